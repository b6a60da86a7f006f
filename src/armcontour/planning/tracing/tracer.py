"""Joint paths along which an arm follows a tool path: inverse kinematics at knots.

Knots are added until the tool follows its path between them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Generic, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput, Unreachable
from armcontour.core.pool import split_evenly
from armcontour.geometry import Path
from armcontour.geometry.path import cut_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import JointPath, quintic
from armcontour.planning.tracing.guide import Guide
from armcontour.planning.tracing.joint_ranges import (
    check_joint_range,
    turn_by,
    turn_into_range,
)
from armcontour.planning.tracing.knots import (
    FINER,
    MIDDLE,
    PLACES,
    Knots,
    describe_fast_rotation,
    first_knots,
    motion_at,
    poses_at,
    row_of_poses,
    suggest_remedy,
    task_dimension,
    without_held,
)
from armcontour.planning.tracing.parallel_joints import check_held, turn_as_tool
from armcontour.planning.tracing.path_samples import CHORD_TURN, PathSamples, sample_path
from armcontour.planning.tracing.positioner_tilt import check_tilt
from armcontour.planning.tracing.tool_cone import check_cone, cone_of
from armcontour.robot import (
    Arm,
    Chain,
    Limits,
    PlanarTwoLink,
    SerialArm,
    load_named,
    pose_solver,
)
from armcontour.robot.inverse_kinematics import AXIS
from armcontour.robot.preferred_chain import list_held
from armcontour.robot.tool_turning import REACHED_ANGLE

if TYPE_CHECKING:
    from armcontour.planning.tracing.causes import Postures

# Length below which an interval outside the tolerance indicates a singularity [m].
SMALLEST_INTERVAL = 1e-9
# Largest distance between the tool and its position on the path between knots [m].
TRACING_TOLERANCE = 1e-10
# Powers of `PLACES`, (places, 6).
POWERS = PLACES[:, None] ** np.arange(6)
# q, dq_ds and d2q_ds2 at the starts, or at the ends, of n intervals, (n, dof) each.
Ends = tuple[FloatArray, FloatArray, FloatArray]
A = TypeVar("A", bound=Arm, covariant=True)
# Largest angle between the tool and its required orientation between knots [rad].
ANGULAR_TOLERANCE = 1e-9
# Ratio of pivots in elimination below which the Jacobian is singular.
SINGULAR_JACOBIAN = 1e-9
# Task dimensions that compare the whole rotation of the tool
WHOLE_ROTATIONS = (4, 6)
# Number of steps in which joint positions are found along a path on which still joints move.
STEPS_BETWEEN = 200
# Distance between the points of a sketch, divided by the span of the arm.
SKETCHED = 0.01
# Largest number of intervals between knots that are solved at once. More do not fit into the
# processor's cache, and their tables would take most of the memory of a long path.
INTERVALS_AT_ONCE = 1024
# Cones that are tried as remedies near the pole of a head [rad]
TRIED_CONES = tuple(np.radians([0.2, 1.0, 5.0]).tolist())


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Joint path of one configuration."""

    joint_path: JointPath
    cost: float  # Cost by which the joint paths of one tool path are sorted


