"""Function `compensate`, with the steps that all compensations share."""

from __future__ import annotations

import warnings

from armcontour.control.compensation.feedforward_servo import (
    has_transient,
    invert_feedforward,
    tail_duration,
)
from armcontour.control.compensation.inverse import INVERSE
from armcontour.control.compensation.method import CompensationOptions
from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.text import capitalise
from armcontour.motion import DEFAULT_CYCLE, LONGEST_CLOCK, SetPoints, Trajectory, check_cycle
from armcontour.motion.execution import describe_excess
from armcontour.motion.set_point_rule import SetPointRule, make_rule
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel

# Relative tolerance of durations, which have rounding errors because they are sums.
DURATION_TOLERANCE = 1e-9


@checked
def compensate(
    trajectory: Trajectory,
    servo: ServoModel,
    options: CompensationOptions = INVERSE,
    *,
    cycle: float = DEFAULT_CYCLE,
    arm: Arm | None = None,
) -> SetPoints:
    """Compute set-points with which the servos follow a trajectory.

    Set-points that compensate are the nearest ones within their limits: the ranges and velocities
    of the plan, `options.command_limits`, and without another limit 3 times the joint acceleration
    of the plan. Set-points of other methods are only compared with these limits.

    The time advance of the set-points is the dead time of the servo, plus half a cycle for
    interpolation "step". With a time advance, set-points begin before time 0, at the start of the
    plan.

    With feed-forward or an integrator, set-points have a transient after the plan. Its time
    constant is `f / kp` with velocity feed-forward f, and `1 / ki` with an integrator. The
    transient is truncated after 1 s or 20 % of the motion. Then the set-points fade to the end of
    the plan, and `SetPoints.truncated` is an upper bound of the resulting joint errors.

    >>> sent = ac.compensate(planned, servo, ac.Inverse(), cycle=4e-3)
    >>> sent.q.shape[1], sent.cycle
    (2, 0.004)

    Args:
        trajectory: Trajectory that the joints should follow.
        servo: Servo model whose delay is compensated.
        options: The method and its options: `Inverse`, `PolePlacement`, `InverseDynamics` or
            `NoCompensation`.
        cycle: Cycle [s].
        arm: The nominal arm with masses, for `InverseDynamics`; other methods ignore it.

    Raises:
        InvalidInput: An argument has the wrong type, the gains do not fit the joints or the cycle,
            the cycle is longer than the motion, the set-points are too many, `InverseDynamics` has
            no arm with masses, or `InverseDynamics` or `PolePlacement` has a servo with an order
            other than "second", an integrator, friction or a drive cycle.
        CompensationError: Poles are not stable, or the plan exceeds the velocity or acceleration of
            the command limits by more than 1 %.

    Warns:
        UserWarning: Set-points exceed a limit, or compensation with this servo may be worse than
            none (`ServoModel.doubt`).
    """
    set_points = unchecked_set_points(trajectory, servo, options, cycle=cycle, arm=arm)
    for excess in set_points.use.excesses:
        warnings.warn(capitalise(describe_excess(excess, set_points)), stacklevel=3)
    if options.compensates and servo.doubt:
        warnings.warn(servo.doubt, stacklevel=3)
    return set_points


def unchecked_set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    options: CompensationOptions,
    *,
    cycle: float,
    arm: Arm | None,
    rule: SetPointRule | None = None,
    saturates: bool = True,
) -> SetPoints:
    """Compute set-points as `compensate`, without its check of limits.

    - `rule`: limits of the set-points; by default those of the plan and the options.
    - `saturates`: whether joints may saturate, so that limited set-points also bound their
      accelerations where this costs less.
    """
    interval = check_cycle(cycle)
    model = servo.for_joints(trajectory.dof)
    duration = trajectory.duration
    if interval > max(duration * (1 + DURATION_TOLERANCE), LONGEST_CLOCK):
        raise InvalidInput(
            f"The cycle must not be longer than the motion of {duration:.6g} s, but is "
            f"{interval:g} s. The cycle is in seconds. For {interval:g} ms, specify "
            f"{interval / 1e3:g}, or in a job `cycle: {interval:g} ms`.",
            needed=interval,
            allowed=max(duration, LONGEST_CLOCK),
        )
    model.check_gains(interval)
    count = set_point_count(duration, model, interval, options)
    checks.check_count(
        f"{count * interval:.4g} s of motion at a cycle of {interval:g} s",
        count * trajectory.dof,
        "Use a longer cycle or a higher speed",
    )
    if rule is None:
        rule = make_rule(
            trajectory.limits_for(None), trajectory.dof, command_limits=options.command_limits
        )
    start, q = options.set_points(trajectory, model, interval, arm)
    truncated = None
    if options.compensates and has_transient(model):
        q, truncated = invert_feedforward(q, interval, model, duration)
    prismatic = None if arm is None else arm.chain.prismatic
    set_points = SetPoints(
        cycle=interval,
        q=q,
        trajectory=trajectory,
        method=options.method,
        start_time=start,
        truncated=truncated,
        rule=rule,
        servo_text=model.describe_with_source(prismatic) if options.compensates else "",
    )
    if not options.compensates:
        return set_points
    from armcontour.control.compensation.nearest_set_points import limit_set_points

    # Set-points for bodies contain torques that the servo model lacks.
    saturates = saturates and not options.for_bodies
    return limit_set_points(set_points, model, arm, saturates=saturates)


def set_point_count(
    duration: float, servo: ServoModel, cycle: float, options: CompensationOptions
) -> float:
    """Return the approximate number of set-points of a motion.

    - `duration`: duration of the motion [s].
    - `servo`: servo model with one value per joint.
    """
    total = duration + options.settling(servo)
    if options.compensates:
        total += float(servo.dead_time.max()) + cycle
        if has_transient(servo):
            total += tail_duration(servo, duration)
    return total / cycle + 1
