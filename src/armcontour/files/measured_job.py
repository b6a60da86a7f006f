"""A measured part of a job, and the text of its file with a measured frame or tool."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.yaml_loader import load
from armcontour.files.frame_keys import frame_keys
from armcontour.files.job_patch import Patch, write_patch
from armcontour.files.job_text_edits import move_files, value_at
from armcontour.files.touch_file import Touches
from armcontour.jobs import Job
from armcontour.robot import SerialArm
from armcontour.robot.measurement import MeasuredPart, MeasuredTool, measure_part

# Keys of a rotation in a frame of a job file.
ROTATIONS = ("rpy", "quaternion")
# Maximum number of path points at which the expected error is computed.
MAX_REGION = 200


def measure_part_of(
    job: Job, touches: Touches, *, noise: float, accept: Collection[str]
) -> MeasuredPart:
    """Measure the part of a job; arguments and errors as in `measure_part`."""
    return measure_part(
        job.arm,
        touches.points,
        touches.q,
        noise=noise,
        region=_measured_region(job),
        planned=job.part,
        accept=accept,
    )


def _measured_region(job: Job) -> FloatArray:
    """Return up to MAX_REGION points of the contours as drawn [m], (n, dimension)."""
    drawn = job.program.placed(job.part.inverse)
    points = np.concatenate([x.path.vertices for x in drawn.contours])
    return np.asarray(points[:: math.ceil(len(points) / MAX_REGION)])


def part_patch(measured: MeasuredPart) -> Patch:
    """Return the key `path.frame` with the measured frame of a part."""
    return {("path", "frame"): frame_keys(measured.frame)}


def work_patch(job: Job, measured: MeasuredPart) -> Patch:
    """Return the key `arm.work` of a job whose part stays where it is in the work frame.

    The touched points have the coordinates p in the old work frame W and x in the drawing, p = M x
    with the measured frame M, and x is at P x in the work frame with the part frame P. The new work
    frame is W M P⁻¹.

    Raises:
        InvalidInput: The arm is planar.
    """
    if not isinstance(job.arm, SerialArm):
        raise InvalidInput(
            f"The planar arm {job.arm.name} has no work frame. Measure the part, which changes "
            "path.frame."
        )
    old = job.arm.chain.base.inverse
    return {("arm", "work"): frame_keys(old @ measured.frame @ job.part.inverse)}


def tool_patch(job: Job, measured: MeasuredTool, text: str) -> Patch:
    """Return the keys of `arm.tool` with the measured centre point; its rotation does not change.

    Args:
        job: The job, whose arm has the present tool.
        measured: The measured tool.
        text: Text of the job file, which may have a rotation of the tool.
    """
    position = (measured.frame.position.round(9) + 0.0).tolist()
    tool: dict[str, Any] = {"position": position}
    data = load(text, "job")
    written = value_at(data, ("arm", "tool"))
    is_turned = isinstance(written, dict) and any(x in written for x in ROTATIONS)
    rotation = job.arm.chain.tool.rotation
    if not is_turned and not np.array_equal(rotation, np.eye(3)):
        # The rotation is that of the arm's file, which a tool in the job would replace.
        turned = frame_keys(Frame(rotation=rotation))
        tool["quaternion"] = turned["quaternion"]
    return {("arm", "tool", key): value for key, value in tool.items()}


def measured_job_text(text: str, patch: Patch, folder: FilePath, to: FilePath) -> str:
    """Return the text of a job file with a measured frame; comments do not change.

    Args:
        text: Text of the job file.
        patch: The measured frame.
        folder: Folder of the job file.
        to: Folder of the new file, to which relative file names are converted.
    """
    return write_patch(move_files(text, folder, to), patch)
