"""Joint positions of a serial arm along a path, one solution for each start configuration.

The solutions are sorted by the length of their joint paths. The configuration of a plan is chosen
later, by duration: see `trace_by_duration` in planning/program_tracing.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.pool import map_in_threads, split_evenly
from armcontour.core.sampled_data import spread_indices
from armcontour.planning.tracing.path_samples import PathSamples
from armcontour.planning.tracing.positioner_tilt import (
    angles_to_gravity,
    check_fixed_tilt,
    tilt_of,
)
from armcontour.planning.tracing.postures import ARM_JOINTS, find_postures, has_graph
from armcontour.planning.tracing.refusals import Failure, refuse_first_pose, refuse_path
from armcontour.planning.tracing.smoothing import (
    interpolate_paths,
    move_to_poses,
    null_space,
    smooth,
    smooth_in_levels,
)
from armcontour.planning.tracing.stations import Stations
from armcontour.robot import SerialArm, pose_solver
from armcontour.robot.arm import shift_by_turns
from armcontour.robot.inverse_kinematics import configurations
from armcontour.robot.limit_use import use_of

T = TypeVar("T")
R = TypeVar("R")

# Number of poses from which threads share the work; starting them takes as long as 100 poses.
THREADED_POSES = 2000
# Number of groups of branches that threads share; some branches end early.
BRANCH_GROUPS = 16
# Number of groups into which joint paths are divided for smoothing; NumPy smooths a group at once.
SMOOTHED_PARTS = 4
# Largest correction of joint positions in the last iteration at a followed pose [rad]. This one
# distinguishes branches whose costs differ in the last digit.
EXACTLY = 1e-9
# The same correction for the single branch of a seed [rad], which the solver corrects again. The
# error is about the square of this value times the condition number of the Jacobian.
NEARLY = 1e-7
# Largest number of start configurations to follow.
MAX_STARTS = 48
# Largest number of different solutions of a redundant arm.
MAX_SOLUTIONS = 8
# Largest difference outside the null space between solutions that count as equal [rad]
SAME_SOLUTION = 0.05
# Number of knots at which solutions are compared first.
FEW_KNOTS = 16
# Number of iterations of smoothing for the ranking of redundant solutions by cost.
ROUGH_ROUNDS = 3
# Largest number of knots for the ranking of redundant solutions by cost.
ROUGH_KNOTS = 70
# Number of best-ranked redundant solutions that are smoothed completely; more are smoothed only if
# none of these succeeds.
MAX_SMOOTHED = 16
# Largest number of whole turns by which a joint that is out of its range is shifted
MAX_TURNS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Joint positions along a path in one configuration."""

    # Joint positions at the start of every knot interval and the end of the last [rad], (n + 1,
    # dof)
    q: FloatArray
    cost: float  # Length of the joint path; ranks the solutions before they are timed


def find_solutions(
    samples: PathSamples, arm: SerialArm, task: int, seed: FloatArray | None
) -> list[Solution]:
    """Find the solutions that complete the path inside the joint ranges, the shortest first.

    - `samples`: the path and its knots.
    - `seed`: approximate joint positions at the start of the path [rad], (dof,); None for all
      configurations.
    """
    path = samples.path
    poses = samples.followed
    # No posture of the arm changes this angle, so it is the reason before any other.
    check_fixed_tilt(arm, np.append(samples.fine.s0, path.length), poses)
    starts = None if seed is None else configurations(arm, poses[0], task, seed)
    collected = _Solutions(
        arm=arm,
        s=samples.s,
        poses=samples.poses,
        task=task,
        seed=seed,
        stations=samples.stations,
        knot_index=samples.knot_index,
    )
    redundant = task < arm.dof
    # The whole path decides on the postures of a cell. An arm without external axes has little
    # room to move, so following is enough in most cases.
    if redundant and arm.dof > ARM_JOINTS and has_graph(arm):
        collected.search(starts)
    if not collected.solutions:
        if starts is None:
            starts = configurations(arm, poses[0], task)
        if len(starts) == 0:
            refuse_first_pose(path, arm, poses, task, seed)
        if seed is None and tilt_of(arm.chain) is not None:
            # Starts that turn the tool down come first.
            starts = starts[np.argsort(angles_to_gravity(arm, starts), kind="stable")]
        collected.follow(poses, starts[:MAX_STARTS])
    if redundant and not collected.solutions and arm.dof == ARM_JOINTS and has_graph(arm):
        collected.search(None if seed is None else starts)
    solutions = collected.solutions
    if not solutions:
        farthest = max(collected.failures, key=lambda x: x.reached)
        refuse_path(path, arm, samples.fine, poses, task, farthest)
    # Solutions with the elbow up and down often have equal cost. The solution whose joints start
    # closer to 0 comes first.
    solutions.sort(key=lambda x: (float(f"{x.cost:.9e}"), float(np.abs(x.q[0]).sum())))
    return solutions[:MAX_SOLUTIONS] if redundant else solutions


