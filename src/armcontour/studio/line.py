"""Places along a plan: where it is drawn, with times and speeds and what limits them there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.jobs import Run
from armcontour.motion import LawAlongPath
from armcontour.planning import Explanation
from armcontour.studio.preview import Preview
from armcontour.studio.thinning import Detail, thin
from armcontour.studio.view import View

# About the largest number of points that are drawn for the speed alone; a short path needs fewer.
MOST_POINTS, LEAST_POINTS = 20_000, 1_200
# A stretch on which another limit binds is drawn if it is longer than so many errors of the line.
SEEN = 8.0
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
        ends: Index of the first place of each line, and the number of places.
    """

    points: FloatArray
    s: FloatArray
    t: FloatArray
    speed: FloatArray
    assigned: FloatArray
    ends: IntArray

    @classmethod
    def of(cls, planned: Preview, view: View, detail: Detail) -> Line:
        """The places of a plan that are seen: points of curves, and where the plan changes."""
        rows: list[tuple[FloatArray, ...]] = []
        for contour, span in zip(
            planned.path.contours, planned.trajectory.contour_spans, strict=True
        ):
            path = contour.path
            if not detail.has(view.box, path):
                continue
            assert span.trajectory is not None
            laws = [x.s for x in span.trajectory.laws if isinstance(x, LawAlongPath)]
            places = np.unique(np.concatenate([detail.places(path), *laws]))
            s = np.clip(places, 0.0, path.length)
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
        if not rows:
            rows = [(np.empty((0, planned.path.dimension)), *[np.empty(0)] * 4)]
        points, s, t, speed, assigned = (np.concatenate(x) for x in zip(*rows, strict=True))
        k, ends = detail.seen(view.drawn(points), ends)
        return cls(points[k], s[k], t[k], speed[k], assigned[k], ends)

    def thinned(self, binding: npt.NDArray[np.uint8], detail: Detail) -> IntArray:
        """Indices of places to draw: their shape, changes of what binds, extremes of the speed.

        Args:
            binding: Which limit binds from each place on, (n,).
            detail: How finely they are drawn.
        """
        shape = detail.needed(self.points, self.ends)
        weight = np.where(shape, np.inf, 0.0)
        changes = np.flatnonzero(np.diff(binding)) + 1
        # What a change is worth is the length up to the next one.
        lengths = np.diff(self.s[np.append(changes, len(self.s) - 1)])
        lengths[lengths > SEEN * detail.error] = np.inf
        weight[changes] = np.maximum(weight[changes], lengths)
        return thin(weight, [self.speed], min(MOST_POINTS, LEAST_POINTS + 2 * shape.sum()))

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


def _assigned(path: Path, s: FloatArray, this: Run) -> FloatArray:
    """Assigned velocities at arc lengths, NaN for none [m/s], (n,)."""
    own = path.speeds[path.locate(s)]
    return own if this.limits.speed is None else np.fmin(own, this.limits.speed)
