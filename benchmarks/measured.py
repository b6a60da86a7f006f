"""Lines of the table: what is compared with what, how times are taken, and the results.

Times are processor times, taken in rounds in which both sides alternate. A ratio divides the
shortest times, because other work on the machine empties the caches, which makes times longer but
never shorter, and can double the median of short calls. Bars limit medians on a quiet machine. Bars
in seconds are for a machine of one speed, to which the reference work converts times.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median

from benchmarks import reference

# A side of a round takes about this long [s], if it is one of many short calls.
SLICE = 0.03
# Maximum number of calls per side and round.
MOST_CALLS = 60
# The rounds of a line together take about this long [s]; long work is measured once.
BUDGET = 1.5
# Maximum number of rounds per line.
MOST_ROUNDS = 20

# Runs a process and prints what it took. A small process does so, as one begins with the peak
# memory of that which started it.
LAUNCH = """
import resource, subprocess, sys, time
begin = time.perf_counter()
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
wall = time.perf_counter() - begin
used = resource.getrusage(resource.RUSAGE_CHILDREN)
unit = 1 if sys.platform == "darwin" else 1024
print(used.ru_utime + used.ru_stime, wall, used.ru_maxrss * unit)
sys.exit(done.returncode)
"""


class Missing(Exception):
    """A line cannot be measured here; the text says what lacks."""


@dataclass(frozen=True)
class Taken:
    """What one run took: time of the processor and by the clock [s], and peak memory [bytes]."""

    processor: float
    wall: float
    memory: float | None = None

    def of(self, parts: int) -> Taken:
        """Return the time per part, for equal parts."""
        return Taken(self.processor / parts, self.wall / parts, self.memory)


# Runs something so many times and says what each of them took.
Timer = Callable[[int], list[Taken]]


@dataclass(frozen=True)
class Bar:
    """What a line shall not exceed: the ratio to its peer, time [s], memory [bytes].

    Args:
        ratio: Share of the peer's time.
        seconds: Time of the processor, or by the clock, on the machine of the bars.
        memory: Peak memory.
        clock: Whether seconds are by the clock, as for work on several cores.
    """

    ratio: float | None = None
    seconds: float | None = None
    memory: float | None = None
    clock: bool = False

    def __str__(self) -> str:
        parts = []
        if self.ratio is not None:
            parts.append(f"{self.ratio:.3g}")
        if self.seconds is not None:
            parts.append(f"{in_words(self.seconds)}{' by the clock' if self.clock else ''}")
        if self.memory is not None:
            parts.append(f"{self.memory / 1e9:.3g} GB")
        return ", ".join(parts) or "-"

    def missed(self, ratio: float, ours: Taken) -> bool:
        """Return whether a ratio, or a run's time, is above the bar."""
        seconds = ours.wall if self.clock else ours.processor
        pairs = ((ratio, self.ratio), (seconds, self.seconds), (ours.memory, self.memory))
        return any(
            value is not None and limit is not None and value > limit for value, limit in pairs
        )


@dataclass(frozen=True)
class Pair:
    """Both sides of a line, ready to be timed.

    Args:
        ours: Times our work.
        peer: Times the peer's.
        notes: Sentences on what was computed, such as durations.
        warm: Whether both warm themselves, so that the first run counts.
        parts: Number of equal parts in a run of ours and in a run of the peer; times are per part.
    """

    ours: Timer
    peer: Timer
    notes: Callable[[], Iterable[str]] = tuple
    warm: bool = False
    parts: tuple[int, int] = (1, 1)


@dataclass(frozen=True)
class Line:
    """A line of the table.

    Args:
        name: By which the baseline knows it.
        what: What is timed, in words.
        peer: What it is compared with, in words.
        prepare: Makes both sides, which is not timed; raises `Missing`.
        bar: The bar.
        full: Whether it takes so long that it is measured only if asked for.
    """

    name: str
    what: str
    peer: str
    prepare: Callable[[], Pair]
    bar: Bar = Bar()
    full: bool = False


