"""Joint torque limits, friction of the joints included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.constraints.friction import TINY, Lines, chord, tangent
from armcontour.timing.constraints.sampled import Sampled, bulge, rise
from armcontour.timing.constraints.second_order import refuse_at_rest
from armcontour.timing.grid import Grid

# The line above viscous friction may take this part of what is left of a limit at rest: rest stays
# a state that every row allows, on which the kernel relies.
SHARE_AT_REST = 0.5


@dataclass(frozen=True, slots=True)
class _Friction:
    """What friction adds to both limits on the intervals of a grid.

    Args:
        viscous: Viscous friction at ds = 1, at the interval ends, (2, n, dof).
        largest: Bound of its amount all along each interval, (n, dof).
        departs: Bound of what it departs from its chord, (n, dof).
        sign: 1 or -1 where a joint certainly turns one way all along an interval, else 0, (n, dof).
        above: Largest Coulomb friction on each interval, (n, dof).
        below: Smallest Coulomb friction on each interval, (n, dof).
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
        arm: The arm, whose masses are known.
        limit: Largest torques [N m], (dof,).

    Raises:
        InvalidInput: The arm's masses are not known.
    """

    name = "torque"
    limit_name = "joint_torque"
    limit: FloatArray
    joints = True
    # Torques at rest, of large accelerations and at speed are of one size, so that margins for all
    # of them at once would be large. From rest, other joints come to bind within a few intervals,
    # and friction, which goes with the root of x, changes most.
    bracketed = True

    def __init__(self, arm: Arm, limit: FloatArray) -> None:
        dynamics = arm.dynamics
        self.limit = limit
        self.viscous = np.asarray(dynamics.chain.viscous)
        self.coulomb = np.asarray(dynamics.chain.coulomb)
        self.curved = bool(self.viscous.any())
        self._terms = Sampled(lambda *motion: np.stack(dynamics.path_terms(*motion), axis=1))

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """Both limits, drawn in by what the torque can rise between the ends.

        With viscous friction there is a row for each limit: lines bound the friction, from above
        for one and from below for the other, while x is from `bounds.least` to `bounds.x`. Without
        bounds viscous friction is left out.

        Raises:
            NotRealizable: The arm cannot hold itself, or cannot even creep.
        """
        if bounds is None or not self.curved:
            return self._rows(grid, path, None, bounds)
        return self._rows(grid, path, (bounds.least[:, None], bounds.x[:, None]), bounds)

    def rows_about(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> Rows:
        """Tangents of the friction at x, one per interval, stand for it: for a plan near that."""
        near = x[:, None]
        return self._rows(grid, path, (near, near) if self.curved else None, None)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        a, b, c = np.moveaxis(self._terms.at_ends(grid)[0], 1, 0)
        dragged = np.abs(self.viscous * path.first[0]) * np.sqrt(x)[:, None] + self.coulomb
        room = self.limit + np.abs(c) + np.abs(b) * x[:, None] + dragged
        with np.errstate(divide="ignore"):
            return np.asarray((room / np.abs(a)).min(axis=1))

    def _rows(
        self,
        grid: Grid,
        path: JointDerivatives,
        bracket: tuple[FloatArray, FloatArray] | None,
        bounds: Bounds | None,
    ) -> Rows:
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
            # Where a joint turns round, its friction is at most what it is at its fastest. The
            # first pass leaves that out, lest rest itself be refused where gravity takes it all.
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
        """What a, b and c depart from their chords on every interval, (n, dof) each."""
        middles = np.moveaxis(self._terms.in_middles(grid), 1, 0)
        return tuple(rise(grid, x, y) for x, y in zip(ends, middles, strict=True))

    def _friction(self, grid: Grid, path: JointDerivatives) -> _Friction:
        first = np.abs(path.first)
        # A quintic is off its chord by at most this.
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
        bounds = -self.limit, self.limit
        refuse_at_rest(grid, self, c, bounds)
        if self.coulomb.any():
            creeping = c + np.where(c > 0, friction.above, friction.below)
            when = "in the slowest motion, with friction"
            refuse_at_rest(grid, self, creeping, bounds, when=when, cannot="move")


def _lines(
    friction: _Friction, sign: float, room: FloatArray, least: FloatArray, most: FloatArray
) -> Lines:
    """Lines of the root of x that make friction no less than it is towards one limit.

    Args:
        friction: The friction.
        sign: 1 for the upper limit, -1 for the lower one.
        room: What is left of the limit at rest, (n, dof).
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
    if rises is None or bounds is None:
        return np.zeros(a.shape[1:])
    return bulge(grid, a, b, rises, bounds)
