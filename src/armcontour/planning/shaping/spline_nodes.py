"""Nodes along the path of a start, and the largest offsets of control points from the nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.frames import perpendicular
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path, Tube
from armcontour.motion import JointPath
from armcontour.planning.shaping.shape_starts import Candidate
from armcontour.planning.tracing.knots import task_dimension
from armcontour.planning.tracing.parallel_joints import turn_as_tool
from armcontour.robot import Arm, PlanarTwoLink, SerialArm

# Distance between nodes at a 90° corner, divided by the tolerance.
AT_CORNER = 0.045
# Relative growth of the distance between nodes per node, away from a corner or rest.
NODE_GROWTH = 0.12
# A corner that turns by less than this [rad] has no node of its own if it is also close to another
# corner (DENSE), because it is taken as a vertex between chords of a curve.
SHALLOW = 0.15
# Distance from another corner, divided by the tolerance, below which a shallow corner has no node.
DENSE = 4.0
# Factor of the distance between nodes next to a rest.
REST_DISTANCE_FACTOR = 0.12
# Largest distance of the polygon of control points from its curve, divided by the tolerance.
SAG = 0.03
# Largest distance between nodes, divided by the radius of the tool path at constant joint
# velocities
LONGEST_NODE_DISTANCE = 0.027
# Approximate smallest number of nodes between two rests.
FEWEST_NODES = 64
# Relative growth between samples below which the logarithm is replaced by its series.
EVEN = 1e-5
# Largest average number of nodes per stretch. The distance between nodes is proportional to the
# square root of the tolerance, so small tolerances make iterations slow.
MAX_NODES = 4000
# Number of samples of the distance between nodes between two marks, before nodes are placed.
DISTANCE_SAMPLES = 32
# Number of samples of the distance between nodes per node, once their number is estimated.
PER_NODE = 8
# Largest offset, divided by the tolerance.
LARGEST_OFFSET = 2.5
# Step of the search for the largest offset, as a fraction of the tolerance.
SEARCH_STEP = 1 / 24
# Number of bisections of the last step of this search.
STEP_BISECTIONS = 24
# Fraction of the tolerance that offsets must not use
UNUSED_TOLERANCE = 1e-3
# Arc lengths closer than this are equal [m].
SAME_ARC_LENGTH = 1e-9
# A node matches points of the objective within this number of tolerances plus twice the larger
# distance to its neighbours.
MATCH_REACH = 3.0
# Number of directions of the bounds of offsets in space.
OFFSET_DIRECTIONS = 12
# All nodes
EVERY = slice(None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearPath:
    """Inverse kinematics at n points near a joint path."""

    arm: Arm
    configuration: str | None  # For an arm in the plane, the branch of its inverse kinematics
    q: FloatArray  # Joint positions at the points on the joint path [rad], (n, dof)
    # Tool poses at the points, (n, 3, 4); `solve` replaces their positions. None in the plane.
    poses: FloatArray | None = None
    task: int = 2  # Number of prescribed degrees of freedom of the tool
    # Null-space rows w of a redundant arm, (n, dof - task, dof); solutions have the same `w q` as
    # the joint path.
    free: FloatArray | None = None

    @classmethod
    def along(
        cls, q: FloatArray, arm: Arm, configuration: str | None, path: Path, s: FloatArray
    ) -> NearPath:
        """Prepare inverse kinematics near joint positions q [rad], (n, dof), at s of a path [m]."""
        if isinstance(arm, PlanarTwoLink):
            return cls(arm=arm, configuration=configuration, q=q)
        assert isinstance(arm, SerialArm)
        poses = np.zeros((len(s), 3, 4))
        poses[:, :, 3] = arm.tool_position(q)
        task = task_dimension(path, arm)
        turned = turn_as_tool(path, arm).orientation
        poses[:, :, :3] = np.eye(3) if turned is None else turned(s)
        free = np.zeros((len(s), 0, arm.dof))
        if task < arm.dof:
            from armcontour.planning.tracing.smoothing import null_space

            free = null_space(arm, poses, task, q)
        return cls(arm=arm, configuration=configuration, q=q, poses=poses, task=task, free=free)

    def part(self, nodes: slice) -> NearPath:
        """Return the inverse kinematics at a part of the points."""
        return replace(
            self,
            q=self.q[nodes],
            poses=None if self.poses is None else self.poses[nodes],
            free=None if self.free is None else self.free[nodes],
        )

    def solve(self, points: FloatArray, guess: FloatArray) -> FloatArray:
        """Return joint positions with the tool at `points` [m], near a guess [rad], (n, dof)."""
        if isinstance(self.arm, PlanarTwoLink):
            q = self.arm.joint_position(points, self.configuration)
            return np.asarray(q + 2 * np.pi * np.round((guess - q) / (2 * np.pi)))
        assert isinstance(self.arm, SerialArm) and self.poses is not None
        assert self.free is not None
        from armcontour.robot import pose_solver

        poses = np.array(self.poses)
        poses[:, :, 3] = points
        q = np.array(guess, order="C")
        solved = pose_solver.solve_poses(
            self.arm.link_table, self.task, q, poses, self.free[:, None], self.q[:, None]
        )
        if not solved.all():
            i = int(np.argmin(solved))
            raise Unreachable("A control point is out of reach.", point=points[i].tolist())
        return q

    def steps(self, q: FloatArray, frames: FloatArray) -> FloatArray:
        """Return the derivatives of q by offsets along columns of `frames` [rad/m], (n, dof, k)."""
        if self.poses is None:
            return np.asarray(np.linalg.solve(self.arm.tool_jacobian(q), frames))
        assert isinstance(self.arm, SerialArm) and self.free is not None
        n = len(q)
        dof = self.arm.dof
        k = frames.shape[2]
        full = self.arm.jacobian(q)
        matrix = np.empty((n, dof, dof))
        matrix[:, :3] = full[:, :3]
        if self.task == 6:
            matrix[:, 3:6] = full[:, 3:]
        elif self.task == 4:
            # The revolute joints turn about one direction.
            revolute = np.flatnonzero(~self.arm.chain.slides)[0]
            axis = full[:, 3:, revolute]
            matrix[:, 3] = np.einsum("ni,nik->nk", axis, full[:, 3:])
        elif self.task == 5:
            axes = self.poses[:, :, :2]
            matrix[:, 3:5] = np.einsum("nij,nik->njk", axes, full[:, 3:])
        matrix[:, self.task :] = self.free
        right = np.zeros((n, dof, k))
        right[:, :3] = frames
        return np.asarray(np.linalg.solve(matrix, right))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nodes:
    """The n nodes along a start's path, one for each control point of the joint spline."""

    s_objective: FloatArray  # Arc lengths on the objective [m], (n,)
    points: FloatArray  # Points on the path of the start [m], (n, dimension)
    frames: FloatArray  # Directions of the offsets as columns, (n, dimension, k)
    sides: FloatArray  # Directions of the bounds in the coordinates of the offsets, (m, k)
    # Largest distance of the curve from the polygon of the control points [m], (n,)
    sag: FloatArray
    tolerance: FloatArray  # Tolerance at each node [m], (n,)
    # Smallest tolerance of each node and its neighbours, because neighbouring control points shape
    # the curve together [m], (n,)
    smallest: FloatArray
    reach: FloatArray  # Distance along the objective within which each node matches [m], (n,)
    fixed: BoolArray  # True if the control point stays on the path of the start, (n,)
    # True if the joints rest at a knot before, between or after the spans, (n + 1,)
    rest: BoolArray
    # Index, among the corners of the tube, of the corner that each node must stay close to; -1 for
    # none
    vertex: IntArray
    group: IntArray  # Index of the corner or rest nearest to each node, ascending, (n,)
    # Times at which the motion of the start passes the knots, halfway between nodes [s], (n + 1,)
    times: FloatArray
    near: NearPath
    q: FloatArray  # Joint positions at the nodes [rad], (n, dof)

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.s_objective)

    def bounds(self, tube: Tube, inside: FloatArray, nodes: IntArray | slice = EVERY) -> FloatArray:
        """Return the largest offsets in each direction of `sides` [m], (m, directions).

        - `inside`: fraction of the tolerance that offsets must not use, (n,).
        - `nodes`: the m nodes, by default all.
        """
        windows = self._windows(tube, nodes)
        smallest = self.smallest[nodes]
        tolerance = self.tolerance[nodes]
        spare = inside[nodes] * smallest + np.minimum(self.sag[nodes], 0.3 * smallest)
        margin = spare + tolerance - smallest
        vertex = self.vertex[nodes]
        corners = tube.objective.vertices[np.append(tube.vertex, 0)[vertex]]
        allowed = np.where(
            vertex >= 0, np.append(tube.vertex_tolerance, 0.0)[vertex] - spare, np.inf
        )
        nodes_at = self.points[nodes]

        def is_inside(offset: FloatArray, direction: FloatArray) -> BoolArray:
            points = nodes_at + offset[:, None] * direction
            deviation = np.linalg.norm(points - corners, axis=1)
            return np.asarray((tube.margin(points, windows) >= margin) & (deviation <= allowed))

        offsets = np.zeros((len(tolerance), len(self.sides)))
        # The bounds form an inscribed polygon, because the tube is not evaluated between the
        # directions of the sides.
        share = np.cos(np.pi / len(self.sides)) if self.sides.shape[1] > 1 else 1.0
        for j, side in enumerate(self.sides):
            direction = self.frames[nodes] @ side
            offsets[:, j] = share * _farthest(is_inside, direction, tolerance)
        offsets[self.fixed[nodes]] = 0.0
        return offsets

    def _windows(self, tube: Tube, nodes: IntArray | slice) -> IntArray:
        """Return the first and last piece of the tube that each of m nodes may match, (m, 2)."""
        # Matches stay between two corners. A node at a corner may match the pieces on both sides.
        s = self.s_objective[nodes]
        reach = self.reach[nodes]
        ends = tube.objective.breaks[tube.vertex]
        corners = np.concatenate([[-np.inf], ends, [np.inf]])
        low = corners[np.searchsorted(ends, s - SAME_ARC_LENGTH, side="right")]
        high = corners[np.searchsorted(ends, s + SAME_ARC_LENGTH, side="left") + 1]
        low = np.maximum(s - reach, low + SAME_ARC_LENGTH)
        high = np.minimum(s + reach, high - SAME_ARC_LENGTH)
        return tube.windows_between(low, high)


