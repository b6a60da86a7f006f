"""Tasks that create a file: exports, reports and certificates."""

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
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.tasks.logs import learn_from_logs
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.files.exports.formats import ExportFormat
    from armcontour.jobs import Job, RunResult

# Template whose file names must be KRL identifiers, and the maximum length of these names.
KUKA, MAX_LETTERS = "kuka", 24


def report(request: Request) -> PageFrame:
    """Create an HTML report of the run; with the option `all`, of all runs."""
    from armcontour.jobs import run
    from armcontour.report import render_report

    job = request.whole_job
    if not request.option("all", False):
        chosen = tuple(y for y in job.runs if request.run in (None, y.name))[:1]
        job = replace(job, runs=chosen)
    study = run(job, progress=request.progress)
    request.progress(Step(("writing",)))
    return PageFrame.of_file(
        f"{job.name}-report.html", render_report(study).encode(), {"run": request.run}
    )


def certify(request: Request) -> PageFrame:
    """Certify the run and create a report; the options are fields of `CertificateGoal`."""
    from armcontour.core.render import plain, verdict
    from armcontour.report import render_report
    from armcontour.studies.certification import certify
    from armcontour.studies.certification.certification import goal_of

    if request.whole_job.certificate is None and "tolerance" not in request.options:
        raise InvalidInput(
            "Certify requires a tolerance, because the job does not specify one. Enter it next to "
            "Certify."
        )
    goal = goal_of(request.whole_job, **request.options)
    certificate = certify(request.whole_job, request.run, goal=goal, progress=request.progress)
    request.progress(Step(("writing",)))
    data = certificate.to_data()
    header = {
        **{
            "run": certificate.run.name,
            "sentence": f"{verdict(data)} It is valid for: {certificate.model}.",
        },
        **{"notes": [*data.notes, *data.warnings], "certificate": plain(data)},
    }
    page = render_report(certificate.study, certificate=certificate)
    return PageFrame.of_file(f"{certificate.job.name}-certificate.html", page.encode(), header)


def export(request: Request) -> PageFrame:
    """Export set-points or the plan.

    Options: `format`, `template`, `of` (set_points, planned or learned), `cycle` [s].
    """
    from armcontour.files.exports.formats import TemplateFormat, format_named, write_destination
    from armcontour.files.exports.table import make_table
    from armcontour.files.exports.template import BUILT_IN, describe_program, ending_of
    from armcontour.jobs import analog_outputs

    format_class = format_named(str(request.option("format", "csv")))
    source = request.option("of", "set_points")
    if source == "learned":
        study = learn_from_logs(request)
        plan = replace(study.plan, set_points=study.lesson)
    else:
        plan = request.set_points
    format = format_class(**{name: y for name, y in request.options.items() if name == "template"})
    template, ending = None, format.ending
    if isinstance(format, TemplateFormat):
        template = format.label
        if template not in BUILT_IN:
            names = ", ".join(BUILT_IN)
            raise InvalidInput(f"The template must be one of {names}, but is {template!r}.")
        ending = ending_of(template)
    set_points = source != "planned"
    request.progress(Step(("writing",)))
    with tempfile.TemporaryDirectory() as folder:
        stem = f"{request.job.name}-{plan.run.name}"
        if template == KUKA:
            # The file name of a KRL program is its identifier, so it must be short and without
            # special characters.
            stem = re.sub(r"\W", "_", stem if stem[:1].isalpha() else f"p_{stem}", flags=re.ASCII)
            stem = stem[:MAX_LETTERS]
        file = FilePath(folder) / f"{stem}{ending}"
        table = make_table(
            plan.set_points if set_points else plan.trajectory,
            name=f"{request.job.name} {'set-points' if set_points else 'reference'}",
            arm=request.job.arm,
            cycle=None if set_points else request.option("cycle", plan.run.cycle),
            analog=_analog(format, plan, request.job, analog_outputs),
        )
        notes = describe_program(
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
        "warnings": (*plan.warnings, *(f"{called}: {said}" for said in notes)),
    }
    return PageFrame.of_file(name, content, header)


def _analog(format: ExportFormat, plan: RunResult, job: Job, outputs: Callable[..., Any]) -> Any:
    """Analog outputs of a plan; None if there are none or the format does not support them."""
    from armcontour.files.exports.formats import WITH_ANALOG

    if not isinstance(format, WITH_ANALOG):
        return None
    return outputs(plan.path, plan.trajectory, job.process, plan.run.limits) or None


def _content_of(file: FilePath) -> tuple[str, bytes]:
    """Name and bytes of a file; a folder is packed into a ZIP archive."""
    if not file.is_dir():
        return file.name, file.read_bytes()
    archive = BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as into:
        for part in sorted(file.iterdir()):
            into.write(part, f"{file.name}/{part.name}")
    return f"{file.name}.zip", archive.getvalue()
