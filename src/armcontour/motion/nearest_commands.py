"""Limits of set-points: their differences, and the nearest set-points within bounds."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb, isfinite
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
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
# The same with bounds of the joint's response, with which rounding errors are larger.
ROUNDED_RESPONSE_GAP = 1e-2
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


class JointResponse(NamedTuple):
    """Response of a joint to its set-points, and bounds of its acceleration.

    The joint responds to set-points u with positions `y = B(d) / C(d) u`, where d is the delay of
    one cycle. So if the set-points change by `C x`, the joint's positions change by `B x`. The
    bounds are those of the second differences of y.
    """

    numerator: FloatArray  # Coefficients of B
    denominator: FloatArray  # Coefficients of C, the first one is 1
    lower: float  # Lower bound of the second differences [rad]
    upper: float  # Upper bound of the second differences [rad]


class Excess(NamedTuple):
    """Set-points, or a difference of set-points, that exceed a limit."""

    name: str  # Name of the limit
    order: int  # Order of the difference; 0 for positions
    row: int  # Row of the last set-point but one of the difference
    joint: int
    needed: float  # The position, or the absolute value of the derivative
    allowed: float


def find_excess(
    q: FloatArray, cycle: float, bounds: FloatArray, share: float = 0.0
) -> Excess | None:
    """Find the largest excess of set-points over their bounds; None if there is none.

    Excesses of positions [rad] are compared with those of derivatives, which are shares of bounds.

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
    responses: Sequence[JointResponse] | None = None,
) -> tuple[FloatArray, int | None]:
    """Return set-points within bounds, with the smallest mean squared difference from `q`.

    The set-points of joints within their bounds are not changed. The nearest set-points are rounded
    to DECIMALS, and satisfy the bounds after this rounding.

    Returns the set-points [rad], (n, dof), and the first joint for which none were found, or None.
    With `otherwise`, it is always None.

    - `q`: set-points [rad], (n, dof), at rest before and after.
    - `cycle`: cycle [s].
    - `bounds`: as from `command_bounds`.
    - `otherwise`: set-points for joints for which none are found.
    - `fixed`: number of set-points at the start that do not change, and that are within the bounds.
    - `responses`: bounds of the responses of all joints, only if `fixed` is 1.
    """
    commands = q.copy()
    for j in range(q.shape[1]):
        joint_bounds = bounds[:, :, j]
        if find_excess(q[:, j : j + 1], cycle, joint_bounds[:, :, None]) is None:
            continue
        narrower = _bounds_before_rounding(joint_bounds, cycle).tolist()
        response = None if responses is None else responses[j]
        nearest = nearest_values(q[:, j], [(low, high) for low, high in narrower], fixed, response)
        if nearest is None:
            if otherwise is None:
                return commands, j
            commands[:, j] = otherwise[:, j]
            continue
        commands[:, j] = np.round(nearest, DECIMALS)
    return commands, None


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def nearest_values(
    values: FloatArray,
    bounds: Sequence[tuple[float, float]],
    fixed: int = 1,
    response: JointResponse | None = None,
) -> FloatArray | None:
    """Return the least-squares nearest values within bounds on values and differences.

    The `fixed` first values and the last one do not change; before and after all values they are
    assumed constant. Differences of fixed values only are not compared. The result is None if no
    values within the bounds are found.

    - `values`: set-points of one joint, (n,).
    - `bounds`: lower and upper bounds of the values, then of their differences of orders 1, 2, ...
    - `response`: bounds of the joint's response; the joint rests before the first value.
    """
    orders = [k for k, x in enumerate(bounds) if isfinite(x[0]) or isfinite(x[1])]
    change_filter = np.ones(1) if response is None else response.denominator
    size = len(values) - fixed - len(change_filter)
    if not orders:
        return values
    rows = [_bound_difference(values, k, bounds[k], fixed, change_filter) for k in orders]
    if response is not None:
        rows.append(_bound_response(values, response))
    problem = _Problem(size, change_filter, rows)
    if problem.excess <= 0:
        return values
    if size < 1:
        return None
    unknown = _smallest_change(problem)
    if unknown is None:
        return None
    nearest = values.copy()
    nearest[fixed:-1] += np.convolve(unknown, change_filter)
    return nearest