def _farthest(
    is_inside: Callable[[FloatArray, FloatArray], BoolArray],
    direction: FloatArray,
    tolerance: FloatArray,
) -> FloatArray:
    """Find the largest offsets along directions up to which all offsets are inside [m], (n,).

    - `is_inside`: mask, (n,), of offsets [m], (n,), along directions, (n, dimension).
    """
    low = np.zeros(len(tolerance))
    inside = np.ones(len(tolerance), dtype=bool)
    for share in np.arange(SEARCH_STEP, LARGEST_OFFSET, SEARCH_STEP):
        inside &= is_inside(share * tolerance, direction)
        if not inside.any():
            break
        low = np.where(inside, share * tolerance, low)
    high = low + SEARCH_STEP * tolerance
    for _ in range(STEP_BISECTIONS):
        middle = (low + high) / 2
        good = is_inside(middle, direction)
        low = np.where(good, middle, low)
        high = np.where(good, high, middle)
    return low


def place_nodes(start: Candidate, tube: Tube, arm: Arm, configuration: str | None) -> Nodes | None:
    """Place nodes along the path of a start, dense at corners and rests; None if too many."""
    path = start.path
    matches = start.places
    joint_path = start.joint_path
    marks = _Marks.from_path(path, matches, tube)
    spread = _distribute_nodes(start, arm, tube, marks)
    if spread is None:
        return None
    s, index = spread
    # At a rest between two stretches there are two nodes.
    row = np.repeat(np.arange(len(s)), 1 + np.isin(index, np.flatnonzero(marks.rest)[1:-1]))
    doubled = np.concatenate([[False], row[1:] == row[:-1], [False]])
    s = s[row]
    mark = np.where(doubled[1:], -1, index[row])
    corner = np.where(mark >= 0, marks.corner[mark], -1)
    s_objective = np.interp(s, matches[:, 1], matches[:, 0])
    s_objective[corner >= 0] = tube.objective.breaks[tube.vertex[corner[corner >= 0]]]
    tolerance = _tolerance_at(tube, s_objective)
    resting = np.isin(index[row], np.flatnonzero(marks.rest))
    gap = np.diff(s)
    wide = np.maximum(np.append(0.0, gap), np.append(gap, 0.0))
    tangents = path(s, 1)
    return Nodes(
        s_objective=s_objective,
        points=path(s),
        frames=_frames(tangents),
        sides=_sides(tangents.shape[1] - 1),
        # On a line, the curve is in the hull of its control points, except for the curvature of the
        # tool path at constant joint velocities.
        sag=wide**2 * _tool_curvature(joint_path, arm, s) / 8,
        tolerance=tolerance,
        smallest=_smallest_of_neighbours(tolerance),
        reach=MATCH_REACH * tolerance + 2 * wide,
        fixed=resting | (tolerance == 0),
        rest=doubled | np.isin(np.arange(len(s) + 1), [0, len(s)]),
        vertex=np.where(resting, -1, _adjacent_corners(corner)),
        group=np.searchsorted((marks.s[1:] + marks.s[:-1]) / 2, s),
        times=start.trajectory.time_at(np.concatenate([s[:1], (s[1:] + s[:-1]) / 2, s[-1:]])),
        near=NearPath.along(joint_path(s), arm, configuration, path, s),
        q=joint_path(s),
    )


