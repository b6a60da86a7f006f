"""One run of the servo plant: joint by joint through command intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError
from armcontour.execution._pieces import run_joint
from armcontour.execution._servo import simulate
from armcontour.execution.dead_time import pattern
from armcontour.execution.plant import RUNAWAY, refuse_too_heavy
from armcontour.motion import TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.command import polynomials


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


def joined(parts: list[Part]) -> Part:
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


def refuse_endless(part: Part, servo: ServoModel, start: float, span: float) -> None:
    """Refuse a part of a run in which a joint's motion could not be computed to its end.

    Args:
        part: What the compiled functions gave.
        servo: With values per joint.
        start: When the part begins [s].
        span: Time between two results [s].

    Raises:
        ExecutionError: A position that is not finite.
    """
    lost = ~np.isfinite(part.q)
    if lost.any():
        row, j = (int(x) for x in np.argwhere(lost)[0])
        gains = f"kp = {servo.kp[j]:g} 1/s"
        if servo.kv is not None:
            gains += f" and kv = {servo.kv[j]:g} 1/s"
        t = start + row * span
        raise ExecutionError(
            f"The motion of joint {j + 1} cannot be computed from t = {t:.4g} s on: its steps are "
            f"too short or its numbers too large, with {gains}; take gains nearer to each other "
            "and to those of a robot.",
            t=t,
            joint=j + 1,
        )


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
        self.taught, self.steps, self.servo, self.limit = taught, steps, servo, limit
        self.kp, self.kv, self.linear = servo.kp, servo.kv, servo.interpolation == "linear"

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Run from command interval `begin` on.

        Raises:
            ExecutionError: A joint's motion comes to no end.
        """
        taught = self.taught
        commands = taught.q[begin : begin + count + 1]
        missing = count + 1 - len(commands)
        if missing:
            commands = np.concatenate([commands, np.tile(taught.q[-1], (missing, 1))])
        position, velocity, demand, saturated, extremes = simulate(
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
        part = Part(position, velocity, demand, ddq, saturated, extremes)
        start = taught.start_time + begin * taught.period
        refuse_endless(part, self.servo, start, taught.period / self.steps)
        return part


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
        self.taught, self.steps = taught, steps
        self.commands = polynomials(taught.q, taught.period, servo.interpolation)
        self.patterns = [pattern(taught.period, steps, x) for x in servo.dead_time.tolist()]

    def advance(self, begin: int, count: int, q: FloatArray, dq: FloatArray) -> Part:
        """Run from command interval `begin` on.

        Raises:
            ExecutionError: A joint runs away, or its motion comes to no end.
        """
        if self.torque is None or count == 0:
            return self._run(begin, count, q, dq, self.accelerations)
        parts = []
        for k in range(begin, begin + count):
            parts.append(self._run(k, 1, q, dq, self.torque.at(k, q, dq)))
            q, dq = parts[-1].q[-1], parts[-1].dq[-1]
        return joined(parts)

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
        saturated = np.array([x[1] for x in joints])
        extremes = np.array([x[2:] for x in joints]).T
        part = Part(position, velocity, demand, ddq, saturated, extremes)
        start = self.taught.start_time + begin * self.taught.period
        refuse_endless(part, self.servo, start, self.taught.period / self.steps)
        return part
