"""Store measurements in a baseline file, and find lines that became slower than it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.measured import Measured

FILE = Path(__file__).with_name("baseline.json")
# A line that takes this share more than in the baseline has become slower.
SLOWER = 0.1


@dataclass(frozen=True)
class Known:
    """A line of the baseline.

    Args:
        ratio: Median of some measurements.
        runs: How many.
        spread: How much larger the largest of them was than the smallest, as a share.
        peer: What the ratio is to, in words; that to another peer is another line.
        ours: Our least time in the measurement that is the median [s].
        theirs: The peer's [s].
        of_bar: What that measurement has of what the bar limits, in words.
        missed: Whether it misses its bar.
        notes: Sentences on what was computed.
    """

    ratio: float
    runs: int
    spread: float
    peer: str
    ours: float | None = None
    theirs: float | None = None
    of_bar: str = "-"
    missed: bool = False
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, repetitions: Sequence[Measured]) -> Known:
        """Summarize some measurements of a line."""
        ordered = sorted(repetitions, key=lambda x: x.ratio)
        middle = ordered[(len(repetitions) - 1) // 2]
        ours, theirs = (_rounded(x) for x in middle.least)
        return cls(
            ratio=_rounded(middle.ratio),
            runs=len(repetitions),
            spread=round(ordered[-1].ratio / ordered[0].ratio - 1, 3),
            peer=middle.line.peer,
            ours=ours,
            theirs=theirs,
            of_bar=middle.of_bar,
            missed=middle.missed,
            notes=middle.notes,
        )


def _rounded(value: float) -> float:
    """Round a measured value to four digits."""
    return float(f"{value:.4g}")


@dataclass(frozen=True)
class Session:
    """Lines measured at one time.

    Args:
        date: The day, as 2026-01-31.
        commit: The commit of this project.
        machine: Processor, cores, and versions of Python and libraries, in words.
        lines: Lines by name.
    """

    date: str
    commit: str
    machine: str
    lines: dict[str, Known]

    def is_like(self, other: Session) -> bool:
        """Return whether a session has the same day, commit and machine."""
        return replace(self, lines={}) == replace(other, lines={})


def read(file: Path) -> list[Session]:
    """Read the sessions of a baseline; none if the file does not exist."""
    if not file.exists():
        return []
    sessions = json.loads(file.read_text(encoding="utf-8"))["sessions"]
    return [
        Session(**{**x, "lines": {k: _read_line(y) for k, y in x["lines"].items()}})
        for x in sessions
    ]


def _read_line(fields: Mapping[str, Any]) -> Known:
    return Known(**{**fields, "notes": tuple(fields.get("notes", ()))})


def write(file: Path, sessions: Iterable[Session]) -> None:
    """Write a baseline with one text line per benchmark line, completely or not at all."""
    texts = []
    for x in sessions:
        head = {key: value for key, value in asdict(x).items() if key != "lines"}
        rows = [
            f"    {json.dumps(k)}: {json.dumps(asdict(v), ensure_ascii=False)}"
            for k, v in sorted(x.lines.items())
        ]
        body = json.dumps(head, ensure_ascii=False)[1:-1].replace('", "', '",\n   "')
        texts.append(f'  {{{body},\n   "lines": {{\n' + ",\n".join(rows) + "\n   }}")
    whole = '{"sessions": [\n' + ",\n".join(texts) + "\n]}\n"
    fresh = file.with_suffix(".new")
    fresh.write_text(whole, encoding="utf-8")
    os.replace(fresh, file)


def baselines_by_name(sessions: Iterable[Session]) -> dict[str, Known]:
    """Return all lines of a baseline by name."""
    return {name: line for x in sessions for name, line in x.lines.items()}


def updated(sessions: Iterable[Session], new: Session) -> list[Session]:
    """Return a baseline with newly measured lines, which leave their earlier session."""
    unchanged = []
    lines = dict(new.lines)
    for x in sessions:
        rest = {name: line for name, line in x.lines.items() if name not in new.lines}
        if x.is_like(new):
            lines |= rest
        elif rest:
            unchanged.append(replace(x, lines=rest))
    return [*unchanged, replace(new, lines=lines)]


def done(sessions: Iterable[Session], new: Session) -> set[str]:
    """Name the lines that were measured for the same commit on the same machine."""
    same = [x for x in sessions if (x.commit, x.machine) == (new.commit, new.machine)]
    return {name for x in same for name in x.lines}


def change(measurement: Measured, lines: Mapping[str, Known]) -> float | None:
    """Return how much slower a line is than in the baseline, as a share; None if it is new."""
    before = lines.get(measurement.line.name)
    if before is None or before.peer != measurement.line.peer:
        return None
    return measurement.ratio / before.ratio - 1


def is_slower(measurement: Measured, lines: Mapping[str, Known]) -> bool:
    """Return whether a line has become slower than in the baseline."""
    more = change(measurement, lines)
    return more is not None and more > SLOWER


def sentences(measurements: Sequence[Measured], lines: Mapping[str, Known]) -> list[str]:
    """Return sentences on the lines: slower ones first, then missed bars, then new lines."""
    messages = []
    slow = [x for x in measurements if is_slower(x, lines)]
    for x in sorted(slow, key=lambda x: -(change(x, lines) or 0.0)):
        before = lines[x.line.name].ratio
        messages.append(
            f"Slower than the baseline by {change(x, lines):.0%}: {x.line.name} takes "
            f"{x.ratio:.3g} of {x.line.peer}, {before:.3g} before."
        )
    if not slow:
        messages.append(f"No line is slower than the baseline by more than {SLOWER:.0%}.")
    messages += [
        f"Misses its bar of {x.line.bar}: {x.line.name} has {x.of_bar}."
        for x in measurements
        if x.missed
    ]
    new = [x.line.name for x in measurements if change(x, lines) is None]
    if new:
        messages.append(f"Not in the baseline yet: {', '.join(new)}.")
    return messages
