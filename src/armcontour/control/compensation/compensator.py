"""Function `compensate`, its options, and the inverse of the servo."""

from __future__ import annotations

import warnings
from typing import Annotated, ClassVar

import numpy as np
import numpy.typing as npt

from armcontour.control.compensation.set_point_times import (
    SETTLING,
    SNAP,
    SetPointTimes,
    advance_set_points,
    integrator_tail,
    set_point_times,
    time_advances,
)
from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Options, checked, declared
from armcontour.core.quantities import NO_KEY, Items, Key, Pole
from armcontour.motion import DEFAULT_CYCLE, LONGEST_CLOCK, SetPoints, Trajectory, check_cycle
from armcontour.motion.execution import check_set_points, describe_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import without_integral

# Factor k of the bias k T² x'' of interpolated set-points with the cycle T: a mean over a cycle
# contributes 1 / 24, linear interpolation 1 / 12, and held set-points 1 / 24.
BIAS = {"linear": 1 / 8, "step": 1 / 12, "cubic": 1 / 24}
# Largest half-width of the second differences that correct this bias [cycles]. A smaller half-width
# would increase the commanded acceleration at jumps of acceleration.
HALF_WIDTH = 12
# Relative tolerance of durations, which have rounding errors because they are sums.
DURATION_TOLERANCE = 1e-9
# Poles in a file.
POLES = Key(
    hint=Annotated[list[Pole], Items(3, 3)] | list[Annotated[list[Pole], Items(3, 3)]] | None
)


def invert_servo(
    trajectory: Trajectory, servo: ServoModel, cycle: float
) -> tuple[float, FloatArray]:
    """Time of the first set-point [s], and set-points by the inverse servo [rad], (n, dof).

    The saturation of the servo is ignored.
    """
    # A set-point is the mean of the exact command over the cycle about its time. Because the servo
    # is linear, this mean is the command for the means of the plan. The means of velocity and
    # acceleration are differences of position and velocity. Therefore, if the acceleration jumps
    # within such a cycle, each of its values is weighted by its duration in the cycle.
    final = trajectory([trajectory.duration], side="left")
    tail = np.zeros((integrator_tail(servo, trajectory.duration, cycle), trajectory.dof))

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        t = times.inside
        if len(t) and times.after_end < cycle / 2:
            # The cycle about the first set-point after the motion contains a part of the motion.
            t = np.append(t, trajectory.duration + times.after_end)
        # A drive holds its acceleration over a drive cycle, so the plan's acceleration is taken
        # half a drive cycle later.
        q, dq, ddq = _means(trajectory, t, cycle, servo.drive_cycle / 2)
        q = np.concatenate([q, tail + final])
        ends = np.concatenate([dq, tail])
        ddq = without_integral(ends, np.concatenate([ddq, tail]), servo, cycle)
        commands = servo.command(q, ends, ddq)
        inside = commands[: len(t)]
        inside -= BIAS[servo.interpolation] * _second_differences(inside, trajectory, t, cycle)
        return np.concatenate([commands, final])[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, cycle), cycle, command, from_rest=True
    )