def _bounds_before_rounding(bounds: FloatArray, cycle: float) -> FloatArray:
    """Return bounds of differences that also hold after rounding to DECIMALS, (orders, 2).

    `bounds` are bounds of the derivatives of one joint, (orders, 2). Rounding changes a difference
    of order k by at most `2^k` half digits; whole ones are used.
    """
    orders = np.arange(len(bounds))[:, None]
    difference_bounds = bounds * cycle**orders
    digit = 10.0**-DECIMALS
    margin = digit * 2.0**orders + COMMAND_SLACK * np.abs(difference_bounds)
    return difference_bounds + np.where(np.isfinite(bounds), margin, 0.0) * (1.0, -1.0)


class _Rows(NamedTuple):
    """Bounds `F x <= room[0]` and `-F x <= room[1]` on the unknown x.

    F filters x, takes differences of an order, and scales them so that both bounds are 2 apart.
    """

    order: int
    taps: FloatArray  # Coefficients of the filter
    scale: float
    room: FloatArray  # Distances from the upper and the lower bounds at x = 0, (2, rows)

    @property
    def weights(self) -> FloatArray:
        """Weights of x in a row, from the newest value on."""
        order = self.order
        signs = [(-1) ** j * comb(order, j) * self.scale for j in range(order + 1)]
        return np.convolve(signs, self.taps)

    def apply(self, x: FloatArray) -> FloatArray:
        """Return `F x`, (rows,)."""
        filtered = np.convolve(x, self.taps)
        return np.asarray(self.scale * np.diff(np.pad(filtered, self.order), self.order))

    def apply_transposed(self, y: FloatArray) -> FloatArray:
        """Return `F' y`, (n,)."""
        summed = self.scale * (-1) ** self.order * np.diff(y, self.order)
        return np.correlate(summed, self.taps, "valid")


class _Problem(NamedTuple):
    """Smallest `|C x|` within bounds `D x <= room[0]` and `-D x <= room[1]`.

    The inner values change by `C x`, all other values stay. The rows of D are those of all bounded
    orders of differences, and of the joint's response.
    """

    size: int  # Number n of unknowns
    change_filter: FloatArray  # Coefficients of C; 1 for unknowns that are the changes
    rows: list[_Rows]

    @property
    def rounded_gap(self) -> float:
        """Tolerance of the duality gap, relative to `|C x|²`, if rounding errors end the search."""
        return ROUNDED_GAP if len(self.change_filter) == 1 else ROUNDED_RESPONSE_GAP

    @property
    def room(self) -> FloatArray:
        """Distances from the upper and the lower bounds at x = 0, (2, rows)."""
        return np.concatenate([x.room for x in self.rows], axis=1)

    @property
    def excess(self) -> float:
        """Largest violation of a bound by the unchanged values."""
        return -min(float(x.room.min(initial=np.inf)) for x in self.rows)

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Divide one value per row of D into those of `rows`."""
        return np.split(values, np.cumsum([x.room.shape[1] for x in self.rows])[:-1])

    def apply(self, x: FloatArray) -> FloatArray:
        """Return `D x`, (rows,)."""
        return np.concatenate([rows.apply(x) for rows in self.rows])

    def apply_transposed(self, y: FloatArray) -> FloatArray:
        """Return `D' (y[0] - y[1])`, the transposed operator for both bounds, (n,)."""
        parts = zip(self.rows, self.split(y[0] - y[1]), strict=True)
        return np.asarray(sum(rows.apply_transposed(part) for rows, part in parts))


def _bound_difference(
    values: FloatArray,
    order: int,
    bounds: tuple[float, float],
    fixed: int,
    change_filter: FloatArray,
) -> _Rows:
    """Bound the differences of one order; a missing bound becomes a very distant one.

    - `fixed`: number of values at the start that do not change.
    """
    # Differences that contain an inner value
    compared = differences(values, order)[fixed - 1 :] if order else values[fixed:-1]
    largest = float(np.abs(compared).max(initial=0.0))
    distant = MISSING_BOUND * max(largest, *(abs(x) for x in bounds if isfinite(x)))
    low = max(bounds[0], -distant)
    high = min(bounds[1], distant)
    scale = 2 / (high - low)
    return _Rows(order, change_filter, scale, scale * np.stack([high - compared, compared - low]))


def _bound_response(values: FloatArray, response: JointResponse) -> _Rows:
    """Bound the second differences of a joint's response to inner values."""
    from scipy.signal import lfilter

    taps, denominator, low, high = response
    compared = differences(lfilter(taps, denominator, values - values[0]), 2)
    scale = 2 / (high - low)
    return _Rows(2, taps, scale, scale * np.stack([high - compared, compared - low]))


