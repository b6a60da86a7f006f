"""`learn` computes the set-points of the next run from the log of the last run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.ndimage import uniform_filter1d

from armcontour.control.identification import identify
from armcontour.control.learning import log_alignment
from armcontour.control.learning.learning_result import (
    LearningResult,
    LearningRun,
    Recording,
    record,
)
from armcontour.control.learning.lifted_model import (
    IDENTIFIED_SERVOS,
    REST_TIME,
    RIGID_BODIES,
    Lifted,
    Nominal,
)
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import shared_unit
from armcontour.core.sampled_data import differences, interpolate
from armcontour.motion import Execution, Log, SetPoints
from armcontour.motion.log import INTERPOLATIONS
from armcontour.motion.nearest_commands import BY_ORDER, find_excess, nearest_commands
from armcontour.motion.set_point_rule import NO_BOUND
from armcontour.robot import Arm
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
# The first model whose deviation is below this fraction of the deviation from the set-points is
# used.
CERTAIN_MISFIT = 0.02
# A servo that is identified from a log is used if the deviation of each joint from its simulation
# is below this fraction of the deviation from the set-points.
IDENTIFIED_MISFIT = 0.5
# It must also be below this fraction of the largest deviation from the simulation of the job's
# servo.
BETTER_SHARE = 0.5
# A servo is identified from at most this part of a long log [s], which takes a second or two.
IDENTIFIED_TIME = 15.0
# If a joint hardly moves, its deviation from the set-points counts as at least this fraction of the
# largest one, because coupled joints move it.
LEAST_LAG = 0.3
# Learning ends after this number of setbacks.
MAX_SETBACKS = 3
# Each setback multiplies the step by this factor.
SETBACK_STEP = 0.5
# In a bad case, the error of the next run is at most this multiple of the smallest error.
MAX_GROWTH = 1.2
# Number of steps that are tried on the model, each SETBACK_STEP times the previous one.
TRIALS = 4
# Set-points may accelerate up to the limit of the joint or up to this multiple of the largest
# acceleration before learning, whichever is larger.
ACCELERATION_FACTOR = 2.0
# If a joint hardly moves before learning, its acceleration counts as this fraction of the fastest
# joint's acceleration.
RESTING_SHARE = 0.25
# If learning ends by setbacks and more than this fraction of the first error remains, the servo may
# be wrong.
PROVEN_SHARE = 0.5


def smooth_error(lifted: Lifted, error: FloatArray, noise: FloatArray) -> FloatArray:
    """Remove white noise from an error [rad], (n, dof).

    The result is the part that a disturbance of the drives explains, and the remainder where it
    exceeds the noise (a Wiener filter).

    - `noise`: standard deviation of the white noise [rad], (dof,).
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
    # model_errors: relative error of the model's response, by joint, (dof,).

    def __init__(self, lifted: Lifted, runs: tuple[LearningRun, ...]) -> None:
        self._lifted = lifted
        self._runs = runs
        self.best = int(np.argmin([x.rms for x in runs]))
        best = runs[self.best]
        equal = [x for x in runs if np.array_equal(x.q, best.q)]
        self.count = len(equal)
        # The model of the correction, a random walk, applies to the change since the first run. It
        # does not apply to the remaining error, which has peaks at reversals and corners.
        learned_response = lifted.respond(best.q - runs[0].q)
        error = np.mean([x.error for x in equal], axis=0)
        rest = np.mean([x.rest for x in equal], axis=0)
        # The errors in the last REST_TIME stand for the errors of the arm at rest.
        later = np.any([x.rests_later for x in equal], axis=0)
        error[lifted.is_rest] = np.where(later, rest, error[lifted.is_rest])
        remaining = error - learned_response
        noise = best.noise**2 / self.count + MODEL_ERROR**2 * (remaining**2).mean(axis=0)
        penalty = lifted.choose_penalty(remaining, float(np.mean(noise)))
        # The last set-point determines where a joint rests, also after the times of the model.
        last = best.q[-1] - rest - runs[0].q[-1]
        change, response = lifted.correct(remaining, penalty, last)
        self.q = np.asarray(runs[0].q + change)
        self.error = learned_response - response
        self.repeats = lifted.measure_tool_error(self.error).rms
        self.noise = self._find_noise()
        self.model_errors = self._find_model_errors()

    def _find_noise(self) -> float | None:
        """Return the RMS tool error that differs between runs of equal set-points [m].

        It is None if there are no such runs.
        """
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

    def _find_model_errors(self) -> FloatArray:
        """Return the relative error of the model's response of each joint, (dof,).

        It is that of the newest change of the set-points. Before there is such a change, it is that
        of the motion that the first set-points cause.
        """
        best = self._runs[self.best]
        for run in reversed(self._runs):
            if not np.array_equal(run.q, best.q):
                predicted = self._lifted.respond(run.q - best.q)
                model_error = run.error - best.error - predicted
                noise = np.hypot(run.noise, best.noise)
                model_error = smooth_error(self._lifted, model_error, noise)
                squares = np.maximum(np.mean(predicted**2, axis=0), 1e-300)
                return np.asarray(np.sqrt(np.mean(model_error**2, axis=0) / squares))
        return _find_misfit(self._lifted, best.q, self._lifted.planned + best.error).ratios

    @property
    def steps(self) -> FloatArray:
        """Fraction of the change that each joint makes, (dof,)."""
        # A deviation of the first motion may also come from a load or friction, which repeats.
        if self.count == len(self._runs):
            return np.ones(self._lifted.dof)
        return np.asarray(1 / (1 + CAUTION**2 * self.model_errors**2))

    def predict(self, response: FloatArray) -> tuple[float, float]:
        """Return the RMS tool error of the next run as predicted, and in a bad case [m].

        In the bad case, the joints respond differently from the model by its errors, all in the
        same direction or in alternating ones.

        - `response`: response of the joints to the change of the set-points [rad], (n, dof).
        """
        expected = self.error + response
        predicted = self._lifted.measure_tool_error(expected).rms
        alternating = (-1.0) ** np.arange(self._lifted.dof)
        worst = predicted
        for signs in (alternating, np.ones(self._lifted.dof)):
            deviation = signs * self.model_errors * response
            worst = max(worst, self._lifted.measure_tool_error(expected + deviation).rms)
        return predicted, worst

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
    gravity_feedforward: bool = True,
) -> LearningResult:
    """Compute set-points for the next run from the set-points of the last run and their log.

    After each further run, pass the returned result and the log of its execution. Errors that
    repeat are distinguished from other errors if there are logs of several runs of the same
    set-points. If the first log contradicts the servo, the servo that is identified from this log
    is used. If it does not fit either, learning ends, and `reason` states the deviation.

    >>> improved = ac.learn(set_points, executed, arm=arm, servo=servo)
    >>> improved.q.shape[1], len(improved.runs)
    (2, 1)

    Args:
        set_points: The set-points of the last run: a `LearningResult` with the earlier runs, or
            other set-points for the first run.
        executed: Motion of the joints, for one run or several runs: an execution, a log whose
            set-points determine the clock, or a recording of only joint positions.
        arm: The nominal arm. If it has masses and the servo is of second order, the response is
            that of rigid bodies with drives or of independent servos, whichever the first log
            supports.
        servo: The nominal servo, whose response is used.
        gravity_feedforward: True if the controller adds the torque against gravity.

    Raises:
        InvalidInput: The log does not belong to these set-points or is not suitable for learning.
    """
    logs = executed if isinstance(executed, (list, tuple)) else (executed,)
    if not logs:
        raise InvalidInput("The number of logs must be at least one, but is 0.")
    recordings = [record(x, set_points) for x in logs]
    nominal = Nominal(arm, servo, gravity_feedforward)
    chosen = _choose_model(set_points, recordings, nominal)
    lifted = chosen.lifted
    new = tuple(_measure_errors(lifted, set_points, x) for x in recordings)
    if chosen.note:
        new = tuple(replace(x, notes=(*x.notes, chosen.note)) for x in new)
    for recording, run in zip(recordings, new, strict=True):
        log_alignment.require_same_set_points(recording, run, set_points)
    return _learn_next(set_points, chosen, new)


