"""`BandedConditions`: optimality conditions of a correction, solved window by window in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.robot.nominal_robot import Equations, Response

# Number of values of a window's band. The band of one window is in memory at a time.
WINDOW_VALUES = 1e6
# Number of values of all joints' factors that are kept for further solutions with a penalty. Others
# are computed again.
KEPT_VALUES = 1.6e7
# Penalty on the deviation of the last set-point from a given one, relative to the weight of an
# error at one time.
LAST_PENALTY = 1e10


class Weights(NamedTuple):
    """Indices of set-points, and their weights in the command of one joint, (n, m) each."""

    indices: IntArray
    weights: FloatArray
    integrated: bool  # Whether the integrators get this part of the command


# Weights of the set-points in the command of a joint at the times with the indices (n,).
Commands = Callable[[int, IntArray], list[Weights]]


class Window(NamedTuple):
    """Successive unknowns whose factors are computed together."""

    first: int  # Index of the first time
    last: int  # Index after the last time
    begin: int  # First unknown
    end: int  # Unknown after the last one


class Factors(NamedTuple):
    """Factors of a window: rows of U, divided by nothing, with the pivot in the first column."""

    band: FloatArray  # (unknowns, bandwidth + 1)
    border: FloatArray  # (unknowns, 2 dof)


@compiled()
def eliminate(band: FloatArray, border: FloatArray, corner: FloatArray, size: int) -> float:
    """Factorize the first rows of a symmetric matrix in place: `K = U' D^-1 U` with D = diag U.

    No pivoting is required, because the matrix is quasi-definite. Returns the logarithm of the
    absolute product of the pivots.

    - `band`: right half of the band, `band[i, k] = K[i, i + k]`, (n, bandwidth + 1).
    - `border`, `corner`: columns of the unknowns that are eliminated last, (n, m) and (m, m).
    - `size`: number of rows to factorize.
    """
    width = band.shape[1]
    size_of_corner = corner.shape[0]
    log_product = 0.0
    for i in range(size):
        pivot = band[i, 0]
        log_product += np.log(abs(pivot))
        for k in range(1, width):
            if band[i, k] == 0.0:
                continue
            factor = band[i, k] / pivot
            for m in range(k, width):
                band[i + k, m - k] -= factor * band[i, m]
            for c in range(size_of_corner):
                border[i + k, c] -= factor * border[i, c]
        for c in range(size_of_corner):
            factor = border[i, c] / pivot
            for m in range(size_of_corner):
                corner[c, m] -= factor * border[i, m]
    return log_product


@compiled()
def substitute_forward(
    band: FloatArray, border: FloatArray, right_side: FloatArray, tail: FloatArray
) -> float:
    """Eliminate the unknowns of a window from a right side, in place.

    Returns the sum of `right_side² / pivot` of the window.

    - `band`, `border`: as in `Factors`.
    - `right_side`: right side of the window and of the following unknowns, (>= n + bandwidth,).
    - `tail`: right side of the unknowns that are eliminated last, (m,).
    """
    total = 0.0
    for i in range(len(band)):
        factor = right_side[i] / band[i, 0]
        total += factor * right_side[i]
        for k in range(1, band.shape[1]):
            right_side[i + k] -= factor * band[i, k]
        for c in range(len(tail)):
            tail[c] -= factor * border[i, c]
    return total


@compiled()
def substitute_back(
    band: FloatArray, border: FloatArray, right_side: FloatArray, tail: FloatArray
) -> None:
    """Compute the unknowns of a window in place of the right side; arguments as before."""
    for i in range(len(band) - 1, -1, -1):
        value = right_side[i]
        for k in range(1, band.shape[1]):
            value -= band[i, k] * right_side[i + k]
        for c in range(len(tail)):
            value -= border[i, c] * tail[c]
        right_side[i] = value / band[i, 0]


@compiled()
def march(left: FloatArray, right_side: FloatArray, x: FloatArray, first: int) -> None:
    """Compute the positions that follow from equations, in place.

    - `left`: blocks of the equations as in `Equations`, (n, width, dof, dof).
    - `right_side`: (n, dof); its values are replaced.
    - `x`: positions at all times [rad], (>= first + n, dof).
    - `first`: index of the first equation's time.
    """
    width = left.shape[1]
    dof = left.shape[2]
    for k in range(len(left)):
        row = right_side[k]
        for s in range(width - 1):
            earlier = max(first + k - width + 1 + s, 0)
            for a in range(dof):
                for b in range(dof):
                    row[a] -= left[k, s, a, b] * x[earlier, b]
        # Gaussian elimination without pivoting, because the mass dominates the last block.
        block = left[k, width - 1].copy()
        for a in range(dof):
            for c in range(a + 1, dof):
                factor = block[c, a] / block[a, a]
                for b in range(a, dof):
                    block[c, b] -= factor * block[a, b]
                row[c] -= factor * row[a]
        for a in range(dof - 1, -1, -1):
            value = row[a]
            for b in range(a + 1, dof):
                value -= block[a, b] * x[first + k, b]
            x[first + k, a] = value / block[a, a]


@compiled()
def multiply(left: FloatArray, x: FloatArray, product: FloatArray, first: int) -> None:
    """Add `A x` of a window to `product`, (n, dof); arguments as in `march`."""
    width = left.shape[1]
    dof = left.shape[2]
    for k in range(len(left)):
        for s in range(width):
            earlier = max(first + k - width + 1 + s, 0)
            for a in range(dof):
                for b in range(dof):
                    product[k, a] += left[k, s, a, b] * x[earlier, b]


@compiled()
def multiply_transposed(left: FloatArray, y: FloatArray, product: FloatArray, first: int) -> None:
    """Add `A' y` of a window to `product` at all times, (>= first + n, dof).

    - `y`: multipliers of the window's equations, (n, dof).
    """
    width = left.shape[1]
    dof = left.shape[2]
    for k in range(len(left)):
        for s in range(width):
            earlier = max(first + k - width + 1 + s, 0)
            for a in range(dof):
                for b in range(dof):
                    product[earlier, b] += left[k, s, a, b] * y[k, a]


@compiled()
def write_multipliers(
    left: FloatArray, weight: FloatArray, positions: IntArray, window: IntArray, band: FloatArray
) -> None:
    """Write the blocks of `A A' / W` of a window to its band.

    - `left`: blocks of the window's equations and of some later ones, (n, width, dof, dof).
    - `weight`: W at all times, (times,).
    - `positions`: positions of the multipliers, (times, dof).
    - `window`: fields of `Window`, (4,).
    """
    width = left.shape[1]
    dof = left.shape[2]
    first = window[0]
    begin = window[2]
    for k in range(window[1] - first):
        for lag in range(min(width, len(left) - k)):
            for a in range(dof):
                row = positions[first + k, a]
                for b in range(a if lag == 0 else 0, dof):
                    value = 0.0
                    for s in range(lag, width):
                        earlier = max(first + k - width + 1 + s, 0)
                        product = 0.0
                        for c in range(dof):
                            product += left[k, s, a, c] * left[k + lag, s - lag, b, c]
                        value += product / weight[earlier]
                    band[row - begin, positions[first + k + lag, b] - row] = value


class BandedConditions:
    """Conditions of the minimum of `W |error + P du|² + penalty |L du|²` for joints of one group.

    With multipliers y of the response `A x = R du`, and with `x = -error - A' y / W` eliminated,
    they are

        [ A A' / W          R        ] [ y  ]   [ -A error ]
        [    R'     -penalty L' L    ] [ du ] = [     0    ]

    The matrix is quasi-definite. In the order of time it is a band, except for the first and the
    last set-point, which have an effect until the motion begins and after it has ended. They are
    eliminated last.

    - `response`: linearized response of all joints.
    - `joints`: indices of the joints of the group.
    - `commands`: weights of the set-points in the commands.
    - `weight`: W at the times, (n,).
    - `reached`: times at which the set-points have an effect, for the order [s], (count, dof).
    """

    def __init__(
        self,
        response: Response,
        joints: IntArray,
        commands: Commands,
        weight: FloatArray,
        reached: FloatArray,
    ) -> None:
        self.joints = joints
        self._response = response
        self._commands = commands
        self._weight = np.ascontiguousarray(weight)
        self.count = len(reached)
        dof = len(joints)
        n = len(response.t)
        inner = reached[1:-1, joints]
        order = np.argsort(np.append(np.repeat(response.t, dof), inner.ravel()), kind="stable")
        positions = np.empty(len(order), dtype=np.intp)
        positions[order] = np.arange(len(order))
        # Positions of the multipliers (n, dof) and of the inner set-points (count - 2, dof).
        self.times = positions[: n * dof].reshape(n, dof)
        self.inner = positions[n * dof :].reshape(inner.shape)
        self.bandwidth = self._find_bandwidth()
        self.windows = self._divide(len(order))

    @property
    def size(self) -> int:
        """Number of unknowns, without the first and the last set-point."""
        return self.times.size + self.inner.size

    def _find_bandwidth(self) -> int:
        """Return the largest distance of unknowns in one condition."""
        width = self._response.width
        n = len(self.times)
        later = np.minimum(np.arange(n) + width - 1, n - 1)
        bandwidth = int((self.times[later, -1] - self.times[:, 0]).max())
        if not self.inner.size:
            return bandwidth
        bandwidth = max(bandwidth, int(np.diff(self.inner, axis=0).max(initial=0)))
        # The equation at a time contains commands at this time and at earlier ones.
        earlier = np.maximum(np.arange(n) - width + 1, 0)
        for a, joint in enumerate(self.joints):
            for part in self._commands(int(joint), np.arange(n)):
                is_used = part.weights != 0.0
                lowest = np.where(is_used, part.indices, self.count).min(axis=1)[earlier]
                highest = np.where(is_used, part.indices, -1).max(axis=1)
                for reach in (lowest, highest):
                    is_inner = (highest > 0) & (lowest < self.count - 1)
                    inner = np.clip(reach[is_inner], 1, self.count - 2) - 1
                    distance = np.abs(self.inner[inner, a] - self.times[is_inner, a])
                    bandwidth = max(bandwidth, int(distance.max(initial=0)))
        return bandwidth

    def _divide(self, size: int) -> list[Window]:
        """Divide the unknowns into windows."""
        dof = len(self.joints)
        n = len(self.times)
        values = size * (self.bandwidth + 1 + 2 * dof)
        firsts = np.linspace(0, n, int(np.ceil(values / WINDOW_VALUES)) + 1).astype(np.intp)
        begins = [0, *self.times[firsts[1:-1], 0].tolist(), size]
        windows = []
        for k in range(len(firsts) - 1):
            window = Window(int(firsts[k]), int(firsts[k + 1]), begins[k], begins[k + 1])
            windows.append(window)
        return windows

    def equations(self, window: Window, more: int = 0) -> Equations:
        """Return the equations of a window, and of `more` times after it."""
        last = min(window.last + more, len(self.times))
        return self._response.equations(window.first, last, self.joints)

    def assemble(self, window: Window, penalty: float) -> Factors:
        """Return the conditions of a window that contain no unknown of an earlier window."""
        shape = window.end - window.begin + self.bandwidth
        band = np.zeros((shape, self.bandwidth + 1))
        border = np.zeros((shape, 2 * len(self.joints)))
        # Times after the window whose commands contain set-points of the window.
        more = self.bandwidth // len(self.joints) + 1
        equations = self.equations(window, more)
        write_multipliers(equations.left, self._weight, self.times, np.array(window), band)
        self._write_commands(window, equations, band, border)
        self._write_jumps(window, penalty, band, border)
        return Factors(band, border)

    def _write_commands(
        self, window: Window, equations: Equations, band: FloatArray, border: FloatArray
    ) -> None:
        """Write the weights R of the set-points in the equations."""
        dof = len(self.joints)
        width = equations.left.shape[1]
        count = len(equations.left)
        rows = np.maximum(np.arange(window.first - width + 1, window.first + count), 0)
        own = window.last - window.first
        for a, joint in enumerate(self.joints):
            position = self.times[window.first : window.first + count, a]
            for part in self._commands(int(joint), rows):
                means = equations.seen if part.integrated else equations.unseen
                for s in range(width):
                    index = part.indices[s : s + count]
                    value = part.weights[s : s + count] * means[:, s, a, None]
                    for column, c in ((0, a), (self.count - 1, dof + a)):
                        at_end = np.where(index == column, value, 0.0)[:own].sum(axis=1)
                        border[position[:own] - window.begin, c] += at_end
                    if not self.inner.size:
                        continue
                    is_inner = (index > 0) & (index < self.count - 1) & (value != 0.0)
                    set_point = self.inner[np.clip(index, 1, self.count - 2) - 1, a]
                    row = np.minimum(position[:, None], set_point)
                    distance = np.abs(position[:, None] - set_point)
                    chosen = is_inner & (row >= window.begin) & (row < window.end)
                    np.add.at(band, (row[chosen] - window.begin, distance[chosen]), value[chosen])

    def _write_jumps(
        self, window: Window, penalty: float, band: FloatArray, border: FloatArray
    ) -> None:
        """Write the blocks of `-penalty L' L`."""
        dof = len(self.joints)
        inner = self.count - 2
        for a in range(dof):
            begin, end = np.searchsorted(self.inner[:, a], [window.begin, window.end])
            position = self.inner[begin:end, a]
            rows = position - window.begin
            band[rows, 0] -= 2 * penalty
            following = self.inner[begin + 1 : end + 1, a]
            band[rows[: len(following)], following - position[: len(following)]] += penalty
            for index, c in ((0, a), (inner - 1, dof + a)):
                if begin <= index < end:
                    border[rows[index - begin], c] += penalty

    def corner(self, penalty: float, held: BoolArray) -> FloatArray:
        """Return the conditions of the first and the last set-points, (2 dof, 2 dof).

        `held` is the mask of the joints whose change of the last set-point is given, (dof,).
        """
        dof = len(self.joints)
        corner = -penalty * np.eye(2 * dof)
        if self.count == 2:
            corner += penalty * np.eye(2 * dof, k=dof) + penalty * np.eye(2 * dof, k=-dof)
        corner[dof:, dof:] -= LAST_PENALTY * np.diag(held[self.joints] * 1.0)
        return corner

    def right_side(self, error: FloatArray) -> FloatArray:
        """Return `-A error` for an error of all joints, (n, dof), in the order of the unknowns."""
        values = np.zeros(self.size + self.bandwidth)
        own = np.ascontiguousarray(-error[:, self.joints])
        for window in self.windows:
            product = np.zeros((window.last - window.first, len(self.joints)))
            multiply(self.equations(window).left, own, product, window.first)
            values[self.times[window.first : window.last]] = product
        return values

    def response_to(self, solution: FloatArray, error: FloatArray) -> FloatArray:
        """Return the response `x = -error - A' y / W` of the joints of the group, (n, dof)."""
        product = np.zeros(self.times.shape)
        for window in self.windows:
            y = solution[self.times[window.first : window.last]]
            multiply_transposed(self.equations(window).left, y, product, window.first)
        return np.asarray(-error[:, self.joints] - product / self._weight[:, None])

    def respond(self, command: FloatArray) -> FloatArray:
        """Return the positions of the group's joints for commands of all joints, (n, dof)."""
        x = np.zeros(self.times.shape)
        own = command[:, self.joints]
        for window in self.windows:
            left, seen, _ = self.equations(window)
            width = left.shape[1]
            right_side = np.zeros((len(left), len(self.joints)))
            for s in range(width):
                rows = np.maximum(np.arange(window.first, window.last) - width + 1 + s, 0)
                right_side += seen[:, s] * own[rows]
            march(left, right_side, x, window.first)
        return x


class Factorization:
    """Factors of the conditions of a group for one penalty.

    The factors of the first windows are kept. Those of the others are computed again from the
    state at the begin of their window, so memory does not grow with the duration.

    - `held`: mask of the joints whose change of the last set-point is given, (dof,).
    """

    def __init__(self, conditions: BandedConditions, penalty: float, held: BoolArray) -> None:
        self.conditions = conditions
        self._penalty = penalty
        self._corner = conditions.corner(penalty, held)
        self._kept: dict[int, Factors] = {}
        self._kept_values = KEPT_VALUES * len(conditions.joints) / len(held)
        self._log_product = 0.0
        # Rows of the band and the border that follow each window, after its elimination.
        rows = conditions.bandwidth
        border = np.zeros((rows, 2 * len(conditions.joints)))
        self._states = [Factors(np.zeros((rows, rows + 1)), border)]

    @property
    def log_determinant(self) -> float:
        """Logarithm of the absolute determinant; requires an earlier solution."""
        return self._log_product + float(np.linalg.slogdet(self._corner)[1])

    def _factors(self, k: int) -> Factors:
        """Return the factors of window k, whose predecessors have been computed before."""
        if k in self._kept:
            return self._kept[k]
        conditions = self.conditions
        window = conditions.windows[k]
        band, border = conditions.assemble(window, self._penalty)
        state = self._states[k]
        band[: len(state.band)] += state.band
        border[: len(state.band)] += state.border
        size = window.end - window.begin
        is_new = len(self._states) == k + 1
        corner = self._corner if is_new else self._corner.copy()
        log_product = eliminate(band, border, corner, size)
        if is_new:
            self._log_product += log_product
            self._states.append(Factors(band[size:].copy(), border[size:].copy()))
        factors = Factors(band[:size], border[:size])
        if (k + 1) * band.size <= self._kept_values:
            self._kept[k] = factors
        return factors

    def forward(self, right_side: FloatArray, tail: FloatArray) -> float:
        """Eliminate all unknowns from a right side, in place; return `r' K^-1 r`.

        - `right_side`: of `BandedConditions.right_side`.
        - `tail`: right side of the first and the last set-points, (2 dof,).
        """
        total = 0.0
        for k, window in enumerate(self.conditions.windows):
            band, border = self._factors(k)
            total += substitute_forward(band, border, right_side[window.begin :], tail)
        return float(total + tail @ np.linalg.solve(self._corner, tail))

    def solve(self, right_side: FloatArray, tail: FloatArray) -> FloatArray:
        """Solve the conditions; return the changes of the set-points, (count, dof).

        The right side is replaced by the solution; arguments as in `forward`.
        """
        self.forward(right_side, tail)
        ends = np.asarray(np.linalg.solve(self._corner, tail), dtype=np.float64)
        windows = self.conditions.windows
        for k in range(len(windows) - 1, -1, -1):
            band, border = self._factors(k)
            substitute_back(band, border, right_side[windows[k].begin :], ends)
        first, last = ends.reshape(2, -1)
        return np.concatenate([first[None], right_side[self.conditions.inner], last[None]])