def _smallest_change(problem: _Problem) -> FloatArray | None:
    """Return the unknown x of the smallest change within the bounds, (n,); None if none is found.

    At the minimum of `|C x|² / 2`, slacks s and multipliers y, both nonnegative, satisfy

        ±D x + s = room,  C' C x + D' (y[0] - y[1]) = 0,  s y = 0.

    Mehrotra's primal-dual interior-point method (SIAM J. Optim. 2, 575-601, 1992) solves these
    conditions. Their matrix is banded, so the time is proportional to the number of values.
    """
    room = problem.room
    iterate = _first_iterate(problem, room)
    for _ in range(MAX_SEARCH_ITERATIONS):
        conditions = _conditions_at(problem, room, iterate)
        if conditions.are_satisfied(OPTIMAL_GAP):
            return iterate.unknown
        if not isfinite(conditions.gap + conditions.size):
            return None
        factor = _factorize(problem, iterate)
        if factor is None:
            # Rounding errors end the search.
            return iterate.unknown if conditions.are_satisfied(problem.rounded_gap) else None
        _take_step(problem, iterate, conditions, factor)
    return None


class _Iterate(NamedTuple):
    """Arrays of an iterate, changed in place; the rows of slacks and multipliers as in `room`."""

    unknown: FloatArray  # x, (n,)
    slacks: FloatArray  # s, (2, rows)
    multipliers: FloatArray  # y, (2, rows)


class _Conditions(NamedTuple):
    """Residuals of the conditions at an iterate."""

    outside: FloatArray  # ±D x + s - room, (2, rows)
    gradient: FloatArray  # C' C x + D' (y[0] - y[1]), (n,)
    products: FloatArray  # s y, (2, rows)
    gap: float  # Sum of s y, which is the duality gap once the other conditions are satisfied
    size: float  # |C x|²

    def are_satisfied(self, share: float) -> bool:
        """Return whether x is within the bounds, and the others below a share of `|C x|²`."""
        if float(np.abs(self.outside).max()) > BOUND_VIOLATION:
            return False
        return max(self.gap, float(self.gradient @ self.gradient)) < share * self.size


class _Step(NamedTuple):
    """Newton's step: changes of x, s and y."""

    unknown: FloatArray
    slacks: FloatArray
    multipliers: FloatArray


def _first_iterate(problem: _Problem, room: FloatArray) -> _Iterate:
    """Return the iterate x = 0, with positive slacks and multipliers of equal products."""
    excess = problem.excess
    slacks = np.maximum(room, max(excess, 1.0))
    multipliers = FIRST_PRODUCT * min(excess, 1.0) ** 2 / slacks
    return _Iterate(np.zeros(problem.size), slacks, multipliers)


def _conditions_at(problem: _Problem, room: FloatArray, iterate: _Iterate) -> _Conditions:
    """Return the residuals of the conditions of `_smallest_change` at an iterate."""
    unknown, slacks, multipliers = iterate
    change = np.convolve(unknown, problem.change_filter)
    products = slacks * multipliers
    return _Conditions(
        outside=BOUND_SIGNS * problem.apply(unknown) + slacks - room,
        gradient=np.correlate(change, problem.change_filter, "valid")
        + problem.apply_transposed(multipliers),
        products=products,
        gap=float(products.sum()),
        size=float(change @ change),
    )


