"""Places along a plan: where it is drawn, with times and speeds and what limits them there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.jobs import Run
from armcontour.motion import LawAlongPath
from armcontour.studio.preview import Preview
from armcontour.studio.thinning import bends, thin
from armcontour.timing import Explanation

# Curves are drawn with points that are not farther apart than this [rad], and at most so many.
TURN, MOST_PER_ARC = 0.06, 120
# Where no limit binds, or it is not known.
NOTHING = 255


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Places along all contours of a plan.

    Args:
        points: The places [m], (n, dimension).
        s: Their arc lengths, counted over all contours [m], (n,).
        t: Times at which the tool is there [s], (n,).
        speed: Its speeds there [m/s], (n,).
        assigned: Assigned velocities there, NaN for none [m/s], (n,).
        ends: Index of the first place of each contour, and the number of places.
    """

    points: FloatArray
    s: FloatArray
    t: FloatArray
    speed: FloatArray
    assigned: FloatArray
    ends: IntArray

    @classmethod
    def of(cls, planned: Preview) -> Line:
        """The places of a plan: points of curves, and where the plan changes."""
        rows: list[tuple[FloatArray, ...]] = []
        for contour, span in zip(
            planned.path.contours, planned.trajectory.contour_spans, strict=True
        ):
            path = contour.path
            assert span.trajectory is not None
            laws = [x.s for x in span.trajectory.laws if isinstance(x, LawAlongPath)]
            s = np.clip(np.unique(np.concatenate([places_of(path), *laws])), 0.0, path.length)
            rows.append(
                (
                    path(s),
                    span.s[0] + s,
                    span.t[0] + span.trajectory.time_at(s),
                    span.trajectory.speed_at(s),
                    _assigned(path, s, planned.run),
                )
            )
        ends = np.cumsum([0, *(len(x[0]) for x in rows)])
        points, s, t, speed, assigned = (np.concatenate(x) for x in zip(*rows, strict=True))
        return cls(points, s, t, speed, assigned, ends)

    def thinned(self, binding: npt.NDArray[np.uint8], most: int) -> IntArray:
        """Indices of places to draw: ends, corners, changes of what binds, extremes of the speed.

        Args:
            binding: Which limit binds from each place on, (n,).
            most: About the largest number of them.
        """
        weight = bends(self.points)
        changes = np.flatnonzero(np.diff(binding)) + 1
        # What a change is worth is the length up to the next one.
        lengths = np.diff(self.s[np.append(changes, len(self.s) - 1)])
        weight[changes] = np.maximum(weight[changes], lengths)
        weight[self.ends[:-1]] = weight[self.ends[1:] - 1] = np.inf
        return thin(weight, [*self.points.T, self.speed], most)

    def binding(
        self, explanation: Explanation | None, limits: Sequence[Mapping[str, Any]]
    ) -> npt.NDArray[np.uint8]:
        """Index of the limit that binds from each place to the next, (n,)."""
        if explanation is None:
            return np.full(len(self.s), NOTHING, dtype=np.uint8)
        index = {x["name"]: k for k, x in enumerate(limits)}
        starts = np.array([x.s[0] for x in explanation.bindings])
        known = np.array([index.get(x.name, NOTHING) for x in explanation.bindings], np.uint8)
        which = np.searchsorted(starts, self.s, side="right") - 1
        return known[np.clip(which, 0, len(known) - 1)]


def places_of(path: Path) -> FloatArray:
    """Arc lengths of the ends of all segments, and of points on curves that look smooth [m]."""
    turns = np.abs(path.curvatures) * path.lengths
    parts = np.clip(np.ceil(turns / TURN), 1, MOST_PER_ARC).astype(np.intp)
    if len(path) == parts.sum():
        return path.breaks
    i = np.repeat(np.arange(len(path)), parts)
    k = np.arange(len(i)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(path.breaks[i] + path.lengths[i] * (k / parts[i]), path.length)


def _assigned(path: Path, s: FloatArray, this: Run) -> FloatArray:
    """Assigned velocities at arc lengths, NaN for none [m/s], (n,)."""
    own = path.speeds[path.locate(s)]
    return own if this.limits.speed is None else np.fmin(own, this.limits.speed)
