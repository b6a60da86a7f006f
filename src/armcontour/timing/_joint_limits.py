"""Plans with joint limits and fixed ceilings only: both passes of the planner in one compiled call.

The same steps as in `optimal.py`, in the same order, with the same kernels. What is out of the
ordinary is left to it.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.timing._bracket import bound_x, judge, sag, spread, turn
from armcontour.timing._reach import (
    BELOW_CEILING,
    BINDING,
    PLAY,
    pack,
    reach,
    skew_along_rows,
    write_rows,
)
from armcontour.timing.constraints._rows import (
    derivatives,
    largest_u,
    lower_by_velocity,
    velocity_ceiling_at_ends,
    write_bulge,
    write_derivatives,
)

FOUND, LOST, LEFT = 0, 1, 2


@compiled(inner=True)
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


@compiled(inner=True)
def _reach(
    width: FloatArray,
    packed: FloatArray,
    ceiling: FloatArray,
    shifts: FloatArray,
    start: float,
    end: float,
) -> tuple[FloatArray, bool]:
    """The largest x at all points, and whether both ends have the speeds that are asked for."""
    n = len(width)
    if start > ceiling[0] * (1 + PLAY) or end > ceiling[n] * (1 + PLAY):
        return ceiling, False
    first, last = min(start, ceiling[0]), min(end, ceiling[n])
    no_disc, no_radius = np.empty((2, 0)), np.empty(0)
    x, _, stuck = reach(width, packed, ceiling, no_disc, no_radius, shifts, first, last)
    return x, stuck < 0 and x[n] >= last * (1 - PLAY)


@compiled(inner=True)
def _first_pass(
    coefficients: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    piece: IntArray,
    fixed: FloatArray,
    stops: IntArray,
    velocity: FloatArray,
    low: FloatArray,
    high: FloatArray,
    start: float,
    end: float,
    packed: FloatArray,
) -> tuple[FloatArray, FloatArray, bool]:
    """A plan without margins and without skew, the slopes of u for it, and whether there is one."""
    n, dof = len(piece), coefficients.shape[2]
    width = s[1:] - s[:-1]
    first, second = np.empty((2, n, dof)), np.empty((2, n, dof))
    third, fourth = np.empty((n, dof)), np.empty((n, dof))
    derivatives(coefficients, breaks, piece, s, first, second, third, fourth)
    ends = velocity_ceiling_at_ends(first, velocity)
    for i in range(fixed.shape[1]):
        ends[0, i], ends[1, i] = min(ends[0, i], fixed[0, i]), min(ends[1, i], fixed[1, i])
    ceiling = at_points(ends, stops)
    none, skew = np.zeros(n), np.zeros(n)
    pack(width, none, first, second, low, high, np.zeros((n, dof)), 0, packed, np.zeros(n))
    x, sound = _reach(width, packed, ceiling, none, start, end)
    if not sound:
        return x, skew, False
    used = np.empty(n)
    for i in range(n):
        free = 0.0 < x[i] <= ceiling[i] * BELOW_CEILING
        free = free and 0.0 < x[i + 1] <= ceiling[i + 1] * BELOW_CEILING
        used[i] = BINDING if free else np.inf
    skew_along_rows(width, first, second, low, high, x, used, skew)
    return x, skew, True


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
        low: Smallest joint accelerations, (1, 1, dof).
        high: Largest joint accelerations, (1, 1, dof).
        start: ds² at the start.
        end: ds² at the end.
        headroom: Ratio by which x may be above that of the coarse plan at first.
        largest_margin: Largest share of a limit that margins may take.
        fine_margin: That share where finer grids have not been tried yet.
        largest_dip: As in `judge`.
        wider: Ratio by which the headroom grows where it was too little.
        tries: Largest number of plans on the grid.
        packed: Memory for the rows, (n, 4, 2 dof).

    Returns:
        ds² at the points, (n + 1,); slopes of dds, (n,); the share of limits that margins take,
        (n,); and FOUND, LOST where margins take too much, or else LEFT.
    """
    x, slope, sound = _first_pass(
        coefficients,
        breaks,
        coarse,
        coarse_piece,
        coarse_fixed,
        coarse_stops,
        velocity,
        low,
        high,
        start,
        end,
        packed[: len(coarse_piece)],
    )
    n, dof = len(piece), coefficients.shape[2]
    lost = np.zeros(n)
    if not sound:
        return x, slope, lost, LEFT
    width = s[1:] - s[:-1]
    most, least, skew = spread(x, slope, of)
    ratio = np.full(n, headroom)
    dips, left = np.empty(n, np.bool_), np.empty(n, np.bool_)
    # Derivatives of the interval at hand, and of the one before it.
    first, second = np.empty((2, 2, dof)), np.empty((2, 2, dof))
    third, fourth, bulge = np.empty((2, dof)), np.empty((2, dof)), np.empty((2, dof))
    shifts, ceiling = np.empty(n), np.empty((2, n))
    for _ in range(tries):
        largest, smallest = bound_x(most, least, ratio, skew, width)
        too_much = False
        for i in range(n):
            row, k = i % 2, piece[i]
            before = 1 - row if i > 0 and piece[i - 1] == k else -1
            write_derivatives(
                coefficients, breaks, k, s[i], s[i + 1], before, row, first, second, third, fourth
            )
            allowed = largest_u(largest[i], row, first, second, low[0, 0], high[0, 0])
            if allowed == np.inf:
                return x, skew, lost, LEFT
            u = allowed + turn(skew[i], width[i])
            shifts[i] = skew[i] * width[i] ** 2
            at_start, at_end, share = lower_by_velocity(
                width[i], largest[i], u, skew[i], row, first, second, third, velocity
            )
            if fixed.shape[1]:
                at_start, at_end = min(at_start, fixed[0, i]), min(at_end, fixed[1, i])
            # Where u falls, x lies above its chord.
            above = sag(skew[i], width[i]) if skew[i] < 0.0 else 0.0
            ceiling[0, i], ceiling[1, i] = at_start - above, at_end - above
            write_bulge(width[i], largest[i], u, skew[i], row, first, second, third, fourth, bulge)
            half, shift = 0.5 / width[i], shifts[i]
            lost[i] = write_rows(
                half, shift, share, row, first, second, low, high, 0, bulge, 0, i, packed
            )
            too_much |= lost[i] > largest_margin
        if too_much:
            # As in the general planner: skew is left out where it is the cause.
            changed = False
            for i in range(n):
                if lost[i] > largest_margin and skew[i] != 0.0:
                    if lost[i] >= 1.0 or largest_margin > fine_margin:
                        skew[i], changed = 0.0, True
            if not changed:
                return x, skew, lost, LOST
            continue
        x, sound = _reach(width, packed, at_points(ceiling, stops), shifts, start, end)
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
