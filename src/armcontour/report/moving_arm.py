"""The arm of a job in a report: it moves as planned, in its cell and along the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import limit_style
from armcontour.jobs import Job, RunResult
from armcontour.motion import Trajectory
from armcontour.planning.explanation import RAPIDS
from armcontour.report.arm_frame import arm_frame, nearest_pair
from armcontour.report.figure import Picture
from armcontour.report.message_frame import MessageFrame
from armcontour.report.plan_drawing import pieces_of, rapid_paths
from armcontour.report.still_arm import draw_still
from armcontour.report.view import essential_points, in_space, simplify, to_float32

# Maximum spacing of the sampled postures [s], unless there would be more than MAX_SAMPLES.
SPACING = 10e-3
# Maximum number of sampled postures.
MAX_SAMPLES = 50_000
# Maximum error of the linear interpolation between those sampled postures that are stored [rad].
POSTURE_ERROR = 1e-3
# Factor of times, so that distances from chords are those at equal times [rad/s].
STEEP = 1e3
# Stored postures are multiples of this angle [rad]: their zeros make the page smaller.
ANGLE = 2.0**-16
# Maximum deviation of the drawn path as a fraction of its size.
VISIBLE = 1 / 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingArm(Picture):
    """The arm and its cell in space, with a slider of the time; `frames`: arm and motion.

    Args:
        still: SVG of the arm at the middle of its motion, for paper and browsers without WebGL.
        notes: Sentences about the drawn bodies.
    """

    template: ClassVar[str] = "arm.html"
    still: str
    notes: tuple[str, ...] = ()


def draw_arm(result: RunResult, job: Job) -> MovingArm:
    """Draw the arm of a job with the planned motion and the path of a run."""
    pieces = list(pieces_of(result, 0.0).items())
    if rapids := rapid_paths(result):
        pieces.append((RAPIDS, rapids))
    arrays = _postures(result.trajectory)
    lines = []
    still_lines = list[tuple[str, FloatArray]]()
    for k, (kind, curves) in enumerate(pieces):
        look = limit_style(kind)
        points, breaks = _simplify_and_join(curves)
        arrays |= {f"points{k}": to_float32(in_space(points)), f"breaks{k}": breaks}
        lines.append({"points": f"points{k}", "breaks": f"breaks{k}"})
        lines[-1] |= {theme: str(look[theme]) for theme in ("light", "dark")}
        if kind != RAPIDS:
            separate = np.split(in_space(points), breaks[1:-1])
            still_lines += [(str(look["light"]), x) for x in separate]
    header = {"lines": lines, "nearest": nearest_pair(result)}
    arm = arm_frame(job)
    middle = result.trajectory(result.trajectory.duration / 2)
    return MovingArm(
        title="Arm, moving as planned",
        still=draw_still(arm, middle, still_lines),
        frames=(arm, MessageFrame("motion", header, arrays)),
        notes=tuple(arm.header["notes"]),
    )


def _postures(trajectory: Trajectory) -> dict[str, Any]:
    """Return the arrays of times [s] and joint positions [rad]; a page interpolates linearly."""
    count = min(MAX_SAMPLES, 2 + int(trajectory.duration / SPACING))
    t = np.linspace(0.0, trajectory.duration, count)
    q = trajectory(t)
    ends = np.array([0, len(t)])
    chosen = essential_points(np.column_stack([q, STEEP * t]), ends, POSTURE_ERROR)
    return {"t": to_float32(t[chosen]), "q": to_float32(np.round(q[chosen] / ANGLE) * ANGLE)}


def _simplify_and_join(curves: Sequence[FloatArray]) -> tuple[FloatArray, Any]:
    """Join simplified curves; also return where each curve starts, and the end, as indices."""
    size = max(float(np.ptp(x, axis=0).max()) for x in curves)
    chosen = simplify(curves, VISIBLE * size)
    drawn = [x[rows] for x, rows in zip(curves, chosen, strict=True)]
    ends = np.cumsum([0, *map(len, drawn)], dtype=np.uint32)
    return np.concatenate(drawn), ends
