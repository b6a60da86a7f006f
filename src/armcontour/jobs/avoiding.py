"""Joint paths of a program that keep clear: other configurations, and rapids around obstacles."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.arms import Arm, SerialArm
from armcontour.arms.inverse import configurations
from armcontour.clearance import Cell, Clearance
from armcontour.clearance.connecting import connect, through
from armcontour.clearance.distances import can_measure
from armcontour.errors import ArmContourError, InvalidInput, locate_errors
from armcontour.frames import exp
from armcontour.geometry import Path
from armcontour.jobs.job import Job, Run
from armcontour.jobs.programs import time_run
from armcontour.motion import JointPath, Span, Trajectory, stand_still
from armcontour.program import Contour, Program, contour_called
from armcontour.scene.arm_shapes import ASSUMED_GAP, ASSUMED_RADIUS
from armcontour.timing import Tracing, trace_program
from armcontour.timing.fastest_configuration import bound_duration, find_starts
from armcontour.timing.program_tracing import TracedMove, ends_of
from armcontour.tracing import trace

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cleared:
    """A plan that keeps clear, as far as one was found.

    Args:
        traced: Its joint paths.
        trajectory: The plan.
        clearance: How far the arm stays from itself and from its cell; None for an arm whose shapes
            are not known.
        notes: Sentences on what was done for it; without a clearance, why there is none.
    """

    traced: Tracing
    trajectory: Trajectory
    clearance: Clearance | None
    notes: tuple[str, ...] = ()


def keep_clear(
    job: Job, this: Run, traced: Tracing, trajectory: Trajectory, progress: Progress
) -> Cleared:
    """Prove that a plan keeps clear, or plan it anew with other joint paths.

    Args:
        job: The job.
        this: The run.
        traced: Joint paths of the plan.
        trajectory: The plan.
        progress: Called with the step "clearance" and the share that is done.

    Raises:
        Collision: The arm comes too near to something, no other way was found, and the job does not
            ignore this.
        InvalidInput: The job has a scene, but the shapes of the arm are not known.
    """
    progress(Step(("clearance",)))
    if not _is_looked_at(job):
        unseen = _why_unseen(job.arm)
        return Cleared(traced=traced, trajectory=trajectory, clearance=None, notes=unseen)
    cell = job.cell
    if job.scene is None and not cell.pairs:
        return Cleared(traced=traced, trajectory=trajectory, clearance=None)
    found = cell.check(trajectory)
    notes = ((OTHER,) if traced.passed_over else ()) + _about_tool(job.arm)
    if not found.kept and not job.ignore_collisions:
        other, more = avoid(job, this, traced, cell, progress)
        if other is not traced:
            notes = tuple(dict.fromkeys((*more, *notes)))
            progress(Step(("timing",)))
            traced = other
            trajectory = time_run(job, this, traced, progress, duration=this.duration)
            found = cell.check(trajectory)
    if not found.kept and not job.ignore_collisions:
        _refuse(traced.program, trajectory, cell)
        found.refuse()
    return Cleared(traced=traced, trajectory=trajectory, clearance=found, notes=notes)


def first_contour_clear(job: Job) -> Callable[[JointPath], bool] | None:
    """Whether a contour keeps clear along a joint path; None if no configuration is chosen.

    Args:
        job: The job.
    """
    chosen = job.start is None and isinstance(job.arm, SerialArm)
    if chosen and not job.ignore_collisions and _is_looked_at(job):
        return job.cell.keeps
    return None


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
        f"the tool is taken as a capsule with a radius of {ASSUMED_RADIUS * 1e3:.3g} mm, from the "
        f"flange to {ASSUMED_GAP * 1e3:.3g} mm before the tool point: arm.tool.shapes gives its "
        "own shapes",
    )


def _refuse(program: Program, trajectory: Trajectory, cell: Cell) -> None:
    """Refuse the first contour that comes too near to something, else the first other move.

    Rapids might go around what is in their way, so that contours are what a user has to change.

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
        found = None if x.trajectory is None else cell.check(x.trajectory)
        if found is not None and not found.kept:
            with locate_errors(name):
                found.later(x.t[0]).refuse()


def avoid(
    job: Job, this: Run, traced: Tracing, cell: Cell, progress: Progress
) -> tuple[Tracing, tuple[str, ...]]:
    """Joint paths of a program with which the arm keeps its margins, as far as they are found.

    Contours are followed in another configuration, or with another turn about a tool axis that is
    free. Rapids go back along the tool axis, move, and approach along it; or through postures that
    a search finds.

    Args:
        job: The job.
        this: The run.
        traced: Joint paths, along which the arm comes too near to something.
        cell: The arm and its cell.
        progress: Called with the step "clearance" and the share that is done.

    Returns:
        The joint paths, and sentences on what is different.
    """
    notes: list[str] = []
    if not _contours_clear(traced, cell):
        other = _other_start(job, this, traced, cell, progress)
        if other is None or not _contours_clear(other, cell):
            # No rapid helps; the plan that got farthest is refused, with its first contour that
            # comes too near.
            return traced if other is None else other, ()
        traced = other
        notes.append(OTHER)
    steps, around = [], 0
    for k, x in enumerate(traced.steps):
        progress(Step(("clearance",), k / len(traced.steps)))
        path = x.joint_path
        if path is not None and not _is_contour(traced, x) and not cell.keeps(path):
            found = _rapid_around(job.arm, this, cell, path)
            if found is not None:
                around += 1
                x = dataclasses.replace(x, joint_path=found)
        steps.append(x)
    if around:
        what = "1 rapid goes" if around == 1 else f"{around} rapids go"
        notes.append(f"{what} around what the direct way would come too near to")
    return dataclasses.replace(traced, steps=tuple(steps)), tuple(notes)


def _is_contour(traced: Tracing, step: TracedMove) -> bool:
    """Whether a step is a contour."""
    return step.move is not None and isinstance(traced.program.moves[step.move], Contour)


def _contours_clear(traced: Tracing, cell: Cell) -> bool:
    """Whether all contours keep clear."""
    return all(
        cell.keeps(x.joint_path)
        for x in traced.steps
        if x.joint_path is not None and _is_contour(traced, x)
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
        best: tuple[float, Tracing] | None = None
        clear = [x for x in starts if cell.keeps(_rest(x))]
        for k, q in enumerate(clear):
            progress(Step(("clearance",), k / len(clear)))
            try:
                found = trace_program(program, job.arm, this.limits, start=q)
            except ArmContourError:
                continue
            least = sum(bound_duration(x, bounds) for x in found.joint_paths)
            if best is not None and least >= best[0]:
                continue
            reach = _reach(found, cell)
            if reach == np.inf:
                best = least, found
            elif reach > reached:
                farthest, reached = found, reach
        if best is not None:
            return best[1]
    return farthest


def _reach(traced: Tracing, cell: Cell) -> float:
    """Number of contours that keep clear before one does not, and the share of that one."""
    contours = [x for x in traced.steps if x.joint_path is not None and _is_contour(traced, x)]
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
    point, rotation = path([0.0])[0], path.orientation([0.0])[0]
    turned: list[FloatArray] = []
    for angle in np.arange(TURNS) * 2 * np.pi / TURNS:
        pose = np.column_stack([rotation @ exp(np.array([0.0, 0.0, angle])), point])
        turned += list(configurations(arm, pose, WHOLE_POSE))
    yield turned


def _rapid_around(arm: Arm, this: Run, cell: Cell, path: JointPath) -> JointPath | None:
    """A joint path with the same ends that keeps clear; None if none is found."""
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
