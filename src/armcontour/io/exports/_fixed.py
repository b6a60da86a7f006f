"""The compiled text of numbers with a fixed number of decimals, rounded as Python rounds them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Numbers of fewer units of their last decimal are exact. They have at most sixteen digits.
MOST_UNITS = 2.0**53
# Most characters of such a number: its digits, a sign and a point.
LONGEST = 18
# Splits a number in two halves of its digits, the products of which are exact.
HALVES = 2.0**27 + 1.0
ZERO, MINUS, POINT = ord("0"), ord("-"), ord(".")

ByteArray = npt.NDArray[np.uint8]


@compiled(inner=True)
def _count_units(size: float, units: float) -> int:
    """A size in units of the last decimal, rounded exactly; from a tie to even.

    Dekker's product: the rounded one, and what the rounding left out.

    Args:
        size: The size, below MOST_UNITS.
        units: How many units are 1.
    """
    product = size * units
    high, unit = HALVES * size, HALVES * units
    high -= high - size
    unit -= unit - units
    low, rest = size - high, units - unit
    left = high * unit - product + high * rest + low * unit + low * rest
    found = int(product)
    # The sign of the sum is exact.
    beyond = (product - found - 0.5) + left
    return found + (1 if beyond > 0.0 or (beyond == 0.0 and found % 2) else 0)


@compiled()
def write_rows(
    values: FloatArray, texts: ByteArray, ends: IntArray, decimals: int, out: ByteArray
) -> int:
    """Write rows of numbers and of the texts before, between and after them.

    Args:
        values: The numbers, (n, columns).
        texts: The texts of one row, one after the other.
        ends: Their ends, (columns + 1,).
        decimals: How many each number has.
        out: Takes the characters.

    Returns:
        How many these are; -1 if a number has too many digits or is none.
    """
    one = 10**decimals
    at = 0
    for i in range(len(values)):
        begin = 0
        for k in range(len(ends)):
            for place in range(begin, ends[k]):
                out[at] = texts[place]
                at += 1
            begin = ends[k]
            if k == values.shape[1]:
                break
            size = abs(values[i, k])
            if not size * one < MOST_UNITS:
                return -1
            if math.copysign(1.0, values[i, k]) < 0.0:
                out[at] = MINUS
                at += 1
            left = _count_units(size, float(one))
            last, beyond = at + decimals + 1, 10 * one
            while left >= beyond:
                last, beyond = last + 1, 10 * beyond
            for place in range(last, at - 1, -1):
                if place == last - decimals:
                    out[place] = POINT
                else:
                    out[place] = ZERO + left % 10
                    left //= 10
            at = last + 1
    return at
