"""The command `check`: checks a trajectory file against limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour import files, verification
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Check
from armcontour.cli.console import data_lines
from armcontour.cli.inputs import read_option
from armcontour.core.checks import FloatArray, comparable, raise_if
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.progress import Progress
from armcontour.core.quantities import AngularDistance, AngularRate, Frequency
from armcontour.core.render import plain
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import digits, joint_label, list_some, show
from armcontour.core.yaml_loader import load
from armcontour.files.drawings.path_reader import YAML
from armcontour.files.job_file import read_cell_scene
from armcontour.files.joint_table import TrajectoryFile
from armcontour.files.limits_and_servo_files import MotionRequirements
from armcontour.files.robots.arm_loading import load_arm
from armcontour.jobs import Job, Run, find_resumption, prepare_program, round_program
from armcontour.jobs.job import find_run
from armcontour.jobs.rows import set_point_rows
from armcontour.motion import make_rule
from armcontour.motion.log import FEWEST, Log, raise_other_joints
from armcontour.motion.log_checks import check_range_of_log, refuse_wrapped
from armcontour.motion.log_times import repair_times
from armcontour.motion.time_finding import findings_table
from armcontour.program import Program
from armcontour.robot import Arm
from armcontour.robot.limits import LIMITS
from armcontour.verification import InterpolationCheck
from armcontour.verification.clearance import Clearance, check_clearance
from armcontour.verification.limit_verdict import VERDICTS
from armcontour.verification.repeated_runs import RepeatedRuns, require_equal_durations

# Standard deviation below which scatter counts as rounding, not as noise [rad]. The steps of a
# 32-bit encoder are 1.5e-9 rad.
MIN_NOISE = 1e-9
# Times between set-points may differ by this share, because they are printed with few digits.
UNEVEN_SHARE = 1e-3
# Maximum number of listed column titles.
MAX_TITLES = 8
# Exit codes by verdict; no error has the exit code 7.
EXIT_CODES = {"kept": 0, "violated": 1, "cannot tell": 7}


def check(options: Check, _: None, progress: Progress) -> Outcome:
    """Check a trajectory against limits, and optionally path, cell and controller."""
    job = None if options.path is None else files.read_job(options.path)
    cell_arm, scene = (None, None) if options.scene is None else read_cell_scene(options.scene)
    arm = _arm(options, cell_arm if job is None else job.arm)
    run = None if job is None else _run(job, options)
    if options.set_points:
        raise_if(bool(options.repeat), "--set-points and --repeat exclude each other.")
        return _check_set_points(options, arm, job, run)
    path = None if job is None or run is None else _path(job, run)
    required = _requirements(options, run, arm)
    samples = _samples(options, arm)
    check_samples = partial(
        verification.check,
        arm=arm,
        limits=required.limits,
        path=path,
        deviation=required.deviation,
        orientation_deviation=required.orientation_deviation,
    )
    result = check_samples(samples)
    clearance = None
    if scene is not None:
        # Times are as in the file.
        clearance = check_clearance(samples.straight, arm, scene).later(float(samples.t[0]))
    commands = _check_commands(options, samples, arm, required, path)
    if not result.uses and result.path_deviation is None and clearance is None:
        raise InvalidInput(
            f"There is no limit to check, because the arm {arm.name} has no limits. Specify limits "
            "with --limits."
        )
    data = result.to_data()
    lines = data_lines(replace(data, not_proven=""))
    lines += _remarks(samples, arm, result, clearance, options)
    verdicts = [result.verdict]
    if commands is not None:
        lines += data_lines(commands.to_data())
        verdicts.append(commands.verdict)
    if clearance is not None and not clearance.satisfied:
        verdicts.append("violated")
    repeated = None
    if options.repeat:
        others = [_samples(replace(options, trajectory=x), arm) for x in options.repeat]
        sources = [x.source for x in (samples, *others)]
        require_equal_durations(sources, [(x.t, x.q) for x in (samples, *others)])
        results = [result, *map(check_samples, others)]
        repeated = _repeated_runs(results)
        lines += data_lines(repeated.to_data())
        verdicts += [x.verdict for x in results[1:]]
    lines += filter(None, [data.not_proven])
    page = _page(samples, result, clearance, commands, repeated)
    return Outcome(lines=lines, page=page, code=EXIT_CODES[max(verdicts, key=VERDICTS.index)])


def _repeated_runs(results: Sequence[verification.Check]) -> RepeatedRuns:
    """Return the largest errors of repeated runs."""
    largest = [x.path_deviation.distance for x in results if x.path_deviation is not None]
    if not largest:
        raise InvalidInput(
            "--repeat compares distances from a path, but no path is specified. Specify the job of "
            "the path with --path."
        )
    return RepeatedRuns(largest=np.array(largest))


def _check_set_points(options: Check, arm: Arm, job: Job | None, run: Run | None) -> Outcome:
    """Judge the samples as set-points of a controller.

    Raises:
        InvalidInput: The samples have no regular times.
    """
    limits = _requirements(options, run, arm).limits.over(arm.limits)
    rule = make_rule(limits, arm.dof)
    if job is not None and run is not None:
        rule = job.rule(run, limits)
    samples = _samples(options, arm)
    steps = np.diff(samples.t)
    cycle = float(np.median(steps)) if len(steps) else 0.0
    if not len(steps) or np.abs(steps - cycle).max() > UNEVEN_SHARE * cycle:
        raise InvalidInput(
            f"{samples.source} must have at least two samples at regular times, because "
            "set-points are judged by their differences over a cycle."
        )
    use = rule.judge(samples.q, cycle)
    verdict = "violated" if use.stated_excess else "kept"
    notes = []
    for excess in use.excesses:
        unit = arm.chain.unit(LIMITS[excess.limit].unit, excess.joint)
        joint = joint_label(excess.joint + 1, arm.joint_names)
        found = excess.describe(f"joint {joint}", unit, float(samples.t[0]))
        notes.append(f"The {found}. {excess.remedy}")
    rows = (
        Row("verdict", verdict, "", "verdict", level=VERDICT),
        Row("cycle", cycle, "s", "cycle", "of the set-points"),
        *set_point_rows(use, arm),
        Row("command_use", dict(use.ratios), "1"),
    )
    data = Data("Check of set-points", rows, notes=tuple(notes))
    return Outcome(lines=data_lines(data), page=plain(data), code=EXIT_CODES[verdict])


def _arm(options: Check, default: Arm | None) -> Arm:
    """Return the arm of --arm; without this option, the arm of the job or cell."""
    arm = default if options.arm is None else named_arm(options.arm)
    if arm is None:
        raise InvalidInput(
            "The check requires an arm. Specify it with --arm, with the job of --path, or with the "
            "cell of --scene."
        )
    return arm


def _check_commands(
    options: Check,
    samples: TrajectoryFile,
    arm: Arm,
    required: MotionRequirements,
    path: Program | None,
) -> InterpolationCheck | None:
    """Check the commands that --controller sends for the samples; None without this option."""
    name = options.controller
    rate = read_option("--rate", options.rate, Frequency)
    raise_if((name is None) != (rate is None), "--controller and --rate require each other.")
    if name is None or rate is None:
        return None
    return verification.check_interpolation(
        samples,
        arm,
        name,
        rate,
        required.limits,
        path,
        deviation=required.deviation,
        orientation_deviation=required.orientation_deviation,
    )


def _page(
    samples: TrajectoryFile,
    result: verification.Check,
    clearance: Clearance | None,
    commands: InterpolationCheck | None,
    repeated: RepeatedRuns | None,
) -> dict[str, Any]:
    """Return the data of the JSON output."""
    data = result.to_data()
    parts = {"clearance": clearance, "commands": commands, "repeated": repeated}
    page = replace(
        data,
        rows=(
            *data.rows,
            Row("left_out", samples.left_out),
            Row("notes", samples.notes),
            Row("findings", findings_table(samples.findings).as_dicts()),
        ),
        parts={key: x.to_data() for key, x in parts.items() if x is not None},
    )
    return plain(page)


def named_arm(name: str) -> Arm:
    """Load a built-in arm, an arm file, or the arm of a job file or cell."""
    if name.lower().endswith(YAML):
        data = load(read_text(FilePath(name), "arm file"), name)
        arm = read_cell_scene(name)[0] if isinstance(data, dict) and "arm" in data else None
        if arm is not None:
            return arm
    return load_arm(name)


def _path(job: Job, run: Run) -> Program:
    """Return the path of a run, with its leads and rounded corners."""
    resumption = find_resumption(job, run)
    objective = prepare_program(job, run, resumption=resumption)
    return round_program(job, run, objective, resumption=resumption)


def _requirements(options: Check, run: Run | None, arm: Arm) -> MotionRequirements:
    """Return the limits and allowed deviations: of --limits, of the run, or of the arm."""
    if options.limits is None:
        return MotionRequirements(limits=arm.limits if run is None else run.limits)
    required = files.read_limits(options.limits, arm)
    deviations = (required.deviation, required.orientation_deviation)
    if run is None and deviations != (None, None):
        raise InvalidInput(
            f"{options.limits} limits the deviation from a path, but no path is specified. Specify "
            "the job of the path with --path."
        )
    return required


def _run(job: Job, options: Check) -> Run:
    """Return the run of --run, by default the first run that rounds corners.

    All runs that round corners must then have the same limits and corners. If no run rounds
    corners, all runs of the job count.
    """
    if options.run_name is not None:
        return find_run(job, options.run_name)
    runs = [x for x in job.runs if x.rounding is not None] or list(job.runs)
    corners_and_limits = [(x.rounding, x.continuity, comparable(x.limits)) for x in runs]
    if any(x != corners_and_limits[0] for x in corners_and_limits[1:]):
        raise InvalidInput(
            f"The runs of the job {job.name} round corners differently, or have different limits. "
            f"Choose a run with --run ({', '.join(x.name for x in runs)})."
        )
    return runs[0]


def _samples(options: Check, arm: Arm) -> TrajectoryFile:
    """Read a trajectory file, check its joints and ranges, and apply `--noise`."""
    samples = files.read_trajectory(
        options.trajectory, arm.joint_names, columns=options.columns, topic=options.topic
    )
    if samples.q.shape[1] != arm.dof:
        raise_other_joints(samples.source, samples.joints, arm.joint_names)
    check_range_of_log(
        samples.source, samples.t, {"position": samples.q}, samples.joints, arm,
        margin=2 * math.pi, degrees_only=True,
    )  # fmt: skip
    for j, joint in enumerate(samples.joints):
        position = f"{samples.source}: the position of {joint}"
        slides = bool(arm.chain.slides[j])
        if samples.prismatic and samples.prismatic[j] not in (slides, None):
            raise InvalidInput(
                f"{position} must be in {arm.chain.unit('rad', j)}, as the joint is "
                f"{'prismatic' if slides else 'revolute'}. Correct the unit in the column title."
            )
        if not slides:
            refuse_wrapped(position, samples.t, samples.q[:, j], j)
    return _with_noise(_with_true_times(samples), options.noise)


def _with_true_times(samples: TrajectoryFile) -> TrajectoryFile:
    """Return measured samples with repaired times, see `repair_times`.

    Samples that are planned, or too few for the check of their times, are not changed.
    """
    if not samples.is_log or len(samples.t) < FEWEST:
        return samples
    log = repair_times(
        Log(
            t=samples.t,
            command=samples.q,
            measured=samples.q,
            velocity=samples.dq,
            source=samples.source,
            prismatic=tuple(bool(x) for x in samples.prismatic),
            findings=samples.findings,
        )
    )
    if not log.findings:
        return samples
    lines = samples.lines
    if len(log.t) != len(samples.t):
        # Samples were added or removed, so they have no lines.
        lines = None
    dq = log.velocity if samples.dq is not None else None
    return replace(
        samples, t=log.t, q=log.measured, dq=dq, ddq=None, lines=lines, findings=log.findings
    )


def _with_noise(samples: TrajectoryFile, noise: str | None) -> TrajectoryFile:
    """Return the samples whose resolution includes the maximum errors that `--noise` declares."""
    if noise is None:
        return samples
    parts = noise.split(",")
    if len(parts) > 1 + (samples.dq is not None):
        raise InvalidInput(
            f"--noise has {len(parts)} values, but takes the largest error of positions and, "
            "unless the file has no velocities, of velocities, such as '0.05 mrad, 2 mrad/s'."
        )
    resolution = dict(samples.resolution)
    for name, part, kind in zip(("q", "dq"), parts, (AngularDistance, AngularRate), strict=False):
        # A resolution is twice the maximum error, as for rounded numbers.
        error = read_option("--noise", part, kind)
        resolution[name] = max(resolution.get(name, 0.0), 2 * error)
    return replace(samples, resolution=resolution)


def _remarks(
    samples: TrajectoryFile,
    arm: Arm,
    result: verification.Check,
    clearance: Clearance | None,
    options: Check,
) -> list[str]:
    """Return lines on joint names, file, arm and clearance, and a note on undeclared noise."""
    named = sorted({y.joint + 1 for y in result.uses if y.joint is not None})
    called = [joint_label(y, arm.joint_names) for y in named]
    lines = [f"Joints: {', '.join(called)}."] if called != [str(y) for y in named] else []
    if samples.left_out:
        lines.append(
            f"Ignored columns of {samples.source}: "
            f"{list_some([show(x) for x in samples.left_out], MAX_TITLES)}."
        )
    sentences = [x.sentence for x in samples.findings]
    lines += [f"Note: {x}" for x in (*sentences, *samples.notes, *arm.notes)]
    if clearance is not None:
        lines.append(
            f"{clearance.sentence} Joint positions between samples are interpolated linearly."
        )
        lines += filter(None, [clearance.below_base])
    noise = _noise(samples.q)
    is_noisy = noise > max(samples.resolution.get("q", 0.0), MIN_NOISE)
    if result.violated and options.noise is None and is_noisy:
        lines.append(
            f"The positions scatter by {digits(noise * 1e3, 2)} mrad from sample to sample, like "
            "measured positions, and the check treats this noise as motion. If the positions are "
            "measured, declare their largest error with --noise, such as "
            f"'{digits(4e3 * noise, 2)} mrad'; then only deviations beyond this error are "
            "violations. If they are set-points, whose accelerations jump, add --set-points."
        )
    return lines


def _noise(q: FloatArray) -> float:
    """Estimate the largest standard deviation of noise in joint positions [rad]; 0 without it."""
    third = np.diff(q, n=3, axis=0)
    power = np.sum(third**2, axis=0)
    noise = 0.0
    for j in np.flatnonzero(power > 0):
        # Third differences of white noise have the correlation -0.75 with their neighbours.
        if float(third[1:, j] @ third[:-1, j]) < -0.6 * power[j]:
            noise = max(noise, math.sqrt(power[j] / len(third) / 20))
    return noise
