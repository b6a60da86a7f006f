"""Outlines from the path data of SVG paths (the attribute d)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.files.drawings._svg_tree import Element
from armcontour.files.drawings._svg_units import (
    EACH_NUMBER,
    MOST_NUMBERS,
    NUMBER,
    NUMBERS,
    check_numbers,
    limit_matches,
)
from armcontour.files.drawings.chain import WELL_KNOWN, Chain
from armcontour.files.drawings.shapes import Outline, Shape
from armcontour.files.drawings.splines import Spline

# Number of arguments of each command.
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
# Commands of further points after a move command.
FURTHER = {"M": "L", "m": "l"}
LETTERS = "".join(COUNTS) + "".join(COUNTS).lower()
_LETTER = re.compile(r"([A-DF-Za-df-z])")
_NO_COMMAND = re.compile(r"[^\WMmLlHhVvCcSsQqTtAaZzEe\d_]")
# Between the two flags of an arc no separator is needed.
_GAP = r"[\s,]*+"
_ARC = re.compile(
    rf"{_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}([01]){_GAP}([01]){_GAP}({NUMBER})"
    rf"{_GAP}({NUMBER})"
)
Command = tuple[str, list[float]]


def outlines_of(element: Element, spend: Callable[[int], None]) -> list[Outline]:
    """The outlines of a path, one per subpath.

    Args:
        element: The path.
        spend: Called with a number of segments before they are made; may refuse them.

    Raises:
        InvalidInput: The path data do not follow SVG's grammar.
    """
    pen = Pen(element)
    for letter, numbers in _commands(element, spend):
        pen.obey(letter, numbers)
    pen.lift(closed=False)
    return pen.outlines


def _commands(element: Element, spend: Callable[[int], None]) -> Iterator[Command]:
    """Yield the commands of a path, each repetition with its own numbers.

    Raises:
        InvalidInput: A command is unknown, or has the wrong number of arguments.
    """
    text = element.get("d")
    if text == "none":
        return
    unknown = _NO_COMMAND.search(text)
    if unknown is not None:
        element.refuse(
            f"path data has the unknown command {unknown[0]!r} at character {unknown.start() + 1}"
        )
    # Each command is a segment; repetitions are added below.
    spend(sum(text.count(x) for x in LETTERS))
    parts = _LETTER.split(text)
    at = len(parts[0])
    if parts[0].strip() or (len(parts) > 1 and parts[1] not in "Mm"):
        element.refuse(f"path data begins with {text[:20]!r}: it must begin with M")
    for letter, chunk in zip(parts[1::2], parts[2::2], strict=True):
        count = COUNTS[letter.upper()]
        values = (_arcs if count == 7 else _numbers)(element, chunk, at + 1)
        repeats, rest = divmod(len(values), count) if count else (1, len(values))
        if rest or not repeats:
            element.refuse(
                f"the command {letter} at character {at + 1} of the path data takes {count} "
                f"numbers, but has {len(values)}"
            )
        at += 1 + len(chunk)
        spend(repeats - 1)
        for k in range(repeats):
            yield FURTHER.get(letter, letter) if k else letter, values[k * count : (k + 1) * count]


def _numbers(element: Element, chunk: str, at: int) -> list[float]:
    """The arguments of a command, whose text `chunk` starts at character `at` (from 0).

    Raises:
        InvalidInput: The text is not a list of numbers.
    """
    good = NUMBERS.match(chunk)
    end = good.end() if good else 0
    if end < len(chunk):
        _refuse(element, chunk, at, end)
    values = [float(x[0]) for x in limit_matches(EACH_NUMBER.finditer(chunk))]
    return check_numbers(element, f"path data after character {at}", values)


def _arcs(element: Element, chunk: str, at: int) -> list[float]:
    """The arguments of a command A, whose text `chunk` starts at character `at` (from 0).

    Raises:
        InvalidInput: The text is not a list of arguments of A.
    """
    values: list[float] = []
    end = 0
    while (match := _ARC.match(chunk, end)) and len(values) <= MOST_NUMBERS:
        values += [float(x) for x in match.groups()]
        end = match.end()
    if match is None and chunk[end:].strip(" \t\r\n,"):
        _refuse(element, chunk, at, end)
    return check_numbers(element, f"path data after character {at}", values)


def _refuse(element: Element, chunk: str, at: int, end: int) -> None:
    """Refuse the arguments of a command from character `end` of its text.

    Raises:
        InvalidInput: Always.
    """
    element.refuse(
        f"path data has {chunk[end : end + 20].strip()!r} at character {at + end + 1}, which is "
        "not what its command takes"
    )


@dataclass(slots=True, eq=False)
class Pen:
    """Executes the commands of a path one after the other; points are complex numbers.

    Args:
        element: The path.
        outlines: Outlines of the completed subpaths.
        shapes: Shapes of the current subpath.
        here: The current point.
        start: Start point of the current subpath.
        drawn: Points of lines, or control points of Bézier curves, that are not yet a shape.
        curved: Whether the points of `drawn` are control points of Bézier curves.
        before: The previous command, in capitals, and its last control point.
    """

    element: Element
    outlines: list[Outline] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    here: complex = 0j
    start: complex = 0j
    drawn: list[complex] = field(default_factory=list)
    curved: bool = False
    before: tuple[str, complex] = ("", 0j)

    def obey(self, letter: str, numbers: Sequence[float]) -> None:
        """Execute one command with its arguments."""
        kind, base = letter.upper(), self.here if letter.islower() else 0j
        control = self.here
        if kind in "MZ":
            self.lift(closed=kind == "Z")
            self.here = self.start if kind == "Z" else complex(*numbers) + base
            self.start = self.here
        elif kind == "H":
            self._line(complex(numbers[0] + base.real, self.here.imag))
        elif kind == "V":
            self._line(complex(self.here.real, numbers[0] + base.imag))
        elif kind == "A":
            self._arc(numbers[:5], complex(*numbers[5:]) + base)
        else:
            points = [complex(*x) + base for x in zip(numbers[::2], numbers[1::2], strict=True)]
            if kind == "L":
                self._line(points[0])
            else:
                control = self._bezier(kind, points)
        self.before = kind, control

    def lift(self, *, closed: bool) -> None:
        """End the current subpath; it becomes an outline if it has shapes."""
        self._finish()
        if self.shapes:
            self.outlines.append(Outline(self.shapes, closed))
        self.shapes = []

    def _line(self, end: complex) -> None:
        """Draw a line from the current point."""
        self._draw(False, [end])

    def _bezier(self, kind: str, points: list[complex]) -> complex:
        """Draw a command C, S, Q or T; returns its last control point."""
        last, control = self.before
        if kind in "ST":
            # The control point of the previous curve, mirrored at the current point.
            smooth = last in ("CS" if kind == "S" else "QT") and bool(last)
            points = [2 * self.here - control if smooth else self.here, *points]
        if kind in "CS":
            self._draw(True, points)
            return points[1]
        # A quadratic Bézier curve as an equal cubic one.
        (b, c), a = points, self.here
        self._draw(True, [a + 2 / 3 * (b - a), c + 2 / 3 * (b - c), c])
        return b

    def _draw(self, curved: bool, points: list[complex]) -> None:
        """Append points of a line or control points of a curve, after the current point."""
        if self.curved != curved:
            self._finish()
        self.curved = curved
        self.drawn = self.drawn or [self.here]
        if not curved or any(x != self.here for x in points):
            self.drawn += points
        self.here = points[-1]

    def _finish(self) -> None:
        """Make a shape of the points in `drawn`."""
        if len(self.drawn) > 1:
            points = _plane(self.drawn)
            self.shapes.append(Spline(points=points) if self.curved else Chain.straight(points))
        self.drawn = []

    def _arc(self, numbers: Sequence[float], end: complex) -> None:
        """Draw an arc from the current point, with the arguments of A before its end point.

        Raises:
            InvalidInput: The radii do not fit the end points.
        """
        rx, ry, tilt, large, sweep = numbers
        if rx == 0 or ry == 0 or self.here == end:
            self._line(end)
            return
        self._finish()
        first, last = _plane([self.here, end])
        with np.errstate(all="ignore"):
            try:
                arc = _arc_between(
                    first, last, (abs(rx), abs(ry)), math.radians(tilt), bool(large), bool(sweep)
                )
            except (ValueError, ZeroDivisionError, OverflowError):
                arc = None
        if arc is None or not all(np.isfinite(x).all() for x in (arc.cosines, arc.angles)):
            self.element.refuse("an arc of the path data has radii that do not fit its ends")
        self.shapes.append(arc)
        self.here = end


def _plane(points: Sequence[complex]) -> FloatArray:
    """Complex numbers as points in the plane, (n, 2)."""
    array = np.array(points, dtype=np.complex128)
    return np.stack([array.real, array.imag], axis=-1)


def _arc_between(
    first: FloatArray,
    last: FloatArray,
    radii: tuple[float, float],
    tilt: float,
    large: bool,
    sweep: bool,
) -> Chain:
    """The elliptical arc between two points as defined by SVG's command A.

    Radii that are too small are increased until the ellipse passes through both points.

    Args:
        first: Start point, (2,).
        last: End point, different from the start point, (2,).
        radii: Semi-axes of the ellipse, above zero.
        tilt: Rotation of the ellipse [rad].
        large: Whether the arc is the one of more than half a turn.
        sweep: Whether the angle increases along the arc.
    """
    c, s = math.cos(tilt), math.sin(tilt)
    axes = np.array([[c, -s], [s, c]]) * radii
    # The vector between the points, in coordinates in which the ellipse is a unit circle.
    step = np.array([[c, s], [-s, c]]) @ (last - first) / radii
    half = math.hypot(*step) / 2
    if half > 1:
        axes, step, half = axes * half, step / half, 1.0
    across = np.array([-step[1], step[0]]) / (2 * half)
    side = 1.0 if sweep != large else -1.0
    center = step / 2 + side * math.sqrt((1 - half) * (1 + half)) * across
    angle = 2 * math.asin(half)
    angle = 2 * math.pi - angle if large else angle
    sine = np.array([center[1], -center[0]]) * (1.0 if sweep else -1.0)
    ends = np.stack([first, last])
    arc = Chain.arc(first + axes @ center, axes @ -center, axes @ sine, angle, ends)
    return arc.halve() if angle > WELL_KNOWN else arc
