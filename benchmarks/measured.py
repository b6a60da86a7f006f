"""Lines of the table: what is timed against what, how times are taken, and what was found.

Times are those of the processor, medians of rounds in which both sides take turns, so that a
machine with other work gives much the same ratio.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

# A side of a round takes about this long [s], if it is one of many short calls.
SLICE, MOST_CALLS = 0.03, 60
# A line takes about this long [s], in so many rounds; long work is measured once.
BUDGET, MOST_ROUNDS = 1.5, 15

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
        """What one of equal parts took."""
        return Taken(self.processor / parts, self.wall / parts, self.memory)


# Runs something so many times and says what the median of them took.
Timer = Callable[[int], Taken]


@dataclass(frozen=True)
class Bar:
    """What a line shall not exceed: the ratio to its peer, time [s], memory [bytes].

    Args:
        ratio: Share of the peer's time.
        seconds: Time of the processor, or by the clock.
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
        """Whether a ratio, or what a run took, is over the bar."""
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
        parts: Equal parts that a run of ours and of the peer consists of; times are of one.
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
    """What was found for a line: the median ratio, what both sides took, notes."""

    line: Line
    ratio: float
    ours: Taken
    peer: Taken
    notes: tuple[str, ...] = ()

    @property
    def missed(self) -> bool:
        """Whether it misses its bar."""
        return self.line.bar.missed(self.ratio, self.ours)


def measure(line: Line, times: int = 1) -> list[Measured]:
    """Prepare a line once and measure it so many times; the first has the notes."""
    pair = line.prepare()
    gc.collect()
    if not pair.warm:
        pair.ours(1)
        pair.peer(1)
    found = [_measure(line, pair) for _ in range(times)]
    notes = tuple(pair.notes())
    return [Measured(line, x.ratio, x.ours, x.peer, notes) for x in found]


def _measure(line: Line, pair: Pair) -> Measured:
    rounds = [(pair.ours(1), pair.peer(1))]
    calls = [max(1, min(MOST_CALLS, int(SLICE / max(x.processor, 1e-6)))) for x in rounds[0]]
    whole = sum(n * x.processor for n, x in zip(calls, rounds[0], strict=True))
    more = min(MOST_ROUNDS, int(BUDGET / whole))
    if more > 0:
        rounds = [(pair.ours(calls[0]), pair.peer(calls[1])) for _ in range(more)]
    rounds = [(ours.of(pair.parts[0]), peer.of(pair.parts[1])) for ours, peer in rounds]
    ratio = median(ours.processor / peer.processor for ours, peer in rounds)
    return Measured(line, ratio, *(middle(side) for side in zip(*rounds, strict=True)))


def middle(runs: Sequence[Taken]) -> Taken:
    """The median of what runs took, and the most memory."""
    memory = [x.memory for x in runs if x.memory is not None]
    return Taken(
        median(x.processor for x in runs),
        median(x.wall for x in runs),
        max(memory) if memory else None,
    )


def timed(call: Callable[[], object]) -> Timer:
    """A timer of a call in this process."""

    def run(times: int) -> Taken:
        taken = []
        for _ in range(times):
            wall, processor = time.perf_counter(), time.process_time()
            call()
            processor, wall = time.process_time() - processor, time.perf_counter() - wall
            taken.append(Taken(processor, wall))
        return middle(taken)

    return run


def spawned(
    command: Callable[[], Sequence[str]], environment: Callable[[], Mapping[str, str]] = dict
) -> Timer:
    """A timer of a process from its start to its end, with the processes that it waits for.

    Args:
        command: Says what to run.
        environment: Makes the variables of a run that differ from this process's.
    """

    def run(times: int) -> Taken:
        taken = []
        for _ in range(times):
            called = [sys.executable, "-c", LAUNCH, *command()]
            done = subprocess.run(
                called, env={**os.environ, **environment()}, capture_output=True, text=True
            )
            if done.returncode != 0:
                raise RuntimeError(f"{' '.join(called[3:])}: {done.stderr.strip()[-500:]}")
            taken.append(Taken(*(float(x) for x in done.stdout.split())))
        return middle(taken)

    return run


def in_words(seconds: float) -> str:
    """A time with its unit."""
    if seconds < 1e-3:
        return f"{seconds * 1e6:.3g} µs"
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
