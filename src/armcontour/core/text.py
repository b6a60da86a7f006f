"""Text of other people for messages: printable, in one line, of limited length; and numbers."""

from __future__ import annotations

import difflib
import inspect
import math
import re
import reprlib
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from importlib import import_module
from typing import Any

# Characters of a value that a message repeats.
MOST_SHOWN = 40
# Longest message; a longer one would repeat the content of a file.
LONGEST_SENTENCE = 2000

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 4 * MOST_SHOWN
# Longest text of a number; no program prints more digits.
LONGEST = 100


def make_printable(text: str) -> str:
    r"""The text with an escape, such as `\x1b`, for every character that is not printable.

    Such characters are control characters, ends of line, characters that change the direction of
    writing, and lone surrogates. Some control the terminal, others make names misleading.
    """
    if text.isprintable():
        return text
    return "".join(x if x.isprintable() else _escape(x) for x in text)


def to_line(text: str) -> str:
    """The text as one printable line of limited length, for a terminal."""
    return make_printable(shorten(text))


def capitalise(text: str) -> str:
    """The text with a capital at its start, as a sentence begins."""
    return text[:1].upper() + text[1:]


def shorten(text: str, most: int = LONGEST_SENTENCE) -> str:
    """The text; its middle is left out if the text has more than `most` characters."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[: most - 5 - half]} ... {text[len(text) - half :]}"


def show(value: Any) -> str:
    """The start of a value as Python writes it, for messages."""
    text = _short.repr(value) if not isinstance(value, str) else repr(value[: MOST_SHOWN + 1])
    long = len(value) > MOST_SHOWN if isinstance(value, str) else len(text) > MOST_SHOWN
    return f"{text[:MOST_SHOWN]}..." if long else text


def list_some(names: Sequence[str], most: int) -> str:
    """The first names, separated by commas, and the number of other names."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def suggest(name: str, known: Iterable[str], otherwise: str) -> str:
    """A question with the known name that is most similar to an unknown one, or `otherwise`."""
    known = list(known)
    # Two words of the field for one quantity.
    alike = [
        x for x in known if x.replace("velocity", "speed") == name.replace("velocity", "speed")
    ]
    near = alike or difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]}?" if near else otherwise


def describe_fields(cls: type) -> dict[str, str]:
    """Descriptions of the fields of a dataclass, from its docstring and those of its bases."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, rest = inspect.cleandoc(base.__doc__ or "").partition("\nArgs:\n")
        for entry in filter(None, re.split(r"\n(?= {4}\w)", rest.split("\n\n")[0])):
            names, _, text = entry.strip().partition(": ")
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def _escape(character: str) -> str:
    """The escape of a character."""
    return character.encode("unicode_escape").decode("ascii")


def parse_number(text: str) -> float:
    """Parse a finite decimal number; blanks around the number are ignored.

    `float` also accepts `1_0`, digits of other scripts, `nan` and `inf`; these are refused.

    Raises:
        ValueError: The text is not a finite decimal number.
    """
    if len(text) > LONGEST or not text.isascii() or "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number")
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def plain_number(value: Any) -> float | None:
    """Convert a value of a YAML file to a finite number; None if the value is no number."""
    if isinstance(value, bool):
        return None
    try:
        found = parse_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


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
        InvalidInput: There is no such kind, the result has nothing of it, or plotly is not
            installed.
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
