"""Bounds of a job at a place without a plan, from joint positions at some poses of its paths."""

# A place is a candidate position of the part or the base: values of the axes of the search.

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import quintic
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.tracing.configurations import MAX_STARTS, follow_branches, subdivide
from armcontour.planning.tracing.knots import (
    OUT_OF_REACH,
    PLACES,
    FirstPoses,
    first_knots,
    row_of_poses,
    task_dimension,
    tool_errors,
)
from armcontour.planning.tracing.ranges import ROUNDING
from armcontour.planning.tracing.serial_solver import SINGULAR
from armcontour.planning.tracing.solver import Ends
from armcontour.program import Contour, Dwell, Program
from armcontour.robot import Arm, Chain, Limits, SerialArm, newton
from armcontour.robot.inverse import WHOLE, configurations, out_of_reach

# Quintics through the first knots represent the joint path if their deviations from the tool path
# are at most MAX_DEVIATION [m] and MAX_ANGLE [rad]. Otherwise the duration has no bound.
MAX_DEVIATION, MAX_ANGLE = 1e-5, 1e-4
# A pose that is out of reach by more than this distance is refused without tracing [m]. Smaller
# distances are decided by tracing, which is more precise.
REACH_TOLERANCE = 1e-6
# Kinds of refusals, for messages.
REACH, RANGE, SINGULAR_ARM = "reach", "joint range", "singularity"
# Number of later poses that are checked for reach if no configuration follows the whole path.
POSES_AHEAD = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceBounds:
    """Bounds of the figures of merit of a place, without a plan."""

    duration: float = 0.0  # Lower bound of the duration, up to the error of `bound_duration` [s]
    # singular: smallest singular value along the path in the configuration with the smallest
    # duration; with `every`, in the configuration in which it is largest; NaN if unknown.
    singular: float = np.nan
    refusal: str = ""  # Kind of the refusal if tracing would fail, otherwise empty


class Screen:
    """Computes bounds of a program for a non-redundant arm, without a plan, at any place.

    `every`: if True, singular values are the largest over all configurations.
    """

    def __init__(
        self,
        program: Program,
        arm: SerialArm,
        limits: Limits,
        seed: npt.ArrayLike | None,
        *,
        every: bool = False,
    ) -> None:
        self.limits, self.every, self._arm = limits.without_jerk, every, arm
        has_seed = seed is not None and isinstance(program.moves[0], Contour)
        self.contours = [
            _PathPoses(x.path, arm, np.asarray(seed, dtype=float) if has_seed and k == 0 else None)
            for k, x in enumerate(program.contours)
        ]
        self.dwells = sum(x.duration for x in program.moves if isinstance(x, Dwell))

    @staticmethod
    def supports(program: Program, arm: object) -> bool:
        """True if bounds are available: for a path in space and an arm without redundancy."""
        return isinstance(arm, SerialArm) and all(
            x.path.dimension == 3 and task_dimension(x.path, arm) == arm.dof
            for x in program.contours
        )

    def out_of_reach(self, bases: FloatArray) -> BoolArray:
        """Mask of bases in the work frame, (n, 3, 4), from which a pose is out of reach, (n,)."""
        # Poses that may be within reach are decided by tracing.
        refused = np.zeros(len(bases), dtype=np.bool_)
        for poses in self.contours:
            refused[~refused] = poses.out_of_reach(self._arm, bases[~refused])
        return refused

    def bounds_of(self, arm: SerialArm) -> PlaceBounds:
        """Bounds of the program for an arm with the work frame of the place."""
        duration, singular = self.dwells, np.inf
        for poses in self.contours:
            bounds = poses.bounds_of(arm, self.limits, self.every)
            if bounds.refusal:
                return bounds
            duration += bounds.duration
            singular = min(singular, bounds.singular)
        return PlaceBounds(duration=duration, singular=singular)