class Solver(ABC, Generic[A]):
    """Computes joint positions and their derivatives along a tool path, for one kind of arm."""

    def __init__(self, path: Path, arm: A) -> None:
        self.path = path
        self.arm = arm

    def first_ends(self, knots: Knots, guess: FloatArray | None) -> tuple[Ends, Ends]:
        """Return q, dq_ds and d2q_ds2 at the starts and at the ends of the first intervals.

        `guess` are the joint positions near the solutions at the starts, then at the ends, (2 n,
        dof).
        """
        n = len(knots)
        both = knots.part(np.tile(np.arange(n), 2))
        columns = self.ends(both, np.concatenate([knots.u0, knots.u1]), guess)
        return _select(columns, slice(n)), _select(columns, slice(n, None))

    @abstractmethod
    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """Return q, dq_ds and d2q_ds2 at distances `u` [m] along the segments, (n, dof) each.

        - `knots`: the n knot intervals.
        - `u`: distance along the segment of each interval [m], (n,).
        - `guess`: joint positions near the solution, (n, dof); not used by a closed form.
        """

    def guess(
        self, knots: Knots, u: FloatArray, middle: FloatArray, halfway: FloatArray
    ) -> FloatArray | None:
        """Return joint positions near the solutions in intervals, (n, dof); None if not needed.

        Near a singularity the quintic may overshoot, and `halfway` is the better guess.

        - `knots`: the n knot intervals.
        - `u`: distance along the segment of each interval [m], (n,).
        - `middle`: joint positions in the middle of the quintics of the intervals, (n, dof).
        - `halfway`: means of the joint positions at both ends, (n, dof).
        """
        nearer = self.tool_errors(knots, u, halfway) < self.tool_errors(knots, u, middle)
        return np.where(nearer[:, None], halfway, middle)

    @abstractmethod
    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Return the error of the tool at joint positions `q`, divided by the tolerance, (n,)."""

    def errors_between(self, knots: Knots, start: Ends, end: Ends) -> tuple[FloatArray, FloatArray]:
        """Return the largest tool error on each quintic, divided by the tolerance, (n,).

        Also return the joint positions in the middle of the intervals, (n, dof).
        """
        largest = np.empty(len(knots))
        middle = np.empty_like(start[0])
        for rows in _rows_at_once(len(knots)):
            part = knots.part(rows)
            curves = quintic(part.u1 - part.u0, _select(start, rows), _select(end, rows))
            q = np.tensordot(POWERS, curves, (1, 1))
            errors = self.tool_errors(*part.places(), q.reshape(-1, q.shape[2]))
            largest[rows] = errors.reshape(-1, len(part)).max(axis=0)
            middle[rows] = q[MIDDLE]
        return largest, middle

    def refuse_stop(self, s: float, *q: FloatArray) -> NoReturn:
        """Raise Unreachable at a point of the path behind which the joint path does not go on.

        An arm in the plane stops only where it is singular.

        - `s`: arc length of the point [m].
        - `q`: joint positions near the point [rad], (dof,) each.
        """
        path = self.path
        point = path(s).tolist()
        raise Unreachable(
            describe_fast_rotation(path, s)
            or f"At {s:.6g} m of {path.length:.6g} m along the path, at "
            f"{tuple(round(x, 6) for x in point)} m, the arm {self.arm.name} is singular. "
            f"{suggest_remedy(path)}.",
            point=point,
            s=s,
            limit="singularity",
        )

    def continuous(self, start: Ends, end: Ends) -> tuple[Ends, Ends]:
        """Return values at starts and ends of the intervals, without jumps between intervals."""
        return start, end


class AnalyticSolver(Solver[PlanarTwoLink]):
    """Exact joint positions and derivatives at knots, by (3)-(4), (28) and (27) of the paper."""

    def __init__(
        self, path: Path, arm: PlanarTwoLink, configuration: str, tolerance: float
    ) -> None:
        # `configuration`: one of `arm.branches`; `tolerance`: largest distance of the tool from the
        # path between knots [m].
        if path.dimension != arm.dimension:
            raise ArmMismatch(
                f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} "
                f"has {arm.dimension}. Use a path with {arm.dimension} coordinates."
            )
        super().__init__(path, arm)
        self.configuration = configuration
        self.tolerance = tolerance

    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """Return q, dq_ds and d2q_ds2 at distances `u` [m] along the segments, (n, dof) each."""
        try:
            q = self.arm.joint_position(self.path.on_segment(knots.segment, u), self.configuration)
        except Unreachable as error:
            index = error.index or 0
            s = float(knots.arc_lengths(u)[index])
            raise Unreachable(
                f"At {s:.6g} m along the path: {error}",
                point=error.point,
                index=int(knots.segment[index]),
                s=s,
                limit=error.limit,
                needed=error.needed,
                allowed=error.allowed,
            ) from None
        dq_ds = self.arm.joint_velocity(q, self.path.on_segment(knots.segment, u, 1))
        curvature = self.path.on_segment(knots.segment, u, 2)
        return q, dq_ds, self.arm.joint_acceleration(q, dq_ds, curvature)

    def guess(self, knots: Knots, u: FloatArray, middle: FloatArray, halfway: FloatArray) -> None:
        """Return None, because the closed form needs no guess."""

    def continuous(self, start: Ends, end: Ends) -> tuple[Ends, Ends]:
        """Remove jumps by whole turns from the joint positions."""
        q = np.stack([start[0], end[0]], axis=1).reshape(-1, start[0].shape[1])
        unwrapped = np.unwrap(q, axis=0).reshape(len(start[0]), 2, -1)
        return (unwrapped[:, 0], *start[1:]), (unwrapped[:, 1], *end[1:])

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Return the tool's distances from the path points, divided by the tolerance, (n,)."""
        difference = self.arm.tool_position(q) - self.path.on_segment(knots.segment, u)
        return np.asarray(np.linalg.norm(difference, axis=1) / self.tolerance)


