"""`explain_reach`: the point of a job that is farthest out of reach, and a remedy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.render import number
from armcontour.core.sampled_data import spread_indices
from armcontour.core.text import capitalise
from armcontour.geometry import Path
from armcontour.jobs.job import Job
from armcontour.planning import turn_along
from armcontour.planning.tracing.knots import OUT_OF_REACH, suggest_remedy, task_dimension
from armcontour.program import Contour, Program, Rapid, contour_called, prepare
from armcontour.program.moves import origin_on
from armcontour.robot import Arm, PlanarTwoLink, SerialArm
from armcontour.robot.arm import FAR_OUT, unit_hint

# Approximate number of points on each path; a point takes a few milliseconds.
MAX_ALONG = 60
# Approximate number of points on all paths.
MAX_SEARCHED_POINTS = 400
# Initial configurations from which a point is searched.
FEW_SEEDS = 12
# More initial configurations are tried for this number of the worst points.
WORST = 6


class _NamedPath(NamedTuple):
    """A path of a program, and its name in messages."""

    name: str
    path: Path
    entities: tuple[str, ...] = ()  # Names of the drawing's entities on the path


class _PathPoints(NamedTuple):
    """Points along some paths of a program."""

    paths: list[_NamedPath]
    owner: IntArray  # For each point, the index of its path, (n,)
    s: FloatArray  # Arc lengths [m], (n,)
    points: FloatArray  # Required tool positions [m], (n, dimension)
    rotations: FloatArray  # Tool orientations, (n, 3, 3); identity where none is required

    @classmethod
    def along(cls, paths: list[_NamedPath]) -> _PathPoints:
        """Sample paths at ends of segments and evenly spaced points, or at a subset of these."""
        maximum = int(np.clip(MAX_SEARCHED_POINTS // len(paths), 2, MAX_ALONG))
        rows = []
        for k, (_, path, _) in enumerate(paths):
            s = np.union1d(np.linspace(0, path.length, maximum), path.breaks)
            if len(s) > 2 * maximum:
                s = s[spread_indices(len(s), 2 * maximum)]
            turned = np.tile(np.eye(3), (len(s), 1, 1))
            if path.orientation is not None:
                turned = path.orientation(s)
            rows.append((np.full(len(s), k), s, path(s), turned))
        return cls(paths, *map(np.concatenate, zip(*rows, strict=True)))

    def some(self, selection: IntArray) -> _PathPoints:
        """Return the points with the given indices."""
        paths, indices, s, points, rotations = self
        return _PathPoints(
            paths, indices[selection], s[selection], points[selection], rotations[selection]
        )


def explain_reach(error: Unreachable, job: Job) -> Unreachable:
    """Return the error about the job's point that is farthest out of reach.

    If all points are within reach, the given error is returned.

    Points of contours have priority over points of rapids.
    """
    # The given error is about the first unreachable move, which may be a rapid.
    program = job.program
    if not job.process.automatic:
        program = prepare(program, job.process)
    for rapid in (False, True) if error.limit == "reach" else ():
        if not (paths := list(_paths_of(program, rapid))):
            continue
        points = _extremes(job.arm, _PathPoints.along(paths))
        gaps = np.linalg.norm(_reached(job.arm, points) - points.points, axis=1)
        k = int(np.argmax(gaps))
        if gaps[k] > OUT_OF_REACH:
            return _refusal(job, points, gaps, k, rapid)
    return error


def _paths_of(program: Program, rapid: bool) -> Iterator[_NamedPath]:
    """Yield the paths of all contours, or if `rapid`, of all rapids that have a path."""
    contours = program.contours
    index = 0
    for move in program.moves:
        if isinstance(move, Contour):
            if not rapid:
                is_single = program.single_path is not None and not move.name
                name = "the path" if is_single else contour_called(move, index)
                yield _NamedPath(name, move.path, move.entities)
            index += 1
        elif rapid and isinstance(move, Rapid) and move.path is not None:
            before = contours[max(index - 1, 0) : index]
            after = contours[index : index + 1]
            if after:
                name = f"rapid to {contour_called(after[0], index)}"
            else:
                name = f"rapid away from {contour_called(before[0], index - 1)}"
            yield _NamedPath(name, turn_along(move.path, before, after))


def _extremes(arm: Arm, points: _PathPoints) -> _PathPoints:
    """Reduce many points to those that are farthest from the base of the arm or nearest to it."""
    if len(points.s) <= 2 * MAX_SEARCHED_POINTS:
        return points
    assert isinstance(arm, PlanarTwoLink | SerialArm)
    base = [arm.base, 0.0] if isinstance(arm, PlanarTwoLink) else arm.chain.base.position
    ranks = np.argsort(np.linalg.norm(points.points - base, axis=1))
    return points.some(
        np.sort(np.append(ranks[: MAX_SEARCHED_POINTS // 4], ranks[-MAX_SEARCHED_POINTS:]))
    )


def _reached(arm: Arm, points: _PathPoints) -> FloatArray:
    """Find the reachable tool position nearest to each point [m], (n, dimension)."""
    goals = points.points
    if isinstance(arm, PlanarTwoLink):
        least, largest = arm.reach
        from_base = goals - [arm.base, 0.0]
        distance = np.linalg.norm(from_base, axis=1, keepdims=True)
        # A point at the base has no direction, so an arbitrary direction is used.
        divisor = np.where(distance > 0, distance, 1.0)
        directions = np.where(distance > 0, from_base / divisor, [1.0, 0.0])
        return np.asarray([arm.base, 0.0] + directions * np.clip(distance, least, largest))
    assert isinstance(arm, SerialArm)
    from armcontour.robot.inverse_kinematics import REACH_SEEDS, TURNED, nearest_reached, seeds

    path = points.paths[0].path
    task = task_dimension(path, arm)
    start_positions = seeds(arm)
    rotations = points.rotations
    if task == TURNED and arm.tool_turning is not None:
        free = path.orientation is not None and path.orientation.axis_only
        rotations = arm.tool_turning.nearest(rotations, axis_only=free)
    poses = np.concatenate([rotations, goals[:, :, None]], axis=2)
    positions = np.empty((len(poses), arm.dof))
    for i in range(len(poses)):
        positions[i] = nearest_reached(arm, poses[i], task, start_positions[:FEW_SEEDS])
    gaps = np.linalg.norm(arm.tool_position(positions) - goals, axis=1)
    for i in np.argsort(-gaps)[:WORST]:
        if gaps[i] > OUT_OF_REACH:
            # A search from another configuration may result in a nearer position.
            start = np.vstack([positions[i], start_positions[:REACH_SEEDS]])
            positions[i] = nearest_reached(arm, poses[i], task, start)
    return arm.tool_position(positions)


def _refusal(job: Job, points: _PathPoints, gaps: FloatArray, k: int, rapid: bool) -> Unreachable:
    """Return the error about point k, which is farthest out of reach.

    - `gaps`: distance of each point from the nearest reachable position [m], (n,).
    - `rapid`: whether the points are those of rapids.
    """
    name, path, entities = points.paths[points.owner[k]]
    point = points.points[k]
    s = float(points.s[k])
    gap = float(gaps[k])
    is_far = gap >= FAR_OUT
    drawn = (np.resize([*point, 0.0], 3) - job.part.position) @ job.part.rotation
    drawn = drawn[: len(point)]
    before = (
        "" if np.allclose(drawn, point) else f", which is {_place(drawn, is_far)} before path.frame"
    )
    count = len(np.unique(points.owner[gaps > OUT_OF_REACH]))
    others = "" if is_far or count < 2 else f" ({count} of {len(points.paths)} are out of reach)"
    remedy = unit_hint(gap) if is_far else ". " + _remedy(points, rapid)
    origin = origin_on(path, s, entities)
    in_file = f", in {origin}" if origin else ""
    return Unreachable(
        f"{capitalise(name)} is out of reach of the arm {job.arm.name} by up to "
        f"{f'{gap:.3g} m' if is_far else number(gap, 'm')}, most at {_place(point, is_far)}, "
        f"{f'{s:.6g} m' if is_far else f'{1e3 * s:.6g} mm'} along it{in_file}{before}{others}"
        f"{remedy}.",
        point=point.tolist(),
        s=s,
        origin=origin,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _remedy(points: _PathPoints, rapid: bool) -> str:
    """Write a remedy for points out of reach, as sentences; the last has no period."""
    free = suggest_remedy(points.paths[0].path).removeprefix("Move the path or the arm")
    move = f"ove the part or the arm{free}. `armcontour place` finds a position"
    if rapid:
        return f"All contours are in reach. Use a smaller approach or retract, or m{move}"
    return f"M{move}"


def _place(point: FloatArray, far: bool = False) -> str:
    """Write coordinates in millimetres, rounded to a micrometre; if `far`, in metres."""
    scale, digits, unit = (1.0, 6, "m") if far else (1e3, 3, "mm")
    shown = (f"{x:.{6 if far else 10}g}" for x in np.round(point * scale, digits) + 0.0)
    return f"({', '.join(shown)}) {unit}"
