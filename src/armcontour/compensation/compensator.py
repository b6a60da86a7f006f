"""Public function `compensate`: taught data for a realizable trajectory."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.compensation.set_points import SETTLING, set_point_times
from armcontour.core.fields import checked
from armcontour.errors import InvalidInput
from armcontour.motion import LONGEST_CLOCK, PERIOD, TaughtData, Trajectory, check_interval
from armcontour.motion.command_limits import describe_excess, refuse_commands
from armcontour.servo import ServoModel

# Durations are sums with rounding errors: an interval that is longer by this share is as long.
SAME = 1e-9
METHODS = ("inverse", "pole_placement", "inverse_dynamics", "none")
OPTIONS = {"pole_placement": ("poles",), "inverse_dynamics": ("gravity_feedforward", "known")}


@checked
def compensate(
    trajectory: Trajectory,
    servo: ServoModel,
    *,
    method: str = "inverse",
    period: float = PERIOD,
    arm: Arm | None = None,
    limits: Limits | None = None,
    command_limits: Limits | None = None,
    poles: npt.ArrayLike | None = None,
    gravity_feedforward: bool | None = None,
    known: Arm | None = None,
) -> TaughtData:
    """Taught data whose set-points make the servos follow a trajectory.

    Set-points have a time advance of the servo's dead time, plus half a command interval for
    interpolation "step". The taught data then starts before time 0, at the start of the plan.

    Velocity feed-forward f leaves a transient of the set-points after the plan, with the time
    constant `f / kp`, and an integrator one with `1 / ki`. After 1 s or 20 % of the motion it is
    cut off: set-points fade to the end of the plan, and `TaughtData.cut_off` bounds the errors of
    the joints after it.

    Args:
        trajectory: Trajectory that the joints should follow.
        servo: Servo model whose delay is compensated.
        method: "inverse" is the exact inverse of the unsaturated servo, for the mean of the
            trajectory over a command interval about each set-point; where accelerations jump, the
            servo demands are about 1 % larger than that. The first set-point, one interval before
            time 0, is the start of the plan. "inverse_dynamics" is the inverse of drives that move
            the bodies of `arm`, best for plans with limits of jerk; its first and last set-points
            hold the arm at both ends of the plan. "pole_placement" is the paper's compensator
            (26). "none" is the trajectory itself, without time advance.
        period: Command interval [s].
        arm: The nominal arm whose bodies the drives move, for "inverse_dynamics"; other methods do
            not use it.
        limits: Limits of the controller, in place of those of the plan: set-points must be within
            joint_lower and joint_upper, and must not move faster than joint_velocity. Set-points
            that exceed those of the command limits or else of the plan, where none are given, are a
            warning.
        command_limits: Limits of the set-points themselves, as controllers check them by
            differences over the command interval: joint_velocity [rad/s], joint_acceleration
            [rad/s²], joint_jerk [rad/s³], joint_lower and joint_upper [rad], each one value or one
            per joint. Set-points of a joint that exceeds one are the nearest ones within them (mean
            square), at rest at both ends of the plan; they begin earlier and end later by up to
            1 s. `TaughtData.limit_cost` is the error that this causes.
        poles: For "pole_placement": two regulator poles and the observer pole [1/s], (3,), or three
            per joint, (dof, 3).
        gravity_feedforward: For "inverse_dynamics": whether the controller adds the gravity torque;
            True by default.
        known: For "inverse_dynamics": the arm as its controller knows it, for example without a
            payload that was found later; by default `arm`.

    Raises:
        InvalidInput: An argument has the wrong type, a method or option is unknown, gains do not
            fit the joints or the interval, the interval is longer than the motion, the set-points
            are too many, "inverse_dynamics" has no arm with masses, or it or "pole_placement" has a
            servo with joints of another order than "second", an integrator, friction or a cycle.
        CompensationError: Poles are not stable, set-points exceed the given limits, or the plan
            exceeds velocity or acceleration of the command limits by more than 1 %.

    Warns:
        UserWarning: No limits are given, and set-points exceed those of the plan; or compensation
            with this servo may be worse than none (`ServoModel.doubt`).
    """
    taught = teach(
        trajectory,
        servo,
        method=method,
        period=period,
        arm=arm,
        command_limits=command_limits,
        poles=poles,
        gravity_feedforward=gravity_feedforward,
        known=known,
    )
    if limits is not None:
        refuse_commands(taught, limits)
    elif excess := describe_excess(taught):
        warnings.warn(excess, stacklevel=3)
    if method != "none" and servo.doubt:
        warnings.warn(servo.doubt, stacklevel=3)
    return taught


def teach(
    trajectory: Trajectory,
    servo: ServoModel,
    *,
    method: str,
    period: float,
    arm: Arm | None,
    command_limits: Limits | None = None,
    **given: Any,
) -> TaughtData:
    """Taught data as of `compensate`, without a check of limits.

    Args:
        trajectory: As in `compensate`, like the others.
        servo: See above.
        method: See above.
        period: See above.
        arm: See above.
        command_limits: See above.
        given: Options of the method, or None.

    Raises:
        ArmContourError: As `compensate`.
    """
    _checks.choice("method", method, METHODS)
    interval = check_interval(period)
    options = {name: x for name, x in given.items() if x is not None}
    takes = OPTIONS.get(method, ())
    if unknown := sorted(set(options) - set(takes)):
        words = f"the option {' or '.join(takes)}" if takes else "no options"
        raise InvalidInput(f"The method {method} takes {words}, not {unknown[0]}.")
    model, duration = servo.for_joints(trajectory.dof), trajectory.duration
    if interval > max(duration * (1 + SAME), LONGEST_CLOCK):
        raise InvalidInput(
            f"The command interval of {interval:g} s is longer than the motion of {duration:.6g} "
            f"s, so that no set-point lies within it; it is in seconds: for {interval:g} ms give "
            f"{interval / 1e3:g}, in a job `command_interval: {interval:g} ms`.",
            needed=interval,
            allowed=max(duration, LONGEST_CLOCK),
        )
    model.refuse_too_fast(interval)
    count = set_point_count(duration, model, interval, method, options.get("poles"))
    _checks.refuse_too_many(
        f"{count * interval:.4g} s of motion at a command interval of {interval:g} s",
        count * trajectory.dof,
        "take a longer command interval or a higher speed",
    )
    start, q, cut_off = _set_points(trajectory, model, interval, method, arm, options)
    taught = TaughtData(
        period=interval,
        q=q,
        trajectory=trajectory,
        method=method,
        start_time=start,
        cut_off=cut_off,
    )
    if command_limits is None:
        return taught
    from armcontour.compensation.nearest import within_limits

    return within_limits(taught, model, command_limits, arm)


def _set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    period: float,
    method: str,
    arm: Arm | None,
    options: dict[str, Any],
) -> tuple[float, FloatArray, FloatArray | None]:
    """Time of the first set-point [s], set-points, (n, dof) [rad], and `TaughtData.cut_off`."""
    if method == "none":
        t = set_point_times(trajectory, period).inside
        end = trajectory([trajectory.duration], side="left")
        return 0.0, np.concatenate([trajectory(t), end]), None
    if method == "pole_placement":
        from armcontour.compensation.pole_placement import pole_placement

        start, q = pole_placement(trajectory, servo, period, **options)
    elif method == "inverse_dynamics":
        from armcontour.compensation.inverse_dynamics import inverse_dynamics

        start, q = inverse_dynamics(trajectory, servo, period, arm, **options)
    else:
        from armcontour.compensation.set_points import inverse

        start, q = inverse(trajectory, servo, period)
    if not servo.has_feedforward and not servo.ki.any():
        return start, q, None
    from armcontour.compensation.feedforward import for_feedforward

    return start, *for_feedforward(q, period, servo, trajectory.duration)


def set_point_count(
    duration: float, servo: ServoModel, period: float, method: str, poles: Any | None = None
) -> float:
    """Approximate number of set-points of a motion.

    Args:
        duration: Duration of the motion [s].
        servo: Servo model whose delay is compensated, with values per joint.
        period: Command interval [s].
        method: As in `compensate`.
        poles: As in `compensate`.

    Raises:
        InvalidInput: The poles are not valid.
        CompensationError: The poles are not stable.
    """
    total = duration
    if method != "none":
        total += float(servo.dead_time.max()) + period
        if servo.has_feedforward or servo.ki.any():
            from armcontour.compensation.feedforward import tail_duration

            total += tail_duration(servo, duration)
    if method == "pole_placement" and servo.kv is not None:
        from armcontour.compensation.pole_placement import check_poles

        slowest = float(servo.kv.min())
        if poles is not None:
            slowest = float(np.abs(check_poles(poles, len(servo.kv)).real).min())
        total += SETTLING / slowest
    return total / period + 1
