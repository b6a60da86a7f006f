"""Parallels of lines and arcs, and where neighbours cross.

All points are in the plane XY [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.gcode.arcs import Point
from armcontour.io.drawings.gcode.faults import Fault

# Sine of a turn below which a move goes straight back [rad].
STRAIGHT_BACK = 1e-9
# Lengths along parallels that differ by so little are one [m].
SLACK = REPEATED_POINT


@dataclass(slots=True)
class Beside:
    """The way of the tool's centre beside a move, as long as no corner has shortened it.

    Args:
        start: Start [m].
        end: End [m].
        tangents: Unit tangents at start and end.
        corner: Programmed start of the move [m].
        z: Height at the end [m].
        length: Length [m].
        bend: Curvature of the programmed move [1/m], positive to the left.
        curvature: Curvature of this way [1/m], positive to the left.
        line: Line of the program; 0 for a rapid.
        speed: Speed [m/s].
        tolerance: Largest corner error [m].
        first: Where it begins, by its length [m]: above 0 after an inside corner.
        entry: Whether it is the straight move that leads to the contour.
    """

    start: Point
    end: Point
    tangents: tuple[Point, Point]
    corner: Point
    z: float
    length: float
    bend: float = 0.0
    curvature: float = 0.0
    line: int = 0
    speed: float = math.nan
    tolerance: float = math.nan
    first: float = 0.0
    entry: bool = False

    def at(self, way: float) -> tuple[Point, Point]:
        """Point and unit tangent at a length from the start [m]."""
        (x, y), (tx, ty), k = self.start, self.tangents[0], self.curvature
        along = math.sin(k * way) / k if k else way
        across = 2 * math.sin(k * way / 2) ** 2 / k if k else 0.0
        point = (x + along * tx - across * ty, y + along * ty + across * tx)
        return point, turned((tx, ty), k * way)


def turn_between(before: Beside, found: Beside, left: float) -> float:
    """The angle from one move to the next, positive to the left [rad].

    A move straight back turns around the outside of the tip, as in LinuxCNC, unless it bends away
    to the tool's side, where both make an inside corner.
    """
    a, b = before.tangents[1], found.tangents[0]
    sine, cosine = cross(a, b), dot(a, b)
    if cosine < 0 and abs(sine) <= STRAIGHT_BACK:
        inside = (before.bend + found.bend) * left < 0
        return math.copysign(math.pi, left if inside else -left)
    return math.atan2(sine, cosine)


def cut_corner(before: Beside, found: Beside, radius: float) -> float:
    """Shortens two ways at an inside corner up to where they cross.

    Returns:
        The length at which the first one ends [m].

    Raises:
        Fault: They do not cross, or one of them is too short.
    """
    corner, lengths = "an inside corner at ({}, {}) for a tool of {}", (*found.corner, 2 * radius)
    mend = "take a smaller tool, or round the corner by more than the tool's radius"
    ways = [x for x in _ways_to_crossings(before, found) if min(x) >= -SLACK]
    if not ways:
        raise Fault(f"{corner}, into which it does not fit: {mend}", *lengths)
    back, ahead = min(ways)
    left = before.length - before.first
    if back > left + SLACK and not before.entry:
        raise Fault(
            f"{corner}, which shortens the move before it by {{}}, of which {{}} are left: {mend}",
            *lengths, back, left,
        )  # fmt: skip
    if ahead > found.length + SLACK:
        raise Fault(
            f"{corner}, which shortens the move after it by {{}}, which is {{}} long: {mend}",
            *lengths, ahead, found.length,
        )  # fmt: skip
    found.first = ahead
    return before.length - back


def _ways_to_crossings(before: Beside, found: Beside) -> list[tuple[float, float]]:
    """How far crossings of two ways lie before the end of one, and after the start of the other.

    Relative to the ends, so that crossings of nearly tangent arcs of any radius are exact: a circle
    through a point with tangent t, left normal n and curvature k has k x.x / 2 = n.x there.
    """
    ta, tb, ka, kb = before.tangents[1], found.tangents[0], before.curvature, found.curvature
    apart = minus(found.start, before.end)
    if not (ka or kb):
        sine = cross(ta, tb)
        return [(-cross(apart, tb) / sine, cross(apart, ta) / sine)]
    if abs(ka) >= abs(kb):
        crossings = _crossings(ta, ka, tb, kb, apart)
    else:
        others = _crossings(tb, kb, ta, ka, minus((0.0, 0.0), apart))
        crossings = [(x + apart[0], y + apart[1]) for x, y in others]
    return [
        (_wrapped(-way_to(ta, ka, x), ka), _wrapped(way_to(tb, kb, minus(x, apart)), kb))
        for x in crossings
    ]


def _crossings(ta: Point, ka: float, tb: Point, kb: float, apart: Point) -> list[Point]:
    """Where a circle crosses a line or a larger circle, relative to the first one's point.

    Args:
        ta: Unit tangent of the circle.
        ka: Its curvature [1/m].
        tb: Unit tangent of the other one.
        kb: Its curvature [1/m].
        apart: From the point of the one to the point of the other [m].
    """
    na, nb = (-ta[1], ta[0]), (-tb[1], tb[0])
    # The crossings lie on one line, on which the difference of both equations vanishes.
    w = (
        ka * nb[0] - kb * na[0] + ka * kb * apart[0],
        ka * nb[1] - kb * na[1] + ka * kb * apart[1],
    )
    size = dot(w, w)
    if size == 0.0:
        return []
    share = ka * (kb * dot(apart, apart) / 2 + dot(nb, apart)) / size
    foot = (share * w[0], share * w[1])
    along = (-w[1] / math.sqrt(size), w[0] / math.sqrt(size))
    a, b, c = ka / 2, dot(na, along), ka * dot(foot, foot) / 2 - dot(na, foot)
    inside = b * b - 4 * a * c
    if inside < 0:
        return []
    larger = (b + math.copysign(math.sqrt(inside), b)) / 2
    roots = (larger / a, c / larger) if larger else (0.0,)
    return [(foot[0] + s * along[0], foot[1] + s * along[1]) for s in roots]


def way_to(tangent: Point, curvature: float, chord: Point) -> float:
    """The length along a line or a circle to the end of a chord, negative backwards [m]."""
    along = dot(tangent, chord)
    if not curvature:
        return along
    return math.atan2(curvature * along, 1 - curvature * cross(tangent, chord)) / curvature


def _wrapped(way: float, curvature: float) -> float:
    """A length along a circle, forwards."""
    return way + 2 * math.pi / abs(curvature) if curvature and way < -SLACK else way


def shifted(point: Point, tangent: Point, left: float) -> Point:
    """A point moved to the left of a tangent by a distance [m]."""
    return point[0] - left * tangent[1], point[1] + left * tangent[0]


def turned(vector: Point, angle: float) -> Point:
    """A vector turned to the left by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return vector[0] * c - vector[1] * s, vector[0] * s + vector[1] * c


def minus(a: Point, b: Point) -> Point:
    """The difference of two vectors."""
    return a[0] - b[0], a[1] - b[1]


def dot(a: Point, b: Point) -> float:
    """The scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Point, b: Point) -> float:
    """The cross product of two vectors: positive if the second points to the left."""
    return a[0] * b[1] - a[1] * b[0]
