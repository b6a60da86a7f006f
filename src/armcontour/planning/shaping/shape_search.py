"""Search for a faster shape, corner by corner.

A quadratic program proposes changes of control points and span times. A change of a corner concerns
only its neighbourhood: the shape is drawn, compared with the tube and timed along those stretches
whose corners still improve, and each corner keeps its best shape. When all corners have converged,
the whole path is traced and timed exactly.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmContourError
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path, Proof, ShapedPath, ShapingOutcome, Tube, orient_shaped
from armcontour.geometry.orientation import SAME_ORIENTATION
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.shaped_path import ARCS, PARABOLAS, SHAPED
from armcontour.geometry.tube import ALL
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
from armcontour.planning.shaping.spline_rows import (
    LEAST_SPAN,
    JointSpline,
    Neighbour,
    assemble,
    span_rows,
)
from armcontour.planning.shaping.spline_timing import SplineTiming, time_spline
from armcontour.planning.shaping.tool_path_fit import DrawnPath, draw

# Initial trust region: largest change of offsets in an iteration, divided by the tolerance.
FIRST_TRUST = 0.3
# Largest trust region, divided by the tolerance.
MAX_TRUST = 0.5
# Smallest trust region, divided by the tolerance.
LEAST_TRUST = 1e-5
# Trust region from which corners that have converged are improved once more. From a larger one, the
# first changes are rejected, because the shape is nearly the fastest.
AGAIN_TRUST = 0.01
# Factor of the trust region of a corner after a rejected change
SHRINK = 0.5
# Factor of the trust region of a corner after an accepted change
GROW = 2.0
# A corner has converged after this many consecutive iterations that gain little (LITTLE_GAIN).
IDLE = 3
# Iterations with little gain after which a corner has converged when it is improved once more: most
# corners gain nothing then.
IDLE_AGAIN = 2
# An iteration gains little if it shortens the time around a corner by at most this fraction.
LITTLE_GAIN = 2e-5
# Number of corners before and after those that have not converged in a stretch
GROUPS_AROUND = 2
# Largest number of consecutive iterations in which no shape of a start is within the tube
MAX_TIGHTENED = 12
# Each consecutive rejection of a corner multiplies its proposed change by this factor.
REJECTION_FACTOR = 0.6
# Corners of a proposal revert to the best shape at most this many times in an iteration.
MAX_REVERSIONS = 4
# Once all corners have converged, they are improved once more while a round gains more than this
# fraction of the duration.
ROUND_GAIN = 1e-3
# Largest number of iterations of a round if the joint positions at the control points depend on the
# tool's orientation along the path, which is updated after each round
ROUND = 10
# Accuracy of the quadratic program, as `solve_program` defines it: the proposed duration is within
# about 1e-4 of the least one.
PROGRAM_GAP = 1e-5
# Weights of the squares of offsets and span times; they make the quadratic program definite.
WEIGHT = (1e-3, 1e-9)
# Offsets outside the tube are reduced by their excess distance times this factor.
EXCESS_FACTOR = 1.5
# Fraction of the tolerance to which the corners of starts are rounded
START_SHARE = 0.7


@dataclass(slots=True)
class _Shape:
    """Shape of n nodes, with its timing."""

    offsets: FloatArray  # Offsets [m], (n, k)
    h: FloatArray  # Span times of the spline that is drawn [s], (n,)
    q: FloatArray  # Control points [rad], (n, dof)
    times: FloatArray  # Times of the spans in the fastest motion [s], (n,)
    rates: FloatArray  # Derivatives of the spline's parameter by time at the knots, (n + 1,)


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Consecutive nodes, from `begin` to before `end`."""

    begin: int
    end: int

    @property
    def nodes(self) -> slice:
        """The nodes."""
        return slice(self.begin, self.end)

    @property
    def knots(self) -> slice:
        """The knots before, between and after the spans of the nodes."""
        return slice(self.begin, self.end + 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Proposal:
    """Proposed shape along a stretch of m nodes."""

    offsets: FloatArray  # Offsets [m], (m, k)
    h: FloatArray  # Span times [s], (m,)
    spline: JointSpline
    timing: SplineTiming | None  # None if no motion satisfies the limits

    @property
    def times(self) -> FloatArray:
        """Times of the spans in the fastest motion [s], infinite if there is none, (m,)."""
        return np.full(len(self.h), np.inf) if self.timing is None else self.timing.times

    @property
    def duration(self) -> float:
        """Duration of the fastest motion [s], infinite if there is none."""
        return np.inf if self.timing is None else float(self.timing.times.sum())


class _Rejected(Exception):
    """A proposal is not faster than the best shape."""


@dataclass(slots=True)
class ShapeSearch:
    """Search along the nodes of one start."""

    nodes: Nodes
    start: Candidate
    tube: Tube
    timer: Timer
    tolerances: Tolerances
    # Duration after each iteration by the timing of the spline [s]
    durations: list[float] = field(init=False, default_factory=list)
    _best: _Shape = field(init=False)
    # Largest change of the offsets of each node, divided by the tolerance, (n,)
    _trust: FloatArray = field(init=False)
    # Fraction of the tolerance that offsets must not use, (n,)
    _inside: FloatArray = field(init=False)
    # Largest offsets in each direction of `Nodes.sides` [m], (n, m)
    _limits: FloatArray = field(init=False)
    # Numbers of consecutive rejections, and of consecutive iterations with little gain, of each
    # corner or rest, (groups,)
    _rejections: FloatArray = field(init=False)
    _idle: FloatArray = field(init=False)
    # Number of rounds before the current one
    _round: int = field(init=False, default=0)
    # Whether the best shape is within the tube; false for the spline of the start
    _is_inside: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        n = len(self.nodes)
        groups = int(self.nodes.group[-1]) + 1
        times = np.diff(self.nodes.times)
        self._best = _Shape(
            offsets=np.zeros((n, self.nodes.frames.shape[2])),
            h=times,
            q=self.nodes.q.copy(),
            times=times.copy(),
            rates=np.where(self.nodes.rest, 0.0, 1.0),
        )
        self._trust = np.full(n, FIRST_TRUST)
        self._inside = np.full(n, UNUSED_TOLERANCE)
        self._limits = self.nodes.bounds(self.tube, self._inside)
        self._rejections = np.zeros(groups)
        self._idle = np.zeros(groups)

    @property
    def size(self) -> float:
        """Return the number of joint values in the control points per corner or rest."""
        return self.nodes.q.size / float(self.nodes.group[-1] + 1)

    def run(self, iterations: int, report: Callable[[float], None]) -> Candidate | None:
        """Search, and return the fastest shape with its exact timing; None if there is none.

        The shape is within the tube, also after one iteration.

        - `iterations`: largest number of iterations.
        - `report`: called with the fraction done after each iteration.
        """
        best: Candidate | None = None
        least = np.inf
        converged_at = np.inf
        length = iterations if self.nodes.near.poses is None else ROUND
        confirmed = copy.deepcopy(self._best)
        while len(self.durations) < iterations:
            self._improve(min(iterations - len(self.durations), length), report)
            if not self._is_inside:
                break
            result = self._confirm()
            if result is None:
                # The arm cannot follow the shape. Smaller steps are confirmed one by one.
                self._best = copy.deepcopy(confirmed)
                self._is_inside = best is not None
                self._trust *= SHRINK
                length = 1
                if self._trust.max() < LEAST_TRUST:
                    break
                continue
            candidate, drawn = result
            if self.nodes.near.poses is not None:
                self._update_near(candidate, drawn.knots)
            confirmed = copy.deepcopy(self._best)
            if candidate.duration < least:
                best = candidate
                least = candidate.duration
            if self._active_stretches():
                continue
            if least > (1 - ROUND_GAIN) * converged_at:
                break
            converged_at = least
            self._improve_again()
        return best

    def _improve_again(self) -> None:
        """Let all corners that have converged be improved once more."""
        self._round += 1
        self._idle[:] = IDLE - IDLE_AGAIN
        self._rejections[:] = 0
        self._trust[:] = AGAIN_TRUST

    def _improve(self, count: int, report: Callable[[float], None]) -> None:
        """Improve the shape until all corners have converged, in at most `count` iterations.

        `report`: as in `run`.
        """
        tightened = 0
        for _ in range(count):
            stretches = self._active_stretches()
            if not stretches or tightened == MAX_TIGHTENED:
                break
            if not self._is_inside:
                stretches = [_Stretch(0, len(self.nodes))]
            for stretch in stretches:
                self._iterate(stretch)
            tightened = 0 if self._is_inside else tightened + 1
            duration = self._best.times.sum() if self._is_inside else self.start.duration
            self.durations.append(float(duration))
            # Each round is reported as half of the rest.
            converged = float(np.minimum(self._idle / IDLE, 1.0).mean())
            report(1 - 0.5**self._round * (1 - converged / 2))

    def _active_stretches(self) -> list[_Stretch]:
        """Return the stretches of corners that have not converged, with their neighbours."""
        near = self._idle < IDLE
        for _ in range(GROUPS_AROUND):
            near = near | np.append(near[1:], False) | np.append(False, near[:-1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
        firsts = np.searchsorted(self.nodes.group, edges[::2])
        ends = np.searchsorted(self.nodes.group, edges[1::2])
        return [_Stretch(a, b) for a, b in zip(firsts.tolist(), ends.tolist(), strict=True)]

    def _iterate(self, stretch: _Stretch) -> None:
        """Propose a change along a stretch, and accept its corners that become faster."""
        group = self._groups(stretch)
        first = int(self.nodes.group[stretch.begin])
        groups = slice(first, first + int(group[-1]) + 1)
        times = _sums(group, self._best.times[stretch.nodes])
        kept = np.zeros(len(times), dtype=bool)
        gained = np.zeros(len(times))
        blamed = ~kept
        try:
            proposal = self._propose(stretch)
            if proposal.timing is not None:
                slower = _sums(group, proposal.timing.times) > times
                if slower.any():
                    # Neighbouring corners share the line between them.
                    blamed = _around(slower.astype(float)) > 0
            proposal, kept = self._accepted_part(stretch, proposal, times)
            blamed = ~kept
            after = _sums(group, proposal.times)
            gained = times - after if self._is_inside else times
            self._accept(stretch, proposal)
        except (_Rejected, ArmContourError, np.linalg.LinAlgError):
            pass
        self._rejections[groups] = np.where(kept, 0, self._rejections[groups] + blamed)
        factor = np.where(kept, GROW, np.where(blamed, SHRINK, 1.0))
        trust = self._trust[stretch.nodes] * factor[group]
        self._trust[stretch.nodes] = np.clip(trust, LEAST_TRUST, MAX_TRUST)
        # Neighbouring corners share the line between them.
        little = _around(gained) <= LITTLE_GAIN * _around(times)
        self._idle[groups] = np.where(little, self._idle[groups] + 1, 0)

    def _accept(self, stretch: _Stretch, proposal: _Proposal) -> None:
        """Make a proposal the best shape of its stretch."""
        assert proposal.timing is not None
        best = self._best
        best.offsets[stretch.nodes] = proposal.offsets
        best.h[stretch.nodes] = proposal.h
        best.q[stretch.nodes] = proposal.spline.q
        best.times[stretch.nodes] = proposal.timing.times
        # At its ends, the stretch has the rates of the best shape.
        inner = slice(stretch.begin + 1, stretch.end)
        best.rates[inner] = proposal.timing.rates[1:-1]
        self._is_inside = True

    def _accepted_part(
        self, stretch: _Stretch, proposal: _Proposal, times: FloatArray
    ) -> tuple[_Proposal, BoolArray]:
        """Revert the corners of a proposal that are slower or leave the tube.

        Returns the remaining proposal, and the mask of its corners that are not reverted. The first
        shape of a search is accepted even if it is slower than its start.

        - `times`: time of the best shape around each corner [s], (groups,).

        Raises:
            _Rejected: The remaining proposal is not faster than the best shape.
        """
        kept = np.ones(len(times), dtype=bool)
        if self._is_inside:
            proposal, kept = self._keep_faster(stretch, proposal, times)
        least = float(times.sum()) if self._is_inside else np.inf
        for _ in range(MAX_REVERSIONS):
            if proposal.timing is None or proposal.duration >= least:
                break
            outside = self._corners_outside(stretch, proposal)
            if not outside.any():
                return proposal, kept
            kept &= ~outside
            proposal = self._revert(stretch, proposal, outside)
        raise _Rejected

    def _keep_faster(
        self, stretch: _Stretch, proposal: _Proposal, times: FloatArray
    ) -> tuple[_Proposal, BoolArray]:
        """Revert the corners of a proposal that are slower, until it is no longer faster so.

        Returns the fastest proposal, and the mask of its corners that are not reverted.

        - `times`: time of the best shape around each corner [s], (groups,).
        """
        group = self._groups(stretch)
        kept = np.ones(len(times), dtype=bool)
        fastest = proposal
        of_fastest = kept
        for _ in range(MAX_REVERSIONS):
            if proposal.timing is None:
                break
            slower = kept & (_sums(group, proposal.timing.times) > times)
            kept = kept & ~slower
            if not slower.any() or not kept.any():
                break
            proposal = self._revert(stretch, proposal, slower)
            if proposal.duration < fastest.duration:
                fastest = proposal
                of_fastest = kept
            elif fastest.duration < times.sum():
                break
        return fastest, of_fastest

    def _groups(self, stretch: _Stretch) -> IntArray:
        """Return the index of the corner or rest nearest to each node, from 0 on, (m,)."""
        group = self.nodes.group
        return np.asarray(group[stretch.nodes] - group[stretch.begin])

    def _confirm(self) -> tuple[Candidate, DrawnPath] | None:
        """Draw the whole best shape, and trace and time it exactly; None if that fails."""
        whole = _Stretch(0, len(self.nodes))
        shape = self._best
        drawn = self._draw(whole, self._spline(whole, shape.offsets, shape.h))
        drawn, proof = self._prove(whole, drawn)
        if _excess(drawn, proof) > proof.slack:
            return None
        path = self._make_path(drawn)
        candidate = None if path is None else self.timer.candidate(SHAPED, path, drawn.places)
        return None if candidate is None else (candidate, drawn)

    def _update_near(self, candidate: Candidate, knots: FloatArray) -> None:
        """Use a candidate's tool orientations and redundant joints for the control points.

        `knots` are the arc lengths of the knots on its path [m], (n + 1,).
        """
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
        whole = _Stretch(0, len(self.nodes))
        best = self._best
        updated = self._make_proposal(whole, best.offsets, best.h)
        if updated.timing is None:
            self._best = replace(best, q=updated.spline.q)
        else:
            self._accept(whole, updated)

    def _revert(self, stretch: _Stretch, proposal: _Proposal, corners: BoolArray) -> _Proposal:
        """Return a proposal whose masked corners revert to the best shape, and time it.

        Next to a reverted corner, the change of the proposal increases with the distance from the
        corner. `corners` is a mask, (groups,).
        """
        share = self._shares(stretch, np.where(corners, 0.0, 1.0))
        best = self._best
        offsets = best.offsets[stretch.nodes]
        h = best.h[stretch.nodes]
        return self._make_proposal(
            stretch,
            offsets + share[:, None] * (proposal.offsets - offsets),
            h + share * (proposal.h - h),
        )

    def _shares(self, stretch: _Stretch, values: FloatArray) -> FloatArray:
        """Interpolate values of corners, (groups,), to the nodes of a stretch, (m,).

        Between two corners, the smaller value applies.
        """
        group = self._groups(stretch)
        edges = np.minimum(values[1:], values[:-1])
        first = np.append(values[0], edges)[group]
        last = np.append(edges, values[-1])[group]
        count = np.bincount(group)
        _, number = number_parts(count)
        return np.asarray(first + (number + 0.5) / count[group] * (last - first))

    def _make_proposal(self, stretch: _Stretch, offsets: FloatArray, h: FloatArray) -> _Proposal:
        """Make the spline of offsets [m], (m, k), and span times [s], (m,), and time it."""
        spline = self._spline(stretch, offsets, h)
        rates = self._best.rates
        try:
            timing = time_spline(
                spline,
                self.timer.arm,
                self.timer.limits,
                self._assigned_speeds(stretch),
                (float(rates[stretch.begin]), float(rates[stretch.end])),
            )
        except ArmContourError:
            timing = None
        return _Proposal(offsets, h, spline, timing)

    def _spline(self, stretch: _Stretch, offsets: FloatArray, h: FloatArray) -> JointSpline:
        """Make the joint spline of offsets [m], (m, k), and span times [s], (m,)."""
        nodes = self.nodes
        part = stretch.nodes
        points = nodes.points[part] + np.einsum("ndk,nk->nd", nodes.frames[part], offsets)
        return JointSpline(
            q=nodes.near.part(part).solve(points, nodes.q[part]),
            h=h,
            rest=nodes.rest[stretch.knots],
            before=self._neighbour(stretch.begin - 1),
            after=self._neighbour(stretch.end),
        )

    def _neighbour(self, i: int) -> Neighbour | None:
        """Return node `i` of the best shape as the neighbour of a stretch, if there is one."""
        if not 0 <= i < len(self.nodes):
            return None
        return Neighbour(self._best.q[i], float(self._best.h[i]))

    def _propose(self, stretch: _Stretch) -> _Proposal:
        """Propose a change along a stretch by the quadratic program.

        Raises:
            LinAlgError: The quadratic program has no solution.
        """
        nodes = self.nodes
        part = stretch.nodes
        best = self._best
        offsets = best.offsets[part]
        times = best.times[part]
        k = offsets.shape[1]
        # The first and the last node of a stretch are fixed, so that the rest of the path stays.
        # Around the outer corners, only the timing changes: the tool can regain its speed there.
        ends = self._fixed_ends(stretch)
        unit = np.where(nodes.fixed[part], 0.0, np.maximum(nodes.tolerance[part], 1e-12))
        group = self._groups(stretch)
        unit[np.isin(group, group[ends])] = 0.0
        rows, bounds = self._limit_rows(stretch, offsets, times, unit)
        node_rows, node_bounds = self._node_rows(stretch, unit)
        rows = np.concatenate([rows, node_rows], axis=1)
        bounds = np.concatenate([bounds, node_bounds], axis=1)
        cost = np.zeros((len(times), k + 1))
        cost[:, k] = times / times.mean()
        # Offsets without a gain return to zero.
        cost[:, :k] = WEIGHT[0] * offsets / np.where(unit > 0, unit, 1.0)[:, None]
        for i in ends:
            _fix_node(i, cost, rows, bounds)
        weight = np.tile([*[WEIGHT[0]] * k, WEIGHT[1]], (len(times), 1))
        unknowns = solve_program(cost, rows, bounds, weight, PROGRAM_GAP).x
        if not np.isfinite(unknowns).all():
            raise np.linalg.LinAlgError("The quadratic program has no solution.")
        # The trust region limits offsets only; after rejections all changes are reduced.
        groups = nodes.group[part]
        rejections = self._rejections[groups[0] : groups[-1] + 1]
        unknowns *= self._shares(stretch, REJECTION_FACTOR**rejections)[:, None]
        changed = self._limit_offsets(offsets + unknowns[:, :k] * unit[:, None], part)
        h = times * (1 + np.maximum(unknowns[:, k], -LEAST_SPAN))
        h[ends] = best.h[part][ends]
        changed[ends] = offsets[ends]
        return self._make_proposal(stretch, changed, h)

    def _fixed_ends(self, stretch: _Stretch) -> list[int]:
        """Return the nodes at the ends of a stretch that must stay, as indices in the stretch."""
        ends = []
        if not self.nodes.rest[stretch.begin]:
            ends.append(0)
        if not self.nodes.rest[stretch.end]:
            ends.append(stretch.end - stretch.begin - 1)
        return ends

    def _assigned_speeds(self, stretch: _Stretch) -> FloatArray:
        """Return the assigned velocities of the spans [m/s], infinite if none, (m,)."""
        assigned = self.tube.objective.assigned_speeds(
            self.timer.limits.speed, self.nodes.s_objective[stretch.nodes]
        )
        # The end of a span may be on the segment of either node.
        assigned[:-1] = np.minimum(assigned[:-1], assigned[1:])
        return assigned

    def _limit_rows(
        self, stretch: _Stretch, offsets: FloatArray, h: FloatArray, unit: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rows of all limits of the arm, and their bounds, about a shape.

        - `unit`: change of a node's offsets by one unknown [m], (m,).
        """
        part = stretch.nodes
        spline = replace(self._spline(stretch, offsets, h), q=self._best.q[part])
        steps = self.nodes.near.part(part).steps(spline.q, self.nodes.frames[part])
        speeds = self._assigned_speeds(stretch)
        return assemble(
            spline, span_rows(spline, self.timer.arm, self.timer.limits, speeds), steps, unit
        )

    def _node_rows(self, stretch: _Stretch, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rows and bounds of single nodes: tube, trust region, smallest span time."""
        nodes = self.nodes
        part = stretch.nodes
        offsets = self._best.offsets[part]
        n, k = offsets.shape
        m = len(nodes.sides)
        rows = np.zeros((n, m + 2 * k + 1, 3 * (k + 1)))
        bounds = np.zeros((n, m + 2 * k + 1))
        free = unit > 0
        room = self._limits[part] - offsets @ nodes.sides.T
        rows[free, :m, k + 1 : 2 * k + 1] = nodes.sides
        bounds[:, :m] = np.maximum(room / np.where(free, unit, 1.0)[:, None], 0.0)
        for j in range(k):
            for row, sign in ((m + 2 * j, 1.0), (m + 2 * j + 1, -1.0)):
                rows[free, row, k + 1 + j] = sign
                bounds[:, row] = self._trust[part]
        rows[:, -1, 2 * k + 1] = -1.0
        bounds[:, -1] = LEAST_SPAN
        return rows, bounds

    def _limit_offsets(self, offsets: FloatArray, part: slice) -> FloatArray:
        """Scale offsets of a part of the nodes down until they are within their limits, (m, k)."""
        along = offsets @ self.nodes.sides.T
        limits = self._limits[part]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(along > limits, limits / along, 1.0)
        return np.asarray(offsets * np.clip(share.min(axis=1), 0.0, 1.0)[:, None])

    def _draw(self, stretch: _Stretch, spline: JointSpline) -> DrawnPath:
        """Draw the tool path of a spline along a stretch."""
        nodes = self.nodes
        s = nodes.s_objective[:, None]
        before = s[stretch.begin - 1] if stretch.begin > 0 else None
        after = s[stretch.end] if stretch.end < len(nodes) else None
        s_knots = spline.at_knots(s[stretch.nodes], before, after)[:, 0]
        objective = self.tube.objective
        if stretch.begin == 0:
            s_knots[0] = 0.0
        if stretch.end == len(nodes):
            s_knots[-1] = objective.length
        return draw(spline, self.timer.arm, objective, s_knots, nodes.tolerance[stretch.nodes])

    def _prove(self, stretch: _Stretch, drawn: DrawnPath) -> tuple[DrawnPath, Proof]:
        """Match a drawn path to the objective, and bound how far it is from the objective."""
        nodes = self.nodes
        knots = np.interp(drawn.places[:, 1], drawn.knots, np.arange(len(drawn.knots)))
        last = stretch.end - stretch.begin - 1
        reach = nodes.reach[stretch.nodes][np.clip(knots.astype(np.intp), 0, last)]
        plain = Path(segments=drawn.segments)
        corners = self._corners_of(stretch, drawn)
        drawn = replace(drawn, places=match(self.tube, plain, drawn.places, reach, corners))
        return drawn, prove(self.tube, plain, drawn.places, corners)

    def _corners_of(self, stretch: _Stretch, drawn: DrawnPath) -> slice:
        """Return the corners of the objective along a stretch that is drawn."""
        if stretch.end - stretch.begin == len(self.nodes):
            return ALL
        return self.tube.corners_between(*drawn.places[[0, -1], 0].tolist())

    def _corners_outside(self, stretch: _Stretch, proposal: _Proposal) -> BoolArray:
        """Draw a proposal, return the mask of corners outside the tube, and reduce their limits.

        Corners at which the tool nearly stops count as outside; their trust region is reduced.
        """
        group = self._groups(stretch)
        outside = np.zeros(int(group[-1]) + 1, dtype=bool)
        drawn = self._draw(stretch, proposal.spline)
        lengths = np.diff(drawn.curve.breaks)
        tiny = drawn.curve.breaks[:-1][lengths < REPEATED_POINT]
        if len(tiny):
            span = np.searchsorted(drawn.knots, tiny, side="right") - 1
            outside[group[np.clip(span, 0, len(group) - 1)]] = True
            return outside
        drawn, proof = self._prove(stretch, drawn)
        if _excess(drawn, proof) <= proof.slack:
            return outside
        deviation = np.repeat(drawn.curve.spreads, 2)
        breaks = Path(segments=drawn.segments).breaks
        middle = (breaks[:-1] + breaks[1:]) / 2
        span = np.clip(np.searchsorted(drawn.knots, middle) - 1, 0, len(group) - 1)
        lacking = np.zeros(len(group))
        np.maximum.at(lacking, span, proof.segments + deviation)
        vertices = proof.vertices + drawn.curve.spreads.max()
        corners = self._corners_of(stretch, drawn)
        near = self._near_corners(stretch, corners, np.where(vertices > proof.slack, vertices, 0.0))
        lacking = np.maximum(lacking, near)
        outside[group[lacking > 0]] = True
        self._tighten(stretch, lacking)
        return outside

    def _near_corners(self, stretch: _Stretch, corners: slice, excess: FloatArray) -> FloatArray:
        """Return the excess distance [m] of the corner that each node belongs to, (m,).

        - `excess`: distance of each of the corners from the path in excess of its tolerance [m].
        """
        nodes = self.nodes
        s = nodes.s_objective[stretch.nodes]
        vertex = nodes.vertex[stretch.nodes]
        lacking = np.zeros(len(s))
        s_corners = self.tube.objective.breaks[self.tube.vertex]
        first = corners.indices(len(s_corners))[0]
        for k in np.flatnonzero(excess):
            corner = first + k
            near = vertex == corner
            if not near.any():
                distance = np.abs(s - s_corners[corner])
                near = distance == distance.min()
            lacking[near] = np.maximum(lacking[near], excess[k])
        return lacking

    def _tighten(self, stretch: _Stretch, lacking: FloatArray) -> None:
        """Reduce the limits of the offsets where the path leaves the tube.

        - `lacking`: distance outside the tube in the span of each node [m], (m,).
        """
        nodes = self.nodes
        part = stretch.nodes
        # Control points determine their own span and both neighbours.
        of_neighbours = np.maximum(np.append(lacking[1:], 0.0), np.append(0.0, lacking[:-1]))
        lacking = np.maximum(lacking, of_neighbours)
        reduction = (
            EXCESS_FACTOR * np.maximum(lacking, 0.0) / np.maximum(nodes.smallest[part], 1e-12)
        )
        # `inside` is at least doubled, so that few reductions are sufficient.
        inside = self._inside[part]
        increased = np.maximum(2 * inside, inside + reduction)
        self._inside[part] = np.where(lacking > 0, np.minimum(increased, 1.0), inside)
        changed = stretch.begin + np.flatnonzero(lacking > 0)
        self._limits[changed] = nodes.bounds(self.tube, self._inside, changed)

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


def _sums(group: IntArray, values: FloatArray) -> FloatArray:
    """Return the sum of the values of the nodes of each corner, (groups,)."""
    return np.bincount(group, values).astype(np.float64)


def _around(values: FloatArray) -> FloatArray:
    """Return the sum of the values of each corner and its neighbours, (groups,)."""
    total = values.copy()
    total[1:] += values[:-1]
    total[:-1] += values[1:]
    return total


def _excess(drawn: DrawnPath, proof: Proof) -> float:
    """Return how far a drawn path is outside the tube at most [m]; at most the slack if inside."""
    # The tool follows the curve, which deviates slightly from the arcs.
    segments = proof.segments + np.repeat(drawn.curve.spreads, 2)
    vertices = proof.vertices + drawn.curve.spreads.max()
    return max(float(segments.max()), float(vertices.max(initial=-np.inf)))


def _fix_node(i: int, cost: FloatArray, rows: FloatArray, bounds: FloatArray) -> None:
    """Fix the unknowns of node `i`, which is the first or the last one, at zero."""
    n, k = cost.shape
    cost[i] = 0.0
    rows[i, :, k : 2 * k] = 0.0
    if i > 0:
        rows[i - 1, :, 2 * k :] = 0.0
    if i < n - 1:
        rows[i + 1, :, :k] = 0.0
    # The rows of its span and of the next one are satisfied without a change.
    for row in (max(i - 1, 0), i, min(i + 1, n - 1)):
        bounds[row] = np.maximum(bounds[row], 0.0)


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
