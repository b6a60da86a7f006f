"""The command `check`: checks a trajectory file against limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armcontour.cli.console import print_json, show_data
from armcontour.cli.inputs import read_option
from armcontour.cli.options import CheckOptions
from armcontour.cli.program import JUDGE, command
from armcontour.core.text import clock, digits, joint_label, list_some, show

if TYPE_CHECKING:
    from armcontour.core.checks import FloatArray
    from armcontour.files.joint_table import TrajectoryFile
    from armcontour.jobs import Job, Run
    from armcontour.program import Program
    from armcontour.robot import Arm, Limits
    from armcontour.robot.scene import Scene
    from armcontour.verification import Check, InterpolationCheck
    from armcontour.verification.clearance import Clearance

# Standard deviation below which scatter counts as rounding, not as noise [rad]. The steps of a
# 32-bit encoder are 1.5e-9 rad.
MIN_NOISE = 1e-9
# Maximum number of listed column titles.
MAX_TITLES = 8
# Exit codes by verdict; no error has the exit code 7.
EXIT_CODES = {"kept": 0, "violated": 1, "cannot tell": 7}


@command(JUDGE, "check motion.csv --arm ur5e --noise '0.05 mrad'")
def check(
    trajectory: Annotated[
        FilePath, typer.Argument(help="Time-stamped joint trajectory: CSV, or YAML of ROS.")
    ],
    options: CheckOptions,
) -> int:
    """Check a joint trajectory against limits.

    Exit codes: 0 all limits kept, 1 a limit violated, 7 the samples cannot tell, 2 invalid input.
    """
    from armcontour import verification
    from armcontour.core.errors import InvalidInput
    from armcontour.core.result import Row
    from armcontour.files import read_job
    from armcontour.verification.limit_verdict import VERDICTS

    job = None if options.path is None else read_job(options.path)
    arm, scene = _arm_and_scene(options, None if job is None else job.arm)
    limits, path, deviation, angle = _limits_and_path(options, job, arm)
    samples = _samples(trajectory, arm, options)
    allowed: dict[str, Any] = {"deviation": deviation, "orientation_deviation": angle}
    result = verification.check(samples, arm, limits, path, **allowed)
    clearance = None if scene is None else _clearance(samples, arm, scene)
    commands = _check_commands(samples, arm, options, limits, path, allowed)
    if not result.uses and result.path_deviation is None and clearance is None:
        raise InvalidInput(
            f"There is no limit to check, because the arm {arm.name} has no limits. Specify limits "
            "with --limits."
        )
    data = result.to_data()
    if options.as_json:
        notes = (Row("left_out", samples.left_out), Row("notes", samples.notes))
        results = {"clearance": clearance, "commands": commands}
        parts = {key: x.to_data() for key, x in results.items() if x is not None}
        print_json(replace(data, rows=(*data.rows, *notes), parts=parts))
    else:
        named = sorted({y.joint + 1 for y in result.uses if y.joint is not None})
        called = [joint_label(y, arm.joint_names) for y in named]
        remarks = [f"Joints: {', '.join(called)}."] if called != [str(y) for y in named] else []
        remarks += _file_notes(samples, result, declared=options.noise is not None)
        if clearance is not None:
            evenly = "Joint positions between samples are interpolated linearly."
            remarks.append(f"{clearance.sentence} {evenly}")
            remarks += filter(None, [clearance.below_base])
        remarks += [f"Note: {note}" for note in arm.notes]
        show_data(replace(data, notes=(*data.notes, *remarks)))
        if commands is not None:
            show_data(commands.to_data())
    verdicts = [result.verdict, *([] if commands is None else [commands.verdict])]
    touches = clearance is not None and not clearance.satisfied
    return EXIT_CODES["violated" if touches else max(verdicts, key=VERDICTS.index)]


def _check_commands(
    samples: TrajectoryFile,
    arm: Arm,
    options: CheckOptions,
    limits: Limits,
    path: Program | None,
    allowed: Mapping[str, Any],
) -> InterpolationCheck | None:
    """Check the commands of a controller for the samples; None without `--controller`."""
    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import Frequency
    from armcontour.verification import check_interpolation

    name, rate = options.controller, read_option("--rate", options.rate, Frequency)
    if name is None or rate is None:
        if (name is None) != (rate is None):
            raise InvalidInput("--controller and --rate require each other.")
        return None
    return check_interpolation(samples, arm, name, rate, limits, path, **allowed)


def _limits_and_path(
    options: CheckOptions, job: Job | None, arm: Arm
) -> tuple[Limits, Program | None, float | None, float | None]:
    """Limits, path, and allowed deviations of position [m] and orientation [rad] from the path."""
    from armcontour.core.errors import InvalidInput

    path, limits = None, arm.limits
    if job is not None:
        from armcontour.jobs import prepare_program, round_program

        run = _run(job, options.run_name, limited=options.limits is None)
        path, limits = round_program(job, run, prepare_program(job, run)), run.limits
    if options.limits is None:
        return limits, path, None, None
    from armcontour.files import read_limits

    limits, deviation, angle = read_limits(options.limits, arm)
    if path is None and (deviation, angle) != (None, None):
        raise InvalidInput(
            f"{options.limits} limits the deviation from a path, but no path is specified. Specify "
            "the job of the path with --path."
        )
    return limits, path, deviation, angle


def _clearance(samples: TrajectoryFile, arm: Arm, scene: Scene) -> Clearance:
    """Clearance of the arm from itself and its cell along the samples; times are as in the file."""
    from armcontour.verification.clearance import check_clearance

    return check_clearance(samples.straight, arm, scene).later(float(samples.t[0]))


def _arm_and_scene(options: CheckOptions, default: Arm | None) -> tuple[Arm, Scene | None]:
    """Arm and scene of the options; the scene is None without `--scene`.

    The arm is that of `--arm`, else `default` (arm of the job), else the arm of the scene's cell.
    """
    from armcontour.files.cell import read_cell_scene

    if options.scene is None:
        return _arm(options, default), None
    arm, scene = read_cell_scene(options.scene)
    return _arm(options, arm if default is None else default), scene


def _arm(options: CheckOptions, default: Arm | None) -> Arm:
    """Arm of the options; the default is the arm of the job or cell."""
    from armcontour.core.errors import InvalidInput

    if options.arm is not None:
        return named_arm(options.arm)
    if default is None:
        raise InvalidInput(
            "The check requires an arm. Specify it with --arm, with the job of --path, or with the "
            "cell of --scene."
        )
    return default


def named_arm(name: str) -> Arm:
    """Load a built-in arm, an arm file, or the arm of a job file or cell."""
    from armcontour.core.file_access import read_text
    from armcontour.core.yaml_loader import load
    from armcontour.files.cell import YAML, read_cell_scene
    from armcontour.files.robots.loading import load_arm

    if name.lower().endswith(YAML):
        data = load(read_text(FilePath(name), "arm file"), name)
        arm = read_cell_scene(name)[0] if isinstance(data, dict) and "arm" in data else None
        if arm is not None:
            return arm
    return load_arm(name)


def _samples(trajectory: FilePath, arm: Arm, options: CheckOptions) -> TrajectoryFile:
    """Read a trajectory file, check its joints and ranges, and apply `--noise`."""
    from armcontour.files import read_trajectory
    from armcontour.motion.log_checks import check_range_of_log
    from armcontour.motion.log_columns import raise_other_joints

    samples = read_trajectory(trajectory, arm.joint_names, columns=options.columns)
    if samples.q.shape[1] != arm.dof:
        raise_other_joints(samples.source, samples.joints, arm.joint_names)
    check_range_of_log(
        samples.source, samples.t, {"position": samples.q}, samples.joints, arm,
        margin=2 * math.pi, degrees_only=True,
    )  # fmt: skip
    return _with_noise(samples, options.noise)


def _with_noise(samples: TrajectoryFile, noise: str | None) -> TrajectoryFile:
    """Samples whose resolution includes the maximum errors that `--noise` declares."""
    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import AngularDistance, AngularRate

    if noise is None:
        return samples
    parts = noise.split(",")
    if len(parts) > 1 + (samples.dq is not None):
        most = "one, such as '0.05 mrad', because the file has no velocities"
        if samples.dq is not None:
            most = "two, such as '0.05 mrad, 2 mrad/s': largest errors of positions and velocities"
        raise InvalidInput(f"--noise has {len(parts)} values, but takes at most {most}.")
    resolution = dict(samples.resolution)
    for name, part, kind in zip(("q", "dq"), parts, (AngularDistance, AngularRate), strict=False):
        error = read_option("--noise", part, kind)
        assert error is not None
        # A resolution is twice the maximum error, as for rounded numbers.
        resolution[name] = max(resolution.get(name, 0.0), 2 * error)
    return replace(samples, resolution=resolution)


def _file_notes(samples: TrajectoryFile, result: Check, *, declared: bool) -> list[str]:
    """Lines with the ignored columns, the notes of the file, and a note about undeclared noise."""
    from armcontour.motion.log_checks import find_wrap

    lines = []
    if samples.left_out:
        lines.append(
            f"Ignored columns of {samples.source}: "
            f"{list_some([show(x) for x in samples.left_out], MAX_TITLES)}."
        )
    lines += [f"Note: {x}" for x in samples.notes]
    for positions, joint in zip(samples.q.T, samples.joints, strict=True):
        if (i := find_wrap(positions)) is not None:
            lines.append(
                f"The position of {joint} jumps by about a turn at t = {clock(samples.t[i])} s, "
                "like a wrapped angle. If the joint does not jump, unwrap the positions "
                "(numpy.unwrap)."
            )
            return lines
    noise = _noise(samples.q)
    is_noisy = noise > max(samples.resolution.get("q", 0.0), MIN_NOISE)
    if result.violated and not declared and is_noisy:
        lines.append(
            f"The positions scatter by {digits(noise * 1e3, 2)} mrad from sample to sample, like "
            "measured positions, and the check treats this noise as motion. If the positions are "
            "measured, declare their largest error with --noise, such as "
            f"'{digits(4e3 * noise, 2)} mrad'; then only deviations beyond this error are "
            "violations. If they are set-points, whose accelerations jump, check planned.csv "
            "instead."
        )
    return lines


def _noise(q: FloatArray) -> float:
    """Largest standard deviation of the noise in joint positions [rad]; 0 without noise."""
    import numpy as np

    third = np.diff(q, n=3, axis=0)
    power = np.sum(third**2, axis=0)
    noise = 0.0
    for j in np.flatnonzero(power > 0):
        # Third differences of white noise have the correlation -0.75 with their neighbours.
        if float(third[1:, j] @ third[:-1, j]) < -0.6 * power[j]:
            noise = max(noise, math.sqrt(power[j] / len(third) / 20))
    return noise


def _run(job: Job, run_name: str | None, *, limited: bool) -> Run:
    """Select the run of a job for the check, which uses its path and, if `limited`, its limits."""
    # The default is the first run that rounds corners, if all such runs round corners equally.
    from armcontour.core.checks import comparable
    from armcontour.core.errors import InvalidInput
    from armcontour.jobs.job import find_run

    if run_name is not None:
        return find_run(job, run_name)
    runs = [x for x in job.runs if x.rounding is not None] or list(job.runs)
    rounding = {(x.rounding, x.continuity, x.limits.centripetal_acceleration): x for x in runs}
    if runs[0].rounding is not None and len(rounding) > 1:
        names = ", ".join(x.name for x in rounding.values())
        raise InvalidInput(
            f"The runs of the job {job.name} round corners differently. Choose a run with --run "
            f"({names})."
        )
    if limited and any(comparable(x.limits) != comparable(runs[0].limits) for x in runs):
        names = ", ".join(x.name for x in runs)
        raise InvalidInput(
            f"The runs of the job {job.name} have different limits. Choose a run with --run "
            f"({names}), or specify --limits."
        )
    return runs[0]
