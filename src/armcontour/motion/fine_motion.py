"""The motion of the joints between two results of an execution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._quintics import evaluate, quintic


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineMotion:
    """Joint motion as polynomials between nodes, with the velocities on both sides of each node.

    Args:
        t: Times of the nodes [s], (n,); the same time twice where one stretch ends and another
            one begins.
        q: Joint positions [rad], (n, dof).
        before: Joint velocities before each node [rad/s], (n, dof).
        after: Joint velocities after each node [rad/s], (n, dof).
        ddq: Joint accelerations, which do not jump [rad/s²], (n, dof): the polynomials are
            quintics; None for cubics.
    """

    t: FloatArray
    q: FloatArray
    before: FloatArray
    after: FloatArray
    ddq: FloatArray | None = None

    def __call__(self, t: FloatArray) -> FloatArray:
        """Joint positions at times between the nodes of a stretch [rad], (len(t), dof)."""
        nodes = self.t
        i: Any = slice(0, 1)
        if len(nodes) > 2:
            i = np.minimum(nodes[1:-1].searchsorted(t, side="right"), len(nodes) - 2)
        widths = nodes[1:] - nodes[:-1]
        if self.ddq is not None:
            begin = self.q[:-1], self.after[:-1], self.ddq[:-1]
            end = self.q[1:], self.before[1:], self.ddq[1:]
            return evaluate(quintic(widths, begin, end)[i], widths[i], t - nodes[:-1][i], 0)
        width = widths[i, None]
        x = (t[:, None] - nodes[:-1][i, None]) / width
        rise = (self.q[1:] - self.q[:-1])[i]
        first, last = width * self.after[:-1][i], width * self.before[1:][i]
        bend = first + last - 2 * rise
        rest = x * (rise - first - bend + x * bend)
        return np.asarray(self.q[:-1][i] + x * (first + rest))

    @classmethod
    def through(
        cls, t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray | None, which: IntArray
    ) -> FineMotion:
        """The motion from each of some results to the next one, by polynomials.

        Args:
            t: Times of all results [s], (n,).
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof), or None.
            which: Indices of the results before, increasing, (m,).
        """
        i = (which[:, None] + np.arange(2)).ravel()
        rate = dq[i]
        bend = None if ddq is None else ddq[i]
        return cls(t=t[i], q=q[i], before=rate, after=rate, ddq=bend)
