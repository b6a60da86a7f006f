"""Executed motion of the joints and of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray, Value
from armcontour._describing import brief, line_up, milliseconds
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.motion.fine_motion import FineMotion
from armcontour.motion.taught import TaughtData

# A plant's motion ends at a result if it is as near to it as this [rad].
SAME = 1e-9
# Times are whole numbers of steps if they are so near to them [steps].
WHOLE = 1e-3


class Between(Protocol):
    """What knows the motion between the results of an execution: a plant."""

    def motion_between(self, executed: Execution, which: IntArray) -> FineMotion | None:
        """The motion from some results to the next ones; None where it is not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution(Value):
    """Motion of the joints of a plant, from the first set-point until rest.

    Args:
        arm: The arm that moved.
        taught: The set-points that the plant executed.
        t: Regular times [s], (n,).
        q, dq, ddq: Joint positions, velocities and accelerations [rad, rad/s, rad/s²], (n, dof).
        demand: Accelerations that the servos demand, before saturation [rad/s²], (n, dof).
        demand_range: Lowest and highest demand at any time, not only at `t` [rad/s²], (2, dof).
        saturated_time: Time in saturation of each joint [s], (dof,).
        torque: Torques of the drives [N m], (n, dof); None from a plant without torques.
        torque_demand: Torques before saturation [N m], (n, dof); None without `torque`.
        motor_q: Positions of the motors, which is what encoders tell [rad], (n, dof), where springs
            are between motors and links; None where they are those of the links, q.
        unsettled: Distances of the joints from the last set-point at the end [rad], (dof,), where
            they are not at rest there; None where they are.
        unexplained: Largest error of each joint that the servo model of the plant does not explain
            [rad], (dof,); None if it is not known.
        plant: What tells the motion between the times `t`, so that `evaluate` finds peaks there;
            None where only the results are known, as those of a log, or of changed arrays.

    Raises:
        InvalidInput: Only one of `torque` and `torque_demand` is given.
    """

    arm: Arm
    taught: TaughtData
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    demand: FloatArray
    demand_range: FloatArray
    saturated_time: FloatArray
    torque: FloatArray | None = None
    torque_demand: FloatArray | None = None
    motor_q: FloatArray | None = None
    unsettled: FloatArray | None = None
    unexplained: FloatArray | None = None
    plant: Between | None = None

    def __post_init__(self) -> None:
        if (self.torque is None) != (self.torque_demand is None):
            raise InvalidInput("An execution has both torque and torque_demand, or neither.")
        for name in ("t", "q", "dq", "ddq", "demand", "demand_range", "saturated_time"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        for name in ("torque", "torque_demand", "motor_q", "unsettled", "unexplained"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    def __str__(self) -> str:
        """How every joint moved: ranges, and largest amounts."""
        t, step = self.t, float(self.t[-1] - self.t[0]) / max(len(self.t) - 1, 1)
        title = (
            f"Execution of {self.arm.name}: t = {t[0]:.4f} to {t[-1]:.4f} s, {len(t)} samples "
            f"every {milliseconds(step)}"
        )
        header = ["joint", "position [rad]", "velocity [rad/s]"]
        header += ["acceleration [rad/s²]", "saturated"]
        amounts = [self.dq, self.ddq]
        if self.torque is not None:
            header.append("torque [N m]")
            amounts.append(self.torque)
        rows = [header]
        for j, name in enumerate(self.arm.joint_names):
            low, high = self.q[:, j].min(), self.q[:, j].max()
            velocity, acceleration, *torque = (f"{np.abs(x[:, j]).max():.4g}" for x in amounts)
            held = milliseconds(float(self.saturated_time[j]))
            reach = f"{low:z.4f} to {high:z.4f}"
            rows.append([name, reach, velocity, acceleration, held, *torque])
        return line_up(title, rows, columns=">")

    __repr__ = brief

    def between(self, which: IntArray) -> FineMotion | None:
        """The motion from some results to the next ones; None where it is not known.

        The plant is believed only where results are as far from each other as it gives them, and
        its motion ends at the next ones: an execution that was cut or changed may have others.

        Args:
            which: Indices of the results before, increasing, (m,).
        """
        if self.plant is None or not self._are_steps(which):
            return None
        found = self.plant.motion_between(self, which)
        if found is None:
            return None
        off = np.abs(found(self.t[which + 1]) - self.q[which + 1])
        return found if off.max(initial=0.0) < SAME else None

    def _are_steps(self, which: IntArray) -> bool:
        """Whether some results and the next ones are at whole steps of the command interval."""
        step = float(self.t[1] - self.t[0])
        if not 0 < step < self.taught.period * (1 + WHOLE):
            return False
        steps = self.taught.period / step
        at = (self.t[np.stack([which, which + 1])] - self.taught.start_time) / step
        whole = at.round()
        return bool(
            abs(steps - round(steps)) < WHOLE
            and (abs(at - whole) < WHOLE).all()
            and (whole[1] - whole[0] == 1).all()
        )

    @property
    def peak_demand(self) -> FloatArray:
        """Largest absolute demand of each joint at any time [rad/s²], (dof,)."""
        return np.asarray(np.abs(self.demand_range).max(axis=0))

    @property
    def tool(self) -> FloatArray:
        """Positions of the tool [m], (n, dimension)."""
        return self.arm.forward(self.q)

    @property
    def tool_speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        return np.asarray(np.linalg.norm(self.arm.tool_velocity(self.q, self.dq), axis=1))

    @property
    def saturated(self) -> BoolArray:
        """Mask of the times at which a joint is saturated, (n, dof)."""
        asked, given = self.demand, self.ddq
        if self.torque is not None and self.torque_demand is not None:
            asked, given = self.torque_demand, self.torque
        return np.asarray(np.abs(asked - given) > 1e-9 * np.abs(asked))