class Chosen(NamedTuple):
    """The lifted model that the first log supports."""

    lifted: Lifted
    model: str  # As in `LearningResult`
    note: str = ""  # Sentence on a servo that contradicts the log, or empty


def _choose_model(
    set_points: SetPoints, recordings: Sequence[Recording], nominal: Nominal
) -> Chosen:
    """Return the model of the earlier runs, or the one that the first log supports.

    The models are rigid bodies with drives, if the arm has masses, and independent servos. If the
    log contradicts both, the servo is identified from this log.
    """
    if isinstance(set_points, LearningResult):
        lifted = set_points.lifted
        if lifted is None:
            nominal = nominal._replace(servo=set_points.servo)
            if set_points.model != RIGID_BODIES:
                nominal = nominal.without_bodies()
            lifted = Lifted(set_points, nominal, len(set_points.runs[0].error))
        return Chosen(lifted, set_points.model)
    candidates = [_linearize(nominal)]
    if candidates[0].drives is not None:
        candidates.append(_linearize(nominal.without_bodies()))
    recording = recordings[0]
    best: Lifted | None = None
    smallest_misfit = math.inf
    refused: InvalidInput | None = None
    for candidate in candidates:
        try:
            lifted = _make_lifted_model(set_points, recordings, candidate)
            misfit = _compare(lifted, set_points, recording).largest
        except InvalidInput as error:
            # A log that does not agree at all with one model can agree with the other.
            refused = refused or error
            continue
        if best is None or misfit < smallest_misfit:
            best = lifted
            smallest_misfit = misfit
        if smallest_misfit < CERTAIN_MISFIT:
            break
    if best is None:
        assert refused is not None
        raise refused
    if smallest_misfit > CERTAIN_MISFIT and (servo := _identify_servo(set_points, recording, best)):
        identified = _linearize(nominal.without_bodies()._replace(servo=servo))
        lifted = _make_lifted_model(set_points, recordings, identified)
        misfit = _compare(lifted, set_points, recording).largest
        if misfit < min(IDENTIFIED_MISFIT, BETTER_SHARE * smallest_misfit):
            measured = log_alignment.align(recording, best, set_points).measured
            described = _describe_contradiction(best, set_points.q, measured, recording)
            note = f"{described}. Learning uses the servo that was identified from this log."
            return Chosen(lifted, IDENTIFIED_SERVOS, note)
    return Chosen(best, best.nominal.model)


