"""Any constraint of the form `low <= a(s) dds + b(s) ds² + c(s) <= high`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, kernel_array
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.planning.constraints.base import Constraint
from armcontour.planning.grid import Grid
from armcontour.planning.topp.limits import Form
from armcontour.planning.topp.on_grid import OnGrid
from armcontour.robot.limits import UNITS

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

    @checked
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
        bounds = (checks.shaped(f"bounds of {name}", x, (None,)) for x in (low, high))
        self.low, self.high = map(checks.frozen_array, bounds)
        if self.low.shape != self.high.shape or not (self.low <= self.high).all():
            raise InvalidInput(f"The lower bounds of {name} must be at most its upper bounds.")
        self.joints = joints

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """The name, with the joint of each row if there is one per joint."""
        return [(self.name, k) for k in range(len(self.low))] if self.joints else super().names

    def _at(self, s: FloatArray, side: str) -> FloatArray:
        """The coefficients at arc lengths, (3, n, rows)."""
        name, shape = f"coefficients of {self.name}", (3, len(s), len(self.low))
        return checks.shaped(name, checks.check_numbers(name, self.coefficients(s, side)), shape)

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The quantities.

        Raises:
            NotRealizable: c alone breaks a bound, so that even rest is impossible there.
        """
        path, last = OnGrid(path.grid, jumps=True), 2 * len(path)
        _, s = path.places
        a, b, c = np.concatenate([self._at(s[:last], "right"), self._at(s[last:], "left")], axis=1)
        check_rest(path.grid, self, path.at_ends(c), (self.low, self.high))
        return (path.rows((a, b, c), kernel_array(self.low), kernel_array(self.high)),)


def check_rest(
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
        value: The quantity at the starts and ends of all intervals, (n, 2, rows).
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
    i, end, row = np.unravel_index(int(np.argmax(over)), over.shape)
    needed, s = float(value[i, end, row]), float(grid.s[i + end])
    allowed = float(high[row] if needed > high[row] else low[row])
    joint = int(row) if constraint.joints else None
    who = constraint.name if joint is None else f"joint {joint + 1} {constraint.name}"
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