@dataclass(frozen=True, slots=True)
class _Marks:
    """The m rests and corners of a start's path."""

    s: FloatArray  # Arc lengths on the path of the start, ascending [m], (m,)
    rest: BoolArray  # True at rests, (m,)
    corner: IntArray  # Index of the corner in the tube; -1 for rests, (m,)
    first: FloatArray  # Distance to the adjacent nodes [m], (m,); not used at rests

    @classmethod
    def from_path(cls, path: Path, matches: FloatArray, tube: Tube) -> _Marks:
        """Make the marks at the rests of a path, and at the other corners of its tube.

        A corner has no mark if it turns little and is close to the next corner.
        """
        s_corners = np.interp(tube.objective.breaks[tube.vertex], matches[:, 0], matches[:, 1])
        stops = np.concatenate([[0.0], path.stops, [path.length]])
        turns = tube.objective.turns[tube.vertex - 1]
        gaps = np.diff(np.concatenate([[0.0], s_corners, [path.length]]))
        tolerances = _tolerance_at(tube, tube.objective.breaks[tube.vertex])
        dense = (turns < SHALLOW) & (np.minimum(gaps[1:], gaps[:-1]) < DENSE * tolerances)
        corner = np.flatnonzero(~_equals_any(s_corners, stops) & ~dense)
        marks = np.concatenate([stops, s_corners[corner]])
        order = np.argsort(marks, kind="stable")
        corner_index = np.concatenate([np.full(len(stops), -1), corner])[order]
        # The index -1 of rests selects the appended turn of 0.
        half = np.append(turns, 0.0)[corner_index] / 2
        tolerances = _tolerance_at(tube, np.interp(marks[order], matches[:, 1], matches[:, 0]))
        first = AT_CORNER * tolerances / np.maximum(np.sin(half), 1e-6)
        return cls(marks[order], order < len(stops), corner_index, first)


