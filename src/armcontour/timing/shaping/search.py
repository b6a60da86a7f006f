"""The search for a faster shape: proposed by a quadratic program, decided by the exact timing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import ArmContourError
from armcontour.geometry import Outcome, Path, ShapedPath, Tube
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.timing.shaping._quadratic import solve_program
from armcontour.timing.shaping.curves import Drawn, draw
from armcontour.timing.shaping.nodes import INSIDE, Nodes, place_nodes
from armcontour.timing.shaping.places import match, prove
from armcontour.timing.shaping.rows import LEAST_SPAN, Spline, assemble, span_rows
from armcontour.timing.shaping.starts import ARCS, PARABOLAS, Candidate, Timer, make_starts
from armcontour.timing.shaping.wishes import Wishes

# Changes of offsets are limited to this share of the tolerance at first, and at most and at least
# to these. Where an iteration is refused the limit shrinks, where it pays the limit grows.
FIRST_TRUST, MOST_TRUST, LEAST_TRUST = 0.3, 0.5, 1e-5
SHRINK, EASE, GROW = 1 / 3, 0.7, 1.5
# The search ends when this many iterations in sequence gain less than this share of the duration.
IDLE, LEAST_GAIN = 4, 3e-6
# It also ends when so many in sequence leave the tube.
MOST_TIGHTENED = 12
# Weights of the squares of offsets and of times, which make the quadratic program definite.
WEIGHT = (1e-6, 1e-9)
# Where the tube is left the offsets keep this much more than was lacking.
SPARE = 1.5
SHAPED = "shaped"
# The search starts from parabolas within this share of the tolerance.
SHARE = 0.7


@dataclass(slots=True)
class _State:
    """The best shape so far.

    Args:
        best: The best candidate.
        offsets: Its offsets [m], (n, k).
        h: Its span times [s], (n,).
        trust: Largest change of the offsets of each node, over the tolerance, (n,).
        inside: Share of the tolerance that offsets stay inside by, (n,).
        limits: Largest offsets along every side [m], (n, m).
    """

    best: Candidate
    offsets: FloatArray
    h: FloatArray
    trust: FloatArray
    inside: FloatArray
    limits: FloatArray


@dataclass(slots=True)
class Search:
    """A search along the nodes of one start; each step gives the best candidate so far.

    Args:
        nodes: The nodes.
        start: The start.
        tube: The tube of the tolerance.
        timer: Times the shapes.
        wishes: What is wanted.
    """

    nodes: Nodes
    start: Candidate
    tube: Tube
    timer: Timer
    wishes: Wishes
    state: _State = field(init=False)

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
        """Yield the best candidate after each iteration, until nothing is gained."""
        idle = tightened = 0
        while idle < IDLE and tightened < MOST_TIGHTENED:
            before = self.state.best.duration
            kept = self._iterate()
            gained = before - self.state.best.duration
            tightened = 0 if kept else tightened + 1
            idle = 0 if gained > LEAST_GAIN * before else idle + kept
            yield self.state.best

    def _iterate(self) -> bool:
        """Propose a change and keep it if the exact timing is faster.

        Returns:
            False if the change left the tube, whose limits are then less.
        """
        state, nodes = self.state, self.nodes
        try:
            offsets, h = self._propose()
            drawn = self._draw(offsets, h)
        except (ArmContourError, np.linalg.LinAlgError):
            state.trust *= SHRINK
            return True
        if drawn is None:
            return False
        path = self._path(drawn)
        found = self.timer.candidate(SHAPED, path, drawn.places)
        if found is None:
            state.trust *= SHRINK
            return True
        times = np.diff(found.trajectory.time_at(np.clip(drawn.knots, 0.0, path.length)))
        groups = int(nodes.group[-1]) + 1
        now = np.bincount(nodes.group, state.h, groups)
        then = np.bincount(nodes.group, times, groups)
        slower = then > now
        # The first spline only has to be: it may be slower than the start that it is drawn from.
        if state.best is self.start or found.duration < state.best.duration:
            state.best, state.offsets, state.h = found, offsets, times
            factor = np.where(slower, EASE, GROW)
        else:
            # Neighbours of a corner share its lines.
            wide = slower | np.append(slower[1:], False) | np.append(False, slower[:-1])
            factor = np.where(wide if slower.any() else True, SHRINK, 1.0)
        state.trust = np.clip(state.trust * factor[nodes.group], LEAST_TRUST, MOST_TRUST)
        return True

    def _spline(self, offsets: FloatArray, h: FloatArray) -> Spline:
        """The spline of the joints for offsets [m] and span times [s]."""
        nodes = self.nodes
        points = nodes.points + np.einsum("ndk,nk->nd", nodes.frames, offsets)
        return Spline(q=nodes.near.solve(points, nodes.q), h=h, rest=nodes.rest)

    def _propose(self) -> tuple[FloatArray, FloatArray]:
        """Offsets and span times of the quadratic program around the best shape."""
        state, nodes = self.state, self.nodes
        n, k = state.offsets.shape
        spline = self._spline(state.offsets, state.h)
        steps = nodes.near.steps(spline.q, nodes.frames)
        unit = np.where(nodes.fixed, 0.0, np.maximum(nodes.tolerance, 1e-12))
        limits = self.timer.limits
        speeds = self.tube.objective.speeds[self.tube.objective.locate(nodes.place)]
        assigned = np.fmin(speeds, np.inf if limits.speed is None else limits.speed)
        assigned = np.where(np.isnan(assigned), np.inf, assigned)
        rows, bounds = assemble(
            spline, span_rows(spline, self.timer.arm, limits, assigned), steps, unit
        )
        own, own_bounds = self._own_rows(unit)
        cost = np.zeros((n, k + 1))
        cost[:, k] = state.h / state.h.mean()
        x, _ = solve_program(
            cost,
            np.concatenate([rows, own], axis=1),
            np.concatenate([bounds, own_bounds], axis=1),
            np.tile([*[WEIGHT[0]] * k, WEIGHT[1]], (n, 1)),
        )
        if not np.isfinite(x).all():
            raise np.linalg.LinAlgError("The quadratic program has no solution.")
        offsets = state.offsets + x[:, :k] * unit[:, None]
        return self._clip(offsets), state.h * (1 + np.maximum(x[:, k], -LEAST_SPAN))

    def _own_rows(self, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of each node alone: the tube, the trust region, and the least span time."""
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
        """Offsets drawn back to their limits along the line to the start, (n, k)."""
        along = offsets @ self.nodes.sides.T
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(along > self.state.limits, self.state.limits / along, 1.0)
        return np.asarray(offsets * np.clip(share.min(axis=1), 0.0, 1.0)[:, None])

    def _draw(self, offsets: FloatArray, h: FloatArray) -> Drawn | None:
        """The path of offsets and times; None if it leaves the tube, whose limits are then less."""
        nodes, state = self.nodes, self.state
        spline = self._spline(offsets, h)
        objective = self.tube.objective
        drawn = draw(spline, self.timer.arm, objective, nodes.place, nodes.tolerance)
        if self._nearly_stops(drawn):
            return None
        knots = np.interp(drawn.places[:, 1], drawn.knots, np.arange(len(nodes) + 1))
        reach = nodes.reach[np.clip(knots.astype(np.intp), 0, len(nodes) - 1)]
        plain = Path(segments=drawn.segments)
        drawn = replace(drawn, places=match(self.tube, plain, drawn.places, reach))
        proof = prove(self.tube, plain, drawn.places)
        # The tool follows the curve, which is a little beside the arcs.
        beside = np.repeat(drawn.curve.spreads, 2)
        vertices = proof.vertices + drawn.curve.spreads.max()
        excess = max(float((proof.segments + beside).max()), float(vertices.max(initial=-np.inf)))
        if excess <= proof.slack:
            return drawn
        lacking = np.zeros(len(nodes))
        middle = (plain.breaks[:-1] + plain.breaks[1:]) / 2
        span = np.clip(np.searchsorted(drawn.knots, middle) - 1, 0, len(nodes) - 1)
        np.maximum.at(lacking, span, proof.segments + beside)
        for k, excess in enumerate(vertices):
            lacking[nodes.vertex == k] = np.maximum(lacking[nodes.vertex == k], excess)
        # Control points shape their own span and both neighbours.
        wide = np.maximum(np.append(lacking[1:], 0.0), np.append(0.0, lacking[:-1]))
        lacking = np.maximum(lacking, wide)
        less = SPARE * np.maximum(lacking, 0.0) / np.maximum(nodes.least, 1e-12)
        # At least twice as much as before, so that a few times are enough.
        more = np.maximum(2 * state.inside, state.inside + less)
        state.inside = np.where(lacking > 0, np.minimum(more, 1.0), state.inside)
        state.limits = nodes.bounds(self.tube, state.inside)
        state.offsets = self._clip(state.offsets)
        return None

    def _nearly_stops(self, drawn: Drawn) -> bool:
        """Whether the tool turns on the spot somewhere; the offsets there then change less."""
        nodes, lengths = self.nodes, np.diff(drawn.curve.breaks)
        tiny = drawn.curve.breaks[:-1][lengths < REPEATED_POINT]
        if not len(tiny):
            return False
        span = np.clip(np.searchsorted(drawn.knots, tiny, side="right") - 1, 0, len(nodes) - 1)
        there = np.isin(nodes.group, nodes.group[span])
        self.state.trust[there] = np.maximum(SHRINK * self.state.trust[there], LEAST_TRUST)
        return True

    def _path(self, drawn: Drawn) -> ShapedPath:
        """The drawn path, whose outcome is not known yet."""
        wishes = self.wishes
        path = ShapedPath(
            segments=drawn.segments,
            objective=self.tube.objective,
            places=drawn.places,
            tolerance=wishes.tolerance,
            line_tolerance=wishes.line_tolerance,
            zone=wishes.zone,
            outcome=Outcome(start=self.start.name, durations={}),
            curve=drawn.curve,
        )
        return orient(path)


