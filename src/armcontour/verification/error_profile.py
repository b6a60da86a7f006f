"""`ErrorProfile`: an error over time; the path points of the tool, from which errors follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray, kernel_array
from armcontour.core.render import Result
from armcontour.core.result import TABLE, Data, Row
from armcontour.core.sampled_data import integrate
from armcontour.core.text import format_event, short_repr
from armcontour.geometry import Orientation, Path, Projection
from armcontour.geometry.biarcs import length
from armcontour.geometry.orientation import turns_between
from armcontour.geometry.projection import distances_in_order, pack_segments, pad_to_space

# A value between samples is a peak only if it exceeds the highest sample by more than this fraction
# of the sample plus ERROR_ROUNDING.
PEAK_EXCESS = 3e-7
# Differences of errors or of arc lengths up to this are rounding errors [m or rad].
ERROR_ROUNDING = 1e-13
# Number of parts per searched interval.
SEARCH_PARTS = 32
# Largest number of subdivisions of a searched interval.
MAX_CUTS = 12
# If the path turns by more than this between two samples [rad], the error may have a peak there
# that no sample shows.
SHARP_TURN = 0.2
# Number of parts of an interval in the first search for the maximum of a smooth function, and its
# sample times as fractions of the interval.
GRID = 8
FIRST_FRACTIONS = np.arange(GRID + 1) / GRID
# Number of these searches, and by which factor their steps become shorter each time.
CLOSER_SEARCHES = 3
STEP_RATIO = 16
# Sample times of an interval, as fractions of its width.
SHARES = np.arange(SEARCH_PARTS + 1) / SEARCH_PARTS
# Sample times of the next search relative to the estimated peaks, as fractions of the width of the
# interval.
KINK_MARGIN = 0.03
AROUND = np.array([0.0, -KINK_MARGIN, KINK_MARGIN])[:, None, None]
# Smallest distance of sample times from the ends of an interval, as a fraction of its width; the
# values at the ends are known.
END_DISTANCE = 0.01
# Number of largest angles in the first batch, and growth of each further batch.
FIRST_BATCH = 100
BATCH_GROWTH = 4

# The first leash is this multiple of the largest of three lengths: the largest distance of some
# points from the path, the longest step of the tool, and SHORTEST_LENGTH. The leash is doubled
# until it suffices.
LEASH_FACTOR = 4.0
# Approximate number of points whose distances from the path determine the first leash.
LEASH_POINTS = 500
# Smallest of the lengths that determine the first leash [m].
SHORTEST_LENGTH = 1e-7
# Indices of samples after which an error may have a peak, (m,), and bounds on the height of the
# peaks above the mean of the samples on both sides, (m,).
Hidden = tuple[IntArray, FloatArray]
# Function of the index of a sample and of times in the interval after it; returns errors and arc
# lengths, (n,) each, or None if the motion is unknown.
Measure = Callable[[int, FloatArray], tuple[FloatArray, FloatArray] | None]
# Function of the index of a sample, of two times after it, and of an error; returns a larger error
# between these times, or None if there is none or if the motion is unknown.
Search = Callable[[int, float, float, float], "Peak | None"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """Largest distance from the path to the tool (coverage error).

    Args:
        max: The distance [m].
        t_max: Time at which the tool passes this path point [s].
        s_max: Arc length of this path point [m].
    """

    max: float
    t_max: float
    s_max: float


def error_rows(
    name: str,
    label: str,
    error: ErrorProfile | Coverage | None,
    rms_level: int = TABLE,
    max_level: int = TABLE,
) -> tuple[Row, ...]:
    """Make the rows of an error's RMS and maximum, at the levels `rms_level` and `max_level`."""
    if error is None:
        return (Row(name, None),)
    key = f"{name}." if name else ""
    location = format_event(error.t_max, error.s_max)
    unit = "rad" if getattr(error, "angular", False) else "m"
    largest = (
        Row(f"{key}max", error.max, unit, f"{label}, largest", location, max_level),
        Row(f"{key}t_max", error.t_max, "s"),
        Row(f"{key}s_max", error.s_max, "m"),
    )
    if isinstance(error, Coverage):
        return largest
    return (Row(f"{key}rms", error.rms, unit, f"{label}, RMS", level=rms_level), *largest)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorProfile(Result, Frozen):
    """An error over time: a distance [m], or an angle [rad].

    Between the contours of a program all columns except `t` are NaN.

    Args:
        t: Times [s], (n,).
        values: Errors [m or rad], (n,).
        signed: Errors in the plane with a sign: positive to the left of the path, negative to its
            right, (n,); None in space and for errors without a side.
        s: Arc length of the nearest point of the path [m], (n,).
        rms: Root mean square over time [m or rad].
        max: Largest value [m or rad].
        t_max: Time of the largest value [s].
        s_max: Arc length of the largest value [m].
        angular: Whether the errors are angles.
    """

    t: FloatArray
    values: FloatArray
    signed: FloatArray | None
    s: FloatArray
    rms: float
    max: float
    t_max: float
    s_max: float
    angular: bool = False

    def to_data(self) -> Data:
        """Return RMS and largest value, with time and arc length."""
        return Data("Error", error_rows("", "error", self))

    __repr__ = short_repr

    @classmethod
    def over_time(
        cls,
        t: FloatArray,
        values: FloatArray,
        s: FloatArray,
        end_time: float,
        side: FloatArray | None = None,
        peak: Peak | None = None,
        rms_end_time: float | None = None,
    ) -> ErrorProfile:
        """Make the profile from the first time to `end_time`; the last value is held to the end.

        Args:
            t: Times [s], (n,).
            values: Errors [m or rad], (n,).
            s: Arc length of the nearest point of the path [m], (n,).
            end_time: End of the profile [s].
            side: 1 to the left of the path, -1 to its right, (n,); None for errors without a side.
            peak: A higher value between the times, which is inserted into the values but not into
                the RMS; or None.
            rms_end_time: End of the time over which the RMS is taken [s]; by default `end_time`.
        """
        times, (weighted,) = _cut_at(t, end_time if rms_end_time is None else rms_end_time, values)
        t, (values, s) = _cut_at(t, end_time, values, s)
        span = float(times[-1] - times[0])
        # A profile without duration has one value.
        square = integrate(weighted**2, times) / span if span > 0 else weighted[-1] ** 2
        if peak is not None:
            # A single peak would have too large a weight in the mean.
            k = int(np.searchsorted(t, peak.t))
            t, values, s = (_insert(x, k, y) for x, y in zip((t, values, s), peak, strict=True))
            if side is not None:
                side = _insert(side, k, side[max(k - 1, 0)])
        worst = int(np.argmax(values))
        return cls(
            t=t,
            values=values,
            signed=None if side is None else values * np.append(side, side[-1:])[: len(values)],
            s=s,
            rms=float(np.sqrt(square)),
            max=float(values[worst]),
            t_max=float(t[worst]),
            s_max=float(s[worst]),
        )

    @classmethod
    def join(cls, profiles: Sequence[ErrorProfile]) -> ErrorProfile:
        """Join consecutive profiles, with a gap of NaN between them."""
        if len(profiles) == 1:
            return profiles[0]
        worst = max(profiles, key=lambda x: x.max)
        times = [float(x.t[-1] - x.t[0]) for x in profiles]
        if not sum(times) > 0:
            times = [1.0] * len(profiles)
        squares = sum(x.rms**2 * time for x, time in zip(profiles, times, strict=True))
        signed = [x.signed for x in profiles if x.signed is not None]
        return cls(
            t=np.concatenate([np.append(x.t, x.t[-1]) for x in profiles]),
            values=_with_gaps([x.values for x in profiles]),
            s=_with_gaps([x.s for x in profiles]),
            signed=_with_gaps(signed) if len(signed) == len(profiles) else None,
            rms=float(np.sqrt(squares / sum(times))),
            max=worst.max,
            t_max=worst.t_max,
            s_max=worst.s_max,
            angular=worst.angular,
        )


