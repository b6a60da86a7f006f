"""The pieces of an execution that are evaluated one by one: the contours of a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampling import number_parts
from armcontour.geometry import Path
from armcontour.geometry.biarcs import dot, length
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.motion import Execution, FineMotion, Span
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.verification.error_profile import (
    CLOSE,
    ROUNDING,
    SHARP,
    Coverage,
    ErrorProfile,
    Hidden,
    Measure,
    angle_off,
    climb_smooth,
    find_peak,
)
from armcontour.verification.following import Followed, follow_path

# Errors at some times, and the places of the tool on the path then, (n,) each.
Errors = tuple[FloatArray, FloatArray]
# The tool is at rest below this speed [m/s].
REST_SPEED = 1e-3
# Most steps of the search of a common delay, and the step at which it ends [s].
MOST_DELAYS = 20
SAME_DELAY = 1e-7
# An arm that does not move has no delay.
TINY = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourExecution:
    """An execution along one path.

    Args:
        executed: The whole execution.
        path: The path that the tool was to follow.
        objective: The path before rounding, or None if unknown.
        which: The samples of the piece.
        until: End of the piece [s].
        rms_until: End of the time over which root mean squares are taken [s]; by default `until`.
        since: Its start [s]; by default that of its first sample.
        beyond: Index after the last sample at which the tool may still be on the path.
        work: Places between which parts of the path count that the tool leaves out [m].
        before_work: The same on the objective path, or None if unknown.
        offset: Length of the contours before the piece [m], added to arc lengths.
    """

    executed: Execution
    path: Path
    objective: Path | None
    which: slice
    until: float
    beyond: int
    work: tuple[float, float]
    before_work: tuple[float, float] | None = None
    offset: float = 0.0
    since: float | None = None
    rms_until: float | None = None

    @cached_property
    def t(self) -> FloatArray:
        """Times [s], (n,)."""
        return self.executed.t[self.which]

    @cached_property
    def q(self) -> FloatArray:
        """Joint positions [rad], (n, dof)."""
        return self.executed.q[self.which]

    @cached_property
    def _around(self) -> tuple[FloatArray, slice]:
        """Tool points of the piece and around it [m], and which of them are those of the piece."""
        # The tool is at the start of the work between two samples.
        first = max(self.which.start - 1, 0)
        points = self.executed.arm.tool_position(self.executed.q[first : self.beyond])
        return points, slice(self.which.start - first, self.which.stop - first)

    @property
    def tool(self) -> FloatArray:
        """Tool points [m], (n, dimension)."""
        points, own = self._around
        return points[own]

    @cached_property
    def speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        velocity = self.executed.arm.tool_velocity(self.q, self.executed.dq[self.which])
        return length(velocity)

    @cached_property
    def found(self) -> Followed:
        """Places of the tool on the path."""
        return self._follow(self.path, self.work)

    @cached_property
    def on_path(self) -> FloatArray:
        """Points of the path at which the tool is found [m], (n, dimension)."""
        return self.path(self.found.s)

    @cached_property
    def off_objective(self) -> Followed | None:
        """Places of the tool on the objective path; None if unknown."""
        return None if self.objective is None else self._follow(self.objective, self.before_work)

    def _follow(self, path: Path, work: tuple[float, float] | None) -> Followed:
        """Places of the tool on a path."""
        points, own = self._around
        return follow_path(path, points, work=work, judged=own)

    @cached_property
    def contour_error(self) -> ErrorProfile:
        """Distance from the tool to the path [m]."""
        side = None
        if self.path.dimension == 2:
            side = _side(self.path, self.found, self.tool)
        return self._off_path(self.found, side)

    @property
    def coverage_error(self) -> Coverage:
        """Largest distance from the path to the tool [m]."""
        return self._most_missed(self.path, self.work, self.found, self.contour_error)

    def speed_shares(self, limit: float | None, *, between: bool = False) -> FloatArray:
        """Tool speed over the velocity assigned at its place, (n,); see `measure_shares`."""
        return measure_shares(self.path, self.found, self.speed, limit, between=between)

    def tracking_error(self, delay: float = 0.0) -> ErrorProfile:
        """Distance from the tool to its planned position at a time `delay` earlier [m]."""
        trajectory = self.executed.set_points.trajectory
        planned = trajectory(np.clip(self.t - delay, 0.0, trajectory.duration))
        off = length(self.tool - self.executed.arm.tool_position(planned))
        return self._over_time(off, self.found.s)

    @property
    def model_error(self) -> tuple[float, float] | None:
        """Largest `unexplained_errors` along and across the path [m]; None if not known."""
        model_error = self.executed.model_error
        if model_error is None:
            return None
        tangent = self.path(self.found.s, 1)
        both = unexplained_errors(self.executed.arm, self.q, tangent, model_error)
        along, across = (float(x.max()) for x in both)
        return along, across

    @cached_property
    def objective_error(self) -> ErrorProfile | None:
        """Distance from the tool to the objective path [m]; None if unknown."""
        found = self.off_objective
        return None if found is None else self._off_path(found)

    @property
    def objective_coverage_error(self) -> Coverage | None:
        """Largest distance from the objective path to the tool [m]; None if unknown."""
        found, error = self.off_objective, self.objective_error
        if self.objective is None or found is None or error is None:
            return None
        work = self.before_work or (0.0, self.objective.length)
        return self._most_missed(self.objective, work, found, error)

    @property
    def orientation_error(self) -> ErrorProfile | None:
        """Angle between the tool and the required tool orientation [rad]; None if not required."""
        arm, orientation = self.executed.arm, self.path.orientation
        if orientation is None or not isinstance(arm, SerialArm):
            return None

        def measure(i: int, t: FloatArray) -> Errors | None:
            q = self._between(i, t)
            if q is None:
                return None
            tool, turned = arm.pose(q)
            s = self._near(self.found, i, tool)[1]
            return angle_off(orientation, s, turned), s

        angle = angle_off(orientation, self.found.s, arm.pose(self.q)[1])
        return replace(self._over_time(angle, self.found.s, measure), angular=True)

    @cached_property
    def corners(self) -> tuple[CornerDeviation, ...]:
        """Cornering deviations at the corners of the objective path; empty if unknown."""
        if self.objective is None or self.off_objective is None:
            return ()
        judged = self.t <= self.until
        return corner_deviations(
            self.tool[judged],
            self.objective,
            self.off_objective.s[judged],
            self._largest_beside if self._is_told else None,
        )

    def _largest_beside(
        self, which: IntArray, of: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """The largest values of smooth functions of tool points, at some samples and beside them.

        Args:
            which: Indices of samples of the piece that are higher than those beside them, (m,).
            of: Gives values of tool points, from (m, n, dimension) to (m, n).
        """
        m = len(which)
        best = np.asarray(of(self.tool[which][:, None]))[:, 0]
        # The intervals before and after each sample.
        i = np.clip(which + np.array([[-1], [0]]), 0, len(self.t) - 2).ravel()
        fine = self.executed.between(np.unique(i) + self.which.start)
        if fine is None:
            return best

        def measure(t: FloatArray) -> FloatArray:
            both = t.reshape(2, m, -1).swapaxes(0, 1).reshape(m, -1)
            tool = self.executed.arm.tool_position(fine(both.ravel()))
            found = np.asarray(of(tool.reshape(*both.shape, -1)))
            return found.reshape(m, 2, -1).swapaxes(0, 1).reshape(t.shape)

        top = climb_smooth(self.t[i], self.t[i + 1], measure).reshape(2, m).max(axis=0)
        return np.asarray(np.maximum(best, top))

    def _most_missed(
        self, path: Path, work: tuple[float, float], found: Followed, error: ErrorProfile
    ) -> Coverage:
        """The place of a path that is the farthest from the tool, of all that it passes.

        Args:
            path: The path.
            work: Places between which it counts [m].
            found: How the tool follows it.
            error: Distance from the tool to the path.
        """
        far, where = found.coverage_error, found.coverage_error_s
        guessed = np.zeros(len(far), dtype=bool)
        if self._is_told:
            # Elsewhere than at a sample's own place the tool's way was taken for straight.
            guessed = (np.abs(where - found.s) > ROUNDING) & (far >= 0)
        given = np.where(guessed, -1.0, far)
        i = int(np.argmax(given))
        most = Coverage(
            max=max(0.0, float(given[i])),
            t_max=float(self.t[i]),
            s_max=float(where[i]) + self.offset,
        )
        if not self._is_told:
            return most
        rows = np.flatnonzero(guessed)
        bounds = (far + self._bent)[rows]
        # Between the places of two samples on one segment, each place is that of a tool point.
        before, after = found.s[rows], found.s[np.minimum(rows + 1, len(far) - 1)]
        joints = found.geometry[1:, 11]
        alone = np.searchsorted(joints, before, "right") == np.searchsorted(joints, after)
        alone &= (before < where[rows]) & (where[rows] < after)
        bounds[alone] = np.minimum(bounds[alone], error.max)
        rows, bounds = rows[bounds > most.max], bounds[bounds > most.max].tolist()
        near = int(np.clip(np.searchsorted(self.t, error.t_max), 0, len(self.t) - 1))
        # The place from which the tool is the farthest may be as far from the tool's way.
        places = [(error.max, near, error.s_max - self.offset)]
        places += zip(bounds, rows.tolist(), where[rows].tolist(), strict=True)
        for bound, k, s in sorted(places, key=lambda x: -x[0]):
            if bound > most.max * (1 + CLOSE) and work[0] <= s <= work[1]:
                value, t = self._distance_to_way(path([s])[0], k)
                # Outside of the piece the tool may come nearer, as the samples there tell.
                inside = self.t[0] < t < self.t[-1]
                value = min(value, bound if inside else max(float(far[k]), 0.0))
                if value > most.max:
                    most = Coverage(max=value, t_max=t, s_max=s + self.offset)
        return most

    @property
    def _is_told(self) -> bool:
        """Whether a plant tells the motion between samples, of which there are some to go by."""
        return self.executed.plant is not None and len(self.t) > 2

    @cached_property
    def _bent(self) -> FloatArray:
        """How far the tool's way may be from straight beside each sample [m], (n,)."""
        return np.pad(length(np.diff(self.tool, 2, axis=0)) / 4, 1, mode="edge")

    @cached_property
    def _way(self) -> FloatArray:
        """How far the tool has moved from the first sample to each [m], (n,)."""
        return np.append(0.0, np.cumsum(length(np.diff(self.tool, axis=0))))

    def _distance_to_way(self, point: FloatArray, i: int) -> tuple[float, float]:
        """Distance from a point to the tool's way about sample i of the piece [m], and when [s]."""
        reach = 2 * float(length(self.tool[i] - point))
        # The tool's way by which the first and the last of these are away from the sample.
        low, high = np.searchsorted(self._way, self._way[i] + np.array([-reach, reach])).tolist()
        low, high = min(low, i), max(high, i + 1)
        k = low + int(np.argmin(length(self.tool[low:high] - point)))
        # Squares are smooth, also where the way goes through the point.
        found = self._largest_beside(np.array([k]), lambda x: -dot(x - point, x - point))
        return float(np.sqrt(-found[0])), float(self.t[k])

    def _off_path(self, found: Followed, side: FloatArray | None = None) -> ErrorProfile:
        """The profile of distances from a path."""

        def measure(i: int, t: FloatArray) -> Errors | None:
            q = self._between(i, t)
            return None if q is None else self._near(found, i, self.executed.arm.tool_position(q))

        hidden = None
        if self._is_told:
            # Where the path turns sharply, a peak has room for half of the tool's way there.
            sharp = np.flatnonzero(found.turns(SHARP) > SHARP)
            hidden = sharp, length(self.tool[sharp + 1] - self.tool[sharp]) / 2
        return self._over_time(found.distance, found.s, measure, side, hidden)

    def _over_time(
        self,
        values: FloatArray,
        s: FloatArray,
        measure: Measure | None = None,
        side: FloatArray | None = None,
        hidden: Hidden | None = None,
    ) -> ErrorProfile:
        """The profile of values at the samples, (n,), with the arc lengths of their points."""
        peak = None
        if self._is_told and measure is not None:
            since = float(self.t[0]) if self.since is None else self.since
            until = min(self.until, float(self.executed.t[-1]))
            peak = find_peak(self.t, values, measure, since=since, until=until, hidden=hidden)
        if peak is not None:
            peak = peak._replace(s=peak.s + self.offset)
        return ErrorProfile.over_time(
            self.t, values, s + self.offset, self.until, side, peak, self.rms_until
        )

    def _between(self, i: int, t: FloatArray) -> FloatArray | None:
        """Joint positions between sample i of the piece and the next one [rad], (n, dof).

        Args:
            i: Index of the sample; -1 for the one before the piece.
            t: Times [s], (n,).
        """
        if i not in self._fine:
            here = self.which.start + i
            inside = 0 <= here < len(self.executed.t) - 1
            self._fine[i] = self.executed.between(np.array([here])) if inside else None
        fine = self._fine[i]
        return None if fine is None else fine(t)

    @cached_property
    def _fine(self) -> dict[int, FineMotion | None]:
        """Motions between samples, as far as they were asked for."""
        return {}

    def _near(self, found: Followed, i: int, tool: FloatArray) -> Errors:
        """Distances from a path and places of tool points between sample i and the next one [m]."""
        ends = np.clip([i, i + 1], 0, len(found.s) - 1)
        low, high = found.s[ends].tolist()
        return found.near(tool, (low, high), float(found.distance[ends].max()))


