"""One run of the servo plant: the simulation of all joints over command intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError
from armcontour.execution.plant import RUNAWAY, refuse_too_heavy
from armcontour.motion import TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.simulation import Simulation


class Part(NamedTuple):
    """The motion of all joints over some command intervals.

    Attributes:
        q, dq: Positions [rad] and velocities [rad/s] at the results, (n, dof).
        demand: Demanded accelerations [rad/s²], (n, dof).
        ddq: Accelerations after saturation [rad/s²], (n, dof).
        saturated: Time in saturation [s], (dof,).
        demand_range: Lowest and highest demand, also between the results [rad/s²], (2, dof).
    """

    q: FloatArray
    dq: FloatArray
    demand: FloatArray
    ddq: FloatArray
    saturated: FloatArray
    demand_range: FloatArray


def join_parts(parts: list[Part]) -> Part:
    """The motion over consecutive parts."""
    ends = np.concatenate([x.demand_range for x in parts])
    q, dq, demand, ddq = (np.concatenate([x[i] for x in parts]) for i in range(4))
    return Part(
        q,
        dq,
        demand,
        ddq,
        saturated=np.sum([x.saturated for x in parts], axis=0),
        demand_range=np.stack([ends.min(axis=0), ends.max(axis=0)]),
    )


class TorqueBounds:
    """Acceleration bounds of the joints that follow from torque limits.

    Args:
        arm: An arm with masses.
        limit: Torque limits, (dof,) [N m].
        taught: The set-points.

    Raises:
        ExecutionError: Gravity alone exceeds a limit at the first or the last set-point.
    """

    def __init__(self, arm: Arm, limit: FloatArray, taught: TaughtData) -> None:
        self.arm, self.limit, self.taught = arm, limit, taught
        for which, k in (("first", 0), ("last", -1)):
            q, still = taught.q[k], np.zeros(arm.dof)
            weight = np.abs(arm.torque(q, still, still))
            refuse_too_heavy(weight, limit, f"the {which} set-point", float(taught.t[k]))

    def at(self, k: int, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Acceleration bounds `(-T - b) / M_jj` and `(T - b) / M_jj` in interval k [rad/s²].

        If b alone exceeds T, both bounds have the same sign: the joint brakes or falls.

        Args:
            k: Index of the command interval.
            q: Joint positions at the start of the interval [rad], (dof,).
            dq: Joint velocities at the start of the interval [rad/s], (dof,).

        Raises:
            ExecutionError: A joint is faster than `RUNAWAY`.
        """
        fast = ~(np.abs(dq) < RUNAWAY)
        if fast.any():
            j = int(np.argmax(fast))
            t = self.taught.start_time + k * self.taught.period
            raise ExecutionError(
                f"Joint {j + 1} runs away at t = {t:.4g} s, at {abs(dq[j]):.3g} rad/s: its drive "
                f"gives at most {self.limit[j]:.4g} N m; raise its torque limit or lighten its "
                "load.",
                t=t,
                joint=j + 1,
            )
        bias = self.arm.torque(q, dq, np.zeros_like(q))
        inertia = np.diagonal(self.arm.dynamics.mass_matrix(q))
        return (-self.limit - bias) / inertia, (self.limit - bias) / inertia


class ServoRun:
    """The servos of all joints, with acceleration bounds that may change in every interval.

    Args:
        taught: The set-points.
        steps: Number of results per command interval.
        servo: A servo with values per joint.
        accelerations: Lower and upper bounds, (dof,) each [rad/s²].
        torque: Torque limits that give the bounds of each interval instead, if any.

    Raises:
        ExecutionError: The gains are too large to simulate.
    """

    def __init__(
        self,
        taught: TaughtData,
        steps: int,
        servo: ServoModel,
        accelerations: tuple[FloatArray, FloatArray],
        torque: TorqueBounds | None,
    ) -> None:
        # Copies that can be written to: for locked ones the kernels would be compiled once more.
        lower, upper = (np.array(x) for x in accelerations)
        self.bounds, self.torque = (lower, upper), torque
        self.simulation = Simulation(taught.q, taught.period, servo, *accelerations, steps=steps)
        self.held: FloatArray | None = None

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Simulate some command intervals.

        Args:
            begin: Index of the first interval.
            count: Number of intervals.
            q: Joint positions at the start [rad], (dof,).
            dq: Joint velocities at the start [rad/s], (dof,).

        Raises:
            ExecutionError: A joint runs away, or its motion cannot be computed.
        """
        if self.torque is None or count == 0:
            return self._run(begin, count, q, dq, self.bounds)
        parts = []
        for k in range(begin, begin + count):
            parts.append(self._run(k, 1, q, dq, self.torque.at(k, q, dq)))
            q, dq = parts[-1].q[-1], parts[-1].dq[-1]
        return join_parts(parts)

    def _run(
        self,
        begin: int,
        count: int,
        q: FloatArray,
        dq: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
    ) -> Part:
        """Simulate some command intervals with constant acceleration bounds."""
        run = self.simulation.run(begin, begin + count, q, dq, bounds, self.held)
        self.held = run.held
        position, velocity, demand = (run.states[:, :, i].T.copy() for i in range(3))
        ddq = np.clip(demand, *bounds)
        extremes = np.stack([run.lowest, run.highest])
        return Part(position, velocity, demand, ddq, run.saturated, extremes)
