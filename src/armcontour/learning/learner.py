"""Public functions `learn`: set-points for the next run; `judge_run`: the errors of a run alone."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.errors import CompensationError
from armcontour.learning.aligning import Clock, fit_clock, fit_delay, set_points_off
from armcontour.learning.diagnosing import refuse_coarse, refuse_other_set_points, refuse_unlike
from armcontour.learning.estimating import (
    UNTESTED,
    Estimate,
    choose_penalty,
    loop_noise,
    unexplained,
    white_noise,
)
from armcontour.learning.judging import Judge
from armcontour.learning.lesson import JudgedRun, LearnedRun, Lesson, TransferredData
from armcontour.learning.lifted import Lifted, Nominal
from armcontour.learning.recording import Recording, record
from armcontour.learning.tracking import add_tool
from armcontour.motion import Execution, Log, TaughtData
from armcontour.motion.command_limits import refuse_commands
from armcontour.servo import ServoModel

# Learning ends after this many setbacks; each halves the step and forbids changes that are ten
# times as slow.
MOST_SETBACKS = 3
HALF, SLOWER = 0.5, 100.0
# A joint whose set-points would exceed a limit gets this share of its change, again and again; of
# less than NO_STEP it gets none.
SHORTER, NO_STEP = 0.8, 1e-6
# With less noise than the model is off, dead time is looked for with this penalty.
TO_FIND_DELAY = 1e-2
# A run is worse than another one, not noisy, by this many standard deviations.
SURE = 3.0


def learn(
    taught: TaughtData,
    executed: Execution | Log | Recording,
    *,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None = None,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> Lesson:
    """Set-points for the next run, from those of the last run and what the joints did.

    Give the lesson that this returns, and the log of its run, for the run after it.

    Args:
        taught: The set-points of the last run: a `Lesson` with the runs before it, or other taught
            data for the first run.
        executed: What the joints did: an execution, a log with set-points, from which the clock is
            found, or a recording of joint positions alone.
        arm: The nominal arm. If it has masses, and the servo is of second order, the model is one
            of rigid bodies; otherwise of its servos alone.
        servo: The nominal servo.
        limits: Limits of the controller, as in `compensate`; by default they are not checked.
        gravity_feedforward: Whether the controller adds the torque against gravity.
        known: The arm as its controller knows it, if `arm` has what was found since, as a payload.
        tool: Times [s], (m,), and measured positions of the tool point in the frame of the path
            [m], (m, dimension), from a tracker. With an execution the times are those of its plan;
            otherwise the tracker has a clock of its own, and a tool that is late on its whole way
            cannot be told from a clock that is off. Give it for every run or for none.

    Raises:
        InvalidInput: The log is not of this taught data, or not fit to learn from.
        CompensationError: The set-points of the last run exceed the limits.
    """
    nominal = _nominal(arm, servo, gravity_feedforward, known)
    lifted, judge, taught, run, _ = _see(taught, executed, nominal, tool)
    refuse_other_set_points(run)
    before = taught.runs if isinstance(taught, Lesson) else ()
    return _next_lesson(taught, (*before, run), lifted, judge, limits)


def judge_run(
    taught: TaughtData,
    executed: Execution | Log | Recording,
    *,
    arm: Arm,
    servo: ServoModel,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> JudgedRun:
    """Judge a run by its log as `learn` does, and learn nothing from it.

    Args:
        taught: The set-points of the run.
        executed: What the joints did.
        arm: The nominal arm.
        servo: The nominal servo.
        gravity_feedforward: Whether the controller adds the torque against gravity.
        known: The arm as its controller knows it.
        tool: Measured positions of the tool, as `learn` takes them.

    Raises:
        InvalidInput: The log is not of this taught data, or not fit to be judged.
    """
    nominal = _nominal(arm, servo, gravity_feedforward, known)
    lifted, _, _, run, smooth = _see(taught, executed, nominal, tool)
    return JudgedRun(
        run=run,
        t=lifted.t,
        q=lifted.planned + run.error,
        smooth=lifted.planned + smooth,
        delay=lifted.delay,
    )


def _nominal(arm: Arm, servo: ServoModel, gravity_feedforward: bool, known: Arm | None) -> Nominal:
    """The nominal robot."""
    return Nominal(
        arm=arm, servo=servo.for_joints(arm.dof),
        gravity_feedforward=gravity_feedforward, known=known,
    )  # fmt: skip


def _see(
    taught: TaughtData,
    executed: Execution | Log | Recording,
    nominal: Nominal,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> tuple[Lifted, Judge, TaughtData, LearnedRun, FloatArray]:
    """A run as learning sees it: its model, judge, set-points, errors, and those without noise."""
    recording = record(executed, taught)
    lifted, clock, taught = _align(taught, recording, nominal)
    judge = Judge(nominal.arm, taught.trajectory, lifted.t, lifted.planned)
    run, smooth = _judge_run(lifted, judge, taught, recording, clock, tool)
    return lifted, judge, taught, run, smooth


def _align(
    taught: TaughtData, recording: Recording, nominal: Nominal
) -> tuple[Lifted, Clock, TaughtData]:
    """The model, the recording's clock, and the taught data with times as the robot has them.

    A robot that is later than its model by whole command intervals gets its set-points earlier by
    these: only their times in the plan change.
    """
    known = taught.lifted if isinstance(taught, Lesson) else None
    told = taught.delay if isinstance(taught, Lesson | TransferredData) else None
    lifted = Lifted(taught, nominal, told or 0.0) if known is None else known
    refuse_coarse(recording, lifted)
    clock = fit_clock(recording, lifted, taught.q)
    expected = lifted.expected(taught.q)
    refuse_unlike(recording, clock, lifted, expected)
    knows_time = recording.in_plan_time or recording.command is not None
    if told is not None or not knows_time:
        return lifted, clock, taught
    measured = lifted.at_times(clock.plan_time(recording.t), recording.q, expected)
    noise = white_noise(recording.q - lifted.between(clock.plan_time(recording.t), expected))
    variance = float(np.mean(unexplained(noise, measured - lifted.planned)))
    penalty = TO_FIND_DELAY
    if np.mean(noise**2) > variance / 2:
        penalty = max(penalty, choose_penalty(lifted, measured - expected, variance))
    delay = fit_delay(lifted, measured, partial(lifted.expected, taught.q), penalty)
    earlier = start_early(taught, delay)
    if earlier is taught:
        return lifted.with_delay(delay), clock, taught
    clock = Clock(clock.offset + earlier.start_time - taught.start_time, clock.rate)
    return Lifted(earlier, nominal, delay), clock, earlier


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
    clock: Clock,
    tool: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> tuple[LearnedRun, FloatArray]:
    """Errors of a run, and those of the joints without noise [rad], (n, dof)."""
    expected = lifted.expected(taught.q)
    t = clock.plan_time(recording.t)
    error = lifted.at_times(t, recording.q, expected) - lifted.planned
    noise = white_noise(recording.q - lifted.between(t, expected))
    in_loop = loop_noise(lifted, recording, lifted.planned + error - expected, noise)
    # Noise of samples that are further apart than the model's times counts for all of these.
    noise *= np.sqrt(max(recording.interval * clock.rate / lifted.step, 1.0))
    if tool is not None:
        error, more = add_tool(tool, lifted, error, clock if recording.in_plan_time else None)
        noise = np.hypot(noise, more)
    variance = float(np.mean(unexplained(noise, error)))
    smooth = lifted.smooth(error, choose_penalty(lifted, error, variance))
    found = judge.judge(smooth)
    last = taught if isinstance(taught, Lesson) else None
    judged = LearnedRun(
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
        bound=None if last is None else last.bound,
        set_points_off=set_points_off(recording, clock, taught),
        source=recording.source,
    )
    return judged, smooth


def _next_lesson(
    taught: TaughtData,
    runs: tuple[LearnedRun, ...],
    lifted: Lifted,
    judge: Judge,
    limits: Limits | None,
) -> Lesson:
    """The lesson after all runs."""
    known = Estimate(lifted, judge, runs)
    best = runs[known.best]
    setbacks = taught.setbacks if isinstance(taught, Lesson) else 0
    before = min((x.rms for x in runs[:-1]), default=np.inf)
    repeated = isinstance(taught, Lesson) and taught.finished
    if runs[-1].rms > before + SURE * known.resolution and not repeated:
        setbacks += 1
    change, response = lifted.correct(known.error, known.penalty * SLOWER**setbacks)
    step = HALF**setbacks * (known.step if len(runs) > 1 else 1.0)
    change = step * (known.q - best.q + change)
    share, reason = keep_limits(taught, best.q, change, limits)
    left = judge.judge(max(known.off, UNTESTED) * response).rms
    rest = 1 - float(share.min()) * step
    predicted = min(float(np.hypot(left + rest * best.rms, known.noise)), best.rms)
    bound = best.rms + SURE * known.resolution
    finished = best.rms - known.noise < known.resolution or setbacks >= MOST_SETBACKS
    if finished:
        reason = (
            f"{setbacks} changes made the error larger"
            if setbacks >= MOST_SETBACKS
            else "what remains is noise"
        )
        predicted = best.rms
    return Lesson(
        period=taught.period,
        q=best.q if finished else best.q + share * change,
        trajectory=taught.trajectory,
        method="learning",
        start_time=taught.start_time,
        runs=runs,
        delay=lifted.delay,
        predicted=predicted,
        bound=bound,
        noise=known.noise,
        setbacks=setbacks,
        finished=finished,
        reason=reason,
        lifted=lifted,
    )


def keep_limits(
    taught: TaughtData, q: FloatArray, change: FloatArray, limits: Limits | None
) -> tuple[FloatArray, str]:
    """The share of each joint's change that keeps the limits, (dof,), and why it is not all of it.

    Args:
        taught: The set-points of the last run.
        q: The set-points that are changed [rad], (n, dof).
        change: Their change [rad], (n, dof).
        limits: Limits of the controller.

    Raises:
        CompensationError: The set-points exceed the limits before the change.
    """
    share = np.ones(q.shape[1])
    if limits is None:
        return share, ""
    own = limits.for_joints(q.shape[1])
    plain = TaughtData(
        period=taught.period, q=q, trajectory=taught.trajectory, method=taught.method,
        start_time=taught.start_time,
    )  # fmt: skip
    refuse_commands(plain, own)
    reason = ""
    while True:
        try:
            refuse_commands(replace(plain, q=q + share * change), own)
            return share, reason
        except CompensationError as error:
            assert error.joint is not None
            reason = f"the {error.limit} of joint {error.joint} bounds the step"
            j = error.joint - 1
            share[j] = share[j] * SHORTER if share[j] > NO_STEP else 0.0
