"""Memory that plans of one thread use one after the other."""

from __future__ import annotations

import sys
import threading

import numpy as np

from armcontour._checks import FloatArray

# A block of more numbers than this (32 MB) is not kept.
MOST_KEPT = 4_000_000
# References to an unused block during the check: the attribute, the local name, the argument.
UNUSED = 3


class MemoryBlock(threading.local):
    """The memory block of the last plan, per thread, which the next plan uses again.

    At 5000 points a fresh block from the system costs as much time as all the arithmetic.
    """

    block: FloatArray | None = None

    def take(self, size: int) -> FloatArray:
        """A block of at least `size` numbers that no other object refers to."""
        block = self.block
        if block is not None and block.size >= size and sys.getrefcount(block) == UNUSED:
            return block
        block = np.empty(size)
        self.block = block if size <= MOST_KEPT else None
        return block


def take_rows(memory: MemoryBlock, n: int, rows: int) -> FloatArray:
    """Memory for the rows of n intervals, as `pack` writes them, (n, 4, rows)."""
    return memory.take(n * 4 * rows)[: n * 4 * rows].reshape(n, 4, rows)
