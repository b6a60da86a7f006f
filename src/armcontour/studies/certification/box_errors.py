"""Largest contour errors of all robots in a box: joint ranges, a bound, and the worst robots.

The servos of different joints are independent. Over the box, the positions of joint j at a time
therefore fill an interval, and the positions of all robots fill the product of these intervals: 8
executions, in which all joints are in the same corner of the box, determine the intervals, and each
corner of their product is the position of a robot of the box. The largest contour error is the
largest distance from the tool to the path over these products.

The bound adds what can lie between the corners:

- A parameter inside of its range can move a joint beyond its ends (`_beyond_corners`).
- Between two positions of a joint, the tool moves on an arc of radius rho about the axis of the
  joint, which differs from its chord by rho r² / 2 (r: half of the joint's range).
- The distance from a bent path is not convex: tool points whose path points are within a distance A
  of a common point of the path exceed the largest distance of the corners by at most
  `curvature A² / 2` (`_Bends`). At the critical times, the product is divided until this
  part is small.
- Between two samples, the distance exceeds the samples by an eighth of its second difference.

It is valid without saturation. Where parts of the path are missed (coverage), only the robots that
are executed count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.pool import map_in_threads
from armcontour.core.progress import Step
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.geometry.biarcs import length
from armcontour.motion import Execution, JointPath, SetPoints
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.simulation import simulate
from armcontour.studies.certification.case import Case
from armcontour.verification.contour_errors import ContourExecution, split_by_contour
from armcontour.verification.error_profile import Followed

# Parameters of a servo that are uncertain, in the order of the rows of deviations.
PARAMETERS = ("kp", "kv", "dead time")
# Time between two results of an execution [s]; peaks between them are evaluated.
RESULT_STEP = 2e-3
# Time between two results of the executions that determine the joint ranges [s].
RANGE_STEP = 1e-3
# Largest number of parameters of the worst robot in a summary.
MAX_NAMED_PARAMETERS = 4
# Number of the worst robots of each contour that are executed.
EXECUTED = 4
# Factor by which the second derivative by a parameter may exceed the second difference over its
# range. It exceeded it by up to 1.32 on random robots, with saturation by up to 1.85.
CURVATURE_MARGIN = 2.0
# Relative excess of the bound over the largest distance of a robot, at which a product of joint
# ranges is not divided further.
CLOSE_BOUND = 1e-3
# Largest number of parts of a product of joint ranges that are measured at one time.
MAX_RANGE_PARTS = 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxErrors(Result):
    """Contour errors of one contour on the robots of a box.

    Args:
        bound: Bound of the distance from the tool to the path for all robots of the box [m].
        max: Largest contour error of each executed robot, of both directions [m], (n,).
        names: Names of the uncertain parameters.
        deviations: Errors of these parameters (relative, or in s), (n, len(names)).
        robots: Parameter errors of the robots, (n, 3 dof), as for `servo_with`.
        demand: Largest ratio of a commanded acceleration to its limit on each robot, (n,).
    """

    bound: float
    max: FloatArray
    names: tuple[str, ...]
    deviations: FloatArray
    robots: FloatArray
    demand: FloatArray

    @property
    def largest(self) -> float:
        """The larger of the proven bound and the largest simulated error [m].

        The error can be larger than the bound if parts of the path are missed.
        """
        return max(self.bound, float(self.max.max()))

    def to_data(self) -> Data:
        """Return data of the bound, and of the parameters of the worst robot."""
        errors = self.deviations[int(np.argmax(self.max))].tolist()
        worst = dict(zip(self.names, errors, strict=True))
        named = sorted(worst, key=lambda x: -abs(worst[x]))[:MAX_NAMED_PARAMETERS]
        robot = ", ".join(f"{x} {worst[x]:+.3g}" for x in named)
        return Data(
            "Robots of the box",
            (
                Row("bound", self.bound, "m", "contour error, guaranteed for all", "", VERDICT),
                Row("max", self.max.max(), "m", "worst robot found", robot, VERDICT),
                Row("executions", len(self.max)),
                Row("worst", worst),
            ),
        )

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointRanges:
    """Ranges of the joint positions over the robots of a box, at n times.

    Args:
        template: An execution at these times, whose positions are replaced.
        low, high: Ends of the ranges over the corners of the box [rad], (n, dof).
        low_at, high_at: Indices in `corners` of the robots that are at these ends, (n, dof).
        corners: Errors of the parameters in the corners, the same for all joints or in proportion,
            (m, 3, dof).
        beyond: Bound of the positions beyond these ends, inside of the box [rad], (n, dof).
    """

    template: Execution
    low: FloatArray
    high: FloatArray
    low_at: IntArray
    high_at: IntArray
    corners: FloatArray
    beyond: FloatArray

    @classmethod
    def over(
        cls, runs: Sequence[Execution], corners: FloatArray, beyond: FloatArray | None = None
    ) -> JointRanges:
        """Determine the ranges over executions in the corners of a box, (m,)."""
        q = join_positions(runs)
        template = max(runs, key=lambda x: len(x.t))
        return cls(
            template=template,
            low=q.min(axis=0),
            high=q.max(axis=0),
            low_at=q.argmin(axis=0),
            high_at=q.argmax(axis=0),
            corners=corners,
            beyond=np.zeros(q.shape[1:]) if beyond is None else beyond,
        )

    def ends(self) -> BoolArray:
        """Combine both ends of all joints that have a range, (2^k, dof); True for the high end."""
        return combine_ends(np.asarray((self.high > self.low).any(axis=0)))

    def extreme_motions(self) -> Iterator[tuple[BoolArray, Execution]]:
        """Yield the motions in which each joint is at the same end of its range at all times."""
        zeros = np.zeros_like(self.low)
        for is_high in self.ends():
            q = np.where(is_high, self.high, self.low)
            speed = np.gradient(q, self.template.t, axis=0)
            yield (
                is_high,
                replace(self.template, q=q, dq=speed, ddq=zeros, demand=zeros, plant=None),
            )

    def robot_at(self, i: int, is_high: BoolArray) -> FloatArray:
        """Return the parameter errors of the robot that is at these ends at time i, (3, dof).

        - `i`: index of the time.
        - `is_high`: True for joints at the high ends of their ranges, (dof,).
        """
        corner = np.where(is_high, self.high_at[i], self.low_at[i])
        return np.asarray(self.corners[corner, :, np.arange(len(corner))].T)


def combine_ends(has_range: BoolArray) -> BoolArray:
    """Combine both ends of k joints that have a range, (2^k, dof); True for the high end.

    - `has_range`: True for the k joints, (dof,).
    """
    combinations = list(product((False, True), repeat=int(has_range.sum())))
    ends = np.zeros((len(combinations), len(has_range)), dtype=np.bool_)
    ends[:, has_range] = combinations
    return ends


def join_positions(runs: Sequence[Execution]) -> FloatArray:
    """Join the joint positions of m executions, until the last one rests [rad], (m, n, dof)."""
    count = max(len(x.t) for x in runs)
    return np.stack([np.pad(x.q, ((0, count - len(x.t)), (0, 0)), mode="edge") for x in runs])


def independent_half_widths(case: Case) -> FloatArray:
    """Return the largest parameter errors that differ from joint to joint, (3, dof).

    A part of the dead time that all joints share only delays the motion, and changes no contour. If
    the errors of the dead times are shared, only the differences of their ranges remain.
    """
    assert case.goal.box is not None
    half_widths = case.goal.box.half_widths(case.servo, case.arm.dof)
    if case.goal.box.dead_time_shared:
        dead_time = half_widths[2]
        common = (dead_time.min() + dead_time.max()) / 2
        half_widths[2] = np.abs(dead_time - common)
    return half_widths


def same_corner_robots(half_widths: FloatArray) -> FloatArray:
    """Return the errors of the robots whose joints are in the same corner of the box, (m, 3, dof).

    These robots have the largest demand of each joint, because joints are independent.
    """
    levels = [(-1.0, 1.0) if row.any() else (0.0,) for row in half_widths]
    return np.array(list(product(*levels)))[:, :, None] * half_widths


def servo_with(servo: ServoModel, deviations: FloatArray) -> ServoModel:
    """Return the servo with errors of its parameters.

    - `deviations`: relative errors of kp and kv, and errors of the dead time [s], (3, dof) or
      (3 dof,).
    """
    kp, kv, dead_time = deviations.reshape(3, -1)
    return servo.replace(
        kp=servo.kp * (1 + kp),
        kv=None if servo.kv is None else servo.kv * (1 + kv),
        dead_time=np.maximum(servo.dead_time + dead_time, 0.0),
    )


def bound_box(case: Case, set_points: SetPoints) -> list[BoxErrors]:
    """Bound the errors of a program on all robots of a box, and execute the worst robots.

    Returns the errors of each contour; an empty list without a box.
    """
    if case.goal.box is None:
        return []
    case.progress(Step(("robots of the box",)))
    ranges = find_joint_ranges(case, set_points)
    bounds, worst = _bound_contours(case, ranges)
    robots = np.unique([y for x in worst for y in _robots_near(case, x)], axis=0)
    results = map_in_threads(partial(_execute_robot, case, set_points), list(robots))
    *errors, demand = np.array(results).T
    varies = case.goal.box.half_widths(case.servo, case.arm.dof) > 0
    names = np.array([[f"{x} of joint {j + 1}" for j in range(case.arm.dof)] for x in PARAMETERS])
    if case.goal.box.dead_time_shared:
        varies[2, 1:] = False
        names[2] = "dead time"
    return [
        BoxErrors(
            bound=bound,
            max=error,
            names=tuple(names[varies].tolist()),
            deviations=robots[:, varies.ravel()],
            robots=robots,
            demand=demand,
        )
        for bound, error in zip(bounds, errors, strict=True)
    ]


def find_joint_ranges(case: Case, set_points: SetPoints) -> JointRanges:
    """Execute a program on robots at three values of each parameter, and find the joint ranges."""
    half_widths = independent_half_widths(case)
    levels = [(-1.0, 0.0, 1.0) if row.any() else (0.0,) for row in half_widths]
    units = np.array(list(product(*levels)))
    deviations = units[:, :, None] * half_widths
    servos = [case.plant(servo_with(case.servo, x)) for x in deviations]
    step = min(RANGE_STEP, set_points.cycle)
    runs = map_in_threads(partial(simulate, set_points, resolution=step), servos)
    q = join_positions(runs)
    beyond = _beyond_corners(q.reshape(*map(len, levels), *q.shape[1:]))
    varies = [len(x) > 1 for x in levels]
    corner = (units[:, varies] != 0).all(axis=1)
    corner_runs = [runs[k] for k in np.flatnonzero(corner)]
    return JointRanges.over(corner_runs, deviations[corner], beyond)


def slow_motion_caps(case: Case, joint_path: JointPath, cells: FloatArray) -> FloatArray:
    """Return the largest ds² at which slow motion keeps the budget on all robots [m²/s²], (cells,).

    In slow motion, joint j of a robot deviates from that of the nominal robot by
    `-q_j'(s) v (lag_j - nominal lag_j)`, with the lag `(1 - feed-forward) / kp + dead time` [s]. So
    the largest distance across the path over all lags of the box is proportional to the path speed
    v. A first plan within these caps is close to the last one. An estimate: faster motion differs.

    - `cells`: arc lengths of the ends of the cells [m], (n + 1,).
    """
    path = joint_path.tool_path
    if path is None or not case.run.compensation.compensates:
        return np.full(len(cells) - 1, np.inf)
    kp, _, dead_time = independent_half_widths(case)
    servo = case.servo
    lag = np.where(servo.ki > 0, 0.0, (1 - servo.velocity_feedforward) / servo.kp)
    longest = lag / (1 - kp) - lag + dead_time
    shortest = lag / (1 + kp) - lag - dead_time
    tangent = path(cells, 1)
    jacobian = case.arm.tool_jacobian(joint_path(cells))
    along = np.einsum("nd,ndj->nj", tangent, jacobian)
    across = jacobian - tangent[:, :, None] * along[:, None]
    across_rate = across * joint_path(cells, 1)[:, None]  # Across the path, per joint and lag
    largest = np.zeros(len(cells))
    for is_long in combine_ends(longest > shortest):
        largest = np.maximum(largest, length(across_rate @ np.where(is_long, longest, shortest)))
    rate = np.maximum(largest[:-1], largest[1:])
    with np.errstate(divide="ignore"):
        return np.asarray((case.budget / rate) ** 2)


def _robots_near(case: Case, deviations: FloatArray) -> Iterator[FloatArray]:
    """Yield the errors of robots of the box that have these errors of the gains, (3 dof,).

    - `deviations`: errors of the parameters, (3, dof).
    """
    assert case.goal.box is not None
    if not case.goal.box.dead_time_shared:
        yield deviations.ravel()
        return
    # The dead times of all joints have one error, in proportion to their ranges.
    dead_time = case.goal.box.half_widths(case.servo, case.arm.dof)[2]
    for sign in (-1.0, 1.0):
        yield np.concatenate([deviations[0], deviations[1], sign * dead_time])


def _execute_robot(case: Case, set_points: SetPoints, deviations: FloatArray) -> list[float]:
    """Return a robot's largest error on each contour, of both directions [m], and its demand."""
    plant = case.plant(servo_with(case.servo, deviations))
    resolution = min(RESULT_STEP, set_points.cycle)
    executed = simulate(set_points, plant, resolution=resolution)
    pieces = split_by_contour(executed, case.program, None, None)
    demand = float(case.demand_ratio(executed.demand_range).max())
    return [*(max(x.contour_error.max, x.coverage_error.max) for x in pieces), demand]