def settling_time(executed: Execution, speed: FloatArray) -> float:
    """Time after which the tool stays at rest [s], not before the end of the plan.

    Args:
        executed: The execution.
        speed: Its tool speeds [m/s], (n,).
    """
    moving = np.flatnonzero(speed > REST_SPEED)
    last = float(executed.t[moving[-1]]) if len(moving) else 0.0
    return max(last, executed.set_points.trajectory.duration)


def common_delay(executed: Execution) -> float:
    """Delay of the plan at which the tracking error has the smallest root mean square [s].

    Args:
        executed: The execution.
    """
    trajectory, t, tool = executed.set_points.trajectory, executed.t, executed.tool
    q, dq = (trajectory(np.clip(t, 0.0, trajectory.duration), order) for order in (0, 1))
    planned, velocity = executed.arm.tool_position(q), executed.arm.tool_velocity(q, dq)
    best, delay = (np.inf, 0.0), 0.0
    for _ in range(MOST_DELAYS):
        own, rate = (
            np.stack([np.interp(t - delay, t, x) for x in columns.T], axis=1)
            for columns in (planned, velocity)
        )
        best = min(best, (float(((tool - own) ** 2).sum()), delay))
        # Gauss-Newton step of the least squares in the delay.
        step = float((rate * (own - tool)).sum() / max((rate**2).sum(), TINY))
        delay += step
        if abs(step) < SAME_DELAY:
            break
    return best[1]


