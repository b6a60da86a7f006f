"""Lines and circular arcs from which users build a path, with their process requirements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, check_number, check_numbers
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import NO_KEY, Distance, Speed
from armcontour.geometry.segments import LimitColumns, Segments

# Smallest sine of the angle between two chords of an arc through three points, and largest sine of
# the angle by which an arc's normal may deviate from the perpendicular to its radius.
SMALLEST_SINE = 1e-9
# Fraction of a full circle by which rounding errors may exceed it.
FULL_CIRCLE_ROUNDING = 1e-12
# Start, tangent, normal, curvature and length of a segment.
Row = tuple[FloatArray, FloatArray, FloatArray, float, float]


@declared()
class SegmentLimits(Checked):
    """Process requirements of one segment; stricter limits of the job override them.

    >>> slow = ac.SegmentLimits(speed=0.02, tag="slow")
    >>> ac.Line((0.0, 0.0), (0.1, 0.0), segment_limits=slow).segment_limits.speed
    0.02

    Args:
        speed: Assigned velocity on the segment [m/s]; by default, the segment has none.
        tolerance: Largest corner error at the segment's ends [m]; by default, only that of the job
            applies.
        tag: Free text that is copied to the results; None by default.
    """

    speed: Speed | None = None
    tolerance: Distance | None = None
    tag: Annotated[str | None, NO_KEY] = None

    def columns(self, n: int) -> LimitColumns:
        """Return the requirements as columns of a table with n segments.

        Args:
            n: Number of segments.
        """
        speed = np.nan if self.speed is None else self.speed
        tolerance = np.nan if self.tolerance is None else self.tolerance
        return {
            "speeds": np.full(n, speed),
            "tolerances": np.full(n, tolerance),
            "tags": np.full(n, self.tag, dtype=object),
            "origins": np.zeros(n, dtype=np.intp),
        }


NO_LIMITS = SegmentLimits()


@declared()
class Line:
    """A straight segment from `start` to `end` [m].

    >>> line = ac.Line((0.30, 0.20), (0.33, 0.20))
    >>> round(ac.Path(segments=[line]).length, 6)
    0.03

    Args:
        start: First point [m], 2 or 3 coordinates.
        end: Last point [m], same number of coordinates.
        segment_limits: Speed, corner error and tag of this segment.
    """

    start: Sequence[float] = field(kw_only=False)
    end: Sequence[float] = field(kw_only=False)
    segment_limits: SegmentLimits = NO_LIMITS


@declared()
class Arc:
    """A circular segment from `start` around `center` [m].

    >>> quarter = ac.Arc((1.0, 0.0), (0.0, 0.0), np.pi / 2)
    >>> round(ac.Path(segments=[quarter]).length, 3)
    1.571

    Args:
        start: First point [m], 2 or 3 coordinates.
        center: Centre of the circle [m].
        angle: Swept angle [rad], not zero, up to a full circle. In the plane a positive angle is
            counter-clockwise; in space it is about `normal` by the right-hand rule.
        normal: Axis of the circle, in space only.
        segment_limits: Speed, corner error and tag of this segment.
    """

    start: Sequence[float] = field(kw_only=False)
    center: Sequence[float] = field(kw_only=False)
    angle: float = field(kw_only=False)
    normal: Sequence[float] | None = None
    segment_limits: SegmentLimits = NO_LIMITS

    @classmethod
    def through(
        cls,
        start: Sequence[float],
        via: Sequence[float],
        end: Sequence[float],
        *,
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Arc:
        """Return the arc from `start` through `via` to `end`, in the plane or in space.

        In the plane, if `end` repeats `start`, this is the full circle with `start` and `via` at
        the ends of a diameter. In space such a circle is not unique and raises an error.

        Args:
            start: First point [m], 2 or 3 coordinates.
            via: A point of the arc between its ends [m].
            end: Last point [m].
            segment_limits: Speed, corner error and tag of this segment.

        Raises:
            InvalidInput: The points lie on one line, or do not determine a circle.
        """
        a, b, c = (
            check_numbers(f"{name} of an arc", x, "m")
            for name, x in (("start", start), ("via point", via), ("end", end))
        )
        if len({x.shape for x in (a, b, c)}) > 1 or a.shape not in ((2,), (3,)):
            raise InvalidInput("The points of an arc must all have 2 or all have 3 coordinates.")
        if np.array_equal(a, c) and len(a) == 2 and not np.array_equal(a, b):
            return cls(
                start=a.tolist(),
                center=((a + b) / 2).tolist(),
                angle=2 * np.pi,
                segment_limits=segment_limits,
            )
        center, angle, normal = _circle_through(a, b, c)
        return cls(
            start=a.tolist(),
            center=center,
            angle=angle,
            normal=normal,
            segment_limits=segment_limits,
        )

    @classmethod
    def circle(
        cls,
        start: Sequence[float],
        center: Sequence[float],
        *,
        normal: Sequence[float] | None = None,
        segment_limits: SegmentLimits = NO_LIMITS,
    ) -> Arc:
        """Return the full circle from `start` around `center`, counter-clockwise (about `normal`).

        Args:
            start: Point where the circle starts and ends [m], 2 or 3 coordinates.
            center: Centre of the circle [m].
            normal: Axis of the circle, perpendicular to its radius, in space only.
            segment_limits: Speed, corner error and tag of this segment.
        """
        return cls(
            start=start,
            center=center,
            angle=2 * np.pi,
            normal=normal,
            segment_limits=segment_limits,
        )


def _circle_through(
    a: FloatArray, b: FloatArray, c: FloatArray
) -> tuple[list[float], float, list[float] | None]:
    """Return centre, swept angle and, in space, normal of the arc from a through b to c."""
    u, v = b - a, c - a
    uu = u @ u
    vv = v @ v
    uv = u @ v
    # Squared area of the parallelogram with the sides u and v. The formula uu vv - uv² would lose
    # its digits to cancellation if the parallelogram is flat.
    across = np.cross(u, v) if len(a) == 3 else np.array([u[0] * v[1] - u[1] * v[0]])
    area = across @ across
    if not area > (SMALLEST_SINE**2) * max(uu, vv) ** 2:
        raise InvalidInput(
            f"The points {tuple(a.tolist())}, {tuple(b.tolist())} and {tuple(c.tolist())} m "
            "lie on one line, so they do not determine an arc. For a full circle in space, specify "
            "its center, angle and normal."
        )
    center = (a + (vv * (uu - uv) * u + uu * (vv - uv) * v) / (2 * area)).tolist()
    # The swept angle is twice the angle between the chords to and from the via point.
    to_via = b - a
    from_via = c - b
    size = np.linalg.norm(to_via) * np.linalg.norm(from_via)
    angle = 2 * np.arctan2(np.sqrt(area) / size, to_via @ from_via / size)
    if len(a) == 3:
        return center, float(angle), np.cross(to_via, from_via).tolist()
    sign = np.sign(to_via[0] * from_via[1] - to_via[1] * from_via[0])
    return center, float(sign * angle), None


def tabulate(segments: Iterable[Line | Arc]) -> Segments:
    """Convert lines and arcs to a table of segments."""
    listed = list(checks.check_sequence("segments of a path", segments, object, "Lines and Arcs"))
    for i, segment in enumerate(listed):
        if not isinstance(segment, (Line, Arc)):
            raise InvalidInput(
                f"Segment {i + 1} must be a Line or an Arc, not a {type(segment).__name__}. For "
                "points, write Path.polyline(points).",
                index=i,
            )
        checks.check_type(
            f"segment_limits of segment {i + 1}", segment.segment_limits, SegmentLimits
        )
    rows = [_line(x, i) if isinstance(x, Line) else _arc(x, i) for i, x in enumerate(listed)]
    if not rows:
        raise InvalidInput("A path needs at least one segment.")
    if len({len(start) for start, *_ in rows}) > 1:
        raise InvalidInput("All segments of a path must have the same number of coordinates.")
    starts, tangents, normals, curvatures, lengths = (np.array(x) for x in zip(*rows, strict=True))
    demands = [x.segment_limits for x in listed]
    return Segments(
        starts=starts,
        tangents=tangents,
        normals=normals,
        curvatures=curvatures,
        lengths=lengths,
        speeds=np.array([x.speed for x in demands], dtype=np.float64),
        tolerances=np.array([x.tolerance for x in demands], dtype=np.float64),
        tags=np.array([x.tag for x in demands], dtype=object),
    )


def _line(line: Line, index: int) -> Row:
    """Return a line as a table row."""
    start = check_numbers(f"start of segment {index + 1}", line.start, "m")
    end = check_numbers(f"end of segment {index + 1}", line.end, "m")
    _check_dimensions(index, start, end)
    length = float(np.linalg.norm(end - start))
    if length == 0:
        raise InvalidInput(
            f"Segment {index + 1} is a line of zero length at {tuple(start.tolist())} m. Remove "
            "the segment.",
            index=index,
            point=start.tolist(),
        )
    return start, (end - start) / length, np.zeros_like(start), 0.0, length


def _arc(arc: Arc, index: int) -> Row:
    """Return an arc as a table row."""
    start = check_numbers(f"start of segment {index + 1}", arc.start, "m")
    center = check_numbers(f"centre of segment {index + 1}", arc.center, "m")
    _check_dimensions(index, start, center)
    angle = check_number(f"angle of segment {index + 1}", arc.angle, "rad")
    radius = float(np.linalg.norm(center - start))
    if radius == 0 or angle == 0 or abs(angle) > 2 * np.pi * (1 + FULL_CIRCLE_ROUNDING):
        raise InvalidInput(
            f"Segment {index + 1} must be an arc with a radius above zero and an angle that is not "
            f"zero and at most ±2 pi rad, but has radius {radius:g} m and angle {angle:g} rad.",
            index=index,
        )
    to_center = (center - start) / radius
    tangent = np.sign(angle) * _counter_clockwise(to_center, arc.normal, index)
    return start, tangent, to_center, 1 / radius, radius * abs(angle)


def _counter_clockwise(
    to_center: FloatArray, normal: Sequence[float] | None, index: int
) -> FloatArray:
    """Return the unit tangent of counter-clockwise motion around a centre.

    - `to_center`: unit vector towards the centre.
    - `normal`: axis of the circle, in space only.
    - `index`: index of the segment, for messages.
    """
    if len(to_center) == 2:
        if normal is not None:
            raise InvalidInput(
                f"Segment {index + 1} is an arc in the plane, so it must not have a normal."
            )
        return np.array([to_center[1], -to_center[0]])
    if normal is None:
        raise InvalidInput(
            f"Segment {index + 1} is an arc in space, so it needs a normal.", index=index
        )
    axis = check_numbers(f"normal of segment {index + 1}", normal)
    size = float(np.linalg.norm(axis))
    if axis.shape != (3,) or size == 0 or abs(axis @ to_center) > SMALLEST_SINE * size:
        raise InvalidInput(
            f"The normal of segment {index + 1} must be a vector perpendicular to its radius.",
            index=index,
        )
    tangent: FloatArray = np.cross(to_center, axis / size)
    return tangent / np.linalg.norm(tangent)


def _check_dimensions(index: int, first: FloatArray, second: FloatArray) -> None:
    """Raise InvalidInput unless both points of a segment have 2 or both have 3 coordinates."""
    if first.shape not in ((2,), (3,)) or first.shape != second.shape:
        raise InvalidInput(
            f"The points of segment {index + 1} must both have 2 or both have 3 coordinates.",
            index=index,
        )
