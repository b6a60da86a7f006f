"""The figures of speed on pages, written from the baseline between marks, so that none is by hand.

A mark is a comment of HTML, `<!-- KIND: ARGUMENT -->`, and what stands between it and the next
`<!-- end -->` is written anew:

- `lines: BEGIN ...`: a table of the lines whose names begin so, and what was computed in them;
- `ratio: NAME`, `ours: NAME`, `theirs: NAME`: the ratio of a line as a share, the times of both;
- `sessions: all`: when, on what machine and with which versions all of it was measured.
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
MARK = re.compile(r"(<!-- (lines|ratio|ours|theirs|sessions): (.+?) -->)(.*?)(<!-- end -->)", re.S)
NOT_YET = "not measured yet"
HEADS = ("line", "what", "ours", "against", "its time", "ratio", "bar")
RIGHT = ("ours", "its time", "ratio")


def write(lines: Sequence[Line], sessions: Sequence[Session]) -> list[str]:
    """Write the pages; returns their names."""
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        file.write_text(filled(text, lines, sessions), encoding="utf-8")
    return [x.relative_to(ROOT).as_posix() for x in FILES]


def filled(text: str, lines: Sequence[Line], sessions: Sequence[Session]) -> str:
    """A page with what its marks ask for.

    Raises:
        KeyError: A mark names a line that does not exist.
    """
    known = baseline.known(sessions)

    def fill(mark: re.Match[str]) -> str:
        begin, kind, argument, _, end = mark.groups()
        if kind == "sessions":
            return f"{begin}\n\n{_sessions(sessions)}\n\n{end}"
        if kind == "lines":
            rows = [x for x in lines if x.name.startswith(tuple(argument.split()))]
            if not rows:
                raise KeyError(f"No line begins with {argument}.")
            return f"{begin}\n\n{_table(rows, known)}\n\n{end}"
        if argument not in {x.name for x in lines}:
            raise KeyError(f"There is no line {argument}.")
        return f"{begin}{_value(kind, known.get(argument))}{end}"

    return MARK.sub(fill, text)


def named(text: str) -> list[str]:
    """With what the names of lines begin that a page has tables of."""
    return [x for mark in MARK.finditer(text) if mark[2] == "lines" for x in mark[3].split()]


def _value(kind: str, line: Known | None) -> str:
    if line is None:
        return NOT_YET
    if kind == "ratio":
        return f"{100 * line.ratio:.3g} %"
    return _time(line.ours if kind == "ours" else line.theirs)


def _time(seconds: float | None) -> str:
    return "-" if seconds is None else in_words(seconds)


def _table(lines: Iterable[Line], known: Mapping[str, Known]) -> str:
    rows = [HEADS, tuple("--:" if x in RIGHT else "---" for x in HEADS)]
    notes = []
    for line in lines:
        found = known.get(line.name)
        rows.append((f"`{line.name}`", line.what, *_cells(line, found)))
        if found is not None and found.notes:
            notes.append(f"- `{line.name}`: {_plain('; '.join(found.notes))}")
    table = "\n".join(f"| {' | '.join(map(_plain, row))} |" for row in rows)
    return "\n".join([table, "", "What was computed:", "", *notes]) if notes else table


def _cells(line: Line, found: Known | None) -> tuple[str, ...]:
    if found is None:
        more = " (only if asked for)" if line.full else ""
        return NOT_YET + more, line.peer, "-", "-", str(line.bar)
    bar = str(line.bar)
    if found.of_bar != "-":
        bar += f" ({found.of_bar}{', missed' if found.missed else ''})"
    return _time(found.ours), found.peer, _time(found.theirs), f"{found.ratio:.3g}", bar


def _plain(text: str) -> str:
    """Text that is no mark of a table or of HTML."""
    return text.replace("|", "\\|").replace("<", "&lt;")


def _sessions(sessions: Sequence[Session]) -> str:
    rows = ["| measured | commit | machine and versions | lines |", "|---|---|---|---|"]
    everything = baseline.known(sessions)
    for x in sessions:
        names = f"all {len(x.lines)}" if len(sessions) == 1 else _names(x, everything)
        rows.append(f"| {x.date} | {x.commit} | {_plain(x.machine)} | {names} |")
    return "\n".join(rows)


def _names(session: Session, everything: Iterable[str]) -> str:
    """Names of lines; for those with the same first part that alone, if all are of the session."""
    elsewhere = {x.partition("/")[0] for x in everything if x not in session.lines}
    parts = [(x.partition("/")[0], x) for x in sorted(session.lines)]
    return ", ".join(dict.fromkeys(f"`{x if part in elsewhere else part}`" for part, x in parts))
