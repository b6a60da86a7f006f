"""Limits of set-points: their differences, and the nearest set-points within bounds."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb, isfinite
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import differences
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot import Limits
from armcontour.robot.limits import JOINT_RANGE, UNITS

# Limits of commands by the order of the differences that they bound. Order 0 has two limits, the
# ends of the joint range.
BY_ORDER = ("", "joint_velocity", "joint_acceleration", "joint_jerk")
COMMAND_LIMITS = (*BY_ORDER[1:], *JOINT_RANGE)
# Number of decimals of set-points within limits [rad], the same as in written files.
DECIMALS = 12
# Maximum number of iterations; 12 to 30 are usual.
MAX_SEARCH_ITERATIONS = 80
# Tolerance of a solution's violation of its bounds, relative to half the distance between them.
BOUND_VIOLATION = 1e-10
# Tolerance of a solution's duality gap, relative to the sum of the squared changes of the values.
OPTIMAL_GAP = 1e-9
# Tolerance of the same gap, relative to the same sum, if rounding errors end the search.
ROUNDED_GAP = 1e-5
# Initial product of slack and multiplier if a bound is exceeded by at least half the distance
# between the bounds.
FIRST_PRODUCT = 1.0
# A missing bound is replaced by this multiple of the largest magnitude of the values and of the
# other bound.
MISSING_BOUND = 10.0
# Fraction of the longest feasible step that is used, so that slacks and multipliers stay positive.
STEP_SHARE = 0.995
# Number of set-points that are compared with their bounds at once, which limits the memory.
ROWS_AT_ONCE = 50_000
# Signs of a difference in its upper and its lower bound.
BOUND_SIGNS = np.array([[1.0], [-1.0]])


def check_command_limits(limits: Limits, dof: int) -> Limits:
    """Check the limits of commands; return them with one value per joint."""
    names = [x for x in UNITS if getattr(limits, x) is not None]
    if others := [x for x in names if x not in COMMAND_LIMITS]:
        raise InvalidInput(
            f"command_limits has {others[0]}, but supports only {', '.join(COMMAND_LIMITS)}. "
            f"Specify {others[0]} in limits."
        )
    return limits.for_joints(dof)


def command_bounds(limits: Limits, dof: int) -> FloatArray:
    """Return lower and upper bounds of set-points and of their derivatives 1 to 3, (4, 2, dof)."""
    return np.array([limits.joint_range(dof), *(limits.bounds(x, dof) for x in BY_ORDER[1:])])


class Excess(NamedTuple):
    """Set-points, or a difference of set-points, that exceed a limit."""

    name: str  # Name of the limit
    order: int  # Order of the difference; 0 for positions
    row: int  # Row of the set-point at which the difference begins
    joint: int
    needed: float  # The position, or the absolute value of the derivative
    allowed: float


def find_excess(
    q: FloatArray, cycle: float, bounds: FloatArray, share: float = 0.0
) -> Excess | None:
    """Find the largest excess of set-points over their bounds; None if there is none.

    - `q`: set-points [rad], (n, dof).
    - `cycle`: cycle [s].
    - `bounds`: as from `command_bounds`, or its first orders.
    - `share`: allowed excess of derivatives, as a fraction of their bounds.
    """
    largest = COMMAND_SLACK
    found = None
    for order, (low, high) in enumerate(bounds):
        if not (np.isfinite(low).any() or np.isfinite(high).any()):
            continue
        values = differences(q, order) / cycle**order if order else q
        for first in range(0, len(values), ROWS_AT_ONCE):
            part = values[first : first + ROWS_AT_ONCE]
            excesses = _excess_over_bounds(part, low, high, relative=order > 0)
            if order > 0:
                excesses = excesses - share
            k, joint = (int(i) for i in np.unravel_index(np.argmax(excesses), excesses.shape))
            if excesses[k, joint] <= largest:
                continue
            largest = float(excesses[k, joint])
            value = float(part[k, joint])
            bound = int(value > high[joint])
            # The absolute value of a derivative is reported.
            sign = -1.0 if order and value < 0 else 1.0
            found = Excess(
                name=BY_ORDER[order] or JOINT_RANGE[bound],
                order=order,
                row=min(first + k, len(q) - 1),
                joint=joint,
                needed=sign * value,
                allowed=sign * float(bounds[order, bound, joint]),
            )
    return found


def _excess_over_bounds(
    values: FloatArray, low: FloatArray, high: FloatArray, *, relative: bool
) -> FloatArray:
    """Return how far values exceed the nearer of both bounds, negative within them, (n, dof).

    - `values`: set-points, or one of their derivatives, (n, dof).
    - `low`, `high`: lower and upper bound of each joint, (dof,) each.
    - `relative`: true to return the excess as a fraction of the bound's magnitude, false to return
      it in the unit of the values.
    """
    low_unit = np.where(np.isfinite(low) & relative, np.abs(low), 1.0)
    high_unit = np.where(np.isfinite(high) & relative, np.abs(high), 1.0)
    return np.asarray(np.maximum((values - high) / high_unit, (low - values) / low_unit))


def nearest_commands(
    q: FloatArray,
    cycle: float,
    bounds: FloatArray,
    otherwise: FloatArray | None = None,
    *,
    fixed: int = 1,
) -> tuple[FloatArray, int | None]:
    """Return set-points within bounds, with the smallest mean squared difference from `q`.

    The set-points of joints within their bounds are not changed. Other set-points are rounded to
    DECIMALS, and satisfy the bounds after this rounding.

    Returns set-points [rad], (n, dof), and None; without `otherwise`, the search stops at the first
    joint whose bounds cannot be satisfied and returns the index of this joint.

    - `q`: set-points [rad], (n, dof), at rest before and after.
    - `cycle`: cycle [s].
    - `bounds`: as from `command_bounds`.
    - `otherwise`: set-points for joints whose bounds cannot be satisfied.
    - `fixed`: number of set-points at the start that do not change, and that are within the bounds.
    """
    commands = q.copy()
    for j in range(q.shape[1]):
        joint_bounds = bounds[:, :, j]
        if find_excess(q[:, j : j + 1], cycle, joint_bounds[:, :, None]) is None:
            continue
        narrower = _bounds_before_rounding(joint_bounds, cycle).tolist()
        nearest = nearest_values(q[:, j], [(low, high) for low, high in narrower], fixed)
        if nearest is None:
            if otherwise is None:
                return commands, j
            commands[:, j] = otherwise[:, j]
            continue
        commands[:, j] = np.round(nearest, DECIMALS)
    return commands, None


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def nearest_values(
    values: FloatArray, bounds: Sequence[tuple[float, float]], fixed: int = 1
) -> FloatArray | None:
    """Return the least-squares nearest values within bounds on values and differences.

    The `fixed` first values and the last one do not change; before and after all values they are
    assumed constant. Differences of fixed values only are not compared. The result is None if no
    values satisfy the bounds.

    - `values`: set-points of one joint, (n,).
    - `bounds`: lower and upper bounds of the values, then of their differences of orders 1, 2, ...
    """
    orders = [k for k, x in enumerate(bounds) if isfinite(x[0]) or isfinite(x[1])]
    if not orders or len(values) < fixed + 2:
        return values
    scaled = _scale_bounds(values, bounds, orders, fixed)
    if scaled.excess <= 0:
        return values
    change = _smallest_change(scaled)
    if change is None:
        return None
    nearest = values.copy()
    nearest[fixed:-1] += change
    return nearest


def _bounds_before_rounding(bounds: FloatArray, cycle: float) -> FloatArray:
    """Return bounds of differences that also hold after rounding to DECIMALS, (orders, 2).

    `bounds` are bounds of the derivatives of one joint, (orders, 2). Rounding changes a difference
    of order k by at most `2^k` half digits.
    """
    orders = np.arange(len(bounds))[:, None]
    difference_bounds = bounds * cycle**orders
    digit = 10.0**-DECIMALS
    margin = digit * 2.0**orders + COMMAND_SLACK * np.abs(difference_bounds)
    return difference_bounds + np.where(np.isfinite(bounds), margin, 0.0) * (1.0, -1.0)


class _ScaledBounds(NamedTuple):
    """Bounds `D x <= room[0]` and `-D x <= room[1]` on changes x of the inner values.

    The rows of D are the differences of all bounded orders, each order scaled so that its two
    bounds are 2 apart. All values except the inner ones keep their value, so x is zero there.
    """

    size: int  # Number n of inner values
    orders: list[int]  # Bounded orders of differences
    scales: list[float]  # Factor of the differences of each order
    cuts: IntArray  # First rows of all orders but the first
    room: FloatArray  # Distances from the upper and the lower bounds at x = 0, (2, rows)

    @property
    def excess(self) -> float:
        """Largest violation of a bound by the unchanged values."""
        return -float(self.room.min())

    def differences(self, x: FloatArray) -> FloatArray:
        """Return the scaled differences `D x`, (rows,)."""
        parts = zip(self.orders, self.scales, strict=True)
        return np.concatenate([scale * np.diff(np.pad(x, k), k) for k, scale in parts])

    def differences_transposed(self, x: FloatArray) -> FloatArray:
        """Return `D' (x[0] - x[1])`, the transposed operator for both bounds, (n,)."""
        parts = zip(self.orders, self.scales, np.split(x[0] - x[1], self.cuts), strict=True)
        return np.asarray(sum(scale * (-1) ** k * np.diff(y, k) for k, scale, y in parts))


def _scale_bounds(
    values: FloatArray, bounds: Sequence[tuple[float, float]], orders: list[int], fixed: int
) -> _ScaledBounds:
    """Make the scaled bounds of the given orders; missing bounds become very distant ones.

    - `fixed`: number of values at the start that do not change.
    """
    rooms = []
    scales = []
    for k in orders:
        # Differences that contain an inner value
        values_of_order = differences(values, k)[fixed - 1 :] if k else values[fixed:-1]
        largest = float(np.abs(values_of_order).max())
        distant = MISSING_BOUND * max(largest, *(abs(x) for x in bounds[k] if isfinite(x)))
        low = max(bounds[k][0], -distant)
        high = min(bounds[k][1], distant)
        scales.append(2 / (high - low))
        rooms.append(scales[-1] * np.stack([high - values_of_order, values_of_order - low]))
    cuts = np.cumsum([x.shape[1] for x in rooms])[:-1]
    size = len(values) - fixed - 1
    return _ScaledBounds(size, orders, scales, cuts, np.concatenate(rooms, axis=1))


def _smallest_change(scaled: _ScaledBounds) -> FloatArray | None:
    """Return the smallest change x within the bounds, (n,); None if none exists.

    At the minimum of `|x|² / 2`, slacks s and multipliers y, both nonnegative, satisfy

        ±D x + s = room,  x + D' (y[0] - y[1]) = 0,  s y = 0.

    Mehrotra's primal-dual interior-point method (SIAM J. Optim. 2, 575-601, 1992) solves these
    conditions. Their matrix is banded, so the time is proportional to the number of values.
    """
    iterate = _first_iterate(scaled)
    for _ in range(MAX_SEARCH_ITERATIONS):
        conditions = _conditions_at(scaled, iterate)
        if conditions.are_satisfied(OPTIMAL_GAP):
            return iterate.change
        if not isfinite(conditions.gap + conditions.size):
            return None
        factor = _factorize(scaled, iterate)
        if factor is None:
            # Rounding errors end the search.
            return iterate.change if conditions.are_satisfied(ROUNDED_GAP) else None
        _take_step(scaled, iterate, conditions, factor)
    return None


class _Iterate(NamedTuple):
    """Arrays of an iterate, changed in place; the rows of slacks and multipliers as in `room`."""

    change: FloatArray  # x, (n,)
    slacks: FloatArray  # s, (2, rows)
    multipliers: FloatArray  # y, (2, rows)


class _Conditions(NamedTuple):
    """Residuals of the conditions at an iterate."""

    outside: FloatArray  # ±D x + s - room, (2, rows)
    gradient: FloatArray  # x + D' (y[0] - y[1]), (n,)
    products: FloatArray  # s y, (2, rows)
    gap: float  # Sum of s y, which is the duality gap once the other conditions are satisfied
    size: float  # |x|²

    def are_satisfied(self, share: float) -> bool:
        """Return whether x is within the bounds and the gap below a share of `|x|²`."""
        return float(np.abs(self.outside).max()) < BOUND_VIOLATION and self.gap < share * self.size


class _Step(NamedTuple):
    """Newton's step: changes of x, s and y."""

    change: FloatArray
    slacks: FloatArray
    multipliers: FloatArray


