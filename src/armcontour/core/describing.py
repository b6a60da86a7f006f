"""What results say of themselves in a terminal: aligned lines for people, one line for `repr`."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from importlib import import_module
from typing import Any

from armcontour.core.text import make_printable, shorten, show

# Widest line and widest name of a row [characters], and most lines.
WIDTH, WIDEST_NAME, MOST_LINES = 98, 60, 60
GAP = "  "
# Values of an array, or members of a list, that `repr` writes out.
FEW = 6


def format_table(
    title: str, rows: Iterable[Sequence[str]] = (), *, columns: str = "<", width: int = WIDTH
) -> str:
    """A title, and below it rows of aligned cells, for `print`.

    Rows whose cells after the first are all empty are left out. Long lines go on in the next one;
    of too many lines, the number of the others is said.

    Args:
        title: The first line.
        rows: The cells, the name of the row first.
        columns: Alignment of the columns after the first, as in a format, "<" or ">"; the last one
            holds for all columns that follow.
        width: Longest line.
    """
    kept = [[shorten(x[0], WIDEST_NAME), *x[1:]] for x in rows if any(x[1:])]
    widths = [max(map(len, x)) for x in zip(*kept, strict=True)]
    align = "<" + columns.ljust(len(widths), columns[-1])
    margin = " " * (sum(widths[:-1]) + len(GAP) * len(widths))
    lines = []
    for row in kept:
        cells = [f"{x:{a}{w}}" for x, a, w in zip(row, align, widths, strict=False)]
        line = make_printable(GAP + GAP.join(cells)).rstrip()
        lines += textwrap.wrap(line, width, subsequent_indent=margin[: width // 2])
    if len(lines) >= MOST_LINES:
        others = len(lines) + 2 - MOST_LINES
        lines[MOST_LINES - 2 :] = [f"{GAP}... and {others} more lines"]
    return "\n".join([shorten(make_printable(title), WIDTH), *lines])


def short_repr(value: Any) -> str:
    """A dataclass in one line: arrays by their shapes, what it holds by its classes; for `repr`."""
    shown = ", ".join(
        f"{x.name}={_member(getattr(value, x.name))}" for x in fields(value) if x.repr
    )
    return f"{type(value).__name__}({shown})"


def to_html(value: Any) -> str:
    """What a result prints, as a table of HTML; for `_repr_html_` in notebooks."""
    title, *lines = str(value).splitlines()
    rows: list[list[str]] = []
    for x in lines:
        if rows and x.startswith(GAP * 3):
            # A long line goes on.
            rows[-1][-1] += f" {x.strip()}"
        else:
            rows.append(re.split(f"{GAP}+", x.strip()))
    cells = ("".join(f"<td>{escape(x)}</td>" for x in row) for row in rows)
    body = "".join(f"<tr>{x}</tr>" for x in cells)
    if not rows:
        return f"<p>{escape(title)}</p>"
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def draw(value: Any, kind: str = "path") -> Any:
    """Draw a result as the report does: a figure of plotly, to show, change or save.

        planned.figure("speed").show()
        result.figure("error").write_html("error.html")

    Args:
        value: The result.
        kind: "path", the path of the tool; "joints", positions, velocities and accelerations with
            limits, of a study those of its first run; "speed", the tool speed with the assigned
            velocity; "error", the contour error.

    Raises:
        InvalidInput: There is no such kind, or the result has nothing of it.
    """
    # An import by name: what draws knows the results.
    return import_module("armcontour.report.results").draw_result(value, kind)


def _member(value: Any, depth: int = 0) -> str:
    """A member of a dataclass in a few characters."""
    if hasattr(value, "shape") and hasattr(value, "tolist"):
        few = value.size <= FEW
        return repr(value.tolist()) if few else f"<{'x'.join(map(str, value.shape))} array>"
    if is_dataclass(value):
        return f"{type(value).__name__}(...)"
    if isinstance(value, Mapping | tuple | list | frozenset) and value:
        return _members(value, depth)
    return value.__name__ if isinstance(value, type) else show(value)


def _members(value: Any, depth: int) -> str:
    """A mapping or a list in a few characters."""
    if len(value) > FEW or depth > 1:
        return f"<{len(value)} {type(next(iter(value))).__name__}>"
    if isinstance(value, Mapping):
        inner = [f"{show(name)}: {_member(x, depth + 1)}" for name, x in value.items()]
        return f"{{{', '.join(inner)}}}"
    inner = [_member(x, depth + 1) for x in value]
    return f"[{', '.join(inner)}]" if isinstance(value, list) else f"({', '.join(inner)})"


def digits(value: float, count: int = 4) -> str:
    """A number with some digits that count, and without an exponent below 10^15.

    Args:
        value: The number.
        count: Number of digits.
    """
    text = f"{value:.{count}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e15 else text


def clock(t: float, count: int = 4) -> str:
    """A time in s with some digits that count, and 0.1 ms also long after zero, as since 1970.

    Args:
        t: The time [s].
        count: Number of digits of times below 1 s.
    """
    return f"{t:.{count}g}" if abs(t) < 1 else f"{t:.4f}".rstrip("0").rstrip(".")


def place_and_time(t: float, s: float) -> str:
    """When and where something is largest.

    Args:
        t: The time [s].
        s: The arc length [m].
    """
    return f"t = {t:.3f} s, s = {digits(s)} m"


def count_noun(count: int, what: str) -> str:
    """A count with its noun."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def count_kinds(counts: Mapping[str, int]) -> str:
    """Counts with their nouns, without what there is none of.

    Args:
        counts: Counts by their nouns.
    """
    return ", ".join(count_noun(n, what) for what, n in counts.items() if n)


def joint_called(joint: int, names: Sequence[str]) -> str:
    """The number of a joint, from 1, with its name if that says more."""
    name = names[joint - 1]
    return str(joint) if name == f"joint {joint}" else f"{joint} ({name})"


def joint_rows(q: Any, names: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Rows that say between which positions joints are.

    Args:
        q: Joint positions [rad], (n, dof).
        names: Names of the joints; by default their numbers from 1.
    """
    ends = zip(q.min(axis=0), q.max(axis=0), strict=True)
    return [
        (names[j] if names else f"joint {j + 1}", f"{low:z.4f} to {high:z.4f} rad")
        for j, (low, high) in enumerate(ends)
    ]