def _adjacent_corners(corner: IntArray) -> IntArray:
    """Return the index of the corner at or next to each node, (n,); -1 for none."""
    nearest = corner.copy()
    indices = np.flatnonzero(corner >= 0)
    for side in (np.maximum(indices - 1, 0), np.minimum(indices + 1, len(corner) - 1)):
        free = nearest[side] < 0
        nearest[side[free]] = corner[indices[free]]
    return nearest


def _smallest_of_neighbours(values: FloatArray) -> FloatArray:
    """Return the smallest value of each node and its two neighbours, (n,)."""
    smallest = values.copy()
    smallest[1:] = np.minimum(smallest[1:], values[:-1])
    smallest[:-1] = np.minimum(smallest[:-1], values[1:])
    return smallest


def _equals_any(s: FloatArray, others: FloatArray) -> BoolArray:
    """Return the mask of arc lengths that are equal to one of `others`."""
    i = np.clip(np.searchsorted(others, s), 1, len(others) - 1)
    return np.asarray(np.minimum(np.abs(s - others[i - 1]), np.abs(s - others[i])) < 1e-9)


def _tolerance_at(tube: Tube, s_objective: FloatArray) -> FloatArray:
    """Return the tolerance at points of the objective [m], (n,); at a change, the smaller value."""
    last = len(tube) - 1
    before = np.clip(np.searchsorted(tube.breaks, s_objective, side="left") - 1, 0, last)
    after = np.clip(np.searchsorted(tube.breaks, s_objective, side="right") - 1, 0, last)
    return np.asarray(np.minimum(tube.tolerance[before], tube.tolerance[after]))


def _tool_curvature(joint_path: JointPath, arm: Arm, s: FloatArray) -> FloatArray:
    """Return the curvature of the tool path at constant joint velocities [1/m], (n,)."""
    slope = joint_path(s, 1)
    even = np.einsum("nij,nj->ni", arm.tool_jacobian_rate(joint_path(s), slope), slope)
    return np.asarray(np.linalg.norm(even, axis=1))


