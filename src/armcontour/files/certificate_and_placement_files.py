"""Files of certificates and placements (JSON and CSV), and the job file of the best placement."""

from __future__ import annotations

import csv
import io
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.render import plain, units_by_name
from armcontour.files.frame_keys import frame_keys
from armcontour.files.job_patch import Patch, write_patch
from armcontour.files.job_text_edits import move_files
from armcontour.robot import SerialArm
from armcontour.robot.scene import BASE
from armcontour.studies.certification import Certificate
from armcontour.studies.placement import AXES, Placement


def certificate_page(certificate: Certificate) -> dict[str, Any]:
    """Return the data of a certificate for JSON: requirements, results and model."""
    data = certificate.to_data()
    page = plain(certificate.job_result.to_data())
    return page | {"units": page["units"] | units_by_name([data]), "certificate": plain(data)}


def placement_csv(placement: Placement) -> str:
    """Return the CSV text of a placement: a row per place; refused places have no duration."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    axes = [f"{x} [{AXES[x]}]" for x in placement.axes]
    table.writerow([*axes, "duration [s]", "clearance [m]", "refused by", "why not"])
    for x in placement.places:
        values = [x.duration, x.clearance, x.refusal, x.why_not]
        table.writerow([*x.values.values(), *("" if y is None else y for y in values)])
    return text.getvalue()


def placed_job_text(
    placement: Placement, text: str, *, folder: FilePath, to: FilePath, patch: Patch | None = None
) -> str:
    """Return the text of the job file with the part or the base at the best placement.

    Args:
        placement: The placement.
        text: Text of the job file.
        folder: Folder of the job file.
        to: Folder of the new file.
        patch: Values by key path that replaced values of the file.

    Raises:
        NotRealizable: No place is feasible.
        InvalidInput: The base moves, and obstacles are fixed to the base.
    """
    text = write_patch(move_files(text, folder, to), patch or {})
    return write_patch(text, _placement_patch(placement, text))


def _placement_patch(placement: Placement, text: str) -> Patch:
    """Return the patch for the best place: `arm.work` (serial arm) or `path.frame` (planar)."""
    job = placement.job
    inside = [] if job.scene is None else [x.fixed_to for x in job.scene.obstacles]
    if placement.moved == BASE and BASE in inside:
        raise InvalidInput(
            "No job file is written, because the base moves and its obstacles that are fixed to "
            "the base do not move with it. Write their new positions by hand."
        )
    if isinstance(job.arm, SerialArm):
        return {("arm", "work"): frame_keys(placement.placed().arm.chain.base.inverse)}
    return {("path", "frame"): frame_keys(placement.placed().part)}
