"""Placements as JSON and CSV, and the job file of the best place."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, quaternions
from armcontour.core.render import jsonable
from armcontour.files.job_arm import frame_of
from armcontour.files.job_edits import REMOVE, move_files
from armcontour.files.job_file import model_of, read_data
from armcontour.files.job_model import CellModel
from armcontour.files.json_text import data_json
from armcontour.files.patch import Patch, write
from armcontour.robot import SerialArm
from armcontour.robot.scene.scene import BASE, PART
from armcontour.studies.placement import Placement

# Columns of verdicts in CSV, by their attributes.
COLUMNS = {
    "duration": "duration [s]",
    "bound": "at least [s]",
    "singular": "least singular value [m/rad]",
    "clearance": "clearance [m]",
    "torque_margin": "torque margin [1]",
    "refusal": "refused by",
}


def placement_json(placement: Placement, files: Sequence[str] = ()) -> str:
    """What was found, as JSON; the map itself is in the CSV.

    Args:
        placement: The placement.
        files: The files of the result, relative to its folder.
    """
    return data_json(placement.to_data(files))


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
    placement: Placement, text: str, *, folder: FilePath, to: FilePath, patch: Patch | None = None
) -> str:
    """The job file of a job with its part or base in the best place: only some keys are new.

    The key `placement` is left out: its question is answered, and its ranges begin from where the
    part was.

    Args:
        placement: The placement.
        text: The job file.
        folder: Its folder.
        to: The folder of the new file.
        patch: Values by keys that replaced those of the file.

    Raises:
        InvalidInput: Obstacles would move, too.
    """
    own = {keys: x for keys, x in (patch or {}).items() if keys[0] != "placement"}
    text = write(move_files(text, folder, to), {**own, ("placement",): REMOVE})
    return write(text, _placed(placement, text))


def _placed(placement: Placement, text: str) -> Patch:
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
    if isinstance(job.arm, SerialArm):
        found = placement.placed().arm.chain
        assert found is not None
        return {("arm", "work"): _frame(found.base.inverse)}
    model = model_of(CellModel, read_data(text, "job"), "job")
    own = Frame() if model.path.frame is None else frame_of("path.frame", model.path.frame)
    frame = placement.frame()
    moved = frame if placement.what == PART else frame.inverse
    return {("path", "frame"): _frame(moved @ own)}


def _frame(frame: Frame) -> dict[str, list[float]]:
    """A frame as keys of a job file."""
    # To a picometre, so that 0.1 m is written so. Adding zero removes the sign of -0.
    return {
        "position": (frame.position.round(12) + 0.0).tolist(),
        "quaternion": (quaternions(frame.rotation) + 0.0).tolist(),
    }
