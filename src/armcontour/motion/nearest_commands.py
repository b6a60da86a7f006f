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
from armcontour.robot.limit_use import use_of
from armcontour.robot.limits import JOINT_RANGE, UNITS

# Limits of commands by the order of the differences that they bound. Order 0 has two limits, the
# ends of the joint range.
BY_ORDER = ("", "joint_velocity", "joint_acceleration", "joint_jerk")
COMMAND_LIMITS = (*BY_ORDER[1:], *JOINT_RANGE)
# Number of decimals of set-points within limits [rad], the same as in written files.
DECIMALS = 12
# Maximum number of iterations; 12 to 30 are usual.
MAX_STEPS = 80
# Tolerance of a solution's violation of its bounds, relative to half the distance between them.
EXACT = 1e-10
# Tolerance of a solution's duality gap, relative to the sum of the squared changes of the values.
OPTIMAL = 1e-9
# Tolerance of the same gap, relative to the same sum, if rounding errors end the search.
ROUNDED = 1e-5
# Initial product of slack and multiplier if a bound is exceeded by at least half the distance
# between the bounds.
FIRST_PRODUCT = 1.0
# A missing bound is replaced by this multiple of the largest magnitude of the values and of the
# other bound.
FAR = 10.0
# Fraction of the longest feasible step that is used, so that slacks and multipliers stay positive.
INSIDE = 0.995


def check_command_limits(limits: Limits, dof: int) -> Limits:
    """Checked limits of commands, with one value per joint."""
    names = [x for x in UNITS if getattr(limits, x) is not None]
    if others := [x for x in names if x not in COMMAND_LIMITS]:
        raise InvalidInput(
            f"command_limits has {others[0]}, but supports only {', '.join(COMMAND_LIMITS)}. "
            f"Specify {others[0]} in limits."
        )
    return limits.for_joints(dof)


def command_bounds(limits: Limits, dof: int) -> FloatArray:
    """Lower and upper bounds of set-points and their derivatives of orders 1 to 3, (4, 2, dof)."""
    return np.array([limits.joint_range(dof), *(limits.bounds(x, dof) for x in BY_ORDER[1:])])


def command_use(q: FloatArray, cycle: float, limits: Limits) -> dict[str, FloatArray]:
    """Largest ratio of set-points to each limit, {name of `BY_ORDER`: ratio per joint, (dof,)}.

    - `q`: set-points [rad], (n, dof), constant before and after.
    - `cycle`: cycle [s].
    """
    use = {}
    for order, name in enumerate(BY_ORDER):
        if name and getattr(limits, name) is not None:
            derivative = differences(q, order) / cycle**order
            use[name] = use_of(name, limits, derivative).largest
    return use


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
    """The largest excess of set-points over their bounds; None if all bounds are satisfied.

    - `q`: set-points [rad], (n, dof).
    - `cycle`: cycle [s].
    - `bounds`: as from `command_bounds`, or its first orders.
    - `share`: allowed excess of derivatives, as a fraction of their bounds.
    """
    worst = COMMAND_SLACK
    excess = None
    for order, (low, high) in enumerate(bounds):
        if not (np.isfinite(low).any() or np.isfinite(high).any()):
            continue
        values = differences(q, order) / cycle**order if order else q
        upper, lower = (np.where(np.isfinite(y) & (order > 0), np.abs(y), 1.0) for y in (high, low))
        beyond = np.maximum((values - high) / upper, (low - values) / lower) - share * (order > 0)
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(beyond)), beyond.shape))
        if beyond[k, j] > worst:
            worst = float(beyond[k, j])
            value = float(values[k, j])
            end = int(value > high[j])
            limit = float(bounds[order, end, j])
            row = min(k, len(q) - 1)
            sign = -1.0 if order and value < 0 else 1.0
            name = BY_ORDER[order] or JOINT_RANGE[end]
            excess = Excess(name, order, row, j, sign * value, sign * limit)
    return excess


def find_range_or_speed_excess(q: FloatArray, cycle: float, limits: Limits) -> Excess | None:
    """The largest excess of set-points over the joint ranges, or else over the joint velocities."""
    bounds = command_bounds(limits, q.shape[1])[:2]
    return find_excess(q, cycle, bounds[:1]) or find_excess(q, cycle, bounds)


