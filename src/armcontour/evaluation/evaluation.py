"""Evaluation: how far the tool was from the path, how fast, and what the joints had to give.

Shares only geometry and arms with what it judges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.arms.limits import or_unlimited
from armcontour.errors import InvalidInput
from armcontour.evaluation.checking import check
from armcontour.evaluation.cornering_deviations import CornerDeviation
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.evaluation.pieces import Piece, pieces_of
from armcontour.evaluation.tally import judges_torque
from armcontour.geometry import Path
from armcontour.motion import Execution
from armcontour.program import Program

# The tool is at rest below this speed [m/s].
REST_SPEED = 1e-3
# A joint from this share of a limit on makes full use of it.
NEAR = 0.99
# Places per knot interval at which the plan is looked at, how many in all at least, and at most.
FINER = 20
FEWEST_PLACES = 4000
MOST_PLACES = 400_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """What an execution was worth.

    Args:
        duration: Planned time of the motion [s].
        settled: Time after which the tool stays below 1 mm/s [s].
        until: End of the time that the errors cover [s].
        contour_error: Distance from the tool to the path [m].
        tracking_error: Distance from the tool to where it should be at that time [m].
        objective_error: Distance from the tool to the objective path, if one was given [m].
        orientation_error: Angle between the tool's orientation (or its axis, where only that
            counts) and the one at the nearest place of the path [rad]; None without one.
        corners: Cornering deviations (ISO 9283, 8.5) at the corners of the objective path.
        speed: Largest tool speed [m/s].
        speed_ratio: The same over the assigned velocity; NaN without one.
        speed_overshoot: Largest excess of the tool speed over the assigned velocity of the place,
            segments' own included [m/s]; 0 without one.
        path_velocity: Mean tool speed over the planned time of the motion [m/s].
        utilisation: Share of that time in which some joint was within 1 % of a limit of its
            acceleration, velocity or torque.
        limit_ratios: Of the planned motion, the largest share of every limit, over times up to 20
            times as close as its knots; `check` looks closer.
        demand: Largest acceleration that each joint was asked for [rad/s²], (dof,).
        demand_ratio: The largest share of the limit in its direction that each joint was asked
            for; 0 for a joint without one, (dof,).
        saturated: Share of the time for which each joint was saturated, (dof,).
        contours: The contour error of every contour, in order.
    """

    duration: float
    settled: float
    until: float
    contour_error: ErrorProfile
    tracking_error: ErrorProfile
    objective_error: ErrorProfile | None
    orientation_error: ErrorProfile | None
    corners: tuple[CornerDeviation, ...]
    speed: float
    speed_ratio: float
    speed_overshoot: float
    path_velocity: float
    utilisation: float
    limit_ratios: Mapping[str, float]
    demand: FloatArray
    demand_ratio: FloatArray
    saturated: FloatArray
    contours: tuple[ErrorProfile, ...] = ()

    def __post_init__(self) -> None:
        for name in ("demand", "demand_ratio", "saturated"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))


def evaluate(
    executed: Execution,
    path: Path | Program,
    *,
    objective: Path | Program | None = None,
    limits: Limits | None = None,
    until: float | None = None,
) -> Evaluation:
    """Judge an execution against the path that it was to follow.

    Errors are weighted by time, from the first set-point to `until`; after its end the execution
    stands still. Of a program, every contour is judged for as long as the process is planned to be
    at work on it, and nothing between contours; a single path with nothing around it to its end.

    Args:
        executed: What the joints did.
        path: The path that the tool was to follow, or the program that was planned.
        objective: The same before rounding; gives `objective_error` and the corners.
        limits: By default the arm's own.
        until: End of the time that errors cover [s]; by default when the planned motion has ended
            and the tool is at rest. A program of more than one path takes none.

    Raises:
        InvalidInput: A path of another dimension than the arm's, a time that is not above zero, or
            a program that was not planned.
    """
    program, before = _programs(executed, path, objective)
    if until is not None and program.single_path is None:
        raise InvalidInput(
            "until is for one path: the contours of a program are judged while they are worked on."
        )
    bounds = (executed.arm.limits if limits is None else limits).for_joints(executed.arm.dof)
    t, speed, duration = executed.t, executed.tool_speed, executed.taught.trajectory.duration
    moving, moved = np.flatnonzero(speed > REST_SPEED), (t >= 0) & (t <= duration)
    settled = float(t[moving[-1]]) if len(moving) else 0.0
    end = max(duration, settled)
    if until is not None:
        end = _checks.positive("until", until, "s")
    pieces = pieces_of(executed, program, before, end)
    contours = tuple(x.contour_error for x in pieces)
    fastest = max(float(x.speed.max()) for x in pieces)
    return Evaluation(
        duration=duration,
        settled=settled,
        until=end,
        contour_error=ErrorProfile.join(contours),
        tracking_error=ErrorProfile.join([x.tracking_error for x in pieces]),
        objective_error=_of_all([x.objective_error for x in pieces]),
        orientation_error=_of_all([x.orientation_error for x in pieces]),
        corners=_corners(pieces, program),
        contours=contours,
        speed=fastest,
        speed_ratio=fastest / (np.nan if bounds.speed is None else bounds.speed),
        speed_overshoot=max(_overshoot(x, bounds) for x in pieces),
        path_velocity=float(np.trapezoid(speed[moved], t[moved]) / duration),
        **_demands(executed, bounds, end),
    )


def _programs(
    executed: Execution, path: Path | Program, objective: Path | Program | None
) -> tuple[Program, Program | None]:
    """What was to be followed, and the same before rounding, as programs."""
    if not isinstance(executed, Execution):
        raise InvalidInput(
            f"evaluate needs an Execution, as execute gives it, not {type(executed).__name__}."
        )
    program = Program.of(path, "evaluate needs a Path or a Program")
    if objective is None:
        return program, None
    return program, Program.of(objective, "evaluate needs a Path or a Program as its objective")


def _demands(executed: Execution, limits: Limits, end: float) -> dict[str, Any]:
    """What the joints had to give, and how much of their limits that is."""
    low, high = limits.acceleration_bounds(executed.arm.dof)
    lowest, highest = executed.demand_range
    time = max(end, float(executed.t[-1])) - float(executed.t[0])
    return {
        "utilisation": _utilisation(executed, limits, executed.taught.trajectory.duration),
        "limit_ratios": _limit_ratios(executed, limits),
        "demand": executed.peak_demand,
        "demand_ratio": np.maximum(lowest / low, highest / high),
        "saturated": executed.saturated_time / time,
    }


def _of_all(profiles: Sequence[ErrorProfile | None]) -> ErrorProfile | None:
    found = [x for x in profiles if x is not None]
    return ErrorProfile.join(found) if found else None


def _corners(pieces: Sequence[Piece], program: Program) -> tuple[CornerDeviation, ...]:
    """The corners of all contours; those of a single path have no contour's number."""
    if program.single_path is not None:
        return tuple(x for piece in pieces for x in piece.corners)
    return tuple(
        replace(x, contour=number)
        for number, piece in enumerate(pieces, start=1)
        for x in piece.corners
    )