@dataclass(frozen=True)
class Measured:
    """What was found for a line.

    Args:
        line: The line.
        ours: What each of our runs took, or each of its equal parts.
        peer: The same of the peer.
        notes: Sentences on what was computed.
    """

    line: Line
    ours: list[Taken]
    peer: list[Taken]
    notes: tuple[str, ...] = ()

    @cached_property
    def least(self) -> tuple[float, float]:
        """The least times of the processor [s], ours and the peer's."""
        ours, peer = (min(x.processor for x in side) for side in (self.ours, self.peer))
        return ours, peer

    @property
    def ratio(self) -> float:
        """That of the least times."""
        ours, peer = self.least
        return ours / peer

    @cached_property
    def usual(self) -> Taken:
        """What the median of our runs took, and the most memory."""
        memory = [x.memory for x in self.ours if x.memory is not None]
        return Taken(
            median(x.processor for x in self.ours),
            median(x.wall for x in self.ours),
            max(memory, default=None),
        )

    @property
    def usual_ratio(self) -> float:
        """That of the medians."""
        return self.usual.processor / median(x.processor for x in self.peer)

    @property
    def converted(self) -> Taken:
        """The usual, on the machine of the bars."""
        usual = self.usual
        nominal = reference.SECONDS.get(self.line.peer)
        if nominal is None:
            return usual
        factor = nominal / median(x.processor for x in self.peer)
        return replace(usual, processor=factor * usual.processor, wall=factor * usual.wall)

    @property
    def missed(self) -> bool:
        """Return whether the measurement misses its bar."""
        return self.line.bar.missed(self.usual_ratio, self.converted)

    @property
    def of_bar(self) -> str:
        """What it has of what its bar limits, in words."""
        bar = self.line.bar
        usual = self.converted
        time_taken = usual.wall if bar.clock else usual.processor
        return str(
            Bar(
                None if bar.ratio is None else self.usual_ratio,
                None if bar.seconds is None else time_taken,
                None if bar.memory is None else usual.memory,
                bar.clock,
            )
        )


def measure(line: Line, times: int = 1) -> list[Measured]:
    """Prepare a line once and measure it so many times; the first has the notes."""
    pair = line.prepare()
    gc.collect()
    if not pair.warm:
        pair.ours(1)
        pair.peer(1)
    repetitions = [_measure(pair) for _ in range(times)]
    notes = tuple(pair.notes())
    return [Measured(line, *sides, notes) for sides in repetitions]


def _measure(pair: Pair) -> tuple[list[Taken], list[Taken]]:
    ours = pair.ours(1)
    peer = pair.peer(1)
    each = ours[0].processor, min(x.processor for x in peer)
    calls = [max(1, min(MOST_CALLS, int(SLICE / max(x, 1e-6)))) for x in each]
    whole = sum(n * x for n, x in zip(calls, each, strict=True))
    for _ in range(min(MOST_ROUNDS, int(BUDGET / whole))):
        ours += pair.ours(calls[0])
        peer += pair.peer(calls[1])
    return [x.of(pair.parts[0]) for x in ours], [x.of(pair.parts[1]) for x in peer]


def timed(call: Callable[[], object]) -> Timer:
    """Make a timer of a call in this process."""

    def run(times: int) -> list[Taken]:
        taken = []
        for _ in range(times):
            wall = time.perf_counter()
            processor = time.process_time()
            call()
            processor = time.process_time() - processor
            wall = time.perf_counter() - wall
            taken.append(Taken(processor, wall))
        return taken

    return run


def spawned(
    command: Callable[[], Sequence[str]], environment: Callable[[], Mapping[str, str]] = dict
) -> Timer:
    """Make a timer of a process from start to end, with the processes that it waits for.

    Args:
        command: Says what to run.
        environment: Makes the variables of a run that differ from this process's.
    """

    def run(times: int) -> list[Taken]:
        taken = []
        for _ in range(times):
            called = [sys.executable, "-c", LAUNCH, *command()]
            outcome = subprocess.run(
                called, env={**os.environ, **environment()}, capture_output=True, text=True
            )
            if outcome.returncode != 0:
                raise RuntimeError(f"{' '.join(called[3:])}: {outcome.stderr.strip()[-500:]}")
            taken.append(Taken(*(float(x) for x in outcome.stdout.split())))
        return taken

    return run


def in_words(seconds: float) -> str:
    """Format a time with its unit."""
    if seconds < 1e-3:
        return f"{seconds * 1e6:.3g} µs"
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
