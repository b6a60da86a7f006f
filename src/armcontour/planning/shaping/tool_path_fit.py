"""Tool path of a joint spline, as tangent arcs with a smooth curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.quintics import quintic
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path, Segments, SmoothCurve
from armcontour.geometry.biarcs import join_pairs, make_biarcs
from armcontour.planning.shaping.spline_rows import JointSpline
from armcontour.robot import Arm

# Largest relative change of the joint velocity along a part of a span
CHANGE = 0.1
# Largest number of parts of a span at first, and largest factor by which a round increases it.
MAX_PARTS_OF_SPAN = 8
# Largest distance of arcs from the curve, as a fraction of the tolerance. Spans with larger
# distances are divided into more parts.
ARC_DISTANCE = 1e-4
# Distance of arcs from the curve that is always small enough [m].
SMALL_DISTANCE = 1e-10
# Largest number of rounds of dividing spans, including the first one.
MAX_FIT_ROUNDS = 4
# Largest turn of a part [rad].
LARGEST_PART_TURN = 0.35
# Positions on each quintic at which arcs are compared with the curve.
PLACES = np.linspace(0.1, 0.9, 9)
# Safety factor of the largest distance at these positions.
DISTANCE_SAFETY = 1.25
# Points, unit tangents, and derivatives of the tangents along the arc length
Ends: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPath:
    """Tool path of a joint spline."""

    segments: Segments
    curve: SmoothCurve
    places: FloatArray  # Matching arc lengths on the objective and on the path [m], (m, 2)
    knots: FloatArray  # Arc lengths of the knots of the spline [m], (n + 1,)


def draw(
    spline: JointSpline, arm: Arm, objective: Path, s_knots: FloatArray, tolerance: FloatArray
) -> DrawnPath:
    """Compute the tool path of a joint spline.

    The distance of the arcs from the curve is a small fraction of the tolerance.

    - `s_knots`: arc lengths on the objective at the knots [m], (n + 1,).
    - `tolerance`: tolerance at the control points [m], (n,).
    """
    count = _count_parts(spline)
    drawn = _draw(spline, arm, objective, s_knots, count)
    factor = _refinement_factor(drawn.segments, drawn.curve.spreads, count, tolerance)
    if not (factor > 1).any():
        return drawn
    spans = np.arange(len(count))
    for rounds_left in reversed(range(MAX_FIT_ROUNDS - 1)):
        spans = spans[factor > 1]
        factor = factor[factor > 1]
        count[spans] *= np.clip(np.ceil(factor), 2, MAX_PARTS_OF_SPAN).astype(np.intp)
        if not (rounds_left and len(spans)):
            break
        span, share = _divide_spans(spans, count[spans])
        arcs, breaks, quintics = _fit(*(_evaluate_spline(spline, arm, span, x) for x in share.T))
        factor = _refinement_factor(
            arcs, _spreads(arcs, breaks, quintics), count[spans], tolerance[spans]
        )
    return _draw(spline, arm, objective, s_knots, count)


def _refinement_factor(
    arcs: Segments, spreads: FloatArray, count: IntArray, tolerance: FloatArray
) -> FloatArray:
    """Return the factor by which each span needs more parts, (m,); 1 or less if it has enough.

    `arcs` has two arcs for each part; `spreads` is the distance of the arcs of each part from the
    curve [m]. `count` and `tolerance` [m] belong to the spans, (m,).
    """
    first = np.cumsum(count) - count
    deviation = np.maximum.reduceat(spreads, first) / np.maximum(
        ARC_DISTANCE * tolerance, SMALL_DISTANCE
    )
    turns = (arcs.curvatures * arcs.lengths).reshape(-1, 2).sum(axis=1)
    # If the tool nearly stops, it may turn within a small part of a span.
    turn = np.maximum.reduceat(turns, first) / LARGEST_PART_TURN
    # The distance is proportional to the cube of the length.
    return np.asarray(np.maximum(np.cbrt(deviation), turn))


def _divide_spans(spans: IntArray, count: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the span of each part, (p,), and fractions of the span time at its ends, (p, 2)."""
    span, number = number_parts(count)
    return spans[span], np.stack([number, number + 1], axis=1) / count[span][:, None]


