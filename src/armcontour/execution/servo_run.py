"""One run of the servo plant: joint by joint through command intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError
from armcontour.execution._pieces import run_joint
from armcontour.execution._servo import simulate
from armcontour.execution.command import pattern
from armcontour.motion import TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.command import polynomials


class Part(NamedTuple):
    """What happened in some command intervals: at results (n, dof), and over all time (dof,)."""

    q: FloatArray
    dq: FloatArray
    demand: FloatArray
    ddq: FloatArray
    saturated: FloatArray
    peak: FloatArray


class PlainRun:
    """A servo of second order without dead time, whose command is straight between set-points.

    Args:
        taught: The set-points.
        steps: Results per interval.
        servo: With values per joint.
        limit: Acceleration limits either way, (dof,) [rad/s²].
    """

    def __init__(
        self, taught: TaughtData, steps: int, servo: ServoModel, limit: FloatArray
    ) -> None:
        assert servo.kv is not None
        self.taught, self.steps, self.limit = taught, steps, limit
        self.kp, self.kv, self.linear = servo.kp, servo.kv, servo.interpolation == "linear"

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Run from command interval `begin` on."""
        taught = self.taught
        commands = taught.q[begin : begin + count + 1]
        missing = count + 1 - len(commands)
        if missing:
            commands = np.concatenate([commands, np.tile(taught.q[-1], (missing, 1))])
        position, velocity, demand, saturated, peak = simulate(
            np.ascontiguousarray(commands),
            taught.period,
            self.steps,
            self.linear,
            self.kp,
            self.kv,
            self.limit,
            q,
            dq,
        )
        ddq = np.clip(demand, -self.limit, self.limit)
        return Part(position, velocity, demand, ddq, saturated, peak)


class TorqueBounds:
    """What is left of every joint's torque limit for its acceleration.

    Args:
        arm: With masses.
        limit: Torque limits, (dof,) [N m].
        taught: The set-points, for their times.
    """

    def __init__(self, arm: Arm, limit: FloatArray, taught: TaughtData) -> None:
        self.arm, self.limit, self.taught = arm, limit, taught

    def at(self, k: int, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`(-T - b) / M_jj` and `(T - b) / M_jj` at the beginning of interval k [rad/s²].

        Raises:
            ExecutionError: Gravity, friction and the joints' velocities alone take more than T.
        """
        bias = self.arm.torque(q, dq, np.zeros_like(q))
        weak = np.abs(bias) >= self.limit
        if weak.any():
            j = int(np.argmax(weak))
            t = self.taught.start_time + k * self.taught.period
            raise ExecutionError(
                f"Joint {j + 1} takes {abs(bias[j]):.4g} N m at t = {t:.4g} s to keep its velocity "
                f"of {dq[j]:.3g} rad/s, but its drive gives at most {self.limit[j]:.4g} N m: raise "
                "its torque limit, lighten its load, or move slower.",
                t=t,
                joint=j + 1,
                limit="joint_torque",
                needed=float(abs(bias[j])),
                allowed=float(self.limit[j]),
            )
        inertia = np.diagonal(self.arm.dynamics.mass_matrix(q))
        return (-self.limit - bias) / inertia, (self.limit - bias) / inertia


class PiecedRun:
    """Any servo: late, of first order, under a cubic command, or with bounds that change.

    Args:
        taught: The set-points.
        steps: Results per interval.
        servo: With values per joint.
        accelerations: Lower and upper bounds, (dof,) each [rad/s²].
        torque: Where the bounds of every interval come from instead.
    """

    def __init__(
        self,
        taught: TaughtData,
        steps: int,
        servo: ServoModel,
        accelerations: tuple[FloatArray, FloatArray],
        torque: TorqueBounds | None,
    ) -> None:
        self.servo, self.accelerations, self.torque = servo, accelerations, torque
        self.commands = polynomials(taught.q, taught.period, servo.interpolation)
        self.patterns = [pattern(taught.period, steps, x) for x in servo.dead_time.tolist()]

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Run from command interval `begin` on.

        Raises:
            ExecutionError: A drive is too weak.
        """
        if self.torque is None or count == 0:
            return self._run(begin, count, q, dq, self.accelerations)
        parts = []
        for k in range(begin, begin + count):
            parts.append(self._run(k, 1, q, dq, self.torque.at(k, q, dq)))
            q, dq = parts[-1].q[-1], parts[-1].dq[-1]
        position, velocity, demand, ddq = (np.concatenate([x[i] for x in parts]) for i in range(4))
        saturated = np.sum([x.saturated for x in parts], axis=0)
        peak = np.max([x.peak for x in parts], axis=0)
        return Part(position, velocity, demand, ddq, saturated, peak)

    def _run(
        self,
        begin: int,
        count: int,
        q: FloatArray,
        dq: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
    ) -> Part:
        kv = np.zeros_like(self.servo.kp) if self.servo.kv is None else self.servo.kv
        joints = [
            run_joint(
                command,
                begin,
                count,
                parts.width,
                parts.source,
                parts.local,
                parts.result,
                self.servo.kp[j],
                kv[j],
                bounds[0][j],
                bounds[1][j],
                q[j],
                dq[j],
            )
            for j, (command, parts) in enumerate(zip(self.commands, self.patterns, strict=True))
        ]
        states = np.stack([x[0] for x in joints], axis=2)
        position, velocity, demand, ddq = (states[:, i] for i in range(4))
        saturated, peak = (np.array([x[i] for x in joints]) for i in (1, 2))
        return Part(position, velocity, demand, ddq, saturated, peak)
