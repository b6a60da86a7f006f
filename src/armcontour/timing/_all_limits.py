"""Plans with the library's own limits in two compiled calls, one for each pass of the planner.

The same steps as in `optimal.py`, in the same order, with the same kernels. What is out of the
ordinary is left to it, and so are all refusals.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.motion._intervals import law_of_squares
from armcontour.timing._block import ENDS, count_blocks, filled, widths_of
from armcontour.timing._bracket import bound_u, bound_x, gain_left, judge, spread
from armcontour.timing._joint_limits import FOUND, LEFT, TOO_MUCH, at_points, reach_ends
from armcontour.timing._reach import (
    BELOW_CEILING,
    BINDING,
    pack,
    skew_along_discs,
    skew_along_rows,
)
from armcontour.timing.constraints._rows import (
    acceleration_bulge,
    derivatives,
    path_acceleration_bound,
    velocity_ceiling,
    velocity_ceiling_at_ends,
)
from armcontour.timing.constraints._sampled import bulges, rises
from armcontour.timing.constraints._tool import shrink_discs
from armcontour.timing.constraints._torque import (
    at_rest,
    dragged_rows,
    friction_on_grid,
    largest_u,
    rub,
)


class Joints(NamedTuple):
    """The arm and the limits of its joints.

    Args:
        velocity: Largest joint velocities, infinite for none [rad/s], (dof,).
        low: Smallest joint accelerations [rad/s²], (dof,), or (0,) for none.
        high: The largest.
        torque: Largest joint torques [N m], (dof,), or (0,) for none.
        viscous: Viscous friction, as `torque`.
        coulomb: Coulomb friction, as `torque`.
        links: Numbers of the links, as `Dynamics` packs them, (dof, 24), or (0, 24) for none.
        gravity: Acceleration of gravity in the frame of the base [m/s²], (3,).
    """

    velocity: FloatArray
    low: FloatArray
    high: FloatArray
    torque: FloatArray
    viscous: FloatArray
    coulomb: FloatArray
    links: FloatArray
    gravity: FloatArray


class Places(NamedTuple):
    """A grid, and the limits of the tool on it.

    Args:
        s: Ends of the intervals [m], (n + 1,).
        piece: Piece of the joint path that holds each interval, (n,).
        stops: Points at which the tool stops.
        fixed: Ceilings of x that depend on the place only, (2, n), or (2, 0) for none.
        curvature: Of discs: as the fields of `Discs`; (2, 0) and (0,) for none.
        radius: See above.
        stretch: See above.
        uneven: See above.
    """

    s: FloatArray
    piece: IntArray
    stops: IntArray
    fixed: FloatArray
    curvature: FloatArray
    radius: FloatArray
    stretch: FloatArray
    uneven: BoolArray


class Rules(NamedTuple):
    """Speeds of the ends, and the planner's numbers, which `optimal.py` explains.

    Args:
        start: ds² at the start.
        end: ds² at the end.
        most: Largest share of a limit that margins may take.
        fine_margin: That share where finer grids have not been tried yet.
        no_way: The share that stands for margins that leave no plan.
        fine_enough: Number of intervals from which on such a grid is refused.
        safety: Factor of bounds that are measured, as in `rises`.
        headroom: Reach of the first brackets.
        close: Reach of brackets around a plan that is found.
        wider: Ratio by which brackets widen.
        least_gain: Share of the duration below which a repetition gains too little.
        largest_dip: As in `judge`.
        near_tangent: Error of x, as a share, below which tangents are near enough.
        tries: Largest number of plans on the grid.
        tangents: Largest number of tangents.
        moves: How often plans may leave their brackets after one is found.
    """

    start: float
    end: float
    most: float
    fine_margin: float
    no_way: float
    fine_enough: int
    safety: float
    headroom: float
    close: float
    wider: float
    least_gain: float
    largest_dip: float
    near_tangent: float
    tries: int
    tangents: int
    moves: int


class Torques(NamedTuple):
    """Joint torques `a u + b x + c` on a grid, and what gravity and dry friction leave of limits.

    Args:
        a: Coefficients of u at the starts and ends, (2, n, dof).
        b: Coefficients of x there.
        c: Torques of gravity there.
        low: Lower limits there, less gravity and dry friction.
        high: Upper limits.
        drag: Viscous friction there, (2, n, dof), or (2, 0, dof) for none.
        within: Of `friction_on_grid`, (5, n, dof), or (5, 0, dof) for none.
        kept: Whether every joint can stand still and move slowly.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    low: FloatArray
    high: FloatArray
    drag: FloatArray
    within: FloatArray
    kept: bool


