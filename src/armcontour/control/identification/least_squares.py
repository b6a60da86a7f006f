"""Least squares for identification: solver, estimates, and tests of residuals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.fields import quantities
from armcontour.core.render import Result, number_range
from armcontour.core.result import Data, Row
from armcontour.core.sampled_data import white_noise
from armcontour.motion.log import Log
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import MOVING_SHARE

# Spacing of the samples from which velocities and accelerations are computed [s].
SAMPLE_SPACING = 8e-3
# Logs whose frequency is at most this multiple of that of the slowest log are slow, as programs are
# compared with multisines.
SLOW_RATIO = 3.0
# Lower bound of a velocity that is used as a divisor [rad/s].
LEAST_VELOCITY = 1e-9
# The correlation length is the sum of the autocorrelations before the first one below this value.
LEAST_CORRELATION = 0.05
# Significance level of the whiteness test.
SIGNIFICANCE = 0.01
# Smallest number of spectral lines of the low band of the whiteness test.
FEWEST_LINES = 8
# Differences of positions up to this fraction of the range of the positions are rounding errors.
POSITION_ROUNDING = 1e-9
# Largest relative deviation of a difference of positions from a multiple of the encoder's
# resolution.
STEP_ROUNDING = 0.01
# Residuals are quantized white noise if their variance in excess of the white noise exceeds the
# variance of quantization by at most this fraction.
VARIANCE_SLACK = 0.2
# Largest standard deviation of a determined parameter, relative to its value.
RELATIVE_SD = 0.10
# The data do not determine the parameters along an eigenvector of the Gram matrix whose eigenvalue
# is below this fraction of the largest eigenvalue.
DEPENDENT = 1e-14
PARAMETERS = (
    *("kp", "kv", "ki", "velocity_feedforward", "acceleration_feedforward"),
    *("dead_time", "friction", "acceleration_limit"),
)
UNITS = {name: quantities(ServoModel)[name].words for name in PARAMETERS}
# Lower and upper end of an interval, each as its difference from the value.
Ends = tuple[float, float]
# Parameters that are fitted as logarithms.
LOGARITHMIC = ("kp", "kv", "ki", "acceleration_limit")


class FastestMotion(NamedTuple):
    """Largest rates of the commands of logs, (dof,) each."""

    velocity: FloatArray  # Largest velocity of all logs [rad/s]
    acceleration: FloatArray  # Largest acceleration of all logs [rad/s²]
    # Smallest ratio of the largest acceleration to the largest velocity of a log [1/s]. A joint
    # that hardly moves in a log does not count there.
    frequency: FloatArray
    of_logs: FloatArray  # Smallest of these ratios in each log [1/s], (logs,)

    @property
    def slow_logs(self) -> BoolArray:
        """Mask of the logs that reverse about as slowly as the slowest log, (logs,)."""
        return np.asarray(self.of_logs <= SLOW_RATIO * self.of_logs.min())


def fastest_motion(logs: Sequence[Log]) -> FastestMotion:
    """Largest velocities, accelerations and smallest frequencies of the commands of logs."""
    velocities = []
    accelerations = []
    for log in logs:
        some = slice(None, None, max(round(SAMPLE_SPACING / log.interval), 1))
        rates = np.gradient(log.command[some], log.t[some], axis=0)
        changes = np.gradient(rates, log.t[some], axis=0)
        velocities.append(np.abs(rates).max(axis=0))
        accelerations.append(np.abs(changes).max(axis=0))
    velocity = np.array(velocities)
    acceleration = np.array(accelerations)
    frequency = acceleration / np.maximum(velocity, LEAST_VELOCITY)
    # Every joint counts in the log in which it is fastest.
    least = np.minimum(MOVING_SHARE * velocity.max(axis=1, keepdims=True), velocity.max(axis=0))
    frequency[velocity < least] = np.inf
    return FastestMotion(
        velocity.max(axis=0), acceleration.max(axis=0), frequency.min(axis=0), frequency.min(axis=1)
    )


def is_white(residuals: FloatArray, step: float) -> bool:
    """Return whether residuals [rad], (n,), are white up to quantization by `step` [rad]."""
    # F-tests compare the mean power of the lowest 8, 16, ... spectral lines with that of the rest.
    from scipy.stats import f

    # True if quantization explains the variance in excess of the white noise.
    if np.var(residuals) - white_noise(residuals) ** 2 <= (1 + VARIANCE_SLACK) * step**2 / 12:
        return True
    power = np.abs(np.fft.rfft(residuals - np.mean(residuals))[1:]) ** 2
    n = len(power)
    chances: list[float] = []
    while (m := FEWEST_LINES << len(chances)) <= n / 2:
        ratio = np.mean(power[:m]) / max(float(np.mean(power[m:])), 1e-300)
        chances.append(float(f.sf(ratio, 2 * m, 2 * (n - m))))
    return not chances or min(chances) * len(chances) > SIGNIFICANCE


def encoder_resolution(y: FloatArray) -> float:
    """Resolution of an encoder [rad]: common divisor of all position differences, 0 if none."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > POSITION_ROUNDING * max(float(np.ptp(y)), 1e-12)]
    if len(steps) < 2:
        return 0.0
    step = float(np.min(steps))
    differences = np.abs(steps / step - np.rint(steps / step))
    return step if np.all(differences < STEP_ROUNDING * np.maximum(steps / step, 1.0)) else 0.0


