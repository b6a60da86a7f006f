"""What takes longer than a preview: exact figures, checks, searches, files; in another process.

A request is a mapping of `text`, `source`, `folder`, `run` and `trust_xacro`, which are the
document and its run, and of `options`, which are those of the task. A result is a frame: its header
has the facts, and a file is an array `content` of bytes, with its `name` and `type` in the header.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from armcontour import _process
from armcontour._files import reading_below
from armcontour._progress import Progress, Step
from armcontour._yaml import load
from armcontour.errors import ArmContourError, Collision, InvalidInput
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.jobs import Job, RunPlan, RunResult
    from armcontour.studio.preview import Previewer
    from armcontour.studio.view import View

# Progress is told this often at most [s].
OFTEN = 0.1
# Clearance is measured at so many times, and so many of the nearest pairs are told.
CLEARANCE_TIMES, MOST_PAIRS = 400, 10
# A sweep has so many points by default.
SWEPT = 15
# A small job with which the process loads what all tasks need.
SMALL = """
name: small
arm: pmk3s
path: {points: [[0.35, 0.1], [0.4, 0.15], [0.35, 0.2]]}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
runs: {one: {}}
"""
TYPES = {
    ".csv": "text/csv",
    ".html": "text/html",
    ".script": "text/plain",
    ".src": "text/plain",
    ".mod": "text/plain",
    ".yaml": "application/yaml",
    ".zip": "application/zip",
}
# How often the process looks whether it still works for somebody [s].
LOOK = 1.0
# Motions whose starts differ by more are in different configurations [rad].
SAME = 0.01
OTHER_CONFIGURATION = "The full run starts in another configuration of the arm than the preview."
Heard: TypeAlias = Callable[[bytes], None]


@dataclass(kw_only=True)
class Request:
    """A task on a document.

    Args:
        text: Text of the job file.
        source: Its name in messages.
        folder: Folder of relative file names.
        run: Name of the run.
        trust_xacro: Whether the arm may be a .xacro file.
        options: Options of the task.
        allowed: Folders in which files may be read; without any, everywhere.
        named: Files elsewhere that may be read.
        progress: Called with steps.
    """

    text: str
    source: str = "job"
    folder: str = ""
    run: str | None = None
    trust_xacro: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    allowed: Sequence[str] = ()
    named: Sequence[str] = ()
    progress: Progress = lambda step: None

    @cached_property
    def data(self) -> dict[str, Any]:
        """The job as parsed."""
        found = load(self.text, self.source)
        if not isinstance(found, dict):
            raise InvalidInput(f"{self.source} must hold a mapping of keys such as arm and path.")
        return found

    @cached_property
    def previewer(self) -> Previewer:
        """Keeps what does not change from one task to the next."""
        key = self.folder, self.trust_xacro
        if key not in _previewers:
            from armcontour.studio.preview import Previewer

            _previewers.clear()
            _previewers[key] = Previewer(FilePath(self.folder), trust_xacro=self.trust_xacro)
        return _previewers[key]

    @cached_property
    def job(self) -> Job:
        """The job with the run only, without experiments and requirements of a certificate."""
        return self.previewer.job(self.data, self.run)

    @cached_property
    def whole_job(self) -> Job:
        """The job with all that its file has."""
        from armcontour.io import parse_job

        return parse_job(
            self.text,
            source=self.source,
            folder=FilePath(self.folder),
            trust_xacro=self.trust_xacro,
        )

    @cached_property
    def taught(self) -> RunPlan:
        """Plan and taught data of the run."""
        from armcontour.jobs import teach

        (found,) = teach(self.job, progress=self.progress).values()
        return found

    @cached_property
    def result(self) -> RunResult:
        """The result of the run."""
        from armcontour.jobs import run

        (found,) = run(self.job, progress=self.progress).runs.values()
        return found

    @cached_property
    def view(self) -> View:
        """The plane that the document is drawn in."""
        from armcontour.studio.handles import handles_of
        from armcontour.studio.view import View

        handles = handles_of(self.job, self.data)
        return View(handles.plane, handles.centre)

    def option(self, name: str, default: Any) -> Any:
        """An option of the task, or a default."""
        found = self.options.get(name)
        return default if found is None else found


# One, of the last folder.
_previewers: dict[tuple[str, bool], Previewer] = {}


class Given(NamedTuple):
    """Work for the other process.

    Args:
        id: Its name, by which it can be cancelled.
        task: What is done, of `TASKS`.
        request: What it is done with, as `do` takes it.
    """

    id: str
    task: str
    request: Mapping[str, Any]


WARM = Given("", "warm", {})


def work(given: Given, heard: Heard = _process.tell) -> bytes:
    """What the other process does: a task, with its progress, to a frame.

    Args:
        given: The task; WARM only loads what tasks need.
        heard: Called with frames of progress, as bytes.
    """
    id, task, request = given
    if given == WARM:
        _be_ready()
        return b""
    telling = _Telling(id, task, heard)
    try:
        found = do(task, request, telling)
    except ArmContourError as error:
        found = Frame("failed", {"sentence": str(error), "error": type(error).__name__})
    except Exception as error:
        found = Frame("failed", {"sentence": f"{task} failed: {type(error).__name__}: {error}"})
    return replace(found, header={**found.header, "id": id, "task": task}).pack()


class _Telling:
    """Tells of the progress of a task, now and then.

    Args:
        id: Name of the task for answers.
        task: What is done.
        heard: Called with frames, as bytes.
    """

    def __init__(self, id: str, task: str, heard: Heard) -> None:
        self._facts = {"id": id, "task": task}
        self._heard = heard
        self._begin = self._last = time.monotonic()

    def __call__(self, step: Step) -> None:
        """Tell of a step, if it is time."""
        now = time.monotonic()
        if now - self._last < OFTEN:
            return
        self._last, share = now, step.done
        left = (now - self._begin) * (1 - share) / share if share else None
        facts = {**self._facts, "steps": step.names, "share": share, "eta": left}
        self._heard(Frame("progress", facts).pack())


def _be_ready() -> None:
    """Load what tasks need, without taking processors from previews; end with the parent."""
    if _process.is_other() and hasattr(os, "nice"):
        os.nice(5)
        threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    figures(Request(text=SMALL))


def _end_with(parent: int) -> None:
    """End this process when it works for nobody any more: not only after its task."""
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)


def do(task: str, request: Mapping[str, Any], progress: Progress) -> Frame:
    """Do a task.

    Args:
        task: A name of `TASKS`.
        request: The document and options.
        progress: Called with steps.

    Raises:
        ArmContourError: What the task is refused for; exact figures are a refusal in its place.
    """
    if task not in TASKS:
        raise InvalidInput(f"There is no task {task!r}: there are {', '.join(TASKS)}.")
    x = Request(**request, progress=progress)
    named = [FilePath(y) for y in x.named]
    with reading_below(map(FilePath, x.allowed), named) if x.allowed else nullcontext():
        return TASKS[task](x)


def figures(x: Request) -> Frame:
    """The figures of a full run, or what it refuses and where.

    Options: `start`, joint positions at the start of the preview, to say where they differ.
    """
    from armcontour.studio.picture import refusal_header

    try:
        result = x.result
    except ArmContourError as error:
        try:
            told = refusal_header(error, x.view, tier=3, run=x.run or "")
        except InvalidInput:
            # The data make no job, so that there is no plane to draw in.
            told = {"tier": 3, "run": x.run, "sentence": str(error), "at": {}}
        return Frame("refusal", {**told, "of": "live"})
    e, near, start = result.evaluation, result.clearance, result.trajectory(0.0)
    least = None if near is None else near.least
    off = e.objective_error
    header: dict[str, Any] = {
        **{"run": result.run.name, "of": "live", "duration": e.duration, "settled": e.settled},
        **{"rms": e.contour_error.rms, "max": e.contour_error.max, "t_max": e.contour_error.t_max},
        "objective_max": None if off is None else off.max,
        "missed": e.missed.max,
        "saturated": [
            {"joint": name, "time": span}
            for name, span in zip(
                x.job.arm.joint_names, result.execution.saturated_time.tolist(), strict=True
            )
            if span > 0
        ],
        "demand": e.demand_ratio,
        "limit_use": e.limit_ratios,
        "clearance": None
        if least is None
        else {"least": least.high, "pair": [least.first, least.second], "t": least.t},
        "start": start,
        "warnings": result.warnings,
        "notes": [
            *(y for y in (result.shape_note, result.stops_note, result.clearance_note) if y),
            *x.job.arm.notes,
        ],
    }
    preview = x.options.get("start")
    if preview is not None and np.abs(start - preview).max() > SAME:
        header["notes"].append(OTHER_CONFIGURATION)
    return Frame("figures", header)


def plan(x: Request) -> Frame:
    """The picture of the plan as a full run has it, in whatever time that takes."""
    from armcontour.studio.picture import picture_frame

    planned = x.previewer.plan(x.data, x.run, exact=True, progress=x.progress)
    return picture_frame(planned, x.view)


def check(x: Request) -> Frame:
    """The plan checked against all limits, by code that shares nothing with the planner."""
    from armcontour.arms.limits import UNITS
    from armcontour.evaluation import check

    plan = x.taught
    found = check(plan.trajectory, x.job.arm, plan.run.limits, plan.path)
    worst = found.worst
    most = "" if worst is None else f" {worst.name} is used most, by {worst.certain:.6f}."
    rows = [
        {
            **{"limit": y.name, "ratio": y.certain, "value": y.value, "allowed": y.limit},
            **{"unit": UNITS.get(y.name, "m"), "t": y.t, "s": y.s, "joint": y.joint},
            "verdict": y.verdict,
        }
        for y in found.uses
    ]
    verdict = {"kept": "All limits are kept.", "violated": "A limit is exceeded."}
    sentence = verdict.get(found.verdict, "It cannot be told whether all limits are kept.") + most
    return Frame(
        "result",
        {
            **{"run": plan.run.name, "verdict": found.verdict, "sentence": sentence},
            **{"rows": rows, "states": found.states, "not_judged": found.not_judged},
        },
    )


def certify(x: Request) -> Frame:
    """The fastest plan whose execution keeps the tolerance, as a report; and its figures.

    Options: fields of `jobs.Goal`, such as `tolerance` [m].
    """
    from armcontour.certification import certify
    from armcontour.io import certificate_json
    from armcontour.report import render_report

    # Published figures are of other plans, whose runs the report would not have.
    job = replace(x.whole_job, published=None)
    found = certify(job, x.run, progress=x.progress, **x.options)
    x.progress(Step(("writing",)))
    data = json.loads(certificate_json(found))["certificate"]
    budget = found.budget
    sentence = (
        f"Certified: {found.duration:.4f} s, {found.cost:+.4f} s to the optimum, with "
        f"{budget.left * 1e3:.4g} mm of the tolerance left. It holds for: {found.model}."
    )
    header = {
        **{"run": found.run.name, "sentence": sentence, "duration": found.duration},
        **{"cost": found.cost, "left": budget.left, "certificate": data},
    }
    page = render_report(found.study, certificate=found)
    return _file(f"{found.job.name}-certificate.html", page.encode(), header)


def sweep(x: Request) -> Frame:
    """Duration and error over the values of one key, in previews.

    Options: `key`, and `values` in SI units, or `min`, `max` and `count`, evenly or with `log`.
    """
    from armcontour.io.job_edits import change_data
    from armcontour.studio.edits import EditState, changes_of
    from armcontour.studio.handles import handles_of

    key, values = str(x.option("key", "")), _values(x)
    state = EditState(data=x.data, run=x.job.runs[0].name, handles=handles_of(x.job, x.data))
    duration, rms, most = (np.full(len(values), np.nan) for _ in range(3))
    refusals: list[str | None] = []
    for k, value in enumerate(values.tolist()):
        x.progress(Step((f"{k + 1} of {len(values)}",), k / len(values)))
        try:
            changes = changes_of({"do": "set", "key": key, "value": value}, state)
            planned = x.previewer.plan(change_data(x.data, changes), x.run)
            duration[k] = planned.trajectory.duration
            errors = x.previewer.execute(planned).errors
            rms[k], most[k] = errors.rms, errors.max
            refusals.append(None)
        except ArmContourError as error:
            refusals.append(str(error))
    return Frame(
        "result",
        {"run": state.run, "key": key, "refusals": refusals},
        {"values": values, "duration": duration, "rms": rms, "max": most},
    )


def _values(x: Request) -> Any:
    """The values of a sweep.

    Raises:
        InvalidInput: No values.
    """
    given = x.options.get("values")
    if given is not None:
        return np.array(given, dtype=np.float64)
    low, high = x.options.get("min"), x.options.get("max")
    if low is None or high is None:
        raise InvalidInput("A sweep needs values, or min and max.")
    space = np.geomspace if x.option("log", False) else np.linspace
    return space(float(low), float(high), int(x.option("count", SWEPT)))


def place(x: Request) -> Frame:
    """Where the part lies best: a map of a grid of places, and the best place.

    Options: those of `placement.place`, such as `over`. Shifts are in the plane of the picture.
    """
    from armcontour.placement import place, shown

    given = dict(x.options)
    given.setdefault("processes", 1)
    found = place(x.job, x.run, progress=x.progress, **given)
    verdicts, objective = found.verdicts, found.objective
    places = [found.place(k) for k in range(len(verdicts))]
    kinds = list(found.refusals)
    best = found.refined
    gained = found.own.duration - best.verdict.duration
    sentence = f"Best: {best}, with {shown(best.verdict.score(objective), objective)}."
    if np.isfinite(gained):
        than = "less" if gained >= 0 else "more"
        sentence += f" The motion takes {abs(gained):.4f} s {than} than where the part is now."
    header = {
        **{"run": found.run.name, "sentence": sentence, "objective": objective},
        "axes": [{"name": y.name, "values": y.values} for y in found.axes],
        "anchor": x.view.uv(found.moves.anchor),
        "refusals": kinds,
        "best": {
            **{"values": best.values, "by": _shift(x.view, best.values)},
            **{"turn": best.values.get("yaw", 0.0), "duration": best.verdict.duration},
        },
        "own": {"duration": found.own.duration, "refusal": found.own.refusal},
        "notes": found.notes,
    }
    refused = [kinds.index(y.refusal) if y.refusal else 255 for y in verdicts]
    scores = np.array([y.score(objective) for y in verdicts])
    arrays: dict[str, Any] = {
        "by": np.array([_shift(x.view, y) for y in places], dtype=np.float32),
        "turn": np.array([y.get("yaw", 0.0) for y in places], dtype=np.float32),
        "duration": np.array([y.duration for y in verdicts], dtype=np.float32),
        "score": scores.astype(np.float32),
        "refusal": np.array(refused, dtype=np.uint8),
    }
    return Frame("result", header, arrays)


def _shift(view: View, values: Mapping[str, float]) -> Any:
    """The shift of a place in the plane of the picture [m], (2,)."""
    shift = np.array([values.get(name, 0.0) for name in "xyz"])
    return view.offsets(shift[None])[0]


def learn(x: Request) -> Frame:
    """What learning would gain, on a simulated robot that the controller does not know.

    Options: `runs`, the largest number of runs, and `seed`.
    """
    from armcontour.io.learning import learning_json
    from armcontour.jobs.learning import plan_run, simulate_learning
    from armcontour.jobs.unknown_robot import unknown_robot
    from armcontour.report import render_learning

    plan = plan_run(x.whole_job, x.run, progress=x.progress)
    robot, about = unknown_robot(x.whole_job, plan, x.options.get("seed"))
    found = simulate_learning(
        x.whole_job, plan, robot, about, runs=int(x.option("runs", 6)), progress=x.progress
    )
    x.progress(Step(("writing",)))
    errors = [y.contour_error for y in found.simulated]
    best = errors[found.lesson.best].rms if found.lesson.best < len(errors) else errors[-1].rms
    sentence = (
        f"In {len(errors)} simulated runs the error fell from {errors[0].rms * 1e3:.4g} mm to "
        f"{best * 1e3:.4g} mm (RMS)."
    )
    header = {
        **{"run": plan.run.name, "sentence": sentence, "robot": about},
        **{"rms": [y.rms for y in errors], "max": [y.max for y in errors]},
        "learning": json.loads(learning_json(found))["learning"],
        "notes": found.notes,
    }
    return _file(f"{found.job.name}-learning.html", render_learning(found).encode(), header)


def clearance(x: Request) -> Frame:
    """How far the arm stays from itself and its cell over time, and the pair that is nearest."""
    from armcontour.clearance import Cell
    from armcontour.jobs import teach
    from armcontour.scene import Scene
    from armcontour.studio.view import short

    cell = Cell(x.job.arm, x.job.scene or Scene())
    try:
        plan = x.taught
    except Collision:
        # Where it comes too near is what is asked for.
        (plan,) = teach(replace(x.job, ignore_collisions=True), progress=x.progress).values()
    found = cell.check(plan.trajectory)
    t = np.linspace(0.0, plan.trajectory.duration, CLEARANCE_TIMES)
    over_time = cell.least_over(plan.trajectory(t))
    header = {
        **{"run": plan.run.name, "sentence": str(found), "kept": found.kept},
        "kinds": list(over_time),
        "nearest": [
            {
                **{"pair": [y.first, y.second], "kind": y.kind, "margin": y.margin},
                **{"least": y.high, "t": y.t, "points": y.points},
            }
            for y in found.pairs[:MOST_PAIRS]
        ],
        "left_out": len(found.left_out),
    }
    over_time["t"] = t
    return Frame("result", header, {name: short(y) for name, y in over_time.items()})


def export(x: Request) -> Frame:
    """The set-points or the plan in a format of a controller or a table.

    Options: `format`, a name of `io.exports.formats()`; for "template" its `template`; `of`,
    "taught" or "planned"; `period` of a plan [s]; `outputs`, `derivatives` and `tool_motion`.
    """
    from armcontour.io.exports import export, formats
    from armcontour.io.exports.template import SHIPPED
    from armcontour.jobs import analog_outputs

    kind, plan = str(x.option("format", "csv")), x.taught
    endings = formats()
    if kind not in endings:
        raise InvalidInput(f"There is no format {kind!r}: there are {', '.join(endings)}.")
    template = x.options.get("template")
    if template is not None and template not in SHIPPED:
        raise InvalidInput(f"There is no template {template!r}: there are {', '.join(SHIPPED)}.")
    ending = endings[kind]
    if template is not None:
        ending = FilePath(SHIPPED[template].removesuffix(".j2")).suffix
    taught = x.option("of", "taught") == "taught"
    x.progress(Step(("writing",)))
    with tempfile.TemporaryDirectory() as folder:
        file = FilePath(folder) / f"{x.job.name}-{plan.run.name}{ending}"
        export(
            plan.taught if taught else plan.trajectory,
            file,
            arm=x.job.arm,
            format=kind,
            template=template,
            period=None if taught else x.option("period", plan.run.period),
            name=f"{x.job.name} {'taught' if taught else 'reference'}",
            outputs=x.options.get("outputs"),
            derivatives=int(x.option("derivatives", 2)),
            tool_motion=bool(x.option("tool_motion", False)),
            analog=_analog(kind, plan, x.job, analog_outputs),
        )
        name, content = _content_of(file)
    header = {"run": plan.run.name, "points": len(plan.taught.q), "warnings": plan.warnings}
    return _file(name, content, header)


def _analog(kind: str, plan: RunPlan, job: Job, outputs: Callable[..., Any]) -> Any:
    """The analog outputs of a plan, for formats that have them."""
    from armcontour.io.exports import WITH_ANALOG

    if kind not in WITH_ANALOG:
        return None
    return outputs(plan.path, plan.trajectory, job.process, plan.run.limits) or None


def _file(name: str, content: bytes, header: Mapping[str, Any]) -> Frame:
    """A result that is a file."""
    kind = TYPES.get(FilePath(name).suffix, "application/octet-stream")
    told = {**header, "name": name, "type": kind, "bytes": len(content)}
    return Frame("result", told, {"content": np.frombuffer(content, np.uint8)})


def _content_of(file: FilePath) -> tuple[str, bytes]:
    """Name and bytes of a file; a folder becomes an archive."""
    if not file.is_dir():
        return file.name, file.read_bytes()
    archive = BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as into:
        for part in sorted(file.iterdir()):
            into.write(part, f"{file.name}/{part.name}")
    return f"{file.name}.zip", archive.getvalue()


def report(x: Request) -> Frame:
    """The report of the run as one page of HTML; with the option `all`, of all runs."""
    from armcontour.jobs import run
    from armcontour.report import render_report

    job = x.whole_job
    if not x.option("all", False):
        chosen = tuple(y for y in job.runs if x.run in (None, y.name))[:1]
        job = replace(job, runs=chosen, published=None)
    study = run(job, progress=x.progress)
    x.progress(Step(("writing",)))
    return _file(f"{job.name}-report.html", render_report(study).encode(), {"run": x.run})


TASKS: dict[str, Callable[[Request], Frame]] = {
    "figures": figures,
    "plan": plan,
    "check": check,
    "certify": certify,
    "sweep": sweep,
    "place": place,
    "learn": learn,
    "clearance": clearance,
    "export": export,
    "report": report,
}
