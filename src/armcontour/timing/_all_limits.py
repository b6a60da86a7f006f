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
from armcontour.timing._block import (
    ABOVE,
    ENDS,
    HIGH0,
    HIGH1,
    INTERVAL,
    LOST,
    LOW0,
    LOW1,
    MARGIN,
    OWN,
    RISES,
    SHIFT,
    SKEW,
    B,
    U,
    X,
    count_blocks,
    filled,
    take_terms,
    widths_of,
)
from armcontour.timing._bracket import bound_x, gain_left, judge, spread, turn
from armcontour.timing._joint_limits import (
    FOUND,
    LEFT,
    TOO_MUCH,
    at_points,
    bound_by_joints,
    free_uses,
    put_ceiling,
    reach_ends,
    steer_along_joints,
    write_joints,
    write_plainly,
)
from armcontour.timing._reach import (
    pack,
    raise_lost,
    skew_along_discs,
    skew_along_rows,
    take_bounds,
    write_rows,
)
from armcontour.timing.constraints._rows import (
    derivatives,
    place_block,
    take_coefficients,
    write_derivatives,
)
from armcontour.timing.constraints._sampled import rises, take_rises, write_sampled_bulge
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
    joints: Joints,
    coefficients: FloatArray,
    breaks: FloatArray,
    places: Places,
    width: FloatArray,
    terms: FloatArray,
) -> Torques:
    """The torques on a grid along a joint path, of the coefficients at its ends, (3, 2, n, dof)."""
    dof = len(joints.torque)
    a, b, c = terms[0], terms[1], terms[2]
    low, high, kept = at_rest(c, joints.torque)
    viscous, rubs, n = False, False, len(width) if dof else 0
    for j in range(dof):
        viscous |= joints.viscous[j] != 0.0
        rubs |= viscous or joints.coulomb[j] != 0.0
    drag, within = np.empty((2, n if rubs else 0, dof)), np.empty((5, n if rubs else 0, dof))
    if kept and rubs:
        path = np.empty((6, n, dof))
        first, third = path[0:2], path[4]
        derivatives(coefficients, breaks, places.piece, places.s, first, path[2:4], third, path[5])
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


@compiled(inner=True, allocates=True)
def _make_room(packed: FloatArray, kept: int, more: int) -> FloatArray:
    """The first rows of each end, as `pack` writes them, with memory for others after them."""
    blocks, every = packed.shape[0], packed.shape[1] // 2
    found = np.empty((blocks, 2 * (kept + more), ENDS))
    for b in range(blocks):
        for k in range(kept):
            for m in range(ENDS):
                found[b, k, m] = packed[b, k, m]
                found[b, kept + more + k, m] = packed[b, every + k, m]
    return found


