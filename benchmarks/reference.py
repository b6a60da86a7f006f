"""Fixed work that gives lines without a natural peer a ratio, too.

This work never changes with the project: a plain Python loop, numpy calls on small arrays and numpy
calls on large arrays, each about a third of the time; and a function for numba to compile.
"""

from __future__ import annotations

import numpy as np

NAME = "the reference work"
COMPILED = "numba compiling the reference function"
# What both take on the machine for which the bars in seconds are [s].
SECONDS = {NAME: 12e-3, COMPILED: 2.5}
# Rounds of the plain loop.
LOOPS = 60_000
# Rounds of numpy calls on small arrays.
CALLS = 2_500
# Numbers in a large array.
LARGE = 20_000
# Rounds of numpy calls on large arrays.
LARGE_CALLS = 25


def work() -> float:
    """Do the reference work."""
    total = 0.0
    for i in range(LOOPS):
        total += (i % 7) * 0.5 - total * 1e-3
    small = np.linspace(0.1, 1.0, 12).reshape(2, 6)
    for _ in range(CALLS):
        small = np.maximum(small * 0.999, small[::-1] + 1e-3)
    large = np.linspace(0.0, 1.0, LARGE)
    for _ in range(LARGE_CALLS):
        large = np.sqrt(large * large + 1e-9) + 1e-3 * np.cos(large)
    return total + float(small.sum()) + float(np.cumsum(large)[-1])


def compile_function() -> None:
    """Let numba compile a function of loops over arrays."""
    from numba import njit

    def multiply(a, b, out):  # type: ignore[no-untyped-def]
        for i in range(a.shape[0]):
            for j in range(b.shape[1]):
                total = 0.0
                for k in range(a.shape[1]):
                    total += a[i, k] * b[k, j]
                out[i, j] = np.sqrt(abs(total)) if total < 0.0 else total
        order = np.argsort(out[0])
        return out[0][order], np.searchsorted(out[0][order], 0.5)

    square = np.eye(3)
    njit(multiply)(square, square, np.empty((3, 3)))