def _identify_servo(
    set_points: SetPoints, recording: Recording, lifted: Lifted
) -> ServoModel | None:
    """Identify the servo from a recording; None if the recording does not determine one.

    Without recorded set-points, the clock is that with which the recording fits the model. Learning
    needs only the response on this clock, so its dead time may differ from that of the robot.

    - `lifted`: model of the servo that the recording contradicts.
    """
    kind = lifted.nominal.servo.interpolation
    if kind not in INTERPOLATIONS:
        return None
    t = recording.t
    command = recording.command
    if command is None:
        aligned = log_alignment.align(recording, lifted, set_points)
        t = aligned.offset + aligned.rate * t
        command = interpolate(t, set_points.t, set_points.q)
    part = _find_moving_part(t, command)
    try:
        log = Log(
            t=t[part],
            command=command[part],
            measured=recording.q[part],
            interpolation=kind,
            source=recording.source,
        )
        return identify(log).servo_model()
    except InvalidInput:
        return None


def _find_moving_part(t: FloatArray, command: FloatArray) -> slice:
    """Return the part of a log, of at most IDENTIFIED_TIME, in which all joints move most.

    - `t`, `command`: times [s], (n,), and set-points [rad], (n, dof).
    """
    parts = int(np.ceil((t[-1] - t[0]) / IDENTIFIED_TIME))
    ends = np.searchsorted(t, np.linspace(t[0], t[-1], parts + 1)[1:], "right")
    begins = np.append(0, ends[:-1])
    whole = np.maximum(np.ptp(command, axis=0), 1e-300)
    best = slice(0, len(t))
    largest = -1.0
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        moved = float((np.ptp(command[begin:end], axis=0) / whole).min())
        if moved > largest:
            largest = moved
            best = slice(begin, end)
    return best


