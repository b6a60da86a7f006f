"""Joint torque limits, including joint friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.constraints.friction import TINY, Lines, chord, tangent
from armcontour.timing.constraints.sampled import Sampled, bulge, rise
from armcontour.timing.constraints.second_order import refuse_excess_at_rest
from armcontour.timing.grid import Grid

# The line above viscous friction may take this share of the torque that is left at rest. So every
# row allows rest, on which the compiled planner relies.
SHARE_AT_REST = 0.5


@dataclass(frozen=True, slots=True)
class _Friction:
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
        self.limit = limit
        self.viscous = np.asarray(dynamics.chain.viscous)
        self.coulomb = np.asarray(dynamics.chain.coulomb)
        self.curved = bool(self.viscous.any())
        self._terms = Sampled(lambda *motion: np.stack(dynamics.path_terms(*motion), axis=1))

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """Both limits, less what the torque can rise between the ends.

        With viscous friction there is one row for each limit. A line bounds the friction from above
        for the upper limit and from below for the lower limit, while x is from `bounds.least` to
        `bounds.x`. Without bounds, viscous friction is left out.

        Raises:
            NotRealizable: A joint exceeds its limit at rest, or in arbitrarily slow motion.
        """
        if bounds is None or not self.curved:
            return self._rows(grid, path, None, bounds)
        return self._rows(grid, path, (bounds.least[:, None], bounds.x[:, None]), bounds)

    def rows_about(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> Rows:
        """Rows with the tangents of friction at x, one x for each interval, (n,)."""
        near = x[:, None]
        return self._rows(grid, path, (near, near) if self.curved else None, None)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        a, b, c = np.moveaxis(self._terms.at_ends(grid), 2, 0)
        dragged = np.abs(self.viscous * path.first) * np.sqrt(x)[:, None] + self.coulomb
        room = self.limit + np.abs(c) + np.abs(b) * x[:, None] + dragged
        with np.errstate(divide="ignore"):
            return np.asarray((room / np.abs(a)).min(axis=(0, 2)))

    def _rows(
        self,
        grid: Grid,
        path: JointDerivatives,
        bracket: tuple[FloatArray, FloatArray] | None,
        bounds: Bounds | None,
    ) -> Rows:
        """Rows with friction bounded for x within a bracket; without a bracket, no viscous one."""
        a, b, c = np.moveaxis(self._terms.at_ends(grid), 2, 0)
        friction = self._friction(grid, path)
        self._refuse_at_rest(grid, c, friction)
        low, high = -self.limit - c - friction.below, self.limit - c - friction.above
        rises = self._rises(grid, (a, b, c)) if bounds is not None else None
        if bracket is None:
            return Rows(a, b, low, high, _margin(grid, a, b, rises, bounds))
        sides = []
        for sign, room in ((1.0, high), (-1.0, -low)):
            lines = _lines(friction, sign, room.min(axis=0), *bracket)
            # Where a joint reverses, its friction is at most that at its largest speed. The first
            # pass leaves this out, so that rest is allowed where gravity takes all the torque.
            most, turns = sign * friction.largest * np.sqrt(bracket[1]), friction.sign == 0
            most = most if bounds is not None else np.zeros_like(most)
            dragged = b + np.where(turns, 0.0, friction.viscous * lines.slope)
            offset = np.where(turns, most, friction.viscous * lines.offset)
            found = rises
            if rises is not None:
                along, aside = friction.departs * lines.slope, friction.departs * lines.offset
                found = (rises[0], rises[1] + along, rises[2] + aside)
            sides.append((dragged, offset, _margin(grid, a, dragged, found, bounds)))
        none = np.full(c.shape, np.inf)
        (b_up, up, margin_up), (b_down, down, margin_down) = sides
        return Rows(
            np.concatenate([a, a], axis=-1),
            np.concatenate([b_up, b_down], axis=-1),
            np.concatenate([-none, low - down], axis=-1),
            np.concatenate([high - up, none], axis=-1),
            np.concatenate([margin_up, margin_down], axis=-1),
        )

    def _rises(self, grid: Grid, ends: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """Bounds of the distance of a, b and c from their chords on every interval, (n, dof)."""
        middles = np.moveaxis(self._terms.in_middles(grid), 1, 0)
        return tuple(rise(grid, x, y) for x, y in zip(ends, middles, strict=True))

    def _friction(self, grid: Grid, path: JointDerivatives) -> _Friction:
        """Bound the friction on every interval."""
        first = np.abs(path.first)
        # Largest distance of dq_ds from its chord.
        off = grid.width[:, None] ** 2 / 8 * path.third
        one_way = (path.first[0] * path.first[1] > 0) & (first.min(axis=0) > off)
        sign = np.where(one_way, np.sign(path.first[0]), 0.0)
        largest = first.max(axis=0) + off
        coulomb = np.where(largest > 0, self.coulomb, 0.0)
        return _Friction(
            viscous=self.viscous * path.first,
            largest=self.viscous * largest,
            departs=self.viscous * off,
            sign=sign,
            above=np.where(one_way, sign, 1.0) * coulomb,
            below=np.where(one_way, sign, -1.0) * coulomb,
        )

    def _refuse_at_rest(self, grid: Grid, c: FloatArray, friction: _Friction) -> None:
        """Refuse torques `c` at rest that exceed a limit, with and without Coulomb friction.

        Raises:
            NotRealizable: A joint exceeds its limit.
        """
        bounds = -self.limit, self.limit
        refuse_excess_at_rest(grid, self, c, bounds)
        if self.coulomb.any():
            creeping = c + np.where(c > 0, friction.above, friction.below)
            when = "in the slowest motion, with friction"
            refuse_excess_at_rest(grid, self, creeping, bounds, when=when, cannot="move")


def _lines(
    friction: _Friction, sign: float, room: FloatArray, least: FloatArray, most: FloatArray
) -> Lines:
    """Lines for the root of x that bound viscous friction towards one limit.

    Args:
        friction: The friction.
        sign: 1 for the upper limit, -1 for the lower one.
        room: Torque that is left of the limit at rest [N m], (n, dof).
        least: Smallest x, (n, 1).
        most: Largest x, (n, 1).
    """
    allowed = (room > 0) & (friction.largest > 0)
    share = SHARE_AT_REST * room / np.where(allowed, friction.largest, 1.0)
    cap = np.where(allowed, np.maximum(share, TINY), np.inf)
    return tangent(least, most, cap).where(friction.sign == sign, chord(least, most))


def _margin(
    grid: Grid,
    a: FloatArray,
    b: FloatArray,
    rises: tuple[FloatArray, ...] | None,
    bounds: Bounds | None,
) -> FloatArray:
    """Margin of the torque on every interval, (n, dof); zero without bounds."""
    if rises is None or bounds is None:
        return np.zeros(a.shape[1:])
    return bulge(grid, a, b, rises, bounds)
