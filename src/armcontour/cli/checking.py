"""Checking a trajectory file from the command line."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.arms.limits import JOINT_LIMITS, JOINT_RANGE, TOOL_LIMITS

if TYPE_CHECKING:
    from armcontour.evaluation import Check, LimitUse
    from armcontour.jobs import Job, Run

# Columns of text where the output goes to a file or another program.
WIDTH = 120
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
) -> bool:
    """Check a trajectory file, print what was found, and say whether every limit is kept.

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

    Raises:
        InvalidInput: A file that cannot be used.
    """
    from armcontour.arms import load_arm
    from armcontour.errors import InvalidInput
    from armcontour.evaluation import check
    from armcontour.io import read_job, read_limits, read_trajectory
    from armcontour.jobs import path_of

    job = None if job_file is None else read_job(job_file)
    if arm_name is not None:
        arm = load_arm(arm_name, tip=tip, base=base, joint_limits=joint_limits)
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
        path, limits = path_of(job, run), run.limits
        if run.ignore_jerk:
            limits = limits.replace(joint_jerk=None)
    if limits_file is not None:
        limits, deviation, turned = read_limits(limits_file, arm)
    if (deviation is not None or turned is not None) and path is None:
        raise InvalidInput(
            f"{limits_file} limits the deviation from a path: name its job with --path."
        )
    samples = read_trajectory(trajectory, arm.joint_names)
    found = check(samples, arm, limits, path, deviation=deviation, orientation_deviation=turned)
    if not found.uses and found.path_deviation is None:
        raise InvalidInput(f"There is no limit to check: {arm.name} has none, so give --limits.")
    if as_json:
        print(json.dumps(_plain(found), indent=2, allow_nan=False))
    else:
        _print(found)
    return not found.violated


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
    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "kept": not found.violated,
        "worst": None if found.worst is None else found.worst.name,
        "limits": [
            {
                # A joint may have a range that is open.
                **{k: known(v) if isinstance(v, float) else v for k, v in asdict(x).items()},
                "verdict": _verdict(x, found.tolerance),
            }
            for x in found.uses
        ],
        "not_judged": list(found.not_judged),
        "path_deviation": None if found.path_deviation is None else asdict(found.path_deviation),
        "start": found.start,
        "end": found.end,
        "end_speeds": [known(x) for x in found.end_speeds],
        "states": found.states,
        "tolerance": found.tolerance,
        "rounding": dict(found.rounding),
        "reconstruction": found.reconstruction,
    }


def _verdict(use: LimitUse, tolerance: float) -> str:
    """In a word: above a limit by less than the printed digits tell is neither."""
    if use.certain > 1 + tolerance:
        return "violated"
    return "kept" if use.ratio <= 1 + tolerance else "cannot tell"


def _print(found: Check) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table()
    for name in ("limit", "largest ratio", "of it rounding", "value", "allowed", "t [s]", "joint"):
        table.add_column(escape(name), justify="left" if name == "limit" else "right")
    table.add_column("verdict")
    for x in found.uses:
        unit = UNITS.get(x.name, "")
        table.add_row(
            x.name.replace("_", " "),
            f"{x.ratio:.6f}",
            f"{x.slack:.1g}",
            f"{x.value:.6g} {unit}",
            f"{x.limit:.6g} {unit}" if math.isfinite(x.limit) else "none",
            f"{x.t:.6g}",
            "" if x.joint is None else str(x.joint),
            _verdict(x, found.tolerance),
        )
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    console.print(table)
    lines = [found.reconstruction]
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
        console.print(line, soft_wrap=True, highlight=False)
