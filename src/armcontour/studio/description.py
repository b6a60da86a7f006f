"""Message frame `document`: file, runs, waypoints, slider values and obstacles of the job."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import read_plain, unit_of, write_like
from armcontour.core.render import number, scale
from armcontour.core.source_file import fingerprint
from armcontour.core.text import Keys
from armcontour.files.file_keys import quantity_of
from armcontour.files.job_file import GEOMETRY_KEYS
from armcontour.files.job_model import JobModel
from armcontour.files.job_patch import full_key, locate_key
from armcontour.files.job_text_edits import line_of, value_at
from armcontour.files.touch_file import touch_columns
from armcontour.jobs import Job
from armcontour.planning import Optimal
from armcontour.report.arm_frame import matrix
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.capped_speeds import capped_speeds
from armcontour.studio.differences import differences
from armcontour.studio.document import Document
from armcontour.studio.edits.keys import EXTERNAL_AXES, joint_unit, run_of, shown_unit, value_of
from armcontour.studio.edits.layout import tilt_ignored, tilt_of
from armcontour.studio.edits.obstacles import part_names
from armcontour.studio.handles import LENGTH, Handles, obstacles_of, plane_in
from armcontour.studio.run_keys import differing_keys, values_of
from armcontour.studio.slider_ranges import SLIDER_RANGES

# Labels of edits in the undo list, by `do` of the edit.
LABELS = {
    "move_waypoint": "move waypoint {number}",
    "set_waypoint": "set waypoint {number}",
    "insert_waypoint": "insert waypoint {number}",
    "remove_waypoint": "remove waypoint {number}",
    "place": "place the part",
    "obstacle": "{action} an obstacle",
    "allow": "let {bodies} touch",
    "draw": "draw",
    "text": "edit the text",
    "set": "set {key}",
    "unset": "remove {key}",
    "tilt": "tilt the tool",
    "add_run": "add a run",
    "pick": "add edges",
    "unpick": "remove edges",
    "order": "order the contours",
}
# Edits whose label has the changed values, such as "Speed 50 mm/s → 40 mm/s".
NAMED_BY_VALUES = ("set", "unset", "place", "obstacle", "tilt", "order", "text", "add_run", "allow")
# Largest number of values in a label.
MAX_NAMED_VALUES = 3
# Maximum number of listed steps of the undo list; the newest ones are listed.
MAX_STEPS = 200


def slider_rows(data: Mapping[str, Any], job: Job, run: str) -> dict[str, dict[str, Any]]:
    """Return the shown run's slider rows by key, in SI units.

    A quantity whose joint values differ has one row per joint, with the joint index in the key.
    """
    rows = dict[str, dict[str, Any]]()
    for keys in SLIDER_RANGES:
        rows.update(_quantity(keys, data, job, run))
    return rows


def _quantity(
    keys: Keys, data: Mapping[str, Any], job: Job, run: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a quantity's key and slider row; one row per joint if the joint values differ."""
    written = value_at(data, locate_key(keys, data, run))
    value = value_of(keys, job, run_of(job, run))
    key = ".".join(map(str, keys))
    if not isinstance(value, np.ndarray):
        yield key, _row(keys, value, written)
        return
    # Ranges (lower and upper bounds) have no slider.
    if value.ndim == 2:
        return
    # Infinite and zero gains have no slider.
    finite = np.flatnonzero(np.isfinite(value) & (value > 0))
    if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(finite):
        for k in finite.tolist():
            text = written[k] if isinstance(written, list) else written
            yield f"{key}.{k}", _joint_row(keys, float(value[k]), text, job, k)
    else:
        yield key, _row(keys, float(value[0]), written)


def _joint_row(keys: Keys, value: float, written: Any, job: Job, joint: int) -> dict[str, Any]:
    """Make the slider row of a joint, with its name.

    `linear` is true if the value has a unit of length, because the joint is prismatic. The file has
    it as a number in SI units, and the page shows it in the units of results.
    """
    kind = quantity_of(JobModel, full_key(keys))
    assert kind is not None
    row = _row(keys, value, written)
    unit = joint_unit(kind, joint, job)
    is_linear = unit != kind.unit
    if is_linear:
        row["unit"], row["factor"] = scale(unit)
    return {**row, "joint": job.arm.joint_names[joint], "linear": is_linear}


def _row(keys: Keys, value: float | None, written: Any) -> dict[str, Any]:
    """Make a slider row: value and range in SI units, and the unit that the job uses."""
    kind = quantity_of(JobModel, full_key(keys))
    assert kind is not None
    unit, factor = unit_of(written, kind)
    low, high = usual = SLIDER_RANGES[keys]
    if value is not None and value > 0 and low > 0:
        low = min(low, 10.0 ** math.floor(math.log10(value)))
        high = max(high, 10.0 ** math.ceil(math.log10(value)))
    of_arm = str(keys[-1]).startswith("joint_") and value is not None
    return {
        **{"value": value, "unit": unit, "factor": factor, "arm": of_arm},
        **{"min": low, "max": high, "log": usual[0] > 0},
    }


