"""Tool orientation of shaped paths, without a jump of the angular rate where arcs meet.

A shaped path has many arcs, and arc lengths that differ from those of its objective. The
orientation at the place on the objective would have a jump of its rate wherever the ratio of these
arc lengths changes, and each jump is a stop. So the place is taken from a smooth function of the
path's arc length: monotone cubics between as few knots as bring the orientation near that at the
given places. Where the rate of the objective's orientation jumps, blends take the
jump as they do at rounded corners (rounded_orientation.py).

A tool that follows the tangent follows that of the shaped path. Carried along without turning about
the tangent it would come round a little turned out of the plane, by the solid angle between both
paths' tangents. That twist is taken back evenly from segment to segment of the objective.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.frames import exp, log, shortest
from armcontour.core.sampling import number_parts
from armcontour.geometry.orientation import (
    RATE_FLOOR,
    SAME_ORIENTATION,
    SAME_RATE,
    Orientation,
    fade,
    shift,
    turns_between,
)
from armcontour.geometry.orienting import carry
from armcontour.geometry.path import Path
from armcontour.geometry.rounded_orientation import (
    SLIVER,
    blend_kinks,
    find_kinks,
    largest_cuts,
)
from armcontour.geometry.rounding import needed_angle
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.geometry.shaped import check_places

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

# Twists below this are rounding errors [rad].
NO_TWIST = 1e-12
# Largest turn of an arc along which a twist is taken back by one constant rate [rad].
MOST_TURN = 0.1
# Shares of the angular tolerance that smooth places and blends may use, which are off at different
# places: at the vertices, in the middle of blends, places are exact.
PLACES, BLENDS = 0.5, 0.95
# Smallest and largest angle by which smooth places may be off, and that without a tolerance [rad].
LEAST_ANGLE, MOST_ANGLE, SMALL_ANGLE = 1e-5, 1e-2, 1e-3
# Blends that turn too far are made shorter by this, as often as that.
SHORTER, TRIES = 0.8, 8
# Stretches between two knots of smooth places are halved this often at most.
HALVINGS = 12

AnyPath = TypeVar("AnyPath", bound=Path)


def orient_shaped(
    path: AnyPath,
    objective: Path,
    places: npt.ArrayLike,
    angular_tolerance: float | None = None,
) -> tuple[AnyPath, float]:
    """A path with the tool orientation of the objective path that it was made from.

    A constant orientation is kept. One that turns at constant rates is that at the place on the
    objective, but for blends at the vertices where its rate jumps. One that follows the tangent
    follows that of the path, but for blends where arcs meet. The angular rate does not jump, except
    at corners of the path, where the tool stops anyway, and at angular tolerance 0.

    Args:
        path: The path, made of lines and arcs.
        objective: Its objective path, whose orientation is not rounded.
        places: Arc lengths on the objective and on the path that belong together [m], from the
            start to the end, neither decreasing, (n, 2); linear in between.
        angular_tolerance: Largest angle between the orientation and that at the place, or that of
            the tangent [rad]. Without one, a blend at a corner of the objective takes as much of it
            as a parabola with the same distance from the corner.

    Returns:
        The path, and how far its orientation was found to be at most from that at the place on the
        objective [rad]; if it follows the tangent, from that of the path's tangent. Between the
        tool axes if only they are prescribed.

    Raises:
        InvalidInput: The orientation needs an angular tolerance, or is rounded already; or the
            places do not lead along both paths.
    """
    own = objective.orientation
    if own is None:
        return path, 0.0
    corner = np.flatnonzero(objective.turns > TANGENT_TOLERANCE)
    straight = np.setdiff1d(find_kinks(objective), corner)
    allowed = needed_angle(objective, angular_tolerance, straight)
    pairs = check_places(places, objective, path)
    if own.follows:
        found, off = _follow(path, objective, pairs, allowed)
    else:
        found, off = _turn(path, objective, pairs, allowed)
    return dataclasses.replace(path, orientation=found), off


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Runs:
    """The k longest stretches of an objective along which its orientation has a constant rate.

    Args:
        at: Arc lengths of their ends on the objective [m], (k + 1,).
        s: Arc lengths of their ends on the path [m], (k + 1,).
        segment: First segments on the objective, (k,).
        starts: Rotation matrices at their starts, (k, 3, 3).
        rates: Angular rates over the arc length of the objective [rad/m], (k, 3).
        speeds: How fast the tool turns, or its axis if only that is prescribed [rad/m], (k,).
    """

    at: FloatArray
    s: FloatArray
    segment: IntArray
    starts: FloatArray
    rates: FloatArray
    speeds: FloatArray

    @classmethod
    def of(cls, path: Path, objective: Path, pairs: FloatArray) -> _Runs:
        """The runs of an objective that have a length on its path."""
        own = objective.orientation
        assert own is not None
        size = np.linalg.norm(own.first, axis=1)
        step = np.linalg.norm(np.diff(own.first, axis=0), axis=1)
        changes = step > SAME_RATE * (size[1:] + size[:-1]) + RATE_FLOOR
        first = np.append(0, np.flatnonzero(changes | (own.jumps > SAME_ORIENTATION)) + 1)
        at = np.append(own.breaks[first], objective.length)
        s = np.interp(at, pairs[:, 0], pairs[:, 1])
        s[0], s[-1] = 0.0, path.length
        used = np.diff(s) > REPEATED_POINT
        first = first[used]
        turns = own.first[first]
        if own.axis_only:
            turns = np.cross(turns, own.starts[first][:, :, 2])
        return cls(
            at=np.append(at[:-1][used], objective.length),
            s=np.append(s[:-1][used], path.length),
            segment=first,
            starts=own.starts[first],
            rates=own.first[first],
            speeds=np.linalg.norm(turns, axis=1),
        )


def _turn(
    path: Path, objective: Path, pairs: FloatArray, allowed: float
) -> tuple[Orientation, float]:
    """Orientation at smooth places with blends, and how far it is from that at the places [rad].

    Args:
        path: The path.
        objective: Its objective.
        pairs: Places that belong together [m], (n, 2).
        allowed: Largest angle of blends [rad], infinite without one.
    """
    own = objective.orientation
    assert own is not None
    runs = _Runs.of(path, objective, pairs)
    near = float(np.clip(PLACES * allowed, LEAST_ANGLE, MOST_ANGLE))
    near = near if np.isfinite(allowed) else SMALL_ANGLE
    place = _smooth_places(runs, pairs, near)
    cut = _cuts(path, objective, runs, pairs, BLENDS * allowed)
    for _ in range(TRIES):
        found = _lay(runs, place, cut, axis_only=own.axis_only)
        s = _between(np.unique(np.concatenate([found.breaks, pairs[:, 1], runs.s])))
        wanted = own(np.interp(s, pairs[:, 1], pairs[:, 0]))
        angles = turns_between(found(s), wanted, axis_only=own.axis_only)
        # Where the places change unevenly, a blend can be off by more than it is at even places.
        bad = s[angles > allowed]
        vertex, away = _nearest(bad, runs.s[1:-1])
        long = np.unique(vertex[away < cut[vertex]])
        if not len(long):
            break
        cut[long] *= SHORTER
    return found, float(angles.max())


def _smooth_places(runs: _Runs, pairs: FloatArray, near: float) -> PchipInterpolator:
    """Places on the objective as a smooth function of the path's arc length.

    Args:
        runs: The runs of the objective's orientation.
        pairs: Places that belong together [m], (n, 2).
        near: Angle by which the orientation may be off because of it [rad].
    """
    from scipy.interpolate import PchipInterpolator

    knots, at = runs.s, runs.at
    for _ in range(HALVINGS):
        smooth = PchipInterpolator(knots, at)
        s = _between(np.union1d(knots, pairs[:, 1]))
        run = np.clip(np.searchsorted(runs.s, s, side="right") - 1, 0, len(runs.speeds) - 1)
        off = np.abs(smooth(s) - np.interp(s, pairs[:, 1], pairs[:, 0])) * runs.speeds[run]
        far = np.unique(np.searchsorted(knots, s[off > near], side="right") - 1)
        if not len(far):
            break
        middle = (knots[far] + knots[far + 1]) / 2
        knots = np.insert(knots, far + 1, middle)
        at = np.insert(at, far + 1, np.interp(middle, pairs[:, 1], pairs[:, 0]))
    return smooth


def _cuts(
    path: Path, objective: Path, runs: _Runs, pairs: FloatArray, allowed: float
) -> FloatArray:
    """Lengths of the path that blends take on either side of the vertices between runs [m].

    Args:
        path: The path.
        objective: Its objective.
        runs: The k + 1 runs of the objective's orientation.
        pairs: Places that belong together [m], (n, 2).
        allowed: Largest angle of blends [rad], infinite without one.

    Returns:
        The lengths, (k,); 0 where the rate does not jump, or where the tool stops anyway.
    """
    own = objective.orientation
    assert own is not None
    vertex = runs.segment[1:] - 1
    wanted = largest_cuts(own, allowed)[vertex]
    if not np.isfinite(allowed):
        gap = np.linalg.norm(path(runs.s[1:-1]) - objective.starts[vertex + 1], axis=1)
        half = objective.turns[vertex] / 2
        wanted = np.where(wanted > 0, 2 * gap / np.sin(half), 0.0)
    at, s = runs.at[1:-1], runs.s[1:-1]
    ends = [np.interp(x, pairs[:, 0], pairs[:, 1]) for x in (at - wanted, at + wanted)]
    cut = np.minimum(s - ends[0], ends[1] - s)
    cut = np.minimum(cut, np.minimum(np.diff(runs.s)[:-1], np.diff(runs.s)[1:]) / 2)
    cut[own.jumps[vertex] > SAME_ORIENTATION] = 0.0
    # Where the path has a corner, the tool stops anyway.
    sharp, away = _nearest(path.breaks[1:-1][path.turns > TANGENT_TOLERANCE], s)
    cut[sharp[away <= REPEATED_POINT]] = 0.0
    return cut


def _lay(runs: _Runs, place: PchipInterpolator, cut: FloatArray, *, axis_only: bool) -> Orientation:
    """The orientation at smooth places, with blends.

    Args:
        runs: The k + 1 runs of the objective's orientation.
        place: Places on the objective over the path's arc length [m].
        cut: Lengths that blends take on either side of the vertices between runs [m], (k,).
        axis_only: Rotation about the tool axis is free.
    """
    blended = np.flatnonzero(cut > 0)
    low, high = runs.s[1:-1][blended] - cut[blended], runs.s[1:-1][blended] + cut[blended]
    knots = place.x
    window = np.searchsorted(low, knots, side="right") - 1
    inside = (window >= 0) & (knots < np.append(high, -np.inf)[window])
    inside[[0, -1]] = False
    breaks = np.unique(np.concatenate([knots[~inside], low, high]))
    # Blends of neighbours may share an end, up to rounding.
    breaks = breaks[np.append(True, np.diff(breaks) > SLIVER)]
    breaks[-1] = knots[-1]
    begin, end = breaks[:-1], breaks[1:]
    middle = (begin + end) / 2
    run = np.clip(np.searchsorted(runs.s, middle, side="right") - 1, 0, len(runs.rates) - 1)
    j = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(knots) - 2)
    f, g = shift(place.c[::-1, j].T, begin - knots[j]), np.zeros((len(begin), 4))
    f[:, 0] -= runs.at[run]
    first, second, starts = runs.rates[run], np.zeros((len(begin), 3)), runs.starts[run]
    i = np.searchsorted(breaks, low + cut[blended], side="right") - 1
    # The rate before a vertex fades out from the place at the begin, and the one after it sets in.
    at, none, width = runs.at[1:-1][blended], np.zeros(len(i)), end[i] - begin[i]
    f[i] = fade(width, (place(begin[i]) - at, place(begin[i], 1)), (none, none))
    g[i] = fade(width, (none, none), (place(end[i]) - at, place(end[i], 1)))
    first[i], second[i] = runs.rates[blended], runs.rates[blended + 1]
    starts[i] = runs.starts[blended + 1]
    return Orientation(
        breaks=breaks, starts=starts, first=first, second=second, f=f, g=g, axis_only=axis_only
    )


def _between(s: FloatArray) -> FloatArray:
    """Arc lengths and three more between each two of them [m]."""
    share = np.arange(4) / 4
    inner = s[:-1, None] + share * np.diff(s)[:, None]
    return np.append(inner.ravel(), s[-1])


def _nearest(s: FloatArray, marks: FloatArray) -> tuple[IntArray, FloatArray]:
    """The nearest of some increasing marks for each arc length, and the distance to it [m]."""
    if not len(marks):
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    i = np.searchsorted((marks[1:] + marks[:-1]) / 2, s)
    return i, np.abs(s - marks[i])


def _follow(
    path: Path, objective: Path, pairs: FloatArray, allowed: float
) -> tuple[Orientation, float]:
    """Orientation that follows the tangent of the path, and how far it is off [rad]."""
    own = objective.orientation
    assert own is not None
    begin = shortest(objective.tangents[:1], path.tangents[:1])
    carried = carry(path.segments, (exp(begin) @ own.starts[:1])[0], axis_only=own.axis_only)
    # Twist at the middles of the objective's segments, against their frames with the least tilt.
    middle = (objective.breaks[:-1] + objective.breaks[1:]) / 2
    s = np.interp(middle, pairs[:, 0], pairs[:, 1])
    tangents = path.segments.at(*_on(path, s), 1)
    tilt = exp(shortest(objective.segments.at(*_on(objective, middle), 1), tangents))
    twist = np.sum(log(tilt @ own(middle) @ _turned(carried(s))) * tangents, axis=1)
    off = 0.0
    if np.abs(twist).max() > NO_TWIST:
        # At the start there is none.
        knots, twists = np.append(0.0, s), np.unwrap(np.append(0.0, twist))
        carried, off = _twist(path, carried, knots, twists)
    found, angles = blend_kinks(carried, largest_cuts(carried, allowed))
    return found, float(angles.max(initial=0.0)) + off


def _twist(
    path: Path, carried: Orientation, s: FloatArray, twist: FloatArray
) -> tuple[Orientation, float]:
    """An orientation turned about the path's tangent, linearly between arc lengths s [m].

    Each piece gets the constant rate from its start to its end; long arcs become several pieces.

    Returns:
        The orientation, and how far it is off in the middle of its pieces [rad].
    """
    off = np.abs(s - path.breaks[np.stack([path.locate(s), path.locate(s) + 1])]).min(axis=0)
    cuts = np.union1d(path.breaks, s[off > REPEATED_POINT])
    whole = path.locate((cuts[:-1] + cuts[1:]) / 2)
    first, last = cuts[:-1] - path.breaks[whole], cuts[1:] - path.breaks[whole]
    # On tiny arcs a difference of arc lengths has too few digits.
    last = np.where(cuts[1:] == path.breaks[whole + 1], path.lengths[whole], last)
    count = np.ceil(path.curvatures[whole] * (last - first) / MOST_TURN).astype(np.intp).clip(1)
    part, k = number_parts(count)
    i, step = whole[part], ((last - first) / count)[part]
    u = [first[part] + x * step for x in (k, k + 0.5, k + 1)]
    begin, middle, end = (
        exp(np.interp(path.breaks[i] + x, s, twist)[:, None] * path.segments.at(i, x, 1))
        @ carried.on_piece(i, x)
        for x in u
    )
    lengths = u[2] - u[0]
    rates = log(end @ _turned(begin)) / lengths[:, None]
    found = Orientation.even(
        lengths, begin, rates, axis_only=carried.axis_only, follows=carried.follows
    )
    off = log(found.on_piece(np.arange(len(i)), lengths / 2) @ _turned(middle))
    return found, float(np.linalg.norm(off, axis=1).max())


def _on(path: Path, s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Segments and distances along them of arc lengths."""
    i = path.locate(s)
    return i, s - path.breaks[i]


def _turned(rotations: FloatArray) -> FloatArray:
    """Inverse rotations, (n, 3, 3)."""
    return np.swapaxes(rotations, 1, 2)
