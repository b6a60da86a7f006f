"""Checking a trajectory file from the command line."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.arms.limits import JOINT_LIMITS, JOINT_RANGE, TOOL_LIMITS
from armcontour.cli.console import Console

if TYPE_CHECKING:
    from armcontour.evaluation import Check
    from armcontour.evaluation.tally import Occurrence
    from armcontour.jobs import Job, Run

HEADINGS = (
    *("limit", "largest ratio", "of it rounding", "value", "allowed", "t [s]", "joint"),
    "verdict",
)
# Larger ratios are printed with an exponent.
MOST_PLAIN = 1e6
# Exit code of every verdict; no error has the code 7.
EXIT_CODES = {"kept": 0, "violated": 1, "cannot tell": 7}
UNITS = {
    **JOINT_LIMITS,
    **dict.fromkeys(JOINT_RANGE, "rad"),
    **TOOL_LIMITS,
    "path_deviation": "m",
    "orientation_deviation": "rad",
}


def check_file(
    trajectory: FilePath,
    arm_name: str | None,
    limits_file: FilePath | None,
    job_file: FilePath | None,
    *,
    run_name: str | None = None,
    tip: str | None = None,
    base: str | None = None,
    joint_limits: FilePath | None = None,
    as_json: bool = False,
    trust_xacro: bool = False,
) -> int:
    """Check a trajectory file, print what was found, and return the exit code of its verdict.

    Args:
        trajectory: CSV file.
        arm_name: Built-in arm, or its file; by default the job's, with its tool and payload.
        limits_file: Limits; by default those of the job's run, or else the arm's own.
        job_file: The job whose path the tool was to follow.
        run_name: The run of that job.
        tip: Link at the end of an arm from a robot description.
        base: Link of it that stands still.
        joint_limits: A `joint_limits.yaml` of MoveIt for the arm.
        as_json: Whether to print JSON and not a table.
        trust_xacro: Whether the arm may be a .xacro file, which is a program.

    Raises:
        InvalidInput: A file that cannot be used.
    """
    from armcontour.arms import load_arm
    from armcontour.errors import InvalidInput
    from armcontour.evaluation import check
    from armcontour.io import read_job, read_limits, read_trajectory
    from armcontour.jobs import programs_of

    job = None if job_file is None else read_job(job_file, trust_xacro=trust_xacro)
    if arm_name is not None:
        arm = load_arm(
            arm_name, tip=tip, base=base, joint_limits=joint_limits, trust_xacro=trust_xacro
        )
    elif job is None:
        raise InvalidInput("Name the arm with --arm, or with --path a job that has one.")
    elif any(x is not None for x in (tip, base, joint_limits)):
        raise InvalidInput(
            "--tip, --base and --joint-limits go with --arm: the job's arm has its own."
        )
    else:
        arm = job.arm
    limits, deviation, turned = arm.limits, None, None
    path = None
    if job is not None:
        run = _run(job, run_name, limited=limits_file is None)
        path, limits = programs_of(job, run)[1], run.limits
        if run.ignore_jerk:
            limits = limits.replace(joint_jerk=None)
    if limits_file is not None:
        limits, deviation, turned = read_limits(limits_file, arm)
    if (deviation is not None or turned is not None) and path is None:
        raise InvalidInput(
            f"{limits_file} limits the deviation from a path: name its job with --path."
        )
    samples = read_trajectory(trajectory, arm.joint_names)
    if samples.q.shape[1] != arm.dof:
        raise InvalidInput(
            f"{samples.source} has positions of {samples.q.shape[1]} joints, but the arm "
            f"{arm.name} has {arm.dof}: give all of them, or the arm of the file with --arm."
        )
    found = check(samples, arm, limits, path, deviation=deviation, orientation_deviation=turned)
    if not found.uses and found.path_deviation is None:
        raise InvalidInput(f"There is no limit to check: {arm.name} has none, so give --limits.")
    if as_json:
        print(json.dumps(_plain(found), indent=2, allow_nan=False))
    else:
        _print(found)
    return EXIT_CODES[found.verdict]


def _run(job: Job, run_name: str | None, *, limited: bool) -> Run:
    """The run of a job whose path counts, and whose limits if it is to be `limited` by them.

    Without a name it is any of those that round corners, if these do not differ in that.
    """
    from armcontour.errors import InvalidInput
    from armcontour.jobs import traced_alike

    if run_name is not None:
        for run in job.runs:
            if run.name == run_name:
                return run
        names = ", ".join(x.name for x in job.runs)
        raise InvalidInput(f"The job {job.name} has no run {run_name!r}: its runs are {names}.")
    runs = [x for x in job.runs if x.rounding is not None] or list(job.runs)
    rounding = {(x.rounding, x.limits.centripetal_acceleration): x for x in runs}
    if runs[0].rounding is not None and len(rounding) > 1:
        names = ", ".join(x.name for x in rounding.values())
        raise InvalidInput(
            f"The runs of the job {job.name} round corners differently: choose one with --run "
            f"({names})."
        )
    if limited and not all(traced_alike(runs[0], x) for x in runs):
        names = ", ".join(x.name for x in runs)
        raise InvalidInput(
            f"The runs of the job {job.name} have different limits: choose one with --run "
            f"({names}), or give --limits."
        )
    return runs[0]


def _plain(found: Check) -> dict[str, Any]:
    return {
        "kept": {"kept": True, "violated": False}.get(found.verdict),
        "verdict": found.verdict,
        "worst": None if found.worst is None else found.worst.name,
        "limits": [
            {"name": x.name, **_known(x), "highest": _known(x.highest), "verdict": x.verdict}
            for x in found.uses
        ],
        "not_judged": list(found.not_judged),
        "path_deviation": None if found.path_deviation is None else asdict(found.path_deviation),
        "start": found.start,
        "end": found.end,
        "end_speeds": [x if math.isfinite(x) else None for x in found.end_speeds],
        "states": found.states,
        "tolerance": found.tolerance,
        "rounding": dict(found.rounding),
        "reconstruction": found.reconstruction,
    }


def _known(x: Occurrence) -> dict[str, float | int | None]:
    """How far a limit is used at one time; what is infinite, such as an open range, is null."""
    from armcontour.evaluation.tally import Occurrence

    values = {y.name: getattr(x, y.name) for y in fields(Occurrence)}
    return {k: v if v is None or math.isfinite(v) else None for k, v in values.items()}


def _cells(name: str, x: Occurrence) -> tuple[str, ...]:
    unit = UNITS.get(name, "")
    return (
        f"{x.ratio:.6f}" if x.ratio < MOST_PLAIN else f"{x.ratio:.6g}",
        f"{x.slack:.1g}",
        f"{x.value:.6g} {unit}",
        f"{x.limit:.6g} {unit}" if math.isfinite(x.limit) else "none",
        f"{x.t:.6g}",
        "" if x.joint is None else str(x.joint),
    )


def _print(found: Check) -> None:
    rows = []
    for x in found.uses:
        rows.append((x.name.replace("_", " "), *_cells(x.name, x), x.verdict))
        certain, highest = _cells(x.name, x), _cells(x.name, x.highest)
        if certain[0] != highest[0]:
            rows.append(("  as the numbers stand", *highest, ""))
    console = Console()
    console.show_table(HEADINGS, rows, left=(0, len(HEADINGS) - 1))
    lines = [found.reconstruction]
    open_ones = [x for x in found.uses if x.verdict == "cannot tell"]
    if open_ones:
        names = ", ".join(x.name.replace("_", " ") for x in open_ones)
        lines.insert(
            0,
            f"Cannot tell of: {names}. As the numbers stand the limit is exceeded, but their "
            "rounding, or a turn between two samples, may have made that: print more digits, add "
            "columns of velocities and accelerations, or sample more often.",
        )
    if found.path_deviation is not None:
        far = found.path_deviation
        lines.append(
            f"Largest distance from the path: {far.distance * 1e3:.6g} mm at t = {far.t:.6g} s, "
            f"s = {far.s:.6g} m."
        )
    if found.not_judged:
        names = ", ".join(found.not_judged)
        lines.append(f"Not judged, for no limit is given or these samples do not tell: {names}.")
    for line in lines:
        console.say(line)