def _beyond_corners(q: FloatArray) -> FloatArray:
    """Bound how far positions inside a box exceed the range at its corners [rad], (n, dof).

    `q`: positions at three values of each uncertain parameter, (3, 3, 3, n, dof); 1 in place of 3
    for a parameter that is certain.

    A function f on [-1, 1] with |f''| <= M and the mean slope s exceeds the larger of its ends by
    at most (M - |s|)² / (2 M) if |s| < M, and does not exceed it otherwise. M is the second
    difference, times a margin.
    """
    total = np.zeros(q.shape[-2:])
    for axis in range(3):
        if q.shape[axis] == 1:
            continue
        low, middle, high = np.moveaxis(q, axis, 0)
        others = (0, 1)
        slope = (high - low) / 2
        bend = CURVATURE_MARGIN * np.abs(low - 2 * middle + high).max(axis=others)
        same_sign = (slope > 0).all(axis=others) | (slope < 0).all(axis=others)
        steepness = np.where(same_sign, np.abs(slope).min(axis=others), 0.0)
        total += np.maximum(bend - steepness, 0.0) ** 2 / (2 * np.maximum(bend, 1e-300))
    return total


class _Largest:
    """Largest distances of the extreme motions from one contour, at its n samples."""

    def __init__(self, piece: ContourExecution) -> None:
        n = len(piece.t)
        self.piece = piece
        self.distance = np.zeros(n)  # Largest distance at each time [m]
        self.sagitta = np.zeros(n)  # Largest excess between this sample and its neighbours [m]
        self.end = np.zeros((n, piece.q.shape[1]), dtype=np.bool_)  # Ends of the largest distance
        # Smallest and largest arc length of the path points at each time [m]
        self.s_low = np.full(n, np.inf)
        self.s_high = np.full(n, -np.inf)

    def add(self, is_high: BoolArray, piece: ContourExecution) -> None:
        """Take the distances of one more extreme motion into account."""
        followed = piece.followed
        larger = followed.distance > self.distance
        self.end[larger] = is_high
        np.maximum(self.distance, followed.distance, out=self.distance)
        np.minimum(self.s_low, followed.s, out=self.s_low)
        np.maximum(self.s_high, followed.s, out=self.s_high)
        if len(self.distance) > 2:
            bent = np.pad(np.abs(np.diff(followed.distance, 2)) / 8, 1, mode="edge")
            neighbours = np.maximum(np.append(bent[1:], 0.0), np.append(0.0, bent[:-1]))
            np.maximum(self.sagitta, np.maximum(bent, neighbours), out=self.sagitta)


