"""The timing methods by their names, with what all contours and rapids of a plan share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from armcontour.arms import Arm, Limits
from armcontour.arms.limits import TOOL_LIMITS
from armcontour.motion import JointPath, Law, Method, Trajectory
from armcontour.timing.conventional import plan_conventional
from armcontour.timing.mac import plan_mac
from armcontour.timing.optimal import plan_optimal

METHODS = tuple(x.value for x in Method)
OPTIONS = {
    "optimal": ("intervals", "grid", "start_speed", "end_speed", "constraints"),
    "mac": ("knots", "period"),
    "conventional": (),
}
# A rapid's grid: its limits change little along a straight line of the joints or of the tool.
RAPID_INTERVALS = 200


class MoveTiming(Protocol):
    """What times the moves of a program one after the other, knowing the laws before each."""

    @property
    def arm(self) -> Arm:
        """The arm that moves."""

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """The motion along a contour, after the laws before it."""

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """A free motion, after the laws before it."""

    def pause(self, before: Sequence[Law]) -> float:
        """How long the joints stand still between some laws and the contour after them [s]."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How joint paths are timed.

    Args:
        arm: The arm.
        limits: Those that the plan keeps: what is reserved for the servo is taken off.
        method: One of METHODS.
        options: Options of the method.
        memory: What the program may take [bytes].
    """

    arm: Arm
    limits: Limits
    method: str
    options: Mapping[str, Any]
    memory: float

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """The motion along a contour, by the method; what is before does not matter."""
        if self.method == Method.OPTIMAL:
            return plan_optimal(
                joint_path, self.arm, self.limits, memory=self.memory, **self.options
            )
        if self.method == Method.MAC:
            return plan_mac(joint_path, self.arm, self.limits, **self.options)
        return plan_conventional(joint_path, self.arm, self.limits)

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """A free motion; what is before does not matter."""
        return plan_rapid(joint_path, self.arm, self.limits)

    def pause(self, before: Sequence[Law]) -> float:
        """No time: a contour starts as soon as the rapid before it has ended."""
        return 0.0


def plan_rapid(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """The fastest free motion: the limits of the joints hold, and no limit of the tool.

    Args:
        joint_path: What the joints follow.
        arm: The arm.
        limits: Limits of the arm, one value per joint.
    """
    free = limits.replace(**dict.fromkeys(TOOL_LIMITS, None))
    return plan_optimal(joint_path, arm, free, intervals=RAPID_INTERVALS)
