"""The timing methods by name, and how each of them times contours and rapids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from armcontour.arms import Arm, Limits
from armcontour.errors import NotRealizable
from armcontour.motion import JointPath, Law, Method, Trajectory, smooth
from armcontour.timing.conventional import plan_conventional
from armcontour.timing.mac import plan_mac
from armcontour.timing.optimal import plan_optimal

# Methods that time a path as it is given.
METHODS = (Method.OPTIMAL.value, Method.MAC.value, Method.CONVENTIONAL.value)
PLANNING_METHODS = (*METHODS, Method.SHAPED.value)
SHAPE_OPTIONS = ("tolerance", "line_tolerance", "zone", "angular_tolerance", "iterations")
OPTIONS = {
    "optimal": ("intervals", "grid", "start_speed", "end_speed", "constraints", "iterations"),
    "mac": ("knots", "period"),
    "conventional": (),
    "shaped": (*SHAPE_OPTIONS, "intervals"),
}
# Grid intervals of a rapid: limits change little along a straight line of the joints or the tool.
RAPID_INTERVALS = 200


class MoveTiming(Protocol):
    """Times the moves of a program one after the other, given the laws before each move."""

    @property
    def arm(self) -> Arm:
        """The arm that moves."""

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan the motion along a contour, given the laws before it."""

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan a rapid, given the laws before it."""

    def pause(self, before: Sequence[Law]) -> float:
        """Time that the joints stand still between the laws so far and the next contour [s]."""


@dataclass(frozen=True, slots=True)
class Timing:
    """A timing method with its options, which plans each move independently of the others.

    Args:
        arm: The arm.
        limits: The limits that the plan keeps, less the reserve for the servo.
        method: One of METHODS.
        options: Options of the method.
    """

    arm: Arm
    limits: Limits
    method: str
    options: Mapping[str, Any]

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan the motion along a contour by the method; the laws before it do not matter."""
        if self.method in (Method.OPTIMAL, Method.SHAPED):
            own = SHAPE_OPTIONS if self.method == Method.SHAPED else ()
            options = {x: y for x, y in self.options.items() if x not in own}
            found = plan_optimal(joint_path, self.arm, self.limits, **options)
            return found if found.method == self.method else replace(found, method=Method.SHAPED)
        if self.method == Method.MAC:
            return plan_mac(joint_path, self.arm, self.limits, **self.options)
        return plan_conventional(joint_path, self.arm, self.limits)

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan a rapid; the laws before it do not matter."""
        return plan_rapid(joint_path, self.arm, self.limits)

    def pause(self, before: Sequence[Law]) -> float:
        """Zero [s]: a contour starts as soon as the rapid before it has ended."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Times moves as another timing does, and smooths each motion between two rests.

    Args:
        timing: The other timing.
        windows: Windows of the moving averages, as in `smooth` [s].
    """

    timing: MoveTiming
    windows: tuple[float, ...]

    @property
    def arm(self) -> Arm:
        """The arm that moves."""
        return self.timing.arm

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan the motion along a contour and smooth it."""
        return smooth(self.timing.contour(joint_path, before), *self.windows)

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """Plan a rapid and smooth it."""
        return smooth(self.timing.rapid(joint_path, before), *self.windows)

    def pause(self, before: Sequence[Law]) -> float:
        """The pause of the other timing [s]."""
        return self.timing.pause(before)


def plan_rapid(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """Plan the fastest rapid, which keeps the limits of the joints and ignores those of the tool.

    Args:
        joint_path: The joint path of the rapid.
        arm: The arm.
        limits: Limits of the arm, one value per joint.
    """
    return plan_optimal(joint_path, arm, limits.of_joints, intervals=RAPID_INTERVALS)


def refuse_unkept_jerk(method: str, limits: Limits) -> None:
    """Refuse limits of jerk for the methods that keep none.

    Args:
        method: One of PLANNING_METHODS.
        limits: The limits.

    Raises:
        NotRealizable: There are limits of jerk, and the method keeps none.
    """
    given = limits.jerk_limits
    if not given or method == Method.OPTIMAL:
        return
    names = " and ".join(given)
    lift = (
        f"lift {names} with limits.replace({', '.join(f'{x}=None' for x in given)}) (in a job, "
        f"limits: {{{', '.join(f'{x}: null' for x in given)}}})"
    )
    if method == Method.SHAPED:
        raise NotRealizable(
            f"Along a shaped path accelerations jump, at places where {names} would stop the tool: "
            'round corners with continuity="curvature" and plan by the method optimal (in a job, '
            f"corners: {{shape: arc}}, which has it where jerk is limited), or {lift}.",
            limit=given[0],
        )
    raise NotRealizable(
        f"The method {method} keeps no limits of jerk, but there is {names}: plan by the method "
        f"optimal (in a job, timing: {{method: optimal}}), or {lift}.",
        limit=given[0],
    )