def _overshoot(piece: Piece, limits: Limits) -> float:
    """Largest excess of the tool speed over the assigned velocity at the nearest place."""
    path, s = piece.path, piece.found.s
    assigned = np.fmin(path.speeds, np.inf if limits.speed is None else limits.speed)
    # Next to a joint between segments the faster one's velocity is not exceeded yet.
    here = np.fmax(assigned[path.locate(s)], assigned[path.locate(s, side="left")])
    return max(0.0, float(np.nanmax(piece.speed - np.where(np.isnan(here), np.inf, here))))


def _utilisation(executed: Execution, limits: Limits, duration: float) -> float:
    """Share of the time of the motion in which some joint was within 1 % of a limit."""
    dof = executed.arm.dof
    low, high = limits.acceleration_bounds(dof)
    moved = (executed.t >= 0) & (executed.t <= duration)
    ddq, dq = executed.ddq[moved], executed.dq[moved]
    near = (ddq >= NEAR * high) | (ddq <= NEAR * low)
    near |= np.abs(dq) >= NEAR * or_unlimited(limits.joint_velocity, dof)
    torque = _torque(executed) if limits.joint_torque is not None else None
    if torque is not None:
        near |= np.abs(torque[moved]) >= NEAR * or_unlimited(limits.joint_torque, dof)
    return float(near.any(axis=1).mean())


def _torque(executed: Execution) -> FloatArray | None:
    """Torques of the drives: those of the plant, or what the motion takes; None if not known."""
    if executed.torque is not None:
        return executed.torque
    if not judges_torque(executed.arm):
        return None
    return executed.arm.torque(executed.q, executed.dq, executed.ddq)


def _limit_ratios(executed: Execution, limits: Limits) -> dict[str, float]:
    """Largest share of every limit that the planned motion takes."""
    trajectory = executed.taught.trajectory
    intervals = len(trajectory.breaks)
    points = min(max(FINER, FEWEST_PLACES // intervals), max(1, MOST_PLACES // intervals))
    found = check(trajectory, executed.arm, limits, points=points)
    # Steps at breaks are no limits.
    return {x.name: x.ratio for x in found.uses if x.name in Limits.__dataclass_fields__}
