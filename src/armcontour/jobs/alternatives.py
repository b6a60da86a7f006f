"""`alternatives`: other joint paths of a program, tried to avoid collisions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.frames import exp
from armcontour.core.progress import Progress, Step
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.jobs.job import Job, Run
from armcontour.jobs.resumed_configuration import Resumption
from armcontour.motion import JointPath, Span, Trajectory, dwell_law
from armcontour.planning import Tracing, trace_program
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.program_tracing import find_starts
from armcontour.planning.tracing.leaning import leaned_paths
from armcontour.program import Contour, Program, contour_called
from armcontour.program.move_errors import move_context
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import ASSUMED_GAP, ASSUMED_RADIUS, NO_FLOOR
from armcontour.verification.clearance import Cell, Clearance
from armcontour.verification.clearance.body_pairs import can_measure

# Number of rotations about a free tool axis that are tried.
TOOL_AXIS_TURNS = 8
REST = "at rest"
OTHER_CONFIGURATION = (
    "the arm uses another configuration, because the contours are collision-free in it"
)
# Remedy for collisions of moves other than contours.
RAISE_RAPIDS = "Set process.approach and process.retract, or move the obstacle"
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
    job: Job,
    run: Run,
    traced: Tracing,
    progress: Progress,
    resumption: Resumption | None = None,
) -> Iterator[tuple[Tracing, tuple[str, ...]]]:
    """Yield joint paths and notes on them: the fastest, then alternatives without collisions.

    Use the next alternative if the plan along the previous joint paths has a collision. If no
    alternative is free of collisions, the last one has the longest collision-free part.

    A resumed job keeps the configuration of the whole job, so it has no alternatives.
    """
    # Alternatives are another configuration, or another rotation about a free tool axis.
    if not _is_checked(job):
        yield traced, _explain_unchecked(job.arm)
        return
    if not _has_pairs(job):
        yield traced, ()
        return
    notes = ((OTHER_CONFIGURATION,) if traced.faster_rejected else ()) + _about_tool(job.arm)
    if resumption is not None and resumption.whole is not None:
        yield traced, tuple(dict.fromkeys((*resumption.notes, *notes)))
        return
    yield traced, notes
    if (reached := _count_clear(traced, job.cell)) < np.inf:
        other = _other_start(job, run, traced, reached, progress)
        if other is not None:
            clear = _count_clear(other, job.cell, np.inf) == np.inf
            yield other, tuple(dict.fromkeys((*[OTHER_CONFIGURATION] * clear, *notes)))


def first_clear(
    job: Job, run: Run, traced: Tracing, progress: Progress
) -> tuple[Tracing, tuple[str, ...]]:
    """Return the first of the `alternatives` that is free of collisions, and notes on it.

    Raises:
        Collision: All alternatives have collisions.
    """
    checked = _is_checked(job) and _has_pairs(job)
    for candidate, notes in alternatives(job, run, traced, progress):
        if not checked or all(job.cell.check(x).satisfied for x in candidate.joint_paths):
            return candidate, notes
    for step in candidate.steps:
        if step.joint_path is not None:
            with step.named():
                clearance = job.cell.check(step.joint_path)
                # The parameter of a joint path along a tool path is the arc length.
                s = None if step.joint_path.tool_path is None else clearance.first_time
                clearance.refuse(s=s)
    return candidate, notes


def clearance_of(job: Job, motion: Trajectory | JointPath) -> Clearance | None:
    """Check the arm's clearance from itself and its cell; None if it is not checked."""
    return job.cell.check(motion) if _is_checked(job) and _has_pairs(job) else None


def below_base(job: Job, motion: Trajectory) -> str | None:
    """Return a warning if links are below the base; None if none is, or links are not checked."""
    if not _is_checked(job):
        return None
    return Clearance(pairs=(), below=job.cell.below(motion)).below_base


def _has_pairs(job: Job) -> bool:
    """Return whether any pair of bodies may collide."""
    return job.scene is not None or bool(job.cell.pairs)


def first_contour_clear(job: Job) -> Callable[[JointPath], bool] | None:
    """Return the test whether a contour's joint path is free of collisions and above the base.

    None if the start configuration is given or collisions are not checked.
    """
    chosen = not job.has_start and isinstance(job.arm, SerialArm)
    if not chosen or not _is_checked(job):
        return None
    return job.cell.fits


def _is_checked(job: Job) -> bool:
    """Return whether distances are computed: with a scene, or if shapes of links are known."""
    scene = job.scene
    if scene is None:
        return job.arm.knows_shapes and can_measure()
    # A scene without obstacles and without a floor requires no shapes of the links.
    return bool(scene.obstacles) or scene.floor != NO_FLOOR or not _lacks_shapes(job.arm)


def _lacks_shapes(arm: Arm) -> bool:
    """Return whether an arm is described without shapes; missing files are another fault."""
    try:
        return arm.shapes is None
    except InvalidInput:
        return False


