"""Text for messages and terminals: printable, limited in length, aligned in tables."""

from __future__ import annotations

import inspect
import math
import re
import reprlib
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

# Keys of a value in a file, from the outermost one; items of lists count from 0.
Keys: TypeAlias = tuple[str | int, ...]
# Maximum length of a key in a message [characters].
MAX_KEY_LENGTH = 80
# Maximum length of a value that a message repeats [characters].
MAX_SHOWN = 40
# Longest message [characters]; a longer one would repeat the content of a file.
LONGEST_SENTENCE = 2000

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 4 * MAX_SHOWN
# Longest text of a number [characters]; no program prints more digits.
LONGEST_NUMBER = 100
# Widest line of a table, by default, and of its title [characters].
LINE_WIDTH = 98
# Widest first cell of a table row [characters].
WIDEST_NAME = 60
# Largest number of lines of a table.
MAX_LINES = 60
# Space before each cell in a table row.
CELL_GAP = "  "
# Largest array or list that `repr` shows in full [values].
MAX_SHOWN_VALUES = 6


def make_printable(text: str) -> str:
    r"""Escape every character that is not printable, as in `\x1b`."""
    # These are control characters, ends of line, characters that change the direction of writing,
    # and lone surrogates. Some control the terminal, others make names misleading.
    if text.isprintable():
        return text
    escaped = (x if x.isprintable() else x.encode("unicode_escape").decode() for x in text)
    return "".join(escaped)


def to_line(text: str) -> str:
    """Write one printable line of limited length, for a terminal."""
    return make_printable(shorten(text))


def capitalise(text: str) -> str:
    """Return the text with a capital first letter."""
    return text[:1].upper() + text[1:]


def shorten(text: str, maximum: int = LONGEST_SENTENCE) -> str:
    """Replace the middle of a text with more than `maximum` characters by an ellipsis."""
    if len(text) <= maximum:
        return text
    half = (maximum - 5) // 2
    return f"{text[: maximum - 5 - half]} ... {text[len(text) - half :]}"


def show(value: Any) -> str:
    """Return the first characters of a value's `repr`, for messages."""
    text = _short.repr(value) if not isinstance(value, str) else repr(value[: MAX_SHOWN + 1])
    long = len(value) > MAX_SHOWN if isinstance(value, str) else len(text) > MAX_SHOWN
    return f"{text[:MAX_SHOWN]}..." if long else text


def key_text(keys: Sequence[int | str]) -> str:
    """Write a key path for messages; items of lists are counted from 1.

    >>> key_text(["runs", "one", "points", 0])
    'runs.one.points (item 1)'
    """
    text = ""
    for i, key in enumerate(keys):
        if isinstance(key, str):
            key = shorten(key, MAX_KEY_LENGTH)
            text += f".{key}" if text else key
        elif i and isinstance(keys[i - 1], int):
            text = f"{text[:-1]}, item {key + 1})"
        else:
            text += f" (item {key + 1})"
    return text