def refine(solver: Solver[Arm], knots: Knots, guess: FloatArray | None = None) -> JointPath:
    """Add exact knots to a joint path until it satisfies the solver's tolerance.

    - `solver`: computes joint positions and their derivatives.
    - `guess`: as in `first_ends`.
    """
    start, end = solver.first_ends(knots, guess)
    # The guess of a long path takes much memory, and is not needed any more.
    del guess
    settled = np.zeros(len(knots), dtype=bool)
    while True:
        start, end = solver.continuous(start, end)
        unsettled = np.flatnonzero(~settled)
        if len(unsettled) == len(knots):
            errors, middle = solver.errors_between(knots, start, end)
        else:
            errors, middle = solver.errors_between(
                knots.part(unsettled), _select(start, unsettled), _select(end, unsettled)
            )
        outside = ~(errors <= 1)
        too_coarse = np.zeros(len(settled), dtype=bool)
        too_coarse[unsettled[outside]] = True
        if not too_coarse.any():
            break
        coarse = knots.part(too_coarse)
        small = np.flatnonzero(coarse.u1 - coarse.u0 < SMALLEST_INTERVAL)
        if len(small):
            first = small[0]
            solver.refuse_stop(float(coarse.s0[first]), start[0][too_coarse][first])
        u = (coarse.u0 + coarse.u1) / 2
        halfway = (start[0][too_coarse] + end[0][too_coarse]) / 2
        between = solver.ends(coarse, u, solver.guess(coarse, u, middle[outside], halfway))
        knots, parent, second = knots.halve(too_coarse, u)
        start, end = _select(start, parent), _select(end, parent)
        for k in range(3):
            start[k][second] = between[k]
            end[k][second - 1] = between[k]
        settled = (~too_coarse)[parent]
    path = solver.path
    breaks = np.append(knots.s0, path.length)
    return JointPath.hermite(breaks, start, end, stops=path.stops, tool_path=path)