def _make_lifted_model(
    set_points: SetPoints, recordings: Sequence[Recording], nominal: Nominal
) -> Lifted:
    """Make a lifted model that lasts until the arm is at rest."""
    lifted = Lifted(set_points, nominal)
    end = max(log_alignment.find_rest(x, lifted, set_points) for x in recordings)
    if end > lifted.t[-1]:
        times = int(np.ceil((end - lifted.t[0]) / lifted.step)) + 1
        lifted = Lifted(set_points, nominal, times)
    return lifted


def _linearize(nominal: Nominal) -> Nominal:
    """Return the nominal robot with a linear servo, which has values per joint."""
    # Friction is removed, because its effect is learned. A pure delay becomes order "first" with
    # velocity feed-forward 1. With rigid bodies, a drive cycle is replaced by a dead time of half a
    # drive cycle.
    arm = nominal.arm
    servo = nominal.servo.replace(friction=0.0).for_joints(arm.dof)
    if servo.drive_cycle and arm.has_bodies and servo.replace(drive_cycle=0.0).is_plain("second"):
        dead_time = np.minimum(servo.dead_time + servo.drive_cycle / 2, LONGEST_DEAD_TIME)
        servo = servo.replace(drive_cycle=0.0, dead_time=dead_time)
    loop = np.isfinite(servo.kp)
    orders = np.broadcast_to(servo.order, loop.shape)
    servo = servo.replace(
        order=tuple(np.where(loop, orders, "first")),
        kp=np.where(loop, servo.kp, TYPICAL_GAIN),
        velocity_feedforward=np.where(loop, servo.velocity_feedforward, 1.0),
        acceleration_feedforward=np.where(loop, servo.acceleration_feedforward, 0.0),
    )
    return nominal._replace(servo=servo)


def _measure_errors(lifted: Lifted, set_points: SetPoints, recording: Recording) -> LearningRun:
    """Align the recording of a run with the plan, and determine its errors."""
    expected = None
    if isinstance(set_points, LearningResult) and not recording.exact:
        best = set_points.runs[set_points.best]
        response = lifted.respond(set_points.q - best.q)
        expected = lifted.planned + smooth_error(lifted, best.error, best.noise) + response
    aligned = log_alignment.align(recording, lifted, set_points, expected)
    offset, rate, measured, noise = aligned
    error = measured - lifted.planned
    # If the sample interval is longer than the model's time step, the noise of a sample affects
    # several times of the model.
    noise *= np.sqrt(max(recording.interval * rate / lifted.step, 1.0))
    smooth = smooth_error(lifted, error, noise)
    plan_times = offset + rate * recording.t
    rest = log_alignment.measure_rest(recording, aligned, lifted, set_points)
    resting = np.concatenate([rest.positions[None], rest.measured]) - lifted.planned[-1]
    at_rest = lifted.measure_rest(resting)
    tool = lifted.measure_tool_error(smooth)
    tool = tool._replace(tool_max=max(tool.tool_max, at_rest.tool))
    if tool.contour_max is not None and at_rest.contour is not None:
        tool = tool._replace(contour_max=max(tool.contour_max, at_rest.contour))
    return LearningRun(
        q=set_points.q, error=error, noise=noise, rest=resting[0],
        rests_later=rest.later, tool_rest=at_rest.tool,
        joint_rms=np.sqrt((smooth**2).mean(axis=0)), joint_max=np.abs(smooth).max(axis=0),
        offset=offset, rate=rate, source=recording.source,
        notes=(
            *(x.sentence for x in recording.findings),
            *recording.notes,
            *_describe_creep(recording.source, rest.creeps),
        ),
        set_points_off=log_alignment.set_points_off(plan_times, recording.command, set_points),
        prismatic=lifted.prismatic,
        **tool._asdict(),
    )  # fmt: skip


