"""Plans with joint limits and fixed ceilings only: both passes of the planner in one compiled call.

The same steps as in `optimal.py`, in the same order, with the same kernels. What is out of the
ordinary is left to it.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.timing._block import (
    A0,
    A1,
    ABOVE,
    B0,
    B1,
    ENDS,
    HIGH0,
    HIGH1,
    INTERVAL,
    LOST,
    LOW0,
    LOW1,
    LOW_END,
    LOW_START,
    MARGIN,
    OWN,
    SHIFT,
    SKEW,
    WIDTH,
    B,
    U,
    X,
    count_blocks,
    filled,
    widths_of,
)
from armcontour.timing._bracket import bound_x, judge, sag, spread, turn
from armcontour.timing._reach import (
    BELOW_CEILING,
    BINDING,
    PLAY,
    raise_lost,
    reach,
    steer,
    write_rows,
)
from armcontour.timing.constraints._rows import (
    ceil_by_shares,
    lower_by_velocity,
    lower_u,
    place_block,
    raise_shares,
    start_margins,
    take_coefficients,
    write_bulge,
    write_derivatives,
    write_lost,
    write_slopes,
)

FOUND, TOO_MUCH, LEFT = 0, 1, 2


@compiled(inner=True, allocates=True)
def at_points(ceiling: FloatArray, stops: IntArray) -> FloatArray:
    """Largest x at the grid points, (n + 1,): the lower one of both sides, and 0 at stops.

    Args:
        ceiling: Largest x at the ends of the intervals, (2, n).
        stops: Points at which the tool stops.
    """
    n = ceiling.shape[1]
    at = np.empty(n + 1)
    at[0], at[n] = ceiling[0, 0], ceiling[1, n - 1]
    for i in range(1, n):
        at[i] = min(ceiling[1, i - 1], ceiling[0, i])
    for k in stops:
        at[k] = 0.0
    return at


@compiled(inner=True, allocates=True)
def reach_ends(
    width: FloatArray,
    packed: FloatArray,
    ceiling: FloatArray,
    curvature: FloatArray,
    radius: FloatArray,
    shifts: FloatArray,
    start: float,
    end: float,
) -> tuple[FloatArray, bool]:
    """The largest x at all points, and whether both ends have the speeds that are asked for.

    Args:
        width: As in `reach`, as `packed`, `ceiling`, `curvature`, `radius` and `shifts`.
        packed: See above.
        ceiling: See above.
        curvature: See above.
        radius: See above.
        shifts: See above.
        start: ds² at the start.
        end: ds² at the end.
    """
    n = len(width)
    if start > ceiling[0] * (1 + PLAY) or end > ceiling[n] * (1 + PLAY):
        return ceiling, False
    first, last = min(start, ceiling[0]), min(end, ceiling[n])
    x, _, stuck = reach(width, packed, ceiling, curvature, radius, shifts, first, last)
    return x, stuck < 0 and x[n] >= last * (1 - PLAY)


@compiled(inner=True, allocates=True)
def _first_pass(
    coefficients: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    piece: IntArray,
    fixed: FloatArray,
    stops: IntArray,
    velocity: FloatArray,
    own: FloatArray,
    start: float,
    end: float,
    packed: FloatArray,
) -> tuple[FloatArray, FloatArray, bool]:
    """A plan without margins and without skew, the slopes of u for it, and whether there is one."""
    n, dof = len(piece), coefficients.shape[2]
    none, skew, ceiling = filled(n, 0.0), filled(n, 0.0), np.empty((2, n))
    of, c, known = np.empty(INTERVAL), np.empty((dof, 5 * B)), -1
    ends = np.empty((count_blocks(n) * dof, ENDS))
    for m in range(B):
        of[SHIFT + m] = of[ABOVE + m] = 0.0
        for j in range(dof):
            own[j, MARGIN + m] = 0.0
    for begin in range(0, n, B):
        place_block(breaks, piece, s, begin, of)
        known = take_coefficients(coefficients, piece, begin, known, c)
        write_plainly(of, c, own, dof, velocity, ends, packed, begin // B)
        put_ceiling(of, fixed, begin, ceiling)
    highest = at_points(ceiling, stops)
    width = widths_of(s)
    no_discs = np.empty((2, 0)), np.empty(0)
    x, sound = reach_ends(width, packed, highest, *no_discs, none, start, end)
    if sound:
        steer_along_joints(width, ends, own, x, free_uses(x, highest), skew)
    return x, skew, sound


@compiled(inner=True)
def write_plainly(
    of: FloatArray,
    c: FloatArray,
    own: FloatArray,
    rows: int,
    velocity: FloatArray,
    ends: FloatArray,
    packed: FloatArray,
    b: int,
) -> None:
    """Write the derivatives, the ceilings and the rows of joints on one block, without margins.

    Args:
        of: Rows of the intervals, with SHIFT of 0.
        c: Coefficients of the joints, (dof, 5 B).
        own: Bounds of the joints, with MARGIN of 0, (dof, 7 B).
        rows: How many joints have a limit of acceleration: all, or none.
        velocity: Largest joint velocities, (dof,).
        ends: Output: derivatives of the joints, (blocks dof, 4 B).
        packed: Output: the rows, (blocks, 2 all rows, 4 B).
        b: The block.
    """
    for m in range(2 * B):
        of[LOW_START + m] = 0.0
    for j in range(len(own)):
        row = b * len(own) + j
        write_slopes(of, c, j, ends, row)
        raise_shares(of, ends, row, velocity[j])
        if j < rows:
            write_rows(of, ends, row, own, j, packed, b, j, packed.shape[1] // 2 + j)
    ceil_by_shares(of)


@compiled(inner=True, allocates=True)
def free_uses(x: FloatArray, ceiling: FloatArray) -> FloatArray:
    """The use of rows from which on one binds on each interval; infinite below a ceiling, (n,).

    Args:
        x: A plan, (n + 1,).
        ceiling: Largest x at the grid points, (n + 1,).
    """
    used = np.empty(len(x) - 1)
    for i in range(len(used)):
        free = 0.0 < x[i] <= ceiling[i] * BELOW_CEILING
        free = free and 0.0 < x[i + 1] <= ceiling[i + 1] * BELOW_CEILING
        used[i] = BINDING if free else math.inf
    return used


@compiled(inner=True)
def put_ceiling(of: FloatArray, fixed: FloatArray, begin: int, ceiling: FloatArray) -> None:
    """Write LOW_START and LOW_END, or fixed ceilings below them, less ABOVE, for all intervals.

    Args:
        of: Rows of the intervals of a block.
        fixed: Fixed ceilings, (2, n), or (2, 0) for none.
        begin: First interval of the block.
        ceiling: Output, (2, n).
    """
    for m in range(min(B, ceiling.shape[1] - begin)):
        i, start, end = begin + m, of[LOW_START + m], of[LOW_END + m]
        if fixed.shape[1]:
            start, end = min(start, fixed[0, i]), min(end, fixed[1, i])
        ceiling[0, i], ceiling[1, i] = start - of[ABOVE + m], end - of[ABOVE + m]


@compiled(inner=True)
def steer_along_joints(
    width: FloatArray,
    ends: FloatArray,
    own: FloatArray,
    x: FloatArray,
    most: FloatArray,
    skew: FloatArray,
) -> None:
    """Slopes of u over s for joint accelerations, as `skew_along_rows`.

    Args:
        width: Interval lengths, (n,).
        ends: Derivatives of the joints, (blocks dof, 4 B).
        own: Bounds of the joints on any block, (dof, 7 B).
        x: A plan, (n + 1,).
        most: As in `skew_along_rows`, changed in place, (n,).
        skew: Output, (n,).
    """
    for i in range(len(width)):
        if most[i] == math.inf:
            continue
        b, m = i // B, i % B
        for j in range(len(own)):
            k = b * len(own) + j
            joint = ends[k, A0 + m], ends[k, A1 + m], ends[k, B0 + m], ends[k, B1 + m]
            low, high = own[j, LOW0], own[j, HIGH0]
            most[i], skew[i] = steer(
                width[i], x[i], x[i + 1], joint, (low, low), (high, high), most[i], skew[i]
            )


@compiled(inner=True)
def bound_by_joints(of: FloatArray, ends: FloatArray, own: FloatArray, rows: int) -> None:
    """Write what joint accelerations allow at both ends of the intervals into U, given X.

    Args:
        of: Rows of the intervals.
        ends: Derivatives of the joints, (dof, 4 B).
        own: Bounds of the joints, (dof, 7 B).
        rows: How many joints have a limit of acceleration: all, or none.
    """
    for m in range(B):
        of[U + m] = math.inf
    for end in range(2):
        for j in range(rows):
            lower_u(of, ends, j, end, max(own[j, HIGH0], -own[j, LOW0]))


@compiled(inner=True)
def write_joints(
    of: FloatArray,
    ends: FloatArray,
    own: FloatArray,
    rows: int,
    velocity: FloatArray,
    packed: FloatArray,
    b: int,
) -> None:
    """Write the ceilings, the rows of joint accelerations and LOST of one block, with margins.

    Args:
        of: Rows of the intervals, of which X, U, SKEW and SHIFT are given.
        ends: Derivatives of the joints, (dof, 4 B).
        own: Bounds of the joints, (dof, 7 B).
        rows: How many joints have a limit of acceleration: all, or none.
        velocity: Largest joint velocities, (dof,).
        packed: Output: the rows, (blocks, 2 all rows, 4 B).
        b: The block.
    """
    start_margins(of)
    for j in range(len(ends)):
        lower_by_velocity(of, ends, own, j, velocity[j])
    write_lost(of)
    for j in range(rows):
        write_bulge(of, ends, own, j)
        write_rows(of, ends, j, own, j, packed, b, j, packed.shape[1] // 2 + j)
        raise_lost(of, ends, own, j)
    for m in range(B):
        # Where u falls, x lies above its chord.
        above = sag(of[SKEW + m], of[WIDTH + m]) if of[SKEW + m] < 0.0 else 0.0
        of[ABOVE + m] = above


@compiled()
def plan_in_one_go(
    coefficients: FloatArray,
    breaks: FloatArray,
    coarse: FloatArray,
    coarse_piece: IntArray,
    coarse_fixed: FloatArray,
    coarse_stops: IntArray,
    of: IntArray,
    s: FloatArray,
    piece: IntArray,
    fixed: FloatArray,
    stops: IntArray,
    velocity: FloatArray,
    low: FloatArray,
    high: FloatArray,
    start: float,
    end: float,
    headroom: float,
    largest_margin: float,
    fine_margin: float,
    largest_dip: float,
    wider: float,
    tries: int,
    packed: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Plan on a coarse grid, and then with margins on the grid itself.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        coarse: Ends of the coarse intervals, (coarse n + 1,).
        coarse_piece: Piece of each of them, (coarse n,).
        coarse_fixed: Fixed ceilings of x at their ends, (2, coarse n), or (2, 0) for none.
        coarse_stops: Points of the coarse grid at which the tool stops.
        of: The coarse interval of each interval, (n,).
        s: Ends of the intervals, (n + 1,).
        piece: Piece of each interval, (n,).
        fixed: Fixed ceilings at their ends, (2, n), or (2, 0) for none.
        stops: Points of the grid at which the tool stops.
        velocity: Largest joint velocities, infinite for none, (dof,).
        low: Smallest joint accelerations, (dof,).
        high: Largest joint accelerations, (dof,).
        start: ds² at the start.
        end: ds² at the end.
        headroom: Ratio by which x may be above that of the coarse plan at first.
        largest_margin: Largest share of a limit that margins may take.
        fine_margin: That share where finer grids have not been tried yet.
        largest_dip: As in `judge`.
        wider: Ratio by which the headroom grows where it was too little.
        tries: Largest number of plans on the grid.
        packed: Memory for the rows, (blocks, 2 dof, 4 B).

    Returns:
        ds² at the points, (n + 1,); slopes of dds, (n,); the share of limits that margins take,
        (n,); and FOUND, TOO_MUCH where margins take too much, or else LEFT.
    """
    n, dof = len(piece), coefficients.shape[2]
    own = np.empty((dof, OWN))
    for j in range(dof):
        for m in range(B):
            own[j, LOW0 + m] = own[j, LOW1 + m] = low[j]
            own[j, HIGH0 + m] = own[j, HIGH1 + m] = high[j]
    coarse_grid = coefficients, breaks, coarse, coarse_piece, coarse_fixed, coarse_stops
    x, slope, sound = _first_pass(*coarse_grid, velocity, own, start, end, packed)
    lost = filled(n, 0.0)
    if not sound:
        return x, slope, lost, LEFT
    width = widths_of(s)
    most, least, skew = spread(x, slope, of)
    ratio = filled(n, headroom)
    dips, left = np.empty(n, np.bool_), np.empty(n, np.bool_)
    block, c, ends = np.empty(INTERVAL), np.empty((dof, 5 * B)), np.empty((dof, ENDS))
    shifts, ceiling, known = np.empty(n), np.empty((2, n)), -1
    no_discs = np.empty((2, 0)), np.empty(0)
    for _ in range(tries):
        largest, smallest = bound_x(most, least, ratio, skew, width)
        for i in range(n):
            shifts[i] = skew[i] * width[i] ** 2
        too_much = False
        for begin in range(0, n, B):
            place_block(breaks, piece, s, begin, block)
            known = take_coefficients(coefficients, piece, begin, known, c)
            for j in range(dof):
                write_derivatives(block, c, j, ends, own)
            for m in range(B):
                i = min(begin + m, n - 1)
                block[X + m], block[SKEW + m], block[SHIFT + m] = largest[i], skew[i], shifts[i]
            bound_by_joints(block, ends, own, dof)
            unbounded = 0
            for m in range(B):
                unbounded |= int(block[U + m] == math.inf)
                block[U + m] += turn(block[SKEW + m], block[WIDTH + m])
            if unbounded:
                return x, skew, lost, LEFT
            write_joints(block, ends, own, dof, velocity, packed, begin // B)
            put_ceiling(block, fixed, begin, ceiling)
            for m in range(min(B, n - begin)):
                lost[begin + m] = block[LOST + m]
                too_much |= block[LOST + m] > largest_margin
        if too_much:
            # As in the general planner: skew is left out where it is the cause.
            changed = False
            for i in range(n):
                if lost[i] > largest_margin and skew[i] != 0.0:
                    if lost[i] >= 1.0 or largest_margin > fine_margin:
                        skew[i], changed = 0.0, True
            if not changed:
                return x, skew, lost, TOO_MUCH
            continue
        highest = at_points(ceiling, stops)
        x, sound = reach_ends(width, packed, highest, *no_discs, shifts, start, end)
        if not sound:
            return x, skew, lost, LEFT
        any_dips, any_left = judge(
            x, skew, width, largest, smallest, False, largest_dip, dips, left
        )
        if not any_dips and not any_left:
            return x, skew, lost, FOUND
        for i in range(n):
            if any_dips:
                skew[i] = 0.0 if dips[i] else skew[i]
            else:
                most[i] = max(most[i], x[i], x[i + 1])
                least[i] = min(least[i], x[i], x[i + 1])
                ratio[i] *= wider
    return x, skew, lost, LEFT
