"""Full stops inside contours that limits of jerk force."""

from __future__ import annotations

from dataclasses import dataclass

from armcontour.jobs.job import Run
from armcontour.motion import Trajectory
from armcontour.planning import Tracing, find_jerk_stops
from armcontour.program import Program, contour_called

# The reason of these stops.
CURVATURE_JUMPS = "curvature jumps"


@dataclass(frozen=True, slots=True, kw_only=True)
class JerkStop:
    """A full stop inside a contour, at a place where the curvature jumps.

    Args:
        contour: What messages call the contour; empty for a single path.
        s: Arc length from the start of the contour [m].
        point: The place [m], 2 or 3 coordinates.
    """

    contour: str
    s: float
    point: tuple[float, ...]


def jerk_stops(
    program: Program, traced: Tracing | None, trajectory: Trajectory, run: Run
) -> tuple[JerkStop, ...]:
    """Full stops inside contours that limits of jerk force, in order.

    Args:
        program: The program that was planned.
        traced: Its joint paths, if they are known.
        trajectory: Its plan.
        run: The run.
    """
    if traced is None or not run.limits.jerk_limits:
        return ()
    paths = {x.move: x.joint_path for x in traced.steps}
    found = []
    for i, (x, span) in enumerate(zip(program.contours, trajectory.contour_spans, strict=True)):
        joint_path = paths.get(span.move)
        if joint_path is not None and span.trajectory is not None:
            name = "" if program.single_path is not None else contour_called(x, i)
            found += [
                JerkStop(contour=name, s=s, point=tuple(x.path(s).tolist()))
                for s in find_jerk_stops(joint_path, span.trajectory).tolist()
            ]
    return tuple(found)
