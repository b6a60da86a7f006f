"""`learn` computes the set-points of the next run from the log of the last run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy.ndimage import uniform_filter1d

from armcontour.control.learning import log_alignment
from armcontour.control.learning.learning_result import (
    LearningResult,
    LearningRun,
    Recording,
    record,
)
from armcontour.control.learning.lifted_model import REST_TIME, Lifted, Nominal
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import shared_unit
from armcontour.core.sampled_data import differences, interpolate
from armcontour.motion import Execution, Log, SetPoints
from armcontour.motion.execution import check_set_points, describe_excess
from armcontour.motion.nearest_commands import command_bounds, find_excess, nearest_commands
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import LONGEST_DEAD_TIME

# Relative error of the linearized response of an exact model, from tests of `Response`.
MODEL_ERROR = 1e-3
# The response error counts CAUTION times in the next step, because the errors that remain have
# higher frequencies, at which the response of the servo model is less certain.
CAUTION = 2.0
# The mean square of white noise over REST_TIME stays below this multiple of its variance.
NOISE_MARGIN = 1.5
# A change of the set-points is useful if it reduces the error by more than this factor.
USEFUL_FACTOR = 1.05
# Measured or simulated motion of a run.
Executed: TypeAlias = Execution | Log | Recording
# Motion of one or several runs of the same set-points.
Runs: TypeAlias = Executed | Sequence[Executed]
# Position loop gain of a joint whose servo has none [1/s], typical of industrial drives.
TYPICAL_GAIN = 25.0
# A log contradicts the servo if the deviation of a joint from the simulation exceeds this multiple
# of its deviation from the set-points.
MAX_MISFIT = 1.05
# The deviation from the set-points of a joint that hardly moves counts as this fraction of the
# largest one of all joints, because coupled joints move it.
LEAST_LAG = 0.3
# Learning ends after this number of setbacks.
MAX_SETBACKS = 3
# Each setback multiplies the step by this factor.
SETBACK_STEP = 0.5
# Number of steps that are tried on the model, each SETBACK_STEP times the previous one.
TRIALS = 4
# Set-points may accelerate up to the limit of the joint or up to this multiple of the largest
# acceleration before learning, whichever is larger.
ACCELERATION_FACTOR = 2.0
# The acceleration before learning of a joint that hardly moves counts as this fraction of the
# acceleration of the fastest joint.
RESTING_SHARE = 0.25
# If learning ends by setbacks and more than this fraction of the first error remains, the servo may
# be wrong.
PROVEN_SHARE = 0.5


def smooth_error(lifted: Lifted, error: FloatArray, noise: FloatArray) -> FloatArray:
    """Error without white noise [rad], (n, dof).

    The error is the part that a disturbance of the drives explains, and the remainder where it
    exceeds the noise (a Wiener filter).

    `noise` is the standard deviation of the white noise [rad], (dof,).
    """
    smooth = lifted.smooth(error, lifted.choose_penalty(error, float(np.mean(noise**2))))
    remainder = error - smooth
    power = uniform_filter1d(remainder**2, round(REST_TIME / lifted.step), axis=0)
    gain = 1 - NOISE_MARGIN * noise**2 / np.maximum(power, 1e-300)
    return np.asarray(smooth + np.maximum(gain, 0.0) * remainder)


class ErrorEstimate:
    """The best run, its repeating error, and the set-points that remove this error."""

    # best: index of the run with the smallest measured error.
    # count: number of runs with the set-points of the best run.
    # error: repeating error of these runs, their mean without white noise [rad], (n, dof).
    # repeats: RMS of the repeating error at the tool [m].
    # noise: RMS difference of runs with equal set-points from their mean [m]; None if there are no
    # such runs.
    # q: set-points that remove the repeating error [rad], (count, dof).
    # steps: fraction of the change that each joint makes, according to the error of the model's
    # response to the newest change of the set-points, (dof,).

    def __init__(self, lifted: Lifted, runs: tuple[LearningRun, ...]) -> None:
        self._lifted = lifted
        self._runs = runs
        self.best = int(np.argmin([x.rms for x in runs]))
        best = runs[self.best]
        equal = [x for x in runs if np.array_equal(x.q, best.q)]
        self.count = len(equal)
        # The model of the correction, a random walk, applies to the change since the first run. It
        # does not apply to the remaining error, which has peaks at reversals and corners.
        moved = lifted.respond(best.q - runs[0].q)
        remaining = np.mean([x.error for x in equal], axis=0) - moved
        noise = best.noise**2 / self.count + MODEL_ERROR**2 * (remaining**2).mean(axis=0)
        penalty = lifted.choose_penalty(remaining, float(np.mean(noise)))
        change, response = lifted.correct(remaining, penalty)
        self.q = np.asarray(runs[0].q + change)
        self.error = moved - response
        self.repeats = lifted.measure_tool_error(self.error).rms
        self.noise = self._find_noise()
        self.steps = self._choose_steps()

    def _find_noise(self) -> float | None:
        """RMS tool error that differs between runs of equal set-points [m]; None if unknown."""
        groups: dict[bytes, list[LearningRun]] = {}
        for run in self._runs:
            groups.setdefault(run.q.tobytes(), []).append(run)
        squares = 0.0
        freedom = len(self._runs) - len(groups)
        for group in groups.values():
            mean = np.mean([x.error for x in group], axis=0)
            for run in group if len(group) > 1 else ():
                deviation = smooth_error(self._lifted, run.error - mean, run.noise)
                squares += self._lifted.measure_tool_error(deviation).rms ** 2
        return float(np.sqrt(squares / freedom)) if freedom else None

    def _choose_steps(self) -> FloatArray:
        best = self._runs[self.best]
        for run in reversed(self._runs):
            if not np.array_equal(run.q, best.q):
                moved = self._lifted.respond(run.q - best.q)
                miss = run.error - best.error - moved
                miss = smooth_error(self._lifted, miss, np.hypot(run.noise, best.noise))
                ratios = np.mean(miss**2, axis=0) / np.maximum(np.mean(moved**2, axis=0), 1e-300)
                return np.asarray(1 / (1 + CAUTION**2 * ratios))
        return np.ones(self._lifted.dof)

    @property
    def is_noise(self) -> bool:
        """True if runs of equal set-points differ by more than the repeating error."""
        return self.noise is not None and self.count > 1 and self.repeats <= self.noise


@checked
def learn(
    set_points: SetPoints,
    executed: Runs,
    *,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None = None,
    gravity_feedforward: bool = True,
) -> LearningResult:
    """Compute set-points for the next run from the set-points of the last run and their log.

    After each further run, pass the returned result and the log of its execution. Errors that
    repeat are distinguished from other errors if there are logs of several runs of the same
    set-points. If the log contradicts the servo, learning ends, and `reason` states the deviation.

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
        servo: The nominal servo, whose response is used.
        limits: Limits of the controller, as in `compensate`; by default the limits of the plan,
            unless the set-points of the last run exceed them.
        gravity_feedforward: True if the controller adds the torque against gravity.

    Raises:
        InvalidInput: The log does not belong to these set-points or is not suitable for learning.
        CompensationError: The set-points of the last run exceed the limits.
    """
    logs = executed if isinstance(executed, (list, tuple)) else (executed,)
    if not logs:
        raise InvalidInput("The number of logs must be at least one, but is 0.")
    recordings = [record(x, set_points) for x in logs]
    lifted = _make_lifted_model(set_points, recordings, Nominal(arm, servo, gravity_feedforward))
    new = tuple(_measure_errors(lifted, set_points, x) for x in recordings)
    for recording, run in zip(recordings, new, strict=True):
        log_alignment.require_same_set_points(recording, run, set_points)
    return _learn_next(set_points, lifted, new, limits)


def _make_lifted_model(
    set_points: SetPoints, recordings: Sequence[Recording], nominal: Nominal
) -> Lifted:
    """Lifted model: that of the earlier runs, or a new one that lasts until the arm is at rest."""
    if isinstance(set_points, LearningResult):
        nominal = nominal._replace(servo=set_points.servo)
        return set_points.lifted or Lifted(set_points, nominal, len(set_points.runs[0].error))
    nominal = nominal._replace(servo=_linearize(nominal.servo, nominal.arm))
    lifted = Lifted(set_points, nominal)
    end = max(log_alignment.find_rest(x, lifted, set_points) for x in recordings)
    if end > lifted.t[-1]:
        times = int(np.ceil((end - lifted.t[0]) / lifted.step)) + 1
        lifted = Lifted(set_points, nominal, times)
    return lifted


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


def _measure_errors(lifted: Lifted, set_points: SetPoints, recording: Recording) -> LearningRun:
    """Align the recording of a run with the plan, and determine its errors."""
    expected = None
    if isinstance(set_points, LearningResult) and not recording.exact:
        before = set_points.runs[set_points.best]
        added = lifted.respond(set_points.q - before.q)
        expected = lifted.planned + smooth_error(lifted, before.error, before.noise) + added
    arm = set_points.trajectory.arm
    aligned = log_alignment.align(recording, lifted, set_points, expected)
    offset, rate, measured, noise = aligned
    error = measured - lifted.planned
    # If the sample interval is longer than the model's time step, the noise of a sample affects
    # several times of the model.
    noise *= np.sqrt(max(recording.interval * rate / lifted.step, 1.0))
    smooth = smooth_error(lifted, error, noise)
    plan_times = offset + rate * recording.t
    return LearningRun(
        q=set_points.q, error=error, noise=noise,
        joint_rms=np.sqrt((smooth**2).mean(axis=0)), joint_max=np.abs(smooth).max(axis=0),
        offset=offset, rate=rate, source=recording.source, notes=recording.notes,
        set_points_off=log_alignment.set_points_off(plan_times, recording.command, set_points),
        prismatic=() if arm is None or arm.chain.prismatic is None else arm.chain.prismatic,
        **lifted.measure_tool_error(smooth)._asdict(),
    )  # fmt: skip


def _learn_next(
    set_points: SetPoints, lifted: Lifted, new: tuple[LearningRun, ...], limits: Limits | None
) -> LearningResult:
    """Learn from the new runs and from the earlier runs of the set-points."""
    last = set_points if isinstance(set_points, LearningResult) else None
    earlier, setbacks = (last.runs, last.setbacks) if last else ((), 0)
    runs = (*earlier, *new)
    estimate = ErrorEstimate(lifted, runs)
    best = runs[estimate.best]
    before = min((x.rms for x in earlier), default=np.inf)
    done = last is not None and last.finished
    setbacks += min(x.rms for x in new) * USEFUL_FACTOR > before and not done
    command_limits = set_points.command_limits
    applied = set_points.trajectory.limits_for(command_limits if limits is None else limits)
    if limits is None and describe_excess(set_points):
        # The joint limits of the plan do not apply if the set-points already exceed them.
        applied = applied.of_tool
    check_set_points(replace(set_points, q=best.q), applied)
    first = np.abs(differences(runs[0].q, 2)).max(axis=0) / set_points.cycle**2
    fastest = ACCELERATION_FACTOR * np.maximum(first, RESTING_SHARE * first.max())
    if applied.joint_acceleration is not None:
        slowest = np.minimum(*np.abs(applied.acceleration_bounds(lifted.dof)))
        fastest = np.maximum(slowest, fastest)
    change = estimate.steps * (estimate.q - best.q)
    for k in range(setbacks, setbacks + TRIALS):
        requested = best.q + SETBACK_STEP**k * change
        q, reason = _keep_limits(set_points, requested, best.q, applied, fastest)
        expected = float(lifted.measure_tool_error(estimate.error + lifted.respond(q - best.q)).rms)
        if useful := expected * USEFUL_FACTOR < estimate.repeats:
            break
    end = _reason_to_finish(lifted, runs, estimate, setbacks)
    if not (end or useful):
        end = f"no change reduces the error by more than {USEFUL_FACTOR - 1:.0%}"
        end += f", because {reason}" if reason else ""
    # The model and the noise limit what the next run can reach.
    floor = MODEL_ERROR * best.rms, estimate.noise or 0.0
    return LearningResult(
        cycle=set_points.cycle, q=best.q if end else q, trajectory=set_points.trajectory,
        method="learning", start_time=set_points.start_time, command_limits=command_limits,
        servo=lifted.nominal.servo, lifted=lifted, runs=runs, best=estimate.best,
        repeats=estimate.repeats, noise=estimate.noise, setbacks=setbacks, finished=bool(end),
        reason=end or reason, expected=None if end else math.hypot(expected, *floor),
    )  # fmt: skip


def _reason_to_finish(
    lifted: Lifted, runs: tuple[LearningRun, ...], estimate: ErrorEstimate, setbacks: int
) -> str:
    """Reason why another run is not expected to reduce the error; empty if none."""
    if estimate.count == len(runs) and (contradiction := _contradiction(lifted, runs[0])):
        return contradiction
    if estimate.is_noise:
        return "the remaining error is noise"
    if setbacks < MAX_SETBACKS:
        return ""
    reason = f"{setbacks} changes did not reduce the error by {USEFUL_FACTOR - 1:.0%}"
    unproven = runs[estimate.best].rms > PROVEN_SHARE * runs[0].rms
    return f"{reason}, so identify the servo" if unproven else reason


def _contradiction(lifted: Lifted, run: LearningRun) -> str:
    """Reason to identify the servo before learning; empty if the log agrees with the servo."""
    # Constant deviations, such as from gravity, are no errors of the servo.
    times = np.asarray(lifted.start + lifted.cycle * np.arange(lifted.count), dtype=float)
    measured = lifted.planned + run.error
    misfit = (measured - lifted.expected(run.q)).std(axis=0)
    lag = (measured - interpolate(lifted.t, times, run.q)).std(axis=0)
    ratios = misfit / np.maximum(lag, LEAST_LAG * lag.max())
    j = int(np.argmax(ratios))
    if not ratios[j] > MAX_MISFIT:
        return ""
    unit = shared_unit("mrad", run.prismatic[j : j + 1])
    return (
        f"{run.source} contradicts the servo: joint {j + 1} deviates by {misfit[j] * 1e3:.3g} "
        f"{unit} RMS from the simulation with the servo, but by {lag[j] * 1e3:.3g} {unit} from its "
        "set-points. Identify the servo first"
    )


def _keep_limits(
    set_points: SetPoints,
    requested: FloatArray,
    best: FloatArray,
    limits: Limits,
    fastest: FloatArray,
) -> tuple[FloatArray, str]:
    """Nearest set-points within the limits, (n, dof), and a clause on the active limit, or "".

    A joint without a solution keeps the set-points of the best run.

    `fastest` are the limits of joint acceleration [rad/s²], (dof,).
    """
    selected = Limits.only(
        joint_velocity=limits.joint_velocity,
        joint_acceleration=fastest,
        joint_lower=limits.joint_lower,
        joint_upper=limits.joint_upper,
    )
    bounds = command_bounds(selected, len(fastest))
    if set_points.command_limits is not None:
        others = command_bounds(set_points.command_limits, len(fastest))
        bounds = np.stack(
            [np.maximum(bounds[:, 0], others[:, 0]), np.minimum(bounds[:, 1], others[:, 1])], axis=1
        )
    excess = find_excess(requested, set_points.cycle, bounds)
    if excess is None:
        return requested, ""
    name = excess.name if excess.order else "range"
    q = nearest_commands(requested, set_points.cycle, bounds, best)[0]
    words = name.removeprefix("joint_").replace("_", " ")
    return q, f"the {words} of the set-points of joint {excess.joint + 1} limits the step"
