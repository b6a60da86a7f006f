"""The compiled rows of joint torque limits with viscous friction, and their bounds of dds.

The rows of the planner are linear in x, but viscous friction is `viscous q' sqrt(x)`. On every
interval, one line bounds the root from above and one from below, `offset + slope x`, while x is
within a bracket.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.arms._blocks import B
from armcontour.arms._dynamics import (
    FIRST,
    LINK_ROWS,
    MOTION_ROWS,
    OF_U,
    OF_X,
    SECOND,
    WEIGHT,
    write_terms,
)
from armcontour.motion._motion import value_and_slopes

# Keeps divisions finite where a bracket is empty; its square root is far below any path speed.
TINY = 1e-300
# The line above viscous friction may take this share of the torque that is left at rest. So every
# row allows rest, on which the compiled planner relies.
SHARE_AT_REST = 0.5


@compiled(inner=True)
def _write_motion(
    breaks: FloatArray,
    coefficients: FloatArray,
    k: int,
    s: FloatArray,
    begin: int,
    end: int,
    rows: FloatArray,
) -> None:
    """Write joint positions and derivatives at places of piece k into a block, begin to end."""
    start, scale, at = breaks[k], 1.0 / (breaks[k + 1] - breaks[k]), s[begin:end]
    square = scale * scale
    for j in range(coefficients.shape[2]):
        own = rows[j]
        a0, a1, a2 = coefficients[k, 0, j], coefficients[k, 1, j], coefficients[k, 2, j]
        a3, a4, a5 = coefficients[k, 3, j], coefficients[k, 4, j], coefficients[k, 5, j]
        q = own[begin:end]
        first, second = own[FIRST * B + begin :], own[SECOND * B + begin :]
        for i in range(len(q)):
            x = (at[i] - start) * scale
            q[i], slope, bend = value_and_slopes(a0, a1, a2, a3, a4, a5, x)
            first[i], second[i] = scale * slope, square * bend


@compiled()
def terms_on_grid(
    links: FloatArray,
    gravity: FloatArray,
    breaks: FloatArray,
    coefficients: FloatArray,
    piece: IntArray,
    s: FloatArray,
    ends: FloatArray,
    middles: FloatArray,
) -> None:
    """Write the coefficients a, b, c of the torque `a dds + b ds² + c` on all intervals of a grid.

    Args:
        links: Numbers of the links, as `Dynamics` packs them, (dof, 24).
        gravity: Acceleration of gravity in the frame of the base [m/s²], (3,).
        breaks: Of the joint path, (pieces + 1,).
        coefficients: Of the joint path, (pieces, 6, dof).
        piece: Piece of each interval, (n,).
        s: Interval ends [m], (n + 1,).
        ends: Takes a, b and c at the starts and ends of the intervals, (3, 2, n, dof).
        middles: Takes them in the middles, (3, n, dof).
    """
    n, dof = len(piece), coefficients.shape[2]
    rows, motion = np.empty((dof, LINK_ROWS * B)), np.empty(MOTION_ROWS * B)
    for j in range(dof):
        for m in range(LINK_ROWS * B):
            rows[j, m] = 0.0
    at, of, place = np.empty(B), np.empty(B, np.intp), np.empty(B, np.intp)
    at_ends, at_middles = ends.reshape(-1), middles.reshape(-1)
    # Places are starts of intervals, their middles, and the ends that are no starts of others.
    count = i = part = 0
    while i < n or count:
        if i < n and count < B:
            at[count] = s[i] if part == 0 else s[i + 1] if part == 2 else (s[i] + s[i + 1]) / 2
            of[count], place[count] = piece[i], 3 * i + part
            count += 1
            last = i == n - 1 or piece[i + 1] != piece[i]
            if part == 2 or (part == 1 and not last):
                i, part = i + 1, 0
            else:
                part += 1
            if i < n and count < B:
                continue
        begin = 0
        while begin < count:
            end = begin + 1
            while end < count and of[end] == of[begin]:
                end += 1
            _write_motion(breaks, coefficients, of[begin], at, begin, end, rows)
            begin = end
        write_terms(links, gravity, rows, motion)
        for m in range(count):
            k, which = place[m] // 3, place[m] % 3
            both = which == 0 and k > 0 and piece[k - 1] == piece[k]
            out, size = (at_middles, n * dof) if which == 1 else (at_ends, 2 * n * dof)
            to = (n + k) * dof if which == 2 else k * dof
            for j in range(dof):
                a, b, c = rows[j, OF_U * B + m], rows[j, OF_X * B + m], rows[j, WEIGHT * B + m]
                out[to + j], out[size + to + j], out[2 * size + to + j] = a, b, c
                if both:
                    again = to + (n - 1) * dof + j
                    out[again], out[size + again], out[2 * size + again] = a, b, c
        count = 0


@compiled()
def at_rest(c: FloatArray, limit: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """What gravity leaves of the lower and upper limits, (2, n, dof), and whether it keeps them.

    Args:
        c: Torques of gravity at the starts and ends of all intervals, (2, n, dof).
        limit: Largest torques, (dof,).
    """
    low, high, kept = np.empty(c.shape), np.empty(c.shape), True
    for end in range(2):
        for i in range(c.shape[1]):
            for j in range(c.shape[2]):
                low[end, i, j], high[end, i, j] = -limit[j] - c[end, i, j], limit[j] - c[end, i, j]
                kept &= abs(c[end, i, j]) <= limit[j]
    return low, high, kept


@compiled()
def friction_on_grid(
    width: FloatArray,
    first: FloatArray,
    third: FloatArray,
    viscous: FloatArray,
    coulomb: FloatArray,
    ends: FloatArray,
    within: FloatArray,
) -> None:
    """Write bounds of joint friction on all intervals; viscous friction at ds = 1.

    Args:
        width: Lengths of the intervals, (n,).
        first: dq_ds at the starts and ends, (2, n, dof).
        third: Bounds of |d3q_ds3|, (n, dof).
        viscous: Viscous friction of each joint, (dof,).
        coulomb: Coulomb friction of each joint, (dof,).
        ends: Takes viscous friction at the starts and ends, (2, n, dof).
        within: Takes five numbers of each interval, (5, n, dof): a bound of viscous friction,
            without sign; a bound of its distance from its chord; the direction of the joint, 1 or
            -1 where it certainly does not reverse, else 0; the largest and the smallest Coulomb
            friction.
    """
    for i in range(len(width)):
        share = width[i] ** 2 / 8
        for j in range(len(viscous)):
            start, end = first[0, i, j], first[1, i, j]
            # Largest distance of dq_ds from its chord.
            off = share * third[i, j]
            largest = max(abs(start), abs(end)) + off
            one_way = start * end > 0.0 and min(abs(start), abs(end)) > off
            sign = math.copysign(1.0, start) if one_way else 0.0
            dry = coulomb[j] if largest > 0.0 else 0.0
            ends[0, i, j], ends[1, i, j] = viscous[j] * start, viscous[j] * end
            within[0, i, j], within[1, i, j] = viscous[j] * largest, viscous[j] * off
            within[2, i, j] = sign
            within[3, i, j] = (sign if one_way else 1.0) * dry
            within[4, i, j] = (sign if one_way else -1.0) * dry


@compiled()
def rub(
    c: FloatArray,
    above: FloatArray,
    below: FloatArray,
    limit: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> bool:
    """Take dry friction from the limits that gravity leaves, and say whether every joint can move.

    Args:
        c: Torques of gravity at the starts and ends of all intervals, (2, n, dof).
        above: Largest Coulomb friction on each interval, (n, dof).
        below: The smallest, (n, dof).
        limit: Largest torques, (dof,).
        low: Lower limits, (2, n, dof).
        high: Upper limits, (2, n, dof).
    """
    kept = True
    for end in range(2):
        for i in range(c.shape[1]):
            for j in range(c.shape[2]):
                low[end, i, j] -= below[i, j]
                high[end, i, j] -= above[i, j]
                creeping = c[end, i, j] + (above[i, j] if c[end, i, j] > 0.0 else below[i, j])
                kept &= abs(creeping) <= limit[j]
    return kept


@compiled()
def largest_u(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    drag: FloatArray,
    limit: FloatArray,
    dry: FloatArray,
    x: FloatArray,
) -> FloatArray:
    """Largest |u| that limits of torque allow at both ends of each interval, (n,).

    Args:
        a: Coefficients of u at the starts and ends, (2, n, dof).
        b: Coefficients of x there, (2, n, dof).
        c: Torques of gravity there, (2, n, dof).
        drag: Viscous friction at ds = 1 there, (2, n, dof), or without intervals for none.
        limit: Largest torques, (dof,).
        dry: Coulomb friction, (dof,).
        x: Largest x on each interval, (n,).
    """
    n, dof = a.shape[1], a.shape[2]
    viscous = drag.shape[1] == n
    found = np.empty(n)
    for i in range(n):
        least, root = math.inf, math.sqrt(x[i])
        for end in range(2):
            for j in range(dof):
                room = limit[j] + abs(c[end, i, j]) + abs(b[end, i, j]) * x[i] + dry[j]
                if viscous:
                    room += abs(drag[end, i, j]) * root
                size = abs(a[end, i, j])
                if size * least > room:
                    least = room / size
        found[i] = least
    return found


@compiled(inner=True)
def _tangent(least: float, most: float, cap: float) -> tuple[float, float]:
    """Offset and slope of a line above the root of x from `least` on, near the root up to `most`.

    The line is the tangent that is as far above the root at `least` as at `most`. If its offset
    exceeds `cap`, the line is the tangent of offset `cap`, at a smaller x. If that x is below
    `least`, the line is the steeper one of offset `cap` that meets the root at `least`.
    """
    low, high = math.sqrt(least), math.sqrt(max(most, TINY))
    offset = min((low + high) / 4, cap)
    return offset, 1 / (4 * offset) if offset >= low / 2 else (low - offset) / least


@compiled(inner=True)
def _chord(least: float, most: float) -> tuple[float, float]:
    """Offset and slope of a line below the root of x for x from `least` to `most`."""
    low, high = math.sqrt(least), math.sqrt(max(most, TINY))
    return low * high / (low + high), 1 / (low + high)


@compiled()
def dragged_rows(
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    drag: FloatArray,
    largest: FloatArray,
    departs: FloatArray,
    sign: FloatArray,
    least: FloatArray,
    most: FloatArray,
    turning: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows with lines for viscous friction, first those of all upper, then of all lower limits.

    Args:
        b: Coefficients of x at the starts and ends without viscous friction, (2, n, dof).
        low: Lower limits there, (2, n, dof).
        high: Upper limits there, (2, n, dof).
        drag: Viscous friction at ds = 1 there, (2, n, dof).
        largest: Bound of the viscous friction at ds = 1 on each interval, without sign, (n, dof).
        departs: Bound of its distance from its chord, (n, dof).
        sign: Direction of the joint, 1 or -1, or 0 where it may turn round, (n, dof).
        least: Smallest x of the bracket of each interval, (n,).
        most: Largest x, (n,).
        turning: Whether the rows count friction where a joint may turn round. The first pass leaves
            it out, so that rest is allowed where gravity takes all the torque.

    Returns:
        Coefficients of x, lower and upper limits, (2, n, 2 dof) each; what the lines add to the
        rises of coefficients of x and of constants, (n, 2 dof) each.
    """
    n, dof = largest.shape
    shape = (2, n, 2 * dof)
    coefficients, floor, ceiling = np.empty(shape), np.empty(shape), np.empty(shape)
    along, aside = np.empty((n, 2 * dof)), np.empty((n, 2 * dof))
    for i in range(n):
        below, fastest = _chord(least[i], most[i]), math.sqrt(most[i])
        for side in range(2):
            towards = 1.0 - 2.0 * side
            for j in range(dof):
                k = side * dof + j
                if side == 0:
                    room = min(high[0, i, j], high[1, i, j])
                else:
                    room = min(-low[0, i, j], -low[1, i, j])
                cap = math.inf
                if room > 0 and largest[i, j] > 0:
                    cap = max(SHARE_AT_REST * room / largest[i, j], TINY)
                offset, slope = below
                if sign[i, j] == towards:
                    offset, slope = _tangent(least[i], most[i], cap)
                along[i, k], aside[i, k] = departs[i, j] * slope, departs[i, j] * offset
                for end in range(2):
                    value, extra = drag[end, i, j] * offset, drag[end, i, j] * slope
                    if sign[i, j] == 0:
                        # At most that at the largest speed.
                        value, extra = towards * largest[i, j] * fastest if turning else 0.0, 0.0
                    coefficients[end, i, k] = b[end, i, j] + extra
                    floor[end, i, k] = low[end, i, j] - value if side == 1 else -math.inf
                    ceiling[end, i, k] = high[end, i, j] - value if side == 0 else math.inf
    return coefficients, floor, ceiling, along, aside