@dataclass(slots=True, kw_only=True)
class _Solutions:
    """Collects the solutions of a path, and the places at which others end."""

    arm: SerialArm
    s: FloatArray  # Arc lengths of the knots [m], (n,)
    poses: FloatArray  # Tool poses at the knots, (n, 3, 4)
    task: int
    seed: FloatArray | None
    stations: Stations
    knot_index: IntArray  # Index of each knot among the followed poses, (n,)
    solutions: list[Solution] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)  # With indices of followed poses

    def search(self, starts: FloatArray | None) -> None:
        """Add solutions that are chosen over the whole path, from starts, (k, dof), if given."""
        postures = find_postures(self.arm, self.s, self.poses, self.task, self.stations, starts)
        for x in postures.failures:
            self._fail(x)
        self._add([shift_by_turns(self.arm, q, self.seed)[0] for q in postures.paths])

    def follow(self, poses: FloatArray, starts: FloatArray) -> None:
        """Add solutions that follow poses, (m, 3, 4), from starts, (k, dof)."""
        correction = EXACTLY if self.seed is None else NEARLY
        followed, incomplete = _follow(self.arm, poses, self.task, starts, correction)
        self.failures += incomplete
        at_knots = [q[self.knot_index] for q in followed]
        if self.task < self.arm.dof:
            at_knots = _rank(self.arm, self.s, self.poses, self.task, at_knots, self.seed)
        self._add(at_knots)

    def _add(self, joint_paths: list[FloatArray]) -> None:
        """Add joint paths, (n, dof) each, that stay in the joint ranges, after smoothing."""
        arm = self.arm
        different = _DistinctSolutions(arm, self.poses, self.task)
        candidates = _with_costs(
            arm, self.s, self.poses, self.task, joint_paths, self.seed, self.stations
        )
        for count, (q, cost) in enumerate(candidates, start=1):
            in_range = _turn_into_range(arm, q, self.seed)
            if isinstance(in_range, Failure):
                self._fail(in_range)
            elif different.add(in_range):
                self.solutions.append(Solution(q=in_range, cost=cost))
            if self.task < arm.dof and self.solutions and count >= MAX_SMOOTHED:
                break

    def _fail(self, failure: Failure) -> None:
        """Add a failure at a knot."""
        self.failures.append(replace(failure, reached=int(self.knot_index[failure.reached])))


def _with_costs(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    joint_paths: list[FloatArray],
    seed: FloatArray | None,
    stations: Stations,
) -> Iterator[tuple[FloatArray, float]]:
    """Yield joint paths with their costs; the paths of a redundant arm are smoothed on demand."""
    if task == arm.dof:
        yield from ((q, joint_distance(arm, q)) for q in joint_paths)
        return
    index = stations.index
    for group in (joint_paths[:MAX_SMOOTHED], *([q] for q in joint_paths[MAX_SMOOTHED:])):
        smoothed = _smooth(
            smooth_in_levels,
            arm,
            s[index],
            poses[index],
            task,
            [q[index] for q in group],
            stations=stations,
            start_stays=seed is not None,
        )
        if len(index) == len(s):
            # Every knot is a station, so there is nothing to interpolate.
            yield from smoothed
            continue
        for q, (changed, cost) in zip(group, smoothed, strict=True):
            change = interpolate_paths(stations.place, (changed - q[index])[None], stations.measure)
            moved, fits = move_to_poses(arm, poses, task, q + change)
            moved[0, index] = changed
            yield (moved[0], cost) if fits[0] else (q, cost)