def _bound_contours(case: Case, ranges: JointRanges) -> tuple[list[float], list[FloatArray]]:
    """Return bounds of the distances from all contours [m], and their worst robots, (3, dof)."""
    contours: list[_Largest] = []
    delay = _shared_delay(case)
    for is_high, motion in ranges.extreme_motions():
        pieces = [_widened(x, delay) for x in split_by_contour(motion, case.program, None, None)]
        if not contours:
            contours = [_Largest(x) for x in pieces]
        for largest, piece in zip(contours, pieces, strict=True):
            largest.add(is_high, piece)
    bounds = [_bound_contour(case.arm, ranges, x) for x in contours]
    robots = [*ranges.corners]
    for x in contours:
        # The worst times of different combinations of ends.
        order = np.argsort(-x.distance)
        _, worst_of_each = np.unique(x.end[order], axis=0, return_index=True)
        for i in order[np.sort(worst_of_each)[:EXECUTED]].tolist():
            robots.append(ranges.robot_at(x.piece.samples.start + i, x.end[i]))
    return bounds, robots


def _shared_delay(case: Case) -> float:
    """Return the largest delay that all joints share, before or after the nominal motion [s]."""
    box = case.goal.box
    if box is None or not box.dead_time_shared:
        return 0.0
    return float(box.half_widths(case.servo, case.arm.dof)[2].max())


