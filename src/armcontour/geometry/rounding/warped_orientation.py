"""Orientation that turns smoothly over its own pieces, carried to a path with rounded corners."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.spline_orientation import Motion, orient_between_knots

# Number of pieces of the orientation along each curve that replaces a corner.
PIECES = 8


class _Warp:
    """Arc length on a path before rounding as a smooth function of arc length after rounding.

    A curve of length l replaces the tangent lengths t on both sides of a corner. With u from the
    start of the curve, and x = u / l, the arc length before rounding from there is

        u + (2 t - l) (10 x³ - 15 x⁴ + 6 x⁵),

    so its first derivative is 1 and its second derivative 0 at both ends of the curve.

    - `middle`: arc lengths of the corners before rounding [m], increasing, (k,).
    - `tangent`: tangent lengths [m], (k,).
    - `length`: lengths of the curves [m], (k,).
    """

    def __init__(self, middle: FloatArray, tangent: FloatArray, length: FloatArray) -> None:
        self.begin_before = middle - tangent
        self.end_before = middle + tangent
        self.excess = 2 * tangent - length
        saved = np.cumsum(self.excess)
        self.length = length
        self.begin = self.begin_before - saved + self.excess
        # Arc length after rounding minus that before, on the segment before and after each curve.
        self.shifts = -np.append(0.0, saved)

    def after(self, s: FloatArray) -> FloatArray:
        """Return arc lengths after rounding for those before rounding, outside of curves [m]."""
        return np.asarray(s + self.shifts[np.searchsorted(self.end_before, s, side="left")])

    def before(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc lengths before rounding [m], and their first and second derivative."""
        curve = np.searchsorted(self.begin, s, side="right") - 1
        u = s - self.begin[curve]
        on_curve = (curve >= 0) & (u <= self.length[curve])
        shift = self.shifts[np.clip(curve + 1, 0, None)]
        x = np.where(on_curve, u / self.length[curve], 0.0)
        excess = np.where(on_curve, self.excess[curve], 0.0)
        width = self.length[curve]
        value = np.where(
            on_curve,
            self.begin_before[curve] + u + excess * x**3 * (10 - 15 * x + 6 * x**2),
            s - shift,
        )
        slope = 1 + excess / width * 30 * x**2 * (1 - x) ** 2
        bend = excess / width**2 * 60 * x * (1 - x) * (1 - 2 * x)
        return value, slope, bend


def warp_orientation(
    orientation: Orientation, middle: FloatArray, tangent: FloatArray, length: FloatArray
) -> Orientation:
    """Return an orientation along a rounded path, which turns as smoothly as before.

    Its value in the middle of each curve is that at the corner.

    - `orientation`: the orientation along the path before rounding.
    - `middle`, `tangent`, `length`: arc lengths of the corners before rounding, tangent lengths,
      and lengths of the curves that replace them [m], (k,) each.
    """
    curved = tangent > 0
    if not curved.any():
        return orientation
    order = np.argsort(middle[curved])
    warp = _Warp(*(x[curved][order] for x in (middle, tangent, length)))
    knots = _knots(orientation, warp)
    jumping = orientation.jumps > SAME_ORIENTATION
    stops = warp.after(orientation.breaks[1:-1][(orientation.kinks > 0) | jumping])
    cuts = np.searchsorted(knots, stops - REPEATED_POINT)
    ends = [0, *cuts.tolist(), len(knots) - 1]
    motions = [_motion(orientation, warp, knots[a : b + 1]) for a, b in pairwise(ends)]
    warped = orient_between_knots(motions, axis_only=orientation.axis_only)
    return warped.with_cone(orientation.cone)


def _knots(orientation: Orientation, warp: _Warp) -> FloatArray:
    """Return the arc lengths after rounding between which the orientation is one piece [m]."""
    s = orientation.breaks
    inside = np.zeros(len(s), dtype=bool)
    curves = []
    for a, b, begin, width in zip(
        warp.begin_before, warp.end_before, warp.begin, warp.length, strict=True
    ):
        inside |= (s > a - REPEATED_POINT) & (s < b + REPEATED_POINT)
        curves.append(np.linspace(begin, begin + width, PIECES + 1))
    knots = np.sort(np.concatenate([warp.after(s[~inside]), *curves]))
    # Neighbouring curves share an end, except for rounding errors.
    return np.asarray(knots[np.append(True, np.diff(knots) > REPEATED_POINT)])


def _motion(orientation: Orientation, warp: _Warp, knots: FloatArray) -> Motion:
    """Return the motion at knots between two stops of the orientation."""
    s, slope, bend = warp.before(knots)
    s = np.clip(s, 0.0, orientation.breaks[-1])
    # The last knot can be a stop, where the motion before the stop counts.
    poses, last = (orientation(s, side=side) for side in ("right", "left"))
    rates, last_rates = (orientation.rates(s, side=side) for side in ("right", "left"))
    poses[-1] = last[-1]
    rate = rates[0]
    change = rates[1]
    rate[-1] = last_rates[0][-1]
    change[-1] = last_rates[1][-1]
    slope = slope[:, None]
    return Motion(
        s=knots,
        poses=poses,
        rates=slope * rate,
        changes=slope**2 * change + bend[:, None] * rate,
    )
