"""Arcs from what G2 and G3 give: end and centre, or end and radius.

All points are in the arc's plane [m]; `turn` is 1 for counter-clockwise (G3), -1 for clockwise.

A drawn arc has to start and end exactly where it is programmed, but centres are rounded to a few
decimals. So the centre goes to the nearest point that is as far from the start as from the end:
its foot on their perpendicular bisector. Over three quarters of a circle, where that can be far
off, there are two arcs instead: one around the given centre for half the angle, and one that goes
on from there without a corner to the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.gcode.faults import Fault

Point = tuple[float, float]

# LinuxCNC's: how much the distances from centre to start and end may differ [m], in programs in
# millimetres and in inches. Up to the first nothing is said, which lets coordinates be rounded to
# 0.01 mm or 0.001 inch (its default CENTER_ARC_RADIUS_TOLERANCE); up to the second, 0.05 inch or
# 0.5 mm (manual, "Center Format Arcs"), it may be 0.1 % of the radius.
ROUNDED = {"mm": 2 * math.sqrt(2) * 1e-5, "inch": 2 * math.sqrt(2) * 2.54e-5}
MOST = {"mm": 0.5e-3, "inch": 0.05 * 0.0254}
RELATIVE = 1e-3
# So much a radius may be too short to reach the end, and less is none (LinuxCNC's
# RADIUS_TOLERANCE).
SHORT = 0.00005 * 0.0254
# From this angle on there are two arcs: here the foot on the bisector is 0.7 of the mismatch away.
NEARLY_FULL = 1.5 * math.pi
# A drawn arc may miss its end by half of what still counts as the same point.
MISS = REPEATED_POINT / 2


@dataclass(frozen=True, slots=True)
class Piece:
    """One arc of at most a full circle, as a segment of a path has it."""

    tangent: Point
    normal: Point
    curvature: float
    length: float
    end: Point

    def circle(self, start: Point) -> Piece:
        """The full circle that it is a part of, from and to its start."""
        length = 2 * math.pi / self.curvature
        return Piece(self.tangent, self.normal, self.curvature, length, start)


@dataclass(frozen=True, slots=True)
class Circle:
    """What a line asks for: around a centre, from a start through a sweep to an end."""

    center: Point
    start: Point
    end: Point
    turn: int
    sweep: float
    radius: float
    end_radius: float


def around(start: Point, end: Point, center: Point, turn: int, dialect: str) -> Circle:
    """An arc by its centre; a full circle where start and end are the same point.

    Args:
        start: First point.
        end: Last point.
        center: The centre as it is programmed.
        turn: 1 or -1.
        dialect: "mm" or "inch": whose tolerances hold.

    Raises:
        Fault: No radius, or distances from the centre that differ too much.
    """
    px, py = start[0] - center[0], start[1] - center[1]
    qx, qy = end[0] - center[0], end[1] - center[1]
    radius, end_radius = math.hypot(px, py), math.hypot(qx, qy)
    if min(radius, end_radius) < SHORT:
        raise Fault("an arc whose centre is where it starts or ends, so that it has no radius")
    off = abs(radius - end_radius)
    relative = RELATIVE * max(radius, end_radius)
    if off > MOST[dialect] or (off > ROUNDED[dialect] and off > relative):
        allowed = min(MOST[dialect], max(ROUNDED[dialect], relative))
        raise Fault(
            f"an arc whose centre is {radius * 1e3:.6g} mm from its start but "
            f"{end_radius * 1e3:.6g} mm from its end, {off * 1e3:.3g} mm more or less where "
            f"{allowed * 1e3:.3g} mm are allowed: correct I, J and K, or say with G90.1 that they "
            "are absolute"
        )
    if math.dist(start, end) <= REPEATED_POINT:
        return Circle(center, start, start, turn, 2 * math.pi, radius, radius)
    sweep = turn * math.atan2(px * qy - py * qx, px * qx + py * qy)
    # Rounding must not decide between nothing and a full turn.
    if sweep * radius <= REPEATED_POINT:
        sweep += 2 * math.pi
    return Circle(center, start, end, turn, sweep, radius, end_radius)


def with_radius(start: Point, end: Point, radius: float, turn: int) -> Circle:
    """An arc by its radius: at most half a circle, or at least that if it is negative.

    Raises:
        Fault: A full circle, or a radius that does not reach the end.
    """
    chord = math.dist(start, end)
    if chord <= REPEATED_POINT:
        raise Fault(
            "a full circle by its radius R, which leaves its centre open: give the centre by I, J "
            "and K"
        )
    if chord / 2 > abs(radius) + SHORT:
        raise Fault(
            f"an arc of radius {abs(radius) * 1e3:.6g} mm to a point {chord * 1e3:.6g} mm away, "
            f"which needs a radius of at least {chord * 5e2:.6g} mm"
        )
    across = math.sqrt(max((abs(radius) - chord / 2) * (abs(radius) + chord / 2), 0.0))
    height = turn * math.copysign(across, radius)
    ux, uy = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
    center = ((start[0] + end[0]) / 2 - height * uy, (start[1] + end[1]) / 2 + height * ux)
    actual = math.hypot(chord / 2, height)
    sweep = 2 * math.atan2(chord / 2, turn * height)
    return Circle(center, start, end, turn, sweep, actual, actual)


def pieces_of(circle: Circle, turns: int) -> list[Piece]:
    """The arcs to draw, `turns` - 1 of them full circles.

    Raises:
        Fault: An arc so large that its end would not be met.
    """
    x = circle
    if x.start == x.end:
        last = [_arc_around(x, 2 * math.pi)]
    elif x.sweep > NEARLY_FULL and _foot_is_off(x) > REPEATED_POINT:
        last = _two(x)
    else:
        last = [_bow(x.start, x.end, x.center, x.turn)]
    return [last[0].circle(x.start)] * (turns - 1) + last


def _foot_is_off(circle: Circle) -> float:
    """How far the centre is from the bisector of start and end [m]."""
    x = circle
    off = (x.radius - x.end_radius) * (x.radius + x.end_radius)
    return abs(off) / (2 * math.dist(x.start, x.end))


def _bow(start: Point, end: Point, center: Point, turn: int) -> Piece:
    """The arc around the foot of the centre on the bisector, from chord and height alone."""
    chord = math.dist(start, end)
    ux, uy = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
    height = (center[1] - (start[1] + end[1]) / 2) * ux - (center[0] - (start[0] + end[0]) / 2) * uy
    half = math.atan2(chord / 2, turn * height)
    radius = math.hypot(chord / 2, height)
    c, s = math.cos(half), math.sin(half)
    tangent = (ux * c + turn * uy * s, uy * c - turn * ux * s)
    normal = (-turn * tangent[1], turn * tangent[0])
    piece = Piece(tangent, normal, 1 / radius, 2 * half * radius, end)
    _refuse_a_miss(start, piece)
    return piece


def _arc_around(circle: Circle, sweep: float) -> Piece:
    """The arc around the given centre, through part of the sweep."""
    x = circle
    normal = ((x.center[0] - x.start[0]) / x.radius, (x.center[1] - x.start[1]) / x.radius)
    tangent = (x.turn * normal[1], -x.turn * normal[0])
    c, s = math.cos(sweep), math.sin(sweep)
    end = (
        x.center[0] + x.radius * (s * tangent[0] - c * normal[0]),
        x.center[1] + x.radius * (s * tangent[1] - c * normal[1]),
    )
    if sweep == 2 * math.pi:
        end = x.start
    piece = Piece(tangent, normal, 1 / x.radius, sweep * x.radius, end)
    _refuse_a_miss(x.start, piece)
    return piece


def _two(circle: Circle) -> list[Piece]:
    """Half the sweep around the given centre, then an arc with the same tangent to the end."""
    x = circle
    first = _arc_around(x, x.sweep / 2)
    ex = (first.end[0] - x.center[0]) / x.radius
    ey = (first.end[1] - x.center[1]) / x.radius
    along = (x.end[0] - x.center[0]) * ex + (x.end[1] - x.center[1]) * ey
    # The second centre lies on the same radius, this far from the first, where its distance to the
    # end is what is left of the radius: r2² - 2 k along + k² = (r1 - k)².
    shift = (x.end_radius - x.radius) * (x.end_radius + x.radius) / (2 * (along - x.radius))
    center = (x.center[0] + shift * ex, x.center[1] + shift * ey)
    return [first, _bow(first.end, x.end, center, x.turn)]


def _refuse_a_miss(start: Point, piece: Piece) -> None:
    turn = piece.curvature * piece.length
    along = math.sin(turn) / piece.curvature
    across = 2 * math.sin(turn / 2) ** 2 / piece.curvature
    x = start[0] + along * piece.tangent[0] + across * piece.normal[0]
    y = start[1] + along * piece.tangent[1] + across * piece.normal[1]
    # Also refuses NaN.
    if not math.dist((x, y), piece.end) <= MISS:
        raise Fault(
            f"an arc of radius {1 / piece.curvature:.6g} m, so large that its end cannot be met "
            "within a nanometre: write it as lines"
        )


def helix_length(circle: Circle, turns: int, rise: float) -> float:
    """Length of a helix of so many turns [m]; where its radius changes, by the mean radius."""
    total = circle.sweep + 2 * math.pi * (turns - 1)
    return math.hypot((circle.radius + circle.end_radius) / 2 * total, rise)


def chords_of(circle: Circle, turns: int, tolerance: float) -> int:
    """How many chords keep within `tolerance` [m] of a helix of so many turns."""
    largest = max(circle.radius, circle.end_radius)
    step = 2 * math.asin(math.sqrt(min(tolerance / (2 * largest), 0.5))) * 2
    # No chord over a quarter of a turn, however wide the tolerance.
    step = min(step, math.pi / 2)
    total = circle.sweep + 2 * math.pi * (turns - 1)
    return max(1, math.ceil(total / step))


def point_of(circle: Circle, turns: int, share: float) -> Point:
    """The point of a helix after a share of its sweep; its radius changes evenly."""
    x = circle
    angle = x.turn * share * (x.sweep + 2 * math.pi * (turns - 1))
    radius = x.radius + share * (x.end_radius - x.radius)
    px, py = (x.start[0] - x.center[0]) / x.radius, (x.start[1] - x.center[1]) / x.radius
    c, s = math.cos(angle), math.sin(angle)
    return (x.center[0] + radius * (c * px - s * py), x.center[1] + radius * (s * px + c * py))