def _distribute_nodes(
    start: Candidate, arm: Arm, tube: Tube, marks: _Marks
) -> tuple[FloatArray, IntArray] | None:
    """Return the arc lengths of the nodes, and the mark at each node or -1; None if too many."""
    # From its value at a mark, the distance between nodes grows by the fraction NODE_GROWTH per
    # node.
    path = start.path
    matches = start.places
    joint_path = start.joint_path
    rests = marks.s[marks.rest]
    samples, _ = _divide(marks.s, marks.s, np.full(len(marks.s) - 1, DISTANCE_SAMPLES))
    median = max(float(np.median(_tool_curvature(joint_path, arm, samples))), 1e-3)
    for parts in (DISTANCE_SAMPLES, PER_NODE, PER_NODE, 0):
        tolerances = np.maximum(
            _tolerance_at(tube, np.interp(samples, matches[:, 1], matches[:, 0])), 1e-9
        )
        curvature = _tool_curvature(joint_path, arm, samples)
        curved = curvature + np.linalg.norm(path(samples, 2), axis=1)
        step = np.minimum(
            np.sqrt(8 * SAG * tolerances / np.maximum(curved, 1e-6)), LONGEST_NODE_DISTANCE / median
        )
        i = np.clip(np.searchsorted(rests, samples, side="right") - 1, 0, len(rests) - 2)
        step = np.minimum(step, np.diff(rests)[i] / FEWEST_NODES)
        k = np.searchsorted(samples, marks.s)
        step[k] = np.where(
            marks.rest, REST_DISTANCE_FACTOR * step[k], np.minimum(marks.first, step[k])
        )
        # The derivative of the distance between nodes in the arc length is at most NODE_GROWTH.
        step = NODE_GROWTH * samples + np.minimum.accumulate(step - NODE_GROWTH * samples)
        step = (
            np.minimum.accumulate((step + NODE_GROWTH * samples)[::-1])[::-1]
            - NODE_GROWTH * samples
        )
        # `total` is the number of nodes up to each sample, if the distance is linear between
        # samples.
        growth = np.diff(step) / step[:-1]
        safe = np.where(np.abs(growth) > EVEN, growth, 1.0)
        mean = np.where(np.abs(growth) > EVEN, np.log1p(safe) / safe, 1 - growth / 2)
        total = np.append(0.0, np.cumsum(mean / step[:-1] * np.diff(samples)))
        min_count = np.where(marks.rest[:-1] | marks.rest[1:], 3, 1)
        count = np.maximum(np.ceil(np.diff(total[k])), min_count).astype(np.intp)
        if count.sum() > MAX_NODES * len(count):
            return None
        if not parts:
            break
        # Samples follow the density of the nodes.
        samples, _ = _divide(
            total[k], marks.s, np.maximum(count * PER_NODE, parts), (total, samples)
        )
    s, mark = _divide(total[k], marks.s, count, (total, samples))
    return s, mark


def _divide(
    ends: FloatArray,
    marks: FloatArray,
    count: IntArray,
    along: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, IntArray]:
    """Divide the stretches between marks: return arc lengths [m], and the mark at each or -1.

    - `ends`: values at the marks, (m,). Each stretch is divided into `count` parts, (m - 1,), with
      equal steps of these values.
    - `along`: values and arc lengths, if the values are not arc lengths.
    """
    stretch, number = number_parts(count)
    value = ends[stretch] + np.diff(ends)[stretch] * number / count[stretch]
    s = value if along is None else np.interp(value, *along)
    s = np.append(np.where(number == 0, marks[stretch], s), marks[-1])
    return s, np.append(np.where(number == 0, stretch, -1), len(marks) - 1)


def _frames(tangents: FloatArray) -> FloatArray:
    """Return the directions normal to unit tangents as columns, (n, dimension, dimension - 1)."""
    if tangents.shape[1] == 2:
        return np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)[:, :, None]
    first = perpendicular(tangents)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(tangents, first)], axis=2)


def _sides(k: int) -> FloatArray:
    """Return unit vectors in k dimensions, k = 1 or 2, in which offsets are bounded, (m, k)."""
    if k == 1:
        return np.array([[1.0], [-1.0]])
    angle = 2 * np.pi * np.arange(OFFSET_DIRECTIONS) / OFFSET_DIRECTIONS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
