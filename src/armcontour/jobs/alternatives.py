"""`alternatives`: joint paths of a program without collisions."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput, error_context
from armcontour.core.frames import exp
from armcontour.core.progress import Progress, Step
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.jobs.job import Job, Run
from armcontour.motion import JointPath, Span, Trajectory, dwell_law
from armcontour.planning import Tracing, trace_program
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.program_tracing import ends_of, find_starts
from armcontour.planning.tracing import trace
from armcontour.program import Contour, Program, contour_called
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import ASSUMED_GAP, ASSUMED_RADIUS
from armcontour.verification.clearance import Cell, Clearance
from armcontour.verification.clearance.distances import can_measure

# Retract distances along the tool axis that are tried for rapids with a collision [m].
RETRACTS = (0.02, 0.05, 0.1, 0.2)
# Number of points of a retract move, which is a straight line of the tool but not of the joints.
RETRACT_POINTS = 8
# Length that a rounding of a rapid occupies on each line at its corner, as a share of half of the
# shorter line; tried in this order. With 0, the motion stops at the corners.
ROUNDED = (0.9, 0.5, 0.2, 0.0)
# Number of rotations about a free tool axis that are tried.
TURNS = 8
REST = "at rest"
OTHER_CONFIGURATION = (
    "the arm uses another configuration, because the contours are collision-free in it"
)
# If the tool point is nearer to the flange than this [m], the arm counts as having no tool.
MIN_TOOL_LENGTH = 1e-3
# Task dimension of position and orientation, including the rotation about the tool axis.
WHOLE_POSE = 6

# Notes for arms in space. A planar arm needs no note, because only its adjacent links could touch.
NOT_CHECKED = (
    "self-collision is not checked, because a library is missing. Install it with pip install "
    "'armcontour[dynamics]' (no wheels for Windows)."
)
NO_SHAPES = (
    "self-collision is not checked, because the shapes of the arm's links are unknown. Add "
    "<collision> elements to the description of the arm, or arm.shapes to the job."
)


def alternatives(
    job: Job, run: Run, traced: Tracing, progress: Progress
) -> Iterator[tuple[Tracing, tuple[str, ...]]]:
    """Yield joint paths and notes on them: the fastest, then alternatives without collisions.

    Use the next alternative if the plan along the previous joint paths has a collision. If no
    alternative is free of collisions, the last one has the longest collision-free part.
    """
    # Alternatives for contours: another configuration, or another rotation about a free tool axis.
    # Alternative for rapids: retract along the tool axis, move, and approach along it.
    if not _is_checked(job):
        yield traced, _explain_unchecked(job.arm)
        return
    if not _has_pairs(job):
        yield traced, ()
        return
    notes = ((OTHER_CONFIGURATION,) if traced.faster_rejected else ()) + _about_tool(job.arm)
    yield traced, notes
    cell, others = job.cell, list[str]()
    if (reached := _count_clear(traced, cell)) < np.inf:
        other = _other_start(job, run, traced, reached, progress)
        if other is None:
            return
        if _count_clear(other, cell, np.inf) < np.inf:
            # Other rapids cannot avoid a collision of a contour. The check of the plan reports it.
            yield other, notes
            return
        traced = other
        others.append(OTHER_CONFIGURATION)
    around = _rapids_around(job, run, traced, cell, progress)
    count = sum(x is not y for x, y in zip(around.steps, traced.steps, strict=True))
    if count:
        message = "1 rapid avoids" if count == 1 else f"{count} rapids avoid"
        others.append(f"{message} obstacles of the direct move by a retract")
    if others:
        yield around, tuple(dict.fromkeys((*others, *notes)))


def clearance_of(job: Job, motion: Trajectory | JointPath) -> Clearance | None:
    """Clearance of the arm from itself and its cell; None if it is not checked."""
    return job.cell.check(motion) if _is_checked(job) and _has_pairs(job) else None


def below_base(job: Job, motion: Trajectory) -> str | None:
    """Warning about links below the base; None if no link is below it, or links are not checked."""
    if not _is_checked(job):
        return None
    return Clearance(pairs=(), below=job.cell.below(motion)).below_base


def _has_pairs(job: Job) -> bool:
    """Return whether there are pairs of bodies that may collide."""
    return job.scene is not None or bool(job.cell.pairs)


def first_contour_clear(job: Job) -> Callable[[JointPath], bool] | None:
    """Function that tests if the joint path of a contour is collision-free and above the base.

    None if the start configuration is given or collisions are not checked.
    """
    chosen = job.seed is None and isinstance(job.arm, SerialArm)
    if not chosen or not _is_checked(job):
        return None
    return job.cell.fits


def _is_checked(job: Job) -> bool:
    """Return whether distances are computed: with a scene, or if shapes of links are known."""
    return job.scene is not None or (job.arm.knows_shapes and can_measure())


def _explain_unchecked(arm: Arm) -> tuple[str, ...]:
    """Reason why self-collision is not checked; empty for planar arms or if other notes have it."""
    if arm.dimension != 3:
        return ()
    try:
        return (NO_SHAPES,) if arm.shapes is None else (NOT_CHECKED,)
    except InvalidInput:
        # No note is needed, because the notes of the arm list its missing meshes.
        return ()


def _about_tool(arm: Arm) -> tuple[str, ...]:
    """Note on a missing or assumed shape of the tool; empty if the shape is specified."""
    if not np.linalg.norm(arm.chain.tool.position) > MIN_TOOL_LENGTH:
        return ()
    tools = [] if arm.shapes is None else [x for x in arm.shapes.shapes if x.tool]
    if not tools:
        return (
            "the clearance of the tool is not checked, because the tool has no shape. Specify it "
            "with arm.tool.shapes",
        )
    if not tools[0].assumed:
        return ()
    return (
        f"the shape of the tool is assumed to be a capsule with a radius of "
        f"{number(ASSUMED_RADIUS, 'm')}, from the flange to {number(ASSUMED_GAP, 'm')} before the "
        "tool point. Specify its real shape with arm.tool.shapes",
    )


def check_collision(job: Job, program: Program, trajectory: Trajectory) -> None:
    """Raise Collision for the first contour with a collision, else for the first such move."""
    # Contours have priority, because rapids can avoid obstacles by a retract, but contours cannot.
    contours = iter(enumerate(program.contours))
    moves: list[tuple[str, Span]] = []
    called = contour_called(program.contours[0], 0)
    for span in trajectory.spans:
        if span.kind == "contour":
            number, contour = next(contours)
            called = contour_called(contour, number)
        moves.append((called if span.kind == "contour" else f"{span.kind} after {called}", span))
    for name, span in sorted(moves, key=lambda move: move[1].kind != "contour"):
        clearance = None if span.trajectory is None else job.cell.check(span.trajectory)
        if clearance is not None and not clearance.satisfied:
            with error_context(name):
                clearance.later(span.t[0]).refuse()
    job.cell.check(trajectory).refuse()


def _rapids_around(job: Job, run: Run, traced: Tracing, cell: Cell, progress: Progress) -> Tracing:
    """Joint paths in which rapids with a collision have retracts at both ends, if possible."""
    steps = []
    for k, step in enumerate(traced.steps):
        progress(Step(("clearance",), k / len(traced.steps)))
        path = step.joint_path
        if path is not None and not traced.is_contour(step) and not cell.keeps(path):
            lifted = _rapid_around(job.arm, run, cell, path)
            if lifted is not None:
                step = dataclasses.replace(step, joint_path=lifted)
        steps.append(step)
    return dataclasses.replace(traced, steps=tuple(steps))


def _other_start(
    job: Job, run: Run, traced: Tracing, reached: float, progress: Progress
) -> Tracing | None:
    """Joint paths from another start position: collision-free, or with the largest `_count_clear`.

    None if no start has a larger `_count_clear` than the first joint paths (`reached`).
    """
    if job.seed is not None or not isinstance(job.arm, SerialArm):
        return None
    program, farthest, cell = traced.program, None, job.cell
    first = next(x.path for x in program.moves if isinstance(x, Contour))
    bounds = run.limits.for_joints(job.arm.dof)
    # Contours that cannot be traced from a start have the same joint path for all starts.
    fastest: dict[int, JointPath] = {}
    for starts in _starts(job.arm.with_limits(bounds), first):
        best: tuple[float, Tracing | None] = (np.inf, None)
        clear = [x for x in starts if cell.keeps(_rest_at(x))]
        for k, q in enumerate(clear):
            progress(Step(("clearance",), k / len(clear)))
            try:
                tracing = trace_program(program, job.arm, run.limits, seed=q, fastest=fastest)
            except ArmContourError:
                continue
            bound = sum(bound_duration(x, bounds) for x in tracing.joint_paths)
            if bound >= best[0]:
                continue
            reach = _count_clear(tracing, cell, reached)
            if reach == np.inf:
                best = bound, tracing
            elif reach > reached:
                farthest, reached = tracing, reach
        if best[1] is not None:
            return best[1]
    return farthest


def _count_clear(traced: Tracing, cell: Cell, enough: float = 0.0) -> float:
    """Number of collision-free contours before the first collision, infinite without a collision.

    The collision-free share of the contour with the collision is added. Results of at most `enough`
    are upper bounds.
    """
    contours = [x.joint_path for x in traced.steps if traced.is_contour(x)]
    for k, path in enumerate(x for x in contours if x is not None):
        violation = cell.first_violation(path, (enough - k) * path.length)
        if violation < np.inf:
            return k + violation / path.length
    return np.inf


def _starts(arm: SerialArm, path: Path) -> Iterator[list[FloatArray]]:
    """Yield lists of joint positions at the start of a path: configurations, then other rotations.

    The rotations are about a free tool axis; use them if no configuration is collision-free.
    """
    try:
        yield find_starts(path, arm)
    except ArmContourError:
        return
    if path.orientation is None or not path.orientation.axis_only:
        return
    from armcontour.robot.inverse import configurations

    point, rotation = path([0.0])[0], path.orientation([0.0])[0]
    turned: list[FloatArray] = []
    for angle in np.arange(TURNS) * 2 * np.pi / TURNS:
        pose = np.column_stack([rotation @ exp(np.array([0.0, 0.0, angle])), point])
        turned += list(configurations(arm, pose, WHOLE_POSE))
    yield turned


def _rapid_around(arm: Arm, run: Run, cell: Cell, path: JointPath) -> JointPath | None:
    """Collision-free joint path with retracts at the ends of a rapid; None if none is found."""
    first, last = ends_of(path)
    if not isinstance(arm, SerialArm):
        return None
    if not (cell.keeps(_rest_at(first)) and cell.keeps(_rest_at(last))):
        return None
    for height in RETRACTS:
        up, down = _retract(arm, run, first, height), _retract(arm, run, last, height)
        if up is not None and down is not None:
            rapid = _path_through(cell, np.concatenate([up, down[::-1]]))
            if rapid is not None:
                return rapid
    return None


def _path_through(cell: Cell, postures: FloatArray) -> JointPath | None:
    """Make a collision-free joint path through postures; None if no rounding is collision-free.

    `postures` are the joint positions [rad], (n, dof).
    """
    apart = np.append(True, np.abs(np.diff(postures, axis=0)).max(axis=1) > 1e-9)
    for share in ROUNDED if apart.sum() > 2 else ROUNDED[-1:]:
        path = round_postures(postures[apart], share)
        if cell.keeps(path):
            return path
    return None


def round_postures(postures: FloatArray, share: float) -> JointPath:
    """Make a joint path of straight lines between postures, with parabolas at the corners.

    A parabola occupies the fraction `share` of half of the shorter line at its corner; 0 stops at
    every corner.
    """
    steps = np.diff(postures, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    cut = np.zeros(len(postures))
    cut[1:-1] = share * np.minimum(lengths[:-1], lengths[1:]) / 2
    rows, widths = [], []
    for k, (direction, length) in enumerate(zip(directions, lengths, strict=True)):
        line = length - cut[k] - cut[k + 1]
        rows.append([postures[k] + cut[k] * direction, line * direction, 0 * direction])
        widths.append(line)
        if cut[k + 1] > 0:
            r = cut[k + 1]
            # The parabola extends from r before to r after the corner and connects both directions.
            rows.append(
                [
                    postures[k + 1] - r * direction,
                    2 * r * direction,
                    r * (directions[k + 1] - direction),
                ]
            )
            widths.append(2 * r)
    coefficients = np.zeros((len(rows), 6, postures.shape[1]))
    coefficients[:, :3] = rows
    return JointPath(breaks=np.concatenate([[0.0], np.cumsum(widths)]), coefficients=coefficients)


def _rest_at(q: FloatArray) -> Trajectory:
    """Trajectory that rests at joint positions [rad], (dof,), for 1 s."""
    return Trajectory(laws=(dwell_law(q, 1.0),), method=REST)


def _retract(arm: SerialArm, run: Run, q: FloatArray, height: float) -> FloatArray | None:
    """Joint positions of a retract along the tool axis [rad], (n, dof); None if out of reach."""
    point, rotation = (x[0] for x in arm.pose(q[None]))
    line = Path.polyline([point, point - height * rotation[:, 2]])
    try:
        retraction = trace(line.oriented(rotation), arm, limits=run.limits, seed=q)
    except ArmContourError:
        return None
    return retraction(np.linspace(0.0, retraction.length, RETRACT_POINTS))
