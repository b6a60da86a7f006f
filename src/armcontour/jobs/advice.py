"""`advise`: finds changes of a run that save most time or lead to a positive verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import floor, inf, log10
from types import MappingProxyType
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.render import digits_and_unit, number
from armcontour.jobs.command_velocity import set_point_lead
from armcontour.jobs.job import CURVATURE, TANGENT, Job, Run, default_compensation
from armcontour.jobs.program_points import choose_points
from armcontour.jobs.rows import ASSIGNED, weave_speed
from armcontour.jobs.run_job import (
    compute_set_points,
    expect_errors,
    simulate_experiment,
    with_program,
)
from armcontour.jobs.run_plan import plan_one
from armcontour.jobs.run_record import Advice, Improvement
from armcontour.jobs.run_result import JobResult, RunResult
from armcontour.jobs.verdict import EXPECTED, Errors, judging_executions
from armcontour.motion import Method
from armcontour.motion.set_point_rule import ACCELERATION
from armcontour.planning import Optimal
from armcontour.planning.explanation import DWELLS, RAPIDS
from armcontour.robot.limits import LIMITS, or_unlimited
from armcontour.verification import evaluate

# Maximum number of listed changes.
MAX_CHANGES = 3
# At most this number of groups of changes is tried.
MAX_PLANNED_CHANGES = 6
# A limit, or the travel speed of a weave, is multiplied by this factor.
LIMIT_FACTOR = 1.2
# Factor by which a corner tolerance is increased.
TOLERANCE_FACTOR = 2.0
# Minimum fraction of the duration that a listed change saves.
MIN_SAVING = 2e-3
# Factors of the assigned velocity that are tried to repair a run, the smallest change first.
SPEED_FACTORS = (0.8, 0.6, 0.4, 0.2)
# Factors of the pitch of a weave that are tried to repair a run, the smallest change first.
PITCH_FACTORS = (1.25, 1.6, 2.5)
# Reserves for the servo that are tried to repair a run, as fractions of acceleration, the smallest
# change first.
RESERVES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4)
# Limits of jerk that are tried to repair a run, as multiples of the limit with which the
# acceleration of set-points certainly stays within its limit, the smallest change first.
JERK_FACTORS = (3.0, 2.4, 2.0, 1.6, 1.45, 1.3, 1.0)
# If set-points may accelerate less than the plan times TIGHT_COMMAND, limits of jerk need at least
# the reserve TIGHT_RESERVE.
TIGHT_COMMAND = 1.5
TIGHT_RESERVE = 0.2
# Limited set-points cost too much if they may cause this fraction of the allowed contour error.
COSTLY_SHARE = 0.25
# Minimum reserve for the servo, as a fraction of acceleration.
LEAST_RESERVE = 0.02
# Relative rounding error up to which a value counts as a multiple of a step.
STEP_ROUNDING = 1e-12
# A repair uses this fraction of the accuracy, so that rounding errors do not decide the verdict.
ACCURACY_SHARE = 0.98
# Changes are planned by default if they are predicted to take at most this share of the run's time.
CHANGES_SHARE = 0.25
# Predicted time of a run, in the time to plan and simulate one segment of a change (about 4 ms):
# the start and the report of every run, and the steps for each segment.
START_IN_SEGMENTS = 325
RUN_PER_SEGMENT = 2.0
# Condition of a change that raises the limit of one joint, which protects its drive.
IF_DRIVE = "the drive allows it"
# Condition of a change that raises another limit, or the travel speed of a weave.
IF_PROCESS = "the process allows it"
# Condition of a change that raises the corner tolerance.
IF_PART = "the part allows it"
# Name of the step in progress messages.
ADVICE_STEP = "changes"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    """A change that may be an improvement; `label`, `edits`, `condition`: see `Improvement`."""

    label: str
    edits: tuple[tuple[str, Any], ...]
    job: Job  # Changed job
    run: Run  # Changed run
    expected_saving: float = 0.0  # Estimated fraction of the duration that the change saves
    condition: str = ""
    only_fastest: bool = False  # True if the change is suggested only if no other is faster


def advise(
    job: Job,
    result: RunResult,
    progress: Progress | None = None,
    *,
    most: int = MAX_PLANNED_CHANGES,
) -> Advice:
    """Find the changes of a run that save most time, or that repair a run with a negative verdict.

    At most `most` changes are planned and simulated, those with the largest expected effect.
    """
    report = subprogress(progress)
    # Improvements, and whether each is suggested only if it is the fastest
    helpful = list[tuple[Improvement, bool]]()
    repairs = result.kept is False
    if repairs:
        groups = [*_repairs(job, result)]
        none = (
            "No single change of tolerance, compensation, jerk limit, reserve or speed leads to a "
            "run that is kept."
        )
    else:
        likely = sorted(_savings(job, result), key=lambda x: -x[0].expected_saving)
        groups = likely[:MAX_PLANNED_CHANGES]
        none = (
            "No single change of a limit, of the corners or of the contour order makes the motion "
            "faster."
        )
    smallest = -inf if repairs else MIN_SAVING * result.trajectory.duration
    for k, group in enumerate(planned := groups[:most]):

        def try_change(candidate: _Candidate, done: float = k / len(planned)) -> Improvement | None:
            report(Step((ADVICE_STEP,), done=done))
            tried = _plan_change(candidate, result)
            helps = tried is not None and tried.saved > smallest and tried.kept is not False
            return tried if helps else None

        improvement = _find_smallest(group, try_change)
        if improvement is not None:
            helpful.append((improvement, group[0].only_fastest))
    helpful.sort(key=lambda x: -x[0].saved)
    listed = [x for k, (x, only_fastest) in enumerate(helpful) if k == 0 or not only_fastest]
    suggestions = tuple(listed[:MAX_CHANGES])
    note = "" if suggestions else none
    if most < len(groups):
        note = (
            f"Only {most} of {len(groups)} changes were planned, those with the largest expected "
            "effect. To plan all, press Improve in the Studio, or add --changes to armcontour run."
        )
    return Advice(improvements=suggestions, note=note)


def with_advice(
    job_result: JobResult, progress: Progress | None = None, *, complete: bool = False
) -> JobResult:
    """Add the advice on each run; for a large job only if `complete`."""
    most = MAX_PLANNED_CHANGES if complete else _count_affordable(job_result.job)
    if not most:
        return job_result
    runs = dict(job_result.runs)
    for name, result in job_result.runs.items():
        # The limits that changes would move do not determine the speed of a slow first run.
        if result.trajectory.speed_factor == 1.0:
            changes = advise(job_result.job, result, subprogress(progress, name), most=most)
            runs[name] = replace(result, advice=changes)
    return replace(job_result, runs=MappingProxyType(runs))


def _count_affordable(job: Job) -> int:
    """Return how many changes of each run can be planned in the share CHANGES_SHARE of its time."""
    if any(x.is_shaped for x in job.runs):
        return 0
    segments = sum(len(x.path) for x in job.program.contours) * len(job.runs)
    run_time = START_IN_SEGMENTS + RUN_PER_SEGMENT * segments
    return min(MAX_PLANNED_CHANGES, int(CHANGES_SHARE * run_time / max(segments, 1)))


def _find_smallest(
    group: Sequence[_Candidate], try_change: Callable[[_Candidate], Improvement | None]
) -> Improvement | None:
    """Return the improvement by the smallest change of a group that is successful, by bisection.

    If a change is successful, larger ones are assumed to be successful, too.
    """
    smallest = None
    low = 0
    high = len(group)
    while low < high:
        middle = (low + high - 1) // 2
        tried = try_change(group[middle])
        if tried is None:
            low = middle + 1
        else:
            smallest = tried
            high = middle
    return smallest


def _plan_change(candidate: _Candidate, result: RunResult) -> Improvement | None:
    """Plan and simulate a change; None if that is not possible."""
    try:
        planned = with_program(candidate.job, plan_one(candidate.job, candidate.run))
        set_points = compute_set_points(candidate.job, candidate.run, planned.trajectory)
        planned = replace(planned, set_points=set_points)
        errors = _errors(candidate.job, planned) if planned.sends_set_points else None
        verdict = planned.worst_verdict(errors)
    except ArmContourError:
        return None
    assert verdict.off_drawing is not None
    duration = planned.trajectory.duration
    return Improvement(
        label=candidate.label,
        edits=candidate.edits,
        saved=result.trajectory.duration - duration,
        duration=duration,
        off_drawing=verdict.off_drawing,
        kept=verdict.kept,
        condition=candidate.condition,
    )


def _errors(job: Job, planned: RunResult) -> dict[str, Errors]:
    """Return the largest errors in each execution of the set-points that judges the run."""
    run = planned.run
    errors = dict[str, Errors]()
    for name, experiment in judging_executions(run).items():
        executed = simulate_experiment(job, run, planned.set_points, experiment)
        evaluation = evaluate(
            executed, planned.path, objective=planned.objective, end_time=run.end_time
        )
        errors[name] = Errors.of_evaluation(evaluation)
        if experiment is None and (
            expected := expect_errors(job, run, executed, planned.path, evaluation)
        ):
            errors[EXPECTED] = Errors(contour=expected.contours)
    return errors


def _rounded(value: float) -> float:
    """Round a value down to three significant digits."""
    step = 10.0 ** (floor(log10(value)) - 2)
    # A value that is a multiple of the step except for rounding stays the same.
    steps = floor(value / step * (1 + STEP_ROUNDING))
    return float(f"{steps * step:.3g}")


def _savings(job: Job, result: RunResult) -> Iterator[list[_Candidate]]:
    """Yield groups of changes that may save time; of each, the first successful one counts."""
    run = result.run
    explanation = result.explanation
    if explanation is None or run.duration is not None:
        return
    kinds = explanation.kinds
    joints = {x.name: x.joint for x in explanation.bindings}
    for part in explanation.shares:
        joint = joints.get(part.name)
        for candidate in _raised_limit(job, run, part.kind, joint, part.of_time):
            yield [candidate]
    assigned = kinds.get(ASSIGNED, 0.0)
    cornering = 1 - assigned - sum(kinds.get(x, 0.0) for x in (RAPIDS, DWELLS))
    weaves = chain(
        _faster_weave(job, result, assigned),
        _longer_pitches(job, result, cornering, [LIMIT_FACTOR]),
    )
    corners = _wider_corners(job, result, cornering)
    for candidate in chain(weaves, corners):
        yield [candidate]
    if run.timing.reserve > LEAST_RESERVE:
        # The smallest reserve is tried first, because it saves most if the servo can follow.
        reserves = sorted({LEAST_RESERVE, max(_rounded(run.timing.reserve / 2), LEAST_RESERVE)})
        share = (1 - assigned) / 2
        yield [_change_reserve(job, run, x, (run.timing.reserve - x) * share) for x in reserves]
    if len(job.program.contours) > 2 and job.process.order != "shortest":
        process = replace(job.process, order="shortest")
        yield [
            _Candidate(
                label="Order the contours by the shortest rapids",
                edits=(("process.order", "shortest"),),
                job=replace(job, process=process),
                run=run,
                expected_saving=kinds.get(RAPIDS, 0.0) / 3,
            )
        ]


def _faster_weave(job: Job, result: RunResult, share: float) -> Iterator[_Candidate]:
    """Yield a change to a higher travel speed of the weave, if `limits.speed` permits it."""
    weave = job.process.weave
    if weave is None or weave.speed is None or weave_speed(result) is None:
        return
    new = _rounded(weave.speed * LIMIT_FACTOR)
    process = replace(job.process, weave=replace(weave, speed=new))
    yield _Candidate(
        label=f"Raise the travel speed of the weave {_describe_change(weave.speed, new, 'm/s')}",
        edits=(("process.weave.speed", new),),
        job=replace(job, process=process),
        run=result.run,
        expected_saving=share * (1 - 1 / LIMIT_FACTOR),
        condition=IF_PROCESS,
    )


def _longer_pitches(
    job: Job, result: RunResult, share: float, factors: Sequence[float]
) -> Iterator[_Candidate]:
    """Yield changes to a weave with fewer waves per length, by each of the factors.

    - `share`: fraction of the duration in which the curves of the weave limit the speed.
    """
    weave = job.process.weave
    if weave is None:
        return
    for factor in factors:
        if weave.pitch is not None:
            key = "pitch"
            unit = "m"
            old = weave.pitch
            new = _rounded(old * factor)
        else:
            assert weave.frequency is not None
            key = "frequency"
            unit = "Hz"
            old = weave.frequency
            new = _rounded(old / factor)
        verb = "Raise" if new > old else "Lower"
        yield _Candidate(
            label=f"{verb} the {key} of the weave {_describe_change(old, new, unit)}",
            edits=((f"process.weave.{key}", new),),
            job=replace(job, process=replace(job.process, weave=replace(weave, **{key: new}))),
            run=result.run,
            expected_saving=share * (1 - 1 / factor),
            condition=IF_PROCESS,
        )


def _raised_limit(
    job: Job, run: Run, kind: str, joint: int | None, share: float
) -> Iterator[_Candidate]:
    """Yield a change to a higher limit; of a joint limit, only the value of `joint` changes."""
    record = next((x for x in LIMITS.values() if x.label == kind), None)
    value = None if record is None else getattr(run.limits, record.name)
    if record is None or value is None:
        return
    # Estimated saving: time is proportional to 1 / speed, or to 1 / sqrt(acceleration).
    expected_saving = share * (1 - LIMIT_FACTOR ** (-1 / record.order))
    words = f"the {kind}"
    condition = IF_PROCESS
    raised = np.array(value, dtype=np.float64)
    bounds = raised.reshape(raised.size if joint is None else len(raised), -1)
    limit = bounds[joint or 0]
    old = float(np.abs(limit).min())
    limit[:] = [np.sign(x) * _rounded(abs(x) * LIMIT_FACTOR) for x in limit]
    if joint is not None:
        words = f"joint {joint + 1} {kind}"
        condition = IF_DRIVE
    yield _Candidate(
        label=f"Raise {words} {_describe_change(old, float(np.abs(limit).min()), record.unit)}",
        edits=((f"limits.{record.name}", raised.tolist()),),
        job=job,
        run=replace(
            run, limits=run.limits.replace(**{record.name: raised if raised.ndim else limit[0]})
        ),
        expected_saving=expected_saving,
        condition=condition,
    )


def _describe_change(old: float, new: float, unit: str) -> str:
    """Write both values of a change, such as "from 0.25 to 0.5 mm"."""
    old_digits, old_unit = digits_and_unit(old, unit)
    new_digits, new_unit = digits_and_unit(new, unit)
    old_text = old_digits if old_unit == new_unit else f"{old_digits} {old_unit}"
    return f"from {old_text} to {new_digits} {new_unit}"


def _wider_corners(job: Job, result: RunResult, share: float) -> Iterator[_Candidate]:
    """Yield a change to a larger corner tolerance that the required accuracy allows."""
    old = result.tolerance
    accuracy = result.run.accuracy
    if old is None or result.rounding_error is None:
        return
    new = old * TOLERANCE_FACTOR
    if accuracy is not None:
        new = min(new, ACCURACY_SHARE * accuracy - 2 * _contour_error(result))
    if new > old * (1 + MIN_SAVING):
        yield _change_tolerance(job, result.run, _rounded(new), share / 5)


def _change_tolerance(job: Job, run: Run, new: float, expected_saving: float = 0.0) -> _Candidate:
    """Make the change of the corner tolerance to a new value [m]."""
    rounding = run.rounding
    assert rounding is not None and rounding.tolerance is not None
    verb = "Raise" if new > rounding.tolerance else "Lower"
    return _Candidate(
        label=f"{verb} the corner tolerance {_describe_change(rounding.tolerance, new, 'm')}",
        edits=(("corners.tolerance", new),),
        job=job,
        run=replace(run, rounding=replace(rounding, tolerance=new)),
        expected_saving=expected_saving,
        condition=IF_PART if verb == "Raise" else "",
    )


def _change_reserve(job: Job, run: Run, new: float, expected_saving: float = 0.0) -> _Candidate:
    """Make the change of the reserve for the servo to a new value."""
    old = run.timing.reserve
    return _Candidate(
        label=f"{'Raise' if new > old else 'Lower'} the reserve {_describe_change(old, new, '1')}",
        edits=(("timing.reserve", new),),
        job=job,
        run=replace(run, timing=replace(run.timing, reserve=new)),
        expected_saving=expected_saving,
    )


def _repairs(job: Job, result: RunResult) -> Iterator[list[_Candidate]]:
    """Yield groups of changes that may repair a run; of each, the first successful one counts."""
    run = result.run
    if run.accuracy is not None and result.tolerance is not None:
        tolerance = ACCURACY_SHARE * run.accuracy - 2 * _contour_error(result)
        if 0 < tolerance < result.tolerance:
            yield [_change_tolerance(job, run, _rounded(tolerance))]
    yield from _nearer_points(job, result)
    inverse = default_compensation(job.servo, job.arm, run.experiment)
    if run.compensation.method != inverse.method and result.sends_set_points:
        limits = run.compensation.command_limits
        changed = replace(run, compensation=replace(inverse, command_limits=limits))
        label = f"Compensate the servo by {inverse.method}"
        edits = (("compensation.method", inverse.method),)
        yield [_Candidate(label=label, edits=edits, job=job, run=changed)]
    if weaves := [*_longer_pitches(job, result, 0.0, PITCH_FACTORS)]:
        yield weaves
    if run.timing.method == Method.OPTIMAL:
        yield [_change_reserve(job, run, x) for x in RESERVES if x > run.timing.reserve]
    costly = _costs_too_much(result)
    speed = run.limits.speed
    if speed is not None:
        slower = [_rounded(speed * factor) for factor in SPEED_FACTORS]
        yield [
            _Candidate(
                label=f"Lower the assigned velocity {_describe_change(speed, x, 'm/s')}",
                edits=(("limits.speed", x),),
                job=job,
                run=replace(run, limits=run.limits.replace(speed=x)),
                only_fastest=costly,
            )
            for x in slower
        ]
    # Plans with limits of jerk take longest, so they are the last ones.
    if costly and (with_jerk := [*_limited_jerk(job, result)]):
        yield with_jerk


def _contour_error(result: RunResult) -> float:
    """Return the largest contour error of the executions that judge a run [m]."""
    judged = result.judged
    return max(result.verdict.errors.values()) if judged is None else judged.contour_error.max


def _nearer_points(job: Job, result: RunResult) -> Iterator[list[_Candidate]]:
    """Yield a change of the specified interval of a program's points, if it is too long."""
    allowed = result.verdict.allowed
    old = job.export.cycle
    if result.program is None or old is None or allowed is None:
        return
    new = choose_points(result.trajectory, allowed)
    if new.interval < old and new.largest <= allowed:
        yield [
            _Candidate(
                label=f"Shorten the interval of points {_describe_change(old, new.interval, 's')}",
                edits=(("export.cycle", new.interval),),
                job=replace(job, export=replace(job.export, cycle=new.interval)),
                run=result.run,
            )
        ]


