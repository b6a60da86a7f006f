"""Tasks that create a file, and tasks that read logs of the robot.

Options of tasks with logs: `logs`, names of the logs in the order of the runs, and `columns` and
`topic` as in `read_log`.
"""

from __future__ import annotations

import pickle
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Step
from armcontour.core.render import cells, frame
from armcontour.core.result import TABLE, VERDICT, Data, Row
from armcontour.core.validity import AS_MODELLED
from armcontour.files.job_model import IDENTIFIED
from armcontour.report.message_frame import MessageFrame, bytes_array
from armcontour.studio.tasks.figures import exact_figures
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.control.identification import Identification
    from armcontour.core.source_file import SourceFile
    from armcontour.jobs import Job, RunResult
    from armcontour.jobs.run_learning import LearnedRun

# Maximum size of a certified plan that the Studio shows [bytes].
MAX_PLAN = 200_000_000
# Format whose file names must be KRL identifiers.
KUKA = "kuka"
# Motions that are exported, by the value of the option `of`, with their names in programs.
PLANNED = "planned"
PLAIN = "set_points"
LEARNED = "learned"
CERTIFIED = "certified"
NAMES = {PLAIN: "set_points", LEARNED: "learned", PLANNED: "reference", CERTIFIED: "certified"}
# Maximum length of a KRL identifier [characters].
MAX_LETTERS = 24


def report(request: Request) -> MessageFrame:
    """Create an HTML report of the run; with the option `all`, of all runs."""
    from armcontour.jobs import run
    from armcontour.jobs.advice import with_advice
    from armcontour.report import render_report

    job = request.whole_job
    if not request.option("all", False):
        chosen = tuple(y for y in job.runs if request.run in (None, y.name))[:1]
        job = replace(job, runs=chosen)
    job_result = with_advice(run(job, progress=request.progress), request.progress)
    request.progress(Step(("writing",)))
    return MessageFrame.of_file(
        f"{job.name}-report.html",
        render_report(job_result).encode(),
        {"sentence": "The report is ready."},
    )


def certify(request: Request) -> MessageFrame:
    """Certify the run and create a report; the options are fields of `CertificateGoal`."""
    from armcontour.core.render import plain
    from armcontour.report import render_report
    from armcontour.studies.certification import certify
    from armcontour.studies.certification.certification import goal_of

    job = request.whole_job
    chosen = request.job.runs[0]
    if job.certificate is None and request.options.get("tolerance", chosen.accuracy) is None:
        raise InvalidInput(
            "Certify requires a tolerance, because the job does not specify one. Enter it next to "
            "Certify."
        )
    goal = goal_of(job, chosen.name, **request.options)
    certificate = certify(job, run=request.run, goal=goal, progress=request.progress)
    request.progress(Step(("writing",)))
    data = certificate.to_data()
    result = certificate.result
    header = {
        **shown(data),
        "sentence": _proved(result),
        "run": result.run.name,
        "notes": [*data.notes, *data.warnings, data.not_proven],
        "certificate": plain(data),
    }
    plan = pickle.dumps(result)
    page = render_report(
        certificate.job_result, certificate=certificate, set_points=_certified_csv(request, plan)
    )
    name = f"{certificate.job.name}-certificate.html"
    file_frame = MessageFrame.of_file(name, page.encode(), header)
    if len(plan) >= MAX_PLAN:
        return file_frame
    figures = MessageFrame("figures", exact_figures(request, result)).pack()
    arrays = {"plan": bytes_array(plan), "figures": bytes_array(figures)}
    return replace(file_frame, arrays={**file_frame.arrays, **arrays})


def _certified_csv(request: Request, plan: bytes) -> SourceFile | None:
    """Return the CSV file that `export` writes of a certified plan; None if it refuses the job."""
    from armcontour.core.source_file import SourceFile, fingerprint

    options = {"format": "csv", "of": CERTIFIED}
    with suppress(ArmContourError):
        frame = export(replace(request, options=options, plan=plan))
        content = frame.arrays["content"].tobytes()
        return SourceFile(str(frame.header["name"]), fingerprint(content))
    return None


def _proved(result: RunResult) -> str:
    """Say which plan a certificate proves: it is not the plan of the run."""
    from armcontour.core.render import number

    run = result.run
    facts = [f"timing {run.timing.method}", f"compensation {run.compensation.method}"]
    if run.rounding is not None and run.rounding.tolerance is not None:
        facts.append(f"corners within {number(run.rounding.tolerance, 'm')}")
    duration = number(result.trajectory.duration, "s")
    return (
        f"Proved is a plan of its own, not the plan of run {run.name}: {', '.join(facts)}, "
        f"{duration}."
    )


