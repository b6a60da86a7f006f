"""Postures of an arm with external axes, chosen over a whole path by dynamic programming.

Near a pole, where an axis of a positioner is parallel to the tool axis, this axis is free, and the
rest of the path decides where it must be. Therefore a graph has the postures at some stations of
the path as nodes: a grid of positions of the external axes and of rotations about the tool axis,
with all configurations of the arm. The cheapest way through the graph is then smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.frames import exp
from armcontour.core.kernel_cache import compiled
from armcontour.planning.tracing.positioner_tilt import chord_of, tilt_of, turn_down
from armcontour.planning.tracing.posture_cost import (
    INNER_RANGE,
    RANGE_WEIGHT,
    middle_and_half,
    paces,
)
from armcontour.planning.tracing.refusals import Failure
from armcontour.planning.tracing.smoothing import move_to_poses
from armcontour.planning.tracing.stations import Stations
from armcontour.robot import SerialArm
from armcontour.robot.chain import FROM_FLOOR, joint_rows, link_poses
from armcontour.robot.closed_form_kinematics import ClosedForm
from armcontour.robot.inverse_kinematics import AXIS

# Number of joints of the arm on its external axes.
ARM_JOINTS = 6
# Steps between the stations of the graph, among all stations.
GRAPH_STRIDE = 4
# Step of the grid of the part's axis [rad], of other external axes that turn [rad], of axes that
# slide, as a fraction of the arm's length, and of the rotation about the tool axis [rad].
PART_STEP = np.radians(10)
TURN_STEP = np.radians(20)
SLIDE_STEP = 0.25
TOOL_STEP = np.radians(30)
# Largest number of tool poses in the graph, for all stations together; larger steps make fewer.
MAX_POSES = 80_000
# Factor of all steps, and of this number, in the second attempt.
FINER = 0.5
MORE_POSES = 4
# An axis whose range has at least this length [rad] has a periodic grid in the first attempt.
WHOLE_TURN = 2 * np.pi
# Ranges that are longer have a periodic grid in the second attempt as well [rad].
FEW_TURNS = 6 * np.pi
# Largest factor of the steps of axes that turn, and largest step of axes that slide, as a fraction
# of the arm's length, if there are too many tool poses.
WIDER = 3.0
WIDEST_SLIDE = 0.6
# Fraction of the positions of an axis that turns at which a limited tilt is possible, about.
TILTED_SHARE = 0.25
# Largest move of an external axis between stations: this angle [rad], these steps of its grid, and
# this multiple of the tool's rotation.
LARGEST_TURN = 0.45
LARGEST_STEPS = 2.0
ROTATION_SHARE = 1.5
# Largest move of an arm's joint between stations [rad].
LARGEST_MOVE = 1.2
# Fraction of the largest angle between tool axis and gravity that nodes may have.
TILT_SHARE = 0.98
# Cost of each second that a move takes longer than the tool's speed allows [1/s].
LATE = 1000.0
# Smallest sine of the angle between gravity and the axis that levels the tool.
LEVELING_SINE = 0.2


class Layer(NamedTuple):
    """Nodes at one station, sorted by their cells: positions of the external axes."""

    q: FloatArray  # Joint positions [rad], (nodes, dof)
    cost: FloatArray  # Cost of the node itself, (nodes,)
    branch: IntArray  # Configuration of the arm, (nodes,)
    cells: FloatArray  # Positions of the external axes in each cell [rad], (cells, external)
    starts: IntArray  # Index of the first node of each cell, and number of nodes, (cells + 1,)
    kept: BoolArray  # Mask of the cells among the given ones


@compiled()
def relax(
    q: FloatArray,
    own: FloatArray,
    starts: IntArray,
    before_q: FloatArray,
    before_cost: FloatArray,
    before_starts: IntArray,
    near: BoolArray,
    weights: FloatArray,
    wraps: BoolArray,
    largest: FloatArray,
    slowness: FloatArray,
    time: float,
    cost: FloatArray,
    back: IntArray,
) -> None:
    """Find the cheapest predecessor of every node of a layer.

    A move dq costs `sum(weights dq²) + LATE max(0, max(|dq| slowness) - time)`.

    - `q`: joint positions of the nodes [rad], (n, dof).
    - `own`: cost of each node, (n,).
    - `starts`: index of the first node of each cell, and n, (cells + 1,).
    - `before_q`, `before_cost`, `before_starts`: nodes of the layer before, the total costs up to
      them, and their cells.
    - `near`: whether a cell may follow each cell before, (cells, cells before).
    - `weights`: (dof,).
    - `wraps`: joints that are equal after a whole turn, (dof,).
    - `largest`: largest moves [rad], (dof,).
    - `slowness`: inverses of the largest velocities [s/rad], (dof,).
    - `time`: time that the tool takes between both stations [s].
    - `cost`: output, total costs up to the nodes, (n,); infinite without a predecessor.
    - `back`: output, indices of the predecessors, (n,); -1 without one.
    """
    dof = q.shape[1]
    turn = 2.0 * np.pi
    for cell in range(len(starts) - 1):
        for i in range(starts[cell], starts[cell + 1]):
            best = np.inf
            cost[i] = np.inf
            back[i] = -1
            for other in range(len(before_starts) - 1):
                if not near[cell, other]:
                    continue
                for k in range(before_starts[other], before_starts[other + 1]):
                    total = before_cost[k]
                    if total >= best:
                        continue
                    slowest = 0.0
                    for joint in range(dof - 1, -1, -1):
                        move = abs(q[i, joint] - before_q[k, joint])
                        if wraps[joint]:
                            move -= turn * np.floor(move / turn + 0.5)
                            move = abs(move)
                        if move > largest[joint]:
                            total = np.inf
                            break
                        total += weights[joint] * move * move
                        slowest = max(slowest, move * slowness[joint])
                    if slowest > time:
                        total += LATE * (slowest - time)
                    if total < best:
                        best = total
                        back[i] = k
            if back[i] >= 0:
                cost[i] = best + own[i]


@dataclass(frozen=True, slots=True, kw_only=True)
class Postures:
    """Result of the search: joint paths, or the places at which all ways end."""

    # Joint positions at the knots [rad], (knots, dof) each, the lowest cost first
    paths: list[FloatArray]
    failures: list[Failure]  # One for each attempt without a way; empty if there are joint paths


def has_graph(arm: SerialArm) -> bool:
    """Test whether the last six joints of an arm have a closed form, and no other axis turns it."""
    # If a joint of the arm is held, the last six joints can include an axis of the positioner.
    is_whole = arm.dof - arm.chain.floor_link >= ARM_JOINTS
    return is_whole and _closed_form(arm) is not None


def find_postures(
    arm: SerialArm,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    stations: Stations,
    starts: FloatArray | None,
) -> Postures:
    """Find joint paths along a tool path, each with another configuration at its end.

    - `s`: arc lengths of the knots [m], (n,).
    - `poses`: tool poses at the knots, (n, 3, 4).
    - `starts`: joint positions at which the joint paths start [rad], (k, dof); None if free.
    """
    last = len(stations.index) - 1
    places = np.unique(np.append(np.arange(0, last, GRAPH_STRIDE), last))
    chosen = stations.index[places]
    failures = []
    for step, share in ((1.0, 1.0), (FINER, MORE_POSES)):
        graph = _Graph(arm, s[chosen], poses[chosen], task, stations.measure[chosen], step, share)
        ends = graph.search(starts)
        if not ends:
            reached = int(chosen[graph.failure.reached])
            failures.append(replace(graph.failure, reached=reached))
            continue
        ways = np.array([graph.way_to(x) for x in ends])
        between = _interpolate(stations.measure[chosen], ways, stations.measure)
        moved, fits = move_to_poses(arm, poses, task, between)
        if fits.any():
            return Postures(paths=list(moved[fits]), failures=[])
    return Postures(paths=[], failures=failures)


def _interpolate(x: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate values, (paths, n, dof), at places `x`, (n,), by lines at places, (k,)."""
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    share = ((at - x[k]) / (x[k + 1] - x[k]))[:, None]
    return np.asarray(values[:, k] + share * (values[:, k + 1] - values[:, k]))