def _follow(
    arm: SerialArm, poses: FloatArray, task: int, starts: FloatArray, max_correction: float
) -> tuple[list[FloatArray], list[Failure]]:
    """Follow all poses from each start; returns the complete joint positions, and the failures."""
    q, reached = follow_branches(arm, poses, task, starts, max_correction)
    is_complete = reached == len(poses)
    failures = []
    for branch in np.flatnonzero(~is_complete):
        count = int(reached[branch])
        failures.append(Failure(reached=count, q=q[branch, count - 1]))
    return [q[k] for k in np.flatnonzero(is_complete)], failures


def follow_branches(
    arm: SerialArm,
    poses: FloatArray,  # Rotations and positions of the tool, (n, 3, 4)
    task: int,
    starts: FloatArray,  # Joint positions at the first pose [rad], (starts, dof)
    max_correction: float = EXACTLY,
) -> tuple[FloatArray, IntArray]:
    """Follow poses from several start positions in parallel.

    Returns joint positions at the reached poses [rad], (starts, n, dof), and the number of reached
    poses, including the first, (starts,).

    A pose is reached if the correction of every joint is below `max_correction` [rad].
    """
    q = np.empty((len(starts), len(poses), arm.dof))
    reached = np.empty(len(starts), np.intp)
    q[:, 0] = starts

    def follow(branches: slice) -> None:
        pose_solver.follow(
            arm.link_table, task, poses, q[branches], reached[branches], max_correction
        )

    _map_in_threads(follow, split_evenly(len(starts), BRANCH_GROUPS), len(starts) * len(poses))
    return q, reached


def _map_in_threads(work: Callable[[T], R], items: Sequence[T], poses: int) -> list[R]:
    """Apply compiled work to several items, in threads if they have many poses in total."""
    return map_in_threads(work, items) if poses >= THREADED_POSES else [work(x) for x in items]


def _rank(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    followed: list[FloatArray],
    seed: FloatArray | None,
) -> list[FloatArray]:
    """Sort solutions by their cost after a few iterations of smoothing on some knots."""
    # Solutions that repeat an earlier one come last.
    if len(followed) == 1 and len(s) > ROUGH_KNOTS:
        return [shift_by_turns(arm, followed[0])[0]]
    few = spread_indices(len(s), ROUGH_KNOTS)
    shifted = [shift_by_turns(arm, q)[0] for q in followed]
    options = {"start_stays": seed is not None, "rounds": ROUGH_ROUNDS}
    rough = _smooth(smooth, arm, s[few], poses[few], task, [q[few] for q in shifted], **options)
    ranked: list[tuple[float, FloatArray]] = []
    for q, (smoothed, cost) in zip(shifted, rough, strict=True):
        # If some knots are left out, the smoothed joint path is too short to be continued.
        ranked.append((cost, q if len(few) < len(s) else smoothed))
    ranked.sort(key=lambda x: x[0])
    distinct: list[FloatArray] = []
    repeated: list[FloatArray] = []
    different = _DistinctSolutions(arm, poses, task)
    for _, q in ranked:
        (distinct if different.add(q) else repeated).append(q)
    return distinct + repeated


def _smooth(
    work_on: Callable[..., tuple[FloatArray, FloatArray]],
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    joint_paths: list[FloatArray],
    **options: Any,
) -> list[tuple[FloatArray, float]]:
    """Smooth joint paths of a redundant arm, (n, dof) each; return them with their costs."""
    if not joint_paths:
        return []

    def work(part: slice) -> tuple[FloatArray, FloatArray]:
        return work_on(arm, s, poses, task, np.array(joint_paths[part]), **options)

    parts = split_evenly(len(joint_paths), SMOOTHED_PARTS)
    done = _map_in_threads(work, parts, len(joint_paths) * len(s))
    smoothed = []
    for smooth_paths, costs in done:
        for q, cost in zip(smooth_paths, costs, strict=True):
            smoothed.append((q, float(cost)))
    return smoothed