def export(request: Request) -> MessageFrame:
    """Export set-points or the plan.

    Options: `format`, `of` (set_points, planned, learned or certified), `cycle` [s]. `certified`
    exports the set-points of `request.plan`, which a certificate proves.
    """
    from armcontour.files.exports.export_checks import check_export
    from armcontour.files.exports.exporting import Exporter
    from armcontour.files.exports.formats import ENDINGS, format_named, outputs_of
    from armcontour.files.exports.identifiers import identifier

    kind = str(request.option("format", "csv"))
    if kind not in ENDINGS:
        raise InvalidInput(f"The format must be one of {', '.join(ENDINGS)}, but is {kind!r}.")
    job = request.job
    format = format_named(kind, job.export)
    source = request.option("of", PLAIN if format.keeps_times else PLANNED)
    if source not in NAMES:
        raise InvalidInput(f"of must be one of {', '.join(NAMES)}, but is {source!r}.")
    (run,) = job.runs
    names = [job.name, run.name, *([CERTIFIED] if source == CERTIFIED else [])]
    stem = "-".join(names)
    if kind == KUKA:
        # The file name of a KRL program is its identifier.
        words = " ".join(names)
        stem = identifier(words if words[:1].isalpha() else f"p {words}", MAX_LETTERS)
    cycle = request.option("cycle", None) if source == PLANNED else None
    # The motion is planned only if it can be exported.
    is_plan = source == PLANNED or (source == PLAIN and not run.compensation.compensates)
    Exporter(format).check_compensation(stem, is_plan)
    check_export(job, kind, stem=stem, cycle=cycle)
    if source == CERTIFIED:
        if not request.plan:
            raise InvalidInput("The export of a certified plan requires its certificate.")
        plan = pickle.loads(request.plan)
    elif source == LEARNED:
        learned_run = learn_from_logs(request)
        # The simulation is of other set-points.
        plan = replace(learned_run.plan, set_points=learned_run.lesson, execution=None)
    else:
        plan = _exported_run(request, kind, cycle)
    request.progress(Step(("writing",)))
    data = plan.trajectory if source == PLANNED else plan.set_points
    prepared = Exporter(format).prepare_run(
        job, plan, NAMES[source], data, cycle=cycle, origin=request.origin
    )
    with tempfile.TemporaryDirectory() as folder:
        file = FilePath(folder) / f"{stem}{ENDINGS[kind]}"
        prepared.write(file)
        content = file.read_bytes()
    switches = dict.fromkeys(x.name for x in prepared.table.events if isinstance(x.value, bool))
    changes = []
    if format.program is not None:
        missing = [x for x in switches if x not in outputs_of(format)]
        changes = [_name_output(job, x, kind, format.program.output) for x in missing]
    sentence = f"{len(plan.set_points.q)} set-points."
    if prepared.table.between:
        sentence = f"{len(prepared.table.t)} points; {prepared.table.between}."
    header = {
        "sentence": sentence,
        "changes": changes,
        "warnings": (
            *plan.warnings,
            *(f"Format {format.label}: {said}" for said in prepared.warnings),
        ),
    }
    return MessageFrame.of_file(file.name, content, header)


def _exported_run(request: Request, kind: str, cycle: float | None) -> RunResult:
    """Return the run with set-points within the limits of the controller of a format.

    `cycle`: requested time between the points of a plan [s]; None for that of the job.
    """
    from armcontour.jobs import run

    job = request.job
    formats = dict.fromkeys((*job.export.formats, kind))
    exports = replace(job.export, formats=tuple(formats), cycle=cycle or job.export.cycle)
    job = replace(job, export=exports)
    # Tolerances of a goal are predicted from the simulation.
    simulate = job.export.tolerances is not None
    (result,) = run(job, simulate=simulate, progress=request.progress).runs.values()
    if result.failure is not None:
        raise result.failure
    return result


def _name_output(job: Job, event: str, kind: str, output: int | str) -> dict[str, Any]:
    """Change that names the output of an event; the user can change it in the settings."""
    key = ["export", "outputs", event]
    if event in job.export.outputs:
        # The output is named for other formats only.
        key.append(kind)
    edit = {"do": "set", "key": key, "value": output}
    return {"label": f"Output {output} for {event}", "edits": [edit]}


def identify(request: Request) -> MessageFrame:
    """Identify the servo of each joint; the frame has the edit that writes servos into the job."""
    from armcontour.control.identification import ServoFit, identify
    from armcontour.files.limits_and_servo_files import servo_values
    from armcontour.files.sources import recording_files
    from armcontour.report.identification import render_identification
    from armcontour.report.origin import Origin

    with recording_files() as sources:
        logs = read_logs(request, commanded=True)
    identification = identify(logs, ServoFit(kinematics=request.job.arm), progress=request.progress)
    data = identification.to_data()
    changes = []
    if any(y.written for y in identification.joints):
        servo = servo_values(identification, request.job.servo)
        if identification.moving_trusted:
            edit = {"do": "set", "key": "servo", "value": servo}
            label = "Use this servo"
            if resting := identification.resting:
                label += f" (assumed gains stay at {', '.join(resting)})"
            changes = [{"label": label, "edits": [edit]}]
        expected = (*_expected_errors(request, servo), *_gains(identification))
        # The gains of each joint are what the user needs.
        data = replace(data, rows=(*expected, *data.rows), tables=data.tables[::-1])
    facts = {"kept": identification.moving_trusted, "changes": changes, "label": "Download report"}
    origin = Origin(job=request.job.name, sources=sources)
    page = render_identification(identification, origin).encode()
    name = f"{request.job.name}-identification.html"
    return MessageFrame.of_file(name, page, {**facts, **shown(data, logs)})