class _PathPoses:
    """Poses of a path at its first knots, and at finer knots for following configurations."""

    def __init__(self, path: Path, arm: SerialArm, seed: FloatArray | None) -> None:
        self.path, self.seed = path, seed
        self.task = task_dimension(path, arm)
        knots = first_knots(path, arm.span)
        self.first = FirstPoses.at_knots(path, knots)
        fine, self.rows = subdivide(path, knots, self.first.row)
        self.fine = self.first.row if len(fine) == len(knots) else row_of_poses(path, fine)
        self.breaks = np.append(knots.s0, path.length)
        self.width = knots.u1 - knots.u0

    def out_of_reach(self, arm: SerialArm, bases: FloatArray) -> BoolArray:
        """Mask of bases, (n, 3, 4), from which a pose of the path is out of reach, (n,)."""
        closed = arm.closed_form
        if self.task == WHOLE and closed is not None:
            return closed.measure_excess(bases, self.fine, REACH_TOLERANCE) > REACH_TOLERANCE
        return reach_excess(arm.chain, self.task, self.first.row, bases) > 0

    def bounds_of(self, arm: SerialArm, limits: Limits, every: bool) -> PlaceBounds:
        """Bounds of the path for an arm; a refusal if no configuration follows the path."""
        starts = configurations(arm, self.fine[0], self.task, self.seed)[:MAX_STARTS]
        if len(starts) == 0:
            return PlaceBounds(refusal=REACH)
        branches, reached = follow_branches(arm, self.fine, self.task, starts)
        followed = [branches[k, self.rows] for k in np.flatnonzero(reached == len(self.fine))]
        if not followed:
            best = int(np.argmax(reached))
            farthest, last = int(reached[best]), branches[best, reached[best] - 1]
            ahead = np.linspace(farthest, len(self.fine) - 1, POSES_AHEAD).astype(np.intp)
            gaps = out_of_reach(arm, self.fine[ahead], self.task, last[None])
            return PlaceBounds(refusal=REACH if gaps.max() > OUT_OF_REACH else SINGULAR_ARM)
        inside = [q for q in followed if _fits_range(q, limits, arm.dof)]
        if not inside:
            return PlaceBounds(refusal=RANGE)
        return self._bound_configurations(arm, limits, np.array(inside), every)

    def _bound_configurations(
        self, arm: SerialArm, limits: Limits, q: FloatArray, every: bool
    ) -> PlaceBounds:
        """Bounds over k configurations with joint positions q at the knots, (k, n + 1, dof)."""
        begin, end, sound = self._end_states(arm, q)
        if not sound.any():
            return PlaceBounds(refusal=SINGULAR_ARM)
        exact = self._mask_exact(arm, begin, end)
        indices = np.flatnonzero(sound)
        durations = [
            self._duration([x[k] for x in begin], [x[k] for x in end], limits) if exact[k] else 0.0
            for k in indices
        ]
        looked = indices if every else indices[[int(np.argmin(durations))]]
        values = [least_singular_value(arm, q[k], self.task) for k in looked]
        return PlaceBounds(duration=min(durations), singular=max(values))

    def _duration(self, begin: list[FloatArray], end: list[FloatArray], limits: Limits) -> float:
        """Lower bound of the duration in one configuration [s]; 0 if there is no bound."""
        try:
            joint_path = JointPath.hermite(
                self.breaks,
                (begin[0], begin[1], begin[2]),
                (end[0], end[1], end[2]),
                stops=self.first.stops,
                tool_path=self.path,
            )
        except InvalidInput:
            # Newton's method has converged to another configuration.
            return 0.0
        return bound_duration(joint_path, limits)

    def _end_states(self, arm: SerialArm, q: FloatArray) -> tuple[Ends, Ends, BoolArray]:
        """q, dq_ds and d2q_ds2 at the starts and at the ends of all intervals, (k, n, dof) each.

        Also returns the mask of configurations without a singularity, (k,).
        """
        k, n, dof, first = len(q), q.shape[1] - 1, q.shape[2], self.first
        alone = first.ends >= n
        rows = np.concatenate([q[:, :-1], q[:, 1:][:, alone]], axis=1).reshape(-1, dof)
        m = len(rows)
        poses, rates = np.tile(first.poses, (k, 1, 1)), np.tile(first.rates, (k, 1, 1))
        w, g = np.zeros((m, 3, 0, dof)), np.zeros((m, 3, dof))
        links = arm.link_table
        converged = newton.newton(links, self.task, rows, poses, w, g)
        dq_ds, d2q_ds2, pivots = newton.path_derivatives(links, self.task, rows, poses, rates, w, g)
        good = converged & (pivots > SINGULAR) & np.isfinite(d2q_ds2).all(axis=1)
        q, dq_ds, d2q_ds2 = (x.reshape(k, -1, dof) for x in (rows, dq_ds, d2q_ds2))
        begin = q[:, :n], dq_ds[:, :n], d2q_ds2[:, :n]
        end = q[:, first.ends], dq_ds[:, first.ends], d2q_ds2[:, first.ends]
        return begin, end, np.asarray(good.reshape(k, -1).all(axis=1))

    def _mask_exact(self, arm: SerialArm, begin: Ends, end: Ends) -> FloatArray:
        """Mask of configurations in which quintics between the knots follow the path, (k,)."""
        k, n, dof = begin[0].shape
        flat = [tuple(x.reshape(k * n, dof) for x in ends) for ends in (begin, end)]
        coefficients = quintic(np.tile(self.width, k), *flat)  # type: ignore[arg-type]
        q = np.einsum("pk,ikj->pij", PLACES[:, None] ** np.arange(6), coefficients)
        targets = np.tile(self.first.between.reshape(len(PLACES), 1, n, 3, 4), (1, k, 1, 1, 1))
        q, targets = q.reshape(-1, dof), targets.reshape(-1, 3, 4)
        errors = tool_errors(arm, q, targets, self.task, (MAX_DEVIATION, MAX_ANGLE))
        return np.asarray((errors.reshape(len(PLACES), k, n) <= 1).all(axis=(0, 2)))