def _widened(piece: ContourExecution, delay: float) -> ContourExecution:
    """Widen a contour to the samples up to a delay [s] before and after the process."""
    if delay == 0.0:
        return piece
    t = piece.executed.t
    steps = int(np.ceil(delay / (t[1] - t[0])))
    stop = min(piece.samples.stop + steps, len(t))
    samples = slice(max(piece.samples.start - steps, 0), stop)
    return replace(piece, samples=samples, next_start=max(piece.next_start, stop))


def _bound_contour(arm: Arm, ranges: JointRanges, largest: _Largest) -> float:
    """Bound the distance from the tool to one contour for all robots of the box [m]."""
    piece = largest.piece
    low = ranges.low[piece.samples]
    high = ranges.high[piece.samples]
    middle = (low + high) / 2
    jacobian = arm.tool_jacobian(middle)
    lever = np.linalg.norm(jacobian, axis=1)
    revolute = ~np.array(arm.chain.prismatic or [False] * arm.dof)
    half = (high - low) / 2
    chords = (np.where(revolute, lever, 0.0) * half**2).sum(axis=1) / 2
    # The Jacobian differs by up to this factor within the ranges.
    spread = 1 + half.sum(axis=1)
    beyond = (lever * ranges.beyond[piece.samples]).sum(axis=1)
    others = largest.sagitta + spread * (chords + beyond)
    corner_distance = largest.distance + others
    bends = _Bends(piece.followed)
    bound = corner_distance + bends.excess(largest.s_low, largest.s_high)
    best = float(corner_distance.max())
    is_critical = bound > best * (1 + CLOSE_BOUND)
    critical = np.flatnonzero(is_critical)
    critical = critical[np.argsort(-corner_distance[critical])]
    divided = _Division(arm, piece, bends, others).bound(low, high, critical, best)
    return max(divided, float(bound[~is_critical].max(initial=0.0)))


