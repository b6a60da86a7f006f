"""Time scaling: the time of a plan over the time of a motion that goes through it more slowly.

A motion q(tau(t)) with a time scaling tau passes the same joint positions as its plan q, so the
tool stays on its path. The derivative dtau/dt is the override, the share of the planned speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.quintics import quintic
from armcontour.motion.laws import Law
from armcontour.motion.trajectory import Trajectory

# Number of coefficients of a piece, which is a polynomial of degree 5.
COEFFICIENTS = 6
# Factors of the powers 0 to 5 in the derivatives of order 0 to 3.
FACTORS = (
    (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    (0.0, 1.0, 2.0, 3.0, 4.0, 5.0),
    (0.0, 0.0, 2.0, 6.0, 12.0, 20.0),
    (0.0, 0.0, 0.0, 6.0, 24.0, 60.0),
)
# Pieces shorter than this are rounding errors [s].
SHORTEST_PIECE = 1e-12
# Number of halvings with which the time of a plan's time is searched in a piece.
HALVINGS = 48


class ScalingState(NamedTuple):
    """The plan's time tau [s], and its rate dtau/dt [-]."""

    tau: float
    rate: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeScaling:
    """Time of a plan, a piecewise polynomial that never decreases; it is constant after its end.

    Args:
        breaks: Times at the ends of the pieces [s], (n + 1,).
        coefficients: Coefficients c of the pieces, (n, 6): the plan's time on piece i is the sum of
            `c[i, k] (t - breaks[i])^k` [s].
    """

    breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def at_rest(cls, tau: float, begin: float, end: float) -> Self:
        """Make a rest at a time of the plan.

        Args:
            tau: Time of the plan [s].
            begin: Time at which the rest begins [s].
            end: Time at which it ends [s].
        """
        coefficients = np.zeros((1, COEFFICIENTS))
        coefficients[0, 0] = tau
        return cls(breaks=np.array([begin, end]), coefficients=coefficients)

    @classmethod
    def hermite(
        cls,
        breaks: FloatArray,
        begin: tuple[FloatArray, FloatArray, FloatArray],
        end: tuple[FloatArray, FloatArray, FloatArray],
    ) -> Self:
        """Make the scaling with given values and derivatives at the ends of its pieces.

        Args:
            breaks: Times at the ends of the pieces [s], (n + 1,).
            begin: The plan's time [s], its first and second derivative at the start of each piece,
                (n,) each.
            end: The same at the end of each piece, (n,) each.
        """
        width = np.diff(breaks)
        first = [x[:, None] for x in begin]
        last = [x[:, None] for x in end]
        coefficients = quintic(width, first, last)[:, :, 0]
        return cls(
            breaks=breaks, coefficients=coefficients / width[:, None] ** np.arange(COEFFICIENTS)
        )

    @property
    def begin(self) -> float:
        """Time at which the first piece begins [s]."""
        return float(self.breaks[0])

    @property
    def end(self) -> float:
        """Time at which the last piece ends [s]."""
        return float(self.breaks[-1])

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> FloatArray:
        """Return the plan's time [s] or a derivative, shaped like `t`.

        Args:
            t: Times [s]; before the first and after the last piece the plan's time is constant.
            order: 0 to 3.
        """
        times = np.asarray(t, dtype=np.float64)
        last = len(self.coefficients) - 1
        i = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, last)
        inside = np.clip(times, self.begin, self.end)
        values = on_piece(self.coefficients[i], inside - self.breaks[i], order)
        if order:
            is_outside = (times < self.begin) | (times > self.end)
            values = np.where(is_outside, 0.0, values)
        return np.asarray(values)

    def state_at(self, t: float) -> ScalingState:
        """Return the plan's time and its rate just before a time [s]."""
        if t <= self.begin or t > self.end:
            return ScalingState(float(self(t)), 0.0)
        i = max(int(np.searchsorted(self.breaks, t, side="left")) - 1, 0)
        elapsed = np.array(t - self.breaks[i])
        return ScalingState(*(float(on_piece(self.coefficients[i], elapsed, k)) for k in range(2)))

    def until(self, t: float) -> TimeScaling:
        """Return the pieces before a time; if they end earlier, a rest follows."""
        if t > self.end:
            return self.followed_by(TimeScaling.at_rest(float(self(self.end)), self.end, t))
        count = max(int(np.searchsorted(self.breaks, t - SHORTEST_PIECE)), 1)
        return TimeScaling(
            breaks=np.append(self.breaks[:count], t), coefficients=self.coefficients[:count]
        )

    def since(self, t: float) -> TimeScaling:
        """Return the pieces after a time, which becomes time 0."""
        first = int(np.searchsorted(self.breaks, t, side="right")) - 1
        first = int(np.clip(first, 0, len(self.coefficients) - 1))
        elapsed = max(t - float(self.breaks[first]), 0.0)
        coefficients = self.coefficients[first:].copy()
        coefficients[0] = _shifted(coefficients[0], elapsed)
        breaks = self.breaks[first:] - t
        breaks[0] = 0.0
        return TimeScaling(breaks=breaks, coefficients=coefficients)

    def followed_by(self, other: TimeScaling) -> TimeScaling:
        """Return this scaling with the pieces of another one, which begins where this one ends."""
        return TimeScaling(
            breaks=np.concatenate([self.breaks, other.breaks[1:]]),
            coefficients=np.concatenate([self.coefficients, other.coefficients]),
        )

    def delayed(self, delay: float) -> TimeScaling:
        """Return a scaling whose first piece begins at time 0 and has the planned speed.

        The pieces of this scaling follow after the time `delay` [s], at which the plan's time is
        `delay` too.
        """
        later = TimeScaling(breaks=self.breaks + delay, coefficients=self.coefficients)
        if not delay:
            return later
        planned = np.zeros((1, COEFFICIENTS))
        planned[0, 1] = 1.0
        return TimeScaling(breaks=np.array([0.0, delay]), coefficients=planned).followed_by(later)

    def times_of(self, tau: FloatArray) -> FloatArray:
        """Return the first times at which the plan's time reaches values [s], shaped like `tau`."""
        if not len(tau):
            return np.empty(0)
        values = np.append(self.coefficients[:, 0], self(self.end))
        i = np.searchsorted(values, tau, side="left") - 1
        piece = np.clip(i, 0, len(self.coefficients) - 1)
        low = np.zeros_like(tau)
        high = np.diff(self.breaks)[piece]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            is_before = on_piece(self.coefficients[piece], middle, 0) < tau
            low = np.where(is_before, middle, low)
            high = np.where(is_before, high, middle)
        reached = np.where(i < 0, self.begin, self.breaks[piece] + high)
        return np.where(i >= len(self.coefficients), self.end, reached)

    def trajectory(self, plan: Trajectory) -> Trajectory:
        """Return the motion through a plan, from time 0, without spans and events.

        It has one law for each law of the plan, because the moves of a program begin and end there.
        """
        # Without spans, this plan has arc lengths that the motion does not have.
        return Trajectory(
            laws=tuple(self._laws(plan)),
            method=plan.method,
            limits=plan.limits,
            reserve=plan.reserve,
            arm=plan.arm,
        )

    def _laws(self, plan: Trajectory) -> Iterator[ScaledLaw]:
        """Yield the laws of the motion through a plan."""
        begin = self.begin
        first = int(np.searchsorted(plan.starts, float(self(begin)), side="right")) - 1
        last = len(plan.laws) - 1
        first = int(np.clip(first, 0, last))
        ends = np.append(self.times_of(plan.starts[first + 1 : -1]), self.end)
        for k, end in enumerate(ends.tolist(), first):
            if end - begin > SHORTEST_PIECE:
                yield ScaledLaw.of_part(plan.laws[k], float(plan.starts[k]), self, begin, end)
                begin = end
            if self.end - begin <= SHORTEST_PIECE:
                return


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaledLaw(Law):
    """A law with a time scaling, q(tau(t)).

    Args:
        law: The law q.
        breaks: Times at the ends of the pieces of tau, from 0 [s], (n + 1,).
        coefficients: Coefficients of tau, on the clock of `law`, as in `TimeScaling`, (n, 6).
    """

    law: Law
    breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def of_part(
        cls, law: Law, start: float, scaling: TimeScaling, begin: float, end: float
    ) -> ScaledLaw:
        """Scale a law that starts at a time of its plan.

        Args:
            law: The law.
            start: Time of the plan at which the law starts [s].
            scaling: Time scaling of the plan.
            begin: Time at which the law begins in the motion [s].
            end: Time at which it ends [s].
        """
        part = scaling.until(end).since(begin)
        coefficients = part.coefficients.copy()
        coefficients[:, 0] -= start
        return cls(law=law, breaks=part.breaks, coefficients=coefficients)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return the joint positions or a derivative, by the chain rule, (n, dof)."""
        return self.motion(i, t, order)[order]

    def motion(self, i: IntArray, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return joint positions and derivatives up to an order, (n, dof) each."""
        elapsed = t - self.breaks[i]
        tau, *rates = (
            on_piece(self.coefficients[i], elapsed, k)[..., None] for k in range(order + 1)
        )
        breaks = self.law.breaks
        inner = np.clip(tau[..., 0], 0.0, breaks[-1])
        j = np.clip(np.searchsorted(breaks, inner, side="right") - 1, 0, len(breaks) - 2)
        planned = self.law.motion(j, inner, order)
        return (planned[0], *_derivatives(planned[1:], rates))