def make_searches(objective: Path, tube: Tube, timer: Timer, wishes: Wishes) -> Iterator[Search]:
    """Searches from parabolas and from arcs, the faster ones first.

    None where the arm cannot follow them, or where nothing may move.

    Args:
        objective: The objective path.
        tube: The tube of the tolerance.
        timer: Times the shapes.
        wishes: What is wanted.
    """
    if objective.orientation is not None and not objective.orientation.fixed:
        return
    # Without a tolerance nothing may move: splines of the joints do not keep to a line.
    if (tube.tolerance == 0).any():
        return
    starts = make_starts(objective, tube, wishes, SHARE)
    found = [timer.candidate(x, *starts[x]) for x in (PARABOLAS, ARCS) if x in starts]
    for start in sorted((x for x in found if x is not None), key=lambda x: x.duration):
        joint_path = timer.trace(start.path)
        nodes = place_nodes(start, joint_path, tube, timer.arm, timer.branch, 1.0)
        yield Search(nodes, start, tube, timer, wishes)


def orient(path: ShapedPath) -> ShapedPath:
    """A shaped path with the tool orientation of its objective."""
    orientation = path.objective.orientation
    if orientation is None:
        return path
    breaks = np.array([0.0, path.length])
    rows = {x: getattr(orientation, x)[:1] for x in ("starts", "first", "second", "f", "g")}
    return replace(path, orientation=replace(orientation, breaks=breaks, **rows))
