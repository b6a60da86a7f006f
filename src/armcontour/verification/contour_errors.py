"""`ContourExecution`: the execution of one contour, with its errors (see error_profile.py)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import number_parts
from armcontour.geometry import Path
from armcontour.geometry.biarcs import dot, length
from armcontour.geometry.projection import pack_segments, pad_to_space
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.motion import Execution, Span
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.verification.error_profile import (
    ERROR_ROUNDING,
    PEAK_EXCESS,
    SHARP_TURN,
    Coverage,
    ErrorProfile,
    Followed,
    Hidden,
    Peak,
    Search,
    find_peak,
    follow_path,
    maximize_smooth,
    orientation_angles,
    search_measured,
)
from armcontour.verification.tool_between import ToolBetween

if TYPE_CHECKING:
    from armcontour.verification.peak_search import ToolPath

# Errors [m or rad] and arc lengths [m] at n times, (n,) each.
Errors = tuple[FloatArray, FloatArray]
# Number of times for which a plan is evaluated at once, which limits the memory.
TIMES_AT_ONCE = 20_000
# The tool is at rest below this speed [m/s].
REST_SPEED = 1e-3
# Signature of `ContourExecution._maximize_nearby`: indices of samples, (m,), and a function of tool
# points, (m, n, dimension) to (m, n); returns the largest values around the samples, (m,).
Largest = Callable[[IntArray, Callable[[FloatArray], FloatArray]], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourExecution:
    """The part of an execution on one contour (the piece), with its errors."""

    executed: Execution
    between: ToolBetween  # The tool motion between the samples of the execution
    path: Path  # Path that the tool should follow
    objective: Path | None  # Path before rounding; None if unknown
    samples: slice  # Indices of the samples of the piece
    end_time: float  # End of the piece [s]
    # First sample of the next contour: before it, the tool may still be on this path.
    next_start: int
    work: tuple[float, float]  # Arc lengths between which the coverage error is evaluated [m]
    # The range `work` on the objective path [m]; None if the objective is unknown.
    objective_work: tuple[float, float] | None = None
    offset: float = 0.0  # Length of the previous contours [m], added to arc lengths
    start_time: float | None = (
        None  # Start of the piece [s]; by default the time of its first sample
    )
    # End of the RMS interval [s]; by default `end_time`.
    rms_end_time: float | None = None

    @cached_property
    def t(self) -> FloatArray:
        """Times [s], (n,)."""
        return self.executed.t[self.samples]

    @cached_property
    def q(self) -> FloatArray:
        """Joint positions [rad], (n, dof)."""
        return self.executed.q[self.samples]

    @cached_property
    def _around(self) -> tuple[FloatArray, slice]:
        """Tool points from before the piece to the next piece [m], and the slice of the piece."""
        # The piece begins between the sample before it and its first sample.
        before = max(self.samples.start - 1, 0)
        points = self.executed.arm.tool_position(self.executed.q[before : self.next_start])
        return points, slice(self.samples.start - before, self.samples.stop - before)

    @property
    def tool(self) -> FloatArray:
        """Tool points [m], (n, dimension)."""
        points, piece = self._around
        return points[piece]

    @cached_property
    def speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        velocity = self.executed.arm.tool_velocity(self.q, self.executed.dq[self.samples])
        return length(velocity)

    @cached_property
    def followed(self) -> Followed:
        """Path points of the samples: arc lengths and distances of the tool."""
        return self._follow(self.path, self.work)

    @cached_property
    def on_path(self) -> FloatArray:
        """Positions of the samples' path points [m], (n, dimension)."""
        return self.path(self.followed.s)

    @cached_property
    def followed_objective(self) -> Followed | None:
        """Path points of the samples on the objective path; None if the objective is unknown."""
        if self.objective is None:
            return None
        if self.objective_work == self.work:
            geometry = pack_segments(self.objective.segments)
            if np.array_equal(geometry, self.followed.geometry):
                return self.followed
        return self._follow(self.objective, self.objective_work)

    def _follow(self, path: Path, work: tuple[float, float] | None) -> Followed:
        """Determine the path points of the samples on a path."""
        points, piece = self._around
        return follow_path(path, points, work=work, judged=piece)

    @cached_property
    def contour_error(self) -> ErrorProfile:
        """Profile of the distance from the tool to the path [m]."""
        side = None
        if self.path.dimension == 2:
            side = _side(self.path, self.followed, self.tool)
        return self._path_profile(self.followed, side)

    @cached_property
    def coverage_search(self) -> CoverageSearch:
        """Search for the path point that is farthest from the tool."""
        return self._coverage_search(self.path, self.work, self.followed, self.contour_error)

    @property
    def coverage_error(self) -> Coverage:
        """Largest distance from the path to the tool [m]."""
        return self.coverage_search.largest

    def speed_ratios(self, limit: float | None, *, between: bool = False) -> FloatArray:
        """Return tool speed / assigned velocity, (n,); arguments as of `measure_speed_ratios`."""
        return measure_speed_ratios(self.path, self.followed, self.speed, limit, between=between)

    def tracking_error(self, planned: FloatArray) -> ErrorProfile:
        """Return the profile of the distance to the planned position at the same time [m].

        - `planned`: planned tool positions at the samples [m], (n, dimension).
        """
        return self._over_time(length(self.tool - planned), self.followed.s)

    @property
    def model_error(self) -> tuple[float, float] | None:
        """Largest errors along and across the path due to `model_error` [m]; None if unknown."""
        model_error = self.executed.model_error
        if model_error is None:
            return None
        tangent = self.path(self.followed.s, 1)
        along, across = unexplained_errors(self.executed.arm, self.q, tangent, model_error)
        return float(along.max()), float(across.max())

    @cached_property
    def objective_error(self) -> ErrorProfile | None:
        """Profile of the distance from the tool to the objective path [m]; None if unknown."""
        followed = self.followed_objective
        if followed is None:
            return None
        if self._drawn_as_planned:
            return replace(self.contour_error, signed=None)
        return self._path_profile(followed)

    @cached_property
    def objective_search(self) -> CoverageSearch | None:
        """Search for the point of the objective path that is farthest from the tool."""
        followed = self.followed_objective
        error = self.objective_error
        if self.objective is None or followed is None or error is None:
            return None
        if self._drawn_as_planned:
            return self.coverage_search
        work = self.objective_work or (0.0, self.objective.length)
        return self._coverage_search(self.objective, work, followed, error)

    @property
    def objective_coverage_error(self) -> Coverage | None:
        """Largest distance from the objective path to the tool [m]; None if unknown."""
        search = self.objective_search
        return None if search is None else search.largest

    @property
    def drawing_error(self) -> ErrorProfile | Coverage | None:
        """The larger of `objective_error` and `objective_coverage_error`; None if unknown."""
        error = self.objective_error
        search = self.objective_search
        if error is None or search is None:
            return None
        if search.bound <= error.max:
            return error
        coverage = search.largest
        return error if error.max >= coverage.max else coverage

    @property
    def _drawn_as_planned(self) -> bool:
        """Whether the objective path is the path, so that both have the same errors."""
        return self.followed_objective is self.followed

    @property
    def orientation_error(self) -> ErrorProfile | None:
        """Profile of the angle from the required tool orientation [rad]; None if not required."""
        arm = self.executed.arm
        orientation = self.path.orientation
        if orientation is None or not isinstance(arm, SerialArm):
            return None

        def measure(i: int, t: FloatArray) -> Errors | None:
            """Return errors and arc lengths at times after sample i, (n,) each."""
            q = self._between(i, t)
            if q is None:
                return None
            tool, turned = arm.pose(q)
            s = self._nearby_errors(self.followed, i, tool)[1]
            return orientation_angles(orientation, s, turned), s

        angle = orientation_angles(orientation, self.followed.s, arm.pose(self.q)[1])
        search = partial(search_measured, measure)
        return replace(self._over_time(angle, self.followed.s, search), angular=True)

    @cached_property
    def corners(self) -> tuple[CornerDeviation, ...]:
        """Cornering deviations at the corners of the objective path; empty if unknown."""
        if self.objective is None or self.followed_objective is None:
            return ()
        judged = self.t <= self.end_time
        return corner_deviations(
            self.tool[judged],
            self.objective,
            self.followed_objective.s[judged],
            self._maximize_nearby if self._has_fine_motion else None,
        )

    def _maximize_nearby(
        self, indices: IntArray, function: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Maximize m smooth functions of the tool point, each around one sample, (m,).

        `function` maps tool points, (m, n, dimension), to values, (m, n).
        """
        m = len(indices)
        best = np.asarray(function(self.tool[indices][:, None]))[:, 0]
        # The intervals before and after each sample.
        i = np.clip(indices + np.array([[-1], [0]]), 0, len(self.t) - 2).ravel()
        fine = self.between.joints(np.unique(i) + self.samples.start)
        if fine is None:
            return best

        # `maximize_smooth` has a row per interval, and `function` a row per sample, with the times
        # of both intervals.
        def measure(t: FloatArray) -> FloatArray:
            """Return the values at times in each interval, (2 m, n)."""
            times = t.reshape(2, m, -1).swapaxes(0, 1).reshape(m, -1)
            tool = self.executed.arm.tool_position(fine(times.ravel()))
            values = np.asarray(function(tool.reshape(*times.shape, -1)))
            return values.reshape(m, 2, -1).swapaxes(0, 1).reshape(t.shape)

        largest = maximize_smooth(self.t[i], self.t[i + 1], measure).reshape(2, m).max(axis=0)
        return np.asarray(np.maximum(best, largest))

    def _coverage_search(
        self, path: Path, work: tuple[float, float], followed: Followed, error: ErrorProfile
    ) -> CoverageSearch:
        """Prepare the search for the point of a path within `work` that is farthest from the tool.

        - `work`: arc lengths between which the point may be [m].
        - `followed`: path points of the tool on this path.
        - `error`: distances from the tool to this path.
        """
        distances = followed.coverage_error
        arc_lengths = followed.coverage_error_s
        guessed = np.zeros(len(distances), dtype=bool)
        if self._has_fine_motion:
            # `follow_path` assumes straight tool motion between samples. Therefore only the
            # distances from path points of samples are exact.
            guessed = (np.abs(arc_lengths - followed.s) > ERROR_ROUNDING) & (distances >= 0)
        exact = np.where(guessed, -1.0, distances)
        i = int(np.argmax(exact))
        sampled = Coverage(
            max=max(0.0, float(exact[i])),
            t_max=float(self.t[i]),
            s_max=float(arc_lengths[i]) + self.offset,
        )
        if not self._has_fine_motion:
            candidates = list[tuple[float, int, float]]()
            return CoverageSearch(
                piece=self, path=path, distances=distances, sampled=sampled, candidates=candidates
            )
        rows = np.flatnonzero(guessed)
        bounds = (distances + self._sagitta)[rows]
        # If the path points of two successive samples are on one segment, each point between them
        # is the path point of a tool point, and its distance is at most the contour error.
        before = followed.s[rows]
        after = followed.s[np.minimum(rows + 1, len(distances) - 1)]
        segment_starts = followed.geometry[1:, 11]
        on_one_segment = np.searchsorted(segment_starts, before, "right") == np.searchsorted(
            segment_starts, after
        )
        on_one_segment &= (before < arc_lengths[rows]) & (arc_lengths[rows] < after)
        bounds[on_one_segment] = np.minimum(bounds[on_one_segment], error.max)
        rows = rows[bounds > sampled.max]
        bounds = bounds[bounds > sampled.max].tolist()
        nearest = int(np.clip(np.searchsorted(self.t, error.t_max), 0, len(self.t) - 1))
        # The path point with the largest contour error is a candidate too, because its distance
        # from the tool's motion may be equally large.
        candidates = [(error.max, nearest, error.s_max - self.offset)]
        candidates += zip(bounds, rows.tolist(), arc_lengths[rows].tolist(), strict=True)
        inside = [x for x in candidates if work[0] <= x[2] <= work[1]]
        return CoverageSearch(
            piece=self,
            path=path,
            distances=distances,
            sampled=sampled,
            candidates=sorted(inside, key=lambda x: -x[0]),
        )

    @property
    def _has_fine_motion(self) -> bool:
        """True if the plant provides the motion between samples, and there are enough samples."""
        return self.executed.plant is not None and len(self.t) > 2

    @cached_property
    def _sagitta(self) -> FloatArray:
        """Bound on the deviation of the tool's motion from a line near each sample [m], (n,)."""
        return np.pad(length(np.diff(self.tool, 2, axis=0)) / 4, 1, mode="edge")

    @cached_property
    def _travel(self) -> FloatArray:
        """Tool travel from the first sample to each sample [m], (n,)."""
        return np.append(0.0, np.cumsum(length(np.diff(self.tool, axis=0))))

    def distance_to_motion(self, point: FloatArray, i: int) -> tuple[float, float]:
        """Return the distance from a point to the motion near sample i [m], and a time [s].

        - `point`: position, (dimension,) [m].

        The time is that of the sample nearest to the point.
        """
        reach = 2 * float(length(self.tool[i] - point))
        # Range of the samples within a tool travel of `reach` before and after sample i.
        low, high = np.searchsorted(
            self._travel, self._travel[i] + np.array([-reach, reach])
        ).tolist()
        low = min(low, i)
        high = max(high, i + 1)
        k = low + int(np.argmin(length(self.tool[low:high] - point)))
        square = float(dot(self.tool[k] - point, self.tool[k] - point))
        # The intervals before and after the sample.
        before = max(k - 1, 0)
        after = min(k, len(self.t) - 2)
        motion = self.between.path(before + self.samples.start, after + self.samples.start)
        if motion is not None:
            from armcontour.verification.peak_search import nearest_between

            position = pad_to_space(point[None])[0]
            begins = self.t[before : after + 1].copy()
            ends = self.t[before + 1 : after + 2].copy()
            square = min(square, nearest_between(motion, position, begins, ends))
        return float(np.sqrt(square)), float(self.t[k])

    def _path_profile(self, followed: Followed, side: FloatArray | None = None) -> ErrorProfile:
        """Return the profile of the distances from the tool to a path [m].

        - `side`: 1 where the tool is to the left of the path, -1 to its right, (n,); None in space.
        """

        def search(i: int, begin: float, end: float, best: float) -> Peak | None:
            """Find a distance above `best` [m] between two times after sample i [s]."""
            from armcontour.verification.peak_search import search_interval

            motion = self._tool_path(i)
            if motion is None:
                return None
            ends = np.clip([i, i + 1], 0, len(followed.s) - 1)
            low, high = sorted(followed.s[ends].tolist())
            distance_bound = float(followed.distance[ends].max())
            found = search_interval(
                motion, followed.geometry, low, high, distance_bound, begin, end, best
            )
            return Peak(found.t, found.value, found.s) if found.found else None

        hidden = None
        if self._has_fine_motion:
            # Where the path turns sharply, a peak may exceed the mean of both samples by half of
            # the tool's step.
            sharp = np.flatnonzero(followed.turns(SHARP_TURN) > SHARP_TURN)
            hidden = sharp, length(self.tool[sharp + 1] - self.tool[sharp]) / 2
        return self._over_time(followed.distance, followed.s, search, side, hidden)

    def _over_time(
        self,
        values: FloatArray,
        s: FloatArray,
        search: Search | None = None,
        side: FloatArray | None = None,
        hidden: Hidden | None = None,
    ) -> ErrorProfile:
        """Return the profile of an error, with its peaks between samples.

        - `values`: errors at the samples [m or rad], (n,).
        - `s`: arc lengths of the path points of the samples [m], (n,).
        - `search`: searches the error between samples; None to use samples only.
        - `side`: 1 where the tool is to the left of the path, -1 to its right, (n,).
        - `hidden`: intervals in which the error may have a peak that no sample shows.
        """
        peak = None
        if self._has_fine_motion and search is not None:
            start_time = float(self.t[0]) if self.start_time is None else self.start_time
            end_time = min(self.end_time, float(self.executed.t[-1]))
            peak = find_peak(
                self.t, values, search, start_time=start_time, end_time=end_time, hidden=hidden
            )
        if peak is not None:
            peak = peak._replace(s=peak.s + self.offset)
        return ErrorProfile.over_time(
            self.t, values, s + self.offset, self.end_time, side, peak, self.rms_end_time
        )

    def _between(self, i: int, t: FloatArray) -> FloatArray | None:
        """Return q at times between samples i and i + 1 [rad], (n, dof); None if unknown."""
        index = self.samples.start + i
        inside = 0 <= index < len(self.executed.t) - 1
        fine = self.between.joints(np.array([index])) if inside else None
        return None if fine is None else fine(t)

    def _tool_path(self, i: int) -> ToolPath | None:
        """Return the tool motion from sample i to the next; None if unknown."""
        if i not in self._paths:
            index = self.samples.start + i
            inside = 0 <= index < len(self.executed.t) - 1
            self._paths[i] = self.between.path(index, index) if inside else None
        return self._paths[i]

    @cached_property
    def _paths(self) -> dict[int, ToolPath | None]:
        """Cache: index of a sample in the piece -> tool motion to the next sample."""
        return {}

    def _nearby_errors(self, followed: Followed, i: int, tool: FloatArray) -> Errors:
        """Return distances and arc lengths of tool points after sample i [m], (n,) each."""
        ends = np.clip([i, i + 1], 0, len(followed.s) - 1)
        low, high = followed.s[ends].tolist()
        return followed.near(tool, (low, high), float(followed.distance[ends].max()))


@dataclass(frozen=True, kw_only=True, eq=False)
class CoverageSearch:
    """Search for the point of a path that is farthest from the tool (coverage error).

    Args:
        piece: The execution of the contour.
        path: The path.
        distances: Distance from the path to the tool between each sample and the next, for straight
            tool motion between samples [m], (n,).
        sampled: Largest known distance.
        candidates: Points whose distance may be larger: bound of the distance [m], index of a
            sample near the point, and its arc length [m]; the largest bound first.
    """

    piece: ContourExecution
    path: Path
    distances: FloatArray
    sampled: Coverage
    candidates: list[tuple[float, int, float]]

    @property
    def bound(self) -> float:
        """Bound of the largest distance [m], known without measuring candidates."""
        return max(self.sampled.max, self.candidates[0][0] if self.candidates else 0.0)

    @cached_property
    def largest(self) -> Coverage:
        """The largest distance."""
        piece = self.piece
        largest = self.sampled
        for bound, k, s in self.candidates:
            if bound <= largest.max * (1 + PEAK_EXCESS):
                break
            value, t = piece.distance_to_motion(self.path([s])[0], k)
            value = min(value, bound)
            if not piece.t[0] < t < piece.t[-1]:
                # Outside of the piece the tool may come nearer; `distances` includes the samples
                # there.
                value = min(value, max(float(self.distances[k]), 0.0))
            if value > largest.max:
                largest = Coverage(max=value, t_max=t, s_max=s + piece.offset)
        return largest


def largest_coverage(searches: Sequence[CoverageSearch]) -> Coverage:
    """Return the largest coverage error of several pieces; the first piece with it counts.

    Only pieces whose bound is at least the largest error found so far are measured.
    """
    order = sorted(range(len(searches)), key=lambda i: -searches[i].bound)
    best = searches[order[0]].largest
    first = order[0]
    for i in order[1:]:
        if searches[i].bound < best.max:
            break
        found = searches[i].largest
        if found.max > best.max or (found.max == best.max and i < first):
            best = found
            first = i
    return best


def tracking_errors(pieces: Sequence[ContourExecution]) -> list[ErrorProfile]:
    """Return the tracking error of each piece of an execution, see `tracking_error`.

    The plan is evaluated for many short pieces at once, because a call for each takes longer.
    """
    errors = []
    batch: list[ContourExecution] = []
    for k, piece in enumerate(pieces):
        batch.append(piece)
        if k + 1 < len(pieces) and sum(len(x.t) for x in batch) < TIMES_AT_ONCE:
            continue
        trajectory = piece.executed.set_points.trajectory
        t = np.clip(np.concatenate([x.t for x in batch]), 0.0, trajectory.duration)
        planned = piece.executed.arm.tool_position(trajectory(t))
        ends = np.cumsum([len(x.t) for x in batch])
        for one, points in zip(batch, np.split(planned, ends[:-1]), strict=True):
            errors.append(one.tracking_error(points))
        batch = []
    return errors


def settling_time(executed: Execution, speed: FloatArray) -> float:
    """Return the time from which the tool is at rest [s], at least the plan's duration.

    `speed` is the tool speed at the samples [m/s], (n,).
    """
    moving = np.flatnonzero(speed > REST_SPEED)
    last = float(executed.t[moving[-1]]) if len(moving) else 0.0
    return max(last, executed.set_points.trajectory.duration)


def evaluated_times(executed: Execution, end_time: float | None) -> tuple[float, float]:
    """Return when largest values and when RMS values of a single path end [s].

    - `end_time`: end of both; None to choose them from the execution.
    """
    if end_time is not None:
        return end_time, end_time
    # The RMS interval ends when the tool comes to rest, because samples at rest would reduce the
    # RMS. Largest values include the remaining execution, because a slow tool can still leave the
    # path.
    rest_time = settling_time(executed, executed.tool_speed)
    return max(rest_time, float(executed.t[-1])), rest_time


def split_by_contour(
    executed: Execution, path: Program, objective: Program | None, end_time: float | None
) -> list[ContourExecution]:
    """Split an execution into one piece per contour, in which the process works on the contour.

    A single path is one piece, from the first set-point to `end_time`. If `end_time` is None, the
    piece ends with the execution, and the RMS interval ends when the tool comes to rest.

    - `path`: the planned program.
    - `objective`: the program before rounding, with the same contours; None if unknown.
    """
    spans = executed.set_points.trajectory.contour_spans
    _check_contour_counts(len(spans), path, objective)
    if path.single_path is None:
        windows = [_find_window(executed, x) for x in spans]
    else:
        last, rms_end_time = evaluated_times(executed, end_time)
        windows = [_Window(slice(0, len(executed.t)), last, rms_end_time)]
    next_starts = [*(x.samples.start for x in windows[1:]), len(executed.t)]
    between = ToolBetween(executed)
    pieces = []
    for k, (contour, window) in enumerate(zip(path.contours, windows, strict=True)):
        drawn = None if objective is None else objective.contours[k]
        pieces.append(
            ContourExecution(
                executed=executed,
                between=between,
                path=contour.path,
                objective=None if drawn is None else drawn.path,
                work=contour.at_work,
                objective_work=None if drawn is None else drawn.at_work,
                samples=window.samples,
                next_start=next_starts[k],
                start_time=window.start_time,
                end_time=window.end_time,
                rms_end_time=window.rms_end_time,
                offset=window.offset,
            )
        )
    return pieces


def _check_contour_counts(count: int, path: Program, objective: Program | None) -> None:
    """Raise InvalidInput unless both programs have as many contours as the execution."""
    if len(path.contours) != count:
        raise InvalidInput(
            f"The execution has {count} contour{'s' if count != 1 else ''}, but the program has "
            f"{len(path.contours)}. Evaluate the execution with the planned program."
        )
    if objective is not None and len(objective.contours) != count:
        raise InvalidInput(
            f"The objective must have as many contours as the planned program, {count}, but has "
            f"{len(objective.contours)}."
        )


class _Window(NamedTuple):
    """Samples and times of a contour's piece, as in `ContourExecution`."""

    samples: slice
    end_time: float
    rms_end_time: float | None = None
    start_time: float | None = None
    offset: float = 0.0


def _find_window(executed: Execution, span: Span) -> _Window:
    """Find the samples of a contour, its times at work, and its offset on the path."""
    assert span.work is not None
    start, end = np.searchsorted(executed.t, span.work)
    # A piece has at least two samples, even on a very short contour.
    start = min(int(start), len(executed.t) - 2)
    samples = slice(start, max(int(end), start + 2))
    start_time, end_time = span.work
    return _Window(samples, end_time, start_time=start_time, offset=span.s[0])


def _side(path: Path, followed: Followed, tool: FloatArray) -> FloatArray:
    """Return 1 where the tool is to the left of a planar path, -1 to its right, (n,).

    - `followed`: path points of the tool.
    - `tool`: tool points [m], (n, 2).
    """
    rows = followed.geometry.T
    row = np.maximum(rows[11].searchsorted(followed.s, side="right") - 1, 0)
    x, y = (tool[:, axis] - rows[axis][row] for axis in range(2))
    a, b = (rows[3 + axis][row] for axis in range(2))
    along = x * a + y * b
    normal = y * a - x * b
    # The left side of a line is the half-plane to its left. The left side of an arc is the inside
    # of its circle if the arc turns left, and the outside if it turns right.
    to_left = rows[3] * rows[7] > rows[4] * rows[6]
    curvature = np.where(to_left, rows[9], -rows[9])[row]
    side = np.where(2 * normal < curvature * (along * along + normal * normal), -1.0, 1.0)
    corner = (followed.s == rows[11][row]) | (followed.s == path.length)
    if corner.any():
        # At a corner, the sum of both tangents decides.
        s = followed.s[corner]
        x, y = (tool[corner] - path(s)).T
        tangent = (path(s, 1) + path(s, 1, side="left")).T
        side[corner] = np.where(tangent[0] * y < tangent[1] * x, -1.0, 1.0)
    return side


@dataclass(frozen=True, slots=True, kw_only=True)
class CornerDeviation:
    """Deviations of the tool at one corner.

    Args:
        vertex: Index of the corner among the vertices of the objective path, from 0.
        point: Position of the corner [m].
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


def corner_deviations(
    tool: FloatArray, objective: Path, s: FloatArray | None = None, maximize: Largest | None = None
) -> tuple[CornerDeviation, ...]:
    """Cornering deviations at every corner of a path, from tool points (n, dimension) [m].

    - `s`: arc lengths of the path points of the tool points [m], (n,); computed if None.
    - `maximize`: finds the largest values around samples; None if the motion between samples is
      unknown.
    """
    corners = np.flatnonzero(objective.turns > TANGENT_TOLERANCE) + 1
    if not len(corners):
        return ()
    arc_lengths = objective.project(tool).s if s is None else s
    order = np.argsort(arc_lengths, kind="stable")
    arc_lengths = arc_lengths[order]
    tool = tool[order]
    # The region of a corner extends from the middle of the segment before the corner to the middle
    # of the segment after it.
    low = objective.breaks[corners] - objective.lengths[corners - 1] / 2
    high = objective.breaks[corners] + objective.lengths[corners] / 2
    region_start = np.searchsorted(arc_lengths, low)
    region_end = np.searchsorted(arc_lengths, high, side="right")
    # If no sample is in the region, take the samples before and after it.
    empty = region_start == region_end
    region_start = np.where(empty, np.maximum(region_start - 1, 0), region_start)
    region_end = np.where(empty, np.minimum(region_end + 1, len(arc_lengths)), region_end)
    corner, number = number_parts(region_end - region_start)
    sample = region_start[corner] + number
    points = objective.starts[corners]
    starts = np.cumsum(region_end - region_start) - (region_end - region_start)
    offset = tool[sample] - points[corner]
    across = _across(objective, corners)
    distances = length(offset)
    overshoots = dot(offset, across[corner])
    rounding = np.minimum.reduceat(distances, starts)
    overshoot = np.maximum.reduceat(overshoots, starts)
    if maximize is not None:
        # Only the first extreme sample of each corner is refined.
        nearest = _first_of_each_corner(distances == rounding[corner], corner)
        farthest = _first_of_each_corner(overshoots == overshoot[corner], corner)
        # An overshoot at the first or last sample of the region is no peak and is not refined.
        inner = np.flatnonzero(
            (farthest > starts) & (farthest < starts + region_end - region_start - 1)
        )
        farthest = farthest[inner]
        count = len(corners)
        targets = np.concatenate([points, points[inner]])[:, None]
        outward = across[inner][:, None]

        # Squared distances are smooth, even where the tool passes through the corner.
        def nearness_and_overshoot(points: FloatArray) -> FloatArray:
            offsets = points - targets
            nearness = -dot(offsets[:count], offsets[:count])
            return np.concatenate([nearness, np.sum(offsets[count:] * outward, axis=-1)])

        extreme_samples = order[sample[np.concatenate([nearest, farthest])]]
        extremes = maximize(extreme_samples, nearness_and_overshoot)
        rounding = np.sqrt(-extremes[:count])
        overshoot[inner] = extremes[count:]
    return tuple(
        CornerDeviation(vertex=vertex, point=tuple(point), rounding=cr, overshoot=max(0.0, co))
        for vertex, point, cr, co in zip(
            corners.tolist(), points.tolist(), rounding.tolist(), overshoot.tolist(), strict=True
        )
    )


def _first_of_each_corner(mask: BoolArray, corner: IntArray) -> IntArray:
    """Return the first index at which a mask is True, for each corner, (corners,).

    - `mask`: (m,), True at least once for each corner.
    - `corner`: number of the corner of each entry, (m,).
    """
    rows = np.flatnonzero(mask)
    return rows[np.unique(corner[rows], return_index=True)[1]]


def _across(path: Path, corners: IntArray) -> FloatArray:
    """Return the unit vectors in which overshoot at corners is measured, (corners, dimension).

    It is the part of the arriving tangent across the leaving tangent; the arriving tangent itself
    where the path turns back.

    - `corners`: indices of the corners among the vertices of the path.
    """
    before = path.segments.end_tangents[corners - 1]
    after = path.tangents[corners]
    across = before - np.sum(before * after, axis=1, keepdims=True) * after
    size = np.linalg.norm(across, axis=1, keepdims=True)
    turned = size > TANGENT_TOLERANCE
    return np.where(turned, across / np.where(turned, size, 1.0), before)


def measure_speed_ratios(
    path: Path, followed: Followed, speed: FloatArray, limit: float | None, *, between: bool = False
) -> FloatArray:
    """Return tool speed / velocity assigned at the path point, (n,); 0 if none is assigned.

    The path point of a sample is uncertain by its distance from the tool. Within this distance of a
    segment end, the larger velocity of both segments is the assigned velocity. If the assigned
    velocity changes between two samples, the linearly interpolated speed at the segment end is
    used. If `between` is True, the ratios are also bounds between samples; the bounds assume at
    most the curvature of the speed at adjacent samples and one kink.
    """
    assigned = path.assigned_speeds(limit)
    if not np.isfinite(assigned).any():
        return np.zeros(len(speed))
    high = speed + _bound_between(speed) if between else speed
    s = np.maximum.accumulate(followed.s)
    distance = followed.distance
    s_low = s - distance
    s_high = s + distance
    allowed = np.maximum(
        path.assigned_speeds(limit, s_low, side="left"), path.assigned_speeds(limit, s_high)
    )
    ratio: FloatArray = high / allowed
    before = assigned[:-1]
    after = assigned[1:]
    # Where the assigned velocity falls, the speed at the segment end counts for the first sample
    # after the end.
    falls = np.flatnonzero(after < before)
    _raise_at_segment_ends(ratio, high, s_low, path.breaks[1:-1][falls], after[falls], past=1)
    # Where the assigned velocity rises, the speed at the segment end counts for the last sample
    # before the end.
    rises = np.flatnonzero(after > before)
    _raise_at_segment_ends(ratio, high, s_high, path.breaks[1:-1][rises], before[rises], past=0)
    return ratio


def _raise_at_segment_ends(
    ratio: FloatArray,
    speed: FloatArray,
    s: FloatArray,
    joints: FloatArray,
    assigned: FloatArray,
    *,
    past: int,
) -> None:
    """Raise ratios, in place, to those at the times at which the tool passes segment ends.

    - `ratio`: speed / assigned velocity at the samples, (n,).
    - `speed`: tool speed at the samples [m/s], (n,).
    - `s`: arc lengths of the samples [m], (n,).
    - `joints`: arc lengths of the segment ends [m], (m,).
    - `assigned`: velocity on the slow side of each end [m/s], (m,).
    - `past`: 1 to raise the ratio of the sample after the end, 0 that of the sample before it.
    """
    s = np.maximum.accumulate(s)
    i = np.searchsorted(s, joints, side="right")
    inside = (i > 0) & (i < len(s))
    i = i[inside]
    joints = joints[inside]
    assigned = assigned[inside]
    step = s[i] - s[i - 1]
    fraction = (joints - s[i - 1]) / np.where(step > 0, step, 1.0)
    passing = speed[i - 1] + fraction * (speed[i] - speed[i - 1])
    np.maximum.at(ratio, i - 1 + past, passing / assigned)


def _bound_between(speed: FloatArray) -> FloatArray:
    """Bound how far the speed exceeds a sample on the way to its neighbours [m/s], (n,)."""
    if len(speed) < 3:
        return np.zeros(len(speed))
    bent = np.pad(np.abs(np.diff(speed, 2)), 1, mode="edge")
    # A parabola exceeds both ends by at most an eighth of its second difference, a kink by at most
    # a quarter of the sum of the adjacent second differences.
    pairs = (bent[1:] + bent[:-1]) / 4
    return np.asarray(np.maximum(np.append(pairs, 0.0), np.append(0.0, pairs)))


def unexplained_errors(
    arm: Arm, q: FloatArray, tangent: FloatArray, model_error: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First-order bounds of the tool error along and across the path due to joint errors [m].

    - `model_error`: largest error of each joint [rad], (dof,), assumed with the worst sign.
    - `tangent`: unit tangents of the path, (n, dimension).
    """
    tool_errors = arm.tool_jacobian(q) * model_error
    along = (tangent[:, None] @ tool_errors)[:, 0]
    across = tool_errors - tangent[:, :, None] * along[:, None]
    return abs(along).sum(axis=1), length(across.swapaxes(1, 2)).sum(axis=1)