def _first_iterate(scaled: _ScaledBounds) -> _Iterate:
    """Return the iterate x = 0, with positive slacks and multipliers of equal products."""
    excess = scaled.excess
    slacks = np.maximum(scaled.room, max(excess, 1.0))
    multipliers = FIRST_PRODUCT * min(excess, 1.0) ** 2 / slacks
    return _Iterate(np.zeros(scaled.size), slacks, multipliers)


def _conditions_at(scaled: _ScaledBounds, iterate: _Iterate) -> _Conditions:
    """Return the residuals of the conditions of `_smallest_change` at an iterate."""
    change, slacks, multipliers = iterate
    products = slacks * multipliers
    return _Conditions(
        outside=BOUND_SIGNS * scaled.differences(change) + slacks - scaled.room,
        gradient=change + scaled.differences_transposed(multipliers),
        products=products,
        gap=float(products.sum()),
        size=float(change @ change),
    )


def _factorize(scaled: _ScaledBounds, iterate: _Iterate) -> FloatArray | None:
    """Return the Cholesky factor of `I + D' W D` with `W = y / s`; None if rounding prevents it."""
    from scipy.linalg import LinAlgError, cholesky_banded

    weights = (iterate.multipliers / iterate.slacks).sum(axis=0)
    matrix = _matrix_bands(scaled, np.split(weights, scaled.cuts))
    try:
        return np.asarray(cholesky_banded(matrix, lower=True, check_finite=False))
    except LinAlgError:
        return None


