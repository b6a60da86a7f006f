"""Any constraint of the form `low <= a(s) dds + b(s) ds² + c(s) <= high`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms.limits import UNITS
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.constraints.sampled import bulge, rise
from armcontour.timing.grid import Grid

Coefficients = Callable[[FloatArray, str], tuple[FloatArray, FloatArray, FloatArray]]


class SecondOrder(Constraint):
    """`low <= a(s) u + b(s) x + c(s) <= high`, one row per quantity.

    Args:
        name: Name in messages.
        coefficients: Called with arc lengths (n,) and "right" or "left", the side to take at
            vertices between segments; returns a, b and c, (n, rows) each. Smooth between grid
            points.
        low: Lower bounds, (rows,).
        high: Upper bounds, (rows,).
        joints: Whether there is one row per joint.

    Raises:
        InvalidInput: A lower bound exceeds its upper bound, or their numbers differ.
    """

    def __init__(
        self,
        name: str,
        coefficients: Coefficients,
        low: npt.ArrayLike,
        high: npt.ArrayLike,
        *,
        joints: bool = False,
    ) -> None:
        self.name = name
        self.coefficients = coefficients
        self.low = _checks.lock_floats(low)
        self.high = _checks.lock_floats(high)
        if self.low.shape != self.high.shape or not (self.low <= self.high).all():
            raise InvalidInput(f"The lower bounds of {name} must be at most its upper bounds.")
        self.joints = joints

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """The bounds, less what the quantity can rise above its chord between the ends.

        Raises:
            NotRealizable: c alone breaks a bound, so that even rest is impossible there.
        """
        starts = self.coefficients(grid.s[:-1], "right")
        ends = self.coefficients(grid.s[1:], "left")
        a, b, c = (np.stack([x, y], dtype=np.float64) for x, y in zip(starts, ends, strict=True))
        refuse_excess_at_rest(grid, self, c, (self.low, self.high))
        margin = np.zeros(c.shape[1:])
        if bounds is not None:
            middle = self.coefficients((grid.s[:-1] + grid.s[1:]) / 2, "right")
            inside = [np.require(x, np.float64, ["C", "W"]) for x in middle]
            rises = tuple(rise(grid, x, y) for x, y in zip((a, b, c), inside, strict=True))
            margin = bulge(grid, a, b, rises, bounds)
        return Rows(a, b, self.low - c, self.high - c, margin)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        bounds = []
        for s, side in ((grid.s[:-1], "right"), (grid.s[1:], "left")):
            a, b, c = self.coefficients(s, side)
            room = np.maximum(self.high - c, c - self.low) + np.abs(b) * x[:, None]
            with np.errstate(divide="ignore"):
                bounds.append((room / np.abs(a)).min(axis=1))
        return np.asarray(np.min(bounds, axis=0))


def refuse_excess_at_rest(
    grid: Grid,
    constraint: Constraint,
    value: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    when: str = "even at rest",
    cannot: str = "hold itself",
) -> None:
    """Refuse a quantity that breaks its bounds at rest or in arbitrarily slow motion.

    Args:
        grid: The grid.
        constraint: The constraint with these bounds.
        value: The quantity at the starts and ends of all intervals, (2, n, rows).
        bounds: Lower and upper bounds, (rows,) each.
        when: Words of the error message: in which motion the quantity has this value.
        cannot: Words of the error message: what the arm cannot do there.

    Raises:
        NotRealizable: With the arc length, the joint, the value and the bound.
    """
    low, high = bounds
    if ((value >= low) & (value <= high)).all():
        return
    over = np.maximum(value - high, low - value)
    end, i, row = np.unravel_index(int(np.argmax(over)), over.shape)
    needed, s = float(value[end, i, row]), float(grid.s[i + end])
    allowed = float(high[row] if needed > high[row] else low[row])
    joint = int(row) + 1 if constraint.joints else None
    who = constraint.name if joint is None else f"joint {joint} {constraint.name}"
    unit = f" {UNITS[constraint.limit_name]}" if constraint.limit_name in UNITS else ""
    raise NotRealizable(
        f"At {s:.6g} m along the path the {who} is {needed:.4g}{unit} {when}, but its limit in "
        f"this plan, less any reserve, is {allowed:.4g}{unit}: the arm cannot {cannot} there.",
        s=s,
        joint=joint,
        limit=constraint.name,
        needed=needed,
        allowed=allowed,
    )
