"""Write the measured times of the baseline into the pages.

A mark is a comment of HTML, `<!-- KIND: ARGUMENT -->`. The text between it and the next
`<!-- end -->` is replaced:

- `lines: BEGIN ...`: a table of the lines whose names begin so;
- `answers: BEGIN ...`: a table with the results of both sides of these lines;
- `faster: NAME`: the reciprocal of a line's ratio, in words;
- `times: NAME`: a line's times of both sides, in words;
- `sessions: all`: dates, machines and versions of all measurements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from benchmarks import baseline
from benchmarks.baseline import Known, Session
from benchmarks.measured import Line, in_words

ROOT = Path(__file__).parents[1]
FILES = (ROOT / "docs" / "benchmarks.md", ROOT / "README.md")
KINDS = "lines|answers|faster|times|sessions"
MARK = re.compile(rf"(<!-- ({KINDS}): (.+?) -->)(.*?)(<!-- end -->)", re.S)
NOT_YET = "not measured yet"
HEADS = ("line", "armcontour", "compared with", "result")
RIGHT = ("armcontour",)
REFERENCE = "the reference work"


def write(lines: Sequence[Line], sessions: Sequence[Session]) -> list[str]:
    """Write the pages; returns their names."""
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        file.write_text(filled(text, lines, sessions), encoding="utf-8")
    return [x.relative_to(ROOT).as_posix() for x in FILES]


def filled(text: str, lines: Sequence[Line], sessions: Sequence[Session]) -> str:
    """Fill the marks of a page.

    Raises:
        KeyError: A mark names a line that does not exist.
    """
    baselines = baseline.baselines_by_name(sessions)

    def fill(mark: re.Match[str]) -> str:
        begin, kind, argument, _, end = mark.groups()
        if kind == "sessions":
            return f"{begin}\n\n{_sessions(sessions)}\n\n{end}"
        if kind == "lines":
            rows = [x for x in lines if x.name.startswith(tuple(argument.split()))]
            if not rows:
                raise KeyError(f"No line begins with {argument}.")
            return f"{begin}\n\n{_table(rows, baselines)}\n\n{end}"
        if kind == "answers":
            return f"{begin}\n\n{_answers(argument.split(), baselines)}\n\n{end}"
        if argument not in {x.name for x in lines}:
            raise KeyError(f"There is no line {argument}.")
        line = baselines.get(argument)
        words = NOT_YET
        if line is not None:
            words = faster(line.ratio) if kind == "faster" else _times(line)
        return f"{begin}{words}{end}"

    return MARK.sub(fill, text)


def named(text: str) -> list[str]:
    """Return how the lines' names begin of which a page has tables."""
    names = []
    for mark in MARK.finditer(text):
        if mark[2] == "lines":
            names += mark[3].split()
    return names


def _table(lines: Iterable[Line], baselines: Mapping[str, Known]) -> str:
    rows = [HEADS, tuple("--:" if x in RIGHT else "---" for x in HEADS)]
    rows += [(f"`{x.name}`", *_cells(x, baselines.get(x.name))) for x in lines]
    return "\n".join(f"| {' | '.join(map(_plain, row))} |" for row in rows)


def _answers(begins: Sequence[str], baselines: Mapping[str, Known]) -> str:
    """Tabulate the notes of lines, one row for each."""
    rows = [("line", "what was computed"), ("---", "---")]
    for name, line in sorted(baselines.items()):
        if name.startswith(tuple(begins)):
            rows += [(f"`{name}`", note) for note in line.notes]
    return "\n".join(f"| {' | '.join(map(_plain, row))} |" for row in rows)


def _times(line: Known) -> str:
    """Return a line's times of both sides, such as "0.5 ms against 21 ms"."""
    ours, theirs = (NOT_YET if x is None else in_words(x) for x in (line.ours, line.theirs))
    return f"{ours} against {theirs}"


def _cells(line: Line, baseline: Known | None) -> tuple[str, ...]:
    if baseline is None:
        more = " (only if asked for)" if line.full else ""
        return NOT_YET + more, line.peer, "-"
    ours = "-" if baseline.ours is None else in_words(baseline.ours)
    peer = baseline.peer
    if baseline.theirs is not None:
        peer = f"{peer}: {in_words(baseline.theirs)}"
    result = faster(baseline.ratio)
    if baseline.peer == REFERENCE:
        peer = "-"
        result = "-"
    if baseline.missed:
        result = "goal missed" if result == "-" else f"{result}, goal missed"
    return ours, peer, result


def faster(ratio: float) -> str:
    """Write a ratio of times as a speed, such as "38 times faster"."""
    if 0.95 <= ratio <= 1.05:
        return "equal"
    return f"{max(ratio, 1 / ratio):.2g} times {'faster' if ratio < 1 else 'slower'}"


def _plain(text: str) -> str:
    """Escape characters that have a meaning in a table or in HTML."""
    return text.replace("|", "\\|").replace("<", "&lt;")


def _sessions(sessions: Sequence[Session]) -> str:
    days = sorted(x.date for x in sessions)
    parts = dict.fromkeys(y for x in sessions for y in x.machine.split(", "))
    return f"Measured from {days[0]} to {days[-1]}: {_plain(', '.join(parts))}."