def _take_step(
    scaled: _ScaledBounds, iterate: _Iterate, conditions: _Conditions, factor: FloatArray
) -> None:
    """Move an iterate by Mehrotra's step: Newton's step, corrected by what it would change."""
    change, slacks, multipliers = iterate
    products = conditions.products
    gap = conditions.gap
    # Predictor: the step to products of zero, and the gap that remains after it
    predicted = _newton_step(scaled, iterate, conditions, factor, -products)
    primal_fraction = _step_fraction(slacks, predicted.slacks)
    dual_fraction = _step_fraction(multipliers, predicted.multipliers)
    predicted_slacks = slacks + primal_fraction * predicted.slacks
    predicted_multipliers = multipliers + dual_fraction * predicted.multipliers
    predicted_gap = float(np.sum(predicted_slacks * predicted_multipliers))
    # Corrector: the step to the mean product that the predictor can reach, with its second order
    mean_product = (predicted_gap / gap) ** 3 * gap / slacks.size
    second_order = predicted.slacks * predicted.multipliers
    target = mean_product - products - second_order
    step = _newton_step(scaled, iterate, conditions, factor, target)
    primal_fraction = STEP_SHARE * _step_fraction(slacks, step.slacks)
    dual_fraction = STEP_SHARE * _step_fraction(multipliers, step.multipliers)
    change += primal_fraction * step.change
    slacks += primal_fraction * step.slacks
    multipliers += dual_fraction * step.multipliers