def list_some(names: Sequence[str], maximum: int) -> str:
    """Write the first names, separated by commas, and how many names follow.

    >>> list_some(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    listed = ", ".join(names[:maximum])
    return listed if len(names) <= maximum else f"{listed} and {len(names) - maximum} more"


def describe_fields(cls: type) -> dict[str, str]:
    """Read the descriptions of a dataclass's fields from its docstring and those of its bases."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, entries = inspect.cleandoc(base.__doc__ or "").partition("\nArgs:\n")
        for entry in filter(None, re.split(r"\n(?= {4}\w)", entries.split("\n\n")[0])):
            names, _, text = entry.strip().partition(": ")
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def parse_number(text: str) -> float:
    """Parse a finite decimal number; blanks around the number are ignored."""
    # `float` also accepts `1_0`, digits of other scripts, `nan` and `inf`; these are refused.
    if len(text) > LONGEST_NUMBER or not text.isascii() or "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number")
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def plain_number(value: Any) -> float | None:
    """Convert a value of a YAML file to a finite number; None if that is impossible."""
    if isinstance(value, bool):
        return None
    try:
        number = parse_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def format_table(
    title: str, rows: Iterable[Sequence[str]] = (), *, columns: str = "<", width: int = LINE_WIDTH
) -> str:
    """Lay out a title and rows of aligned cells, for `print`."""
    # Rows whose cells after the first are all empty are omitted. Long lines are wrapped; a long
    # table is truncated, and its last line states the number of omitted lines.
    filled = [[shorten(x[0], WIDEST_NAME), *x[1:]] for x in rows if any(x[1:])]
    widths = [max(map(len, x)) for x in zip(*filled, strict=True)]
    align = "<" + columns.ljust(len(widths), columns[-1])
    margin = " " * (sum(widths[:-1]) + len(CELL_GAP) * len(widths))
    lines = []
    for row in filled:
        cells = [f"{x:{a}{w}}" for x, a, w in zip(row, align, widths, strict=False)]
        line = make_printable(CELL_GAP + CELL_GAP.join(cells)).rstrip()
        lines += textwrap.wrap(line, width, subsequent_indent=margin[: width // 2])
    if len(lines) >= MAX_LINES:
        others = len(lines) + 2 - MAX_LINES
        lines[MAX_LINES - 2 :] = [f"{CELL_GAP}... and {others} more lines"]
    return "\n".join([shorten(make_printable(title), LINE_WIDTH), *lines])


def short_repr(value: Any) -> str:
    """Write a dataclass in one line, for `repr`: arrays by shape, other members by class."""
    members = ", ".join(
        f"{x.name}={_member(getattr(value, x.name))}" for x in fields(value) if x.repr
    )
    return f"{type(value).__name__}({members})"


def _member(value: Any) -> str:
    """Write a member of a dataclass briefly."""
    if hasattr(value, "shape") and hasattr(value, "tolist"):
        few = value.size <= MAX_SHOWN_VALUES
        return repr(value.tolist()) if few else f"<{'x'.join(map(str, value.shape))} array>"
    if is_dataclass(value):
        return f"{type(value).__name__}(...)"
    if isinstance(value, Mapping | tuple | list | frozenset) and any(map(is_dataclass, value)):
        return f"<{len(value)} {type(next(iter(value))).__name__}>"
    return value.__name__ if isinstance(value, type) else show(value)


def digits(value: float, count: int = 4) -> str:
    """Format a value with `count` significant digits; large values below 10^15 have no exponent."""
    text = f"{value:.{count}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e15 else text


def distinct(a: float, b: float, count: int = 3) -> tuple[str, str]:
    """Format two values with at least `count` significant digits, so that they look different."""
    texts = digits(a, count), digits(b, count)
    while texts[0] == texts[1] and a != b:
        count = count + 1
        texts = digits(a, count), digits(b, count)
    return texts


def clock(t: float, count: int = 4) -> str:
    """Format a time in s: with `count` significant digits below 1 s, from 1 s on to 0.1 ms."""
    return f"{t:.{count}g}" if abs(t) < 1 else f"{t:.4f}".rstrip("0").rstrip(".")


def format_event(t: float, s: float) -> str:
    """Write the time [s] and arc length [m] of an extreme value."""
    return f"t = {t:.3f} s, s = {digits(s)} m"


def count_noun(count: int, noun: str) -> str:
    """Write a count with its noun, in the plural if needed."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def limit_label(limit: str, joint: int | None) -> str:
    """Write a limit and its joint, if any, such as "joint 2 acceleration"."""
    return limit if joint is None else f"joint {joint + 1} {limit}"


def joint_label(joint: int, names: Sequence[str]) -> str:
    """Write a joint's number, from 1, followed by its name unless that is "joint N".

    >>> joint_label(2, ["base", "elbow"])
    '2 (elbow)'
    """
    name = names[joint - 1]
    return str(joint) if name == f"joint {joint}" else f"{joint} ({name})"