def on_piece(coefficients: FloatArray, elapsed: FloatArray, order: int) -> FloatArray:
    """Return polynomials or a derivative, (n,).

    Args:
        coefficients: Coefficients by increasing power, (n, 6).
        elapsed: Arguments, (n,).
        order: Order of the derivative.
    """
    factors = FACTORS[order]
    value = factors[-1] * coefficients[..., -1]
    for k in range(COEFFICIENTS - 2, order - 1, -1):
        value = value * elapsed + factors[k] * coefficients[..., k]
    return np.asarray(value)


def _derivatives(planned: tuple[FloatArray, ...], rates: list[FloatArray]) -> list[FloatArray]:
    """Return the derivatives of q(tau(t)) by the chain rule, (n, dof) each.

    - `planned`: first derivatives of q, (n, dof) each.
    - `rates`: first derivatives of tau, (n, 1) each.
    """
    derivatives = list[FloatArray]()
    if planned:
        derivatives.append(planned[0] * rates[0])
    if len(planned) > 1:
        derivatives.append(planned[1] * rates[0] ** 2 + planned[0] * rates[1])
    if len(planned) > 2:
        cross = 3 * planned[1] * rates[0] * rates[1]
        derivatives.append(planned[2] * rates[0] ** 3 + cross + planned[0] * rates[2])
    return derivatives


def _shifted(coefficients: FloatArray, by: float) -> FloatArray:
    """Return the coefficients of p(u + by) from those of p(u), (6,)."""
    shifted = coefficients.copy()
    # Horner's scheme, repeated for each coefficient.
    for k in range(COEFFICIENTS - 1):
        for n in range(COEFFICIENTS - 2, k - 1, -1):
            shifted[n] += by * shifted[n + 1]
    return shifted
