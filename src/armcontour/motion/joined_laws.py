"""Evaluation of many path laws at once, because a call for each law of a long program is slow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion.kernels import JointDerivatives, joint_motions, path_motions
from armcontour.motion.laws import PathLaw


@dataclass(frozen=True, slots=True, eq=False)
class JoinedLaws:
    """Path laws one after the other in common arrays.

    Args:
        first: Index of the first interval of each law among the breaks, and the number of breaks,
            (laws + 1,). A law of n intervals has n + 1 breaks.
        begins: Start time of each law [s], (laws,).
        times: Times of the breaks since the start of the trajectory [s], (m,).
        columns: Breaks of the laws since their starts [s], and s, ds, dds, slope and jerk of
            `PathLaw`, (m,) each; rates after the last interval of a law are zero.
        path_first: Index of the first break of each law's joint path, and the number of these
            breaks, (laws + 1,).
        path_breaks: Breaks of the joint paths [m], (k,).
        coefficients: Coefficients after each of these breaks, (k, 6, dof); zero after the last
            break of a joint path.
    """

    first: IntArray
    begins: FloatArray
    times: FloatArray
    columns: tuple[FloatArray, ...]
    path_first: IntArray
    path_breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def join(cls, laws: list[PathLaw], begins: FloatArray) -> JoinedLaws:
        """Join laws that begin at the times `begins` [s], (laws,)."""
        first = _offsets([len(x.breaks) for x in laws])
        paths = [x.joint_path for x in laws]
        path_first = _offsets([len(x.breaks) for x in paths])
        breaks = np.concatenate([x.breaks for x in laws])
        columns = [breaks, np.concatenate([x.s for x in laws])]
        # Every row is written but the one after the last interval of each law.
        used = np.ones(len(breaks), dtype=np.bool_)
        used[first[1:] - 1] = False
        for k in range(len(laws[0].rates)):
            column = np.zeros(len(breaks))
            column[used] = np.concatenate([x.rates[k] for x in laws])
            columns.append(column)
        path_breaks = np.concatenate([x.breaks for x in paths])
        pieces = np.ones(len(path_breaks), dtype=np.bool_)
        pieces[path_first[1:] - 1] = False
        coefficients = np.zeros((len(path_breaks), *paths[0].coefficients.shape[1:]))
        coefficients[pieces] = np.concatenate([x.coefficients for x in paths])
        # The kernels are compiled for read-only arrays.
        for values in (*columns, path_breaks, coefficients):
            values.setflags(write=False)
        return cls(
            first=first,
            begins=begins,
            times=np.repeat(begins, np.diff(first)) + breaks,
            columns=tuple(columns),
            path_first=path_first,
            path_breaks=path_breaks,
            coefficients=coefficients,
        )

    def path_motion(self, law: IntArray, t: FloatArray, side: str) -> tuple[IntArray, FloatArray]:
        """Return the intervals of times, (n,), and s, ds, dds and ddds at them, (4, n).

        Args:
            law: Index of the law of each time, (n,).
            t: Times since the start of the trajectory [s], (n,).
            side: "right" or "left": the interval to which a break belongs.
        """
        breaks = self.columns[0]
        side_of_break: Any = side
        i = np.searchsorted(self.times, t, side=side_of_break) - 1
        i = np.clip(i, self.first[law], self.first[law + 1] - 2)
        law_t = np.clip(t - self.begins[law], breaks[i], breaks[i + 1])
        i.setflags(write=False)
        law_t.setflags(write=False)
        return i, path_motions(i, law_t, *self.columns)

    def motion(
        self, law: IntArray, t: FloatArray, side: str, orders: tuple[int, ...]
    ) -> tuple[FloatArray, ...]:
        """Return joint positions or derivatives by the chain rule, (n, dof) for each order.

        Args:
            law: Index of the law of each time, (n,).
            t: Times since the start of the trajectory [s], (n,).
            side: "right" or "left": the interval to which a break belongs.
            orders: Requested orders, 0 for the positions.
        """
        i, along = self.path_motion(law, t, side)
        end = self.columns[1][i + 1]
        end.setflags(write=False)
        dof = self.coefficients.shape[2]
        counts = [len(t) if k in orders else 0 for k in range(4)]
        out = JointDerivatives(*(np.empty((n, dof)) for n in counts))
        joint_motions(along, end, law, self.path_first, self.path_breaks, self.coefficients, out)
        return tuple(out[k] for k in orders)


def _offsets(counts: list[int]) -> IntArray:
    """Return where each part begins among all, and the total number, (parts + 1,)."""
    return np.append(0, np.cumsum(counts)).astype(np.intp)