def _means(
    trajectory: Trajectory, t: FloatArray, cycle: float, ahead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of q, dq and ddq over the cycles about times t, (n, dof) each.

    Before and after the motion, the joints rest. Means of q are computed by Simpson's rule, which
    is exact up to third order. Means of ddq are for cycles that are shifted by `ahead` [s].
    """
    shifts = cycle / 2 * np.arange(-1, 2)
    if ahead:
        shifts = np.append(shifts, ahead + shifts[::2])
    # All times are evaluated at once, because a program has thousands of motion laws.
    q, dq = trajectory.motion_with_rests((t[:, None] + shifts).ravel(), 1)
    count = len(shifts)
    first, middle, last = (q[k::count] for k in range(3))
    before = dq[count // 4 * 3 :: count]
    after = dq[count - 1 :: count]
    return (first + 4 * middle + last) / 6, (last - first) / cycle, (after - before) / cycle


def _second_differences(
    u: FloatArray, trajectory: Trajectory, t: FloatArray, cycle: float
) -> FloatArray:
    """Second differences of set-points with a half-width up to HALF_WIDTH intervals, (n, dof)."""
    # The differences are within one move. They decrease to 0 towards both ends of the move, because
    # set-points at rest have no bias.
    ends = trajectory.starts
    k = np.clip(np.searchsorted(ends, t, side="right"), 1, len(ends) - 1)
    inside = np.minimum(t - ends[k - 1], ends[k] - t) / cycle
    reach = np.clip(np.floor(inside + SNAP), 0, HALF_WIDTH).astype(np.intp)
    i = np.arange(len(t))
    weight = np.clip(inside / HALF_WIDTH, 0, 1) / np.maximum(reach, 1) ** 2
    return np.asarray(weight[:, None] * (u[i + reach] - 2 * u + u[i - reach]))


@declared(eq=False)
class CompensationOptions(Options):
    """Options of all methods of `compensate`; base of the options of each method.

    Args:
        command_limits: Limits of the set-points, which controllers check by differences over the
            cycle: joint_velocity [rad/s], joint_acceleration [rad/s²], joint_jerk [rad/s³],
            joint_lower and joint_upper [rad], each one value or one per joint. If set-points of a
            joint exceed a limit, they are replaced by the nearest ones within the limits (least
            squares), which are at rest at both ends of the plan and begin earlier and end later by
            up to 1 s. `SetPoints.limit_cost` is the error that this causes.
    """

    method: ClassVar[str]
    command_limits: Annotated[Limits | None, NO_KEY] = None


@declared(eq=False)
class Inverse(CompensationOptions):
    """Exact inverse of the unsaturated servo; options are those of `CompensationOptions`.

    The inverse is applied to the mean of the trajectory over a cycle about each set-point. If
    accelerations of the plan jump, the servo commands accelerations about 1 % above those of the
    plan. The first set-point, one cycle before time 0, is the start of the plan.

    >>> ac.compensate(planned, servo, ac.Inverse()).method
    'inverse'
    """

    method = "inverse"


@declared(eq=False)
class PolePlacement(CompensationOptions):
    """The paper's compensator (26) for servos of order "second"; extends `CompensationOptions`.

    >>> slow = ac.plan(path, arm, limits.replace(speed=0.02))
    >>> ac.compensate(slow, servo, ac.PolePlacement()).method
    'pole_placement'

    Args:
        poles: Two regulator poles and the observer pole [1/s], (3,), or three per joint, (dof, 3);
            by default all joints have the lag of the joint with the smallest K_v.
    """

    method = "pole_placement"
    poles: Annotated[npt.ArrayLike | None, POLES] = None


@declared(eq=False)
class InverseDynamics(CompensationOptions):
    """Inverse of drives that move the arm's rigid bodies; extends `CompensationOptions`.

    The method is most accurate for plans with jerk limits. With the first and the last set-point,
    the arm is at rest at the ends of the plan. The method requires an arm with masses and a servo
    of order "second".

    >>> options = ac.InverseDynamics(gravity_feedforward=True)
    >>> options.method
    'inverse_dynamics'

    Args:
        gravity_feedforward: Whether the controller adds the gravity torque.
        controller: The arm model of the controller, for example without a payload that was
            identified later; by default the nominal arm.
    """

    method = "inverse_dynamics"
    gravity_feedforward: bool = True
    controller: Annotated[Arm | None, NO_KEY] = None


@declared(eq=False)
class NoCompensation(CompensationOptions):
    """Set-points on the trajectory without time advance; options as in `CompensationOptions`.

    >>> sent = ac.compensate(planned, servo, ac.NoCompensation())
    >>> bool(np.allclose(sent.q[-1], planned(planned.duration)))
    True
    """

    method = "none"


INVERSE = Inverse()
# Classes of options by the names of their methods.
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
        limits: Limits of the controller instead of the limits of the plan. Set-points must be
            within joint_lower and joint_upper, and must not move faster than joint_velocity.
            Without `limits`, a warning is given if set-points exceed the command limits or the
            limits of the plan.

    Raises:
        InvalidInput: An argument has the wrong type, the gains do not fit the joints or the cycle,
            the cycle is longer than the motion, the set-points are too many, `InverseDynamics` has
            no arm with masses, or `InverseDynamics` or `PolePlacement` has a servo with an order
            other than "second", an integrator, friction or a drive cycle.
        CompensationError: Poles are not stable, set-points exceed the given limits, or the plan
            exceeds the velocity or acceleration of the command limits by more than 1 %.

    Warns:
        UserWarning: No limits are given and set-points exceed the limits of the plan, or
            compensation with this servo may be worse than none (`ServoModel.doubt`).
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
    """Set-points of `compensate`, without its check of limits."""
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
    from armcontour.control.compensation.nearest_set_points import limit_set_points

    return limit_set_points(set_points, model, options.command_limits, arm)


def _set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    cycle: float,
    options: CompensationOptions,
    arm: Arm | None,
) -> tuple[float, FloatArray, FloatArray | None]:
    """Time of the first set-point [s], set-points [rad], (n, dof), and `SetPoints.truncated`."""
    if isinstance(options, NoCompensation):
        t = set_point_times(trajectory, cycle).inside
        end = trajectory([trajectory.duration], side="left")
        return 0.0, np.concatenate([trajectory(t), end]), None
    if isinstance(options, PolePlacement):
        from armcontour.control.compensation.pole_placement import place_poles

        start, q = place_poles(trajectory, servo, cycle, options.poles)
    elif isinstance(options, InverseDynamics):
        from armcontour.control.compensation.inverse_dynamics import invert_dynamics

        start, q = invert_dynamics(
            trajectory, servo, cycle, arm,
            gravity_feedforward=options.gravity_feedforward, controller=options.controller,
        )  # fmt: skip
    else:
        start, q = invert_servo(trajectory, servo, cycle)
    if not servo.has_feedforward and not servo.ki.any():
        return start, q, None
    from armcontour.control.compensation.feedforward_servo import invert_feedforward

    return start, *invert_feedforward(q, cycle, servo, trajectory.duration)


def set_point_count(
    duration: float, servo: ServoModel, cycle: float, options: CompensationOptions
) -> float:
    """Approximate number of set-points of a motion."""
    total = duration
    if not isinstance(options, NoCompensation):
        total += float(servo.dead_time.max()) + cycle
        if servo.has_feedforward or servo.ki.any():
            from armcontour.control.compensation.feedforward_servo import tail_duration

            total += tail_duration(servo, duration)
    if isinstance(options, PolePlacement) and servo.kv is not None:
        from armcontour.control.compensation.pole_placement import check_poles

        slowest = float(servo.kv.min())
        if options.poles is not None:
            slowest = float(np.abs(check_poles(options.poles, len(servo.kv)).real).min())
        total += SETTLING / slowest
    return total / cycle + 1
