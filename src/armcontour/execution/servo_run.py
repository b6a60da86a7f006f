"""One run of the servo plant: joint by joint through command intervals."""

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
    """What happened in some command intervals: at results (n, dof), and over all time.

    Time in saturation is (dof,), the demand's lowest and highest value (2, dof).
    """

    q: FloatArray
    dq: FloatArray
    demand: FloatArray
    ddq: FloatArray
    saturated: FloatArray
    demand_range: FloatArray


def join_parts(parts: list[Part]) -> Part:
    """What happened in parts that follow each other."""
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
    """What is left of every joint's torque limit for its acceleration.

    Args:
        arm: With masses.
        limit: Torque limits, (dof,) [N m].
        taught: The set-points.

    Raises:
        ExecutionError: Gravity alone takes more at the first or the last set-point.
    """

    def __init__(self, arm: Arm, limit: FloatArray, taught: TaughtData) -> None:
        self.arm, self.limit, self.taught = arm, limit, taught
        for which, k in (("first", 0), ("last", -1)):
            q, still = taught.q[k], np.zeros(arm.dof)
            weight = np.abs(arm.torque(q, still, still))
            refuse_too_heavy(weight, limit, f"the {which} set-point", float(taught.t[k]))

    def at(self, k: int, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`(-T - b) / M_jj` and `(T - b) / M_jj` at the beginning of interval k [rad/s²].

        Where b alone exceeds T both have one sign: the joint brakes, or it falls.

        Raises:
            ExecutionError: A joint that falls faster than any arm moves.
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
    """The servos of all joints, with bounds that may change from interval to interval.

    Args:
        taught: The set-points.
        steps: Results per interval.
        servo: With values per joint.
        accelerations: Lower and upper bounds, (dof,) each [rad/s²].
        torque: Where the bounds of every interval come from instead.

    Raises:
        ExecutionError: Gains that are too large to simulate.
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

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Run from command interval `begin` on.

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
        run = self.simulation.run(begin, begin + count, q, dq, bounds)
        position, velocity, demand = (run.states[:, :, i].T.copy() for i in range(3))
        ddq = np.clip(demand, *bounds)
        extremes = np.stack([run.lowest, run.highest])
        return Part(position, velocity, demand, ddq, run.saturated, extremes)