def _closed_form(arm: SerialArm) -> ClosedForm | None:
    """Return the closed form of the last six joints."""
    rows = joint_rows(arm.chain, np.arange(arm.dof - ARM_JOINTS, arm.dof))
    return ClosedForm.from_chain(arm.chain.replace(**rows, **FROM_FLOOR))


class _Graph:
    """Layers of postures at the stations of a path."""

    def __init__(
        self,
        arm: SerialArm,
        s: FloatArray,
        poses: FloatArray,
        task: int,
        place: FloatArray,
        step: float,
        share: float,
    ) -> None:
        # `step`: factor of the steps of the grid; `share`: factor of the largest number of poses.
        self.arm = arm
        self.s = s
        self.poses = poses
        self.place = place
        self.first = arm.dof - ARM_JOINTS
        closed_form = _closed_form(arm)
        assert closed_form is not None
        self.closed_form = closed_form
        self.lower, self.upper = arm.limits.joint_range(arm.dof)
        self.middle, self.half = middle_and_half(arm)
        whole = self.upper - self.lower >= WHOLE_TURN - 1e-9
        self.wraps = whole & ~arm.chain.slides
        if step < 1.0:
            # The second attempt knows how far an axis has turned.
            self.wraps[: self.first] &= (self.upper - self.lower > FEW_TURNS)[: self.first]
        self.level = self._leveling_axis()
        self.turns = self._tool_turns(step, task)
        self.steps = self._steps(step, share * MAX_POSES / len(s))
        self.layers: list[Layer] = []
        self.backs: list[IntArray] = []
        self.failure = Failure(reached=0, q=self.middle)

    def _leveling_axis(self) -> int | None:
        """Return the axis that turns the tool downwards, if others also turn the part."""
        # It is the one nearest to the floor that is not vertical.
        chain = self.arm.chain
        if tilt_of(chain) is None or chain.floor_link < 2:
            return None
        down, by_joint = turn_down(chain, np.zeros((1, chain.floor_link)))
        sines = np.linalg.norm(by_joint[0], axis=1)
        levels = np.flatnonzero(sines > LEVELING_SINE)
        return int(levels[-1]) if len(levels) else None

    def _steps(self, factor: float, most: float) -> FloatArray:
        """Return the steps of the grid of each external axis [rad or m], (external,)."""
        chain = self.arm.chain
        slides = chain.slides[: self.first]
        lengths = np.linalg.norm(chain.positions[self.first + 1 :], axis=1).sum()
        steps = np.where(slides, SLIDE_STEP * lengths, TURN_STEP) * factor
        if chain.floor_link and not slides[0]:
            steps[0] = PART_STEP * factor
        widest = np.where(slides, WIDEST_SLIDE * lengths, WIDER * steps)
        tools = float(len(self.turns))
        if tilt_of(chain) is not None:
            tools *= TILTED_SHARE
        while (steps < widest).any():
            counts = [len(self._grid(k, steps[k])) for k in range(self.first) if k != self.level]
            if np.prod(counts, initial=1.0) * tools <= most:
                break
            # Slides have larger steps first, because smoothing moves them far.
            large = slides if (steps < widest)[slides].any() else ~slides
            steps = np.where(large, np.minimum(1.2 * steps, widest), steps)
        return np.asarray(steps)

    def _grid(self, axis: int, step: float) -> FloatArray:
        """Return the positions of an external axis [rad or m]."""
        lower = self.lower[axis]
        upper = self.upper[axis]
        if self.wraps[axis]:
            count = int(np.ceil(WHOLE_TURN / step))
            return np.asarray(np.arange(count) * (WHOLE_TURN / count))
        if not np.isfinite(upper - lower):
            lower = max(lower, -self.arm.span)
            upper = min(upper, self.arm.span)
        count = max(2, int(np.ceil((upper - lower) / step)) + 1)
        return np.asarray(np.linspace(lower, upper, count), dtype=np.float64)

    def _tool_turns(self, factor: float, task: int) -> FloatArray:
        """Return rotations about the tool axis, (turns, 3, 3)."""
        count = int(np.ceil(WHOLE_TURN / (TOOL_STEP * factor))) if task == AXIS else 1
        angles = np.arange(count) * (WHOLE_TURN / count)
        return np.asarray(exp(angles[:, None] * np.array([0.0, 0.0, 1.0])))

    def search(self, starts: FloatArray | None) -> list[int]:
        """Relax all layers; return the cheapest last node of each configuration, or none."""
        grid = self._all_cells()
        if starts is None:
            first = self._cells_at(0, grid)
            if not len(first):
                return []
            layer = self._layer(0, first)
        else:
            layer = self._start_layer(starts)
        if not len(layer.q):
            return []
        self.layers.append(layer)
        cost = layer.cost
        weights = paces(self.arm) ** 2
        slowness = self._slowness()
        speed = self.arm.limits.speed
        for i in range(1, len(self.s)):
            rotation = np.arccos(np.clip(self.poses[i - 1, :, 2] @ self.poses[i, :, 2], -1, 1))
            cells = self._cells_at(i, grid)
            near = self._near(cells, layer.cells, float(rotation))
            near &= np.minimum.reduceat(cost, layer.starts[:-1])[None] < np.inf
            kept = near.any(axis=1)
            if not kept.any():
                self._fail(i, layer, cost)
                return []
            after = self._layer(i, cells[kept])
            total = np.full(len(after.q), np.inf)
            back = np.full(len(after.q), -1, dtype=np.intp)
            time = np.inf if speed is None else float((self.s[i] - self.s[i - 1]) / speed)
            relax(
                after.q, after.cost, after.starts, layer.q, cost, layer.starts,
                np.ascontiguousarray(near[kept][after.kept]),
                weights / max(self.place[i] - self.place[i - 1], 1e-6), self.wraps,
                self._largest_moves(float(rotation)), slowness, time, total, back,
            )  # fmt: skip
            if not np.isfinite(total).any():
                self._fail(i, layer, cost)
                return []
            layer = after
            cost = total
            self.layers.append(layer)
            self.backs.append(back)
        ends = []
        for branch in np.unique(layer.branch):
            nodes = np.flatnonzero(layer.branch == branch)
            best = nodes[np.argmin(cost[nodes])]
            if np.isfinite(cost[best]):
                ends.append(int(best))
        return sorted(ends, key=lambda x: cost[x])

    def _fail(self, reached: int, before: Layer, cost: FloatArray) -> None:
        """Note the first station that is not reached, and the cheapest node before it.

        - `cost`: total costs up to the nodes of the layer before, (nodes,).
        """
        self.failure = Failure(reached=reached, q=before.q[np.argmin(cost)])

    def way_to(self, end: int) -> FloatArray:
        """Return the joint positions of the cheapest way to a node of the last layer, (n, dof)."""
        nodes = [end]
        for back in reversed(self.backs):
            nodes.append(int(back[nodes[-1]]))
        rows = [layer.q[k] for layer, k in zip(self.layers, reversed(nodes), strict=True)]
        q = np.array(rows)
        q[:, self.wraps] = np.unwrap(q[:, self.wraps], axis=0)
        return q

    def _slowness(self) -> FloatArray:
        """Return the inverses of the largest joint velocities [s/rad], (dof,)."""
        limits = self.arm.limits
        if limits.joint_velocity is None:
            return np.zeros(self.arm.dof)
        return np.asarray(1 / np.minimum(*np.abs(limits.velocity_bounds(self.arm.dof))))

    def _largest_moves(self, rotation: float) -> FloatArray:
        """Return the largest moves between stations [rad], (dof,)."""
        moves = np.full(self.arm.dof, LARGEST_MOVE)
        moves[: self.first] = np.inf
        return np.asarray(np.maximum(moves, ROTATION_SHARE * rotation))

    def _near(self, cells: FloatArray, before: FloatArray, rotation: float) -> BoolArray:
        """Return whether cells are near those of the layer before, (cells, cells before)."""
        near = np.ones((len(cells), len(before)), dtype=np.bool_)
        for k in range(self.first):
            most = LARGEST_STEPS * self.steps[k] * (1 + 1e-9)
            if not self.arm.chain.slides[k]:
                most = max(most, LARGEST_TURN, ROTATION_SHARE * rotation + self.steps[k])
            if k == self.level:
                most = np.inf
            apart = cells[:, None, k] - before[None, :, k]
            if self.wraps[k]:
                apart -= WHOLE_TURN * np.rint(apart / WHOLE_TURN)
            near &= np.abs(apart) <= most
        return near

    def _all_cells(self) -> FloatArray:
        """Return the grid of all external axes [rad or m], (cells, external)."""
        axes = []
        for k in range(self.first):
            axes.append(np.zeros(1) if k == self.level else self._grid(k, self.steps[k]))
        if not axes:
            return np.zeros((1, 0))
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.first)

    def _cells_at(self, i: int, grid: FloatArray) -> FloatArray:
        """Return those cells whose positions allow the tilt at a station; some axis levels it."""
        chain = self.arm.chain
        tilt = tilt_of(chain)
        if tilt is None:
            return grid
        axis = self.poses[i, :, 2]
        cells = grid if self.level is None else self._leveled(grid, axis)
        if chain.floor_link == 1:
            cells = self._near_level(cells, axis, tilt)
        down, _ = turn_down(chain, cells)
        allowed = chord_of(min(TILT_SHARE * tilt, np.pi))
        return np.asarray(cells[np.linalg.norm(down - axis, axis=1) <= allowed])

    def _leveled(self, grid: FloatArray, axis: FloatArray) -> FloatArray:
        """Return cells in which the leveling axis brings the tool axis nearest to gravity."""
        k = self.level
        assert k is not None
        cells = grid.copy()
        cells[:, k] = self._best_angle(grid, k, axis)
        if self.wraps[k]:
            return cells
        # An angle out of range is replaced by the nearer end of the range.
        middle = (self.lower[k] + self.upper[k]) / 2
        cells[:, k] -= WHOLE_TURN * np.rint((cells[:, k] - middle) / WHOLE_TURN)
        cells[:, k] = np.clip(cells[:, k], self.lower[k], self.upper[k])
        return cells

    def _best_angle(self, cells: FloatArray, k: int, axis: FloatArray) -> FloatArray:
        """Return the positions of axis k that bring the tool axis nearest to gravity [rad].

        The cosine of the angle is `a + b cos(x) + c sin(x)`, whose maximum is at `atan2(c, b)`.
        """
        cosines = []
        for angle in (0.0, np.pi / 2, np.pi):
            at = cells.copy()
            at[:, k] = angle
            cosines.append(turn_down(self.arm.chain, at)[0] @ axis)
        zero, quarter, half = cosines
        return np.arctan2(quarter - (zero + half) / 2, (zero - half) / 2)

    def _near_level(self, grid: FloatArray, axis: FloatArray, tilt: float) -> FloatArray:
        """Return the grid, and its cells at which the only axis of a positioner levels the tool."""
        # The grid may step over the allowed angles.
        best = self._best_angle(grid[:1], 0, axis)[0]
        rest = np.unique(grid[:, 1:], axis=0)
        angles = [best + x * tilt for x in (-0.6, -0.3, 0.0, 0.3, 0.6)]
        if not self.wraps[0]:
            first = np.ceil((self.lower[0] - best) / WHOLE_TURN)
            last = np.floor((self.upper[0] - best) / WHOLE_TURN)
            turns = WHOLE_TURN * np.arange(first, last + 1)
            angles = [x + turn for x in angles for turn in turns]
        cells = [np.column_stack([np.full(len(rest), x), rest]) for x in angles]
        more = np.concatenate([grid, *cells]) if cells else grid
        inside = (more[:, 0] >= self.lower[0]) & (more[:, 0] <= self.upper[0])
        return np.asarray(more[inside | self.wraps[0]])

    def _start_layer(self, starts: FloatArray) -> Layer:
        """Return the layer of given joint positions, each of which is a cell of its own."""
        count = len(starts)
        return Layer(
            q=np.ascontiguousarray(starts),
            cost=np.zeros(count),
            branch=np.zeros(count, dtype=np.intp),
            cells=starts[:, : self.first],
            starts=np.arange(count + 1),
            kept=np.ones(count, dtype=np.bool_),
        )

    def _layer(self, i: int, cells: FloatArray) -> Layer:
        """Return the nodes at a station in the given cells, without empty cells."""
        arm = self.arm
        count = len(cells)
        tools = len(self.turns)
        pose = self.poses[i]
        rows = np.hstack([cells, np.zeros((count, ARM_JOINTS))])
        bases = np.repeat(link_poses(arm.chain, rows)[:, self.first], tools, axis=0)
        turned = np.tile(pose, (tools, 1, 1))
        turned[:, :, :3] = pose[:, :3] @ self.turns
        solved = self.closed_form.solve_many(bases, np.tile(turned, (count, 1, 1)))
        branches = solved.shape[1]
        q = np.empty((count, tools, branches, arm.dof))
        q[..., : self.first] = cells[:, None, None]
        q[..., self.first :] = solved.reshape(count, tools, branches, ARM_JOINTS)
        # Turn the joints into their ranges.
        arm_joints = slice(self.first, None)
        away = q[..., arm_joints] - self.middle[arm_joints]
        q[..., arm_joints] -= WHOLE_TURN * np.rint(away / WHOLE_TURN)
        share = np.abs(q - self.middle) / self.half
        share[..., self.wraps] = np.minimum(share[..., self.wraps], 1.0)
        share[..., : self.first][..., self.wraps[: self.first]] = 0.0
        inside = (share <= 1.0).all(axis=-1)
        excess = np.maximum(share[inside] - INNER_RANGE, 0.0)
        cost = (excess**2).sum(axis=1)
        cell, _, branch = np.nonzero(inside)
        cost += self._tilt_cost(i, cells)[cell]
        numbers = np.bincount(cell, minlength=count)
        kept = numbers > 0
        return Layer(
            q=np.ascontiguousarray(q[inside]),
            cost=cost * RANGE_WEIGHT**2 / len(self.s),
            branch=branch,
            cells=cells[kept],
            starts=np.append(0, np.cumsum(numbers[kept])),
            kept=kept,
        )

    def _tilt_cost(self, i: int, cells: FloatArray) -> FloatArray:
        """Return the squared excess of the angle between tool axis and gravity, (cells,)."""
        tilt = tilt_of(self.arm.chain)
        if tilt is None:
            return np.zeros(len(cells))
        down, _ = turn_down(self.arm.chain, cells)
        chord = np.linalg.norm(down - self.poses[i, :, 2], axis=1)
        return np.asarray(np.maximum(chord / chord_of(tilt) - INNER_RANGE, 0.0) ** 2)