def _newton_step(
    scaled: _ScaledBounds,
    iterate: _Iterate,
    conditions: _Conditions,
    factor: FloatArray,
    target: FloatArray,
) -> _Step:
    """Return Newton's step that removes the residuals and changes the products s y.

    With `v = (target + y outside) / s`, its change of x solves
    `(I + D' W D) dx = -gradient - D' (v[0] - v[1])`.

    - `factor`: Cholesky factor of the matrix, as from `_factorize`.
    - `target`: required changes of the products, (2, rows).
    """
    from scipy.linalg import cho_solve_banded

    _, slacks, multipliers = iterate
    v = (target + multipliers * conditions.outside) / slacks
    right_side = -conditions.gradient - scaled.differences_transposed(v)
    change = cho_solve_banded((factor, True), right_side, check_finite=False)
    slack_change = -conditions.outside - BOUND_SIGNS * scaled.differences(change)
    return _Step(change, slack_change, (target - multipliers * slack_change) / slacks)


def _matrix_bands(scaled: _ScaledBounds, weights: Sequence[FloatArray]) -> FloatArray:
    """Return the diagonal and the lower bands of the matrix `I + D' W D`, (bands, n).

    The rows of D are the scaled differences of all bounded orders, see `_ScaledBounds`. W is the
    diagonal matrix of their weights.

    - `weights`: weights of the rows of D, one array per bounded order.
    """
    count = scaled.size
    bands = np.zeros((max(scaled.orders) + 1, count))
    bands[0] = 1.0
    for k, scale, weight in zip(scaled.orders, scaled.scales, weights, strict=True):
        signs = [(-1) ** j * comb(k, j) * scale for j in range(k + 1)]
        for band in range(min(k + 1, count)):
            for j in range(band, k + 1):
                shifted = weight[j : j + count - band]
                bands[band, : count - band] += signs[j] * signs[j - band] * shifted
    return bands


def _step_fraction(values: FloatArray, step: FloatArray) -> float:
    """Return the largest fraction of a step, at most 1, that keeps all values nonnegative."""
    return float(1 / max(1.0, -(step / values).min()))