def evaluated_times(executed: Execution, until: float | None) -> tuple[float, float]:
    """Ends of the times that largest values and root mean squares of a single path cover [s]."""
    if until is not None:
        return until, until
    # Rest at the end would reduce the root mean square, but a slow tool can still leave the path.
    end = settling_time(executed, executed.tool_speed)
    return max(end, float(executed.t[-1])), end


def pieces_of(
    executed: Execution, path: Program, objective: Program | None, until: float | None
) -> list[ContourExecution]:
    """Split an execution into its contours, each while the process is at work on it.

    A single path is one piece, from the first set-point to `until`.

    Args:
        executed: The execution.
        path: The program that was planned.
        objective: The program before rounding, or None if unknown.
        until: End of the evaluation of a single path [s]; None is until all joints are at rest,
            with root mean squares until the tool is slower than `REST_SPEED`.

    Raises:
        InvalidInput: The execution or the objective has another number of contours than the path.
    """
    spans = executed.set_points.trajectory.contour_spans
    last, rms_until = evaluated_times(executed, until)
    count = len(spans)
    if len(path.contours) != count:
        raise InvalidInput(
            f"The execution has {count} contour{'s' if count != 1 else ''}: evaluate it with the "
            "program that was planned."
        )
    if objective is not None and len(objective.contours) != count:
        raise InvalidInput(
            f"The objective must be a program of {count} contours, as the planned one is."
        )
    if path.single_path is None:
        judged = [_find_window(executed, x) for x in spans]
    else:
        judged = [(slice(0, len(executed.t)), (None, last), 0.0)]
    starts = [which.start for which, _, _ in judged[1:]]
    beyond = [*starts, len(executed.t)]
    before = [None] * count if objective is None else objective.contours
    return [
        ContourExecution(
            executed=executed,
            path=contour.path,
            objective=None if first is None else first.path,
            which=which,
            since=begin,
            until=end,
            rms_until=None if path.single_path is None else rms_until,
            beyond=following,
            work=contour.at_work,
            before_work=None if first is None else first.at_work,
            offset=offset,
        )
        for contour, first, (which, (begin, end), offset), following in zip(
            path.contours, before, judged, beyond, strict=True
        )
    ]


