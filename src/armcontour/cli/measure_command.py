"""The command `measure`: frames of part and tool from joint positions at touched points."""

from __future__ import annotations

from armcontour import files
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Measure
from armcontour.cli.console import data_lines, table_lines
from armcontour.cli.inputs import is_job, read_option, refuse_existing
from armcontour.core import file_access
from armcontour.core.checks import raise_if
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.quantities import Length
from armcontour.core.render import plain
from armcontour.files.job_file import job_text
from armcontour.files.job_patch import Patch
from armcontour.files.measured_job import (
    measure_part_of,
    measured_job_text,
    part_patch,
    tool_patch,
    work_patch,
)
from armcontour.files.touch_file import Touches, read_doubts, read_touches
from armcontour.jobs import Job
from armcontour.robot.measurement import Measurement, measure_tool


def measure(options: Measure, _: None, progress: Progress) -> Outcome:
    """Measure a frame from touches, print it, and write the job with it."""
    raise_if(not is_job(options.job), f"--job must be a job file (.yaml), not {options.job.name}.")
    if options.out is not None:
        refuse_existing(options.out, options.force)
    raise_if(options.force and options.out is None, "--force requires --out, the file to write.")
    job = files.read_job(options.job)
    text = job_text(options.job)
    touches = read_touches(options.touches, job.arm, options.columns)
    noise = float(read_option("--noise", options.noise, Length))
    with error_context(options.touches.name):
        measured, patch = _measure(options, job, text, touches, noise)
    data = measured.to_data()
    lines = [
        *data_lines(data),
        *table_lines([("touch", "residual [mm]"), *_residual_rows(measured)]),
        *(f"Note: {x}" for x in touches.notes),
    ]
    if options.out is None:
        lines.append("Add --out FILE to write the job with this frame.")
    else:
        written = measured_job_text(text, patch, options.job.parent, options.out.parent)
        file_access.write_atomically(options.out, lambda x: x.write_text(written, encoding="utf-8"))
        lines.append(f"Job: {options.out}")
    return Outcome(lines=lines, page=plain(data))


def _measure(
    options: Measure, job: Job, text: str, touches: Touches, noise: float
) -> tuple[Measurement, Patch]:
    """Measure a frame; return it, and the values of the job keys that state it.

    - `text`: text of the job file.
    - `noise`: standard deviation of a touch [m].
    """
    accept = read_doubts(options.accept)
    if options.target == "tool":
        if touches.points is not None:
            raise InvalidInput(
                "the columns x, y and z are not allowed, because the point that the tool touches "
                "is computed. Remove them, or measure the part."
            )
        tool = measure_tool(
            job.arm, touches.q, noise=noise, planned=job.arm.chain.tool, accept=accept
        )
        return tool, tool_patch(job, tool, text)
    part = measure_part_of(job, touches, noise=noise, accept=accept)
    patch = work_patch(job, part) if options.target == "work" else part_patch(part)
    return part, patch


def _residual_rows(measured: Measurement) -> list[tuple[str, str]]:
    """Return the residuals as rows of a table."""
    return [(str(k + 1), f"{x * 1e3:.3f}") for k, x in enumerate(measured.residuals)]
