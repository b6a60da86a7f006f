"""Jerk of samples: lower bounds of the jerk that every motion through the samples must have.

The third divided difference of four positions, times 6, is a mean of the jerk over their time; so
are the second one of three velocities, times 2, the first one of two accelerations, and the one of
positions and velocities at two times, `6 (v0 + v1 - 2 (q1 - q0) / T) / T²`. All weights are
positive. What leaves out a column has more rounding: positions printed with six decimals say
nothing about jerk at 1 ms. So the highest of the numbers as they stand is judged by the highest
derivative that the samples have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.evaluation.sample_windows import Log, Windows, mean_rate, second_rate, third_rate
from armcontour.evaluation.tally import States, Tally


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Column:
    """The highest derivative of joints or tool that samples have.

    Args:
        order: 0 for positions, 1 for velocities, 2 for accelerations.
        values: Its values, (n, columns).
        off: Bound on their error, (n, columns), or on the length of the error, (n, 1).
    """

    order: int
    values: FloatArray
    off: FloatArray

    def jerk(self, log: Log, k: int) -> tuple[int, Windows]:
        """Mean jerks, with the number of samples of their windows, a multiple of k."""
        if self.order == 2:
            return k, mean_rate(log, self.values, self.off, k)
        if self.order == 1 and len(log.t) > 2 * k:
            return 2 * k, second_rate(log, self.values, self.off, k)[2]
        # Too few samples have no third differences either.
        return 3 * k, third_rate(log, self.values, self.off, k)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JerkOfSamples:
    """What samples say about jerk.

    Args:
        joints: The joints, where their jerk is limited; or None.
        tool: The tool, where its jerk is limited; or None.
    """

    joints: _Column | None
    tool: _Column | None

    @classmethod
    def of(cls, log: Log, tally: Tally) -> JerkOfSamples:
        """Take the highest derivatives that samples have, as far as jerk is limited."""
        limits, joints = tally.limits, None
        if limits.joint_jerk is not None:
            given = [(k, x) for k, x in enumerate((log.q, log.dq, log.ddq)) if x is not None]
            order, values = given[-1]
            joints = _Column(order=order, values=values, off=log.errors_of(order))
        return cls(
            joints=joints, tool=None if limits.tool_jerk is None else _tool_column(log, tally)
        )

    def offer(self, log: Log, tally: Tally, k: int) -> float:
        """Offer mean jerks over windows of k, 2 k or 3 k samples.

        Returns:
            Largest share of a limit that rounding may have made.
        """
        limits, slack = tally.limits, 0.0
        if self.joints is not None and limits.joint_jerk is not None:
            width, x = self.joints.jerk(log, k)
            t, q = log.middles(width)
            size = np.abs(x.mean)
            slack = tally.offer("joint_jerk", t, size, limits.joint_jerk, q, x.error)
            if log.dq is not None:
                _offer_both(log, log.dq, tally, limits.joint_jerk, k)
        if self.tool is not None and limits.tool_jerk is not None:
            width, x = self.tool.jerk(log, k)
            t, q = log.middles(width)
            size = np.linalg.norm(x.mean, axis=1)
            off = x.error[:, 0]
            slack = max(slack, tally.offer("tool_jerk", t, size, limits.tool_jerk, q, off))
        return slack


def _tool_column(log: Log, tally: Tally) -> _Column:
    """The highest derivative of the tool point that samples have."""
    if log.dq is None:
        values, off = tally.tool(log.q, log.errors[0])
        return _Column(order=0, values=values, off=off[:, None])
    x = States(t=log.t, q=log.q, dq=log.dq, ddq=log.ddq, errors=log.errors)
    order, arm = 1 if x.ddq is None else 2, tally.arm
    values, off = tally.bounded(x, (arm.tool_velocity, arm.tool_acceleration)[order - 1], order)
    return _Column(order=order, values=values, off=off[:, None])


def _offer_both(log: Log, dq: FloatArray, tally: Tally, limit: FloatArray, k: int) -> None:
    """Offer the mean jerks that follow from positions and velocities at both ends of windows."""
    span, late = log.spans(k)
    total = dq[k:] + dq[:-k]
    rest = np.abs(total * span - 2 * (log.q[k:] - log.q[:-k]))
    off = 4 * log.errors[0] + 2 * log.errors[1] * (span + late) + np.abs(total) * late
    mean = 6 * rest / span**3
    # As numbers of positions are rounded, this says nothing about the motion as it stands.
    narrow, tally.narrow = tally.narrow, False
    error = mean - 6 * (rest - off) / (span + late) ** 3
    t, q = log.middles(k)
    tally.offer("joint_jerk", t, mean, limit, q, error)
    tally.narrow = narrow
