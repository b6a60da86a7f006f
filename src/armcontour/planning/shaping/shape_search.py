"""Search for a faster shape. A quadratic program proposes changes; exact timing accepts them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path, ShapedPath, ShapingOutcome, Tube, orient_shaped
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.shaped_path import ARCS, PARABOLAS, SHAPED
from armcontour.planning.shaping.quadratic_program import solve_program
from armcontour.planning.shaping.shape_starts import (
    Candidate,
    Timer,
    Tolerances,
    make_starts,
    match,
    prove,
)
from armcontour.planning.shaping.spline_nodes import UNUSED_TOLERANCE, NearPath, Nodes, place_nodes
from armcontour.planning.shaping.spline_rows import LEAST_SPAN, JointSpline, assemble, span_rows
from armcontour.planning.shaping.tool_path_fit import DrawnPath, draw

# On a path with more corners and rests than this, corners are rejected separately.
MANY_CORNERS = 40
# A path with more corners and rests than this is also optimized in chunks, by several threads. The
# fixed nodes between chunks often leave no solution.
CHUNKED = 400
# Number of corners of a chunk.
CORNERS = 8
# Number of corners by which the cuts between chunks move in each iteration.
CUT_SHIFT = 3
# Initial trust region: largest change of offsets in an iteration, divided by the tolerance.
FIRST_TRUST = 0.3
# Largest trust region, divided by the tolerance.
MAX_TRUST = 0.5
# Smallest trust region, divided by the tolerance.
LEAST_TRUST = 1e-5
# Factor of the trust region after a rejected change.
SHRINK = 1 / 3
# Factor of the trust region at corners that an accepted change made slower.
EASE = 0.7
# Factor of the trust region at all other corners after an accepted change.
GROW = 1.5
# The search ends after this many consecutive iterations that gain little (LITTLE_GAIN).
IDLE = 4
# An iteration gains little if it shortens the duration by at most this fraction.
LITTLE_GAIN = 1e-5
# The search also ends after this many consecutive iterations in which the path leaves the tube.
MAX_TIGHTENED = 12
# Each consecutive rejection multiplies the proposed change by this factor.
REJECTION_FACTOR = 0.6
# Corners of a long path revert to the best shape at most this many times in an iteration.
MAX_REVERSIONS = 4
# Weights of the squares of offsets and span times; they make the quadratic program definite.
WEIGHT = (1e-3, 1e-9)
# Offsets outside the tube are reduced by their excess distance times this factor.
EXCESS_FACTOR = 1.5
# Fraction of the tolerance to which the corners of starts are rounded
START_SHARE = 0.7


def is_long(group: IntArray) -> bool:
    """Test whether corners are rejected separately; `group`: as in `place_cuts`."""
    return bool(group[-1] >= MANY_CORNERS)


def place_cuts(group: IntArray, iteration: int, *, whole: bool = False) -> IntArray:
    """Return the first of the two fixed nodes between chunks, (m,); empty for a single chunk.

    - `group`: index of the corner or rest nearest to each node, ascending, (n,).
    - `whole`: true for a single chunk, also on long paths.
    """
    if whole or group[-1] < CHUNKED:
        return np.zeros(0, dtype=np.intp)
    first = 1 + CUT_SHIFT * iteration % CORNERS
    cuts = np.searchsorted(group, np.arange(first, int(group[-1]) + 1, CORNERS))
    # A chunk needs room for its first and last node.
    return np.asarray(cuts[(cuts > 2) & (cuts < len(group) - 4)])


def solve_in_chunks(
    cost: FloatArray,
    rows: FloatArray,
    bounds: FloatArray,
    weight: FloatArray,
    cuts: IntArray,  # First of both fixed nodes between chunks, (m,)
) -> FloatArray:
    """Solve the quadratic programs of all chunks independently; returns the unknowns, (n, k)."""
    # The unknowns of other chunks are zero in each program.
    if not len(cuts):
        return solve_program(cost, rows, bounds, weight).x
    n, k = cost.shape
    begins = np.append(0, cuts + 1)
    ends = np.append(cuts + 1, n)

    def solve(begin: int, end: int) -> FloatArray:
        """Solve the program of the nodes from `begin` to `end`; the unknowns of others are 0."""
        part = slice(begin, end)
        chunk_cost = cost[part].copy()
        chunk_rows = rows[part].copy()
        if begin > 0:
            chunk_cost[0] = 0.0
            chunk_rows[0, :, : 2 * k] = 0.0
            chunk_rows[1, :, :k] = 0.0
        if end < n:
            chunk_cost[-1] = 0.0
            chunk_rows[-1, :, k:] = 0.0
            chunk_rows[-2, :, 2 * k :] = 0.0
        x = solve_program(chunk_cost, chunk_rows, bounds[part], weight[part]).x
        # A chunk without a solution does not change.
        return x if np.isfinite(x).all() else np.zeros_like(x)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return np.concatenate(list(pool.map(solve, begins.tolist(), ends.tolist())))


@dataclass(slots=True)
class _State:
    """Best shape found by the search."""

    best: Candidate
    offsets: FloatArray  # Offsets of the best shape [m], (n, k)
    h: FloatArray  # Span times of the best shape [s], (n,)
    trust: FloatArray  # Largest change of the offsets of each node, divided by the tolerance, (n,)
    inside: FloatArray  # Fraction of the tolerance that offsets must not use, (n,)
    limits: FloatArray  # Largest offsets in each direction of `Nodes.sides` [m], (n, m)
    rejections: int = 0  # Number of consecutive rejections
    proposals: int = 0  # Number of proposals


@dataclass(slots=True)
class ShapeSearch:
    """Search along the nodes of one start; each iteration yields the best candidate."""

    nodes: Nodes
    start: Candidate
    tube: Tube
    timer: Timer
    tolerances: Tolerances
    state: _State = field(init=False)

    @property
    def size(self) -> float:
        """Return the number of joint values in the control points per corner or rest."""
        return self.nodes.q.size / float(self.nodes.group[-1] + 1)

    def __post_init__(self) -> None:
        n = len(self.nodes)
        k = self.nodes.frames.shape[2]
        inside = np.full(n, UNUSED_TOLERANCE)
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
        # Numbers of consecutive iterations with little gain, and with a path outside the tube
        idle = 0
        tightened = 0
        while idle < IDLE and tightened < MAX_TIGHTENED:
            before = self.state.best.duration
            trust = self.state.trust.copy()
            inside = self.state.inside
            accepted = self._iterate()
            unchanged = np.array_equal(trust, self.state.trust) and inside is self.state.inside
            if not accepted and unchanged and self.nodes.group[-1] < CHUNKED:
                # The next proposal would be the same one.
                return
            gained = before - self.state.best.duration
            tightened = 0 if accepted else tightened + 1
            idle = 0 if gained > LITTLE_GAIN * before else idle + accepted
            yield self.state.best

    def _iterate(self) -> bool:
        """Propose a change, and accept it if the exact timing is faster.

        Returns false if the path left the tube; the limits of the offsets are then reduced.
        """
        state = self.state
        nodes = self.nodes
        try:
            offsets, h, drawn = self._draw_or_revert(*self._propose())
            judged = None if drawn is None else self._time_drawn(drawn)
        except (ArmContourError, np.linalg.LinAlgError):
            state.trust *= SHRINK
            return True
        if drawn is None:
            return False
        if judged is None:
            state.trust *= SHRINK
            return True
        candidate, times, slower = judged
        # The first spline is accepted even if it is slower than its start.
        better = state.best is self.start or candidate.duration < state.best.duration
        if not better and self._keep_faster_parts(offsets, h, slower):
            state.rejections = 0
            factor = np.where(slower, SHRINK, 1.0)
        elif better:
            state.best = candidate
            state.offsets = offsets
            state.h = times
            self._update_near(candidate, drawn.knots)
            state.rejections = 0
            factor = np.where(slower, EASE, GROW)
        else:
            state.rejections += 1
            # Neighbouring corners share the line between them.
            near_slower = slower | np.append(slower[1:], False) | np.append(False, slower[:-1])
            factor = np.where(near_slower if slower.any() else True, SHRINK, 1.0)
        state.trust = np.clip(state.trust * factor[nodes.group], LEAST_TRUST, MAX_TRUST)
        return True

    def _update_near(self, candidate: Candidate, knots: FloatArray) -> None:
        """Use a candidate's tool orientations and redundant joints for the control points.

        `knots` are the arc lengths of the knots on its path [m], (n + 1,).
        """
        if self.nodes.near.poses is None:
            return
        # `s`: control points of the arc length as a quadratic spline of time; control points next
        # to a rest are at the rest.
        s_knots = np.clip(knots, 0.0, candidate.path.length)
        speed = candidate.trajectory.speed_at(s_knots)
        speed[self.nodes.rest] = 0.0
        both = np.maximum(speed[:-1] + speed[1:], np.finfo(float).tiny)
        s = s_knots[:-1] + speed[:-1] / both * np.diff(s_knots)
        q = candidate.trajectory(candidate.trajectory.time_at(s))
        near = NearPath.along(q, self.timer.arm, self.timer.configuration, candidate.path, s)
        self.nodes = replace(self.nodes, near=near, q=q)

    def _time_drawn(self, drawn: DrawnPath) -> tuple[Candidate, FloatArray, BoolArray] | None:
        """Time the drawn path; returns it with its span times [s] and a mask of slower corners.

        Returns None if the arm cannot follow the path, or if its orientation deviates too much.
        """
        path = self._make_path(drawn)
        candidate = None if path is None else self.timer.candidate(SHAPED, path, drawn.places)
        if path is None or candidate is None:
            return None
        times = np.diff(candidate.trajectory.time_at(np.clip(drawn.knots, 0.0, path.length)))
        before, after = (np.bincount(self.nodes.group, x) for x in (self.state.h, times))
        return candidate, times, after > before

    def _draw_or_revert(
        self, offsets: FloatArray, h: FloatArray
    ) -> tuple[FloatArray, FloatArray, DrawnPath | None]:
        """Draw a proposal; on a long path, corners outside the tube revert to the best shape.

        Returns the offsets, the span times and their path, or None for a path that leaves the tube.
        """
        for _ in range(MAX_REVERSIONS if is_long(self.nodes.group) else 1):
            before = self.state.inside
            drawn = self._draw(offsets, h)
            if drawn is not None:
                return offsets, h, drawn
            outside = np.bincount(self.nodes.group, self.state.inside > before) > 0
            offsets, h = self._revert_corners(offsets, h, outside)
        return offsets, h, None

    def _keep_faster_parts(self, offsets: FloatArray, h: FloatArray, slower: BoolArray) -> bool:
        """Accept a proposal for a long path without its slower corners, if that is faster."""
        if not is_long(self.nodes.group) or slower.all():
            return False
        try:
            offsets, h, drawn = self._draw_or_revert(*self._revert_corners(offsets, h, slower))
            judged = None if drawn is None else self._time_drawn(drawn)
        except ArmContourError:
            return False
        if drawn is None or judged is None or judged[0].duration >= self.state.best.duration:
            return False
        self.state.best = judged[0]
        self.state.offsets = offsets
        self.state.h = judged[1]
        self._update_near(judged[0], drawn.knots)
        return True

    def _revert_corners(
        self, offsets: FloatArray, h: FloatArray, corners: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return a proposal whose masked corners revert to the best shape: offsets and span times.

        Next to a reverted corner, the change of the proposal increases with the distance from the
        corner.

        `corners` is a mask, (groups,).
        """
        group = self.nodes.group
        state = self.state
        stays = 1.0 - corners
        edges = np.minimum(stays[1:], stays[:-1])
        first = np.append(stays[0], edges)[group]
        last = np.append(edges, stays[-1])[group]
        count = np.bincount(group)
        _, number = number_parts(count)
        share = first + (number + 0.5) / count[group] * (last - first)
        return (
            state.offsets + share[:, None] * (offsets - state.offsets),
            state.h + share * (h - state.h),
        )

    def _spline(self, offsets: FloatArray, h: FloatArray) -> JointSpline:
        """Make the joint spline of offsets [m], (n, k), and span times [s], (n,)."""
        nodes = self.nodes
        points = nodes.points + np.einsum("ndk,nk->nd", nodes.frames, offsets)
        return JointSpline(q=nodes.near.solve(points, nodes.q), h=h, rest=nodes.rest)

    def _propose(self) -> tuple[FloatArray, FloatArray]:
        """Propose new offsets [m], (n, k), and span times [s], (n,), by the quadratic program."""
        state = self.state
        nodes = self.nodes
        n, k = state.offsets.shape
        unit = np.where(nodes.fixed, 0.0, np.maximum(nodes.tolerance, 1e-12))
        rows, bounds = self._limit_rows(state.offsets, state.h, unit)
        node_rows, node_bounds = self._node_rows(unit)
        cost = np.zeros((n, k + 1))
        cost[:, k] = state.h / state.h.mean()
        # Offsets without a gain return to zero.
        cost[:, :k] = WEIGHT[0] * state.offsets / np.where(unit > 0, unit, 1.0)[:, None]
        unknowns = solve_in_chunks(
            cost,
            np.concatenate([rows, node_rows], axis=1),
            np.concatenate([bounds, node_bounds], axis=1),
            np.tile([*[WEIGHT[0]] * k, WEIGHT[1]], (n, 1)),
            # Until the first spline is accepted, a single chunk is used: the start is not a spline,
            # so fixed nodes may leave no solution.
            place_cuts(nodes.group, state.proposals, whole=state.best is self.start),
        )
        state.proposals += 1
        if not np.isfinite(unknowns).all():
            raise np.linalg.LinAlgError("The quadratic program has no solution.")
        # The trust region limits offsets only; after rejections all changes are reduced.
        unknowns *= REJECTION_FACTOR**state.rejections
        offsets = state.offsets + unknowns[:, :k] * unit[:, None]
        return self._limit_offsets(offsets), state.h * (1 + np.maximum(unknowns[:, k], -LEAST_SPAN))

    def _limit_rows(
        self, offsets: FloatArray, h: FloatArray, unit: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rows of all limits of the arm, and their bounds, about a shape.

        - `unit`: change of a node's offsets by one unknown [m], (n,).
        """
        nodes = self.nodes
        limits = self.timer.limits
        spline = self._spline(offsets, h)
        steps = nodes.near.steps(spline.q, nodes.frames)
        assigned = self.tube.objective.assigned_speeds(limits.speed, nodes.s_objective)
        # The end of a span may be on the segment of either node.
        assigned[:-1] = np.minimum(assigned[:-1], assigned[1:])
        return assemble(spline, span_rows(spline, self.timer.arm, limits, assigned), steps, unit)

    def _node_rows(self, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rows and bounds of single nodes: tube, trust region, smallest span time."""
        state = self.state
        nodes = self.nodes
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

    def _limit_offsets(self, offsets: FloatArray) -> FloatArray:
        """Scale offsets down until they are within their limits, (n, k)."""
        along = offsets @ self.nodes.sides.T
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(along > self.state.limits, self.state.limits / along, 1.0)
        return np.asarray(offsets * np.clip(share.min(axis=1), 0.0, 1.0)[:, None])

    def _draw(self, offsets: FloatArray, h: FloatArray) -> DrawnPath | None:
        """Draw the path of offsets and span times; None if the path leaves the tube."""
        # The limits of the offsets are then reduced.
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
        """Reduce the limits of the offsets where the path leaves the tube.

        - `lacking`: distance outside the tube in the span of each node [m], (n,).
        - `excess`: distance of each corner from the path in excess of its tolerance [m], (k,).
        """
        nodes = self.nodes
        state = self.state
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
        of_neighbours = np.maximum(np.append(lacking[1:], 0.0), np.append(0.0, lacking[:-1]))
        lacking = np.maximum(lacking, of_neighbours)
        reduction = EXCESS_FACTOR * np.maximum(lacking, 0.0) / np.maximum(nodes.smallest, 1e-12)
        # `inside` is at least doubled, so that few reductions are sufficient.
        increased = np.maximum(2 * state.inside, state.inside + reduction)
        state.inside = np.where(lacking > 0, np.minimum(increased, 1.0), state.inside)
        state.limits = nodes.bounds(self.tube, state.inside)
        state.offsets = self._limit_offsets(state.offsets)

    def _nearly_stops(self, drawn: DrawnPath) -> bool:
        """Test whether the tool nearly stops, and reduce the trust region there."""
        nodes = self.nodes
        lengths = np.diff(drawn.curve.breaks)
        tiny = drawn.curve.breaks[:-1][lengths < REPEATED_POINT]
        if not len(tiny):
            return False
        span = np.clip(np.searchsorted(drawn.knots, tiny, side="right") - 1, 0, len(nodes) - 1)
        there = np.isin(nodes.group, nodes.group[span])
        self.state.trust[there] = np.maximum(SHRINK * self.state.trust[there], LEAST_TRUST)
        return True

    def _make_path(self, drawn: DrawnPath) -> ShapedPath | None:
        """Make the shaped path of a drawing; None if its tool orientation deviates too much."""
        objective = self.tube.objective
        path = ShapedPath(
            segments=drawn.segments,
            objective=objective,
            places=drawn.places,
            tolerance=self.tolerances.distance,
            outcome=ShapingOutcome(start=self.start.name, durations={}),
            curve=drawn.curve,
        )
        if objective.orientation is not None:
            allowed = self.tolerances.angle
            path, angle = orient_shaped(path, objective, drawn.places, allowed)
            if allowed is not None and angle > allowed:
                return None
        return path


def explain_unshaped(objective: Path, tube: Tube) -> str | None:
    """Return the reason why a path cannot be shaped, as a clause; None if it can."""
    if (tube.tolerance == 0).any():
        # Splines of the joints do not follow a line exactly.
        return "not shaped, because a line has no tolerance"
    if _turns_at_corners(objective):
        return "not shaped, because the orientation follows the tangent at corners"
    return None


def make_searches(
    objective: Path, tube: Tube, timer: Timer, tolerances: Tolerances
) -> Iterator[ShapeSearch | None]:
    """Yield the searches from parabolas and from arcs, beginning with the faster start.

    A search with too many nodes is replaced by None.
    """
    starts = make_starts(objective, tube, tolerances, START_SHARE)
    candidates = [timer.candidate(x, *starts[x]) for x in (PARABOLAS, ARCS) if x in starts]
    for start in sorted((x for x in candidates if x is not None), key=lambda x: x.duration):
        nodes = place_nodes(start, tube, timer.arm, timer.configuration)
        if nodes is None:
            yield None
        elif not nodes.fixed.all():
            yield ShapeSearch(nodes, start, tube, timer, tolerances)


def _turns_at_corners(objective: Path) -> bool:
    """Return whether the orientation follows a tangent that jumps and so depends on the shape."""
    # If the orientation follows a smooth tangent, shapes have the orientation of the matching
    # objective points.
    orientation = objective.orientation
    return (
        orientation is not None
        and orientation.follows
        and bool((orientation.jumps > SAME_ORIENTATION).any())
    )
