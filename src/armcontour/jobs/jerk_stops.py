"""Full stops that limits of jerk force where the curvature of a path jumps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from armcontour.jobs.job import TANGENT, Run
from armcontour.motion import Trajectory
from armcontour.program import Program, contour_called
from armcontour.timing import Tracing, find_jerk_stops

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
    program: Program, traced: Tracing | None, trajectory: Trajectory, this: Run
) -> list[JerkStop]:
    """The full stops inside contours that limits of jerk force, in order.

    Args:
        program: The program that was planned.
        traced: Its joint paths, if they are known.
        trajectory: Its plan.
        this: The run.
    """
    if traced is None or not this.limits.jerk_limits:
        return []
    return list(_find(program, traced, trajectory))


def _find(program: Program, traced: Tracing, trajectory: Trajectory) -> Iterator[JerkStop]:
    """The places where the plan rests, though the tool would not have to without these limits."""
    paths = {x.move: x.joint_path for x in traced.steps}
    spans = trajectory.contour_spans
    for i, (contour, span) in enumerate(zip(program.contours, spans, strict=True)):
        joint_path = paths.get(span.move)
        if joint_path is None or span.trajectory is None:
            continue
        for s in find_jerk_stops(joint_path, span.trajectory).tolist():
            called = "" if program.single_path is not None else contour_called(contour, i)
            yield JerkStop(contour=called, s=s, point=tuple(contour.path(s).tolist()))


def warn_of(stops: Sequence[JerkStop], this: Run) -> list[str]:
    """One warning for all full stops that limits of jerk force, or none.

    Args:
        stops: The stops.
        this: The run.
    """
    if not stops:
        return []
    first, count = stops[0], len(stops)
    point = ", ".join(f"{1e3 * x:.4g}" for x in first.point)
    place = f"s = {first.s:.4g} m ({point} mm)"
    if first.contour:
        place = f"{place} of {first.contour}"
    called = (
        f"1 full stop at {place}" if count == 1 else f"{count} full stops, the first at {place}"
    )
    why = "where the curvature of the path jumps and limits of jerk allow no speed"
    return [f"{called}, {why}: {_mend(this)}."]


def _mend(this: Run) -> str:
    """What spares the tool such stops."""
    if this.continuity is None:
        return (
            "corners, such as corners: {tolerance: 0.1 mm}, join lines and arcs without such jumps"
        )
    if this.continuity == TANGENT:
        return "corners: {continuity: curvature} has no such jumps"
    return (
        f"a larger corners.transition_tolerance than {this.transition_tolerance * 1e6:.3g} um, "
        "longer lines and arcs, or a tool orientation that does not turn leaves fewer"
    )