def _with_gaps(columns: Sequence[FloatArray]) -> FloatArray:
    """Join columns, with NaN after each."""
    return np.concatenate([np.append(x, np.nan) for x in columns])


def _cut_at(t: FloatArray, end: float, *columns: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Cut columns at a time: return the times before `end` with `end`, and the columns at them.

    - `t`, `columns`: increasing times [s] and values at them, (n,) each; constant after the last.
    """
    count = int(t.searchsorted(end))
    cut = [np.concatenate([x[:count], [np.interp(end, t, x)]]) for x in columns]
    return np.concatenate([t[:count], [end]]), cut


def _insert(values: FloatArray, k: int, value: float) -> FloatArray:
    """Insert a value before index k; for few values faster than `np.insert`."""
    return np.concatenate([values[:k], [value], values[k:]])


class Peak(NamedTuple):
    """An error at one time: time [s], value [m or rad] and arc length [m]."""

    t: float
    value: float
    s: float


def find_peak(
    t: FloatArray,
    values: FloatArray,
    search: Search,
    *,
    start_time: float,
    end_time: float,
    hidden: Hidden | None = None,
) -> Peak | None:
    """Find a value between samples that exceeds those of all samples; None if there is none.

    - `t`, `values`: times [s] and errors [m or rad] of the samples, (n,) each.
    - `search`: searches the error between samples; its index may also be -1 or n - 1, for times
      before the first and after the last sample.
    - `start_time`, `end_time`: times between which the peak may be [s].
    - `hidden`: intervals in which the error may have a peak that no sample shows.
    """
    from armcontour.verification.path_points import find_candidates

    if len(t) < 3 or (t[1:] <= t[:-1]).any():
        return None
    counts = slice(0, int(t.searchsorted(end_time, side="right")))
    sampled = float(values[counts].max(initial=-np.inf))
    best = sampled
    peak = None
    high, bound = find_candidates(kernel_array(t), kernel_array(values), _threshold(best))
    if hidden is not None and len(hidden[0]):
        sharp, excess = hidden
        high = np.append(high, sharp)
        bound = np.append(bound, (values[sharp] + values[sharp + 1]) / 2 + excess)
    # Before the first and after the last sample the slope of the adjacent interval is used.
    for i, a, b in ((-1, 0, 1), (len(t) - 1, -1, -2)):
        outside = start_time - t[0] if i < 0 else end_time - t[-1]
        if (outside < 0) == (i < 0) and outside != 0:
            rise = abs((values[b] - values[a]) / (t[b] - t[a]) * outside)
            high = np.append(high, i)
            bound = np.append(bound, values[a] + 2 * rise)
    for k in np.argsort(-bound).tolist():
        if bound[k] <= _threshold(best):
            break
        i = int(high[k])
        begin = max(float(t[i]) if i >= 0 else start_time, start_time)
        end = min(float(t[i + 1]) if i + 1 < len(t) else end_time, end_time)
        if begin < end:
            higher = search(i, begin, end, best)
            if higher is not None:
                best = higher.value
                peak = higher
    # A value that exceeds the samples only by rounding is the value of a sample.
    return peak if best > _threshold(sampled) else None


def search_measured(measure: Measure, i: int, begin: float, end: float, best: float) -> Peak | None:
    """Find an error above `best` [m or rad] between two times [s]; None if there is none.

    - `measure`: measures the error after sample `i`.
    """
    from armcontour.verification.path_points import find_tops

    peak = None
    t = np.zeros(0)
    values = np.zeros(0)
    times = begin + (end - begin) * SHARES
    for _ in range(MAX_CUTS):
        measured = measure(i, times)
        if measured is None:
            return None
        k = int(measured[0].argmax())
        if measured[0][k] > best:
            best = float(measured[0][k])
            peak = Peak(float(times[k]), best, float(measured[1][k]))
        t = np.append(t, times)
        values = np.append(values, measured[0])
        order = t.argsort(kind="stable")
        t = t[order]
        values = values[order]
        high, *guesses, bound = find_tops(t, values)
        width = t[high + 1] - t[high]
        uncertain = (bound > _threshold(best)) & (width > SEARCH_PARTS * 4 * np.spacing(t[-1]))
        if not uncertain.any():
            break
        low = t[high[uncertain]]
        width = width[uncertain]
        times = low + width * np.clip(
            np.stack(guesses)[:, uncertain] + AROUND, END_DISTANCE, 1 - END_DISTANCE
        )
        times = np.unique(times)
    return peak


def maximize_smooth(
    begin: FloatArray, end: FloatArray, measure: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return the maxima of m smooth functions between two times each, (m,), by parabolas.

    - `begin`, `end`: times between which each function is maximized [s], (m,) each.
    - `measure`: maps times, (m, n), to the values of each function at them, (m, n).
    """
    step = (end - begin) * FIRST_FRACTIONS[1]
    rows = np.arange(len(begin))
    times = begin[:, None] + (end - begin)[:, None] * FIRST_FRACTIONS
    best = np.full(len(begin), -np.inf)
    for _ in range(CLOSER_SEARCHES):
        values = measure(times)
        best = np.maximum(best, values.max(axis=1))
        k = np.clip(values.argmax(axis=1), 1, len(FIRST_FRACTIONS) - 2)
        low, top, high = (values[rows, k + side] for side in (-1, 0, 1))
        curvature = low + high - 2 * top
        shift = np.where(
            curvature < 0, (low - high) / np.where(curvature < 0, 2 * curvature, 1.0), 0.0
        )
        middle = times[rows, k] + np.clip(shift, -1, 1) * step
        step = step / STEP_RATIO
        times = middle[:, None] + step[:, None] * (FIRST_FRACTIONS - 0.5) * (
            len(FIRST_FRACTIONS) - 1
        )
        times = np.clip(times, begin[:, None], end[:, None])
    return best


def _threshold(best: float) -> float:
    """Return the value above which an error counts as larger than the best one [m or rad]."""
    return best + PEAK_EXCESS * abs(best) + ERROR_ROUNDING


def orientation_angles(orientation: Orientation, s: FloatArray, turned: FloatArray) -> FloatArray:
    """Return the angle between the tool and the required tool orientation [rad], (n,).

    If the path requires only an axis, the angle is between the tool axes. If it allows a cone
    around this axis, the result is the angle by which the tool axis is outside the cone.

    - `s`: arc lengths [m], (n,).
    - `turned`: rotation matrices of the tool, (n, 3, 3).
    """
    angles = turns_between(orientation(s), turned, axis_only=orientation.axis_only)
    return np.maximum(angles - orientation.cone, 0.0)


def smallest_angles(
    path: Path, tool: FloatArray, nearest: Projection, turned: FloatArray, reach: float
) -> FloatArray:
    """Return the smallest angle between the tool and the orientations nearby [rad], (n,).

    Where the path crosses itself, turns back or closes, the tool may follow another point of the
    path than the nearest one. The result is therefore the smallest angle at the nearest points of
    all segments, and at segment ends, within `reach` [m]. To save time, angles that cannot be the
    largest are those at the nearest point.

    - `tool`: tool points [m], (n, 3).
    - `nearest`: the nearest points of the path.
    - `turned`: rotation matrices of the tool, (n, 3, 3).
    """
    from armcontour.verification.path_points import find_path_points

    assert path.orientation is not None
    angle = orientation_angles(path.orientation, nearest.s, turned)
    geometry = pack_segments(path.segments)
    order = np.argsort(-angle)
    size = FIRST_BATCH
    done = 0
    worst = -np.inf
    while done < len(order) and angle[order[done]] > worst:
        batch = order[done : done + size]
        radius = np.maximum(reach, nearest.distance[batch])
        point, arc_lengths = find_path_points(tool[batch], geometry, radius)
        nearby_angles = orientation_angles(
            path.orientation, np.minimum(arc_lengths, path.length), turned[batch[point]]
        )
        np.minimum.at(angle, batch[point], nearby_angles)
        worst = max(worst, float(angle[batch].max()))
        done = done + size
        size = size * BATCH_GROWTH
    return angle


# Where a path crosses or repeats itself, the nearest point can be on another part of the path than
# the tool. Therefore the path point is the nearest point that is reachable along the path from the
# start without moving back, while the distance to the tool never exceeds a bound (the leash). The
# leash is the smallest bound tried with which the whole path is followed.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Followed:
    """Path points of a tool that follows a path, and coverage errors; n tool points."""

    distance: FloatArray  # Distance from the tool to its path point [m], (n,)
    s: FloatArray  # Arc length of the path point [m], (n,)
    # Largest distance from the path to the tool between each path point and the next [m], (n,); -1
    # if it was not measured because it cannot be the largest of all.
    coverage_error: FloatArray
    coverage_error_s: FloatArray  # Arc lengths of these distances [m], (n,)
    geometry: FloatArray  # Segments from `geometry.projection.pack_segments`, (rows, 15)

    def turns(self, threshold: float) -> FloatArray:
        """Angle by which the path turns from each path point to the next [rad], (n - 1,).

        To save time, all results are 0 if no turn can exceed the threshold [rad].
        """
        rows = self.geometry
        angle = (rows[:, 9] * rows[:, 10])[:, None]
        last = np.cos(angle) * rows[:, 3:6] + np.sin(angle) * rows[:, 6:9]
        corner = 2 * np.arcsin(np.minimum(length(last[:-1] - rows[1:, 3:6]) / 2, 1.0))
        ahead = np.abs(np.diff(self.s))
        if corner.max(initial=0.0) + rows[:, 9].max() * ahead.max(initial=0.0) <= threshold:
            return np.zeros(len(ahead))
        # A corner is a step of the cumulative angle over arc length.
        joints = np.repeat(np.append(rows[:, 11], rows[-1, 11] + rows[-1, 10]), 2)[1:-1]
        steps = np.zeros(len(joints))
        steps[1::2] = angle[:, 0]
        steps[2::2] = corner
        return np.asarray(np.abs(np.diff(np.interp(self.s, joints, np.cumsum(steps)))))

    def near(
        self, points: FloatArray, ends: tuple[float, float], distance_bound: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return distances and arc lengths of points between two followed ones [m], (n,) each.

        - `points`: tool points in order [m], (n, dimension).
        - `ends`: arc lengths of both followed points [m].
        - `distance_bound`: the larger distance of both followed points from the path [m].
        """
        from armcontour.verification.path_points import follow

        padded = pad_to_space(points)
        travel = float(length(points - points[0]).max())
        leash = LEASH_FACTOR * max(distance_bound, travel, SHORTEST_LENGTH)
        low, high = min(ends), max(ends)
        begins = self.geometry[:, 11]
        farthest = float(begins[-1] + self.geometry[-1, 10]) + 2 * (distance_bound + travel)
        while True:
            first = int(np.searchsorted(begins, low - leash, side="right")) - 1
            last = int(np.searchsorted(begins, high + leash, side="right"))
            rows = self.geometry[max(first, 0) : last]
            distance, s, reached, held = follow(padded, rows, high + leash, leash, len(points))
            if leash > farthest or (reached >= len(points) and not held):
                return distance, s
            leash *= 2


def follow_path(
    path: Path,
    points: FloatArray,
    *,
    work: tuple[float, float] | None = None,
    judged: slice | None = None,
) -> Followed:
    """Find the path points of a tool that follows a path, and the coverage error.

    The coverage error is evaluated between the arc lengths `work` [m], by default on the whole
    path; the first path point is at or before the first of these arc lengths. Points outside of
    `judged` count for the coverage error only.

    `points` are the tool points in order [m], (n, dimension) with n > 1.
    """
    from armcontour.verification.path_points import FollowedTool, follow, measure_coverage

    first, last = (0, len(points)) if judged is None else (judged.start, judged.stop)
    begin, end = (0.0, path.length) if work is None else work
    padded = pad_to_space(points)
    geometry = pack_segments(path.segments)
    thinned = points[: last : max(1, last // LEASH_POINTS)]
    deviation = float(distances_in_order(path.segments, geometry, thinned).max())
    # Shortest leash with which all points may be followed.
    leash = LEASH_FACTOR * max(
        deviation, float(length(np.diff(points[:last], axis=0)).max(initial=0.0)), SHORTEST_LENGTH
    )
    farthest = path.length + float(length(points - path.starts[0]).max())
    while True:
        distance, s, reached, held = follow(padded, geometry, begin, leash, last)
        if leash > farthest or (reached >= last and not held):
            break
        leash *= 2
    followed = slice(0, max(reached, 2))
    chords = length(np.diff(padded[followed], axis=0))
    later = np.minimum.accumulate(s[followed][::-1])[::-1].copy()
    motion = FollowedTool(padded[followed], distance[followed], s[followed], chords, later)
    coverage_error, coverage_s = measure_coverage(motion, geometry, begin, min(end, path.length))
    # Coverage errors outside of the judged points count at the first or last judged point.
    selected = slice(first, last)
    for index, others in ((first, slice(0, first)), (last - 1, slice(last, None))):
        if len(coverage_error[others]) and coverage_error[others].max() > coverage_error[index]:
            worst = int(np.argmax(coverage_error[others])) + others.start
            coverage_error[index] = coverage_error[worst]
            coverage_s[index] = coverage_s[worst]
    return Followed(
        distance=distance[selected],
        s=s[selected],
        coverage_error=coverage_error[selected],
        coverage_error_s=coverage_s[selected],
        geometry=geometry,
    )