class _Bends:
    """Curvature and turns of a path, by which the distance from it is not convex."""

    def __init__(self, followed: Followed) -> None:
        rows = followed.geometry
        self.begins = rows[:, 11]  # Arc lengths at which the segments begin [m]
        self.curvature = np.append(np.abs(rows[:, 9]), 0.0)  # [1/m]; 0 after the last segment
        angle = (rows[:, 9] * rows[:, 10])[:, None]
        leaving = np.cos(angle) * rows[:, 3:6] + np.sin(angle) * rows[:, 6:9]
        turn = 2 * np.arcsin(np.minimum(length(leaving[:-1] - rows[1:, 3:6]) / 2, 1.0))
        # Sum of the turns at joints before each segment [rad]
        self.turned = np.concatenate([[0.0], np.cumsum(turn)])

    def excess(self, s_low: FloatArray, s_high: FloatArray) -> FloatArray:
        """Bound how far n products exceed the distances at their corners [m], (n,).

        The path points of the corners are between s_low and s_high [m], (n,). For a mean of
        corners, the path at the mean arc length differs from the mean of the path points by at most
        `curvature A² / 2 + turn A / 2`, with A = (s_high - s_low) / 2, the largest curvature
        between them, and the sum of the turns at joints of segments between them.
        """
        first_segment = np.maximum(np.searchsorted(self.begins, s_low, side="right") - 1, 0)
        last_segment = np.searchsorted(self.begins, s_high, side="right") - 1
        last_segment = np.maximum(last_segment, first_segment)
        ranges = np.stack([first_segment, last_segment + 1], axis=1).ravel()
        curvature = np.maximum.reduceat(self.curvature, ranges)[::2]
        half = (s_high - s_low) / 2
        turn = self.turned[last_segment] - self.turned[first_segment]
        return np.asarray(half * (curvature * half + turn) / 2)


