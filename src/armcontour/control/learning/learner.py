"""`learn` computes the set-points of the next run, `judge_run` only the errors of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour.control.learning import alignment
from armcontour.control.learning.error_estimate import (
    RESPONSE_ERROR,
    ErrorEstimate,
    smooth_error,
    unexplained_variance,
)
from armcontour.control.learning.learning_result import (
    LearningResult,
    LearningRun,
    Recording,
    record,
)
from armcontour.control.learning.lifted_model import Lifted, Nominal, rms
from armcontour.control.learning.servo_update import fit_servo
from armcontour.core import checks
from armcontour.core.bounded_differences import differences
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.sampling import white_noise
from armcontour.motion import Execution, Log, SetPoints
from armcontour.motion.nearest_commands import (
    BY_ORDER,
    command_bounds,
    find_excess,
    nearest_commands,
)
from armcontour.motion.set_point_check import check_set_points, describe_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import LONGEST_DEAD_TIME

# Measured or simulated motion of a run.
Executed: TypeAlias = Execution | Log | Recording
# Motion of one or several runs of the same set-points.
Runs: TypeAlias = Executed | Sequence[Executed]
# Times and measured positions of the tool; None without a tracker.
Tool: TypeAlias = tuple[npt.ArrayLike, npt.ArrayLike] | None

# Assumed cycle time of a drive [s].
DRIVE_CYCLE = 2.5e-4
# Position loop gain of a joint whose servo has none [1/s], typical of industrial drives.
TYPICAL_GAIN = 25.0
# Learning ends after MAX_SETBACKS setbacks. Each setback multiplies the step by SETBACK_STEP.
MAX_SETBACKS = 3
SETBACK_STEP = 0.5
# Set-points may accelerate up to the limit of the joint or up to ACCELERATION_FACTOR times the
# largest acceleration before learning, whichever is larger. The acceleration of a joint that hardly
# moves counts as RESTING_SHARE times the acceleration of the fastest joint.
ACCELERATION_FACTOR, RESTING_SHARE = 2.0, 0.25
# Learning ends at setback RESPONSE_SETBACKS if the relative error of the response exceeds
# MAX_RESPONSE_ERROR. The servo model is the cause unless learning has reduced the first error to
# the share PROVEN_SHARE.
RESPONSE_SETBACKS, MAX_RESPONSE_ERROR, PROVEN_SHARE = 2, 1.0, 0.5
# Learning ends if the limits of the set-points allow less than this share of the computed change.
LEAST_CHANGE = 0.05
# Share of the error that remains after the first change with a fitted servo (median of tests).
FITTED_REMAINDER = 0.1
# A run is worse than another run if its error is larger by more than this many standard deviations.
SETBACK_SIGMAS = 3.0


@checked
def learn(
    set_points: SetPoints,
    executed: Runs,
    *,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None = None,
    gravity_feedforward: bool = True,
    controller: Arm | None = None,
    tool: Tool = None,
) -> LearningResult:
    """Compute set-points for the next run from the set-points of the last run and their log.

    After each further run, pass the returned result and the log of its execution. Errors that
    repeat are distinguished from other errors if there are logs of several runs of the same
    set-points, or three runs of learned set-points.

    >>> improved = ac.learn(set_points, executed, arm=arm, servo=servo)
    >>> improved.q.shape[1], len(improved.runs)
    (2, 1)

    Args:
        set_points: The set-points of the last run: a `LearningResult` with the earlier runs, or
            other set-points for the first run.
        executed: Motion of the joints, for one run or several runs: an execution, a log whose
            set-points determine the clock, or a recording of only joint positions.
        arm: The nominal arm. If it has masses and the servo is of second order, the response is
            that of rigid bodies with drives, otherwise that of independent servos.
        servo: The nominal servo.
        limits: Limits of the controller, as in `compensate`; by default the limits of the plan,
            unless the set-points of the last run exceed them.
        gravity_feedforward: True if the controller adds the torque against gravity.
        controller: The arm model of the controller if it differs from `arm`, for example because
            the payload of `arm` was identified later.
        tool: Times [s], (m,), and measured positions of the tool point in the frame of the path
            [m], (m, dimension), from a tracker. With an execution, the times are those of its plan.
            Otherwise the tracker has its own clock, and a constant delay of the tool cannot be
            distinguished from an offset of this clock. Specify `tool` for every run, with one log
            each, or for no run.

    Raises:
        InvalidInput: The log does not belong to these set-points or is not suitable for learning.
        CompensationError: The set-points of the last run exceed the limits.
    """
    result, lifted = _evaluate_runs(
        set_points, executed, Nominal(arm, servo, gravity_feedforward, controller), tool
    )
    for run in result.runs:
        alignment.require_same_set_points(run)
    return _learn_next(
        result, lifted, set_points if isinstance(set_points, LearningResult) else None, limits
    )


def judge_run(
    set_points: SetPoints,
    executed: Runs,
    *,
    arm: Arm,
    servo: ServoModel,
    gravity_feedforward: bool = True,
    controller: Arm | None = None,
    tool: Tool = None,
) -> LearningResult:
    """Determine the errors of runs from their logs as `learn` does, without learning.

    Returns:
        A finished learning result of only these runs, with the set-points of `set_points`.

    Raises:
        InvalidInput: The log does not belong to these set-points or is not suitable.
    """
    result, lifted = _evaluate_runs(
        set_points, executed, Nominal(arm, servo, gravity_feedforward, controller), tool
    )
    estimate = ErrorEstimate(lifted, result.runs)
    return replace(
        result,
        predicted=estimate.expected,
        noise=estimate.noise,
        best=estimate.best,
        repeats=estimate.repeats,
    )


def _evaluate_runs(
    set_points: SetPoints, executed: Runs, nominal: Nominal, tool: Tool
) -> tuple[LearningResult, Lifted]:
    """Measure the errors of the runs; returns a result with estimates of zero, and the model."""
    if tool is not None:
        tool = checks.check_sequence("tool", tool, object, "times and positions of the tool", 2)
    logs = executed if isinstance(executed, (list, tuple)) else (executed,)
    if not logs or (tool is not None and len(logs) > 1):
        raise InvalidInput(
            "The number of logs must be one if tool is specified, otherwise at least one, but is "
            f"{len(logs)}."
        )
    servo = _linearize(nominal.servo.for_joints(nominal.arm.dof), nominal.arm)
    nominal = nominal._replace(servo=servo)
    if isinstance(set_points, LearningResult):
        nominal, misfits = nominal._replace(servo=set_points.servo), set_points.misfits
        lifted = set_points.lifted or Lifted(set_points, nominal)
    else:
        set_points, lifted, misfits = _fit_model(set_points, logs, nominal)
    fitted = lifted.nominal.servo
    result = LearningResult(
        cycle=set_points.cycle, q=set_points.q, trajectory=set_points.trajectory,
        method=set_points.method, start_time=set_points.start_time,
        command_limits=set_points.command_limits, servo=fitted, misfits=misfits, lifted=lifted,
        runs=tuple(_measure_errors(lifted, set_points, record(x, set_points), tool) for x in logs),
        delay=float((fitted.dead_time - servo.dead_time).max()),
        predicted=0.0, noise=0.0, best=0, repeats=0.0, finished=True, reason="learned nothing",
    )  # fmt: skip
    return result, lifted


def _linearize(servo: ServoModel, arm: Arm) -> ServoModel:
    """Linear servo model with values per joint, for the lifted response."""
    # Friction is removed, because its effect is learned. A pure delay becomes order "first" with
    # velocity feed-forward 1. With rigid bodies, a drive cycle is replaced by a dead time of half a
    # drive cycle.
    servo = servo.replace(friction=0.0).for_joints(arm.dof)
    if servo.drive_cycle and arm.has_bodies and servo.replace(drive_cycle=0.0).is_plain("second"):
        dead_time = np.minimum(servo.dead_time + servo.drive_cycle / 2, LONGEST_DEAD_TIME)
        servo = servo.replace(drive_cycle=0.0, dead_time=dead_time)
    loop = np.isfinite(servo.kp)
    orders = np.broadcast_to(servo.order, loop.shape)
    return servo.replace(
        order=tuple(np.where(loop, orders, "first")),
        kp=np.where(loop, servo.kp, TYPICAL_GAIN),
        velocity_feedforward=np.where(loop, servo.velocity_feedforward, 1.0),
        acceleration_feedforward=np.where(loop, servo.acceleration_feedforward, 0.0),
    )


def _fit_model(
    set_points: SetPoints, logs: Sequence[Executed], nominal: Nominal
) -> tuple[SetPoints, Lifted, tuple[float, float]]:
    """Fit the servo to the mean of the first logs: set-points, lifted model, and misfits."""
    # If the robot has more dead time than its model, the set-points start earlier by whole cycles.
    lifted = Lifted(set_points, nominal)
    errors, noises, interval = [], [], np.inf
    for log in logs:
        recording = record(log, set_points)
        aligned = alignment.align(recording, lifted, set_points)
        if not recording.in_plan_time and recording.command is None:
            return set_points, lifted, (0.0, 0.0)
        noises.append(aligned.noise)
        interval = min(interval, recording.interval)
        errors.append(aligned.measured - aligned.expected)
    lead = lifted.command_for(set_points.q) - lifted.planned
    noise = np.mean(noises, axis=0)
    variance = float(np.mean(unexplained_variance(noise, lead)))
    servo, misfits = fit_servo(
        set_points, lifted, np.mean(errors, axis=0), variance, noise, interval
    )
    delay = float((servo.dead_time - nominal.servo.dead_time).max())
    early = max(int(delay / set_points.cycle), 0) * set_points.cycle
    set_points = replace(set_points, start_time=set_points.start_time - early)
    return set_points, Lifted(set_points, nominal._replace(servo=servo)), misfits


def _measure_errors(
    lifted: Lifted, set_points: SetPoints, recording: Recording, tool: Tool
) -> LearningRun:
    """Align the recording of a run with the plan, and determine its errors."""
    expected = None
    if isinstance(set_points, LearningResult) and not recording.exact:
        before = set_points.runs[set_points.best]
        before_moved, added = (
            lifted.respond(x - set_points.runs[0].q) for x in (before.q, set_points.q)
        )
        error = smooth_error(lifted, before.error, before.noise, before_moved)
        expected = lifted.planned + error + added - before_moved
    aligned = alignment.align(recording, lifted, set_points, expected)
    offset, rate, expected, measured, noise, shift, outliers = aligned
    error = measured - lifted.planned
    # in_loop: measurement noise in the loops. If positions are exact, it is determined from their
    # equivalent command. Otherwise encoder noise hides it, and its variance per drive cycle is
    # assumed to be the variance of the encoder noise.
    in_loop = noise * np.sqrt(min(DRIVE_CYCLE, recording.interval) / lifted.step)
    if recording.exact:
        command = lifted.equivalent_command(measured - expected)
        in_loop = white_noise(command, smoothed=True, order=4)
    # If the sample interval is longer than the model's time step, the noise of a sample affects
    # several times of the model.
    noise *= np.sqrt(max(recording.interval * rate / lifted.step, 1.0))
    if tool is not None:
        clock = (offset, rate) if recording.in_plan_time else None
        error, added = alignment.add_tool(tool, lifted, error, clock)
        noise = np.hypot(noise, added)
    moved: FloatArray | float = 0.0
    if isinstance(set_points, LearningResult):
        moved = lifted.respond(set_points.q - set_points.runs[0].q)
    smooth, plan_times = smooth_error(lifted, error, noise, moved), offset + rate * recording.t
    return LearningRun(
        q=set_points.q, error=error, noise=noise, loop_noise=in_loop,
        joint_rms=np.sqrt((smooth**2).mean(axis=0)), joint_max=np.abs(smooth).max(axis=0),
        offset=offset, rate=rate, source=recording.source,
        predicted=set_points.predicted if isinstance(set_points, LearningResult) else None,
        set_points_off=alignment.set_points_off(plan_times, recording.command, set_points),
        encoder_shift=shift, outliers=outliers,
        **lifted.judge(smooth)._asdict(),
    )  # fmt: skip


def _learn_next(
    result: LearningResult, lifted: Lifted, last: LearningResult | None, limits: Limits | None
) -> LearningResult:
    """Learn from the new runs and from the runs of the last result."""
    none: tuple[tuple[LearningRun, ...], int, bool] = ((), 0, False)
    earlier, setbacks, done = (last.runs, last.setbacks, last.finished) if last else none
    runs = (*earlier, *result.runs)
    estimate = ErrorEstimate(lifted, runs)
    best = runs[estimate.best]
    before = min((x.rms for x in earlier), default=np.inf)
    now = rms(np.array([x.rms for x in result.runs]))
    is_setback = now > before + SETBACK_SIGMAS * estimate.resolution and not done
    setbacks += is_setback
    step = SETBACK_STEP**setbacks * (estimate.step if earlier else 1.0)
    applied = result.trajectory.limits_for(result.command_limits if limits is None else limits)
    if limits is None and describe_excess(result):
        # The joint limits of the plan do not apply if the set-points already exceed them.
        applied = applied.of_tool
    check_set_points(replace(result, q=best.q), applied)
    first = _accelerations(runs[0].q, result.cycle)
    fastest = ACCELERATION_FACTOR * np.maximum(first, RESTING_SHARE * first.max())
    if applied.joint_acceleration is not None:
        slowest = np.minimum(*np.abs(applied.acceleration_bounds(lifted.dof)))
        fastest = np.maximum(slowest, fastest)
    requested = best.q + step * (estimate.correct(setbacks) - best.q)
    q, reason = _keep_limits(result, requested, best.q, applied, fastest)
    # fraction: share of the removable error that is predicted to remain. If there are earlier runs,
    # it is at least the square root of the ratio of the new error to the best earlier error,
    # because the share of noise and friction increases.
    fraction = FITTED_REMAINDER if any(result.misfits) else RESPONSE_ERROR
    fraction = (
        max(estimate.response_error, float(np.sqrt(min(now / before, 1.0))))
        if earlier
        else fraction
    )
    remaining = lifted.judge(fraction * estimate.removed).rms
    lost = lifted.respond(requested - q)
    remaining += lifted.judge(lost).rms + (1 - step) * estimate.repeats
    predicted = float(
        np.linalg.norm([remaining, estimate.differs / np.sqrt(len(runs)), estimate.noise])
    )
    end = _reason_to_finish(estimate, setbacks, is_setback)
    early = last is None and result.delay >= result.cycle
    if reason and not (end or early) and rms(q - best.q) < LEAST_CHANGE * rms(requested - best.q):
        end = f"nothing was learned, because {reason}"
    finished, averaged = bool(end), estimate.is_noise and estimate.differs > 0
    return replace(
        result, runs=runs, method="learning", setbacks=setbacks, finished=finished,
        reason=end or reason,
        q=best.q if finished and not averaged else q,
        predicted=estimate.expected if finished else min(predicted, estimate.expected),
        noise=estimate.noise, best=estimate.best, repeats=estimate.repeats,
    )  # fmt: skip


def _reason_to_finish(estimate: ErrorEstimate, setbacks: int, is_setback: bool) -> str:
    """Reason why another run is not expected to reduce the error; empty if none."""
    if estimate.is_noise:
        return "the remaining error is noise"
    if (
        is_setback
        and setbacks >= RESPONSE_SETBACKS
        and estimate.response_error > MAX_RESPONSE_ERROR
    ):
        if estimate.runs[estimate.best].rms < PROVEN_SHARE * estimate.runs[0].rms:
            return "the remaining error does not repeat"
        return (
            "the last change increased the error, and its effect differs by "
            f"{estimate.response_error:.0%} from the prediction of the servo model, so identify "
            "the servo"
        )
    if setbacks >= MAX_SETBACKS:
        return f"{setbacks} changes increased the error"
    return ""


def _accelerations(q: FloatArray, cycle: float) -> FloatArray:
    """Largest acceleration of each joint's set-points [rad/s²], (dof,)."""
    return np.asarray(np.abs(differences(q, 2)).max(axis=0) / cycle**2)


def _keep_limits(
    result: LearningResult,
    requested: FloatArray,
    best: FloatArray,
    limits: Limits,
    fastest: FloatArray,
) -> tuple[FloatArray, str]:
    """Nearest set-points within the limits, (n, dof), and a clause on the active limit, or ""."""
    # A joint without a solution keeps the set-points of the best run. fastest: limits of joint
    # acceleration [rad/s²], (dof,).
    selected = Limits.only(
        joint_velocity=limits.joint_velocity,
        joint_acceleration=fastest,
        joint_lower=limits.joint_lower,
        joint_upper=limits.joint_upper,
    )
    bounds = command_bounds(selected, len(fastest))
    if result.command_limits is not None:
        others = command_bounds(result.command_limits, len(fastest))
        bounds = np.stack(
            [np.maximum(bounds[:, 0], others[:, 0]), np.minimum(bounds[:, 1], others[:, 1])], axis=1
        )
    worst = find_excess(requested, result.cycle, bounds)
    if worst is None:
        return requested, ""
    name, j = BY_ORDER[worst[0]] or "range", worst[2]
    q = nearest_commands(requested, result.cycle, bounds, best)[0]
    return q, f"the {name} of the set-points of joint {j + 1} limits the step"