def _describe_creep(source: str, creeps: BoolArray) -> list[str]:
    """Return a sentence about the joints that still move when a recording ends."""
    joints = [f"joint {j + 1}" for j in np.flatnonzero(creeps)]
    if not joints:
        return []
    return [
        f"At the end of {source}, {', '.join(joints)} still creeps, as with an integrator in the "
        "velocity loop, and is assumed to come to rest at the last set-point. Record a longer rest "
        "to measure this."
    ]


def _learn_next(
    set_points: SetPoints, chosen: Chosen, new: tuple[LearningRun, ...]
) -> LearningResult:
    """Learn from the new runs and from the earlier runs of the set-points.

    - `new`: runs with `set_points` that have just been measured.
    """
    lifted = chosen.lifted
    previous = set_points if isinstance(set_points, LearningResult) else None
    earlier, setbacks = (previous.runs, previous.setbacks) if previous else ((), 0)
    runs = (*earlier, *new)
    estimate = ErrorEstimate(lifted, runs)
    best = runs[estimate.best]
    smallest_before = min((x.rms for x in earlier), default=np.inf)
    was_finished = previous is not None and previous.finished
    setbacks += min(x.rms for x in new) * USEFUL_FACTOR > smallest_before and not was_finished
    bounds = _bounds_of_step(set_points, runs[0].q)
    change = estimate.steps * (estimate.q - best.q)
    for k in range(setbacks, setbacks + TRIALS):
        requested = best.q + SETBACK_STEP**k * change
        q, reason = _keep_limits(requested, best.q, set_points.cycle, bounds)
        predicted, worst = estimate.predict(lifted.respond(q - best.q))
        is_safe = worst <= MAX_GROWTH * best.rms
        if useful := is_safe and predicted * USEFUL_FACTOR < estimate.repeats:
            break
    end = _reason_to_finish(lifted, runs, estimate, setbacks)
    if not (end or useful):
        end = f"no change reduces the error by more than {USEFUL_FACTOR - 1:.0%}"
        if not is_safe:
            unproven = best.rms > PROVEN_SHARE * runs[0].rms
            remedy = ", so identify the servo" if unproven else ""
            reason = f"the model of the servo is not exact enough{remedy}"
        end += f", because {reason}" if reason else ""
    return LearningResult(
        cycle=set_points.cycle, q=best.q if end else q, trajectory=set_points.trajectory,
        method="learning", start_time=set_points.start_time, rule=set_points.rule,
        servo=lifted.nominal.servo, lifted=lifted, runs=runs, best=estimate.best,
        repeats=estimate.repeats, noise=estimate.noise, setbacks=setbacks, finished=bool(end),
        reason=end or reason, model=chosen.model,
    )  # fmt: skip


def _reason_to_finish(
    lifted: Lifted, runs: tuple[LearningRun, ...], estimate: ErrorEstimate, setbacks: int
) -> str:
    """Return the reason why another run may not reduce the error; empty if it may."""
    if estimate.count == len(runs) and (contradiction := _contradiction(lifted, runs[0])):
        return contradiction
    if estimate.is_noise:
        return "the remaining error is noise"
    if setbacks < MAX_SETBACKS:
        return ""
    reason = f"{setbacks} changes did not reduce the error by {USEFUL_FACTOR - 1:.0%}"
    unproven = runs[estimate.best].rms > PROVEN_SHARE * runs[0].rms
    return f"{reason}, so identify the servo" if unproven else reason


class Misfit(NamedTuple):
    """RMS deviations of the joints in a run, without constant ones [rad], (dof,) each."""

    model: FloatArray  # Deviations from the simulation with the servo
    lag: FloatArray  # Deviations from the set-points

    @property
    def ratios(self) -> FloatArray:
        """Deviations from the simulation relative to those from the set-points, (dof,)."""
        return np.asarray(self.model / np.maximum(self.lag, LEAST_LAG * self.lag.max()))

    @property
    def largest(self) -> float:
        """Largest ratio of a joint."""
        return float(np.max(self.ratios))


