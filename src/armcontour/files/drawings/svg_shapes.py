"""Outlines of SVG paths and basic shapes, in the coordinates of their elements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.files.drawings.arc_chain import MAX_CHORD_ANGLE, ArcChain
from armcontour.files.drawings.outlines import BezierSpline, Outline, Shape
from armcontour.files.drawings.svg_elements import (
    EACH_NUMBER,
    MAX_NUMBERS,
    NUMBER,
    NUMBERS,
    Element,
    check_numbers,
    limit_matches,
    parse_numbers,
    read_length,
    read_length_or_zero,
)

# Number of arguments, by path command.
ARGUMENT_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
# Commands for the further points of a move command, which are lines.
FURTHER = {"M": "L", "m": "l"}
LETTERS = "".join(ARGUMENT_COUNTS) + "".join(ARGUMENT_COUNTS).lower()
_LETTER = re.compile(r"([A-DF-Za-df-z])")
_NO_COMMAND = re.compile(r"[^\WMmLlHhVvCcSsQqTtAaZzEe\d_]")
# Separators of path data; possibly none, because the flags of an arc need none.
_GAP = r"[\s,]*+"
_ARC = re.compile(
    rf"{_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}({NUMBER}){_GAP}([01]){_GAP}([01]){_GAP}({NUMBER})"
    rf"{_GAP}({NUMBER})"
)
Command = tuple[str, list[float]]
CountSegments = Callable[[int], None]


def path_outlines(element: Element, count_segments: Callable[[int], None]) -> list[Outline]:
    """Return the outlines of a path, one per subpath."""
    pen = Pen(element)
    for letter, numbers in _commands(element, count_segments):
        pen.execute(letter, numbers)
    pen.end_subpath(closed=False)
    return pen.outlines


def _count_repeats(element: Element, letter: str, given: int, position: int) -> int:
    """Count how often a command is repeated, from its number of arguments."""
    count = ARGUMENT_COUNTS[letter.upper()]
    repeats, remainder = divmod(given, count) if count else (1, given)
    if remainder or not repeats:
        element.refuse(
            f"the command {letter} at character {position + 1} of the path data must have "
            f"{count} numbers or a multiple, but has {given}"
        )
    return repeats


def _commands(element: Element, count_segments: Callable[[int], None]) -> Iterator[Command]:
    """Yield the commands of a path; a command with repeated arguments is yielded repeatedly."""
    text = element.get("d")
    if text == "none":
        return
    unknown = _NO_COMMAND.search(text)
    if unknown is not None:
        element.refuse(
            f"path data has the unknown command {unknown[0]!r} at character {unknown.start() + 1}"
        )
    # Each command counts as a segment; repetitions are counted below.
    count_segments(sum(text.count(x) for x in LETTERS))
    parts = _LETTER.split(text)
    position = len(parts[0])
    if parts[0].strip() or (len(parts) > 1 and parts[1] not in "Mm"):
        element.refuse(f"path data must begin with M, but begins with {text[:20]!r}")
    for letter, chunk in zip(parts[1::2], parts[2::2], strict=True):
        count = ARGUMENT_COUNTS[letter.upper()]
        values = (_parse_arcs if count == 7 else _parse_numbers)(element, chunk, position + 1)
        repeats = _count_repeats(element, letter, len(values), position)
        position += 1 + len(chunk)
        count_segments(repeats - 1)
        for k in range(repeats):
            yield FURTHER.get(letter, letter) if k else letter, values[k * count : (k + 1) * count]


def _parse_numbers(element: Element, chunk: str, position: int) -> list[float]:
    """Parse the arguments of a command from `chunk`, which starts at `position` of the data."""
    good = NUMBERS.match(chunk)
    end = good.end() if good else 0
    if end < len(chunk):
        _refuse_arguments(element, chunk, position, end)
    values = [float(x[0]) for x in limit_matches(EACH_NUMBER.finditer(chunk))]
    return check_numbers(element, f"path data after character {position}", values)


def _parse_arcs(element: Element, chunk: str, position: int) -> list[float]:
    """Parse the arguments of a command A from `chunk`, which starts at `position` of the data."""
    values: list[float] = []
    end = 0
    while (match := _ARC.match(chunk, end)) and len(values) <= MAX_NUMBERS:
        values += [float(x) for x in match.groups()]
        end = match.end()
    if match is None and chunk[end:].strip(" \t\r\n,"):
        _refuse_arguments(element, chunk, position, end)
    return check_numbers(element, f"path data after character {position}", values)


def _refuse_arguments(element: Element, chunk: str, position: int, end: int) -> None:
    """Raise an error for the text from index `end` in the arguments `chunk` of a command."""
    element.refuse(
        f"path data has {chunk[end : end + 20].strip()!r} at character {position + end + 1}, which "
        "is not a valid argument of the command"
    )


@dataclass(slots=True, eq=False)
class Pen:
    """Executes the commands of a path in sequence; points are complex numbers x + i y."""

    element: Element
    outlines: list[Outline] = field(default_factory=list)  # Outlines of the completed subpaths
    shapes: list[Shape] = field(default_factory=list)  # Shapes of the current subpath
    position: complex = 0j  # Current point
    start: complex = 0j  # Start point of the current subpath
    # Points of lines, or control points of Bézier curves, that are not in `shapes` yet.
    pending: list[complex] = field(default_factory=list)
    curved: bool = False  # Whether the points of `pending` are control points of Bézier curves
    # The previous command as a capital letter, and its last control point.
    previous: tuple[str, complex] = ("", 0j)

    def execute(self, letter: str, numbers: Sequence[float]) -> None:
        """Execute one command with its arguments."""
        kind = letter.upper()
        base = self.position if letter.islower() else 0j
        control = self.position
        if kind in "MZ":
            self.end_subpath(closed=kind == "Z")
            self.position = self.start if kind == "Z" else complex(*numbers) + base
            self.start = self.position
        elif kind == "H":
            self._draw(False, [complex(numbers[0] + base.real, self.position.imag)])
        elif kind == "V":
            self._draw(False, [complex(self.position.real, numbers[0] + base.imag)])
        elif kind == "A":
            self._arc(numbers[:5], complex(*numbers[5:]) + base)
        else:
            points = [complex(*x) + base for x in zip(numbers[::2], numbers[1::2], strict=True)]
            if kind == "L":
                self._draw(False, points)
            else:
                control = self._bezier(kind, points)
        self.previous = kind, control

    def end_subpath(self, *, closed: bool) -> None:
        """End the current subpath, which becomes an outline if it has shapes."""
        self._add_pending()
        if self.shapes:
            self.outlines.append(Outline(self.shapes, closed))
        self.shapes = []

    def _bezier(self, kind: str, points: list[complex]) -> complex:
        """Draw a Bézier curve (command C, S, Q or T); return its last control point."""
        last, control = self.previous
        if kind in "ST":
            # The first control point is the last control point of the previous curve, mirrored at
            # the current point. After other commands it is the current point.
            smooth = last in ("CS" if kind == "S" else "QT") and bool(last)
            points = [2 * self.position - control if smooth else self.position, *points]
        if kind in "CS":
            self._draw(True, points)
            return points[1]
        # A quadratic Bézier curve is converted to the equivalent cubic curve.
        b, c = points
        a = self.position
        self._draw(True, [a + 2 / 3 * (b - a), c + 2 / 3 * (b - c), c])
        return b

    def _draw(self, curved: bool, points: list[complex]) -> None:
        """Append points of a line, or control points of a curve, and move the current point."""
        if self.curved != curved:
            self._add_pending()
        self.curved = curved
        self.pending = self.pending or [self.position]
        if not curved or any(x != self.position for x in points):
            self.pending += points
        self.position = points[-1]

    def _add_pending(self) -> None:
        """Convert the points in `pending` to a shape."""
        if len(self.pending) > 1:
            points = _plane(self.pending)
            self.shapes.append(
                BezierSpline(points=points) if self.curved else ArcChain.straight(points)
            )
        self.pending = []

    def _arc(self, numbers: Sequence[float], end: complex) -> None:
        """Draw an arc from the current point; `numbers` are radii, tilt and flags of A."""
        rx, ry, tilt, large, sweep = numbers
        if rx == 0 or ry == 0 or self.position == end:
            self._draw(False, [end])
            return
        self._add_pending()
        first, last = _plane([self.position, end])
        with np.errstate(all="ignore"):
            try:
                arc = _arc_between(
                    first, last, (abs(rx), abs(ry)), math.radians(tilt), bool(large), bool(sweep)
                )
            except (ValueError, ZeroDivisionError, OverflowError):
                arc = None
        if arc is None or not all(np.isfinite(x).all() for x in (arc.cosines, arc.angles)):
            self.element.refuse(
                "an arc of the path data has radii that cannot be scaled to its end points"
            )
        self.shapes.append(arc)
        self.position = end


def _plane(points: Sequence[complex]) -> FloatArray:
    """Convert complex numbers to points in the plane, (n, 2)."""
    array = np.array(points, dtype=np.complex128)
    return np.stack([array.real, array.imag], axis=-1)


def _arc_between(
    first: FloatArray,
    last: FloatArray,
    radii: tuple[float, float],
    tilt: float,
    large: bool,
    sweep: bool,
) -> ArcChain:
    """Return the elliptical arc between two points as defined for SVG's command A."""
    # Radii that are too small are scaled so that the ellipse passes through both points.
    c, s = math.cos(tilt), math.sin(tilt)
    axes = np.array([[c, -s], [s, c]]) * radii
    # The vector between the points, in coordinates that map the ellipse to a unit circle.
    step = np.array([[c, s], [-s, c]]) @ (last - first) / radii
    half = math.hypot(*step) / 2
    if half > 1:
        axes = axes * half
        step = step / half
        half = 1.0
    across = np.array([-step[1], step[0]]) / (2 * half)
    side = 1.0 if sweep != large else -1.0
    center = step / 2 + side * math.sqrt((1 - half) * (1 + half)) * across
    angle = 2 * math.asin(half)
    angle = 2 * math.pi - angle if large else angle
    sine = np.array([center[1], -center[0]]) * (1.0 if sweep else -1.0)
    ends = np.stack([first, last])
    arc = ArcChain.arc(first + axes @ center, axes @ -center, axes @ sine, angle, ends)
    return arc.halve() if angle > MAX_CHORD_ANGLE else arc