def _find_window(
    executed: Execution, span: Span
) -> tuple[slice, tuple[float | None, float], float]:
    """Find the samples of a contour, its times [s] and the length of the contours before [m]."""
    assert span.work is not None
    start, end = np.searchsorted(executed.t, span.work)
    # At least two samples, however short the contour is.
    start = min(int(start), len(executed.t) - 2)
    return slice(start, max(int(end), start + 2)), span.work, span.s[0]


def _side(path: Path, found: Followed, tool: FloatArray) -> FloatArray:
    """1 where the tool is to the left of a path in the plane, -1 to its right.

    Args:
        path: The path.
        found: Places of the tool on the path.
        tool: Tool points [m], (n, 2).
    """
    rows = found.geometry.T
    row = np.maximum(rows[11].searchsorted(found.s, side="right") - 1, 0)
    x, y = (tool[:, axis] - rows[axis][row] for axis in range(2))
    a, b = (rows[3 + axis][row] for axis in range(2))
    along, left = x * a + y * b, y * a - x * b
    # To the left of a line; of an arc that turns to the left, inside of its circle.
    to_left = rows[3] * rows[7] > rows[4] * rows[6]
    bend = np.where(to_left, rows[9], -rows[9])[row]
    side = np.where(2 * left < bend * (along * along + left * left), -1.0, 1.0)
    corner = (found.s == rows[11][row]) | (found.s == path.length)
    if corner.any():
        # At a corner, the sum of both tangents decides.
        s = found.s[corner]
        x, y = (tool[corner] - path(s)).T
        tangent = (path(s, 1) + path(s, 1, side="left")).T
        side[corner] = np.where(tangent[0] * y < tangent[1] * x, -1.0, 1.0)
    return side


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerDeviation:
    """Deviations of the tool at one corner.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0.
        point: The corner [m].
        rounding: Cornering round-off CR: smallest distance between corner and tool [m].
        overshoot: Cornering overshoot CO: largest distance of the tool beyond the line that leaves
            the corner, on the side away from the line that arrives [m].
        contour: Number of the contour in a program, from 1; None for a single path.
    """

    vertex: int
    point: tuple[float, ...]
    rounding: float
    overshoot: float
    contour: int | None = None