def _compare(lifted: Lifted, set_points: SetPoints, recording: Recording) -> Misfit:
    """Compare a recording with the simulation of its set-points."""
    measured = log_alignment.align(recording, lifted, set_points).measured
    return _find_misfit(lifted, set_points.q, measured)


def _find_misfit(lifted: Lifted, q: FloatArray, measured: FloatArray) -> Misfit:
    """Return how measured positions deviate from the simulation of set-points q.

    - `q`: set-points [rad], (count, dof).
    - `measured`: positions at the model's times [rad], (n, dof).
    """
    # Constant deviations, such as from gravity, are no errors of the servo.
    times = np.asarray(lifted.start + lifted.cycle * np.arange(lifted.count), dtype=float)
    misfit = (measured - lifted.expected(q)).std(axis=0)
    lag = (measured - interpolate(lifted.t, times, q)).std(axis=0)
    return Misfit(misfit, lag)


def _contradiction(lifted: Lifted, run: LearningRun) -> str:
    """Return the reason to identify the servo before learning; empty if the log agrees with it."""
    measured = lifted.planned + run.error
    if not _find_misfit(lifted, run.q, measured).largest > MAX_MISFIT:
        return ""
    described = _describe_contradiction(lifted, run.q, measured, run)
    return f"{described}. Identify the servo first"


def _describe_contradiction(
    lifted: Lifted, q: FloatArray, measured: FloatArray, run: LearningRun | Recording
) -> str:
    """Return a clause on the joint that contradicts the servo most."""
    misfit = _find_misfit(lifted, q, measured)
    j = int(np.argmax(misfit.ratios))
    unit = shared_unit("mrad", lifted.prismatic[j : j + 1])
    return (
        f"{run.source} contradicts the servo: joint {j + 1} deviates by "
        f"{misfit.model[j] * 1e3:.3g} {unit} RMS from the simulation with {lifted.nominal.model}, "
        f"but by {misfit.lag[j] * 1e3:.3g} {unit} from its set-points"
    )


def _bounds_of_step(set_points: SetPoints, first_run: FloatArray) -> FloatArray:
    """Return the bounds of the next set-points and of their derivatives, (4, 2, dof).

    They are those of the set-points, except limits that the set-points already exceed. Besides,
    set-points may not accelerate faster than the plan's limit, or than ACCELERATION_FACTOR times
    those of the first run.

    - `first_run`: set-points of the first run [rad], (n, dof).
    """
    rule = set_points.rule
    bounds = rule.at_cycle(set_points.cycle).copy()
    for excess in set_points.use.excesses:
        bounds[BY_ORDER.index("" if excess.is_range else excess.limit)] = NO_BOUND
    executed = np.abs(differences(first_run, 2)).max(axis=0) / set_points.cycle**2
    acceleration = ACCELERATION_FACTOR * np.maximum(executed, RESTING_SHARE * executed.max())
    limit = np.abs(rule.plan[2]).min(axis=0)
    acceleration = np.where(np.isfinite(limit), np.maximum(limit, acceleration), acceleration)
    bounds[2, 0] = np.maximum(bounds[2, 0], -acceleration)
    bounds[2, 1] = np.minimum(bounds[2, 1], acceleration)
    return bounds


def _keep_limits(
    requested: FloatArray, best: FloatArray, cycle: float, bounds: FloatArray
) -> tuple[FloatArray, str]:
    """Return the nearest set-points within bounds, (n, dof), and a clause on the active limit.

    The clause is empty if no limit is active. A joint without a solution keeps the set-points of
    the best run.

    - `requested`, `best`: requested set-points and those of the best run [rad], (n, dof).
    - `cycle`: cycle [s].
    - `bounds`: bounds of the set-points and their derivatives, (4, 2, dof).
    """
    excess = find_excess(requested, cycle, bounds)
    if excess is None:
        return requested, ""
    name = excess.name if excess.order else "range"
    q = nearest_commands(requested, cycle, bounds, best)[0]
    words = name.removeprefix("joint_").replace("_", " ")
    remedy = "plan with a larger reserve" if excess.order else "move the path away from it"
    return q, (
        f"the {words} of the set-points of joint {excess.joint + 1} limits the step, so {remedy}"
    )