def _rows_at_once(count: int) -> list[slice]:
    """Divide intervals between knots into groups of at most INTERVALS_AT_ONCE."""
    return split_evenly(count, -(-count // INTERVALS_AT_ONCE))


def _select(ends: Ends, selection: BoolArray | IntArray | slice) -> Ends:
    """Select rows of q, dq_ds and d2q_ds2."""
    q, dq_ds, d2q_ds2 = ends
    return q[selection], dq_ds[selection], d2q_ds2[selection]


class NumericSolver(Solver[SerialArm]):
    """Exact joint positions and derivatives at knots, by Newton's method from nearby guesses."""

    def __init__(
        self,
        path: Path,
        arm: SerialArm,
        task: int,  # Task dimension: 6, 5, 4 or 3, see `task_dimension`
        tolerance: float,  # Largest distance of the tool from the path between knots [m]
        guide: Guide | None,  # Guide of a redundant arm
    ) -> None:
        super().__init__(path, arm)
        self.task = task
        self.tolerance = tolerance
        self._guide = guide

    def ends(self, knots: Knots, u: FloatArray, guess: FloatArray | None) -> Ends:
        """Return q, dq_ds and d2q_ds2 at distances `u` [m] along the segments, (n, dof) each."""
        assert guess is not None
        q = np.array(guess, order="C")
        dq_ds = np.empty_like(q)
        d2q_ds2 = np.empty_like(q)
        for rows in _rows_at_once(len(u)):
            ends = q[rows], dq_ds[rows], d2q_ds2[rows]
            self._write_ends(knots.part(rows), u[rows], guess[rows], ends)
        return q, dq_ds, d2q_ds2

    def _write_ends(self, knots: Knots, u: FloatArray, guess: FloatArray, ends: Ends) -> None:
        """Write `ends` of some intervals; q contains the guess before.

        - `ends`: q, dq_ds and d2q_ds2, (n, dof) each.
        - other arguments: as of `ends`.
        """
        q, dq_ds, d2q_ds2 = ends
        poses, rates = motion_at(self.path, knots, u)
        w, g = self._rows(knots, u)
        links = self.arm.link_table
        solved = pose_solver.solve_poses(links, self.task, q, poses, w, g)
        found = pose_solver.path_derivatives(links, self.task, q, poses, rates, w, g)
        dq_ds[:] = found.dq_ds
        d2q_ds2[:] = found.d2q_ds2
        bad = ~(solved & (found.pivot_ratio > SINGULAR_JACOBIAN))
        bad |= ~np.isfinite(d2q_ds2).all(axis=1)
        if bad.any():
            first = int(np.argmax(bad))
            self.refuse_stop(float(knots.arc_lengths(u)[first]), guess[first], q[first])

    def tool_errors(self, knots: Knots, u: FloatArray, q: FloatArray) -> FloatArray:
        """Return the larger ratio of position and orientation error to its tolerance, (n,)."""
        difference = self.arm.poses(q) - poses_at(self.path, knots, u)
        error: FloatArray = np.linalg.norm(difference[:, :, 3], axis=1) / self.tolerance
        if self.task == 3:
            return error
        turned = difference[:, :, 2]
        if self.task in WHOLE_ROTATIONS:
            turned = difference[:, :, :3].reshape(-1, 9) / np.sqrt(2.0)
        return np.asarray(np.maximum(error, np.linalg.norm(turned, axis=1) / ANGULAR_TOLERANCE))

    def refuse_stop(self, s: float, *q: FloatArray) -> NoReturn:
        """Raise Unreachable at a point of the path behind which the joint path does not go on."""
        from armcontour.planning.tracing.refusals import refuse_stop

        if describe_fast_rotation(self.path, s):
            super().refuse_stop(s)
        refuse_stop(self.path, self.arm, s, self.task, [x for x in q if np.isfinite(x).all()])

    def _rows(self, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return null-space rows w, (n, 3, free, dof), and guide positions g, (n, 3, dof)."""
        # The second axis is the order of the derivative along s, see `guide`.
        n = len(u)
        dof = self.arm.dof
        if self._guide is None:
            return np.zeros((n, 3, 0, dof)), np.zeros((n, 3, dof))
        return self._guide.evaluate(
            knots.arc_lengths(u), knots.arc_lengths((knots.u0 + knots.u1) / 2)
        )


@checks.explained
def trace(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    tolerance: float = TRACING_TOLERANCE,
) -> JointPath:
    """Compute the joint path along which the arm's tool follows `path`.

    q, dq_ds and d2q_ds2 at the knots are exact, by (28) and (27) for an arm in the plane and by
    their counterparts for an arm in space. Between knots the joint path is a quintic. Knots are
    added until the tool is within `tolerance` of the path and within 1e-9 rad of its orientation.

    >>> joint_path = ac.trace(path, arm)
    >>> joint_path(0.01).shape, joint_path.length == path.length
    ((2,), True)

    Args:
        path: Tool path.
        arm: The arm.
        limits: Limits whose joint ranges apply, and whose joint velocities weight the lengths of
            joint paths; by default those of the arm.
        configuration: For an arm in the plane, one of `arm.branches`; by default the first that
            completes the path. `plan` chooses the fastest.
        seed: For an arm in space, joint positions near the start of the joint path [rad], (dof,);
            by default the configuration with the shortest joint path. `plan` chooses the fastest.
        tolerance: Largest distance between the tool and its position on the path [m].

    Raises:
        Unreachable: The path is out of reach, leaves a joint range or meets a singularity; with
            the arc length.
        InvalidInput: The path does not fit the arm.
    """
    joint_paths = trace_all(
        path,
        load_named(arm),
        limits=limits,
        configuration=configuration,
        seed=seed,
        tolerance=tolerance,
        max_count=1,
    )
    return joint_paths[0]


def trace_all(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    tolerance: float = TRACING_TOLERANCE,
    max_count: int | None = None,  # Largest number of joint paths; all by default
) -> list[JointPath]:
    """Trace a path in all configurations that complete it; the shortest joint path is first.

    An arm in the plane has one joint path per branch, in the order of its branches. An arm in space
    has one joint path per configuration. A redundant arm has infinitely many: `MAX_STARTS` sampled
    starts are followed, and at most `MAX_SOLUTIONS` joint paths are returned (both in
    `branch_solutions`).
    """
    candidates = trace_candidates(
        path,
        arm,
        limits=limits,
        configuration=configuration,
        seed=seed,
        tolerance=tolerance,
        max_count=max_count,
    )
    return [x.joint_path for x in candidates]


def trace_candidates(
    path: Path,
    arm: Arm,
    *,
    limits: Limits | None = None,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    tolerance: float = TRACING_TOLERANCE,
    max_count: int | None = None,
) -> list[Candidate]:
    """Trace a path as `trace_all`, and return the joint paths with their costs."""
    if not isinstance(path, Path):
        raise InvalidInput(
            f"trace takes a Path, not a {type(path).__name__}. Pass a program to plan, which "
            "traces its contours."
        )
    checks.positive("tracing tolerance", tolerance, "m")
    if limits is not None:
        checks.check_type("limits", limits, Limits)
        arm = arm.with_limits(limits)
    if isinstance(arm, PlanarTwoLink):
        if seed is not None:
            raise InvalidInput(
                f"The arm {arm.name} has named branches. Specify a configuration instead of a seed."
            )
        branches = arm.branches if configuration is None else (configuration,)
        tries = [(partial(_trace_planar, path, arm, x, tolerance), 0.0) for x in branches]
        return _complete(tries, max_count)
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"Inverse kinematics is not available for {type(arm).__name__}. Use a SerialArm or "
            "a PlanarTwoLink."
        )
    if configuration is not None:
        raise InvalidInput(
            f"The arm {arm.name} has no named branches. Instead of a configuration, specify a "
            "seed with approximate joint positions at the start of the path."
        )
    _refuse_flat(arm)
    near = None if seed is None else _check_seed(arm, seed)
    if arm.chain.still:
        from armcontour.planning.tracing.still_joints import cost_of, trace_still

        trace_others = partial(trace_all, tolerance=tolerance)
        still_paths = trace_still(path, arm, near, max_count, trace_others)
        return [Candidate(joint_path=x, cost=cost_of(arm, x)) for x in still_paths]
    return _trace_serial(path, arm, near, tolerance, max_count)


def _refuse_flat(arm: SerialArm) -> None:
    """Raise InvalidInput for an arm in space whose joints are parallel, because it is singular."""
    if arm.dof > 2 and arm.moves_in_a_plane:
        raise InvalidInput(
            f"The joints of the arm {arm.name} are parallel or slide in one plane, so its tool "
            "stays in a plane. Arms in a plane have two links. Describe them by an arm file of the "
            "kind planar_two_link."
        )


def sketch_all(
    path: Path, arm: SerialArm, *, limits: Limits | None = None
) -> tuple[FloatArray, list[FloatArray]]:
    """Find joint positions at a few points of a long path, in all configurations.

    Returns arc lengths of the points from 0 to the path's end [m], (n,), and joint positions there
    [rad], (n, dof) each, the shortest joint path first.

    The arm moves in space.
    """
    from armcontour.planning.tracing.branch_solutions import find_solutions

    if limits is not None:
        arm = arm.with_limits(limits)
    _refuse_flat(arm)
    moving, joints = without_held(arm)
    task = dimension_of(path, arm, moving)
    path = turn_as_tool(path, moving)
    knots = first_knots(path, arm.span)
    few = knots.part(_few_places(path, knots, SKETCHED * arm.span))
    solutions = find_solutions(PathSamples(path=path, knots=few), moving, task, None)
    positions = np.zeros((len(solutions), len(few) + 1, arm.dof))
    positions[:, :, joints] = [x.q for x in solutions]
    positions[:, :, list(arm.chain.held)] = list(arm.chain.held.values())
    return np.append(few.s0, path.length), list(positions)


def dimension_of(path: Path, arm: SerialArm, moving: SerialArm) -> int:
    """Return the task dimension of a path for an arm without its held joints, `moving`."""
    check_held(path, arm, moving)
    try:
        return task_dimension(path, moving)
    except InvalidInput as error:
        if not arm.chain.held:
            raise
        # Raises the error if the arm does not support the path even with all of its joints.
        task = task_dimension(path, arm)
        if task <= moving.dof:
            raise error.with_location(f"with {list_held(arm.chain)} (held)") from None
        raise ArmMismatch(
            f"The path prescribes {task} degrees of freedom of the tool, but only {moving.dof} of "
            f"{arm.dof} joints of the arm {arm.name} can move, because preferences hold "
            f"{list_held(arm.chain)}. Hold fewer joints, or prescribe less of the tool's "
            "orientation (axis_only leaves the rotation about the tool axis free).",
            joint=min(arm.chain.held),
            needed=float(task),
            allowed=float(moving.dof),
        ) from None


def _few_places(path: Path, knots: Knots, step: float) -> IntArray:
    """Return indices of knots every `step` [m] or CHORD_TURN of rotation, and of the last knot."""
    turn = np.linalg.norm(np.diff(row_of_poses(path, knots)[:, :, :3], axis=0), axis=(1, 2))
    steps_done = knots.s0 / step + np.cumsum(turn) / CHORD_TURN
    begins_step = np.diff(np.floor(steps_done), prepend=-1.0) > 0
    begins_step[-1] = True
    return np.flatnonzero(begins_step)


def trace_rest(path: Path, arm: Arm, whole: JointPath, s: float, start: float) -> JointPath:
    """Trace the rest of a path in the configuration in which the whole path is traced.

    At the start of the rest, the joint positions equal those on the whole path, including whole
    turns and the positions of free joints, and also along the rest as far as both paths are equal.

    Args:
        path: The rest of the path, possibly with a lead-in.
        arm: The arm with the limits of the motion.
        whole: Joint path along the whole path.
        s: Arc length of the whole path at which the rest begins [m].
        start: Arc length of `path` at which the rest begins, after the lead-in [m].

    Raises:
        Unreachable: The arm cannot follow the lead-in in this configuration.
    """
    known = whole(s)
    if isinstance(arm, PlanarTwoLink):
        joint_path = trace(path, arm, configuration=arm.configuration_of(known))
        return _turn_to(joint_path, arm, known - joint_path(start))
    assert isinstance(arm, SerialArm)
    arm = arm.hold_still(known)
    # Joint positions on the whole path may exceed a joint range by rounding errors.
    lower, upper = arm.limits.joint_range(arm.dof)
    seed = np.clip(known, lower, upper)
    before = None
    if start > REPEATED_POINT:
        before = trace(cut_path(path, 0.0, start).reversed(), arm, seed=seed)
        seed = np.clip(before(before.length), lower, upper)
    if not is_redundant(path, arm):
        return trace(path, arm, seed=seed)

    def positions(along: FloatArray) -> FloatArray:
        """Return the known joint positions at arc lengths of the rest [rad], (n, dof)."""
        # Both paths end at the same point, so arc lengths are counted from there.
        rest = np.clip(whole.length - (path.length - along), 0.0, whole.length)
        q = whole(np.where(along <= start, s, rest))
        if before is not None:
            lead = along < start
            q[lead] = before(np.clip(start - along[lead], 0.0, before.length))
        return q

    return _trace_near(path, arm, positions, start)


def trace_to(path: Path, arm: Arm, q: FloatArray) -> JointPath:
    """Trace a path in the configuration in which it ends at joint positions.

    Args:
        path: The path.
        arm: The arm with the limits of the motion.
        q: Joint positions at the end of the path [rad], (dof,).

    Raises:
        Unreachable: The arm cannot follow the path in this configuration.
    """
    if isinstance(arm, PlanarTwoLink):
        joint_path = trace(path, arm, configuration=arm.configuration_of(q))
        return _turn_to(joint_path, arm, q - joint_path(joint_path.length))
    assert isinstance(arm, SerialArm)
    arm = arm.hold_still(q)
    lower, upper = arm.limits.joint_range(arm.dof)
    back = trace(path.reversed(), arm, seed=np.clip(q, lower, upper))
    if not is_redundant(path, arm):
        return trace(path, arm, seed=np.clip(back(back.length), lower, upper))

    def positions(along: FloatArray) -> FloatArray:
        """Return the known joint positions at arc lengths of the path [rad], (n, dof)."""
        return back(np.clip(path.length - along, 0.0, back.length))

    return _trace_near(path, arm, positions, 0.0)


def trace_between(path: Path, arm: SerialArm, first: FloatArray, last: FloatArray) -> JointPath:
    """Trace a path on which the still joints move evenly from one position to another.

    The other joints begin at `first` and follow; at the end they may differ from `last`.

    Args:
        path: The path.
        arm: The arm with the limits of the motion.
        first: Joint positions at the start of the path [rad], (dof,).
        last: Joint positions [rad], (dof,), of which those of the still joints count.

    Raises:
        Unreachable: The arm cannot follow the path in this way.
    """
    still = list(arm.chain.still)

    def positions(along: FloatArray) -> FloatArray:
        """Return joint positions at increasing arc lengths [m], (n, dof)."""
        count = np.ceil(np.diff(along, prepend=0.0) / path.length * STEPS_BETWEEN).astype(np.intp)
        q = first.copy()
        found = []
        before = 0.0
        for s, steps in zip(along, count, strict=True):
            for x in np.linspace(before, s, steps + 1)[1:]:
                q[still] = first[still] + (last[still] - first[still]) * x / path.length
                q = _solve_near(path, arm, float(x), q)
            before = s
            found.append(q.copy())
        return np.array(found)

    return _trace_near(path, arm.holding({}), positions, 0.0)


def _solve_near(path: Path, arm: SerialArm, s: float, q: FloatArray) -> FloatArray:
    """Return joint positions nearest to q [rad], (dof,), for a tool pose, with still joints kept.

    - `s`: arc length of the pose [m].
    """
    from armcontour.planning.tracing.smoothing import null_space
    from armcontour.planning.tracing.strained_postures import targets_at

    moving, joints = without_held(arm.hold_still(q))
    task = dimension_of(path, arm, moving)
    pose = targets_at(turn_as_tool(path, moving), np.array([s]))
    near = q[None, joints]
    w = null_space(moving, pose, task, near)[:, None]
    solution = near.copy()
    if not pose_solver.solve_poses(moving.link_table, task, solution, pose, w, near[:, None])[0]:
        NumericSolver(path, moving, task, TRACING_TOLERANCE, None).refuse_stop(s, near[0])
    found = q.copy()
    found[joints] = solution[0]
    return found


def is_redundant(path: Path, arm: SerialArm) -> bool:
    """Test whether the joints of an arm that are not held can move while the tool point rests."""
    from armcontour.planning.tracing.leaning import may_lean

    moving, _ = without_held(arm)
    task = dimension_of(path, arm, moving)
    return task < moving.dof or (task == AXIS and may_lean(path, moving))


def _turn_to(joint_path: JointPath, arm: Arm, difference: FloatArray) -> JointPath:
    """Shift joints by the whole turns nearest to a difference [rad], (dof,)."""
    joint_path = turn_by(joint_path, np.rint(difference / (2 * np.pi)))
    check_joint_range(joint_path, arm.limits, arm)
    return joint_path


def _trace_near(
    path: Path, arm: SerialArm, positions: Callable[[FloatArray], FloatArray], knot: float
) -> JointPath:
    """Trace a path of a redundant arm near known joint positions, which it meets at its knots.

    - `positions`: joint positions at arc lengths [m], (n,) -> (n, dof).
    - `knot`: arc length of an additional knot [m].
    """
    from armcontour.planning.tracing.leaning import leans, may_lean, trace_leaning
    from armcontour.planning.tracing.two_axis_head import HEAD_FINER

    moving, joints = without_held(arm)
    leaning = dimension_of(path, arm, moving) == AXIS and may_lean(path, moving)
    knots = first_knots(path, arm.span, HEAD_FINER if leaning else FINER)
    s = np.append(knots.s0, path.length)
    if np.abs(s - knot).min() > REPEATED_POINT:
        split = (knots.s0 < knot) & (knot < s[1:])
        u = (knots.u0 + knot - knots.s0)[split]
        knots = knots.halve(split, u)[0]
        s = np.append(knots.s0, path.length)
    q = positions(s)[:, joints]
    poses = row_of_poses(path, knots)
    if leaning and leans(path, moving, poses, q):
        refine_near = partial(_refine_guided, arm, TRACING_TOLERANCE)
        return trace_leaning(path, arm, knots, q, knot, refine_near)
    return _refine_solution(path, arm, PathSamples(path=path, knots=knots), q)


def _trace_planar(
    path: Path, arm: PlanarTwoLink, configuration: str, tolerance: float
) -> JointPath:
    """Trace a path by an arm in the plane in one branch, within its joint ranges."""
    joint_path = refine(
        AnalyticSolver(path, arm, configuration, tolerance), first_knots(path, arm.span)
    )
    joint_path = turn_into_range(joint_path, arm.limits)
    check_joint_range(joint_path, arm.limits, arm)
    return joint_path


def _trace_serial(
    path: Path, arm: SerialArm, seed: FloatArray | None, tolerance: float, max_count: int | None
) -> list[Candidate]:
    """Trace a path by a serial arm in its configurations; the shortest joint path is first."""
    from armcontour.planning.tracing.causes import find_causes
    from armcontour.planning.tracing.leaning import attempts, may_lean
    from armcontour.planning.tracing.refusals import has_other_cause, name_cause

    moving, joints = without_held(arm)
    task = dimension_of(path, arm, moving)
    near = None if seed is None else seed[joints]
    leaning = task == AXIS and may_lean(path, moving)
    try:
        if leaning:
            refine_near = partial(_refine_guided, arm, tolerance)
            tries = ((x, 0.0) for x in attempts(path, arm, near, refine_near))
            return _complete(tries, max_count)
        return _trace_exactly(path, arm, task, near, tolerance, max_count)
    except Unreachable as error:
        # From a seed, only one configuration is tried; callers try the others.
        if seed is not None:
            raise
        # Near the pole of a head, the singularity of the required axis is no cause.
        if leaning and cone_of(path) == 0.0:
            raise _with_cone_remedy(error, path, arm, tolerance) from None
        if not has_other_cause(error, arm):
            raise
        turned = turn_as_tool(path, moving)
        findings = find_causes(turned, arm, task)
        if findings.feasible is None:
            raise name_cause(error, findings, turned, arm) from None
        if leaning:
            raise
        # Smoothing may have moved all joint paths out of their ranges.
        tries_near = _trace_postures(path, arm, task, findings.feasible, tolerance)
        if not tries_near:
            raise
        try:
            return _complete(tries_near, max_count)
        except Unreachable:
            raise error from None


def _with_cone_remedy(
    error: Unreachable, path: Path, arm: SerialArm, tolerance: float
) -> Unreachable:
    """Return the error of a head near its pole, with the smallest tried cone that is enough."""
    for cone in TRIED_CONES:
        with suppress(Unreachable):
            _trace_serial(path.with_cone(cone), arm, None, tolerance, 1)
            remedy = Unreachable(
                f"{error} A cone of {np.degrees(cone):g} deg around the required tool axis "
                "(`cone` of the orientation) was tried and is enough."
            )
            vars(remedy).update(vars(error))
            return remedy
    return error


def _trace_postures(
    path: Path, arm: SerialArm, task: int, postures: Postures, tolerance: float
) -> list[tuple[Callable[[], JointPath], float]]:
    """Return functions that trace a path near postures, and their costs, the smallest first."""
    from armcontour.planning.tracing.branch_solutions import joint_distance
    from armcontour.planning.tracing.smoothing import move_to_poses

    moving, _ = without_held(arm)
    turned = turn_as_tool(path, moving)
    samples = sample_path(turned, arm.span, FINER if task < moving.dof else 1)
    s = samples.s
    guesses = np.empty((len(postures.q), len(s), moving.dof))
    for k, known in enumerate(postures.q):
        guesses[k] = np.column_stack([np.interp(s, postures.s, x) for x in known.T])
    q, fits = move_to_poses(moving, samples.poses, task, guesses)
    tries = []
    for near in q[fits]:
        trace_near = partial(_refine_in_cone, path, arm, samples, near, tolerance)
        tries.append((trace_near, joint_distance(moving, near)))
    return sorted(tries, key=lambda x: x[1])


def _refine_in_cone(
    path: Path, arm: SerialArm, samples: PathSamples, q: FloatArray, tolerance: float
) -> JointPath:
    """Refine joint positions as `_refine_solution`, and check the cone of the tool axis."""
    joint_path = _refine_solution(path, arm, samples, q, tolerance)
    if cone_of(path) > 0.0:
        # The tool turns about one direction only, and differs from the required axis.
        check_cone(joint_path, arm, max(cone_of(path), REACHED_ANGLE))
    return joint_path


def _trace_exactly(
    path: Path,
    arm: SerialArm,
    task: int,
    seed: FloatArray | None,
    tolerance: float,
    max_count: int | None,
) -> list[Candidate]:
    """Trace a path in the configurations in which the tool has the required orientation.

    - `seed`: as in `trace`, for the joints that are not held, (joints,).
    """
    from armcontour.planning.tracing.branch_solutions import find_solutions
    from armcontour.planning.tracing.refusals import numbered_as

    moving, _ = without_held(arm)
    turned = turn_as_tool(path, moving)
    samples = sample_path(turned, arm.span, FINER if task < moving.dof else 1)
    with numbered_as(arm):
        solutions = find_solutions(samples, moving, task, seed)
    if task == moving.dof:
        # Without a guide only the knots are needed, so the poses of a long path can be released.
        samples = PathSamples(path=turned, knots=samples.knots)
    tries = []
    for x in solutions:
        trace_near = partial(_refine_in_cone, path, arm, samples, x.q, tolerance)
        tries.append((trace_near, x.cost))
    return _complete(tries, max_count)


def _refine_solution(
    path: Path,
    arm: SerialArm,
    samples: PathSamples,
    q: FloatArray,
    tolerance: float = TRACING_TOLERANCE,
) -> JointPath:
    """Refine joint positions at knots to a joint path, and check it against the joint ranges.

    - `samples`: the knots of the path, with the orientation that the tool has.
    - `q`: positions at these knots of the joints that are not held [rad], (n + 1, joints).
    - `tolerance`: largest distance of the tool from the path between knots [m].
    """
    from armcontour.planning.tracing.smoothing import guide_at_stations

    moving, _ = without_held(arm)
    task = dimension_of(path, arm, moving)
    guide = None
    if task < moving.dof:
        guide = guide_at_stations(samples, moving, task, q)
    return _refine_guided(arm, tolerance, path, samples.knots, q, task, guide)


def _refine_guided(
    arm: SerialArm,
    tolerance: float,
    path: Path,
    knots: Knots,
    q: FloatArray,
    task: int,
    guide: Guide | None,
) -> JointPath:
    """Refine joint positions near those at knots to a joint path, and check its ranges.

    - `tolerance`, `q`: as in `_refine_solution`.
    - `task`: task dimension; the guide determines the other motions.
    """
    moving, joints = without_held(arm)
    numeric = NumericSolver(turn_as_tool(path, moving), moving, task, tolerance, guide)
    joint_path = refine(numeric, knots, np.concatenate([q[:-1], q[1:]]))
    if numeric.path is not path:
        joint_path = replace(joint_path, tool_path=path)
    if moving is not arm:
        joint_path = _with_held(joint_path, arm.chain, joints)
    check_joint_range(joint_path, arm.limits, arm)
    check_tilt(joint_path, arm)
    return joint_path


def _with_held(joint_path: JointPath, chain: Chain, joints: IntArray) -> JointPath:
    """Return the joint path of all joints, from that of the joints that are not held."""
    coefficients = np.zeros((len(joint_path.coefficients), 6, len(chain)))
    coefficients[:, :, joints] = joint_path.coefficients
    for k, position in chain.held.items():
        coefficients[:, 0, k] = position
    return replace(joint_path, coefficients=coefficients)


def _complete(
    tries: Iterable[tuple[Callable[[], JointPath], float]], max_count: int | None
) -> list[Candidate]:
    """Trace a path in all configurations that complete it; raise the first error if none does.

    - `tries`: for each configuration, a function that traces the path, and the cost.
    """
    candidates: list[Candidate] = []
    refusals: list[Unreachable] = []
    for attempt, cost in tries:
        if max_count is not None and len(candidates) == max_count:
            break
        # A configuration that is singular or leaves a joint range between knots does not exclude
        # the others.
        try:
            candidates.append(Candidate(joint_path=attempt(), cost=cost))
        except Unreachable as error:
            refusals.append(error)
    if not candidates:
        raise refusals[0]
    return candidates


def _check_seed(arm: SerialArm, seed: npt.ArrayLike) -> FloatArray:
    """Check a seed against the joint ranges; return it as joint positions [rad], (dof,)."""
    positions = checks.per_joint("seed", seed, arm.dof, "rad")
    lower, upper = arm.limits.joint_range(arm.dof)
    outside = (positions < lower) | (positions > upper)
    if outside.any():
        j = int(np.argmax(outside))
        unit = arm.chain.unit("rad", j)
        raise InvalidInput(
            f"seed has joint {j + 1} at {positions[j]:.6g} {unit}, but its range is from "
            f"{lower[j]:.6g} to {upper[j]:.6g} {unit}. Specify values in {unit}, or with a unit.",
            joint=j,
            needed=float(positions[j]),
            allowed=float(lower[j] if positions[j] < lower[j] else upper[j]),
        )
    return positions