def _expected_errors(request: Request, servo: dict[str, Any]) -> list[Row]:
    """Simulate the run on the identified servo: contour errors now, and if the job uses it."""
    plant = {name: x for name, x in servo.items() if name not in IDENTIFIED}
    job = {name: x for name, x in request.data.items() if name not in ("servo", "plant")}
    now = {**job, "servo": request.data["servo"], "plant": plant}
    rows = []
    try:
        for name, label, keys in (
            ("error_now", "contour error now", now),
            ("error_then", "with this servo", {**job, "servo": servo}),
        ):
            planned = request.previewer.plan(keys, request.run)
            if not request.previewer.may_execute(planned):
                return []
            error = request.previewer.execute(planned).errors.max
            rows.append(Row(name, error, "m", label, AS_MODELLED, VERDICT))
    except ArmContourError:
        # The run may need gains that the log does not determine.
        return []
    return rows


def _gains(identification: Identification) -> Iterator[Row]:
    """Return the rows of the gains, each with its range over the joints."""
    for name in ("kp", "kv"):
        found = [x.parameters[name] for x in identification.joints if name in x.parameters]
        if found:
            values = [x.value for x in found]
            ends = dict.fromkeys(f"{x:.3g}" for x in (min(values), max(values)))
            text = f"{' to '.join(ends)} {found[0].unit}"
            count = len(identification.joints)
            who = "all joints" if len(found) == count else f"{len(found)} of {count} joints"
            yield Row(name, text, "", name, who, VERDICT)


def learn(request: Request) -> MessageFrame:
    """Learn the set-points of the next run; creates the same file as `armcontour learn`."""
    from armcontour.files.exports.export_table import set_point_pieces

    learned_run = learn_from_logs(request)
    content = "".join(
        set_point_pieces(learned_run.lesson, learned_run.job.arm.joint_names)
    ).encode()
    name = f"{learned_run.job.name}-{learned_run.plan.run.name}-set_points.csv"
    return MessageFrame.of_file(
        name, content, {"label": "Download next set-points", **shown(learned_run.result)}
    )


def learn_from_logs(request: Request) -> LearnedRun:
    """Learn from the logs of successive runs."""
    from armcontour.jobs.run_learning import LearnedRun, learn_logs, plan_run

    job = request.whole_job
    progress = request.progress
    plan = plan_run(job, request.run, progress)
    lesson = learn_logs(job, plan, read_logs(request), progress=progress)
    return LearnedRun(job=job, plan=plan, lesson=lesson)


def read_logs(request: Request, *, commanded: bool = False) -> list[Any]:
    """Read the logs of a task, with joints in the order of the arm.

    `commanded`: the logs must contain set-points.
    """
    from armcontour.files.log_file import read_run_log

    if not request.logs:
        raise InvalidInput(
            "This task requires a log of the robot. Drop a log on the page and select it."
        )
    request.progress(Step(("reading the log",)))
    columns = str(request.option("columns", "")) or None
    topic = str(request.option("topic", "")) or None
    names = request.job.arm.joint_names
    try:
        return [
            read_run_log(y, names, columns=columns, topic=topic, commanded=commanded)
            for y in request.logs
        ]
    except InvalidInput as error:
        # The message names the log without the folder of uploads.
        sentence = str(error).replace(f"{FilePath(request.logs[0]).parent}/", "")
        raise InvalidInput(_with_field_columns(sentence)) from None


def _with_field_columns(sentence: str) -> str:
    """Return a message about a log with the field *columns* of the page in place of its option."""
    with_values = re.sub(r"--columns '([^']*)'", r"\1 in the field columns", sentence)
    return with_values.replace("--columns", "the field columns")


def shown(data: Data, logs: Sequence[Any] = ()) -> dict[str, Any]:
    """Return a result's values, tables and notes, the same as the terminal prints."""
    from armcontour.report.message_frame import without_options

    tables = [{"title": y.name, "cells": cells(y)} for y in data.tables if y.level <= TABLE]
    notes = [without_options(x) for x in chain(data.notes, *(y.notes for y in logs))]
    notes += filter(None, [data.not_proven])
    return {"rows": frame(data), "tables": tables, "notes": notes}
