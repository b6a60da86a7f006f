"""Search for a faster shape: a quadratic program proposes, the exact timing decides."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.sampling import number_parts
from armcontour.geometry import Path, ShapedPath, ShapingOutcome, Tube, orient_shaped
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.shaped_path import ARCS, PARABOLAS, SHAPED
from armcontour.planning.options import Shaped
from armcontour.planning.shaping.curves import DrawnPath, draw
from armcontour.planning.shaping.kinematics import NearPath
from armcontour.planning.shaping.nodes import INSIDE, Nodes, place_nodes
from armcontour.planning.shaping.quadratic_program import solve_program
from armcontour.planning.shaping.spline_rows import LEAST_SPAN, JointSpline, assemble, span_rows
from armcontour.planning.shaping.starts import Candidate, Timer, make_starts, match, prove

# A path with more corners and rests than this is optimized in chunks.
LONG = 40
# Corners of a chunk, and shift of the cuts between iterations.
CORNERS, SHIFT = 8, 3


def is_long(group: IntArray) -> bool:
    """Test whether a path is long; `group` is the nearest corner or rest of each node, (n,)."""
    return bool(group[-1] >= LONG)


def place_cuts(group: IntArray, iteration: int, *, whole: bool = False) -> IntArray:
    """First of both fixed nodes between chunks, (m,); none if the path is not long, or `whole`."""
    # `group`: number of the nearest corner or rest of each node, ascending, (n,); `whole`: true if
    # long paths are not divided either.
    if whole or not is_long(group):
        return np.zeros(0, dtype=np.intp)
    first = 1 + SHIFT * iteration % CORNERS
    cuts = np.searchsorted(group, np.arange(first, int(group[-1]) + 1, CORNERS))
    # A chunk needs room for its first and last node.
    return np.asarray(cuts[(cuts > 2) & (cuts < len(group) - 4)])


def solve_in_chunks(
    cost: FloatArray,
    rows: FloatArray,
    bounds: FloatArray,
    weight: FloatArray,
    cuts: IntArray,  # First of both fixed nodes between chunks, (m,)
    threads: int | None = None,  # Number of threads; by default the number of processors
) -> FloatArray:
    """Solve the programs of all chunks, each with zero unknowns in the other chunks, (n, k)."""
    if not len(cuts):
        return solve_program(cost, rows, bounds, weight)[0]
    n, k = cost.shape
    begins, ends = np.append(0, cuts + 1), np.append(cuts + 1, n)

    def solve(begin: int, end: int) -> FloatArray:
        part = slice(begin, end)
        chunk_cost, chunk_rows = cost[part].copy(), rows[part].copy()
        if begin > 0:
            chunk_cost[0], chunk_rows[0, :, : 2 * k], chunk_rows[1, :, :k] = 0.0, 0.0, 0.0
        if end < n:
            chunk_cost[-1], chunk_rows[-1, :, k:], chunk_rows[-2, :, 2 * k :] = 0.0, 0.0, 0.0
        x, _ = solve_program(chunk_cost, chunk_rows, bounds[part], weight[part])
        # A chunk without a solution is unchanged.
        return x if np.isfinite(x).all() else np.zeros_like(x)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        return np.concatenate(list(pool.map(solve, begins.tolist(), ends.tolist())))


# Limit of changes of offsets over the tolerance: initial, largest and smallest value, and factors
# after rejected, slower and faster iterations.
FIRST_TRUST, MAX_TRUST, LEAST_TRUST = 0.3, 0.5, 1e-5
SHRINK, EASE, GROW = 1 / 3, 0.7, 1.5
# The search ends after this many consecutive iterations that gain less than LEAST_GAIN of the
# duration.
IDLE, LEAST_GAIN = 4, 1e-5
# It also ends after this many consecutive iterations that leave the tube.
MAX_TIGHTENED = 12
# Factor of a change for each consecutive rejection.
LESS = 0.6
# Corners of a long path revert to the best shape at most this many times in an iteration.
MAX_MENDED = 4
# Weights of the squares of offsets and times, for a positive definite quadratic program.
WEIGHT = (1e-3, 1e-9)
# Factor of the missing distance by which offsets are reduced outside the tube.
SPARE = 1.5
# Share of the tolerance of the initial parabolas.
SHARE = 0.7


@dataclass(slots=True)
class _State:
    """Best shape found by the search."""

    best: Candidate
    offsets: FloatArray  # Its offsets [m], (n, k)
    h: FloatArray  # Its span times [s], (n,)
    trust: FloatArray  # Largest change of the offsets of each node, over the tolerance, (n,)
    inside: FloatArray  # Share of the tolerance by which offsets stay inside, (n,)
    limits: FloatArray  # Largest offsets along every side [m], (n, m)
    refused: int = 0
    proposals: int = 0


@dataclass(slots=True)
class ShapeSearch:
    """Search along the nodes of one start; each step yields the best candidate."""

    nodes: Nodes
    start: Candidate
    tube: Tube
    timer: Timer
    options: Shaped
    state: _State = field(init=False)

    @property
    def size(self) -> float:
        """Number of joint values of the control points per corner or rest."""
        return self.nodes.q.size / float(self.nodes.group[-1] + 1)

    def __post_init__(self) -> None:
        n, k = len(self.nodes), self.nodes.frames.shape[2]
        inside = np.full(n, INSIDE)
        self.state = _State(
            best=self.start,
            offsets=np.zeros((n, k)),
            h=np.diff(self.nodes.times),
            trust=np.full(n, FIRST_TRUST),
            inside=inside,
            limits=self.nodes.bounds(self.tube, inside),
        )

    def run(self) -> Iterator[Candidate]:
        """Yield the best candidate after each iteration, until the gain is negligible."""
        idle = tightened = 0
        while idle < IDLE and tightened < MAX_TIGHTENED:
            before = self.state.best.duration
            accepted = self._iterate()
            gained = before - self.state.best.duration
            tightened = 0 if accepted else tightened + 1
            idle = 0 if gained > LEAST_GAIN * before else idle + accepted
            yield self.state.best

    def _iterate(self) -> bool:
        """Propose a change and accept it if the exact timing is faster."""
        # Returns false if the change left the tube, whose limits are then reduced.
        state, nodes = self.state, self.nodes
        try:
            offsets, h, drawn = self._draw_most(*self._propose())
            judged = None if drawn is None else self._judge(drawn)
        except (ArmContourError, np.linalg.LinAlgError):
            state.trust *= SHRINK
            return True
        if drawn is None:
            return False
        if judged is None:
            state.trust *= SHRINK
            return True
        candidate, times, slower = judged
        # The first spline is accepted even if it is slower than the start it is drawn from.
        better = state.best is self.start or candidate.duration < state.best.duration
        if not better and self._keep_faster_parts(offsets, h, slower):
            state.refused = 0
            factor = np.where(slower, SHRINK, 1.0)
        elif better:
            state.best, state.offsets, state.h = candidate, offsets, times
            self._keep_near(candidate, drawn.knots)
            state.refused = 0
            factor = np.where(slower, EASE, GROW)
        else:
            state.refused += 1
            # Neighbours of a corner share its lines.
            wide = slower | np.append(slower[1:], False) | np.append(False, slower[:-1])
            factor = np.where(wide if slower.any() else True, SHRINK, 1.0)
        state.trust = np.clip(state.trust * factor[nodes.group], LEAST_TRUST, MAX_TRUST)
        return True

    def _keep_near(self, candidate: Candidate, knots: FloatArray) -> None:
        """Use a candidate's tool orientations and redundant joints for the control points."""
        # `knots` are the arc lengths of the knots on its path [m], (n + 1,).
        if self.nodes.near.poses is None:
            return
        # Control points of the arc length itself; at a rest they are at the rest.
        s_knots = np.clip(knots, 0.0, candidate.path.length)
        speed = candidate.trajectory.speed_at(s_knots)
        speed[self.nodes.rest] = 0.0
        both = np.maximum(speed[:-1] + speed[1:], np.finfo(float).tiny)
        s = s_knots[:-1] + speed[:-1] / both * np.diff(s_knots)
        q = candidate.trajectory(candidate.trajectory.time_at(s))
        near = NearPath.along(q, self.timer.arm, self.timer.configuration, candidate.path, s)
        self.nodes = replace(self.nodes, near=near, q=q)

    def _judge(self, drawn: DrawnPath) -> tuple[Candidate, FloatArray, BoolArray] | None:
        """Time the drawn path; returns it with its span times [s] and a mask of slower corners."""
        # None if the arm cannot follow the path.
        path = self._path(drawn)
        candidate = None if path is None else self.timer.candidate(SHAPED, path, drawn.places)
        if path is None or candidate is None:
            return None
        times = np.diff(candidate.trajectory.time_at(np.clip(drawn.knots, 0.0, path.length)))
        before, after = (np.bincount(self.nodes.group, x) for x in (self.state.h, times))
        return candidate, times, after > before

    def _draw_most(
        self, offsets: FloatArray, h: FloatArray
    ) -> tuple[FloatArray, FloatArray, DrawnPath | None]:
        """Draw a proposal; on a long path, corners outside the tube revert to the best shape."""
        # Returns the offsets and times, and their path; None if it leaves the tube.
        for _ in range(MAX_MENDED if is_long(self.nodes.group) else 1):
            before = self.state.inside
            drawn = self._draw(offsets, h)
            if drawn is not None:
                return offsets, h, drawn
            outside = np.bincount(self.nodes.group, self.state.inside > before) > 0
            offsets, h = self._back(offsets, h, outside)
        return offsets, h, None

    def _keep_faster_parts(self, offsets: FloatArray, h: FloatArray, slower: BoolArray) -> bool:
        """On a long path, accept a proposal without its slower corners if that is faster."""
        if not is_long(self.nodes.group) or slower.all():
            return False
        try:
            offsets, h, drawn = self._draw_most(*self._back(offsets, h, slower))
            judged = None if drawn is None else self._judge(drawn)
        except ArmContourError:
            return False
        if drawn is None or judged is None or judged[0].duration >= self.state.best.duration:
            return False
        self.state.best, self.state.offsets, self.state.h = judged[0], offsets, judged[1]
        self._keep_near(judged[0], drawn.knots)
        return True

    def _back(
        self, offsets: FloatArray, h: FloatArray, corners: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Proposal in which the masked corners revert to the best shape, (groups,)."""
        # The share of their neighbours decreases with the distance.
        group, state = self.nodes.group, self.state
        stays = 1.0 - corners
        edges = np.minimum(stays[1:], stays[:-1])
        first, last = np.append(stays[0], edges)[group], np.append(edges, stays[-1])[group]
        count = np.bincount(group)
        _, number = number_parts(count)
        share = first + (number + 0.5) / count[group] * (last - first)
        return (
            state.offsets + share[:, None] * (offsets - state.offsets),
            state.h + share * (h - state.h),
        )

    def _spline(self, offsets: FloatArray, h: FloatArray) -> JointSpline:
        nodes = self.nodes
        points = nodes.points + np.einsum("ndk,nk->nd", nodes.frames, offsets)
        return JointSpline(q=nodes.near.solve(points, nodes.q), h=h, rest=nodes.rest)

    def _propose(self) -> tuple[FloatArray, FloatArray]:
        state, nodes = self.state, self.nodes
        n, k = state.offsets.shape
        unit = np.where(nodes.fixed, 0.0, np.maximum(nodes.tolerance, 1e-12))
        rows, bounds = self._limit_rows(state.offsets, state.h, unit)
        node_rows, node_bounds = self._own_rows(unit)
        cost = np.zeros((n, k + 1))
        cost[:, k] = state.h / state.h.mean()
        # Offsets without a gain return to zero.
        cost[:, :k] = WEIGHT[0] * state.offsets / np.where(unit > 0, unit, 1.0)[:, None]
        unknowns = solve_in_chunks(
            cost,
            np.concatenate([rows, node_rows], axis=1),
            np.concatenate([bounds, node_bounds], axis=1),
            np.tile([*[WEIGHT[0]] * k, WEIGHT[1]], (n, 1)),
            # The start is no spline, so fixed nodes may leave no solution.
            place_cuts(nodes.group, state.proposals, whole=state.best is self.start),
        )
        state.proposals += 1
        if not np.isfinite(unknowns).all():
            raise np.linalg.LinAlgError("The quadratic program has no solution.")
        # The trust region limits offsets only; after rejections all changes are reduced.
        unknowns *= LESS**state.refused
        offsets = state.offsets + unknowns[:, :k] * unit[:, None]
        return self._clip(offsets), state.h * (1 + np.maximum(unknowns[:, k], -LEAST_SPAN))

    def _limit_rows(
        self, offsets: FloatArray, h: FloatArray, unit: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        nodes, limits = self.nodes, self.timer.limits
        spline = self._spline(offsets, h)
        steps = nodes.near.steps(spline.q, nodes.frames)
        speeds = self.tube.objective.speeds[self.tube.objective.locate(nodes.s_objective)]
        # The end of a span may be on the segment of either node.
        speeds[:-1] = np.fmin(speeds[:-1], speeds[1:])
        assigned = np.fmin(speeds, np.inf if limits.speed is None else limits.speed)
        assigned = np.where(np.isnan(assigned), np.inf, assigned)
        return assemble(spline, span_rows(spline, self.timer.arm, limits, assigned), steps, unit)

    def _own_rows(self, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of single nodes: the tube, the trust region, and the smallest span time."""
        state, nodes = self.state, self.nodes
        n, k = state.offsets.shape
        m = len(nodes.sides)
        rows = np.zeros((n, m + 2 * k + 1, 3 * (k + 1)))
        bounds = np.zeros((n, m + 2 * k + 1))
        free = unit > 0
        room = state.limits - state.offsets @ nodes.sides.T
        rows[free, :m, k + 1 : 2 * k + 1] = nodes.sides
        bounds[:, :m] = np.maximum(room / np.where(free, unit, 1.0)[:, None], 0.0)
        for j in range(k):
            for row, sign in ((m + 2 * j, 1.0), (m + 2 * j + 1, -1.0)):
                rows[free, row, k + 1 + j] = sign
                bounds[:, row] = state.trust
        rows[:, -1, 2 * k + 1] = -1.0
        bounds[:, -1] = LEAST_SPAN
        return rows, bounds

    def _clip(self, offsets: FloatArray) -> FloatArray:
        """Offsets reduced to their limits along the line to the start, (n, k)."""
        along = offsets @ self.nodes.sides.T
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(along > self.state.limits, self.state.limits / along, 1.0)
        return np.asarray(offsets * np.clip(share.min(axis=1), 0.0, 1.0)[:, None])

    def _draw(self, offsets: FloatArray, h: FloatArray) -> DrawnPath | None:
        """Path of offsets and times; None if it leaves the tube, whose limits are then reduced."""
        nodes = self.nodes
        spline = self._spline(offsets, h)
        drawn = draw(
            spline, self.timer.arm, self.tube.objective, nodes.s_objective, nodes.tolerance
        )
        if self._nearly_stops(drawn):
            return None
        knots = np.interp(drawn.places[:, 1], drawn.knots, np.arange(len(nodes) + 1))
        reach = nodes.reach[np.clip(knots.astype(np.intp), 0, len(nodes) - 1)]
        plain = Path(segments=drawn.segments)
        drawn = replace(drawn, places=match(self.tube, plain, drawn.places, reach))
        proof = prove(self.tube, plain, drawn.places)
        # The tool follows the curve, which deviates slightly from the arcs.
        deviation = np.repeat(drawn.curve.spreads, 2)
        vertices = proof.vertices + drawn.curve.spreads.max()
        excess = max(
            float((proof.segments + deviation).max()), float(vertices.max(initial=-np.inf))
        )
        if excess <= proof.slack:
            return drawn
        middle = (plain.breaks[:-1] + plain.breaks[1:]) / 2
        span = np.clip(np.searchsorted(drawn.knots, middle) - 1, 0, len(nodes) - 1)
        lacking = np.zeros(len(nodes))
        np.maximum.at(lacking, span, proof.segments + deviation)
        self._tighten(lacking, np.where(vertices > proof.slack, vertices, 0.0))
        return None

    def _tighten(self, lacking: FloatArray, excess: FloatArray) -> None:
        """Reduce the limits of the offsets where the path leaves the tube."""
        # `lacking` is the distance outside the tube in the span of each node [m], (n,); `excess` is
        # the distance of each corner from the path beyond the allowed one [m], (k,).
        nodes, state = self.nodes, self.state
        lacking = lacking.copy()
        s_corners = self.tube.objective.breaks[self.tube.vertex]
        for k in np.flatnonzero(excess):
            near = nodes.vertex == k
            if not near.any():
                near = (
                    np.abs(nodes.s_objective - s_corners[k])
                    == np.abs(nodes.s_objective - s_corners[k]).min()
                )
            lacking[near] = np.maximum(lacking[near], excess[k])
        # Control points determine their own span and both neighbours.
        wide = np.maximum(np.append(lacking[1:], 0.0), np.append(0.0, lacking[:-1]))
        lacking = np.maximum(lacking, wide)
        reduction = SPARE * np.maximum(lacking, 0.0) / np.maximum(nodes.smallest, 1e-12)
        # At least doubled, so that a few times are sufficient.
        increased = np.maximum(2 * state.inside, state.inside + reduction)
        state.inside = np.where(lacking > 0, np.minimum(increased, 1.0), state.inside)
        state.limits = nodes.bounds(self.tube, state.inside)
        state.offsets = self._clip(state.offsets)

    def _nearly_stops(self, drawn: DrawnPath) -> bool:
        """Test whether the tool turns on the spot; reduces the trust region there."""
        nodes, lengths = self.nodes, np.diff(drawn.curve.breaks)
        tiny = drawn.curve.breaks[:-1][lengths < REPEATED_POINT]
        if not len(tiny):
            return False
        span = np.clip(np.searchsorted(drawn.knots, tiny, side="right") - 1, 0, len(nodes) - 1)
        there = np.isin(nodes.group, nodes.group[span])
        self.state.trust[there] = np.maximum(SHRINK * self.state.trust[there], LEAST_TRUST)
        return True

    def _path(self, drawn: DrawnPath) -> ShapedPath | None:
        """The drawn path without its outcome; None if the tool deviates too much in orientation."""
        options, objective = self.options, self.tube.objective
        path = ShapedPath(
            segments=drawn.segments,
            objective=objective,
            places=drawn.places,
            tolerance=options.tolerance,
            line_tolerance=options.line_tolerance,
            zone=options.zone,
            outcome=ShapingOutcome(start=self.start.name, durations={}),
            curve=drawn.curve,
        )
        if objective.orientation is not None:
            # As at the matching point, even if that follows the tangent.
            plain = replace(objective, orientation=replace(objective.orientation, follows=False))
            path, angle = orient_shaped(path, plain, drawn.places, options.angular_tolerance)
            if angle > (np.inf if options.angular_tolerance is None else options.angular_tolerance):
                return None
        return path


def why_not(objective: Path, tube: Tube) -> str | None:
    """Reason why a path cannot be shaped, as a clause; None if it can."""
    if (tube.tolerance == 0).any():
        # Splines of the joints do not follow a line exactly.
        return "lines without a tolerance are not changed: not shaped"
    if _turns_at_corners(objective):
        return "the orientation follows the tangent at corners: not shaped"
    return None


def make_searches(
    objective: Path, tube: Tube, timer: Timer, options: Shaped
) -> Iterator[ShapeSearch | None]:
    """Searches from parabolas and from arcs that the arm can follow, the faster ones first."""
    # None stands for a search with too many nodes.
    starts = make_starts(objective, tube, options, SHARE)
    candidates = [timer.candidate(x, *starts[x]) for x in (PARABOLAS, ARCS) if x in starts]
    for start in sorted((x for x in candidates if x is not None), key=lambda x: x.duration):
        nodes = place_nodes(start, tube, timer.arm, timer.configuration)
        if nodes is None:
            yield None
        elif not nodes.fixed.all():
            yield ShapeSearch(nodes, start, tube, timer, options)


def _turns_at_corners(objective: Path) -> bool:
    """True if the orientation follows a tangent that jumps, so that it depends on the shape."""
    # If it follows a smooth tangent, shapes have the orientation of the matching objective points.
    orientation = objective.orientation
    return (
        orientation is not None
        and orientation.follows
        and bool((orientation.jumps > SAME_ORIENTATION).any())
    )