@compiled(inner=True, allocates=True)
def _torques(
    joints: Joints, width: FloatArray, first: FloatArray, third: FloatArray, terms: FloatArray
) -> Torques:
    """The torques on a grid, of the coefficients at its ends, (3, 2, n, dof)."""
    dof = len(joints.torque)
    a, b, c = terms[0], terms[1], terms[2]
    low, high, kept = at_rest(c, joints.torque)
    viscous, rubs, n = False, False, len(width) if dof else 0
    for j in range(dof):
        viscous |= joints.viscous[j] != 0.0
        rubs |= viscous or joints.coulomb[j] != 0.0
    drag, within = np.empty((2, n if rubs else 0, dof)), np.empty((5, n if rubs else 0, dof))
    if kept and rubs:
        friction_on_grid(width, first, third, joints.viscous, joints.coulomb, drag, within)
        kept = rub(c, within[3], within[4], joints.torque, low, high)
    if not viscous:
        drag = np.empty((2, 0, dof))
    return Torques(a, b, c, low, high, drag, within, kept)


@compiled(inner=True, allocates=True)
def _drag(
    torques: Torques, least: FloatArray, most: FloatArray, turning: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The torque rows with lines for viscous friction, as `dragged_rows`, and a before them."""
    dof = torques.a.shape[2]
    a, within = np.empty((2, len(least), 2 * dof)), torques.within
    for end in range(2):
        for i in range(len(least)):
            for j in range(2 * dof):
                a[end, i, j] = torques.a[end, i, j % dof]
    b, low, high, along, aside = dragged_rows(
        torques.b,
        torques.low,
        torques.high,
        torques.drag,
        within[0],
        within[1],
        within[2],
        least,
        most,
        turning,
    )
    return a, b, low, high, along, aside


@compiled(inner=True)
def _lower(ends: FloatArray, fixed: FloatArray, shifts: FloatArray) -> None:
    """Lower ceilings, (2, n), to fixed ones, and by how far x lies above its chord.

    Args:
        ends: The ceilings at the starts and ends, changed in place, (2, n).
        fixed: Fixed ceilings, (2, n), or (2, 0) for none.
        shifts: Slope of u over s times width², (n,).
    """
    for end in range(2):
        for i in range(ends.shape[1]):
            lowest = ends[end, i]
            if fixed.shape[1] and fixed[end, i] < lowest:
                lowest = fixed[end, i]
            # Where u falls, x lies above its chord by up to |skew| width² / 4.
            ends[end, i] = lowest + shifts[i] / 4 if shifts[i] < 0.0 else lowest


@compiled(inner=True, allocates=True)
def _coarse_terms(terms: FloatArray, of: IntArray, coarse: int) -> FloatArray:
    """The coefficients at the ends of coarse intervals, of those at the ends of all intervals.

    Args:
        terms: Those at the ends of all intervals, (3, 2, n, dof).
        of: The coarse interval of each interval, (n,).
        coarse: Number of coarse intervals.
    """
    n, dof = terms.shape[2], terms.shape[3]
    found = np.empty((3, 2, coarse if n else 0, dof))
    for i in range(n):
        k = of[i]
        begins, ends = i == 0 or of[i - 1] != k, i == n - 1 or of[i + 1] != k
        for end, here in ((0, begins), (1, ends)):
            if here:
                for term in range(3):
                    for j in range(dof):
                        found[term, end, k, j] = terms[term, end, i, j]
    return found


@compiled()
def plan_roughly(
    breaks: FloatArray,
    coefficients: FloatArray,
    places: Places,
    of: IntArray,
    joints: Joints,
    rules: Rules,
    terms: FloatArray,
) -> tuple[FloatArray, FloatArray, bool]:
    """Plan without margins and without skew, and find the slopes of u for such a plan.

    Args:
        breaks: Of the joint path, (pieces + 1,).
        coefficients: Of the joint path, (pieces, 6, dof).
        places: The coarse grid.
        of: The coarse interval of each interval of the grid, (n,).
        joints: The arm and the limits of its joints.
        rules: The rules.
        terms: Coefficients of the torques at the ends of all intervals of the grid, of
            `terms_on_grid`.

    Returns:
        ds² at the points of the coarse grid, slopes of dds, and whether there is a plan.
    """
    n, dof = len(places.piece), coefficients.shape[2]
    width, path = widths_of(places.s), np.empty((6, n, dof))
    first, second, third, fourth = path[0:2], path[2:4], path[4], path[5]
    derivatives(coefficients, breaks, places.piece, places.s, first, second, third, fourth)
    torques = _torques(joints, width, first, third, _coarse_terms(terms, of, n))
    if not torques.kept:
        return width, width, False
    ends = velocity_ceiling_at_ends(first, joints.velocity)
    none, lost, skew = filled(n, 0.0), filled(n, 0.0), filled(n, 0.0)
    no_margin = np.empty((n, 2 * dof))
    for i in range(n):
        for j in range(2 * dof):
            no_margin[i, j] = 0.0
    _lower(ends, places.fixed, none)
    ceiling = at_points(ends, places.stops)
    low, high = joints.low.reshape(1, 1, -1), joints.high.reshape(1, 1, -1)
    rows, lines = len(joints.low), len(joints.torque)
    packed = np.empty((count_blocks(n), 2 * (rows + lines), ENDS))
    a, b, floor, top = torques.a, torques.b, torques.low, torques.high
    discs = places.curvature, places.radius
    about = none
    for k in range(rules.tangents + 1):
        if rows:
            pack(width, none, first, second, low, high, no_margin, 0, packed, lost)
        if lines:
            pack(width, none, a, b, floor, top, no_margin, rows, packed, lost)
        x, sound = reach_ends(width, packed, ceiling, *discs, none, rules.start, rules.end)
        if not sound:
            return x, skew, False
        if k == rules.tangents or not torques.drag.shape[1]:
            break
        near, before = k > 0, about
        about = np.empty(n)
        for i in range(n):
            about[i] = (x[i] + x[i + 1]) / 2
            near &= abs(about[i] - before[i]) <= rules.near_tangent * before[i]
        if near:
            break
        a, b, floor, top, _, _ = _drag(torques, about, about, False)
        if k == 0:
            packed = np.empty((count_blocks(n), 2 * (rows + 2 * lines), ENDS))
    used = np.empty(n)
    for i in range(n):
        free = 0.0 < x[i] <= ceiling[i] * BELOW_CEILING
        free = free and 0.0 < x[i + 1] <= ceiling[i + 1] * BELOW_CEILING
        used[i] = BINDING if free else math.inf
    if rows:
        skew_along_rows(width, first, second, low, high, x, used, skew)
    if lines:
        skew_along_rows(width, a, b, floor, top, x, used, skew)
    if len(places.radius):
        skew_along_discs(width, places.curvature, places.radius, x, used, skew)
    return x, skew, True


@compiled(inner=True, allocates=True)
def _largest_u(
    first: FloatArray,
    second: FloatArray,
    places: Places,
    joints: Joints,
    torques: Torques,
    x: FloatArray,
) -> FloatArray:
    """Largest |u| on every interval that all limits allow for the largest x, (n,)."""
    allowed = filled(len(x), math.inf)
    if len(joints.low):
        allowed = path_acceleration_bound(first, second, joints.low, joints.high, x)
    if len(joints.torque):
        t = torques
        found = largest_u(t.a, t.b, t.c, t.drag, joints.torque, joints.coulomb, x)
        for i in range(len(x)):
            allowed[i] = min(allowed[i], found[i])
    for i in range(len(places.radius)):
        allowed[i] = min(allowed[i], places.radius[i])
    return allowed


@compiled(inner=True, allocates=True)
def _repack_torques(
    width: FloatArray,
    torques: Torques,
    bends: FloatArray,
    x: FloatArray,
    least: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    shifts: FloatArray,
    at: int,
    margin: FloatArray,
    packed: FloatArray,
    lost: FloatArray,
) -> None:
    """Pack the torque rows with margins for the bounds of x and u.

    Args:
        width: Lengths of the intervals, (n,).
        torques: The torques.
        bends: Bounds of the distances of a, b and c from their chords, (3, n, dof).
        x: Largest x, (n,).
        least: Smallest x, (n,).
        u: Largest |u|, (n,).
        skew: Slope of u over s, (n,).
        shifts: The same times width², (n,).
        at: Number of rows before these.
        margin: Memory for the margins, (n, rows).
        packed: As in `pack`.
        lost: As in `pack`.
    """
    n, dof = bends.shape[1], bends.shape[2]
    a, b, low, high = torques.a, torques.b, torques.low, torques.high
    of_a, of_b, of_c = bends[0], bends[1], bends[2]
    if torques.drag.shape[1]:
        a, b, low, high, along, aside = _drag(torques, least, x, True)
        twice = np.empty((3, n, 2 * dof))
        for i in range(n):
            for k in range(2 * dof):
                j = k % dof
                twice[0, i, k], twice[1, i, k] = bends[0, i, j], bends[1, i, j] + along[i, k]
                twice[2, i, k] = bends[2, i, j] + aside[i, k]
        of_a, of_b, of_c = twice[0], twice[1], twice[2]
    bulges(width, a, b, of_a, of_b, of_c, x, u, skew, margin)
    pack(width, shifts, a, b, low, high, margin, at, packed, lost)


@compiled()
def plan_in_brackets(
    breaks: FloatArray,
    coefficients: FloatArray,
    fine: Places,
    of: IntArray,
    joints: Joints,
    rules: Rules,
    x: FloatArray,
    slope: FloatArray,
    terms: FloatArray,
    middles: FloatArray,
    packed: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Plan with margins around the plan on the coarse grid.

    Args:
        breaks: Of the joint path, (pieces + 1,).
        coefficients: Of the joint path, (pieces, 6, dof).
        fine: The grid.
        of: The coarse interval of each interval, (n,).
        joints: The arm and the limits of its joints.
        rules: The rules.
        x: Of `plan_roughly`, as `slope`.
        slope: See above.
        terms: Of `terms_on_grid`, as `middles`.
        middles: See above.
        packed: Memory for the rows, as `pack` takes it.

    Returns:
        ds² at the points, (n + 1,); slopes of dds, (n,); the share of limits that margins take,
        (n,); and FOUND, TOO_MUCH where margins take too much, or else LEFT.
    """
    n, dof, lines = len(fine.piece), coefficients.shape[2], len(joints.torque)
    s, width, lost = fine.s, widths_of(fine.s), filled(n, 0.0)
    path = np.empty((6, n, dof))
    first, second, third, fourth = path[0:2], path[2:4], path[4], path[5]
    derivatives(coefficients, breaks, fine.piece, s, first, second, third, fourth)
    torques = _torques(joints, width, first, third, terms)
    if not torques.kept:
        return x, slope, lost, LEFT
    bends = np.empty((3, n, lines))
    for term in range(3 if lines else 0):
        rises(width, fine.piece, terms[term], middles[term], rules.safety, bends[term])
    rows, bracketed = len(joints.low), lines > 0
    low, high = joints.low.reshape(1, 1, -1), joints.high.reshape(1, 1, -1)
    more = 2 * lines if torques.drag.shape[1] else lines
    margin, bulge = np.empty((n, more)), np.empty((n, rows))
    most, least, slope = spread(x, slope, of)
    ratio, radius = filled(n, rules.headroom), np.empty(len(fine.radius))
    steady, dips, left = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        steady[i] = False
    # The law that is found, which may not be the fastest yet, and its duration.
    best, best_skew, duration, moves = x, slope, math.inf, 0
    for _ in range(rules.tries):
        skew, shifts, unbounded = np.empty(n), np.empty(n), False
        for i in range(n):
            skew[i] = 0.0 if steady[i] else slope[i]
            shifts[i] = skew[i] * width[i] ** 2
        largest, smallest = bound_x(most, least, ratio, skew, width)
        allowed = _largest_u(first, second, fine, joints, torques, largest)
        for i in range(n):
            unbounded |= allowed[i] == math.inf
        if unbounded:
            return x, skew, lost, LEFT
        u = bound_u(allowed, largest, smallest, skew, width, bracketed)
        ends, lost = velocity_ceiling(
            width, first, second, third, joints.velocity, largest, u, skew
        )
        _lower(ends, fine.fixed, shifts)
        if len(radius):
            shrink_discs(
                width,
                fine.curvature,
                fine.radius,
                fine.stretch,
                fine.uneven,
                largest,
                u,
                skew,
                radius,
            )
            for i in range(n):
                if abs(skew[i]) * width[i] / 2 > radius[i]:
                    lost[i] = max(lost[i], 1.0)
        if rows:
            acceleration_bulge(width, first, second, third, fourth, largest, u, skew, bulge)
            pack(width, shifts, first, second, low, high, bulge, 0, packed, lost)
        if lines:
            _repack_torques(
                width,
                torques,
                bends,
                largest,
                smallest,
                u,
                skew,
                shifts,
                rows,
                margin,
                packed,
                lost,
            )
        too_much = changed = False
        for i in range(n):
            if lost[i] > rules.most:
                # As in the general planner: skew is left out where it is the cause.
                too_much = True
                if skew[i] != 0.0 and (lost[i] >= 1.0 or rules.most > rules.fine_margin):
                    steady[i] = changed = True
        if too_much:
            if not changed:
                return best, best_skew, lost, FOUND if duration < math.inf else TOO_MUCH
            continue
        ceiling = at_points(ends, fine.stops)
        discs = fine.curvature, radius
        x, sound = reach_ends(width, packed, ceiling, *discs, shifts, rules.start, rules.end)
        if not sound:
            if duration == math.inf and n > rules.fine_enough:
                return x, skew, lost, LEFT
            for i in range(n):
                lost[i] = rules.no_way
            return best, best_skew, lost, FOUND if duration < math.inf else TOO_MUCH
        any_dips, any_left = judge(
            x, skew, width, largest, smallest, bracketed, rules.largest_dip, dips, left
        )
        if any_dips:
            for i in range(n):
                steady[i] |= dips[i]
        elif any_left:
            if duration < math.inf and moves == rules.moves:
                return best, best_skew, lost, FOUND
            moves += 1
            for i in range(n):
                if left[i] or not bracketed:
                    most[i] = max(most[i], x[i], x[i + 1])
                    least[i] = min(least[i], x[i], x[i + 1])
                    ratio[i] *= rules.wider
        else:
            times, _, _, stuck = law_of_squares(s, x, skew)
            if stuck >= 0:
                return x, skew, lost, LEFT
            if times[n] > duration:
                return best, best_skew, lost, FOUND
            if not bracketed or times[n] >= duration * (1 - rules.least_gain):
                return x, skew, lost, FOUND
            if gain_left(times, lost, x, most, least, ratio, rules.close) <= rules.least_gain:
                return x, skew, lost, FOUND
            best, best_skew, duration, moves = x, skew, times[n], 0
            for i in range(n):
                most[i], least[i] = max(x[i], x[i + 1]), min(x[i], x[i + 1])
                ratio[i] = rules.close
    if duration < math.inf:
        return best, best_skew, lost, FOUND
    for i in range(n):
        lost[i] = max(lost[i], rules.most)
    return x, slope, lost, TOO_MUCH
