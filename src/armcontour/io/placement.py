"""Placements as JSON and CSV, and the job file of the best place."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import refuse_if
from armcontour._version import __version__
from armcontour.arms import SerialArm
from armcontour.core.render import jsonable
from armcontour.errors import InvalidInput
from armcontour.frames import Frame, quaternions
from armcontour.io.job_arm import ARM_FILES, frame_of
from armcontour.io.job_edits import REMOVE, Keys, move_files, set_keys
from armcontour.io.job_file import read_model
from armcontour.io.job_model import ArmModel, CellModel
from armcontour.io.job_overrides import JobOverrides, override
from armcontour.io.json_text import to_json
from armcontour.jobs import Rounding
from armcontour.placement import UNITS, Place, Placement, Verdict
from armcontour.scene.scene import BASE, PART

# Columns of verdicts in CSV, by their attributes.
COLUMNS = {
    "duration": "duration [s]",
    "bound": "at least [s]",
    "singular": "least singular value [m/rad]",
    "clearance": "clearance [m]",
    "torque_margin": "torque margin [1]",
    "refusal": "refused by",
}
VALUE_UNITS = {
    "duration": "s",
    "bound": "s",
    "singular": "m/rad",
    "clearance": "m",
    "torque_margin": "1",
    "beyond": "m",
}
# Options of the command line that no key of a job stands for alone.
OF_RUNS = ("corner_shape", "line_tolerance", "zone", "iterations", "continuity")


def placement_json(placement: Placement, files: Sequence[str] = ()) -> str:
    """What was found, as JSON; the map itself is in the CSV.

    Args:
        placement: The placement.
        files: The files of the result, relative to its folder.
    """
    frame = placement.frame()
    data = {
        "armcontour": __version__,
        "job": placement.job.name,
        "arm": placement.job.arm.name,
        "run": placement.run.name,
        "objective": placement.objective,
        "moved": placement.what,
        "units": {**UNITS, **VALUE_UNITS, "position": "m"},
        "axes": [
            {
                "name": x.name,
                "from": float(x.values[0]),
                "to": float(x.values[-1]),
                "places": len(x.values),
            }
            for x in placement.axes
        ],
        "anchor": placement.moves.anchor.tolist(),
        "absolute": list(placement.moves.absolute),
        "uncertainty": dict(placement.uncertainty),
        "places": len(placement.verdicts),
        "planned": placement.planned,
        "refused": placement.refusals,
        "best": _place(placement.refined),
        "best_of_grid": _place(placement.best),
        "own_place": _verdict(placement.own),
        "moved_by": {
            "position": frame.position.tolist(),
            "quaternion": quaternions(frame.rotation).tolist(),
        },
        "notes": list(placement.notes),
        "files": list(files),
    }
    return to_json(data)


def placement_csv(placement: Placement) -> str:
    """The map as CSV: a row per place. Empty is what is not known without a plan.

    Args:
        placement: The placement.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*(f"{x.name} [{x.unit}]" for x in placement.axes), *COLUMNS.values()])
    for k, verdict in enumerate(placement.verdicts):
        values = [getattr(verdict, name) for name in COLUMNS]
        table.writerow(
            [*placement.place(k).values(), *("" if x is None else x for x in jsonable(values))]
        )
    return text.getvalue()


def placed_job_text(
    placement: Placement,
    text: str,
    *,
    folder: FilePath,
    to: FilePath,
    drawing: FilePath | None = None,
    overrides: JobOverrides | None = None,
) -> str:
    """The job file of a job with its part or base in the best place: only some keys are new.

    The key `placement` is left out: its question is answered, and its ranges begin from where the
    part was.

    Args:
        placement: The placement.
        text: The job file, or the cell if there is a drawing.
        folder: Its folder.
        to: The folder of the new file.
        drawing: The drawing that takes the place of the cell's path.
        overrides: Values that replaced those of the file.

    Raises:
        InvalidInput: No key of a job says what was replaced or moved.
    """
    text = move_files(text, folder, to)
    changes = _override_keys(read_model(CellModel, text, "job"), overrides or JobOverrides())
    if drawing is not None:
        changes["path", "file"] = str(drawing.absolute())
        changes["name",] = placement.job.name
    changes["placement",] = REMOVE
    text = set_keys(text, changes)
    return set_keys(text, _placed_keys(placement, text, overrides))


