"""Nearest values whose differences satisfy bounds, for set-points."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb, isfinite

import numpy as np

from armcontour.core.checks import FloatArray

# Maximum number of iterations; 12 to 30 are usual.
MAX_STEPS = 80
# Tolerances of a solution: violation relative to the bounds, and duality gap relative to the
# objective; a gap of ROUNDED is accepted if rounding errors end the search.
EXACT, OPTIMAL, ROUNDED = 1e-10, 1e-9, 1e-5
# Initial product of slack and multiplier if a bound is exceeded by at least half the distance
# between the bounds.
FIRST_PRODUCT = 1.0
# A missing bound is replaced by this multiple of the largest magnitude of the values and of the
# other bound.
FAR = 10.0
# Fraction of the longest feasible step that is used, so that slacks and multipliers stay positive.
INSIDE = 0.995


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def nearest_within(values: FloatArray, bounds: Sequence[tuple[float, float]]) -> FloatArray | None:
    """Least-squares nearest values within bounds on values and differences; None if impossible."""
    # `values` (n,). `bounds`: of the values, then of their differences of orders 1, 2, .... The
    # first and the last value do not change; before and after them the values are assumed constant.
    # The method is a primal-dual interior-point method (Mehrotra, SIAM J. Optim. 2, 575-601, 1992)
    # on banded equations, so the time is proportional to the number of values.
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    orders = [k for k, x in enumerate(bounds) if isfinite(x[0]) or isfinite(x[1])]
    if not orders or len(values) < 3:
        return values
    rooms, scales = [], []
    for k in orders:
        values_of_order = differences(values, k) if k else values[1:-1]
        # A missing bound is replaced by a bound that the nearest values do not reach.
        distant = FAR * max(
            float(np.abs(values_of_order).max()), *(abs(x) for x in bounds[k] if isfinite(x))
        )
        low, high = max(bounds[k][0], -distant), min(bounds[k][1], distant)
        scales.append(2 / (high - low))
        rooms.append(scales[-1] * np.stack([high - values_of_order, values_of_order - low]))
    room, cuts = np.concatenate(rooms, axis=1), np.cumsum([x.shape[1] for x in rooms])[:-1]
    excess = -float(room.min())
    if excess <= 0:
        return values
    change, side = np.zeros(len(values) - 2), np.array([[1.0], [-1.0]])

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
        gap, size = float(products.sum()), float(change @ change)
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
        primal, dual = _step_fraction(slacks, wider), _step_fraction(multipliers, stronger)
        after = float(np.sum((slacks + primal * wider) * (multipliers + dual * stronger)))
        mean = (after / gap) ** 3 * gap / slacks.size
        step, wider, stronger = direction(*state, mean - products - wider * stronger)
        primal, dual = (
            INSIDE * _step_fraction(slacks, wider),
            INSIDE * _step_fraction(multipliers, stronger),
        )
        change += primal * step
        slacks += primal * wider
        multipliers += dual * stronger
    else:
        return None
    nearest = values.copy()
    nearest[1:-1] += change
    return nearest


def differences(values: FloatArray, order: int) -> FloatArray:
    """Differences of an order; before the first and after the last value, values are constant."""
    around = [(order - 1, order - 1), *[(0, 0)] * (values.ndim - 1)]
    return np.diff(np.pad(values, around, mode="edge"), order, axis=0)


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
