"""Any constraint of the form `low <= a(s) dds + b(s) ds² + c(s) <= high`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.grid import Grid

Coefficients = Callable[[FloatArray, str], tuple[FloatArray, FloatArray, FloatArray]]

# The rise above the chord is seen in the middle of an interval; it counts this many times.
MARGIN = 2.0


class SecondOrder(Constraint):
    """`low <= a(s) u + b(s) x + c(s) <= high`, one row per quantity; joint torque is of this form.

    Args:
        name: What people call it.
        coefficients: Called with arc lengths (n,) and "right" or "left", the side to take at joints
            between segments; returns a, b and c, (n, rows) each. Smooth between grid points.
        low: Lower bounds, (rows,).
        high: Upper bounds, (rows,).
        joints: Whether there is one row per joint.

    Raises:
        InvalidInput: Bounds that do not fit each other.
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
        self.low = _checks.locked(low)
        self.high = _checks.locked(high)
        if self.low.shape != self.high.shape or not (self.low <= self.high).all():
            raise InvalidInput(f"The lower bounds of {name} must be at most its upper bounds.")
        self.joints = joints

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """The bounds, drawn in by what the left side can rise between the ends.

        Raises:
            NotRealizable: c alone breaks a bound: the arm could not even rest there.
        """
        starts = self.coefficients(grid.s[:-1], "right")
        ends = self.coefficients(grid.s[1:], "left")
        a, b, c = (np.stack([x, y]) for x, y in zip(starts, ends, strict=True))
        self._refuse_at_rest(grid, c)
        bulge = np.zeros(c.shape[1:])
        if bounds is not None:
            middle = self.coefficients((grid.s[:-1] + grid.s[1:]) / 2, "right")
            # a, b and c rise as seen in the middle; products of two slopes come on top.
            rise_a, rise_b, rise_c = (
                MARGIN * np.abs(m - v.mean(axis=0)) for m, v in zip(middle, (a, b, c), strict=True)
            )
            mixed = np.abs(b[1] - b[0]) * grid.width[:, None] / 2
            bulge = rise_a * bounds.u[:, None] + rise_b * bounds.x[:, None] + rise_c
            bulge += mixed * bounds.u[:, None]
            skew = np.abs(bounds.skew * grid.width)[:, None]
            bulge += skew / 4 * (np.abs(a[1] - a[0]) + np.abs(b).max(axis=0) * grid.width[:, None])
        return Rows(a, b, self.low - c, self.high - c, bulge)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        a, b, c = self.coefficients(grid.s[:-1], "right")
        room = np.maximum(self.high - c, c - self.low) + np.abs(b) * x[:, None]
        with np.errstate(divide="ignore"):
            return np.asarray((room / np.abs(a)).min(axis=1))

    def _refuse_at_rest(self, grid: Grid, c: FloatArray) -> None:
        over = np.maximum(c - self.high, self.low - c)
        if (over <= 0).all():
            return
        end, i, row = np.unravel_index(int(np.argmax(over)), over.shape)
        value = float(c[end, i, row])
        allowed = float(self.high[row] if value > self.high[row] else self.low[row])
        s = float(grid.s[i + end])
        joint = int(row) + 1 if self.joints else None
        who = f"joint {joint} {self.name}" if joint else self.name
        raise NotRealizable(
            f"At {s:.6g} m along the path the {who} is {value:.4g} even at rest, but its limit is "
            f"{allowed:.4g}: the arm cannot hold itself there.",
            s=s,
            joint=joint,
            limit=self.name,
            needed=value,
            allowed=allowed,
        )
