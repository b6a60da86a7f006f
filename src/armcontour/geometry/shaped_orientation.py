"""Tool orientation of shaped paths, without a jump of the angular rate where arcs meet.

A shaped path has many arcs, and its arc lengths differ from those of its objective. If every point
had the orientation of its corresponding point, the rate would jump, and the tool would stop,
wherever the ratio of these arc lengths changes. Therefore the arc length on the objective is a
smooth function of the arc length on the path: monotone cubics between the fewest knots that keep
the orientation near that of the corresponding points. Where the rate of the objective's orientation
jumps, blends smooth the jump as at rounded corners (rounded_orientation.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.sampled_data import subdivide
from armcontour.geometry.orientation import (
    RATE_FLOOR,
    SAME_ORIENTATION,
    SAME_RATE,
    Orientation,
    fit_cubics,
    no_third_rotation,
    shift_polynomials,
    turns_between,
)
from armcontour.geometry.path import Path
from armcontour.geometry.rounding.rounded_orientation import (
    SLIVER,
    check_even,
    find_kinks,
    largest_half_lengths,
)
from armcontour.geometry.rounding.rounded_path import check_angular_tolerance
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.geometry.shaped_path import check_correspondence

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

# Fraction of the angular tolerance that the smooth arc lengths may use.
PLACES_SHARE = 0.5
# Fraction of the angular tolerance that the blends may use. It may exceed 1 - PLACES_SHARE, because
# the errors do not add up: the smooth arc lengths are exact at the vertices, where blends have
# their largest error.
BLENDS_SHARE = 0.95
# Smallest permitted angular error of the smooth arc lengths [rad].
LEAST_ANGLE = 1e-5
# Largest permitted angular error of the smooth arc lengths [rad].
MAX_ANGLE = 1e-2
# Permitted angular error of the smooth arc lengths if no tolerance is specified [rad].
SMALL_ANGLE = 1e-3
# Factor by which a blend outside the tolerance is shortened in each trial.
SHORTENING = 0.8
# Largest number of trials in which blends outside the tolerance are shortened.
MAX_TRIALS = 8
# The interval between two knots of the smooth arc lengths is halved at most this number of times.
MAX_HALVINGS = 12
# Parts of each interval between two known arc lengths at whose ends angles are compared.
REFINEMENT = 4

AnyPath = TypeVar("AnyPath", bound=Path)


def orient_shaped(
    path: AnyPath, objective: Path, places: npt.ArrayLike, angular_tolerance: float | None = None
) -> tuple[AnyPath, float]:
    """Apply the tool orientation of an objective path to a path that was shaped from it.

    A constant orientation is unchanged. An orientation that turns at constant rates is copied from
    the objective's corresponding points, except for blends at the vertices where its rate jumps;
    this also applies to an orientation that follows the tangent of the objective. The angular rate
    does not jump, except at corners of the path, where the tool stops anyway, and at angular
    tolerance 0.

    Args:
        path: The path, made of lines and arcs.
        objective: Its objective path, whose orientation is not rounded.
        places: Corresponding arc lengths on the objective and on the path [m], from start to end,
            neither decreasing, (n, 2); linear between them.
        angular_tolerance: Largest angle between the orientation and that of the corresponding
            point [rad]. Without one, a blend at a corner of the objective is as long as a parabola
            with the same distance from the corner.

    Returns:
        The path, and the largest sampled angle between its orientation and the objective's at
        corresponding points [rad]; between the tool axes if only they are prescribed.

    Raises:
        InvalidInput: The orientation needs an angular tolerance, or is rounded already; or the
            places do not run from start to end of both paths.
    """
    source = objective.orientation
    if source is None:
        return path, 0.0
    objective = replace(objective, orientation=replace(source, follows=False))
    check_even(objective)
    corner = np.flatnonzero(objective.turns > TANGENT_TOLERANCE)
    straight = np.setdiff1d(find_kinks(objective), corner)
    allowed = check_angular_tolerance(objective, angular_tolerance, straight)
    pairs = check_correspondence(places, objective, path)
    orientation, deviation = _orient_smoothly(path, objective, pairs, allowed)
    return replace(path, orientation=orientation.with_cone(source.cone)), deviation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Runs:
    """The k runs of an objective, which are its parts between changes of the angular rate."""

    objective_s: FloatArray  # Arc lengths on the objective at the ends of the runs [m], (k + 1,)
    s: FloatArray  # Arc lengths on the path at the ends of the runs [m], (k + 1,)
    segment: IntArray  # Index of the first objective segment of each run, (k,)
    starts: FloatArray  # Rotation matrices at the starts of the runs, (k, 3, 3)
    rates: FloatArray  # Angular rates with respect to arc length of the objective [rad/m], (k, 3)
    # Norms of the rates of the tool, or of its axis if only the axis is prescribed [rad/m], (k,)
    speeds: FloatArray

    @classmethod
    def from_path(cls, path: Path, objective: Path, pairs: FloatArray) -> _Runs:
        """Divide an objective into runs, without those of length zero on the shaped path."""
        orientation = objective.orientation
        assert orientation is not None
        size = np.linalg.norm(orientation.first, axis=1)
        step = np.linalg.norm(np.diff(orientation.first, axis=0), axis=1)
        changes = step > SAME_RATE * (size[1:] + size[:-1]) + RATE_FLOOR
        first = np.append(0, np.flatnonzero(changes | (orientation.jumps > SAME_ORIENTATION)) + 1)
        objective_s = np.append(orientation.breaks[first], objective.length)
        s = np.interp(objective_s, pairs[:, 0], pairs[:, 1])
        s[0] = 0.0
        s[-1] = path.length
        used = np.diff(s) > REPEATED_POINT
        first = first[used]
        turns = orientation.first[first]
        if orientation.axis_only:
            turns = np.cross(turns, orientation.starts[first][:, :, 2])
        return cls(
            objective_s=np.append(objective_s[:-1][used], objective.length),
            s=np.append(s[:-1][used], path.length),
            segment=first,
            starts=orientation.starts[first],
            rates=orientation.first[first],
            speeds=np.linalg.norm(turns, axis=1),
        )


def _orient_smoothly(
    path: Path, objective: Path, pairs: FloatArray, allowed: float
) -> tuple[Orientation, float]:
    """Make the objective's orientation at smooth arc lengths, with blends.

    - `pairs`: corresponding arc lengths on the objective and on the path [m], (n, 2).
    - `allowed`: largest angular error [rad].

    Returns the orientation and its largest error [rad].
    """
    source = objective.orientation
    assert source is not None
    runs = _Runs.from_path(path, objective, pairs)
    largest_error = SMALL_ANGLE
    if np.isfinite(allowed):
        largest_error = float(np.clip(PLACES_SHARE * allowed, LEAST_ANGLE, MAX_ANGLE))
    mapping = _smooth_arc_lengths(runs, pairs, largest_error)
    cut = _blend_lengths(path, objective, runs, pairs, BLENDS_SHARE * allowed)
    for _ in range(MAX_TRIALS):
        orientation = _insert_blends(runs, mapping, cut, axis_only=source.axis_only)
        s = subdivide(
            np.unique(np.concatenate([orientation.breaks, pairs[:, 1], runs.s])), REFINEMENT
        )
        targets = source(np.interp(s, pairs[:, 1], pairs[:, 0]))
        angles = turns_between(orientation(s), targets, axis_only=source.axis_only)
        # Where the ratio of the arc lengths changes, a blend can exceed the tolerance; then it is
        # shortened.
        vertex, distance = _nearest(s[angles > allowed], runs.s[1:-1])
        too_long = np.unique(vertex[distance < cut[vertex]])
        if not len(too_long):
            break
        cut[too_long] *= SHORTENING
    return orientation, float(angles.max())


def _smooth_arc_lengths(runs: _Runs, pairs: FloatArray, largest_error: float) -> PchipInterpolator:
    """Return a smooth function from arc length on the path to arc length on the objective.

    - `pairs`: corresponding arc lengths on the objective and on the path [m], (n, 2).
    - `largest_error`: largest angular error compared with the corresponding points [rad].
    """
    from scipy.interpolate import PchipInterpolator

    knots = runs.s
    values = runs.objective_s
    for _ in range(MAX_HALVINGS):
        smooth = PchipInterpolator(knots, values)
        s = subdivide(np.union1d(knots, pairs[:, 1]), REFINEMENT)
        run = np.clip(np.searchsorted(runs.s, s, side="right") - 1, 0, len(runs.speeds) - 1)
        deviations = np.abs(smooth(s) - np.interp(s, pairs[:, 1], pairs[:, 0])) * runs.speeds[run]
        coarse = np.unique(np.searchsorted(knots, s[deviations > largest_error], side="right") - 1)
        if not len(coarse):
            break
        middle = (knots[coarse] + knots[coarse + 1]) / 2
        knots = np.insert(knots, coarse + 1, middle)
        values = np.insert(values, coarse + 1, np.interp(middle, pairs[:, 1], pairs[:, 0]))
    return smooth


def _blend_lengths(
    path: Path, objective: Path, runs: _Runs, pairs: FloatArray, allowed: float
) -> FloatArray:
    """Return the blend's length on either side of each vertex between runs [m], (k - 1,).

    The length is 0 where the rate does not jump, or where the tool stops at a corner.
    """
    orientation = objective.orientation
    assert orientation is not None
    vertex = runs.segment[1:] - 1
    requested = largest_half_lengths(orientation, allowed)[vertex]
    if not np.isfinite(allowed):
        gap = np.linalg.norm(path(runs.s[1:-1]) - objective.starts[vertex + 1], axis=1)
        half = objective.turns[vertex] / 2
        requested = np.where(requested > 0, 2 * gap / np.sin(half), 0.0)
    objective_s = runs.objective_s[1:-1]
    s = runs.s[1:-1]
    ends = [
        np.interp(x, pairs[:, 0], pairs[:, 1])
        for x in (objective_s - requested, objective_s + requested)
    ]
    cut = np.minimum(s - ends[0], ends[1] - s)
    cut = np.minimum(cut, np.minimum(np.diff(runs.s)[:-1], np.diff(runs.s)[1:]) / 2)
    cut[orientation.jumps[vertex] > SAME_ORIENTATION] = 0.0
    # At a corner of the path the tool stops, so no blend is needed.
    nearest, distance = _nearest(path.breaks[1:-1][path.turns > TANGENT_TOLERANCE], s)
    cut[nearest[distance <= REPEATED_POINT]] = 0.0
    return cut


def _insert_blends(
    runs: _Runs, mapping: PchipInterpolator, cut: FloatArray, *, axis_only: bool
) -> Orientation:
    """Make the orientation along a shaped path, with blends between runs.

    - `mapping`: function from arc length on the path to arc length on the objective [m].
    - `cut`: half length of the blend at each vertex between runs [m], (k - 1,).
    """
    blended = np.flatnonzero(cut > 0)
    low = runs.s[1:-1][blended] - cut[blended]
    high = runs.s[1:-1][blended] + cut[blended]
    knots = mapping.x
    window = np.searchsorted(low, knots, side="right") - 1
    inside = (window >= 0) & (knots < np.append(high, -np.inf)[window])
    inside[[0, -1]] = False
    breaks = np.unique(np.concatenate([knots[~inside], low, high]))
    # Neighbouring blends can share an end, except for rounding errors.
    breaks = breaks[np.append(True, np.diff(breaks) > SLIVER)]
    breaks[-1] = knots[-1]
    begin = breaks[:-1]
    end = breaks[1:]
    middle = (begin + end) / 2
    run = np.clip(np.searchsorted(runs.s, middle, side="right") - 1, 0, len(runs.rates) - 1)
    knot = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(knots) - 2)
    f = shift_polynomials(mapping.c[::-1, knot].T, begin - knots[knot])
    g = np.zeros((len(begin), 4))
    f[:, 0] -= runs.objective_s[run]
    first = runs.rates[run]
    second = np.zeros((len(begin), 3))
    starts = runs.starts[run]
    i = np.searchsorted(breaks, low + cut[blended], side="right") - 1
    vertex_s = runs.objective_s[1:-1][blended]
    zeros = np.zeros(len(i))
    width = end[i] - begin[i]
    # Along the blends, which have the rows `i`, the rate before the vertex decreases to zero, and
    # the rate after the vertex rises from zero.
    f[i] = fit_cubics(width, (mapping(begin[i]) - vertex_s, mapping(begin[i], 1)), (zeros, zeros))
    g[i] = fit_cubics(width, (zeros, zeros), (mapping(end[i]) - vertex_s, mapping(end[i], 1)))
    first[i] = runs.rates[blended]
    second[i] = runs.rates[blended + 1]
    starts[i] = runs.starts[blended + 1]
    return Orientation(
        breaks=breaks,
        starts=starts,
        first=first,
        second=second,
        f=f,
        g=g,
        **no_third_rotation(len(first), 4),
        axis_only=axis_only,
        follows=False,
        cone=0.0,
    )


def _nearest(s: FloatArray, marks: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the index of each arc length's nearest mark, and the distance [m].

    `marks` increase. Both results are empty if there are no marks.
    """
    if not len(marks):
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    i = np.searchsorted((marks[1:] + marks[:-1]) / 2, s)
    return i, np.abs(s - marks[i])