def _fits_range(q: FloatArray, limits: Limits, dof: int) -> bool:
    """True if full turns of the joints can move positions q [rad], (n, dof), into their ranges."""
    lower, upper = limits.joint_range(dof)
    first = np.ceil((lower - ROUNDING - q.min(axis=0)) / (2 * np.pi))
    last = np.floor((upper + ROUNDING - q.max(axis=0)) / (2 * np.pi))
    return bool((first <= last).all())


# Axes are parallel if the magnitude of the cosine of their angle exceeds this. Then lengths along
# the axes have a relative error of at most 1e-6.
PARALLEL = 1 - 1e-12


def longest_reach(chain: Chain, task: int) -> tuple[FloatArray, FloatArray, float]:
    """Point of the tool in its frame, and centre and radius of a ball that it cannot leave [m].

    The centre is in the frame of the base. For task 6, the point is on the last axis; otherwise it
    is the tool point. Offsets of links along parallel axes are added with their signs, because
    rotations about these axes do not change them. Offsets along the first axes move the centre.
    """
    end = chain.tip @ chain.tool
    point = end.inverse.position if task == 6 else np.zeros(3)
    steps = [*chain.positions[1:], *([] if task == 6 else [end.position])]
    middle, radius = chain.positions[0].copy(), 0.0
    along = across = 0.0
    sense, first = 1.0, True
    for k, step in enumerate(steps):
        axis = chain.axes[k]
        part = float(axis @ step)
        along += sense * part
        across += float(np.linalg.norm(step - part * axis))
        last = k + 1 == len(steps)
        cosine = 0.0 if last else float(axis @ chain.rotations[k + 1] @ chain.axes[k + 1])
        if abs(cosine) > PARALLEL:
            sense *= float(np.sign(cosine))
            continue
        if first:
            middle += chain.rotations[0] @ (along * chain.axes[0])
            radius += across
        else:
            radius += float(np.hypot(along, across))
        along = across = 0.0
        sense, first = 1.0, False
    return point, middle, radius


def reach_excess(chain: Chain, task: int, poses: FloatArray, bases: FloatArray) -> FloatArray:
    """Largest distance by which poses, (m, 3, 4), exceed the reach from bases, (n, 3, 4) [m], (n,).

    The distance is at most 0 if the links are long enough for all poses.
    """
    point, middle, radius = longest_reach(chain, task)
    points = poses[:, :, 3] + poses[:, :, :3] @ point
    middles = bases[:, :, 3] + bases[:, :, :3] @ middle
    distances = np.linalg.norm(points[None] - middles[:, None], axis=2)
    return np.asarray(distances.max(axis=1) - radius)


def least_singular_value(arm: Arm, q: FloatArray, task: int) -> float:
    """Smallest singular value of the task's Jacobian over joint positions, (n, dof) [m/rad].

    The rows of the Jacobian are the tool velocity [m/rad] and, for tasks 5 and 6, the angular
    velocity [rad/rad], for task 5 without the component along the tool axis.
    """
    if not isinstance(arm, SerialArm) or task == 3:
        rows = arm.tool_jacobian(q)
    else:
        rows = arm.jacobian(q)
        if task == 5:
            # Angular velocities about x and y of the tool.
            _, turned = arm.pose(q)
            across = np.swapaxes(turned[:, :, :2], 1, 2) @ rows[:, 3:]
            rows = np.concatenate([rows[:, :3], across], axis=1)
    return float(np.linalg.svd(rows, compute_uv=False)[:, -1].min())