# The largest values beside some samples, (m,), given these samples, (m,), and a function of tool
# points, (m, n, dimension), that has a value for each of them, (m, n).
Largest = Callable[[IntArray, Callable[[FloatArray], FloatArray]], FloatArray]


def corner_deviations(
    tool: FloatArray, objective: Path, s: FloatArray | None = None, beside: Largest | None = None
) -> tuple[CornerDeviation, ...]:
    """Cornering deviations at every corner of a path.

    Args:
        tool: Tool points [m], (n, dimension).
        objective: The path with its corners.
        s: Arc lengths of the nearest points on the path [m], (n,); computed if None.
        beside: Finds what is larger between the points than at them; None if nothing is known.
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    at = objective.project(tool).s if s is None else s
    order = np.argsort(at, kind="stable")
    at, tool = at[order], tool[order]
    # The region of a corner: from the middle of the segment before to the middle of the one after.
    low = objective.breaks[corners] - objective.lengths[corners - 1] / 2
    high = objective.breaks[corners] + objective.lengths[corners] / 2
    first, last = np.searchsorted(at, low), np.searchsorted(at, high, side="right")
    # If no sample is in the region, take the samples before and after it.
    empty = first == last
    first = np.where(empty, np.maximum(first - 1, 0), first)
    last = np.where(empty, np.minimum(last + 1, len(at)), last)
    of, number = number_parts(last - first)
    near = first[of] + number
    points, starts = objective.starts[corners], np.cumsum(last - first) - (last - first)
    off = tool[near] - points[of]
    across = _across(objective, corners)
    away, past = length(off), dot(off, across[of])
    rounding = np.minimum.reduceat(away, starts)
    overshoot = np.maximum.reduceat(past, starts)
    if beside is not None:
        # The first of the extreme samples of each corner.
        rows = [np.flatnonzero(x == y[of]) for x, y in ((away, rounding), (past, overshoot))]
        nearest, farthest = (x[np.unique(of[x], return_index=True)[1]] for x in rows)
        # What is largest where the tool comes and goes is not so between samples.
        inner = np.flatnonzero((farthest > starts) & (farthest < starts + last - first - 1))
        farthest, count = farthest[inner], len(corners)
        here, out = np.concatenate([points, points[inner]])[:, None], across[inner][:, None]

        # Squares are smooth, also where the tool passes through the corner.
        def both(x: FloatArray) -> FloatArray:
            gap = x - here
            return np.concatenate(
                [-dot(gap[:count], gap[:count]), np.sum(gap[count:] * out, axis=-1)]
            )

        found = beside(order[near[np.concatenate([nearest, farthest])]], both)
        rounding, overshoot[inner] = np.sqrt(-found[:count]), found[count:]
    return tuple(
        CornerDeviation(vertex=vertex, point=tuple(point), rounding=cr, overshoot=max(0.0, co))
        for vertex, point, cr, co in zip(
            corners.tolist(), points.tolist(), rounding.tolist(), overshoot.tolist(), strict=True
        )
    )


def _across(path: Path, corners: IntArray) -> FloatArray:
    """Unit vectors of overshoot, (n, dimension): arriving direction normal to the leaving one."""
    before = path.segments.end_tangents[corners - 1]
    after = path.tangents[corners]
    across = before - np.sum(before * after, axis=1, keepdims=True) * after
    size = np.linalg.norm(across, axis=1, keepdims=True)
    turned = size > TANGENT_TOLERANCE
    return np.where(turned, across / np.where(turned, size, 1.0), before)


def measure_shares(
    path: Path, found: Followed, speed: FloatArray, limit: float | None, *, between: bool = False
) -> FloatArray:
    """Measure the tool speed over the velocity assigned at the place of the tool, (n,).

    The place of a tool off the path is known to within its distance from the path. So next to a
    joint between segments, as near as that, the larger of both velocities is the assigned one.
    Where it falls or rises between two samples, the speed at that place counts, which is
    interpolated linearly.

    Args:
        path: The path, whose segments may have speeds of their own.
        found: Places of the tool on it.
        speed: Tool speed at the samples [m/s], (n,).
        limit: Assigned velocity of the whole path [m/s]; None without one.
        between: Whether the shares bound those between samples too, taking the speed for no more
            bent there than it is at the samples around, with one kink at most.

    Returns:
        The shares; 0 where no velocity is assigned.
    """
    assigned = np.fmin(path.speeds, np.inf if limit is None else limit)
    assigned = np.where(np.isnan(assigned), np.inf, assigned)
    if not np.isfinite(assigned).any():
        return np.zeros(len(speed))
    high = speed + _bound_between(speed) if between else speed
    s, off = np.maximum.accumulate(found.s), found.distance
    first, last = s - off, s + off
    here = np.maximum(_at(path, assigned, first, "left"), _at(path, assigned, last, "right"))
    share = high / here
    before, after = assigned[:-1], assigned[1:]
    # Where the assigned velocity falls, the first sample past the joint has passed it before.
    falls = np.flatnonzero(after < before)
    _raise_at_joints(share, high, first, path.breaks[1:-1][falls], after[falls], past=1)
    # Where it rises, the last sample before the joint goes on until there.
    rises = np.flatnonzero(after > before)
    _raise_at_joints(share, high, last, path.breaks[1:-1][rises], before[rises], past=0)
    return share


def _at(path: Path, assigned: FloatArray, s: FloatArray, side: str) -> FloatArray:
    """Assigned velocities at places, which may be beyond the ends of the path [m/s], (n,)."""
    inside = np.clip(s, 0.0, path.length)
    return assigned[path.locate(inside, side="left" if side == "left" else "right")]


def _raise_at_joints(
    share: FloatArray,
    speed: FloatArray,
    place: FloatArray,
    joints: FloatArray,
    assigned: FloatArray,
    *,
    past: int,
) -> None:
    """Raise shares to those at the time at which the tool passes joints between segments.

    Args:
        share: The shares, (n,); changed.
        speed: Tool speed at the samples [m/s], (n,).
        place: Places of the samples [m], (n,).
        joints: Places of the joints [m], (joints,).
        assigned: Velocity assigned on the slow side of each joint [m/s], (joints,).
        past: 1 to raise the share of the sample after the joint, 0 that of the one before.
    """
    place = np.maximum.accumulate(place)
    i = np.searchsorted(place, joints, side="right")
    inside = (i > 0) & (i < len(place))
    i, joints, assigned = i[inside], joints[inside], assigned[inside]
    size = place[i] - place[i - 1]
    part = (joints - place[i - 1]) / np.where(size > 0, size, 1.0)
    passing = speed[i - 1] + part * (speed[i] - speed[i - 1])
    np.maximum.at(share, i - 1 + past, passing / assigned)


def _bound_between(speed: FloatArray) -> FloatArray:
    """How much higher than at a sample the speed may be between it and the next ones, (n,)."""
    if len(speed) < 3:
        return np.zeros(len(speed))
    bent = np.pad(np.abs(np.diff(speed, 2)), 1, mode="edge")
    # A parabola is above both ends by at most an eighth of its second difference, a kink by at most
    # a quarter of the sum of those around it.
    pairs = (bent[1:] + bent[:-1]) / 4
    return np.asarray(np.maximum(np.append(pairs, 0.0), np.append(0.0, pairs)))


def unexplained_errors(
    arm: Arm, q: FloatArray, tangent: FloatArray, model_error: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bounds of the tool error due to errors of the joints, to first order.

    Each joint counts with its largest error and the worst sign.

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        tangent: Unit tangents of the path, (n, dimension).
        model_error: Largest error of each joint [rad], (dof,).

    Returns:
        Bounds along and across the path [m], (n,) each.
    """
    moved = arm.tool_jacobian(q) * model_error
    along = (tangent[:, None] @ moved)[:, 0]
    across = moved - tangent[:, :, None] * along[:, None]
    return abs(along).sum(axis=1), length(across.swapaxes(1, 2)).sum(axis=1)
