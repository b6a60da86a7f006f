"""Memory of a plan, which its passes use one after the other."""

from __future__ import annotations

import threading

import numpy as np

from armcontour._checks import FloatArray

# A block of more numbers than this (32 MB) is not kept for the next plan.
MOST_KEPT = 4_000_000


class _Spare(threading.local):
    """The block that the last plan of a thread has left; None while a plan has it."""

    block: FloatArray | None = None


class Workspace:
    """Memory for the rows of one plan, to be used in a `with` statement.

    A plan takes over the block of the plan before it: at 5000 points a fresh block from the system
    costs as much time as the arithmetic.
    """

    _spare = _Spare()

    def __enter__(self) -> Workspace:
        self._block, self._spare.block = self._spare.block, None
        return self

    def __exit__(self, *exception: object) -> None:
        block, self._block = self._block, None
        if block is not None and block.size <= MOST_KEPT:
            self._spare.block = block

    def rows(self, n: int, count: int) -> FloatArray:
        """Memory for `count` rows of n intervals, as `pack` writes them, (n, 4, count).

        The memory given before is given again.
        """
        size = 4 * n * count
        if self._block is None or self._block.size < size:
            self._block = np.empty(size)
        return self._block[:size].reshape(n, 4, count)
