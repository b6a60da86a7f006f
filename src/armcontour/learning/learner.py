"""Public functions `learn`: set-points for the next run; `judge_run`: the errors of a run alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.errors import CompensationError, InvalidInput
from armcontour.learning.aligning import Clock, fit_clock, set_points_off
from armcontour.learning.diagnosing import refuse_coarse, refuse_other_set_points, refuse_unlike
from armcontour.learning.estimating import (
    UNTESTED,
    Estimate,
    loop_noise,
    smooth_error,
    unexplained,
    white_noise,
)
from armcontour.learning.judging import Judge
from armcontour.learning.lesson import LearnedRun, Lesson
from armcontour.learning.lifted import Lifted, Nominal
from armcontour.learning.recording import Recording, record
from armcontour.learning.servo_fit import fit_servo
from armcontour.learning.tracking import add_tool
from armcontour.motion import Execution, Log, TaughtData
from armcontour.motion.command_limits import SLACK, refuse_commands
from armcontour.servo import ServoModel

# What the joints did in a run.
Executed: TypeAlias = Execution | Log | Recording

# Learning ends after this many setbacks; each halves the step and forbids changes that are ten
# times as slow.
MOST_SETBACKS = 3
HALF, SLOWER = 0.5, 100.0
# A joint whose set-points would exceed a limit gets this share of its change, again and again; of
# less than NO_STEP it gets none.
SHORTER, NO_STEP = 0.8, 1e-6
# Set-points may accelerate so many times as much as before learning, where this is above the limit
# of the joint; smoother corrections, with a larger penalty, are tried before shorter ones.
ROUGHER = 2.0
SMOOTHINGS, SMOOTHER = 5, 10.0
# Learning ends at a setback if the effect of the last change is off by more than this share.
MOST_OFF = 1.0
# A run is worse than another one, not noisy, by this many standard deviations.
SURE = 3.0


def learn(
    taught: TaughtData,
    executed: Executed | Sequence[Executed],
    *,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None = None,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> Lesson:
    """Set-points for the next run, from those of the last run and what the joints did.

    Give the lesson that this returns, and the log of its run, for the run after it. Logs of several
    runs of the same set-points show which errors repeat; after three runs of learned set-points
    these are known, too.

    Args:
        taught: The set-points of the last run: a `Lesson` with the runs before it, or other taught
            data for the first run.
        executed: What the joints did: an execution, a log with set-points, from which the clock is
            found, or a recording of joint positions alone; or several of these.
        arm: The nominal arm. If it has masses, and the servo is of second order, the model is one
            of rigid bodies; otherwise of its servos alone.
        servo: The nominal servo.
        limits: Limits of the controller, as in `compensate`; by default they are not checked.
        gravity_feedforward: Whether the controller adds the torque against gravity.
        known: The arm as its controller knows it, if `arm` has what was found since, as a payload.
        tool: Times [s], (m,), and measured positions of the tool point in the frame of the path
            [m], (m, dimension), from a tracker. With an execution the times are those of its plan;
            otherwise the tracker has a clock of its own, and a tool that is late on its whole way
            cannot be told from a clock that is off. Give it for every run, of one log each, or for
            none.

    Raises:
        InvalidInput: The log is not of this taught data, or not fit to learn from.
        CompensationError: The set-points of the last run exceed the limits.
    """
    nominal = _nominal(arm, servo, gravity_feedforward, known)
    seen = _see(taught, executed, nominal, tool)
    for run in seen.runs:
        refuse_other_set_points(run)
    lesson = _next_lesson(seen, limits)
    return replace(lesson, delay=more_delay(lesson.servo, nominal.servo), misfits=seen.misfits)


def judge_run(
    taught: TaughtData,
    executed: Executed | Sequence[Executed],
    *,
    arm: Arm,
    servo: ServoModel,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> Lesson:
    """Judge runs by their logs as `learn` does, and learn nothing from them.

    Args:
        taught: The set-points of the runs.
        executed: What the joints did.
        arm: The nominal arm.
        servo: The nominal servo.
        gravity_feedforward: Whether the controller adds the gravity torque.
        known: The arm as its controller knows it.
        tool: Measured positions of the tool, as `learn` takes them.

    Returns:
        A finished lesson of these runs alone, with the set-points of `taught`.

    Raises:
        InvalidInput: The log is not of this taught data, or not fit to be judged.
    """
    nominal = _nominal(arm, servo, gravity_feedforward, known)
    seen = _see(taught, executed, nominal, tool)
    estimate = Estimate(seen.lifted, seen.judge, seen.runs)
    return _lesson(
        seen, estimate, seen.runs, q=taught.q, finished=True, reason="learned nothing",
        predicted=estimate.expected, delay=more_delay(seen.lifted.nominal.servo, nominal.servo),
    )  # fmt: skip


def _nominal(arm: Arm, servo: ServoModel, gravity_feedforward: bool, known: Arm | None) -> Nominal:
    """The nominal robot."""
    return Nominal(
        arm=arm, servo=servo.for_joints(arm.dof),
        gravity_feedforward=gravity_feedforward, known=known,
    )  # fmt: skip


class _Seen(NamedTuple):
    """Runs as learning sees them, with times as the robot has them."""

    taught: TaughtData
    lifted: Lifted
    judge: Judge
    misfits: tuple[float, float]
    runs: tuple[LearnedRun, ...]


def _see(
    taught: TaughtData,
    executed: Executed | Sequence[Executed],
    nominal: Nominal,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> _Seen:
    """Runs as learning sees them.

    Raises:
        InvalidInput: There is no log, or positions of a tool with several.
    """
    logs = executed if isinstance(executed, (list, tuple)) else (executed,)
    if not logs or (tool is not None and len(logs) > 1):
        raise InvalidInput(
            f"learn needs one log for positions of the tool, and at least one without: {len(logs)} "
            "are given."
        )
    lifted, taught, misfits = _model(taught, [record(x, taught) for x in logs], nominal)
    judge = Judge(nominal.arm, taught.trajectory, lifted.t, lifted.planned)
    runs = tuple(_judge_run(lifted, judge, taught, record(x, taught), tool) for x in logs)
    return _Seen(taught, lifted, judge, misfits, runs)


def _model(
    taught: TaughtData, recordings: list[Recording], nominal: Nominal
) -> tuple[Lifted, TaughtData, tuple[float, float]]:
    """The model, the taught data with times as the robot has them, and misfits.

    The servo is fitted to the mean of the first logs. A robot with more dead time than its model,
    by whole command intervals, gets its set-points earlier by these: only their times in the plan
    change.
    """
    lesson = taught if isinstance(taught, Lesson) else None
    if lesson is not None:
        nominal = replace(nominal, servo=lesson.servo)
    known = None if lesson is None else lesson.lifted
    lifted = Lifted(taught, nominal) if known is None else known
    if lesson is not None:
        return lifted, taught, lesson.misfits
    errors, noises = [], []
    for recording in recordings:
        clock, expected = _fit(recording, lifted, taught)
        if not recording.in_plan_time and recording.command is None:
            return lifted, taught, (0.0, 0.0)
        at = clock.plan_time(recording.t)
        noises.append(white_noise(recording.q - lifted.between(at, expected)))
        errors.append(lifted.at_times(at, recording.q, expected) - expected)
    lead = lifted.reaching(taught.q) - lifted.planned
    variance = float(np.mean(unexplained(np.mean(noises, axis=0), lead)))
    servo, misfits = fit_servo(taught, lifted, np.mean(errors, axis=0), variance)
    taught = start_early(taught, more_delay(servo, nominal.servo))
    return Lifted(taught, replace(nominal, servo=servo)), taught, misfits


def _fit(recording: Recording, lifted: Lifted, taught: TaughtData) -> tuple[Clock, FloatArray]:
    """The clock of a recording that fits the expected motion, and that motion [rad], (n, dof)."""
    refuse_coarse(recording, lifted)
    clock = fit_clock(recording, lifted, taught.q)
    expected = lifted.expected(taught.q)
    refuse_unlike(recording, clock, lifted, expected)
    return clock, expected


def more_delay(servo: ServoModel, nominal: ServoModel) -> float:
    """Dead time of a servo beyond that of the nominal one [s]."""
    return float((servo.dead_time - nominal.dead_time).max())


def start_early(taught: TaughtData, delay: float) -> TaughtData:
    """Taught data that starts earlier by the whole command intervals in a dead time.

    Args:
        taught: Taught data.
        delay: Dead time that its model lacks [s].
    """
    early = max(int(delay / taught.period), 0) * taught.period
    return replace(taught, start_time=taught.start_time - early) if early else taught


def _judge_run(
    lifted: Lifted,
    judge: Judge,
    taught: TaughtData,
    recording: Recording,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> LearnedRun:
    """Errors of a run."""
    clock, expected = _fit(recording, lifted, taught)
    t = clock.plan_time(recording.t)
    error = lifted.at_times(t, recording.q, expected) - lifted.planned
    noise = white_noise(recording.q - lifted.between(t, expected))
    in_loop = loop_noise(lifted, recording, lifted.planned + error - expected, noise)
    # Noise of samples that are further apart than the model's times counts for all of these.
    noise *= np.sqrt(max(recording.interval * clock.rate / lifted.step, 1.0))
    if tool is not None:
        error, more = add_tool(tool, lifted, error, clock if recording.in_plan_time else None)
        noise = np.hypot(noise, more)
    smooth = smooth_error(lifted, error, noise)
    found = judge.judge(smooth)
    last = taught if isinstance(taught, Lesson) else None
    return LearnedRun(
        q=taught.q,
        error=error,
        noise=noise,
        loop_noise=in_loop,
        joint_rms=np.sqrt((smooth**2).mean(axis=0)),
        joint_max=np.abs(smooth).max(axis=0),
        tool_rms=found.tool_rms,
        tool_max=found.tool_max,
        contour_rms=found.contour_rms,
        contour_max=found.contour_max,
        offset=clock.offset,
        rate=clock.rate,
        predicted=None if last is None else last.predicted,
        set_points_off=set_points_off(recording, clock, taught),
        source=recording.source,
    )


def _next_lesson(seen: _Seen, limits: Limits | None) -> Lesson:
    """The lesson after all runs."""
    taught, lifted, judge = seen.taught, seen.lifted, seen.judge
    last = taught if isinstance(taught, Lesson) else None
    earlier = () if last is None else last.runs
    runs = (*earlier, *seen.runs)
    known = Estimate(lifted, judge, runs)
    best = runs[known.best]
    setbacks = 0 if last is None else last.setbacks
    before = min((x.rms for x in earlier), default=np.inf)
    now = float(np.sqrt(np.mean([x.rms**2 for x in seen.runs])))
    is_setback = now > before + SURE * known.resolution and not (last and last.finished)
    setbacks += is_setback
    step = HALF**setbacks * (known.step if earlier else 1.0)
    fastest = allowed_accelerations(runs[0].q, taught.period, limits)
    penalty = known.penalty * SLOWER**setbacks
    for _ in range(SMOOTHINGS):
        change, response = lifted.correct(known.error, penalty)
        change = step * (known.q - best.q + change)
        share, reason = keep_limits(taught, best.q, change, limits, fastest)
        if "acceleration" not in reason:
            break
        penalty *= SMOOTHER
    left = judge.judge(max(known.off, UNTESTED) * response).rms
    left += (1 - float(share.min()) * step) * known.repeats
    predicted = float(np.linalg.norm([left, known.differs / np.sqrt(len(runs)), known.noise]))
    finished, averaged = True, False
    if known.is_noise:
        reason, averaged = "what remains is noise", known.differs > 0
    elif setbacks >= MOST_SETBACKS:
        reason = f"{setbacks} changes made the error larger"
    elif is_setback and known.off > MOST_OFF:
        reason = (
            f"the last change made the error larger, and its effect differs by {known.off:.0%} "
            "from that of the servo model, so identify the servo"
        )
    else:
        finished = False
    q = best.q if finished and not averaged else best.q + share * change
    expected = known.expected if finished else min(predicted, known.expected)
    return _lesson(
        seen, known, runs, q=q, method="learning", predicted=expected, setbacks=setbacks,
        finished=finished, reason=reason,
    )  # fmt: skip


def _lesson(seen: _Seen, known: Estimate, runs: tuple[LearnedRun, ...], **values: Any) -> Lesson:
    """A lesson of runs; with the values that differ."""
    taught = seen.taught
    own = {"method": taught.method, **values}
    return Lesson(
        period=taught.period, trajectory=taught.trajectory, start_time=taught.start_time,
        runs=runs, servo=seen.lifted.nominal.servo, noise=known.noise, best=known.best,
        repeats=known.repeats, lifted=seen.lifted, **own,
    )  # fmt: skip


def allowed_accelerations(q: FloatArray, period: float, limits: Limits | None) -> FloatArray:
    """Largest acceleration of the set-points of each joint [rad/s²], (dof,).

    It is the limit of the joint, or so many times that of the set-points before learning if this
    is more.

    Args:
        q: The set-points before learning [rad], (n, dof).
        period: Command interval [s].
        limits: Limits of the controller.
    """
    own = None if limits is None else limits.for_joints(q.shape[1]).joint_acceleration
    return np.maximum(0.0 if own is None else own, ROUGHER * _accelerations(q, period))


def _accelerations(q: FloatArray, period: float) -> FloatArray:
    """Largest acceleration of set-points of each joint [rad/s²], (dof,)."""
    return np.asarray(np.abs(np.diff(q, 2, axis=0)).max(axis=0, initial=0.0) / period**2)


def keep_limits(
    taught: TaughtData,
    q: FloatArray,
    change: FloatArray,
    limits: Limits | None,
    fastest: FloatArray,
) -> tuple[FloatArray, str]:
    """The share of each joint's change that keeps the limits, (dof,), and why it is not all of it.

    Args:
        taught: The set-points of the last run.
        q: The set-points that are changed [rad], (n, dof).
        change: Their change [rad], (n, dof).
        limits: Limits of the controller.
        fastest: As `allowed_accelerations` gives it.

    Raises:
        CompensationError: The set-points exceed the limits before the change.
    """
    share, reason = np.ones(q.shape[1]), ""
    own = (limits or Limits()).for_joints(q.shape[1])
    plain = TaughtData(
        period=taught.period, q=q, trajectory=taught.trajectory, method=taught.method,
        start_time=taught.start_time,
    )  # fmt: skip
    refuse_commands(plain, own)
    while True:
        found = q + share * change
        rough = _accelerations(found, taught.period) > fastest * (1 + SLACK)
        try:
            refuse_commands(replace(plain, q=found), own)
            if not rough.any():
                return share, reason
            name, j = "acceleration", int(np.argmax(rough))
        except CompensationError as error:
            assert error.joint is not None
            name, j = str(error.limit), error.joint - 1
        reason = f"the {name} of the set-points of joint {j + 1} limits the step"
        share[j] = share[j] * SHORTER if share[j] > NO_STEP else 0.0
