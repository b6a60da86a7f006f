"""Public function `compensate`: set-points for a realizable trajectory."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt

from armcontour.control.compensation.set_points import SETTLING, set_point_times
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Options, checked
from armcontour.core.quantities import About
from armcontour.motion import DEFAULT_CYCLE, LONGEST_CLOCK, SetPoints, Trajectory, check_cycle
from armcontour.motion.set_point_check import check_set_points, describe_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel

# Relative tolerance for rounding errors of durations, which are sums.
SAME = 1e-9


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompensationOptions(Options):
    """Options that all methods of `compensate` have: the base of the options of each method.

    Args:
        command_limits: Limits of the set-points themselves, as controllers check them by
            differences over the cycle: joint_velocity [rad/s], joint_acceleration
            [rad/s²], joint_jerk [rad/s³], joint_lower and joint_upper [rad], each one value or one
            per joint. Set-points of a joint that exceeds one are the nearest ones within them (mean
            square), at rest at both ends of the plan; they begin earlier and end later by up to
            1 s. `SetPoints.limit_cost` is the error that this causes.
    """

    method: ClassVar[str]
    command_limits: Limits | None = None

    @property
    def specific(self) -> dict[str, Any]:
        """The specified options that only this method has, without arms, by name."""
        names = ("poles", "gravity_feedforward")
        return {x: getattr(self, x) for x in names if getattr(self, x, None) is not None}


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inverse(CompensationOptions):
    """The exact inverse of the unsaturated servo; options are those of `CompensationOptions`.

    It inverts the mean of the trajectory over a cycle about each set-point. If accelerations jump,
    the servo commands accelerations about 1 % above those of the plan. The first set-point, one
    cycle before time 0, is the start of the plan.

    >>> ac.compensate(planned, servo, ac.Inverse()).method
    'inverse'
    """

    method = "inverse"


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PolePlacement(CompensationOptions):
    """The paper's compensator (26), for servos of order "second"; also `CompensationOptions`.

    >>> slow = ac.plan(path, arm, limits.replace(speed=0.02))
    >>> ac.compensate(slow, servo, ac.PolePlacement()).method
    'pole_placement'

    Args:
        poles: Two regulator poles and the observer pole [1/s], (3,), or three per joint, (dof, 3);
            by default all joints lag as the one with the smallest K_v.
    """

    method = "pole_placement"
    poles: Annotated[npt.ArrayLike | None, About()] = None


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InverseDynamics(CompensationOptions):
    """The inverse of drives that move the arm's rigid bodies; also `CompensationOptions`.

    It is most accurate for plans with limits of jerk. Its first and last set-points hold the arm at
    both ends of the plan. It requires an arm with masses, and a servo of order "second".

    >>> options = ac.InverseDynamics(gravity_feedforward=True)
    >>> options.method
    'inverse_dynamics'

    Args:
        gravity_feedforward: True if the controller adds the gravity torque; by default True, in
            a job the value of its experiment.
        controller: The arm model of the controller, for example without a payload that was
            identified later; by default the nominal arm.
    """

    method = "inverse_dynamics"
    gravity_feedforward: Annotated[bool | None, About()] = None
    controller: Arm | None = None


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoCompensation(CompensationOptions):
    """The trajectory itself, without time advance; options are those of `CompensationOptions`.

    >>> sent = ac.compensate(planned, servo, ac.NoCompensation())
    >>> bool(np.allclose(sent.q[-1], planned(planned.duration)))
    True
    """

    method = "none"


INVERSE = Inverse()
# Options by the names of their methods.
METHODS: dict[str, type[CompensationOptions]] = {
    x.method: x for x in (Inverse, PolePlacement, InverseDynamics, NoCompensation)
}


@checked
def compensate(
    trajectory: Trajectory,
    servo: ServoModel,
    options: CompensationOptions = INVERSE,
    *,
    cycle: float = DEFAULT_CYCLE,
    arm: Arm | None = None,
    limits: Limits | None = None,
) -> SetPoints:
    """Compute set-points with which the servos follow a trajectory.

    Set-points have a time advance of the servo's dead time, plus half a cycle for
    interpolation "step". They then start before time 0, at the start of the plan.

    After the plan, set-points have a transient: with velocity feed-forward f its time constant is
    `f / kp`, with an integrator `1 / ki`. It is truncated after 1 s or 20 % of the motion:
    set-points then fade to the end of the plan, and `SetPoints.truncated` bounds the resulting
    joint errors.

    >>> sent = ac.compensate(planned, servo, ac.Inverse(), cycle=4e-3)
    >>> sent.q.shape[1], sent.cycle
    (2, 0.004)

    Args:
        trajectory: Trajectory that the joints should follow.
        servo: Servo model whose delay is compensated.
        options: The method and its options: `Inverse`, `PolePlacement`, `InverseDynamics` or
            `NoCompensation`.
        cycle: Cycle [s].
        arm: The nominal arm whose bodies the drives move, for `InverseDynamics`; other methods do
            not use it.
        limits: Limits of the controller, instead of those of the plan: set-points must be within
            joint_lower and joint_upper, and must not move faster than joint_velocity. Without
            `limits`, a warning is given if set-points exceed the command limits or the limits of
            the plan.

    Raises:
        InvalidInput: An argument has the wrong type, gains do not fit the joints or the interval,
            the interval is longer than the motion, the set-points are too many, `InverseDynamics`
            has no arm with masses, or it or `PolePlacement` has a servo with joints of another
            order than "second", an integrator, friction or a cycle.
        CompensationError: Poles are not stable, set-points exceed the given limits, or the plan
            exceeds velocity or acceleration of the command limits by more than 1 %.

    Warns:
        UserWarning: No limits are given, and set-points exceed those of the plan; or compensation
            with this servo may be worse than none (`ServoModel.doubt`).
    """
    set_points = unchecked_set_points(trajectory, servo, options, cycle=cycle, arm=arm)
    if limits is not None:
        check_set_points(set_points, limits)
    elif excess := describe_excess(set_points):
        warnings.warn(excess, stacklevel=3)
    if not isinstance(options, NoCompensation) and servo.doubt:
        warnings.warn(servo.doubt, stacklevel=3)
    return set_points


def unchecked_set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    options: CompensationOptions,
    *,
    cycle: float,
    arm: Arm | None,
) -> SetPoints:
    """Set-points as of `compensate`, without a check of limits."""
    interval = check_cycle(cycle)
    model, duration = servo.for_joints(trajectory.dof), trajectory.duration
    if interval > max(duration * (1 + SAME), LONGEST_CLOCK):
        raise InvalidInput(
            f"The cycle of {interval:g} s is longer than the motion of {duration:.6g} "
            f"s, so that no set-point lies within it; it is in seconds: for {interval:g} ms give "
            f"{interval / 1e3:g}, in a job `cycle: {interval:g} ms`.",
            needed=interval,
            allowed=max(duration, LONGEST_CLOCK),
        )
    model.check_gains(interval)
    count = set_point_count(duration, model, interval, options)
    checks.check_count(
        f"{count * interval:.4g} s of motion at a cycle of {interval:g} s",
        count * trajectory.dof,
        "take a longer cycle or a higher speed",
    )
    start, q, truncated = _set_points(trajectory, model, interval, options, arm)
    set_points = SetPoints(
        cycle=interval,
        q=q,
        trajectory=trajectory,
        method=options.method,
        start_time=start,
        truncated=truncated,
    )
    if options.command_limits is None:
        return set_points
    from armcontour.control.compensation.nearest_set_points import within_limits

    return within_limits(set_points, model, options.command_limits, arm)


def _set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    cycle: float,
    options: CompensationOptions,
    arm: Arm | None,
) -> tuple[float, FloatArray, FloatArray | None]:
    """Time of the first set-point [s], set-points, (n, dof) [rad], and `SetPoints.truncated`."""
    if isinstance(options, NoCompensation):
        t = set_point_times(trajectory, cycle).inside
        end = trajectory([trajectory.duration], side="left")
        return 0.0, np.concatenate([trajectory(t), end]), None
    if isinstance(options, PolePlacement):
        from armcontour.control.compensation.pole_placement import pole_placement

        start, q = pole_placement(trajectory, servo, cycle, options.poles)
    elif isinstance(options, InverseDynamics):
        from armcontour.control.compensation.inverse_dynamics import inverse_dynamics

        fed = options.gravity_feedforward is not False
        start, q = inverse_dynamics(trajectory, servo, cycle, arm, fed, options.controller)
    else:
        from armcontour.control.compensation.set_points import inverse

        start, q = inverse(trajectory, servo, cycle)
    if not servo.has_feedforward and not servo.ki.any():
        return start, q, None
    from armcontour.control.compensation.feedforward import for_feedforward

    return start, *for_feedforward(q, cycle, servo, trajectory.duration)


def set_point_count(
    duration: float, servo: ServoModel, cycle: float, options: CompensationOptions
) -> float:
    """Approximate number of set-points of a motion."""
    total = duration
    if not isinstance(options, NoCompensation):
        total += float(servo.dead_time.max()) + cycle
        if servo.has_feedforward or servo.ki.any():
            from armcontour.control.compensation.feedforward import tail_duration

            total += tail_duration(servo, duration)
    if isinstance(options, PolePlacement) and servo.kv is not None:
        from armcontour.control.compensation.pole_placement import check_poles

        slowest = float(servo.kv.min())
        if options.poles is not None:
            slowest = float(np.abs(check_poles(options.poles, len(servo.kv)).real).min())
        total += SETTLING / slowest
    return total / cycle + 1
