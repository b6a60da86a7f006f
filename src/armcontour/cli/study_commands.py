"""The commands `certify`, `place` and `batch`: many plans or runs of one job."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour import files, jobs, report
from armcontour.cli.command_execution import REPORT, Outcome, report_line
from armcontour.cli.commands import Batch, Certify, Place
from armcontour.cli.console import table_lines
from armcontour.cli.inputs import (
    find_file,
    is_job,
    naming_options_in_errors,
    open_job,
    read_option,
    read_patch,
)
from armcontour.cli.run_command import write_motions
from armcontour.core import file_access
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.quantities import Angle, Length
from armcontour.core.render import compare, plain, text
from armcontour.core.result import TABLE
from armcontour.core.source_file import SourceFile
from armcontour.core.text import Keys
from armcontour.core.validity import AS_MODELLED
from armcontour.files import batch as batches
from armcontour.files.certificate_and_placement_files import certificate_page
from armcontour.files.job_file import drawing_text, job_text
from armcontour.report.batch_report import BatchEntry, people_name, render_batch
from armcontour.report.origin import Origin
from armcontour.studies import certification
from armcontour.studies import placement as places

# File name of the job in its best place.
JOB = "job.yaml"
# Difference up to which a range of angles counts as a whole turn [rad].
SAME_ANGLE = 1e-9
# Decimals of the values of an axis, in SI units.
AXIS_DECIMALS = 12


def place(options: Place, folder: files.ResultFolder, progress: Progress) -> Outcome:
    """Plan a job at every place of a grid; the exit code is 1 if no place is feasible."""
    axes = [x for x in places.AXES if getattr(options, x) is not None]
    grid = {name: read_axis(name, getattr(options, name)) for name in axes}
    if not grid:
        raise InvalidInput(
            "place requires an axis of the grid, such as --x '-300 mm .. 300 mm, 25'."
        )
    job = open_job(options.job, options, progress)
    placement = places.place(
        job,
        grid,
        move=options.move,
        run=options.run_name,
        processes=1 if options.workers == 0 else options.workers,
        progress=progress,
    )
    data = placement.to_data()
    lines = str(placement).splitlines()
    folder.write(REPORT, report.render_placement(placement, _plan_best(placement)))
    folder.write("placement.csv", files.placement_csv(placement))
    lines += [f"Note: {x}" for x in (*data.notes, *job.arm.notes)]
    if placement.best is not None:
        try:
            folder.write(JOB, _job_text(placement, options))
            lines.append(f"Job: {options.out / JOB}")
        except InvalidInput as error:
            lines.append(f"Note: {error}")
    return Outcome(lines=lines, page=plain(data), code=int(placement.best is None))


def _plan_best(placement: places.Placement) -> jobs.RunResult | None:
    """Plan the best place again for its drawing; None if no place is feasible."""
    if placement.best is None:
        return None
    job = replace(placement.placed(), runs=(placement.run,))
    return jobs.run(job, simulate=False).runs[placement.run.name]


def read_axis(name: str, text: str) -> FloatArray:
    """Read the values of an axis, such as "-300 mm .. 300 mm, 25" [m or rad], (n,).

    A whole turn omits the last value, which equals the first.
    """
    option = f"--{name}"
    kind = Angle if name == "yaw" else Length
    match = re.fullmatch(r"(.+?)\.\.(.+),\s*([1-9]\d{0,5})", text.strip())
    if match is None:
        raise InvalidInput(
            f"{option} requires a range and a number of values, such as '-300 mm .. 300 mm, 25', "
            f"not {text!r}."
        )
    low, high = (float(read_option(option, x, kind)) for x in match.groups()[:2])
    is_whole_turn = name == "yaw" and abs(abs(high - low) - 2 * np.pi) < SAME_ANGLE
    # Without rounding, steps have rounding errors, for example at 0.
    values = np.linspace(low, high, int(match[3]), endpoint=not is_whole_turn)
    # The sum turns -0.0 into 0.0.
    return np.round(values, AXIS_DECIMALS) + 0.0


def _job_text(placement: places.Placement, options: Place) -> str:
    """Return the text of the job file with the part in its best place."""
    file = options.job
    out = options.out
    if is_job(file):
        text = job_text(file)
        folder = file.parent
    else:
        text = drawing_text(str(options.cell), file, out)
        folder = out
    patch, _ = read_patch(options)
    return files.placed_job_text(placement, text, folder=folder, to=out, patch=patch)


def batch(options: Batch, _: None, progress: Progress) -> Outcome:
    """Run a job for all combinations of values; the exit code is 1 if some jobs failed."""
    patch, names = read_patch(options)
    # Values of each key, by key path.
    over = {keys: [value] for keys, value in patch.items()}
    for text_of_list in options.over:
        with error_context("--over"):
            [(keys, values)] = files.parse_set(text_of_list).items()
            if not isinstance(values, list) or not values:
                raise InvalidInput(f"{text_of_list} has no list. Write 'KEY=[VALUE, VALUE]'.")
        over[keys] = values
    out = options.out
    cell = options.cell
    with naming_options_in_errors(names):
        result = batches.batch(
            find_file(options.job, cell),
            over,
            out,
            cell=cell,
            workers=options.workers,
            progress=progress,
        )
    header, *rows = cells = result.cells()
    counts = ", ".join(f"{n} {status}" for status, n in result.counts.items())
    errors = [x.error for x in result.rows]
    if any(errors):
        header = (*header, "")
        rows = [(*x, y) for x, y in zip(rows, errors, strict=True)]
    origin = Origin(job=options.job.name, sources=result.sources)
    page = render_batch(
        f"Batch of {result.title}", counts, header, rows, _entries(result, patch, options), origin
    )
    file_access.write_atomically(out / REPORT, lambda x: x.write_text(page, encoding="utf-8"))
    lines = [
        *table_lines(cells, f"{result.title}: {counts}; {AS_MODELLED}", names=1 + len(over)),
        *result.errors(),
        f"Table: {out / batches.TABLE}",
        report_line(out),
    ]
    return Outcome(lines=lines, code=int(batches.FAILED in result.counts))


def _entries(result: batches.Batch, patch: Mapping[Keys, Any], options: Batch) -> list[BatchEntry]:
    """Return the rows of a batch for its report, each with the command that runs it alone."""
    several = len({x.run for x in result.rows if x.run}) > 1
    entries = []
    for row in result.rows:
        values = {".".join(map(str, key)): value for key, value in patch.items()} | dict(row.values)
        command = ["armcontour", "run", str(options.job)]
        if options.cell is not None:
            command += ["--cell", str(options.cell)]
        for key, value in values.items():
            command += ["--set", f"{key}={value if isinstance(value, str) else json.dumps(value)}"]
        command += ["--out", f"job_{row.job}"]
        named = [f"{people_name(key)} {value}" for key, value in row.values.items()]
        entries.append(
            BatchEntry(
                name=f"{row.job} {row.run}" if several else str(row.job),
                values=", ".join(named),
                data=row.data,
                error=row.error,
                command=shlex.join(command),
            )
        )
    return entries


def certify(options: Certify, folder: files.ResultFolder | None, progress: Progress) -> Outcome:
    """Find the fastest plan whose execution stays within a tolerance."""
    job = open_job(options.job, options, progress)
    certificate = certification.certify(job, run=options.run_name, progress=progress)
    if folder is not None:
        write_motions(folder, job, certificate.job_result.runs)
        run = certificate.result
        text_of_file = "".join(files.set_point_pieces(run.set_points, job.arm.joint_names))
        page = report.render_report(
            certificate.job_result,
            certificate=certificate,
            set_points=SourceFile.from_text(f"{run.run.name}/set_points.csv", text_of_file),
        )
        folder.write(REPORT, page)
    data = certificate.to_data()
    lines = [
        *text(data).splitlines(),
        *table_lines(compare(certificate.comparison, TABLE)),
        *data.notes,
        *certificate.result.remarks,
        *(f"Warning: {x}" for x in data.warnings),
        *(f"Note: {x}" for x in certificate.job.arm.notes),
        data.not_proven,
    ]
    code = int(not certificate.kept)
    return Outcome(lines=lines, page=certificate_page(certificate), code=code)