def _fit(begin: Ends, end: Ends) -> tuple[Segments, FloatArray, FloatArray]:
    """Fit two arcs and a quintic to each part, from results of `_evaluate_spline` at its ends.

    Returns the arcs, (2 n,), the arc lengths of the ends of the parts [m], (n + 1,), and the
    coefficients of the quintics, (n, 6, dimension).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        # Straight parts have no normal.
        arcs = join_pairs(*make_biarcs(begin[0], begin[1], end[0], end[1]))
    breaks = arcs.breaks[::2]
    return arcs, breaks, quintic(np.diff(breaks), begin, end)


def _draw(
    spline: JointSpline, arm: Arm, objective: Path, s_knots: FloatArray, count: IntArray
) -> DrawnPath:
    """Compute the tool path of a joint spline with `count`, (n,), parts of each span."""
    span, share = _divide_spans(np.arange(len(count)), count)
    begin = _evaluate_spline(spline, arm, span, share[:, 0])
    end = _evaluate_spline(spline, arm, span, share[:, 1])
    rests = np.flatnonzero((share[:, 1] == 1) & spline.rest[span + 1])
    # The end of a part is the start of the next part, but the tangent may jump at a stop.
    points = np.concatenate([begin[0], end[0][-1:]])
    into = np.concatenate([begin[1][1:], end[1][-1:]])
    into[rests] = end[1][rests]
    arcs, breaks, coefficients = _fit(begin, (points[1:], into, end[2]))
    s_parts = s_knots[span][:, None] + share * (s_knots[span + 1] - s_knots[span])[:, None]
    segments = _with_columns(arcs, objective, s_parts)
    curve = SmoothCurve(
        breaks=breaks, coefficients=coefficients, spreads=_spreads(segments, breaks, coefficients)
    )
    matches = np.stack([np.append(s_parts[:, 0], s_parts[-1, 1]), breaks], axis=1)
    matches[:, 0] = np.maximum.accumulate(matches[:, 0])
    knots = np.append(breaks[np.searchsorted(span, np.arange(len(spline.q)))], breaks[-1])
    return DrawnPath(segments=segments, curve=curve, places=matches, knots=knots)


def _count_parts(spline: JointSpline) -> IntArray:
    """Choose how many parts each span needs so that velocity changes little along a part, (n,)."""
    e = np.linalg.norm(spline.velocities, axis=1)
    change = np.linalg.norm(np.diff(spline.velocities, axis=0), axis=1)
    slow = np.maximum(np.minimum(e[1:], e[:-1]), 0.2 * np.maximum(e[1:], e[:-1]))
    count = np.clip(np.ceil(change / (CHANGE * slow)), 1, MAX_PARTS_OF_SPAN).astype(np.intp)
    # Next to a rest a span is straight in joint space.
    count[spline.rest[1:] | spline.rest[:-1]] = 1
    return np.asarray(count)


def _evaluate_spline(spline: JointSpline, arm: Arm, span: IntArray, share: FloatArray) -> Ends:
    """Return points, unit tangents and tangent derivatives in arc length, (m, dimension) each.

    `share` is the time since the start of the span, divided by the span time, (m,).
    """
    e = spline.velocities
    knots = spline.knots
    h = spline.h
    a = (np.diff(e, axis=0) / h[:, None])[span]
    t = (share * h[span])[:, None]
    q = knots[span] + e[span] * t + a * t**2 / 2
    dq = e[span] + a * t
    # A span next to a rest is straight, so its direction is that of the velocity at its other end,
    # even at the rest.
    for side, other in ((spline.rest[:-1], e[1:]), (spline.rest[1:], e[:-1])):
        adjacent = side[span]
        dq[adjacent] = other[span][adjacent]
        a[adjacent] = 0.0
    velocity, acceleration = arm.tool_motion(q, dq, a)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    tangent = velocity / speed
    along = np.sum(acceleration * tangent, axis=1, keepdims=True)
    return arm.tool_position(q), tangent, (acceleration - along * tangent) / speed**2


def _with_columns(arcs: Segments, objective: Path, s_parts: FloatArray) -> Segments:
    """Copy assigned velocities, tolerances, tags and origins from the objective to the arcs."""
    last = len(objective) - 1
    first = np.clip(np.searchsorted(objective.breaks, s_parts[:, 0], side="right") - 1, 0, last)
    end = np.clip(np.searchsorted(objective.breaks, s_parts[:, 1], side="left") - 1, first, last)
    columns: dict[str, npt.NDArray[Any]] = {}
    for name in ("speeds", "tolerances"):
        values = getattr(objective, name)
        column = values[first]
        if not np.isnan(values).all():
            # A part along several segments has the smallest of their values.
            for k in range(1, int((end - first).max(initial=0)) + 1):
                column = np.fmin(column, values[np.minimum(first + k, end)])
        columns[name] = np.repeat(column, 2)
    for name in ("tags", "origins"):
        columns[name] = np.repeat(getattr(objective.segments, name)[first], 2)
    return arcs.replace(checked=False, **columns)


def _spreads(segments: Segments, breaks: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the largest distance of the arcs from each quintic [m], (n,)."""
    width = np.diff(breaks)
    powers = PLACES[:, None] ** np.arange(6)
    points = np.einsum("pk,nkd->npd", powers, coefficients)
    u = PLACES * width[:, None]
    half = segments.lengths[::2][:, None]
    second = u > half
    row = 2 * np.arange(len(width))[:, None] + second
    arc_points = segments.evaluate(row.ravel(), np.where(second, u - half, u).ravel())
    deviation = np.linalg.norm(arc_points.reshape(points.shape) - points, axis=2)
    return np.asarray(DISTANCE_SAFETY * deviation.max(axis=1))