class _Division:
    """Bound of the distance over products of joint ranges, which are divided until it is close."""

    def __init__(
        self, arm: Arm, piece: ContourExecution, bends: _Bends, others: FloatArray
    ) -> None:
        self.arm = arm
        self.piece = piece
        self.bends = bends
        self.others = others  # Parts of the bound that do not depend on the division [m], (n,)

    def bound(self, low: FloatArray, high: FloatArray, times: IntArray, best: float) -> float:
        """Bound the distances at some times [m].

        - `low`, `high`: joint ranges at all times [rad], (n, dof).
        - `times`: indices of the times, the most critical first.
        - `best`: the largest distance of a corner with the other parts of the bound [m].
        """
        largest = best
        for i in times.tolist():
            best, bound = self._bound_at(i, low[i], high[i], best)
            largest = max(largest, bound)
        return max(largest, best)

    def _bound_at(
        self, i: int, low: FloatArray, high: FloatArray, best: float
    ) -> tuple[float, float]:
        """Return the largest distance of a robot so far, and the bound at time index i [m].

        - `low`, `high`: joint ranges at this time [rad], (dof,).
        - `best`: the largest distance of a robot before [m].
        """
        bound = 0.0
        parts = [(low, high)]
        measured = 0
        while parts:
            remaining = []
            for part_low, part_high in parts:
                corner, part_bound = self._measure(i, part_low, part_high)
                best = max(best, corner)
                if part_bound <= best * (1 + CLOSE_BOUND):
                    bound = max(bound, part_bound)
                else:
                    remaining.append((part_low, part_high, part_bound))
            measured += len(parts)
            if measured > MAX_RANGE_PARTS:
                return best, max([bound, *(x[2] for x in remaining)])
            parts = []
            for part_low, part_high, _ in remaining:
                parts += self._halve(i, part_low, part_high)
        return best, bound

    def _measure(self, i: int, low: FloatArray, high: FloatArray) -> tuple[float, float]:
        """Return a product's largest corner distance, and the bound over the product [m]."""
        q = np.where(combine_ends(high > low), high, low)
        followed = self.piece.followed
        s = float(followed.s[i])
        tool = self.arm.tool_position(q)
        distance, arc_lengths = followed.near(tool, (s, s), float(followed.distance[i]))
        corner = float(distance.max())
        s_low = arc_lengths.min(keepdims=True)
        s_high = arc_lengths.max(keepdims=True)
        excess = float(self.bends.excess(s_low, s_high)[0])
        # The distance from one point of the path is convex: it is largest at a corner.
        foot = self.piece.path(float(arc_lengths[int(distance.argmax())]))
        from_foot = float(length(tool - foot).max())
        return corner + self.others[i], min(corner + excess, from_foot) + self.others[i]

    def _halve(
        self, i: int, low: FloatArray, high: FloatArray
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Divide a product along the joint that moves the tool farthest along the path."""
        middle = (low + high) / 2
        tangent = self.piece.path(float(self.piece.followed.s[i]), 1)
        along = np.abs(tangent @ self.arm.tool_jacobian(middle[None])[0]) * (high - low)
        j = int(along.argmax())
        lower_high = high.copy()
        lower_high[j] = middle[j]
        upper_low = low.copy()
        upper_low[j] = middle[j]
        return [(low, lower_high), (upper_low, high)]
