"""Geometry of arcs (G2, G3) that are defined by end and centre or by end and radius.

All points are complex numbers x + i y in the plane of the arc [m]; `turn` is 1 for
counter-clockwise (G3), -1 for clockwise.

An arc must start and end exactly at the programmed points, but programmed centres are rounded to
a few decimals. Therefore the centre is projected onto the perpendicular bisector of start and end,
where its distances to both are equal. For an arc of more than three quarters of a circle, this
projection can be far from the programmed centre. Such an arc is replaced by two arcs: one around
the programmed centre over half the angle, and a tangent arc from there to the end.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

from armcontour.files.drawings.gcode.words import Fault
from armcontour.geometry.segments import REPEATED_POINT

# LinuxCNC's tolerances for the difference between the distances from the centre to start and end
# [m], for programs in millimetres and in inches. A difference up to ALWAYS_ALLOWED is always
# accepted, because coordinates are rounded to 0.01 mm or 0.001 inch (default
# CENTER_ARC_RADIUS_TOLERANCE). A difference up to MAX_DIFFERENCE, 0.5 mm or 0.05 inch (manual,
# "Center Format Arcs"), is accepted if it is at most MAX_RELATIVE, 0.1 %, of the radius.
ALWAYS_ALLOWED = {"mm": 2 * math.sqrt(2) * 1e-5, "inch": 2 * math.sqrt(2) * 2.54e-5}
MAX_DIFFERENCE = {"mm": 0.5e-3, "inch": 0.05 * 0.0254}
MAX_RELATIVE = 1e-3
# A programmed radius may be shorter than half the chord by at most this length [m]. If the start or
# end is nearer to the centre than this length, the radius counts as zero (LinuxCNC's
# RADIUS_TOLERANCE).
RADIUS_TOLERANCE = 0.00005 * 0.0254
# An arc with a larger swept angle [rad] is drawn as two arcs. At this angle, the projection onto
# the bisector moves the centre by 0.7 times the difference of its distances to start and end.
NEARLY_FULL = 1.5 * math.pi
# Largest distance between the end of a drawn arc and the programmed end [m]: half of the distance
# up to which two points count as the same.
END_TOLERANCE = REPEATED_POINT / 2
# Largest angle of a transition on a helix [rad]. The length of its derivative is then within 1e-9
# of 1.
LARGEST_STEP = math.radians(10)
# A transition with the tangents and curvatures of an arc of angle a is within r a⁶ / HELIX_ERROR of
# an arc of radius r.
HELIX_ERROR = 46080


@dataclass(frozen=True, slots=True)
class ArcPart:
    """An arc of at most a full circle, with the data of a path segment."""

    tangent: complex  # Unit tangent at the start
    normal: complex  # Unit vector from the start to the centre
    curvature: float  # Curvature [1/m]
    length: float  # Length [m]
    end: complex  # End point [m]


@dataclass(frozen=True, slots=True)
class ProgrammedArc:
    """A programmed arc of at most one full turn, as a circle with start and end.

    `circles` full circles come before it.
    """

    center: complex  # Centre [m]
    start: complex  # Start point [m]
    end: complex  # End point [m]
    turn: int  # 1 for counter-clockwise, -1 for clockwise
    sweep: float  # Swept angle [rad], positive
    radius: float  # Distance from the centre to the start [m]
    end_radius: float  # Distance from the centre to the end [m]
    circles: int = 0  # Number of full circles before the arc


def arc_around(
    start: complex, end: complex, center: complex, turn: int, dialect: str
) -> ProgrammedArc:
    """Return the arc around a programmed centre; a full circle if start and end are the same point.

    `dialect` is the unit of the program, "mm" or "inch", which selects the tolerances.
    """
    radius = abs(start - center)
    end_radius = abs(end - center)
    if min(radius, end_radius) < RADIUS_TOLERANCE:
        raise Fault("an arc has no radius, because its centre is its start or end point")
    difference = abs(radius - end_radius)
    relative = MAX_RELATIVE * max(radius, end_radius)
    if difference > MAX_DIFFERENCE[dialect] or (
        difference > ALWAYS_ALLOWED[dialect] and difference > relative
    ):
        allowed = min(MAX_DIFFERENCE[dialect], max(ALWAYS_ALLOWED[dialect], relative))
        raise Fault(
            f"the centre of an arc must have equal distances to start and end, but is "
            f"{1e3 * radius:.6g} mm from the start and {1e3 * end_radius:.6g} mm from the end. The "
            f"difference is {1e3 * difference:.6g} mm, but at most {1e3 * allowed:.6g} mm are "
            "allowed. Correct I, J and K, or write G90.1 if they are absolute"
        )
    if abs(end - start) <= REPEATED_POINT:
        return ProgrammedArc(center, start, start, turn, 2 * math.pi, radius, radius)
    sweep = turn * cmath.phase((end - center) * (start - center).conjugate())
    # An arc that would be shorter than rounding errors is a full turn.
    if sweep * radius <= REPEATED_POINT:
        sweep += 2 * math.pi
    return ProgrammedArc(center, start, end, turn, sweep, radius, end_radius)


def arc_with_radius(start: complex, end: complex, radius: float, turn: int) -> ProgrammedArc:
    """Return the arc with a radius [m]: at most half a circle, at least half for a negative one.

    `turn`: 1 for counter-clockwise, -1 for clockwise.
    """
    chord = abs(end - start)
    if chord <= REPEATED_POINT:
        raise Fault(
            "a full circle cannot be defined by its radius R, because its centre is undefined. "
            "Write the centre as I, J and K"
        )
    if chord / 2 > abs(radius) + RADIUS_TOLERANCE:
        raise Fault(
            f"an arc to a point at a distance of {1e3 * chord:.6g} mm needs a radius of at least "
            f"{500 * chord:.6g} mm, but R is {1e3 * abs(radius):.6g} mm"
        )
    across = math.sqrt(max((abs(radius) - chord / 2) * (abs(radius) + chord / 2), 0.0))
    height = turn * math.copysign(across, radius)
    center = (start + end) / 2 + height * 1j * (end - start) / chord
    actual = math.hypot(chord / 2, height)
    sweep = 2 * math.atan2(chord / 2, turn * height)
    return ProgrammedArc(center, start, end, turn, sweep, actual, actual)


def arc_parts(arc: ProgrammedArc) -> list[ArcPart]:
    """Divide a programmed arc into its full circles and one or two arcs."""
    circles = [_arc_around(arc, 2 * math.pi)] * arc.circles
    return [*circles, *_parts_of_turn(arc)]


def _parts_of_turn(arc: ProgrammedArc) -> list[ArcPart]:
    """Divide an arc of at most one full turn into one or two arcs."""
    if arc.start == arc.end:
        return [_arc_around(arc, 2 * math.pi)]
    squares = (arc.radius - arc.end_radius) * (arc.radius + arc.end_radius)
    to_bisector = abs(squares) / (2 * abs(arc.end - arc.start))
    if arc.sweep > NEARLY_FULL and to_bisector > REPEATED_POINT:
        return _divide_arc(arc)
    return [_arc_between(arc.start, arc.end, arc.center, arc.turn)]


def _arc_between(start: complex, end: complex, center: complex, turn: int) -> ArcPart:
    """Return the arc between two points around the projection of `center` onto their bisector."""
    chord = abs(end - start)
    along = (end - start) / chord
    height = ((center - (start + end) / 2) * along.conjugate()).imag
    half = math.atan2(chord / 2, turn * height)
    radius = math.hypot(chord / 2, height)
    tangent = along * cmath.rect(1.0, -turn * half)
    piece = ArcPart(tangent, turn * 1j * tangent, 1 / radius, 2 * half * radius, end)
    _check_end(start, piece)
    return piece


def _arc_around(arc: ProgrammedArc, sweep: float) -> ArcPart:
    """Return the arc around the programmed centre, from the start by the angle `sweep` [rad]."""
    normal = (arc.center - arc.start) / arc.radius
    end = arc.center - arc.radius * (normal * cmath.rect(1.0, arc.turn * sweep))
    if sweep == 2 * math.pi:
        end = arc.start
    piece = ArcPart(-arc.turn * 1j * normal, normal, 1 / arc.radius, sweep * arc.radius, end)
    _check_end(arc.start, piece)
    return piece


def _divide_arc(arc: ProgrammedArc) -> list[ArcPart]:
    """Return an arc about the programmed centre by half the angle, and a tangent arc to the end."""
    first = _arc_around(arc, arc.sweep / 2)
    ray = (first.end - arc.center) / arc.radius
    along = ((arc.end - arc.center) * ray.conjugate()).real
    # The second centre lies on the radius at the end of the first arc, at the distance k = `shift`
    # from the first centre. Its distances to both ends of the second arc must be equal:
    # r2² - 2 k along + k² = (r1 - k)², where r1 and r2 are the radii at start and end.
    shift = (
        (arc.end_radius - arc.radius) * (arc.end_radius + arc.radius) / (2 * (along - arc.radius))
    )
    return [first, _arc_between(first.end, arc.end, arc.center + shift * ray, arc.turn)]


def _check_end(start: complex, piece: ArcPart) -> None:
    """Check that the end computed from the data of an arc is within END_TOLERANCE of `end`."""
    turn = piece.curvature * piece.length
    along = math.sin(turn) / piece.curvature
    across = 2 * math.sin(turn / 2) ** 2 / piece.curvature
    end = start + along * piece.tangent + across * piece.normal
    # The negated comparison is also true for NaN.
    if not abs(end - piece.end) <= END_TOLERANCE:
        raise Fault(
            f"the radius of an arc is too large, {1 / piece.curvature:.6g} m. The end of the arc "
            "cannot be computed to within a nanometre. Write lines instead"
        )


@dataclass(frozen=True, slots=True)
class HelixKnots:
    """Knots of a helix, with derivatives with respect to the fraction of the helix at them."""

    point: list[complex]  # Points in the plane of the arc [m]
    first: list[complex]  # First derivatives in this plane [m]
    second: list[complex]  # Second derivatives in this plane [m]
    middle: list[complex]  # First derivatives in the middle between two knots [m]


def helix_knots(
    arc: ProgrammedArc, tolerance: float, count_segments: Callable[[int], None]
) -> HelixKnots:
    """Return the knots of a helix between which transitions are within a tolerance [m].

    The radius changes linearly from start to end. `count_segments` receives the number of
    transitions before they are computed, and raises an error if there are too many.
    """
    largest = max(arc.radius, arc.end_radius)
    # A quintic with the tangents and curvatures of an arc of angle a is within r a⁶ / 46080 of it.
    # Steps of LARGEST_STEP keep the length of its derivative near 1.
    step = min((HELIX_ERROR * tolerance / largest) ** (1 / 6), LARGEST_STEP)
    sweep = arc.sweep + 2 * math.pi * arc.circles
    n = max(1, math.ceil(sweep / step))
    count_segments(n)
    out = (arc.start - arc.center) / arc.radius
    growth = arc.end_radius - arc.radius
    angle = arc.turn * sweep
    point = []
    first = []
    second = []
    for i in range(2 * n + 1):
        share = i / (2 * n)
        radius = arc.radius + share * growth
        turned = out * cmath.rect(1.0, share * angle)
        point.append(arc.center + radius * turned)
        first.append((growth + 1j * angle * radius) * turned)
        second.append((2j * angle * growth - angle * angle * radius) * turned)
    point[0] = arc.start
    point[-1] = arc.end
    return HelixKnots(point[::2], first[::2], second[::2], first[1::2])
