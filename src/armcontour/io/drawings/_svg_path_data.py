"""The attribute d of SVG paths: svgpathtools reads it, and this keeps it from guessing.

The library leaves out what it does not understand, joins subpaths that touch, and stops at arcs
between equal points; so what it gets is checked before, and one subpath at a time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from armcontour.errors import InvalidInput
from armcontour.io.drawings._svg_strokes import Bend, Straight, Stroke, Subpath, round_between
from armcontour.io.drawings._svg_tree import Element
from armcontour.io.drawings._svg_units import (
    EACH_NUMBER,
    MOST_NUMBERS,
    NUMBER,
    NUMBERS,
    checked,
    limited,
)

# How many numbers each command takes.
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
LETTERS = "".join(COUNTS) + "".join(COUNTS).lower()
_LETTER = re.compile(r"([A-DF-Za-df-z])")
_NO_COMMAND = re.compile(r"[^\WMmLlHhVvCcSsQqTtAaZzEe\d_]")
# An arc's two flags may stand without anything between them.
_GAP = r"[\s,]*+"
_ARC = re.compile(
    rf"{_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}([01]){_GAP}([01]){_GAP}({NUMBER})"
    rf"{_GAP}({NUMBER})"
)
Command = tuple[str, list[float]]


def subpaths_of(element: Element, spend: Callable[[int], None]) -> list[Subpath]:
    """The subpaths of a path.

    Args:
        element: The path.
        spend: Called with the number of segments before they are made; may refuse them.

    Raises:
        InvalidInput: Path data that is not of its grammar, svgpathtools is missing.
    """
    found = []
    for commands, closed in _subpaths(_commands(element, spend), element):
        strokes = _strokes(commands, element)
        if strokes:
            found.append(Subpath(strokes, closed))
    return found


def _commands(element: Element, spend: Callable[[int], None]) -> Iterator[Command]:
    """Commands with the numbers of one repetition each.

    Raises:
        InvalidInput: What is no command, or too few numbers.
    """
    text = element.get("d")
    if text == "none":
        return
    unknown = _NO_COMMAND.search(text)
    if unknown is not None:
        element.refuse(
            f"path data has the unknown command {unknown[0]!r} at character {unknown.start() + 1}"
        )
    # Every command is a segment; what repeats it comes on top.
    spend(sum(text.count(x) for x in LETTERS))
    parts = _LETTER.split(text)
    at = len(parts[0])
    if parts[0].strip() or (len(parts) > 1 and parts[1] not in "Mm"):
        element.refuse(f"path data begins with {text[:20]!r}: it must begin with M")
    for letter, chunk in zip(parts[1::2], parts[2::2], strict=True):
        count = COUNTS[letter.upper()]
        values = (_arcs if count == 7 else _numbers)(element, chunk, at + 1)
        if (len(values) % count if count else len(values)) or (count and not values):
            element.refuse(
                f"the command {letter} at character {at + 1} of the path data takes {count} "
                f"numbers, but has {len(values)}"
            )
        at += 1 + len(chunk)
        spend(len(values) // count - 1 if count else 0)
        if not count:
            yield letter, []
        for k in range(0, len(values), count or 1):
            # Behind a move, more points are lines.
            shown = letter if k == 0 or letter not in "Mm" else "L" if letter == "M" else "l"
            yield shown, values[k : k + count]


def _numbers(element: Element, chunk: str, at: int) -> list[float]:
    good = NUMBERS.match(chunk)
    end = good.end() if good else 0
    if end < len(chunk):
        _refuse(element, chunk, at, end)
    values = [float(x[0]) for x in limited(EACH_NUMBER.finditer(chunk))]
    return checked(element, f"path data behind character {at}", values)


def _arcs(element: Element, chunk: str, at: int) -> list[float]:
    values: list[float] = []
    end = 0
    while (match := _ARC.match(chunk, end)) and len(values) <= MOST_NUMBERS:
        values += [float(x) for x in match.groups()]
        end = match.end()
    if match is None and chunk[end:].strip(" \t\r\n,"):
        _refuse(element, chunk, at, end)
    return checked(element, f"path data behind character {at}", values)


def _refuse(element: Element, chunk: str, at: int, end: int) -> None:
    element.refuse(
        f"path data has {chunk[end : end + 20].strip()!r} at character {at + end + 1}, which is "
        "not what its command takes"
    )


def _subpaths(
    commands: Iterator[Command], element: Element
) -> Iterator[tuple[list[Command], bool]]:
    """Commands of one subpath each, the first of which is an absolute move, and whether closed."""
    here = start = 0j
    current: list[Command] = []
    for letter, x in commands:
        if letter in "Mm":
            if len(current) > 1:
                yield current, False
            here = start = complex(*x) + (here if letter == "m" else 0)
            current = [("M", [here.real, here.imag])]
        elif letter in "Zz":
            if len(current) > 1:
                yield current, True
            here = start
            current = [("M", [start.real, start.imag])]
        else:
            end = _end(letter, x, here)
            current.append(_plain(letter, x, here, end))
            here = end
    if len(current) > 1:
        yield current, False


def _end(letter: str, x: list[float], here: complex) -> complex:
    if letter in "Hh":
        return complex(x[0] + (here.real if letter == "h" else 0.0), here.imag)
    if letter in "Vv":
        return complex(here.real, x[0] + (here.imag if letter == "v" else 0.0))
    return complex(x[-2], x[-1]) + (here if letter.islower() else 0)


def _plain(letter: str, x: list[float], here: complex, end: complex) -> Command:
    """An arc without a radius or of no length as the line that it means."""
    if letter in "Aa" and (x[0] == 0 or x[1] == 0 or here == end):
        return "L", [end.real, end.imag]
    return letter, x


def _strokes(commands: list[Command], element: Element) -> list[Stroke]:
    """The strokes of one subpath."""
    try:
        from svgpathtools import parse_path  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise InvalidInput(
            f"{element.source}: reading SVG needs svgpathtools: pip install 'armcontour[drawings]'."
        ) from None
    text = " ".join(_written(letter, x) for letter, x in commands)
    try:
        with np.errstate(all="ignore"):
            segments = list(parse_path(text))
    except Exception:  # its parser checks little, and stops with whatever comes of it
        element.refuse(f"path data near {text[:40]!r} cannot be followed")
    return _grouped(segments, element)


def _written(letter: str, x: list[float]) -> str:
    if letter in "Aa":
        return f"{letter}{x[0]!r} {x[1]!r} {x[2]!r} {int(x[3])} {int(x[4])} {x[5]!r} {x[6]!r}"
    return letter + " ".join(map(repr, x))


def _grouped(segments: list[Any], element: Element) -> list[Stroke]:
    from svgpathtools import Arc, Line

    strokes: list[Stroke] = []
    line: list[complex] = []
    for x in segments:
        if isinstance(x, Line):
            line = line or [x.start]
            line.append(x.end)
            continue
        if line:
            strokes.append(Straight(_points(line)))
            line = []
        strokes.append(_arc(x, element) if isinstance(x, Arc) else _bend(x.bpoints()))
    if line:
        strokes.append(Straight(_points(line)))
    return strokes


def _points(values: Any) -> Any:
    array = np.array(values, dtype=np.complex128)
    return np.stack([array.real, array.imag], axis=-1)


def _bend(controls: tuple[complex, ...]) -> Bend:
    points = _points(controls)
    if len(points) == 3:
        # A quadratic as the cubic that it is.
        a, b, c = points
        points = np.stack([a, a + 2 / 3 * (b - a), c + 2 / 3 * (b - c), c])
    return Bend(points)


def _arc(x: Any, element: Element) -> Stroke:
    first, last = _points([x.start, x.end])
    radii = (abs(x.radius.real), abs(x.radius.imag))
    with np.errstate(all="ignore"):
        try:
            arc = round_between(
                first, last, radii, math.radians(x.rotation), large=x.large_arc, sweep=x.sweep
            )
        except (ValueError, ZeroDivisionError, OverflowError):
            element.refuse("an arc of the path data has radii that do not fit its ends")
    if not all(np.isfinite(v).all() for v in (arc.center, arc.axes, arc.begin, arc.turn)):
        element.refuse("an arc of the path data has radii that do not fit its ends")
    return arc