def _placed_keys(
    placement: Placement, text: str, overrides: JobOverrides | None
) -> dict[Keys, Any]:
    """The keys that place the job.

    Raises:
        InvalidInput: Obstacles would move, too.
    """
    job = placement.job
    inside = [] if job.scene is None else [x.fixed_to for x in job.scene.obstacles]
    if placement.what == BASE and BASE in inside:
        raise InvalidInput(
            "Obstacles that are fixed to the base stay where they are when it moves, so no job "
            "file is written: give them their new places by hand."
        )
    model = override(read_model(CellModel, text, "job"), overrides)
    if not isinstance(job.arm, SerialArm):
        own = Frame() if model.path.frame is None else frame_of("path.frame", model.path.frame)
        frame = placement.frame()
        moved = frame if placement.what == PART else frame.inverse
        return {("path", "frame"): _frame(moved @ own)}
    found = placement.placed().arm.chain
    assert found is not None
    work = _frame(found.base.inverse)
    if isinstance(model.arm, str):
        return {("arm",): {**_arm_keys(model.arm), "work": work}}
    return {("arm", "work"): work}


def _arm_keys(arm: str | ArmModel) -> dict[str, Any]:
    """The keys of an arm, those that differ from their default."""
    if isinstance(arm, str):
        return {"file" if arm.lower().endswith(ARM_FILES) else "name": arm}
    given = {x.name: getattr(arm, x.name) for x in fields(arm)}
    return {name: _keys(x) for name, x in given.items() if x is not None}


def _keys(value: Any) -> Any:
    """A value as a job file has it; keys without a value are left out."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {name: _keys(x) for name, x in asdict(value).items() if x is not None}
    return jsonable(value)


def _override_keys(model: CellModel, x: JobOverrides) -> dict[Keys, Any]:
    """The keys that say what options replaced.

    Raises:
        InvalidInput: There is no such key.
    """
    for name in OF_RUNS:
        refuse_if(
            getattr(x, name) is not None,
            f"--{name.replace('_', '-')} is of the runs, so no job file is written: put it into "
            "the job file, and place that.",
        )
    same = (
        "units",
        "columns",
        "scale",
        "layers",
        "names",
        "colors",
        "flat",
        "texts",
        "tools",
        "tool",
    )
    skipped = "skip" if x.skip_unknown else None
    given: dict[Keys, Any] = {
        **{("path", name): getattr(x, name) for name in same},
        ("path", "unknown"): {"skip": list(x.skip_words)} if x.skip_words else skipped,
        ("path", "frame", "position"): x.position,
        ("path", "frame", "rpy"): x.turn,
        ("limits", "speed"): x.speed,
        ("corners", "tolerance"): x.corner_tolerance,
        ("process", "from_s"): x.from_s,
        ("ignore_collisions",): x.ignore_collisions,
    }
    given = {key: y for key, y in given.items() if y is not None and y is not False}
    found = {key: list(y) if isinstance(y, tuple) else y for key, y in given.items()}
    for run, own in model.runs.items():
        corners = asdict(own.corners) if isinstance(own.corners, Rounding) else {}
        for part, name, there in (
            ("limits", "speed", own.limits),
            ("corners", "tolerance", corners),
        ):
            if (part, name) in found and there.get(name) is not None:
                found["runs", run, part, name] = found[part, name]
    return found


def _frame(frame: Frame) -> dict[str, list[float]]:
    """A frame as keys of a job file."""
    # To a picometre, so that 0.1 m is written so. Adding zero removes the sign of -0.
    return {
        "position": (frame.position.round(12) + 0.0).tolist(),
        "quaternion": (quaternions(frame.rotation) + 0.0).tolist(),
    }


def _place(place: Place) -> dict[str, Any]:
    """A place for JSON."""
    return {"place": dict(place.values), **_verdict(place.verdict)}


def _verdict(x: Verdict) -> dict[str, Any]:
    """A verdict for JSON; what is not known is null."""
    return {name: value for name, value in asdict(x).items() if value != ""}