def _explain_unchecked(arm: Arm) -> tuple[str, ...]:
    """Say why self-collision is not checked; nothing for planar arms or if other notes do."""
    if arm.dimension != 3:
        return ()
    try:
        return (NO_SHAPES,) if arm.shapes is None else (NOT_CHECKED,)
    except InvalidInput:
        # No note is needed, because the notes of the arm list its missing meshes.
        return ()


def _about_tool(arm: Arm) -> tuple[str, ...]:
    """Say that the shape of the tool is missing or assumed; nothing if it is specified."""
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
    """Raise Collision for the first contour with a collision, else for the first other move."""
    # Contours have priority, because users can raise rapids by an approach and a retract.
    contours = iter(enumerate(program.contours))
    moves: list[tuple[str, tuple[str, ...], Span]] = []
    contour_name = contour_called(program.contours[0], 0)
    relation = "to"
    for span in trajectory.spans:
        if span.kind == "contour":
            number, contour = next(contours)
            contour_name = contour_called(contour, number)
            relation = "after"
            moves.append((contour_name, contour.entities, span))
        else:
            moves.append((f"{span.kind} {relation} {contour_name}", (), span))
    for name, entities, span in sorted(moves, key=lambda move: move[2].kind != "contour"):
        if span.trajectory is not None:
            with move_context(name, span.trajectory.path, entities):
                _refuse_span(job.cell.check(span.trajectory), span, span.trajectory)
    job.cell.check(trajectory).refuse()


def _refuse_span(clearance: Clearance, span: Span, motion: Trajectory) -> None:
    """Raise Collision if the clearance of a span's motion violates a margin, in time of the plan.

    - `motion`: motion of the span, whose times begin at 0.
    """
    first_time = clearance.first_time
    if first_time is None:
        return
    s = None if motion.path is None else float(motion.s(first_time))
    in_time_of_plan = clearance.later(span.t[0])
    if span.kind == "contour":
        in_time_of_plan.refuse(s=s)
    else:
        in_time_of_plan.refuse(RAISE_RAPIDS, s=s)


def _other_start(
    job: Job, run: Run, traced: Tracing, reached: float, progress: Progress
) -> Tracing | None:
    """Find joint paths from another start: collision-free, or with the largest `_count_clear`.

    None if no start has a larger `_count_clear` than the first joint paths (`reached`).
    """
    if job.has_start or not isinstance(job.arm, SerialArm):
        return None
    program = traced.program
    farthest = None
    cell = job.cell
    first = next(x.path for x in program.moves if isinstance(x, Contour))
    bounds = run.limits.for_joints(job.arm.dof)
    # Contours that cannot be traced from a start have the same joint path for all starts.
    fastest: dict[int, JointPath] = {}
    # A tool that leans has several joint paths from one start.
    accept = cell.fits if first.orientation is not None and first.orientation.cone > 0.0 else None
    for starts in _starts(job.arm.with_limits(bounds), first):
        best: tuple[float, Tracing | None] = (np.inf, None)
        rests = [Trajectory(laws=(dwell_law(x, 1.0),), method=REST) for x in starts]
        clear = [x for x, rest in zip(starts, rests, strict=True) if cell.keeps(rest)]
        for k, q in enumerate(clear):
            progress(Step(("clearance",), k / len(clear)))
            try:
                tracing = trace_program(
                    program, job.arm, run.limits, seed=q, accept=accept, fastest=fastest
                )
            except ArmContourError:
                continue
            bound = sum(bound_duration(x, bounds) for x in tracing.joint_paths)
            if bound >= best[0]:
                continue
            reach = _count_clear(tracing, cell, reached)
            if reach == np.inf:
                best = bound, tracing
            elif reach > reached:
                farthest = tracing
                reached = reach
        if best[1] is not None:
            return best[1]
    return farthest


def _count_clear(traced: Tracing, cell: Cell, enough: float = 0.0) -> float:
    """Count the collision-free contours before the first collision; infinite without a collision.

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

    The rotations are about a free tool axis; use them if no configuration is collision-free. The
    last list has positions at which the tool leans in its cone.
    """
    try:
        yield find_starts(path, arm)
    except ArmContourError:
        return
    if path.orientation is None or not path.orientation.axis_only:
        return
    from armcontour.robot.inverse_kinematics import configurations

    point = path([0.0])[0]
    rotation = path.orientation([0.0])[0]
    turned: list[FloatArray] = []
    for angle in np.arange(TOOL_AXIS_TURNS) * 2 * np.pi / TOOL_AXIS_TURNS:
        pose = np.column_stack([rotation @ exp(np.array([0.0, 0.0, angle])), point])
        turned += list(configurations(arm, pose, WHOLE_POSE))
    yield turned
    if path.orientation.cone > 0.0:
        leaned: list[FloatArray] = []
        for other in leaned_paths(path):
            with suppress(ArmContourError):
                leaned += find_starts(other, arm)
        yield leaned
