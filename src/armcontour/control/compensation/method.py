"""`CompensationOptions`: options of a compensation, and what every compensation does."""

from __future__ import annotations

from typing import Annotated, ClassVar

from armcontour.core.checks import FloatArray
from armcontour.core.fields import Options, declared
from armcontour.core.quantities import NO_KEY
from armcontour.motion import Trajectory
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel


@declared(eq=False)
class CompensationOptions(Options):
    """Options of all methods of `compensate`; base of the options of each method.

    Args:
        command_limits: Limits of the set-points, which controllers check by differences over the
            cycle: joint_velocity [rad/s], joint_acceleration [rad/s²], joint_jerk [rad/s³],
            joint_lower and joint_upper [rad], each one value or one per joint. Of these and the
            velocities and ranges of the plan, the smaller count. Without a joint_acceleration, 3
            times that of the plan is assumed; infinity removes it. If set-points of a joint exceed
            a limit, they are replaced by the nearest ones within the limits (least squares), which
            are at rest at both ends of the plan and begin earlier and end later by up to 1 s.
            `SetPoints.limit_cost` is the error that this causes. Methods that do not compensate
            change no set-point.
    """

    method: ClassVar[str]
    # False if the set-points are those of the plan, so that the servo's delay stays
    compensates: ClassVar[bool] = True
    # True if the set-points depend on the masses of the arm, which the servo model lacks
    for_bodies: ClassVar[bool] = False
    # True if a set-point depends on the motion near its time only
    is_local: ClassVar[bool] = False
    command_limits: Annotated[Limits | None, NO_KEY] = None

    @property
    def feeds_gravity_forward(self) -> bool:
        """True if the controller adds the gravity torque."""
        return True

    def set_points(
        self, trajectory: Trajectory, servo: ServoModel, cycle: float, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """Compute set-points for a servo without feed-forward; `compensate` checks the arguments.

        Args:
            trajectory: Trajectory that the joints should follow.
            servo: Servo model with one value per joint.
            cycle: Cycle [s].
            arm: The nominal arm with masses, for methods with `for_bodies`.

        Returns:
            Time of the first set-point [s], and set-points [rad], (n, dof).
        """
        raise NotImplementedError

    def settling(self, servo: ServoModel) -> float:
        """Return the duration of the compensation's own transient after the motion [s].

        Args:
            servo: Servo model with one value per joint.
        """
        return 0.0
