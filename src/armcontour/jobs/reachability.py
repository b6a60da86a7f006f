"""`explain`: where and by how far a job is out of reach, and what brings it into reach."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.render import number
from armcontour.core.text import capitalise
from armcontour.geometry import Path
from armcontour.jobs.job import Job
from armcontour.planning import turn_along
from armcontour.planning.tracing.poses import OUT_OF_REACH, task_dimension, what_helps
from armcontour.program import Contour, Program, Rapid, contour_called, prepare
from armcontour.robot import Arm, PlanarTwoLink, SerialArm
from armcontour.robot.arm import FAR_OUT, unit_hint

# Number of points on each path, and on all; each takes a few milliseconds.
MOST_ALONG = 60
MOST_PLACES = 400
# Starts of the search for what the arm reaches; from more, at so many places that seem the worst.
FEW_SEEDS = 12
WORST = 6
# A move that brings all into reach is looked for in so many steps, at so many places. It goes so
# far inside the reach [m], at whose edge arms are singular, and is said in this unit [m].
MOST_STEPS = 40
MOST_MOVED = 80
INSIDE = 5e-3
SAID = 1e-3


class _Places(NamedTuple):
    """Places along some paths of a program.

    Args:
        paths: Names of the paths in messages, and the paths.
        of: The index of the path of each place, (n,).
        s: Arc lengths [m], (n,).
        points: Where the tool is to be [m], (n, dimension).
        rotations: Its orientation, (n, 3, 3); the unit matrix where none is required.
    """

    paths: list[tuple[str, Path]]
    of: IntArray
    s: FloatArray
    points: FloatArray
    rotations: FloatArray

    @classmethod
    def along(cls, paths: list[tuple[str, Path]]) -> _Places:
        """Places along paths: ends of segments and places between, or some of them."""
        most, rows = int(np.clip(MOST_PLACES // len(paths), 2, MOST_ALONG)), []
        for k, (_, x) in enumerate(paths):
            s = np.union1d(np.linspace(0, x.length, most), x.breaks)
            if len(s) > 2 * most:
                s = s[np.unique(np.linspace(0, len(s) - 1, 2 * most).astype(np.intp))]
            turned = np.tile(np.eye(3), (len(s), 1, 1))
            if x.orientation is not None:
                turned = x.orientation(s)
            rows.append((np.full(len(s), k), s, x(s), turned))
        return cls(paths, *map(np.concatenate, zip(*rows, strict=True)))

    def some(self, which: IntArray) -> _Places:
        """Only these places."""
        paths, of, s, points, rotations = self
        return _Places(paths, of[which], s[which], points[which], rotations[which])


def explain(error: Unreachable, job: Job) -> Unreachable:
    """The refusal by the point of a job that is farthest out of reach, contours before rapids.

    Tracing refuses a program by the move that comes first, which may be a rapid.

    Args:
        error: The error of tracing.
        job: The job.

    Returns:
        The refusal; the same error if no point of the job is out of reach.
    """
    program = job.program
    if not job.process.automatic:
        program = prepare(program, job.process)
    for rapid in (False, True) if error.limit == "reach" else ():
        if not (paths := list(_paths_of(program, rapid))):
            continue
        places = _extremes(job.arm, _Places.along(paths))
        away = np.linalg.norm(_reached(job.arm, places, WORST) - places.points, axis=1)
        k = int(np.argmax(away))
        if away[k] > OUT_OF_REACH:
            return _refusal(job, places, away, k, rapid)
    return error


def _paths_of(program: Program, rapid: bool) -> Iterator[tuple[str, Path]]:
    """Names and paths of all contours, or of all rapids that have a path."""
    contours, done = program.contours, 0
    for x in program.moves:
        if isinstance(x, Contour):
            if not rapid:
                alone = program.single_path is not None and not x.name
                yield "the path" if alone else contour_called(x, done), x.path
            done += 1
        elif rapid and isinstance(x, Rapid) and x.path is not None:
            before, after = contours[max(done - 1, 0) : done], contours[done : done + 1]
            to, (other,) = ("to", after) if after else ("away from", before)
            called = contour_called(other, done if after else done - 1)
            yield f"rapid {to} {called}", turn_along(x.path, before, after)


def _extremes(arm: Arm, places: _Places) -> _Places:
    """Of very many places only those that are farthest from the base of the arm, or nearest."""
    if len(places.s) <= 2 * MOST_PLACES:
        return places
    assert isinstance(arm, PlanarTwoLink | SerialArm)
    base = [arm.base, 0.0] if isinstance(arm, PlanarTwoLink) else arm.chain.base.position
    ranks = np.argsort(np.linalg.norm(places.points - base, axis=1))
    return places.some(np.sort(np.append(ranks[: MOST_PLACES // 4], ranks[-MOST_PLACES:])))


def _reached(
    arm: Arm, places: _Places, closely: int, starts: FloatArray | None = None
) -> FloatArray:
    """The tool points nearest to places that the arm reaches [m], (n, dimension).

    Args:
        arm: The arm.
        places: The places.
        closely: Number of the worst places at which more configurations are tried.
        starts: Joint positions from which the search starts [rad], (n, dof), overwritten with those
            at the points that are found.
    """
    points = places.points
    if isinstance(arm, PlanarTwoLink):
        near, far = arm.reach
        along = points - [arm.base, 0.0]
        distance = np.linalg.norm(along, axis=1, keepdims=True)
        # All directions are alike for a point at the base itself.
        ways = np.where(distance > 0, along / np.where(distance > 0, distance, 1.0), [1.0, 0.0])
        return np.asarray([arm.base, 0.0] + ways * np.clip(distance, near, far))
    assert isinstance(arm, SerialArm)
    from armcontour.robot.inverse import REACH_SEEDS, nearest_reached, seeds

    task, many = task_dimension(places.paths[0][1], arm), seeds(arm)
    poses = np.concatenate([places.rotations, points[:, :, None]], axis=2)
    found = np.empty((len(poses), arm.dof))
    for i in range(len(poses)):
        own = many[:FEW_SEEDS] if starts is None else starts[i : i + 1]
        found[i] = nearest_reached(arm, poses[i], task, own)
    away = np.linalg.norm(arm.tool_position(found) - points, axis=1)
    for i in np.argsort(-away)[:closely]:
        if away[i] > OUT_OF_REACH:
            # Another configuration may come nearer.
            own = np.vstack([found[i], many[:REACH_SEEDS]])
            found[i] = nearest_reached(arm, poses[i], task, own)
    if starts is not None:
        starts[:] = found
    return arm.tool_position(found)


def _refusal(job: Job, places: _Places, away: FloatArray, k: int, rapid: bool) -> Unreachable:
    """The refusal by the place `k`, which is the farthest from what the arm reaches."""
    called, path = places.paths[places.of[k]]
    point, s, gap = places.points[k], float(places.s[k]), float(away[k])
    far = gap >= FAR_OUT
    drawn = (np.resize([*point, 0.0], 3) - job.part.position) @ job.part.rotation
    drawn = drawn[: len(point)]
    before = (
        "" if np.allclose(drawn, point) else f", which is {_place(drawn, far)} before path.frame"
    )
    count = len(np.unique(places.of[away > OUT_OF_REACH]))
    others = "" if far or count < 2 else f" ({count} of {len(places.paths)} are out of reach)"
    remedy = unit_hint(gap) if far else "; " + _remedy(job, places, away, rapid)
    return Unreachable(
        f"{capitalise(called)} is out of reach of the arm {job.arm.name} by up to "
        f"{f'{gap:.3g} m' if far else number(gap, 'm')}, most at {_place(point, far)}, {s:.6g} m "
        f"along it{before}{others}{remedy}.",
        point=point.tolist(),
        s=s,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _remedy(job: Job, places: _Places, away: FloatArray, rapid: bool) -> str:
    """What brings all places into reach, as the end of a sentence."""
    way = _way(job.arm, places, away)
    lower = "all contours are in reach: take a smaller approach or retract, or " if rapid else ""
    free = what_helps(places.paths[0][1]).removeprefix("move the path or the arm")
    if way is None:
        return f"{lower}move the part or the arm{free}; armcontour place looks where"
    return (
        f"{lower}move the part by {_place(way)} (path.frame, --at), with which all "
        f"{'rapids' if rapid else 'contours'} come into reach{free}, or let armcontour place look "
        "for the best place"
    )


def _way(arm: Arm, places: _Places, away: FloatArray) -> FloatArray | None:
    """A way of the part that brings all places into reach [m], (3,); None if none is found.

    Parts stay on their table, as far as that helps.
    """
    worst = np.argsort(-away)[: MOST_MOVED // 4]
    even = np.linspace(0, len(away) - 1, MOST_MOVED).astype(np.intp)
    kept = places.some(np.union1d(worst, even))
    way = np.zeros(kept.points.shape[1])
    starts = None
    if isinstance(arm, SerialArm):
        from armcontour.robot.inverse import seeds

        starts = np.tile(seeds(arm)[0], (len(kept.s), 1))
    for _ in range(MOST_STEPS):
        moved = kept._replace(points=kept.points + way)
        missing = _reached(arm, moved, WORST, starts) - moved.points
        gaps = np.linalg.norm(missing, axis=1)
        k = int(np.argmax(gaps))
        if gaps[k] <= OUT_OF_REACH:
            return way
        step = missing[k].copy()
        if len(step) == 3 and np.linalg.norm(step[:2]) > np.abs(step[2]):
            step[2] = 0.0
        long = float(np.linalg.norm(step))
        # Only the part of a step that lies along the missing way helps there.
        wanted = gaps[k] ** 2 / long if long > 0 else 0.0
        way = np.round((way + step / max(long, OUT_OF_REACH) * (wanted + INSIDE)) / SAID) * SAID
    return None


def _place(point: FloatArray, far: bool = False) -> str:
    """Coordinates in millimetres to the micrometre, or in metres."""
    scale, digits, unit = (1.0, 6, "m") if far else (1e3, 3, "mm")
    shown = (f"{x:.{6 if far else 10}g}" for x in np.round(point * scale, digits) + 0.0)
    return f"({', '.join(shown)}) {unit}"