def _costs_too_much(result: RunResult) -> bool:
    """Return whether limits of the set-points cause much of the contour error of a run."""
    cost = result.set_points.limit_cost
    allowed = result.verdict.allowed
    if cost is None or cost.contour_max is None or allowed is None:
        return False
    return cost.contour_max > COSTLY_SHARE * allowed


def _limited_jerk(job: Job, result: RunResult) -> Iterator[_Candidate]:
    """Yield changes to limits of jerk, with corners of continuous curvature.

    Most motion does not need the largest acceleration and the largest jerk at once, so larger
    limits than `_safe_jerk` are tried, too.
    """
    run = result.run
    rounding = run.rounding
    if rounding is None or rounding.free or not isinstance(run.timing, Optimal):
        return
    reserve = run.timing.reserve
    set_points = result.set_points
    command = np.abs(set_points.rule.at_cycle(set_points.cycle)[ACCELERATION]).min(axis=0)
    planned = np.abs(run.limits.acceleration_bounds(job.arm.dof)).max(axis=0)
    words = ""
    edits: list[tuple[str, Any]] = []
    if (command < TIGHT_COMMAND * planned).any() and reserve < TIGHT_RESERVE:
        reserve = TIGHT_RESERVE
        words = f", and raise the reserve {_describe_change(run.timing.reserve, reserve, '1')}"
        edits.append(("timing.reserve", reserve))
    safe = _safe_jerk(command, (1 - reserve) * planned, set_point_lead(job))
    if safe is None:
        return
    if rounding.continuity == TANGENT:
        edits.append(("corners.continuity", CURVATURE))
        rounding = replace(rounding, continuity=CURVATURE)
    old = or_unlimited(run.limits.joint_jerk, job.arm.dof)
    for factor in JERK_FACTORS:
        new = [_rounded(float(x)) for x in np.minimum(factor * safe, old)]
        if np.array_equal(new, old):
            continue
        limits = run.limits.replace(joint_jerk=new)
        timing = replace(run.timing, reserve=reserve)
        yield _Candidate(
            label=f"Limit the jerk of the joints to {number(max(new), 'rad/s³')}{words}",
            edits=(("limits.joint_jerk", new), *edits),
            job=job,
            run=replace(run, limits=limits, timing=timing, rounding=rounding),
        )


def _safe_jerk(command: FloatArray, planned: FloatArray, lead: FloatArray) -> FloatArray | None:
    """Return limits of jerk with which set-points stay within their acceleration [rad/s³], (dof,).

    The set-points `u = q + dq / kp` of a first-order servo accelerate by `ddq + dddq / kp`. They
    stay within C if the plan stays within A and the jerk `kp (C - A)`. None without such limits.

    - `command`, `planned`: C and A [rad/s²], (dof,) each.
    - `lead`: 1 / kp [s], (dof,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        safe = (command - planned) / lead
    return safe if (np.isfinite(safe) & (safe > 0)).all() else None
