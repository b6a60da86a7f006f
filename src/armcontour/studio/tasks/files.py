"""Tasks that end with a file: exports, reports and certificates."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Step
from armcontour.studio.tasks.logs import learned
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.files.exports.formats import ExportFormat
    from armcontour.jobs import Job, RunResult

# The template whose files have names of KRL, of so many letters at most.
KUKA, MOST_LETTERS = "kuka", 24


def report(x: Request) -> Frame:
    """The report of the run as one page of HTML; with the option `all`, of all runs."""
    from armcontour.jobs import run
    from armcontour.report import render_report

    job = x.whole_job
    if not x.option("all", False):
        chosen = tuple(y for y in job.runs if x.run in (None, y.name))[:1]
        job = replace(job, runs=chosen)
    study = run(job, progress=x.progress)
    x.progress(Step(("writing",)))
    return Frame.of_file(f"{job.name}-report.html", render_report(study).encode(), {"run": x.run})


def certify(x: Request) -> Frame:
    """The fastest plan whose execution keeps the tolerance, as a report; and its figures.

    Options: fields of `jobs.CertificateGoal`, such as `tolerance` [m].

    Raises:
        InvalidInput: Neither the job nor the options have a tolerance.
    """
    from armcontour.core.render import plain, verdict
    from armcontour.report import render_report
    from armcontour.studies.certification import certify
    from armcontour.studies.certification.certification import goal_of

    if x.whole_job.certificate is None and "tolerance" not in x.options:
        raise InvalidInput(
            "Certify needs a tolerance, as the job has none: enter it beside Certify."
        )
    goal = goal_of(x.whole_job, **x.options)
    found = certify(x.whole_job, x.run, goal=goal, progress=x.progress)
    x.progress(Step(("writing",)))
    data = found.to_data()
    header = {
        **{"run": found.run.name, "sentence": f"{verdict(data)} It is valid for: {found.model}."},
        **{"notes": [*data.notes, *data.warnings], "certificate": plain(data)},
    }
    page = render_report(found.study, certificate=found)
    return Frame.of_file(f"{found.job.name}-certificate.html", page.encode(), header)


def export(x: Request) -> Frame:
    """The set-points or the plan in a format of a controller or a table.

    Options: `format`, a name of a format; for "template" its `template`; `of`, "set_points",
    "planned", or "learned" from `logs`; `cycle` of a plan [s].
    """
    from armcontour.files.exports.formats import TemplateFormat, format_named, write_destination
    from armcontour.files.exports.table import make_table
    from armcontour.files.exports.template import SHIPPED, describe_program, ending_of
    from armcontour.jobs import analog_outputs

    of, source = format_named(str(x.option("format", "csv"))), x.option("of", "set_points")
    if source == "learned":
        study = learned(x)
        plan = replace(study.plan, set_points=study.lesson)
    else:
        plan = x.set_points
    format = of(**{name: y for name, y in x.options.items() if name == "template"})
    template, ending = None, format.ending
    if isinstance(format, TemplateFormat):
        template = format.label
        if template not in SHIPPED:
            names = ", ".join(SHIPPED)
            raise InvalidInput(f"There is no template {template!r}: there are {names}.")
        ending = ending_of(template)
    set_points = source != "planned"
    x.progress(Step(("writing",)))
    with tempfile.TemporaryDirectory() as folder:
        stem = f"{x.job.name}-{plan.run.name}"
        if template == KUKA:
            # KRL finds a program by the name of its file, and takes few names.
            stem = re.sub(r"\W", "_", stem if stem[:1].isalpha() else f"p_{stem}", flags=re.ASCII)
            stem = stem[:MOST_LETTERS]
        file = FilePath(folder) / f"{stem}{ending}"
        table = make_table(
            plan.set_points if set_points else plan.trajectory,
            name=f"{x.job.name} {'set-points' if set_points else 'reference'}",
            arm=x.job.arm,
            cycle=None if set_points else x.option("cycle", plan.run.cycle),
            derivatives=2,
            analog=_analog(format, plan, x.job, analog_outputs),
        )
        told = describe_program(
            table,
            format.label,
            None,
            lambda event, output: f"--output {event}={output} of armcontour export",
        )
        write_destination(
            file, lambda path: format.write(table, path), folder=format.kind == "mcap"
        )
        name, content = _content_of(file)
    called = f"{'Format' if template is None else 'Template'} {format.label}"
    header = {
        **{"run": plan.run.name, "points": len(plan.set_points.q)},
        "warnings": (*plan.warnings, *(f"{called}: {said}" for said in told)),
    }
    return Frame.of_file(name, content, header)


def _analog(format: ExportFormat, plan: RunResult, job: Job, outputs: Callable[..., Any]) -> Any:
    """The analog outputs of a plan, for formats that have them."""
    from armcontour.files.exports.formats import WITH_ANALOG

    if not isinstance(format, WITH_ANALOG):
        return None
    return outputs(plan.path, plan.trajectory, job.process, plan.run.limits) or None


def _content_of(file: FilePath) -> tuple[str, bytes]:
    """Name and bytes of a file; a folder becomes an archive."""
    if not file.is_dir():
        return file.name, file.read_bytes()
    archive = BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as into:
        for part in sorted(file.iterdir()):
            into.write(part, f"{file.name}/{part.name}")
    return f"{file.name}.zip", archive.getvalue()