def shown_values(data: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return written values of external axes in the units of the page, by key.

    The text of a value contains its unit; that of a list only numbers.
    """
    rows = dict[str, dict[str, str]]()
    for keys in EXTERNAL_AXES:
        rows.update(_shown_values(keys, value_at(data, keys)))
    return rows


def _shown_values(keys: Keys, written: Any) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the values in a mapping or list of external axes, with their keys."""
    if isinstance(written, Mapping):
        for name, value in written.items():
            yield from _shown_values((*keys, name), value)
    elif isinstance(written, list) and any(isinstance(x, Mapping) for x in written):
        for k, value in enumerate(written):
            yield from _shown_values((*keys, k), value)
    elif (row := _shown_value(keys, written)) is not None:
        yield ".".join(map(str, keys)), row


def _shown_value(keys: Keys, written: Any) -> dict[str, str] | None:
    """Return a value in the unit of the page; None if it is shown as written."""
    values = written if isinstance(written, list) else [written]
    kind = quantity_of(JobModel, (*keys, 0) if isinstance(written, list) else keys)
    if kind is None or not (unit := shown_unit(keys, kind)):
        return None
    try:
        texts = [str(write_like(read_plain(x, kind), f"1 {unit}", kind)) for x in values]
    except ValueError:
        return None
    if isinstance(written, list):
        texts = [x.removesuffix(f" {unit}") for x in texts]
    return {"text": ", ".join(texts), "unit": unit}


@dataclass(frozen=True, slots=True)
class JobState:
    """The job of the document without the edits of active gestures.

    Args:
        data: Data of the document.
        job: The job; None if the data are not a valid job.
        handles: Handles of the last valid job; None if no job was valid yet.
        error: Why the data are not a valid job; None if they are.
    """

    data: Mapping[str, Any]
    job: Job | None
    handles: Handles | None
    error: InvalidInput | None = None


def label_of(
    edits: Sequence[Mapping[str, Any]],
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    job: Job | None = None,
) -> str:
    """Return the label that edits have in the undo list.

    A few changed values are named with the values; other edits are named by what they do.

    Args:
        edits: Edits of a page.
        before: Data of the document before the edits.
        after: Data of the document after the edits.
        job: The job before the edits, whose drawing has the layers; None if it is not valid.
    """
    if all(x.get("do") in NAMED_BY_VALUES for x in edits):
        changed = differences(before, after, [] if job is None else _layers(job))
        if 0 < len(changed) <= MAX_NAMED_VALUES:
            return ", ".join(changed)
    first = edits[0]
    bodies = first.get("bodies")
    index = first.get("index")
    words = LABELS[str(first["do"])].format(
        number=index + 1 if isinstance(index, int) else "",
        action=first.get("action", "change"),
        bodies=" and ".join(map(str, bodies)) if isinstance(bodies, list) else "two bodies",
        key=_name(first.get("key", "")).replace("_", " "),
    )
    return words if len(edits) == 1 else f"{words} and {len(edits) - 1} more"


def document_frame(document: Document, state: JobState, run: str) -> MessageFrame:
    """Make the message frame `document`, which describes the whole document."""
    data = state.data
    handles = state.handles
    header: dict[str, Any] = {
        "name": data.get("name"),
        "title": data.get("title") or data.get("name"),
        "file": None if document.file is None else str(document.file),
        "dirty": document.dirty,
        "on_disk": document.on_disk(),
        "undo_label": document.undo_label,
        "redo_label": document.redo_label,
        "steps": _steps(document),
        "runs": runs_of(data),
        "run_states": run_states(data),
        "run_keys": differing_keys(data),
        "run_values": values_of(data, run),
        "run": run,
        "path": _path(data, handles, state, run),
        "waypoints": [] if handles is None else _waypoints(handles),
        "data": {**data, "path": _options(data.get("path"))},
        "values": {} if state.job is None else slider_rows(data, state.job, run),
        "capped": {} if state.job is None else capped_speeds(data, state.job, run),
        "shown": shown_values(data),
        "layers": [] if state.job is None else _layers(state.job),
        "touch_columns": _touch_columns(state.job),
        "tilt": _tilt(handles, data),
        **_scene(data, state.job, handles),
        "text": document.text,
        # Name of the document if it has a draft of an earlier session.
        "draft": None if document.earlier_draft is None else document.source,
        "start": document.is_start,
        "sentence": None if state.error is None else str(state.error),
        "line": None if state.error is None else line_of(document.text, state.error.key),
    }
    return MessageFrame("document", header)


def _steps(document: Document) -> dict[str, Any]:
    """Describe the undo list: the number of its first listed step, labels, number of made steps."""
    labels, made = document.steps
    first = max(0, min(made - MAX_STEPS // 2, len(labels) - MAX_STEPS))
    return {"first": first, "labels": labels[first : first + MAX_STEPS], "made": made}


def _tilt(handles: Handles | None, data: Mapping[str, Any]) -> dict[str, Any] | None:
    """Describe the tilt of the tool, and what a positioner or the file does to it; None without.

    `why_not`: why it has no effect; `note`: that a positioner turns the part.
    """
    tilt = None if handles is None else tilt_of(handles, data)
    if handles is None or tilt is None:
        return None
    positioner = handles.job.arm.chain.positioner
    note = ""
    if positioner is not None and positioner.tilt is not None:
        largest = number(positioner.tilt, "rad")
        note = (
            f"The tilt is relative to the part. The positioner turns the part, so that the tool "
            f"stays within {largest} of gravity (arm.positioner.tilt)."
        )
    return {**tilt, "why_not": tilt_ignored(handles.job, data), "note": note}


def _touch_columns(job: Job | None) -> list[dict[str, str]]:
    """Describe the columns of the table of touches: names and unit; none without a job."""
    columns = () if job is None else touch_columns(job.arm)
    return [{"name": x.name, "label": x.label, "unit": x.unit} for x in columns]


def _scene(data: Mapping[str, Any], job: Job | None, handles: Handles | None) -> dict[str, Any]:
    """Describe the obstacles, the parts of a CAD model, and the plane of the picture.

    `plane` is in the frame of the base, and `part` is the plane and the pose of the part frame in
    the work frame.
    """
    if job is None or handles is None:
        return {"obstacles": [], "parts": []}
    plane = handles.plane
    axes = {"x": plane.x, "y": plane.y, "normal": plane.normal, "origin": plane.origin}
    return {
        "obstacles": obstacles_of(data, job, plane, handles.frame),
        "parts": part_names(data, job.scene),
        "plane": plane_in(plane, job.arm.chain.base),
        "part": {
            **{"at": matrix(handles.frame), "centre": handles.centre, "plane": axes},
            "dimension": job.arm.dimension,
        },
    }


def runs_of(data: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Name, timing, compensation and corner shape of each run in the data of a job."""
    runs = data.get("runs")
    rows = []
    for name, run in runs.items() if isinstance(runs, Mapping) else ():
        options = run if isinstance(run, Mapping) else {}
        corners = options.get("corners", data.get("corners", "sharp"))
        rows.append(
            {
                "name": name,
                "timing": _method(options.get("timing"), Optimal.method),
                "compensation": _method(options.get("compensation"), "default"),
                "corners": corners.get("shape", "arc") if isinstance(corners, Mapping) else corners,
            }
        )
    return rows


def run_states(data: Mapping[str, Any]) -> dict[str, str]:
    """Return the fingerprint of all keys that apply to each run, by name.

    With it, the page keeps the figures of runs that an edit does not touch.
    """
    runs = data.get("runs")
    shared = repr({key: x for key, x in data.items() if key != "runs"})
    states = runs.items() if isinstance(runs, Mapping) else ()
    return {str(name): fingerprint(f"{shared} {run!r}".encode()) for name, run in states}


def _method(options: Any, default: str) -> str:
    """Return the name of the method in the options of a run, or the default."""
    return str(options.get("method", default) if isinstance(options, Mapping) else default)


def _path(
    data: Mapping[str, Any], handles: Handles | None, state: JobState, run: str
) -> dict[str, Any]:
    """Describe source, axes and units of the path, and whether its waypoints can be edited."""
    if handles is None:
        why = "" if state.error is None else str(state.error)
        return {"editable": False, "why_not": why, "notes": []}
    notes = [] if state.job is None else list(state.job.program.notes)
    tolerance = locate_key(("corners", "tolerance"), data, run)
    coordinates = handles.waypoints[0].written if handles.waypoints else (None,)
    return {
        "axes": handles.axes,
        "unit": unit_of(coordinates[0], LENGTH),
        "tolerance_unit": unit_of(value_at(data, tolerance), LENGTH),
        "kind": handles.kind,
        "file": handles.file,
        "editable": handles.editable,
        "why_not": handles.why_not,
        "notes": notes,
    }


def _options(path: Any) -> Any:
    """Return the path's keys except those that contain its points."""
    if not isinstance(path, Mapping):
        return path
    return {key: x for key, x in path.items() if key not in GEOMETRY_KEYS}


def _layers(job: Job) -> list[str]:
    """List the drawing's layers, including layers that the program does not execute."""
    executed = (x.layer for x in job.program.contours)
    return sorted({*executed, *job.program.other_layers} - {""})


def _name(key: Any) -> str:
    """Return the last name in a key (dotted text or list of names); indices are skipped."""
    parts = key if isinstance(key, list) else str(key).split(".")
    return str(next((x for x in reversed(parts) if not str(x).isdecimal()), ""))


def _waypoints(handles: Handles) -> list[dict[str, Any]]:
    """Describe the waypoints of a drawing: position, role, and which edits are possible."""
    return [
        {
            **{"index": x.index, "uv": x.uv, "written": x.written},
            **{"role": x.role, "why_not": x.why_not},
            **{"removable": handles.is_removable(x), "divisible": handles.is_divisible(x.index)},
        }
        for x in handles.waypoints
    ]
