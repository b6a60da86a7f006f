"""Task that measures the frame of the part from touched points."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import InvalidInput
from armcontour.core.result import TABLE, Row, Table
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.tasks.files import shown
from armcontour.studio.tasks.request import Request

if TYPE_CHECKING:
    from armcontour.core.checks import FloatArray
    from armcontour.robot.measurement import MeasuredPart

# Maximum number of touches that are read from a page.
MAX_TOUCHES = 500


def measure(request: Request) -> MessageFrame:
    """Measure the frame of the part; the frame has the edit that writes it into the job.

    Options: `rows`, the texts of the table of touches; `noise`, the noise of a touch as text, in mm
    without a unit; `accept`, the names of doubts to accept, separated by commas.
    """
    from armcontour.files.measured_job import measure_part_of, part_patch
    from armcontour.files.touch_file import read_doubts, read_touch_rows, read_typed
    from armcontour.report.view import in_space
    from armcontour.robot.measurement import TOUCH_NOISE

    rows = _read_rows(request.option("rows", []))
    noise = request.option("noise", "")
    job = request.job
    touches = read_touch_rows(rows, job.arm)
    sigma = read_typed("The noise of a touch", str(noise), "mm") if noise else TOUCH_NOISE
    accept = read_doubts(str(request.option("accept", "")))
    measured = measure_part_of(job, touches, noise=sigma, accept=accept)
    touched = job.arm.tool_position(touches.q)
    edits = [
        {"do": "set", "key": list(key), "value": value}
        for key, value in part_patch(measured).items()
    ]
    data = measured.to_data()
    header = {
        "changes": [{"label": "Use this frame", "edits": edits}],
        "touched": {"uv": request.view.uv(touched), "xyz": in_space(touched)},
        **shown(replace(data, tables=(_residuals(measured, touches.points),))),
    }
    return MessageFrame("result", header)


def _read_rows(rows: Any) -> list[list[str]]:
    """Check the rows of a page: lists of texts."""
    is_table = isinstance(rows, list) and all(isinstance(row, list) for row in rows)
    if not is_table or not all(isinstance(cell, str) for row in rows for cell in row):
        raise InvalidInput("The touches must be rows of texts.")
    if len(rows) > MAX_TOUCHES:
        raise InvalidInput(
            f"At most {MAX_TOUCHES} touches can be typed here, but there are {len(rows)}. Use "
            "armcontour measure part with a file.",
            needed=len(rows),
            allowed=MAX_TOUCHES,
        )
    return [list(row) for row in rows]


def _residuals(measured: MeasuredPart, points: FloatArray | None) -> Table:
    """Return the residual of each touch as a table, with its point if it is known."""
    names = ("x", "y", "z")[: 0 if points is None else points.shape[1]]
    columns = (
        Row("touch", None, "", "touch"),
        *(Row(name, None, "m", name) for name in names),
        Row("residual", None, "m", "residual"),
    )
    rows = [
        (k + 1, *([] if points is None else points[k].tolist()), float(residual))
        for k, residual in enumerate(measured.residuals)
    ]
    return Table("touches", columns, rows, level=TABLE)
