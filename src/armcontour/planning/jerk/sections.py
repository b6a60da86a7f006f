"""Sections of a path between places where the motion rests, and how it may start and stop there."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.motion import PathLaw
from armcontour.planning.constraints import JointMotion, OnGrid, limits_on
from armcontour.planning.grid import Grid
from armcontour.planning.jerk.mesh import End
from armcontour.planning.options import Task
from armcontour.planning.topp.limits import collect, largest_u

# A jump of d2q_ds2, or of what it means for the tool, counts if it is this share of its size, and
# if at the plan's speed the jerk needs longer than this share of the duration for it.
KINK, TOO_SHORT = 1e-6, 1e-8
# In a long plan it counts if the jerk needs longer than this for it [s]: half of what `check` lets
# pass as a rounding error.
AT_ONCE = 5e-6
# The path hardly bends over a length that turns it by less than about this [rad].
EVEN_BEND = 5e-4
# dq_ds vanishes at an end if it is below this share of that near it; the first cell is then at most
# this share of the section.
STANDING, SHARE_AT_STANDING = 0.1, 5e-4
# The rates at a rest are those at this share of its section.
NEAR_REST = 5e-3


def find_sections(law: PathLaw, task: Task) -> tuple[FloatArray, BoolArray]:
    """Ends of the sections of a path [m], and whether the motion rests there."""
    path, inner = law.joint_path, law.s[1:-1]
    stops = np.union1d(path.stops, _bends(law, task))
    stops = stops[(stops > law.s[0]) & (stops < law.s[-1])]
    if len(inner):
        stops = np.union1d(stops, inner[law.rates.ds[1:] == 0])
    ends = np.concatenate([law.s[:1], stops, law.s[-1:]])
    at_rest = np.ones((len(ends) - 1, 2), dtype=bool)
    at_rest[0, 0], at_rest[-1, 1] = task.start_speed == 0, task.end_speed == 0
    return ends, at_rest


def _bends(law: PathLaw, task: Task) -> FloatArray:
    """Breaks of the joint path at which limited accelerations jump at the speed of a plan [m]."""
    path, jerk, inner = law.joint_path, task.jerk, np.arange(1, len(law.joint_path.breaks) - 1)
    at = path.breaks[inner]
    before, after = (path.on_interval(inner - side, at, 2) for side in (1, 0))
    jump, size, limit = np.abs(after - before), np.abs(before) + np.abs(after), jerk.joint
    if np.isfinite(jerk.tool):
        q = path.on_interval(inner, at, 0)
        found = [task.arm.tool_velocity(q, x) for x in (after - before, before, after)]
        turn, one, other = (np.linalg.norm(x, axis=1, keepdims=True) for x in found)
        jump, size = np.hstack([jump, turn]), np.hstack([size, one + other])
        limit = np.append(limit, jerk.tool)
    square = square_at(law, np.clip(at, law.s[0], law.s[-1]))[:, None]
    soon = min(TOO_SHORT * law.breaks[-1], AT_ONCE) * limit
    return np.asarray(at[((jump > KINK * size) & (jump * square > soon)).any(axis=1)])


def find_ends(
    law: PathLaw, task: Task, places: FloatArray, at_rest: BoolArray
) -> list[tuple[End, End]]:
    """How the motion may start and stop in each section, near a plan."""
    grid = Grid(law.joint_path, law.s, law.joint_path.locate((law.s[:-1] + law.s[1:]) / 2))
    path = OnGrid(grid)
    (first, second), (third, _) = path.derivatives
    acceleration = largest_u(limits_on(path, task.active))
    for x in task.active:
        if isinstance(x, JointMotion) and len(x.low):
            acceleration = np.minimum(acceleration, largest_u(collect([x.rows(path)], len(path))))
    with np.errstate(divide="ignore"):
        jerk = (task.jerk.joint / np.abs(first).max(axis=1)).min(axis=1)
    jerk = np.minimum(jerk, min(task.jerk.path, task.jerk.tool))
    speed = np.maximum.reduceat(
        np.append(law.speeds, 0.0), np.searchsorted(law.s, places, side="right")
    )[:-1]
    near = NEAR_REST * np.diff(places)
    size = np.linalg.norm(first, axis=2).max(axis=1)
    bend = np.linalg.norm(second, axis=2).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = np.fmin(EVEN_BEND * size / bend, np.sqrt(EVEN_BEND * size / third.max(axis=1)))
    squares = np.square([task.start_speed, task.end_speed])

    def at(side: int, s: FloatArray) -> list[End]:
        i = np.clip(np.searchsorted(law.s, s, side="right") - 1, 0, len(grid) - 1)
        edge = places[side : len(places) - 1 + side]
        j = np.clip(np.searchsorted(law.s, edge, side="right") - 1 - side, 0, len(grid) - 1)
        straight = np.nan_to_num(np.fmin(even[i], even[j]), nan=np.inf)
        # Where the joints start with dq_ds = 0, the direction of motion is that farther inside.
        standing = size[j] < STANDING * size[i]
        straight = np.where(standing, SHARE_AT_STANDING * np.diff(places), straight)
        rows = zip(at_rest[:, side], acceleration[i], jerk[i], speed, straight, strict=True)
        return [
            End(bool(rest), float(squares[side]), float(x), float(y), float(v), float(e))
            for rest, x, y, v, e in rows
        ]

    return list(zip(at(0, places[:-1] + near), at(1, places[1:] - near), strict=True))


def square_at(law: PathLaw, s: FloatArray) -> FloatArray:
    """ds² of a plan at arc lengths [m²/s²], (n,)."""
    return np.asarray(law.path_position(*law.reach(s), 1) ** 2)