@compiled(inner=True, allocates=True)
def _bounds_of(joints: Joints, dof: int) -> FloatArray:
    """Bounds of the joints on a block, (dof, 7 B), of acceleration as far as there are any."""
    own, rows = np.empty((dof, OWN)), len(joints.low)
    for j in range(dof):
        for m in range(B):
            own[j, MARGIN + m] = 0.0
            own[j, LOW0 + m] = own[j, LOW1 + m] = joints.low[j] if rows else -math.inf
            own[j, HIGH0 + m] = own[j, HIGH1 + m] = joints.high[j] if rows else math.inf
    return own


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
    rows, lines, blocks = len(joints.low), len(joints.torque), count_blocks(n)
    width, none, lost, skew = widths_of(places.s), filled(n, 0.0), filled(n, 0.0), filled(n, 0.0)
    torques = _torques(joints, coefficients, breaks, places, width, _coarse_terms(terms, of, n))
    if not torques.kept:
        return width, width, False
    block, c, own = np.empty(INTERVAL), np.empty((dof, 5 * B)), _bounds_of(joints, dof)
    ends, highest, known = np.empty((blocks * dof, ENDS)), np.empty((2, n)), -1
    packed = np.empty((blocks, 2 * (rows + lines), ENDS))
    for m in range(B):
        block[SHIFT + m] = block[ABOVE + m] = 0.0
    for begin in range(0, n, B):
        place_block(breaks, places.piece, places.s, begin, block)
        known = take_coefficients(coefficients, places.piece, begin, known, c)
        write_plainly(block, c, own, rows, joints.velocity, ends, packed, begin // B)
        put_ceiling(block, places.fixed, begin, highest)
    ceiling = at_points(highest, places.stops)
    a, b, floor, top = torques.a, torques.b, torques.low, torques.high
    discs = places.curvature, places.radius
    about = none
    for k in range(rules.tangents + 1):
        if lines:
            margin = filled(n * a.shape[2], 0.0).reshape(n, a.shape[2])
            pack(width, none, a, b, floor, top, margin, rows, packed, lost)
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
            packed = _make_room(packed, rows, 2 * lines)
    used = free_uses(x, ceiling)
    if rows:
        steer_along_joints(width, ends, own, x, used, skew)
    if lines:
        skew_along_rows(width, a, b, floor, top, x, used, skew)
    if len(places.radius):
        skew_along_discs(width, places.curvature, places.radius, x, used, skew)
    return x, skew, True


@compiled(inner=True, allocates=True)
def _largest_u(places: Places, joints: Joints, torques: Torques, x: FloatArray) -> FloatArray:
    """Largest |u| on every interval that torques and discs allow for the largest x, (n,)."""
    if len(joints.torque):
        t = torques
        allowed = largest_u(t.a, t.b, t.c, t.drag, joints.torque, joints.coulomb, x)
    else:
        allowed = filled(len(x), math.inf)
    for i in range(len(places.radius)):
        allowed[i] = min(allowed[i], places.radius[i])
    return allowed


class Lines(NamedTuple):
    """Rows of torque with what margins need, of all intervals.

    Args:
        a: Coefficients of u at the starts and ends, (2, n, rows).
        b: Coefficients of x there.
        low: Lower bounds there.
        high: Upper bounds there.
        rise_a: Bounds of the distances of a from its chord, (n, rows).
        rise_b: The same of b.
        rise_c: The same of what depends on the place only.
    """

    a: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray
    rise_a: FloatArray
    rise_b: FloatArray
    rise_c: FloatArray


@compiled(inner=True, allocates=True)
def _lines(torques: Torques, bends: FloatArray, least: FloatArray, most: FloatArray) -> Lines:
    """The torque rows for brackets from `least` to `most`, (n,), with lines for viscous friction.

    Args:
        torques: The torques.
        bends: Bounds of the distances of a, b and c from their chords, (3, n, dof).
        least: Smallest x, (n,).
        most: Largest x, (n,).
    """
    n, dof = bends.shape[1], bends.shape[2]
    if not torques.drag.shape[1]:
        own = torques.a, torques.b, torques.low, torques.high
        return Lines(*own, bends[0], bends[1], bends[2])
    a, b, low, high, along, aside = _drag(torques, least, most, True)
    twice = np.empty((3, n, 2 * dof))
    for i in range(n):
        for k in range(2 * dof):
            j = k % dof
            twice[0, i, k], twice[1, i, k] = bends[0, i, j], bends[1, i, j] + along[i, k]
            twice[2, i, k] = bends[2, i, j] + aside[i, k]
    return Lines(a, b, low, high, twice[0], twice[1], twice[2])


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
    torques = _torques(joints, coefficients, breaks, fine, width, terms)
    if not torques.kept:
        return x, slope, lost, LEFT
    bends = np.empty((3, n, lines))
    for term in range(3 if lines else 0):
        rises(width, fine.piece, terms[term], middles[term], rules.safety, bends[term])
    rows, bracketed, every = len(joints.low), lines > 0, packed.shape[1] // 2
    block, c, own, known = np.empty(INTERVAL), np.empty((dof, 5 * B)), _bounds_of(joints, dof), -1
    ends, shifts, u, highest = np.empty((dof, ENDS)), np.empty(n), np.empty(n), np.empty((2, n))
    # Of the torques on a block.
    own_t, ends_t = np.empty((every - rows, OWN)), np.empty((every - rows, ENDS))
    rises_t = np.empty((every - rows, RISES))
    most, least, slope = spread(x, slope, of)
    ratio, radius = filled(n, rules.headroom), np.empty(len(fine.radius))
    steady, dips, left = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        steady[i] = False
    # The law that is found, which may not be the fastest yet, and its duration.
    best, best_skew, duration, moves = x, slope, math.inf, 0
    for _ in range(rules.tries):
        skew = np.empty(n)
        for i in range(n):
            skew[i] = 0.0 if steady[i] else slope[i]
            shifts[i] = skew[i] * width[i] ** 2
        largest, smallest = bound_x(most, least, ratio, skew, width)
        allowed = _largest_u(fine, joints, torques, largest)
        rows_t = _lines(torques, bends, smallest, largest)
        for begin in range(0, n, B):
            place_block(breaks, fine.piece, s, begin, block)
            known = take_coefficients(coefficients, fine.piece, begin, known, c)
            for j in range(dof):
                write_derivatives(block, c, j, ends, own)
            for m in range(B):
                i = min(begin + m, n - 1)
                block[X + m], block[SKEW + m], block[SHIFT + m] = largest[i], skew[i], shifts[i]
            bound_by_joints(block, ends, own, rows)
            unbounded = 0
            for m in range(B):
                i = min(begin + m, n - 1)
                found = min(block[U + m], allowed[i])
                unbounded |= int(found == math.inf)
                change = turn(skew[i], width[i])
                found += change
                if bracketed:
                    across = (largest[i] - smallest[i]) / (2 * width[i])
                    found = min(found, across + 1.5 * change)
                block[U + m] = u[i] = found
            if unbounded:
                return x, skew, lost, LEFT
            write_joints(block, ends, own, rows, joints.velocity, packed, begin // B)
            put_ceiling(block, fine.fixed, begin, highest)
            if lines:
                take_terms(rows_t.a, rows_t.b, begin, ends_t)
                take_bounds(rows_t.low, rows_t.high, begin, own_t)
                take_rises(rows_t.rise_a, rows_t.rise_b, rows_t.rise_c, begin, rises_t)
            for k in range(len(own_t)):
                write_sampled_bulge(block, ends_t, rises_t, own_t, k)
                at = rows + k
                write_rows(block, ends_t, k, own_t, k, packed, begin // B, at, every + at)
                raise_lost(block, ends_t, own_t, k)
            for m in range(min(B, n - begin)):
                lost[begin + m] = block[LOST + m]
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
        ceiling = at_points(highest, fine.stops)
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