def _factorize(problem: _Problem, iterate: _Iterate) -> FloatArray | None:
    """Return the Cholesky factor of `C' C + D' W D`, `W = y / s`; None if rounding prevents it."""
    from scipy.linalg import LinAlgError, cholesky_banded

    weights = (iterate.multipliers / iterate.slacks).sum(axis=0)
    matrix = _matrix_bands(problem, weights)
    try:
        return np.asarray(cholesky_banded(matrix, lower=True, check_finite=False))
    except LinAlgError:
        return None


def _take_step(
    problem: _Problem, iterate: _Iterate, conditions: _Conditions, factor: FloatArray
) -> None:
    """Move an iterate by Mehrotra's predictor-corrector step."""
    unknown, slacks, multipliers = iterate
    products = conditions.products
    gap = conditions.gap
    # Predictor: the step to products of zero, and the gap that remains after it
    predicted = _newton_step(problem, iterate, conditions, factor, -products)
    primal_fraction = _step_fraction(slacks, predicted.slacks)
    dual_fraction = _step_fraction(multipliers, predicted.multipliers)
    predicted_slacks = slacks + primal_fraction * predicted.slacks
    predicted_multipliers = multipliers + dual_fraction * predicted.multipliers
    predicted_gap = float(np.sum(predicted_slacks * predicted_multipliers))
    # Corrector: the step to the mean product that the predictor can reach, with its second order
    mean_product = (predicted_gap / gap) ** 3 * gap / slacks.size
    second_order = predicted.slacks * predicted.multipliers
    target = mean_product - products - second_order
    step = _newton_step(problem, iterate, conditions, factor, target)
    primal_fraction = STEP_SHARE * _step_fraction(slacks, step.slacks)
    dual_fraction = STEP_SHARE * _step_fraction(multipliers, step.multipliers)
    unknown += primal_fraction * step.unknown
    slacks += primal_fraction * step.slacks
    multipliers += dual_fraction * step.multipliers


def _newton_step(
    problem: _Problem,
    iterate: _Iterate,
    conditions: _Conditions,
    factor: FloatArray,
    target: FloatArray,
) -> _Step:
    """Return Newton's step that removes the residuals and changes the products s y.

    With `v = (target + y outside) / s`, its change of x solves
    `(C' C + D' W D) dx = -gradient - D' (v[0] - v[1])`.

    - `factor`: Cholesky factor of the matrix, as from `_factorize`.
    - `target`: required changes of the products, (2, rows).
    """
    from scipy.linalg import cho_solve_banded

    _, slacks, multipliers = iterate
    v = (target + multipliers * conditions.outside) / slacks
    right_side = -conditions.gradient - problem.apply_transposed(v)
    change = cho_solve_banded((factor, True), right_side, check_finite=False)
    slack_change = -conditions.outside - BOUND_SIGNS * problem.apply(change)
    return _Step(change, slack_change, (target - multipliers * slack_change) / slacks)


def _matrix_bands(problem: _Problem, weights: FloatArray) -> FloatArray:
    """Return the diagonal and the lower bands of the matrix `C' C + D' W D`, (bands, n).

    - `weights`: diagonal of W, the weights of the rows of D.
    """
    count = problem.size
    parts = [
        (x.weights, part) for x, part in zip(problem.rows, problem.split(weights), strict=True)
    ]
    square = problem.change_filter
    bands = np.zeros((max(len(taps) for taps, _ in parts), count))
    for band in range(min(len(square), count)):
        bands[band] = square[band:] @ square[: len(square) - band]
    for taps, weight in parts:
        for band in range(min(len(taps), count)):
            for j in range(band, len(taps)):
                shifted = weight[j : j + count - band]
                bands[band, : count - band] += taps[j] * taps[j - band] * shifted
    return bands


def _step_fraction(values: FloatArray, step: FloatArray) -> float:
    """Return the largest fraction of a step, at most 1, that keeps all values nonnegative."""
    return float(1 / max(1.0, -(step / values).min()))
