"""Laws along joint paths that are evaluated together: the motion of a program has thousands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion._laws import Motion, joint_motions, path_motions, place_times
from armcontour.motion.laws import PathLaw


@dataclass(frozen=True, slots=True)
class JoinedLaws:
    """Several laws as one table, with a row for every break, also for the last one of a law.

    Args:
        starts: Start times of the laws [s], (laws,).
        rows: Rows of the laws' first breaks, and the number of all rows, (laws + 1,).
        breaks: Breaks, counted from the start of each law [s], (n,).
        s: Arc lengths there [m], (n,).
        rates: The columns of `Rates` for the interval after each break, (n,) each.
        path_rows: Rows of the first breaks of the laws' joint paths, (laws + 1,).
        path_breaks: Breaks of the joint paths [m], (m,).
        coefficients: Their coefficients after each break, (m, 6, dof).
    """

    starts: FloatArray
    rows: IntArray
    breaks: FloatArray
    s: FloatArray
    rates: tuple[FloatArray, ...]
    path_rows: IntArray
    path_breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def of(cls, laws: Sequence[PathLaw], starts: FloatArray) -> JoinedLaws:
        """The table of some laws with their start times [s]."""
        paths = [x.joint_path for x in laws]
        return cls(
            starts=starts,
            rows=_first_rows([x.breaks for x in laws]),
            breaks=_join([x.breaks for x in laws]),
            s=_join([x.s for x in laws]),
            rates=tuple(_join_padded([x.rates[k] for x in laws]) for k in range(4)),
            path_rows=_first_rows([x.breaks for x in paths]),
            path_breaks=_join([x.breaks for x in paths]),
            coefficients=_join_padded([x.coefficients for x in paths]),
        )

    def motion(
        self, law: IntArray, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> tuple[FloatArray, ...]:
        """Joint positions or derivatives over time, (n, dof) for each order.

        Args:
            law: The law of each time, (n,).
            t: Times [s], (n,).
            side: "right" or "left": the interval to which a break belongs.
            orders: The orders, from 0 to 3.
        """
        local = np.empty(len(t))
        after = int(side == "right")
        row = place_times(law, t, after, self.starts, self.rows, self.breaks, local)
        for x in (row, local):
            x.setflags(write=False)
        along = path_motions(row, local, self.breaks, self.s, *self.rates)
        dof = self.coefficients.shape[2]
        found = Motion(*(np.empty((len(t) if k in orders else 0, dof)) for k in range(4)))
        begin, end = _locked(self.s[row]), _locked(self.s[row + 1])
        tables = self.path_rows, self.path_breaks, self.coefficients
        joint_motions(along, begin, end, law, *tables, found)
        return tuple(found[k] for k in orders)


def _locked(values: FloatArray) -> FloatArray:
    """An array made read-only: all that a kernel is compiled for."""
    values.setflags(write=False)
    return values


def _join(parts: list[FloatArray]) -> FloatArray:
    """Arrays one after the other."""
    return _locked(np.concatenate(parts))


def _join_padded(parts: list[FloatArray]) -> FloatArray:
    """Arrays one after the other, with a row of zeros after each."""
    zero = np.zeros((1, *parts[0].shape[1:]))
    return _join([x for part in parts for x in (part, zero)])


def _first_rows(parts: list[FloatArray]) -> IntArray:
    """The row at which each of several arrays begins, and the number of all rows."""
    return np.cumsum([0, *(len(x) for x in parts)], dtype=np.intp)