class _DistinctSolutions:
    """Collection of solutions that differ by more than null-space motion."""

    def __init__(self, arm: SerialArm, poses: FloatArray, task: int) -> None:
        # `poses`: rotations and positions of the tool, (n, 3, 4).
        self.arm = arm
        self.poses = poses
        self.task = task
        self._known: list[FloatArray] = []
        # Null spaces of known solutions at a few knots, and at all knots for close comparisons.
        # They are computed when another solution is compared.
        self._rough: list[FloatArray] = []
        self._spaces: dict[int, FloatArray] = {}

    @cached_property
    def _few(self) -> IntArray:
        return spread_indices(len(self.poses), FEW_KNOTS)

    def add(self, q: FloatArray) -> bool:
        """Add joint positions, (n, dof), and return true, unless they repeat a known solution."""
        if self.task == self.arm.dof:
            if any(np.abs(q - x).max() < SAME_SOLUTION for x in self._known):
                return False
        else:
            if self._known:
                few = self._few
                for x in self._known[len(self._rough) :]:
                    self._rough.append(null_space(self.arm, self.poses[few], self.task, x[few]))
                # `_is_known` accepts at most SAME_SOLUTION times half a turn, pi, so only solutions
                # within this distance are compared exactly.
                apart = q[few] - np.array([x[few] for x in self._known])
                slides = self.arm.chain.slides
                outside = _outside_null_space(np.array(self._rough), apart, slides)[0]
                near = outside < SAME_SOLUTION * np.pi
                if any(self._is_known(k, q) for k in np.flatnonzero(near).tolist()):
                    return False
        self._known.append(q)
        return True

    def _is_known(self, k: int, q: FloatArray) -> bool:
        """Test whether joint positions differ from a known solution by null-space motion only."""
        if k not in self._spaces:
            self._spaces[k] = null_space(self.arm, self.poses, self.task, self._known[k])
        apart = q - self._known[k]
        slides = self.arm.chain.slides
        deviation, size = _outside_null_space(self._spaces[k], apart, slides)
        return bool(deviation < SAME_SOLUTION * max(1.0, float(size)))


def _outside_null_space(
    w: FloatArray, difference: FloatArray, slides: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the largest joint difference outside null spaces, and the largest one [rad].

    - `w`: bases of the null spaces, (..., n, free, dof).
    - `difference`: joint differences, modulo whole turns [rad].
    - `slides`: mask of the prismatic joints, (dof,).
    """
    wrapped = np.where(slides, difference, np.pi - np.mod(np.pi - difference, 2 * np.pi))
    outside = wrapped - (np.swapaxes(w, -1, -2) @ (w @ wrapped[..., None]))[..., 0]
    return np.abs(outside).max(axis=(-1, -2)), np.abs(wrapped).max(axis=(-1, -2))


def joint_distance(arm: SerialArm, q: FloatArray) -> float:
    """Sum the shortest times between knots [s]; without velocity limits, the steps [rad]."""
    steps = np.diff(q, axis=0)
    if arm.limits.joint_velocity is None:
        return float(np.abs(steps).max(axis=1).sum())
    return float(use_of("joint_velocity", arm.limits, steps).ratio.max(axis=1).sum())


def _turn_into_range(
    arm: SerialArm, q: FloatArray, seed: FloatArray | None
) -> FloatArray | Failure:
    """Shift positions by whole turns into the joint ranges, or return the failure."""
    shifted, inside = shift_by_turns(arm, q, seed)
    if inside:
        return shifted
    lower, upper = arm.limits.joint_range(arm.dof)
    below = shifted < lower
    above = shifted > upper
    for joint in np.flatnonzero((below | above).any(axis=0) & ~arm.chain.slides):
        shifted[:, joint] = _stay_longest(shifted[:, joint], lower[joint], upper[joint])
    below = shifted < lower
    above = shifted > upper
    row = int(np.argmax((below | above).any(axis=1)))
    worst = int(np.argmax((below | above)[row]))
    limit = float(lower[worst] if below[row, worst] else upper[worst])
    value = float(shifted[row, worst])
    return Failure(reached=row, q=shifted[row], joint=worst, value=value, limit=limit)


def _stay_longest(positions: FloatArray, lower: float, upper: float) -> FloatArray:
    """Shift a joint by the whole turns with which it stays in its range farthest along the path.

    Among such shifts, the one with the smallest excess at the first knot out of range is used.

    - `positions`: joint positions at the knots, which leave the range with every shift [rad], (n,).
    - `lower`, `upper`: ends of the range [rad].
    """
    turns = 2 * np.pi * np.arange(-MAX_TURNS, MAX_TURNS + 1)
    tried = positions[:, None] + turns
    beyond = np.maximum(lower - tried, tried - upper)
    first_outside = np.argmax(beyond > 0, axis=0)
    excess = beyond[first_outside, np.arange(len(turns))]
    best = np.lexsort((excess, -first_outside))[0]
    return np.asarray(tried[:, best])
