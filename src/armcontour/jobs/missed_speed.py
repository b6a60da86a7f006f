"""A warning for contours that are far slower than assigned, with what binds and what mends it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import digits
from armcontour.arms.limits import or_unlimited
from armcontour.geometry import Path, count_full_stops
from armcontour.jobs._missed_speed import bound_mean_acceleration
from armcontour.jobs.job import Run
from armcontour.motion import Method, PathLaw, Trajectory
from armcontour.program import Program, contour_called

# A contour is slow if it takes this multiple of the time of a straight line of its length, with the
# largest acceleration that its ends show.
SLOW = 2.0
# Samples of a motion, and the first share of its length that tells the acceleration of its ends.
SAMPLES, FIRST = 4001, 1e-3
# Relative rounding errors of bounds.
ROUNDING = 1e-9
# A tool that has this share of the assigned velocity reaches it.
REACHED = 0.99
# A limit binds from this share on, and is named if it does so for this share of the time.
BINDS, NAMED = 0.97, 0.1
# An axis turns to and fro if its deviations from its neighbours' mean are opposed this much (-2/3
# is that of independent errors, smooth turns have positive values) and large [rad], at so many
# points.
OPPOSED, TURNS, POINTS = -0.4, 2e-4, 8
LARGEST = 3.5
CENTRIPETAL = "the centripetal acceleration"


@dataclass(frozen=True, slots=True, kw_only=True)
class MissedSpeed:
    """A contour that is far slower than assigned.

    Args:
        contour: What messages call the contour.
        assigned: The largest assigned velocity [m/s].
        mean: Mean speed of the tool [m/s].
        most: Largest speed of the tool [m/s].
        reached: Share of the time at the assigned velocity.
        binds: The limit that binds the longest; empty if none binds for long.
        share: Share of the time for which it binds.
        jitter: How far the tool turns to and fro from point to point, RMS [rad]; 0 if it does not.
        axis_only: Whether only the tool axis is given.
    """

    contour: str
    assigned: float
    mean: float
    most: float
    reached: float
    binds: str
    share: float
    jitter: float
    axis_only: bool


def missed_speeds(
    objective: Program, program: Program, trajectory: Trajectory, this: Run, *, told: bool = False
) -> list[str]:
    """A warning for the contours that are far slower than assigned, with the slowest; or none.

    Short contours, on which there is no room to reach the velocity, are not meant, nor stops that
    the path asks for.

    Args:
        objective: The program with sharp corners.
        program: The program that was planned.
        trajectory: Its plan.
        this: The run.
        told: Whether another warning says where the centripetal acceleration makes the tool slow.
    """
    if this.timing == Method.CONVENTIONAL:
        return []
    found = []
    before = objective.contours
    for i, (x, span) in enumerate(zip(program.contours, trajectory.contour_spans, strict=True)):
        if span.trajectory is None:
            continue
        slow = _look(contour_called(x, i), x.path, before[i].path, span.trajectory, this)
        if slow is not None and not (told and slow.binds == CENTRIPETAL):
            found.append(slow)
    return [_warn(found, alone=len(program.contours) == 1)] if found else []


def _look(
    called: str, path: Path, objective: Path, motion: Trajectory, this: Run
) -> MissedSpeed | None:
    """A contour that is far slower than assigned; None for others."""
    most = np.inf if this.limits.speed is None else this.limits.speed
    speeds = np.fmin(path.speeds, most)
    speeds = np.where(np.isnan(speeds), np.inf, speeds)
    ideal = float(np.sum(path.lengths / speeds))
    if not np.isfinite(speeds).all() or motion.duration <= SLOW * ideal:
        return None
    assigned = float(speeds.max())
    least = assigned / (motion.duration / SLOW - ideal)
    shown = bound_acceleration(motion, path.length)
    # Nearly all contours are told by bounds, without a look at their stops or their motion.
    if shown <= least or shown <= (enough := least * (1 + sum(count_full_stops(path).values()))):
        return None
    t = np.linspace(0.0, motion.duration, SAMPLES)
    s, v = motion.s(t), motion.s(t, 1)
    length = path.length
    gone = np.minimum(s, length - s)
    inside = gone > FIRST * length
    acceleration = float((v[inside] ** 2 / (2 * gone[inside])).max(initial=0.0))
    if acceleration <= enough:
        return None
    here = speeds[path.locate(np.clip(s, 0.0, length), side="right")]
    binds, share = _find_limit(path, motion, t, s, v, this)
    jitter = 0.0 if binds == CENTRIPETAL else measure_jitter(objective)
    return MissedSpeed(
        contour=called,
        assigned=assigned,
        mean=length / motion.duration,
        most=float(v.max()),
        reached=float((v >= REACHED * here).mean()),
        binds=binds,
        share=share,
        jitter=jitter,
        axis_only=objective.orientation is not None and objective.orientation.axis_only,
    )


def bound_acceleration(motion: Trajectory, length: float) -> float:
    """A bound of the acceleration that the ends of a motion show [m/s²]; infinite for none.

    That is v² / 2 over the distance from the nearer end, beyond FIRST of the length.

    Args:
        motion: The motion.
        length: Length of the path [m].
    """
    (law,) = motion.laws if len(motion.laws) == 1 else (None,)
    if not isinstance(law, PathLaw):
        return math.inf
    found = bound_mean_acceleration(law.breaks, law.s, *law.rates, length, FIRST * length)
    return float(found) * (1 + ROUNDING)


def _find_limit(
    path: Path, motion: Trajectory, t: FloatArray, s: FloatArray, v: FloatArray, this: Run
) -> tuple[str, float]:
    """The limit that binds the longest, and for which share of the time; "" if none does for long.

    Limits of torque and jerk are not looked at: `explain` says more.
    """
    dof = motion.dof
    low, high = (np.asarray(x) * (1 - this.reserve) for x in this.limits.acceleration_bounds(dof))
    ddq, dq = motion(t, 2), motion(t, 1)
    shares: dict[str, float] = {}
    for j in range(dof):
        near = (ddq[:, j] >= BINDS * high[j]) | (ddq[:, j] <= BINDS * low[j])
        shares[f"the acceleration of joint {j + 1}"] = float(near.mean())
        fast = np.abs(dq[:, j]) >= BINDS * or_unlimited(this.limits.joint_velocity, dof)[j]
        shares[f"the velocity of joint {j + 1}"] = float(fast.mean())
    across = this.limits.centripetal_acceleration
    if across is not None:
        bend = path.curvatures[path.locate(np.clip(s, 0.0, path.length), side="right")]
        shares[CENTRIPETAL] = float((bend * v**2 >= BINDS * across).mean())
    name = max(shares, key=lambda x: shares[x])
    return (name, shares[name]) if shares[name] >= NAMED else ("", 0.0)


def measure_jitter(path: Path) -> float:
    """How far the tool turns to and fro from point to point of a path, RMS [rad]; 0 if it does not.

    Every direction is compared with that between its neighbours. Where these deviations change
    sides from point to point, they are errors of measured directions, not turns.

    Args:
        path: A path with a tool orientation per waypoint.
    """
    orientation = path.orientation
    if orientation is None or orientation.fixed or orientation.follows:
        return 0.0
    s = path.breaks[path.waypoints]
    if len(s) < POINTS:
        return 0.0
    rotation = orientation(s)
    columns = rotation[:, :, 2] if orientation.axis_only else rotation[:, :, [0, 2]].reshape(-1, 6)
    width = np.diff(s)
    ahead = (width[:-1] / (width[:-1] + width[1:]))[:, None]
    off = columns[1:-1] - (1 - ahead) * columns[:-2] - ahead * columns[2:]
    size = float((off**2).sum())
    # With independent errors e, e - (e before + e after) / 2 has 1.5 times their mean square.
    jitter = float(np.sqrt(size / len(off) / 1.5 / (1 if orientation.axis_only else 4 / 3)))
    if jitter < TURNS or float((off[1:] * off[:-1]).sum()) > OPPOSED * size:
        return 0.0
    return jitter


def _warn(found: list[MissedSpeed], *, alone: bool) -> str:
    """The warning for slow contours."""
    worst = min(found, key=lambda x: x.mean / x.assigned)
    assigned = f"{worst.assigned * 1e3:.3g} mm/s"
    never = worst.reached == 0.0
    if len(found) > 1:
        what = (
            f"{len(found)} contours are far slower than assigned, most of all {worst.contour}, "
            f"which {'never reaches' if never else 'hardly reaches'} its {assigned}"
        )
    else:
        name = "the contour" if alone else worst.contour
        what = f"{name} {'never' if never else 'hardly'} reaches its {assigned}"
    text = f"{what}: {worst.mean * 1e3:.3g} mm/s on average, {worst.most * 1e3:.3g} at most"
    if not never:
        text += f", at the assigned velocity for {digits(worst.reached * 100, 2)} % of the time"
    if worst.binds:
        text += f"; for {digits(worst.share * 100, 2)} % of the time {worst.binds} binds"
    if worst.jitter:
        turns = "tool axis" if worst.axis_only else "tool"
        mend = "smooth the directions before"
        if worst.axis_only:
            # Of some hundred errors the largest is about this multiple of their RMS.
            enough = math.ceil(LARGEST * np.degrees(worst.jitter) * 10) / 10
            mend = f"let a table of waypoints be smoothed, path.smooth_axes: {enough:.3g} deg"
        return (
            f"{text}; the {turns} turns to and fro from waypoint to waypoint, by "
            f"{digits(np.degrees(worst.jitter), 2)}° RMS, as measured directions do: {mend}, or "
            "give fewer waypoints."
        )
    return f"{text}: lower the velocity, or see what binds where in the report."