def element_outlines(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outlines of an element with a tag in `SHAPES`; empty if the shape has no size."""
    return SHAPES[element.tag](element, count_segments)


def _line(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outline of a line; empty if it has no length."""
    count_segments(1)
    x1, y1, x2, y2 = (read_length_or_zero(element, key) for key in ("x1", "y1", "x2", "y2"))
    if (x1, y1) == (x2, y2):
        return []
    return [Outline([ArcChain.straight(np.array([[x1, y1], [x2, y2]]))])]


def _polyline(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outline of a polyline or polygon; empty if it has fewer than two points."""
    values = parse_numbers(element, "points", element.get("points"))
    if len(values) % 2:
        element.refuse(f"points must be pairs of x and y, but has {len(values)} numbers")
    count_segments(len(values) // 2)
    points = np.array(values).reshape(-1, 2)
    closed = element.tag == "polygon"
    return [Outline([ArcChain.straight(points)], closed)] if len(points) > 1 else []


def _rect(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outline of a rect; empty if it has no width or no height."""
    count_segments(8)
    x, y, width, height = (
        read_length_or_zero(element, key) for key in ("x", "y", "width", "height")
    )
    radii = [read_length(element, key, default=None) for key in ("rx", "ry")]
    rx, ry = (b if a is None else a for a, b in (radii, radii[::-1]))
    rx, ry = rx or 0.0, ry or 0.0
    for key, value in (("width", width), ("height", height), ("rx", rx), ("ry", ry)):
        if value < 0:
            element.refuse(f"{key} must not be negative, but is {value:g}")
    if not (width and height):
        return []
    rx = min(rx, width / 2)
    ry = min(ry, height / 2)
    if not (rx and ry):
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        return [Outline([ArcChain.straight(corners)], closed=True)]
    pen = Pen(element)
    right = x + width
    bottom = y + height
    for letter, numbers in (
        ("M", (x + rx, y)),
        ("H", (right - rx,)),
        ("A", (rx, ry, 0, 0, 1, right, y + ry)),
        ("V", (bottom - ry,)),
        ("A", (rx, ry, 0, 0, 1, right - rx, bottom)),
        ("H", (x + rx,)),
        ("A", (rx, ry, 0, 0, 1, x, bottom - ry)),
        ("V", (y + ry,)),
        ("A", (rx, ry, 0, 0, 1, x + rx, y)),
        ("Z", ()),
    ):
        pen.execute(letter, numbers)
    return pen.outlines


def _circle(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outline of a circle; empty if the radius is zero."""
    count_segments(1)
    radius = read_length_or_zero(element, "r")
    return _full_ellipse(element, (radius, radius), ("r", "r"))


def _ellipse(element: Element, count_segments: CountSegments) -> list[Outline]:
    """Return the outline of an ellipse; empty if a radius is zero."""
    count_segments(1)
    radii = [read_length(element, key, default=None) for key in ("rx", "ry")]
    rx, ry = (b if a is None else a for a, b in (radii, radii[::-1]))
    return _full_ellipse(element, (rx or 0.0, ry or 0.0), ("rx", "ry"))


def _full_ellipse(
    element: Element, radii: tuple[float, float], keys: tuple[str, str]
) -> list[Outline]:
    """Return the outline of an ellipse with radii from the attributes `keys`; empty if one is 0."""
    for key, value in zip(keys, radii, strict=True):
        if value < 0:
            element.refuse(f"{key} must not be negative, but is {value:g}")
    if not all(radii):
        return []
    center = np.array([read_length_or_zero(element, "cx"), read_length_or_zero(element, "cy")])
    # By the SVG standard, an ellipse starts at its point with the largest x.
    cosine, sine = np.diag(radii)
    return [Outline([ArcChain.arc(center, cosine, sine, 2 * np.pi)], closed=True)]


SHAPES: dict[str, Callable[[Element, CountSegments], list[Outline]]] = {
    "path": path_outlines,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
}