def nearest_commands(
    q: FloatArray, cycle: float, bounds: FloatArray, otherwise: FloatArray | None = None
) -> tuple[FloatArray, int | None]:
    """Set-points within bounds, with the smallest mean squared difference from `q`.

    The set-points of joints within their bounds are not changed. Other set-points are rounded to
    DECIMALS, and satisfy the bounds after this rounding.

    Returns set-points [rad], (n, dof), and None; without `otherwise`, the search stops at the first
    joint whose bounds cannot be satisfied and returns the index of this joint.

    - `q`: set-points [rad], (n, dof), at rest before and after.
    - `cycle`: cycle [s].
    - `bounds`: as from `command_bounds`.
    - `otherwise`: set-points for joints whose bounds cannot be satisfied.
    """
    commands = q.copy()
    for j in range(q.shape[1]):
        joint_bounds = bounds[:, :, j]
        one = q[:, j : j + 1]
        if find_excess(one, cycle, joint_bounds[:, :, None]) is None:
            continue
        steps = cycle ** np.arange(len(joint_bounds))[:, None]
        digit = 10.0**-DECIMALS
        margin = digit * 2.0 ** np.arange(len(joint_bounds))[:, None] + COMMAND_SLACK * np.abs(
            joint_bounds * steps
        )
        inside = joint_bounds * steps + np.where(np.isfinite(joint_bounds), margin, 0.0) * (
            1.0,
            -1.0,
        )
        nearest = nearest_within(one[:, 0], [(float(x), float(y)) for x, y in inside])
        if nearest is None:
            if otherwise is None:
                return commands, j
            commands[:, j] = otherwise[:, j]
            continue
        commands[:, j] = np.round(nearest, DECIMALS)
    return commands, None


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def nearest_within(values: FloatArray, bounds: Sequence[tuple[float, float]]) -> FloatArray | None:
    """Least-squares nearest values within bounds on values and differences; None if impossible.

    The first and the last value do not change; before and after them the values are assumed
    constant. The method is a primal-dual interior-point method (Mehrotra, SIAM J. Optim. 2,
    575-601, 1992) on banded equations, so the time is proportional to the number of values.

    The values have shape (n,). `bounds` apply to the values, then to their differences of orders
    1, 2, ....
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    orders = [k for k, x in enumerate(bounds) if isfinite(x[0]) or isfinite(x[1])]
    if not orders or len(values) < 3:
        return values
    rooms = []
    scales = []
    for k in orders:
        values_of_order = differences(values, k) if k else values[1:-1]
        # A missing bound is replaced by a bound that the nearest values do not reach.
        distant = FAR * max(
            float(np.abs(values_of_order).max()), *(abs(x) for x in bounds[k] if isfinite(x))
        )
        low = max(bounds[k][0], -distant)
        high = min(bounds[k][1], distant)
        scales.append(2 / (high - low))
        rooms.append(scales[-1] * np.stack([high - values_of_order, values_of_order - low]))
    room = np.concatenate(rooms, axis=1)
    cuts = np.cumsum([x.shape[1] for x in rooms])[:-1]
    excess = -float(room.min())
    if excess <= 0:
        return values
    change = np.zeros(len(values) - 2)
    side = np.array([[1.0], [-1.0]])

    def forward(x: FloatArray) -> FloatArray:
        """Scaled differences of x, the changes of the inner values; other changes are zero."""
        parts = zip(orders, scales, strict=True)
        return np.concatenate([scale * np.diff(np.pad(x, k), k) for k, scale in parts])

    def adjoint(x: FloatArray) -> FloatArray:
        """Transpose of `forward`, applied to the upper minus the lower row of x."""
        parts = zip(orders, scales, np.split(x[0] - x[1], cuts), strict=True)
        return np.asarray(sum(scale * (-1) ** k * np.diff(y, k) for k, scale, y in parts))

    def direction(
        matrix: FloatArray,
        gradient: FloatArray,
        outside: FloatArray,
        slacks: FloatArray,
        multipliers: FloatArray,
        target: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Newton step that changes slacks times multipliers by `target`: x, slacks, multipliers."""
        right = -gradient - adjoint((target + multipliers * outside) / slacks)
        step = cho_solve_banded((matrix, True), right, check_finite=False)
        wider = -outside - side * forward(step)
        return step, wider, (target - multipliers * wider) / slacks

    slacks = np.maximum(room, max(excess, 1.0))
    multipliers = FIRST_PRODUCT * min(excess, 1.0) ** 2 / slacks
    for _ in range(MAX_STEPS):
        outside = side * forward(change) + slacks - room
        gradient = change + adjoint(multipliers)
        products = slacks * multipliers
        gap = float(products.sum())
        size = float(change @ change)
        satisfied = float(np.abs(outside).max()) < EXACT
        if satisfied and gap < OPTIMAL * size:
            break
        if not isfinite(gap + size):
            return None
        weights = np.split((multipliers / slacks).sum(axis=0), cuts)
        try:
            matrix = _bands(len(change), orders, scales, weights)
            matrix = cholesky_banded(matrix, lower=True, check_finite=False)
        except LinAlgError:
            if satisfied and gap < ROUNDED * size:
                break
            return None

        state = matrix, gradient, outside, slacks, multipliers
        _, wider, stronger = direction(*state, -products)
        primal = _step_fraction(slacks, wider)
        dual = _step_fraction(multipliers, stronger)
        after = float(np.sum((slacks + primal * wider) * (multipliers + dual * stronger)))
        mean = (after / gap) ** 3 * gap / slacks.size
        step, wider, stronger = direction(*state, mean - products - wider * stronger)
        primal = INSIDE * _step_fraction(slacks, wider)
        dual = INSIDE * _step_fraction(multipliers, stronger)
        change += primal * step
        slacks += primal * wider
        multipliers += dual * stronger
    else:
        return None
    nearest = values.copy()
    nearest[1:-1] += change
    return nearest


def _bands(
    count: int, orders: Sequence[int], scales: Sequence[float], weights: Sequence[FloatArray]
) -> FloatArray:
    """Lower bands, diagonal first, of `I + sum(D' W D)`: scaled differences D, weights W."""
    bands = np.zeros((max(orders) + 1, count))
    bands[0] = 1.0
    for k, scale, weight in zip(orders, scales, weights, strict=True):
        signs = [(-1) ** j * comb(k, j) * scale for j in range(k + 1)]
        for band in range(min(k + 1, count)):
            for j in range(band, k + 1):
                shifted = weight[j : j + count - band]
                bands[band, : count - band] += signs[j] * signs[j - band] * shifted
    return bands


def _step_fraction(values: FloatArray, step: FloatArray) -> float:
    """Largest fraction of a step, at most 1, that keeps all values nonnegative."""
    return float(1 / max(1.0, -(step / values).min()))