def correlation_length(residuals: FloatArray) -> float:
    """Correlation length of residuals [samples], at least 1 (white noise)."""
    n = len(residuals)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlations = np.fft.irfft(power)[: max(n // 5, 1)]
    if correlations[0] <= 0:
        return 1.0
    correlations = correlations / correlations[0]
    below = np.flatnonzero(correlations < LEAST_CORRELATION)
    end = int(below[0]) if len(below) else len(correlations)
    return float(max(1.0, 1 + 2 * np.sum(correlations[1:end])))


def allowed_deviation(value: Any, also: Any = 0.0) -> Any:
    """Largest standard deviation of a determined parameter: share of its value, at least `also`."""
    return np.maximum(RELATIVE_SD * np.abs(value), also)


def normalize(columns: FloatArray, shortest: float = 1e-150) -> tuple[FloatArray, FloatArray]:
    """Columns scaled to unit norm, 0 if their norm is at most `shortest`, and the divisors."""
    norms = np.maximum(np.sqrt(np.einsum("ki,ki->i", columns, columns)), shortest)
    return columns / norms * (norms > shortest), norms


def invert(square: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Pseudo-inverse of a Gram matrix of normalized columns, and the mask of dependent columns."""
    values, vectors = np.linalg.eigh(square)
    good = values > DEPENDENT * values.max(initial=0.0)
    inverse = vectors[:, good] / values[good] @ vectors[:, good].T
    return inverse, np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-6


def solve(
    residuals: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    evaluations: int,
    near: float = 1e-9,
) -> Any:
    """Solve a bounded least-squares problem by `scipy.optimize.least_squares`.

    slopes(x): residuals and their derivatives. An orthogonal transformation reduces the residuals
    to their norm and zeros, so that the solver does not decompose long matrices, which is slow with
    several BLAS threads. Residuals may be nan. The search ends when an iteration reduces the sum of
    squares by less than the fraction `near`.
    """
    from scipy.optimize import least_squares

    def size(x: FloatArray) -> FloatArray:
        return np.append(np.sqrt(np.sum(residuals(x) ** 2)), np.zeros(len(x)))

    def triangle(x: FloatArray) -> FloatArray:
        columns, norms = normalize(np.column_stack(slopes(x)))
        values, vectors = np.linalg.eigh(np.einsum("ki,kj->ij", columns, columns))
        upper = np.linalg.qr(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)[1]
        return np.asarray(upper[:, 1:] * norms[1:] * np.copysign(1.0, upper[0, 0]))

    # Unknowns without an effect cause overflow in the step computation of the solver.
    with np.errstate(over="ignore"):
        return least_squares(
            size, start, triangle, bounds=bounds, x_scale="jac", max_nfev=evaluations,
            ftol=near, xtol=1e-10, gtol=1e-12,
        )  # fmt: skip


def standard_deviations(jacobian: FloatArray, variance: float, free: BoolArray) -> FloatArray:
    """Standard deviations of the free unknowns, 0 for the others, (unknowns,).

    - `jacobian`: derivatives of the residuals, (samples, unknowns).
    - `variance`: variance of residuals.
    """
    columns, sizes = normalize(jacobian[:, free])
    inverse, dependent = invert(np.einsum("ki,kj->ij", columns, columns))
    variances = np.where(dependent, math.inf, variance * np.diag(inverse))
    deviations = np.zeros(len(free))
    deviations[free] = np.sqrt(np.maximum(variances, 0.0)) / sizes
    return deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(Result):
    """The estimate of one parameter.

    Args:
        name: Name of the parameter.
        unit: Unit of the value.
        value: The value; nan if the model does not have the parameter.
        sd: Standard deviation; nan for a parameter at the bound of its range, or with its nominal
            value.
        low, high: Ends of the 95 % interval; nan without one, as for `sd`, and for a parameter that
            compensates for an effect that dominates the residuals.
        determined: True if the logs determine the parameter: `sd` is at most 10 % of the value, at
            most 0.5 ms for a dead time, or at most 0.05 for feed-forward.
    """

    name: str
    unit: str
    value: float
    sd: float = math.nan
    low: float = -math.inf
    high: float = math.inf
    determined: bool = False

    @classmethod
    def from_interval(
        cls, name: str, value: float, sd: float, ends: Ends, also: float = 0.0, **others: Any
    ) -> Estimate:
        """Estimate with the interval `ends` relative to the value (logarithms for LOGARITHMIC).

        A parameter with a standard deviation of at most `also` is determined, however small its
        value.
        """
        if name in LOGARITHMIC:
            low, high = (value * math.exp(x) for x in np.clip(ends, -700.0, 700.0))
            sd *= value
        else:
            low, high = value + ends[0], value + ends[1]
        if not math.isfinite(sd):
            low = high = math.nan
        sure = bool(sd <= allowed_deviation(value, also))
        fields: dict[str, Any] = {"unit": UNITS[name], "determined": sure, **others}
        return cls(name=name, value=value, sd=sd, low=low, high=high, **fields)

    def including(self, other: float) -> Estimate:
        """The estimate with an interval that also contains the interval of another solution.

        The interval about the value `other` is as wide as that about this value, relative to it for
        LOGARITHMIC.
        """
        if not (math.isfinite(self.low) and math.isfinite(other)):
            return self
        shift = other - self.value
        low = self.low + shift
        high = self.high + shift
        if self.name in LOGARITHMIC:
            low = self.low * other / self.value
            high = self.high * other / self.value
        within = self.low <= other <= self.high
        return replace(
            self,
            low=min(self.low, max(low, 0.0)),
            high=max(self.high, high),
            determined=self.determined and within,
        )

    def without_interval(self) -> Estimate:
        """The estimate without its interval, because an effect that is not modelled biases it."""
        return replace(self, low=math.nan, high=math.nan)

    @property
    def label(self) -> str:
        """Name of the parameter in texts, with spaces instead of underscores."""
        return self.name.replace("_", " ")

    def to_data(self) -> Data:
        """Data of the value, the standard deviation and the interval."""
        ends = (("value", "value"), ("sd", "sd"), ("low", "from"), ("high", "to"))
        return Data(
            f"Estimate of {self.label}",
            (
                Row("name", self.name, "", "parameter"),
                Row("unit", self.unit),
                *(Row(x, getattr(self, x), self.unit, label) for x, label in ends),
                Row("determined", self.determined, "", "determined"),
            ),
        )

    @property
    def row(self) -> Row:
        """Row of a table with the value and its 95 % interval; "open" if it is not determined."""
        ends = self.low, self.high
        note = f"({number_range(ends, self.unit)})" if np.isfinite(ends).all() else ""
        if not (self.determined or math.isnan(self.value)):
            note = f"{note} open".strip()
        return Row(self.name, self.value, self.unit, self.label, note)
