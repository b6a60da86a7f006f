"""Fit of a smooth tool axis along a path to the axis that the faces at its edges prescribe."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import radians

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import angle_between, exp, shortest
from armcontour.files.model.edge_paths import EdgePath
from armcontour.files.model.tool_axis import Bisector
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.spline_orientation import AxisRun, axis_spline, turn_axes_along

# Largest angle between the tool axis and the one that the faces prescribe [rad].
AXIS_ERROR = radians(0.1)
# Axes before and after a vertex that differ by less are equal [rad].
SAME_AXIS = 1e-6
# Number of intervals with which the fit of an axis begins, and fractions at which it is compared.
FIRST_INTERVALS = 4
CHECKED = np.array([0.25, 0.5, 0.75])
# Intervals shorter than this are not halved [m].
SHORTEST = 1e-6
# A point this near to a corner is at the corner [m].
AT_CORNER = 1e-9


def orient(edge_path: EdgePath, axis: Bisector) -> Orientation:
    """Return the orientation along a path whose tool axis follows the faces.

    The axis is a cubic spline within AXIS_ERROR of the one that the faces prescribe, so its rate
    has no jumps.
    """
    run = _TargetAxis(edge_path, axis).fit()
    if angle_between(run.axes, run.axes[:1]).max() <= SAME_AXIS:
        return _constant(edge_path, run.axes[0])
    first = exp(shortest([0.0, 0.0, 1.0], run.axes[0]))
    return turn_axes_along([run], first)


def _constant(edge_path: EdgePath, axis: FloatArray) -> Orientation:
    """Return an orientation with one tool axis along a whole path."""
    orientation = edge_path.path.pointing(axis).orientation
    assert orientation is not None
    return orientation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Corner:
    """A vertex at which the prescribed axis jumps, and the axis turns from one to the other."""

    s: float  # Arc length of the vertex [m]
    turn: FloatArray  # Rotation vector of the jump [rad], (3,)
    width: float  # Length before and after the vertex over which the axis turns [m]


class _TargetAxis:
    """The tool axis that the faces prescribe along a path, with blended corners."""

    def __init__(self, edge_path: EdgePath, axis: Bisector) -> None:
        self.edge_path = edge_path
        self.axis = axis
        self.length = edge_path.path.length
        chain = edge_path.chain
        self.closed = chain.closed
        self.vertices = np.array([x.s[-1] for x in edge_path.places])
        starts = np.concatenate([axis.axes(x, np.array([0.0])) for x in chain.links])
        ends = np.concatenate([axis.axes(x, np.array([1.0])) for x in chain.links])
        # Axes after the end of each link; the last one matters for closed chains only.
        following = np.roll(starts, -1, axis=0)
        self.jumps = angle_between(ends, following)
        if not self.closed:
            self.jumps[-1] = 0.0
        self.turns = shortest(ends, following)
        self.corners = self._make_corners()

    def _make_corners(self) -> list[_Corner]:
        """Return the vertices at which the axis is blended."""
        jumping = np.flatnonzero(self.jumps > SAME_AXIS)
        corners = []
        for k in jumping.tolist():
            s = float(self.vertices[k])
            others = self.vertices[jumping[jumping != k]]
            width = min(self.axis.blend, self._room(s, others))
            corners.append(_Corner(s=s, turn=self.turns[k], width=width))
        return corners

    def _room(self, s: float, others: FloatArray) -> float:
        """Return half the distance from a corner to the next one, or the distance to an end [m]."""
        distances = np.abs(others - s)
        if not self.closed:
            return float(np.min(np.concatenate([distances / 2, [s, self.length - s]])))
        distances = np.minimum(distances, self.length - distances)
        return float(np.min(np.append(distances / 2, self.length / 2)))

    def __call__(self, s: FloatArray) -> FloatArray:
        """Return unit vectors of the axis at arc lengths [m], (n, 3)."""
        which, v = self.edge_path.locate(s)
        axes = np.empty((len(s), 3))
        for k in np.unique(which).tolist():
            on = which == k
            axes[on] = self.axis.axes(self.edge_path.chain.links[k], v[on])
        for corner in self.corners:
            axes = self._blend(corner, s, v, axes)
        return axes

    def _blend(self, corner: _Corner, s: FloatArray, v: FloatArray, axes: FloatArray) -> FloatArray:
        """Return axes that are turned near a corner.

        - `v`: fractions of the links at which the axes were computed, (n,).

        From `width` before the corner, x = 0, to `width` after it, x = 1, the share of the turn
        rises as 10 x³ - 15 x⁴ + 6 x⁵. Before the corner the axis is turned by this share, and after
        it by the share minus 1, so it is continuous, and its rate as well if that of the prescribed
        axis is.
        """
        offset = s - corner.s
        if self.closed:
            offset = (offset + self.length / 2) % self.length - self.length / 2
        near = (offset > -corner.width) & (offset < corner.width)
        if not near.any():
            return axes
        x = (offset[near] / corner.width + 1) / 2
        share = x**3 * (10 - 15 * x + 6 * x**2)
        # At the corner, the axis is that of the link before it if it belongs to the link's end.
        before = np.where(np.abs(offset) < AT_CORNER, v > 0.5, offset < 0)[near]
        rotations = exp(np.where(before, share, share - 1)[:, None] * corner.turn)
        changed = axes.copy()
        changed[near] = np.einsum("nij,nj->ni", rotations, axes[near])
        return changed

    def fit(self) -> AxisRun:
        """Return the axis along the whole path as a spline within AXIS_ERROR."""
        marks = [0.0, *self._marks(), self.length]
        spaced = [np.linspace(a, b, FIRST_INTERVALS, endpoint=False) for a, b in pairwise(marks)]
        s = np.concatenate([*spaced, [self.length]])
        axes = self(s)
        while True:
            run = AxisRun(s=s, axes=axes, periodic=self.closed)
            wide = (self._errors(run) > AXIS_ERROR) & (np.diff(s) > SHORTEST)
            if not wide.any():
                return run
            added = (s[:-1] + s[1:])[wide] / 2
            order = np.argsort(np.concatenate([s, added]))
            axes = np.concatenate([axes, self(added)])[order]
            s = np.concatenate([s, added])[order]

    def _marks(self) -> list[float]:
        """Return the arc lengths between which the axis is smooth [m], in order."""
        marks = set(self.vertices.tolist())
        for corner in self.corners:
            marks |= {corner.s - corner.width, corner.s + corner.width}
        ordered: list[float] = []
        for mark in sorted(x % self.length if self.closed else x for x in marks):
            if not ordered or mark - ordered[-1] > SHORTEST:
                ordered.append(mark)
        return [x for x in ordered if SHORTEST < x < self.length - SHORTEST]

    def _errors(self, run: AxisRun) -> FloatArray:
        """Return the angles between the prescribed axis and a run's spline, per interval [rad]."""
        spline = axis_spline(run)
        begin = run.s[:-1]
        width = np.diff(run.s)
        worst = np.zeros(len(width))
        for share in CHECKED:
            s = begin + share * width
            value = spline(s)
            value /= np.linalg.norm(value, axis=1, keepdims=True)
            worst = np.maximum(worst, angle_between(value, self(s)))
        return worst
