"""What was refused, and where: for the screen."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError
from armcontour.files.job_edits import key_in
from armcontour.studio.preview import Preview
from armcontour.studio.view import View, in_space


def refusal_header(
    error: ArmContourError,
    view: View,
    *,
    tier: int,
    run: str = "",
    planned: Preview | None = None,
    waypoints: FloatArray | None = None,
) -> dict[str, Any]:
    """What was refused, and where.

    Args:
        error: The error.
        view: How points get on the screen.
        tier: What could not be had: 1 the plan, 2 its execution, 3 the full run.
        run: Name of the run.
        planned: The plan, if there is one: it has the place of a time.
        waypoints: Waypoints in the plane [m], (n, 2), of which one may be at the place.
    """
    point = None if error.point is None else np.array(error.point)
    if point is None and error.t is not None and planned is not None:
        t = np.clip(error.t, 0.0, planned.trajectory.duration)
        point = planned.job.arm.tool_position(planned.trajectory(t))
    at: dict[str, Any] = {"s": error.s, "t": error.t, "joint": error.joint, "index": error.index}
    if point is not None and point.shape in {(2,), (3,)}:
        at |= {"xyz": in_space(point), "uv": view.uv(point)}
        if waypoints is not None and len(waypoints):
            away = np.linalg.norm(waypoints - at["uv"], axis=1)
            at["waypoint"] = int(away.argmin()) if away.min() < 1e-4 else None
    return {
        **{"tier": tier, "run": run, "sentence": str(error)},
        **{"error": type(error).__name__, "exit": error.exit_code, "limit": error.limit},
        **{"needed": error.needed, "allowed": error.allowed, "key": key_in(str(error))},
        "at": {name: x for name, x in at.items() if x is not None},
    }
