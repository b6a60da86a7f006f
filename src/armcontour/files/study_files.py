"""Certificates and placements as JSON and CSV, and the job file of the best placement."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, quaternions
from armcontour.core.render import jsonable, plain, units
from armcontour.files.job_arm import frame_of
from armcontour.files.job_edits import REMOVE, move_files
from armcontour.files.job_file import model_of, read_data
from armcontour.files.job_model import CellModel
from armcontour.files.patch import Patch, write_patch
from armcontour.files.result_folder import data_json, to_json
from armcontour.robot import SerialArm
from armcontour.robot.scene import BASE, PART
from armcontour.studies.certification import Certificate
from armcontour.studies.placement import Placement


def certificate_json(certificate: Certificate, files: Sequence[str] = ()) -> str:
    """A certificate as JSON: requirements, results, model, and the data to repeat the plan.

    Args:
        certificate: The certificate.
        files: The files of the result, relative to its folder.
    """
    data, page = certificate.to_data(), plain(certificate.study.to_data(files))
    return to_json(page | {"units": page["units"] | units([data]), "certificate": plain(data)})


def derating_csv(certificate: Certificate) -> str:
    """The derating of a certificate as CSV: a row per interval of arc length with equal derating.

    A row has the share of every joint's acceleration limit that the plan uses, and the largest
    squared speed.
    """
    names = [f"acceleration left {x} [1]" for x in certificate.job.arm.joint_names]
    lines = [",".join(["contour", "from [m]", "to [m]", *names, "largest ds^2 [m^2/s^2]"])]
    for number, contour in enumerate(certificate.contours, start=1):
        derating = contour.derating
        rows = np.column_stack([derating.share, derating.cap])
        first = np.append(True, (rows[1:] != rows[:-1]).any(axis=1))
        start = derating.cells[:-1][first]
        end = np.append(start[1:], derating.cells[-1])
        for a, b, row in zip(start, end, rows[first], strict=True):
            cells = [f"{x!r}" if np.isfinite(x) else "" for x in row.tolist()]
            lines.append(",".join([str(number), repr(float(a)), repr(float(b)), *cells]))
    return "\n".join(lines) + "\n"


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
    """The result of a placement as JSON, without the map, which is in the CSV.

    Args:
        placement: The placement.
        files: The files of the result, relative to its folder.
    """
    return data_json(placement.to_data(files))


def placement_csv(placement: Placement) -> str:
    """The map as CSV: a row per candidate position. Cells that need a plan may be empty."""
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
    """The job file with the part or the base in the best position; other keys do not change.

    The key `placement` is removed, because its ranges begin from the previous position of the part.

    Args:
        placement: The placement.
        text: The job file.
        folder: Its folder.
        to: The folder of the new file.
        patch: Values by keys that replaced those of the file.

    Raises:
        InvalidInput: Obstacles would move, too.
    """
    values = {keys: x for keys, x in (patch or {}).items() if keys[0] != "placement"}
    text = write_patch(move_files(text, folder, to), {**values, ("placement",): REMOVE})
    return write_patch(text, _placed(placement, text))


def _placed(placement: Placement, text: str) -> Patch:
    """The keys that place the job."""
    job = placement.job
    inside = [] if job.scene is None else [x.fixed_to for x in job.scene.obstacles]
    if placement.moved == BASE and BASE in inside:
        raise InvalidInput(
            "Obstacles that are fixed to the base stay where they are when it moves, so no job "
            "file is written: give them their new places by hand."
        )
    if isinstance(job.arm, SerialArm):
        chain = placement.placed().arm.chain
        assert chain is not None
        return {("arm", "work"): _frame(chain.base.inverse)}
    model = model_of(CellModel, read_data(text, "job"), "job")
    path_frame = Frame() if model.path.frame is None else frame_of("path.frame", model.path.frame)
    frame = placement.frame()
    moved = frame if placement.moved == PART else frame.inverse
    return {("path", "frame"): _frame(moved @ path_frame)}


def _frame(frame: Frame) -> dict[str, list[float]]:
    """A frame as keys of a job file."""
    # To a picometre, so that 0.1 m is written so. Adding zero removes the sign of -0.
    return {
        "position": (frame.position.round(12) + 0.0).tolist(),
        "quaternion": (quaternions(frame.rotation) + 0.0).tolist(),
    }
