"""Path points of a tool that follows a path, and the coverage error."""

# Where a path crosses or repeats itself, the nearest point can be on another part of the path than
# the tool. Therefore the path point is the nearest point that is reachable along the path from the
# start without moving back, while the distance to the tool never exceeds a bound (the leash). The
# leash is the smallest bound tried with which the whole path is followed.

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path
from armcontour.geometry.biarcs import length
from armcontour.geometry.projection import find_nearest, pack_segments, pad_to_space

# The first leash is SLACK times the largest of these: the largest distance of about SOME points
# from the path, the longest step of the tool, and SHORTEST [m]. The leash is doubled until it
# suffices.
SLACK = 4.0
SOME = 500
SHORTEST = 1e-7


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
        """Angle by which the path turns from each path point to the next [rad], (n - 1,)."""
        # To save time, all results are 0 if no turn can exceed the threshold [rad].
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
        steps[1::2], steps[2::2] = angle[:, 0], corner
        return np.asarray(np.abs(np.diff(np.interp(self.s, joints, np.cumsum(steps)))))

    def near(
        self, points: FloatArray, ends: tuple[float, float], distance_bound: float
    ) -> tuple[FloatArray, FloatArray]:
        """Distances and arc lengths [m], (n,) each, of tool points between two followed points."""
        # points: (n, dimension) [m]. ends: arc lengths of both followed points [m].
        from armcontour.verification.kernels import follow

        padded = pad_to_space(points)
        travel = float(length(points - points[0]).max())
        leash = SLACK * max(distance_bound, travel, SHORTEST)
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
    """Find the path points of a tool that follows a path, and the coverage error."""
    # points: tool points in order [m], (n, dimension) with n > 1. The coverage error is evaluated
    # between the arc lengths `work` [m], by default on the whole path; the first path point is at
    # or before the first of these arc lengths. Points outside of `judged` count for the coverage
    # error only.
    from armcontour.verification.kernels import FollowedTool, follow, measure_coverage

    first, last = (0, len(points)) if judged is None else (judged.start, judged.stop)
    begin, end = (0.0, path.length) if work is None else work
    padded, geometry = pad_to_space(points), pack_segments(path.segments)
    some = points[: last : max(1, last // SOME)]
    deviation = float(find_nearest(path.segments, some, in_order=True).distance.max())
    # Shortest leash with which all points may be followed.
    leash = SLACK * max(
        deviation, float(length(np.diff(points[:last], axis=0)).max(initial=0.0)), SHORTEST
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
    selected = slice(first, last)
    for index, others in ((first, slice(0, first)), (last - 1, slice(last, None))):
        if len(coverage_error[others]) and coverage_error[others].max() > coverage_error[index]:
            worst = int(np.argmax(coverage_error[others])) + others.start
            coverage_error[index], coverage_s[index] = coverage_error[worst], coverage_s[worst]
    return Followed(
        distance=distance[selected],
        s=s[selected],
        coverage_error=coverage_error[selected],
        coverage_error_s=coverage_s[selected],
        geometry=geometry,
    )
