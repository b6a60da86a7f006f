"""Joint torque limits, including joint friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.timing.constraints._torque import (
    at_rest,
    dragged_rows,
    friction_on_grid,
    largest_u,
    rub,
)
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.constraints.sampled import Sampled, bulge
from armcontour.timing.constraints.second_order import refuse_excess_at_rest
from armcontour.timing.grid import Grid


class _Friction(NamedTuple):
    """Joint friction on the intervals of a grid; viscous friction at ds = 1.

    Args:
        viscous: Viscous friction at the interval ends, (2, n, dof).
        largest: Bound of the viscous friction on each interval, without sign, (n, dof).
        departs: Bound of the distance of viscous friction from its chord, (n, dof).
        sign: Direction of the joint: 1 or -1 where it certainly does not reverse on an interval,
            else 0, (n, dof).
        above: Largest Coulomb friction on each interval [N m], (n, dof).
        below: Smallest Coulomb friction on each interval [N m], (n, dof).
    """

    viscous: FloatArray
    largest: FloatArray
    departs: FloatArray
    sign: FloatArray
    above: FloatArray
    below: FloatArray


@dataclass(frozen=True, slots=True)
class _OnGrid:
    """What all passes on one grid have in common.

    Args:
        grid: The grid.
        a: Coefficients of u at the interval ends, (2, n, dof).
        b: Coefficients of x there without viscous friction, (2, n, dof).
        low: Lower limits there, less gravity and dry friction [N m], (2, n, dof).
        high: The same of the upper limits.
        friction: Joint friction; None if there is none.
    """

    grid: Grid
    a: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray
    friction: _Friction | None


class JointTorque(Constraint):
    """`|a u + b x + c + viscous q' sqrt(x) + coulomb sign(q')| <= limit` for every joint.

    Args:
        arm: The arm, with masses.
        limit: Largest torques [N m], (dof,).

    Raises:
        InvalidInput: The arm has no masses.
    """

    name = "torque"
    limit_name = "joint_torque"
    limit: FloatArray
    joints = True
    # Torques at rest, at large accelerations and at speed have similar sizes, so margins for all of
    # them at once would be large. Next to rests the binding joint changes within a few intervals,
    # and friction, a function of the root of x, changes most.
    bracketed = True

    def __init__(self, arm: Arm, limit: FloatArray) -> None:
        dynamics = arm.dynamics
        self.dynamics = dynamics
        self.limit = np.array(limit)
        self.viscous = np.array(dynamics.chain.viscous)
        self.coulomb = np.array(dynamics.chain.coulomb)
        self.curved = bool(self.viscous.any())
        self._terms = Sampled(dynamics.path_terms, sparing=True)
        self._last: _OnGrid | None = None

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """Both limits, less what the torque can rise between the ends.

        With viscous friction there is one row for each limit. A line bounds the friction from above
        for the upper limit and from below for the lower limit, while x is from `bounds.least` to
        `bounds.x`. Without bounds, viscous friction is left out.

        Raises:
            NotRealizable: A joint exceeds its limit at rest, or in arbitrarily slow motion.
        """
        if bounds is None or not self.curved:
            on = self._on(grid, path)
            return self._with_margin(grid, (on.a, on.b, on.low, on.high), None, bounds)
        return self._dragged(self._on(grid, path), bounds.least, bounds.x, bounds)

    def rows_about(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> Rows:
        """Rows with the tangents of friction at x, one x for each interval, (n,)."""
        if not self.curved:
            return self.rows(grid, path, None)
        return self._dragged(self._on(grid, path), x, x, None)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        a, b, c = self._terms.at_ends(grid)
        drag = self.viscous * path.first if self.curved else np.empty((2, 0, len(self.limit)))
        return np.asarray(largest_u(a, b, c, drag, self.limit, self.coulomb, x))

    def _on(self, grid: Grid, path: JointDerivatives) -> _OnGrid:
        """The rows of a grid without what depends on x.

        Raises:
            NotRealizable: A joint exceeds its limit at rest, or in arbitrarily slow motion.
        """
        if self._last is not None and self._last.grid is grid:
            return self._last
        a, b, c = self._terms.at_ends(grid)
        low, high, kept = at_rest(c, self.limit)
        if not kept:
            refuse_excess_at_rest(grid, self, c, (-self.limit, self.limit))
        friction = None
        if self.curved or self.coulomb.any():
            friction = self._friction(grid, path)
            if not rub(c, friction.above, friction.below, self.limit, low, high):
                self._refuse_creeping(grid, c, friction)
        self._last = _OnGrid(grid, a, b, low, high, friction)
        return self._last

    def _dragged(
        self, on: _OnGrid, least: FloatArray, most: FloatArray, bounds: Bounds | None
    ) -> Rows:
        """Rows with viscous friction bounded for x from `least` to `most`, (n,) each."""
        friction, a = on.friction, np.concatenate([on.a, on.a], axis=-1)
        assert friction is not None
        *rows, along, aside = dragged_rows(
            on.b,
            on.low,
            on.high,
            friction.viscous,
            friction.largest,
            friction.departs,
            friction.sign,
            least,
            most,
            bounds is not None,
        )
        return self._with_margin(on.grid, (a, *rows), (along, aside), bounds)

    def _with_margin(
        self,
        grid: Grid,
        rows: tuple[FloatArray, ...],
        lines: tuple[FloatArray, FloatArray] | None,
        bounds: Bounds | None,
    ) -> Rows:
        """Rows with their margin, which is zero without bounds.

        Args:
            grid: The grid.
            rows: Coefficients of u and of x, lower and upper limits, (2, n, rows) each.
            lines: What lines add to the rises of coefficients of x and of constants, (n, rows)
                each; None without lines.
            bounds: Bounds of x and u.
        """
        a, b, low, high = rows
        if bounds is None:
            return Rows(a, b, low, high, np.zeros(a.shape[1:]))
        rises = self._terms.rises(grid)
        if lines is not None:
            rise_a, rise_b, rise_c = (np.concatenate([x, x], axis=-1) for x in rises)
            rises = rise_a, rise_b + lines[0], rise_c + lines[1]
        return Rows(a, b, low, high, bulge(grid, a, b, rises, bounds))

    def _friction(self, grid: Grid, path: JointDerivatives) -> _Friction:
        """Bound the friction on every interval."""
        ends, within = np.empty(path.first.shape), np.empty((5, *path.third.shape))
        own = self.viscous, self.coulomb
        friction_on_grid(grid.width, path.first, path.third, *own, ends, within)
        return _Friction(ends, *within)

    def _refuse_creeping(self, grid: Grid, c: FloatArray, friction: _Friction) -> None:
        """Refuse torques of gravity `c` that exceed a limit together with Coulomb friction.

        Raises:
            NotRealizable: A joint exceeds its limit.
        """
        creeping = c + np.where(c > 0, friction.above, friction.below)
        when = "in the slowest motion, with friction"
        bounds = -self.limit, self.limit
        refuse_excess_at_rest(grid, self, creeping, bounds, when=when, cannot="move")
