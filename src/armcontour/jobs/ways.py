"""`ways`: joint paths of a program that keep clear, and the refusal of what is out of reach."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._progress import Progress, Step
from armcontour._text import capitalise
from armcontour.arms import Arm, PlanarTwoLink, SerialArm
from armcontour.arms.arm import FAR_OUT, hint_at_unit
from armcontour.clearance import Cell, Clearance
from armcontour.clearance.distances import can_measure
from armcontour.core.render import number
from armcontour.errors import ArmContourError, InvalidInput, Unreachable, locate_errors
from armcontour.frames import exp
from armcontour.geometry import Path
from armcontour.jobs.job import Job, Run
from armcontour.motion import JointPath, Span, Trajectory, stand_still
from armcontour.program import Contour, Program, Rapid, contour_called, prepare
from armcontour.scene.arm_shapes import ASSUMED_GAP, ASSUMED_RADIUS
from armcontour.timing import Tracing, trace_program, turn_along
from armcontour.timing.program_tracing import bound_duration, ends_of, find_starts
from armcontour.tracing import trace
from armcontour.tracing.poses import OUT_OF_REACH, task_dimension, what_helps

# A rapid that would touch goes so far back along the tool axis first [m], the least that is clear.
RETRACTS = (0.02, 0.05, 0.1, 0.2)
# Places on the way back, which is straight for the tool but not for the joints.
PLACES = 8
# Where the turn about the tool axis is free, so many of them are tried in each configuration.
TURNS = 8
REST = "at rest"
OTHER = "another configuration is taken, in which the contours are clear"
# A tool point this near to the flange has no tool between [m].
SHORT = 1e-3
# Position and orientation, with the turn about the tool axis.
WHOLE_POSE = 6

# Of arms in space; in the plane neighbouring links are all that could touch.
NOT_LOOKED_AT = (
    "nothing looked at how near the arm comes to itself: that needs the package pin, which is not "
    "installed and has no wheels for Windows."
)
NO_SHAPES = (
    "nothing looked at how near the arm comes to itself: the shapes of its links are not known; "
    "give its description <collision> elements, or the job arm.shapes."
)
# Places that are looked at: of one path, and of all; each takes a few milliseconds.
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


def ways(
    job: Job, this: Run, traced: Tracing, progress: Progress
) -> Iterator[tuple[Tracing, tuple[str, ...]]]:
    """Joint paths of a program, the fastest first, then those that are found to keep clear.

    Contours are followed in another configuration, or with another turn about a tool axis that is
    free. Rapids go back along the tool axis, move, and approach along it; or through postures that
    a search finds.

    Args:
        job: The job.
        this: The run.
        traced: The fastest joint paths.
        progress: Called with the step "clearance" and the share that is done.

    Yields:
        Joint paths, and sentences on what is different, or why nothing looks at the clearance. The
        next ones are for a caller whose plan along these comes too near to something. The last ones
        are those that got farthest.

    Raises:
        InvalidInput: The job has a scene, but the shapes of the arm are not known.
    """
    if not _is_looked_at(job):
        yield traced, _why_unseen(job.arm)
        return
    if not _has_pairs(job):
        yield traced, ()
        return
    notes = ((OTHER,) if traced.passed_over else ()) + _about_tool(job.arm)
    yield traced, notes
    cell, others = job.cell, list[str]()
    if not _contours_clear(traced, cell):
        other = _other_start(job, this, traced, cell, progress)
        if other is None:
            return
        if not _contours_clear(other, cell):
            # No rapid helps; the first contour of these that comes too near is refused.
            yield other, notes
            return
        traced = other
        others.append(OTHER)
    around = _rapids_around(job, this, traced, cell, progress)
    count = sum(x is not y for x, y in zip(around.steps, traced.steps, strict=True))
    if count:
        what = "1 rapid goes" if count == 1 else f"{count} rapids go"
        others.append(f"{what} around what the direct way would come too near to")
    if others:
        yield around, tuple(dict.fromkeys((*others, *notes)))


def clearance_of(job: Job, motion: Trajectory) -> Clearance | None:
    """How far the arm stays from itself and its cell; None where nothing looks at it."""
    return job.cell.check(motion) if _is_looked_at(job) and _has_pairs(job) else None


def below_base(job: Job, motion: Trajectory) -> str | None:
    """A sentence on links that come below the base; None if none does, or nothing looks at it."""
    if not _is_looked_at(job):
        return None
    return Clearance(pairs=(), below=job.cell.below(motion)).below_base


def _has_pairs(job: Job) -> bool:
    """Whether there is anything that the arm may come near to."""
    return job.scene is not None or bool(job.cell.pairs)


def first_contour_clear(job: Job) -> Callable[[JointPath], bool] | None:
    """Whether a contour keeps clear and above the base; None if no configuration is chosen.

    Args:
        job: The job.
    """
    chosen = job.start is None and isinstance(job.arm, SerialArm)
    if not chosen or not _is_looked_at(job):
        return None
    return job.cell.stays_above if job.ignore_collisions else job.cell.fits


def _is_looked_at(job: Job) -> bool:
    """Whether distances are computed; without a scene nobody asks for what is not known."""
    return job.scene is not None or (job.arm.knows_shapes and can_measure())


def _why_unseen(arm: Arm) -> tuple[str, ...]:
    """Why nothing looks at how near an arm comes to itself, if that is not said elsewhere."""
    if arm.dimension != 3:
        return ()
    try:
        return (NO_SHAPES,) if arm.shapes is None else (NOT_LOOKED_AT,)
    except InvalidInput:
        # Notes of the arm say which meshes are lacking.
        return ()


def _about_tool(arm: Arm) -> tuple[str, ...]:
    """What the shape of the tool is, if nobody gave it."""
    if arm.chain is None or not np.linalg.norm(arm.chain.tool.position) > SHORT:
        return ()
    own = [] if arm.shapes is None else [x for x in arm.shapes.shapes if x.tool]
    if not own:
        return ("the tool has no shape, so nothing looked at how near it comes: arm.tool.shapes",)
    if not own[0].assumed:
        return ()
    return (
        f"the tool is taken as a capsule with a radius of {number(ASSUMED_RADIUS, 'm')}, from the "
        f"flange to {number(ASSUMED_GAP, 'm')} before the tool point: arm.tool.shapes gives its "
        "own shapes",
    )


def refuse_collision(job: Job, program: Program, trajectory: Trajectory) -> None:
    """Refuse the first contour that comes too near to something, else the first other move.

    Rapids might go around what is in their way, so that contours are what a user has to change.

    Args:
        job: The job.
        program: The program.
        trajectory: Its plan.

    Raises:
        Collision: A move comes too near to something; times are those of the whole motion.
    """
    contours = iter(enumerate(program.contours))
    moves: list[tuple[str, Span]] = []
    called = contour_called(program.contours[0], 0)
    for x in trajectory.spans:
        if x.kind == "contour":
            number, contour = next(contours)
            called = contour_called(contour, number)
        moves.append((called if x.kind == "contour" else f"{x.kind} after {called}", x))
    for name, x in sorted(moves, key=lambda move: move[1].kind != "contour"):
        found = None if x.trajectory is None else job.cell.check(x.trajectory)
        if found is not None and not found.kept:
            with locate_errors(name):
                found.later(x.t[0]).refuse()
    job.cell.check(trajectory).refuse()


def _rapids_around(job: Job, this: Run, traced: Tracing, cell: Cell, progress: Progress) -> Tracing:
    """Joint paths whose rapids go around what they would come too near to, as far as is found."""
    steps = []
    for k, x in enumerate(traced.steps):
        progress(Step(("clearance",), k / len(traced.steps)))
        path = x.joint_path
        if path is not None and not traced.is_contour(x) and not cell.keeps(path):
            found = _rapid_around(job.arm, this, cell, path)
            if found is not None:
                x = dataclasses.replace(x, joint_path=found)
        steps.append(x)
    return dataclasses.replace(traced, steps=tuple(steps))


def _contours_clear(traced: Tracing, cell: Cell) -> bool:
    """Whether all contours keep clear."""
    return all(
        cell.keeps(x.joint_path)
        for x in traced.steps
        if x.joint_path is not None and traced.is_contour(x)
    )


def _other_start(
    job: Job, this: Run, traced: Tracing, cell: Cell, progress: Progress
) -> Tracing | None:
    """Joint paths from another start: the fastest whose contours keep clear, or those farthest.

    None if no start gets farther than the joint paths that were tried first.
    """
    if job.start is not None or not isinstance(job.arm, SerialArm):
        return None
    program, farthest, reached = traced.program, None, _reach(traced, cell)
    first = next(x.path for x in program.moves if isinstance(x, Contour))
    bounds = this.limits.for_joints(job.arm.dof)
    for starts in _starts(job.arm.with_limits(bounds), first):
        best: tuple[float, Tracing | None] = (np.inf, None)
        clear = [x for x in starts if cell.keeps(_rest(x))]
        for k, q in enumerate(clear):
            progress(Step(("clearance",), k / len(clear)))
            try:
                found = trace_program(program, job.arm, this.limits, start=q)
            except ArmContourError:
                continue
            least = sum(bound_duration(x, bounds) for x in found.joint_paths)
            if least >= best[0]:
                continue
            reach = _reach(found, cell)
            if reach == np.inf:
                best = least, found
            elif reach > reached:
                farthest, reached = found, reach
        if best[1] is not None:
            return best[1]
    return farthest


def _reach(traced: Tracing, cell: Cell) -> float:
    """Number of contours that keep clear before one does not, and the share of that one."""
    contours = [x for x in traced.steps if x.joint_path is not None and traced.is_contour(x)]
    for k, x in enumerate(contours):
        assert x.joint_path is not None
        if not cell.keeps(x.joint_path):
            near = cell.check(x.joint_path).too_near
            first = near[0].first_time if near else None
            return k + (first or 0.0) / x.joint_path.length
    return np.inf


def _starts(arm: SerialArm, path: Path) -> Iterator[list[FloatArray]]:
    """Joint positions in which a path can start: its configurations, then turned about a free axis.

    The turn at the start of a configuration is a good one already, so that the others only help
    where none of these is clear.
    """
    try:
        yield find_starts(path, arm)
    except ArmContourError:
        return
    if path.orientation is None or not path.orientation.axis_only:
        return
    from armcontour.arms.inverse import configurations

    point, rotation = path([0.0])[0], path.orientation([0.0])[0]
    turned: list[FloatArray] = []
    for angle in np.arange(TURNS) * 2 * np.pi / TURNS:
        pose = np.column_stack([rotation @ exp(np.array([0.0, 0.0, angle])), point])
        turned += list(configurations(arm, pose, WHOLE_POSE))
    yield turned


def _rapid_around(arm: Arm, this: Run, cell: Cell, path: JointPath) -> JointPath | None:
    """A joint path with the same ends that keeps clear; None if none is found."""
    from armcontour.clearance.connecting import connect, through

    first, last = ends_of(path)
    if not (cell.keeps(_rest(first)) and cell.keeps(_rest(last))):
        return None
    if isinstance(arm, SerialArm):
        for height in RETRACTS:
            up, down = _retract(arm, this, first, height), _retract(arm, this, last, height)
            if up is not None and down is not None:
                found = through(cell, np.concatenate([up, down[::-1]]))
                if found is not None:
                    return found
    ranges = this.limits.for_joints(arm.dof).joint_range(arm.dof)
    return connect(cell, first, last, ranges)


def _rest(q: FloatArray) -> Trajectory:
    """Rest at joint positions [rad], (dof,)."""
    return Trajectory(laws=(stand_still(q, 1.0),), method=REST)


def _retract(arm: SerialArm, this: Run, q: FloatArray, height: float) -> FloatArray | None:
    """Joint positions on the way back along the tool axis, (n, dof); None if out of reach.

    Args:
        arm: The arm.
        this: The run.
        q: Joint positions at the start [rad], (dof,).
        height: Length of the way [m].
    """
    point, rotation = (x[0] for x in arm.pose(q[None]))
    line = Path.polyline([point, point - height * rotation[:, 2]])
    try:
        way = trace(line.oriented(rotation), arm, limits=this.limits, start=q)
    except ArmContourError:
        return None
    return way(np.linspace(0.0, way.length, PLACES))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Places:
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
        most = int(np.clip(MOST_PLACES // len(paths), 2, MOST_ALONG))
        s, points, rotations = [], [], []
        for _, x in paths:
            at = _some(np.union1d(np.linspace(0, x.length, most), x.breaks), most)
            s.append(at)
            points.append(x(at))
            rotations.append(
                np.tile(np.eye(3), (len(at), 1, 1)) if x.orientation is None else x.orientation(at)
            )
        return cls(
            paths=paths,
            of=np.repeat(np.arange(len(paths)), [len(at) for at in s]),
            s=np.concatenate(s),
            points=np.concatenate(points),
            rotations=np.concatenate(rotations),
        )

    def some(self, which: IntArray) -> _Places:
        """Only these places."""
        return replace(
            self,
            of=self.of[which],
            s=self.s[which],
            points=self.points[which],
            rotations=self.rotations[which],
        )


@contextmanager
def reach_told(job: Job) -> Iterator[None]:
    """Refuse what is out of reach by its worst place, contours before rapids.

    Inside, a program is refused by the move that comes first, which may be a rapid.

    Args:
        job: The job.

    Raises:
        Unreachable: As raised inside, with the worst place of the job if that is out of reach.
    """
    try:
        yield
    except Unreachable as error:
        told = _told(job) if error.limit == "reach" else None
        if told is None:
            raise
        raise told from None


def _told(job: Job) -> Unreachable | None:
    """The refusal by the place that is farthest out of reach; None if there is none."""
    program = job.program
    if not job.process.automatic:
        program = prepare(program, job.process)
    for rapid in (False, True):
        paths = list(_paths_of(program, rapid))
        if not paths:
            continue
        places = _extremes(job.arm, _Places.along(paths))
        away = np.linalg.norm(_reached(job.arm, places, WORST) - places.points, axis=1)
        k = int(np.argmax(away))
        if away[k] > OUT_OF_REACH:
            return _refusal(job, places, away, k, rapid)
    return None


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


def _some(values: FloatArray, most: int) -> FloatArray:
    """At most twice so many values, evenly spread over all of them."""
    if len(values) <= 2 * most:
        return values
    return values[np.unique(np.linspace(0, len(values) - 1, 2 * most).astype(np.intp))]


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
    from armcontour.arms.inverse import REACH_SEEDS, nearest_reached, seeds

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
    size = f"{gap:.3g} m" if far else number(gap, "m")
    show = _m if far else _mm
    drawn = ((_in_space(point) - job.part.position) @ job.part.rotation)[: len(point)]
    own = "" if np.allclose(drawn, point) else f", which is {show(drawn)} before path.frame"
    mend = hint_at_unit(gap) if far else "; " + _mend(job, places, away, rapid)
    also = "" if far else _others(places, away)
    return Unreachable(
        f"{capitalise(called)} is out of reach of the arm {job.arm.name} by up to "
        f"{size}, most at {show(point)}, {s:.6g} m along it{own}{also}{mend}.",
        point=point.tolist(),
        s=s,
        limit="reach",
        needed=gap,
        allowed=0.0,
    )


def _others(places: _Places, away: FloatArray) -> str:
    """Of how many paths places are out of reach, if not of one alone."""
    count, of = len(np.unique(places.of[away > OUT_OF_REACH])), len(places.paths)
    return "" if count < 2 else f" ({count} of {of} are out of reach)"


def _mend(job: Job, places: _Places, away: FloatArray, rapid: bool) -> str:
    """What would bring all places into reach, as the end of a sentence."""
    what = "rapids" if rapid else "contours"
    way = _way(job.arm, places, away)
    lower = "all contours are in reach: take a smaller approach or retract, or " if rapid else ""
    free = what_helps(places.paths[0][1]).removeprefix("move the path or the arm")
    if way is None:
        return f"{lower}move the part or the arm{free}; armcontour place looks where"
    return (
        f"{lower}move the part by {_mm(way)} (path.frame, --at), with which all {what} come "
        f"into reach{free}, or let armcontour place look for the best place"
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
        from armcontour.arms.inverse import seeds

        starts = np.tile(seeds(arm)[0], (len(kept.s), 1))
    for _ in range(MOST_STEPS):
        moved = replace(kept, points=kept.points + way)
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


def _in_space(point: FloatArray) -> FloatArray:
    """A point with z, which is 0 in the plane."""
    return np.append(point, np.zeros(3 - len(point)))


def _mm(point: FloatArray) -> str:
    """Coordinates in millimetres, to the micrometre."""
    return "(" + ", ".join(f"{x:.10g}" for x in np.round(point * 1e3, 3) + 0.0) + ") mm"


def _m(point: FloatArray) -> str:
    """Coordinates in metres."""
    return "(" + ", ".join(f"{x:.6g}" for x in np.round(point, 6) + 0.0) + ") m"
