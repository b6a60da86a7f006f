"""Rows of numbers as text, as Python's % operator writes them, by a compiled function."""

from __future__ import annotations

import re

import numpy as np

from armcontour.core.checks import ByteArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled

# A number in the % format of a row, with its decimals.
NUMBER = re.compile(r"%\.([1-9]\d*)f")
# Largest value of a number without its point: all digits of a float below 2^52 are exact.
MOST = 2.0**52
# Characters of a number below MOST: 16 digits, its sign and its point.
LONGEST = 18
# Splits a float into two halves of 26 bits (Veltkamp): 2^27 + 1.
SPLITTER = 134217729.0
MINUS = ord("-")
POINT = ord(".")
ZERO = np.uint64(ord("0"))
TEN = np.uint64(10)


class RowForm:
    """The % format of a row of numbers.

    Args:
        row: The format, with numbers such as `%.7f`.
    """

    def __init__(self, row: str) -> None:
        self._row = row
        parts = NUMBER.split(row)
        # The texts before each number, and after the last one.
        self._texts = parts[::2]
        self._decimals = np.array([int(x) for x in parts[1::2]], dtype=np.int64)

    @property
    def numbers(self) -> int:
        """How many numbers a row has."""
        return len(self._decimals)

    def write(self, values: FloatArray) -> str:
        """Return rows as text; `values` are their numbers, (n, numbers)."""
        return self._row * len(values) % tuple(values.ravel().tolist())

    def write_compiled(self, values: FloatArray) -> str:
        """Return the same text as `write`; for many rows, this takes a fifth of the time."""
        scales = np.asarray(10.0**self._decimals, dtype=np.float64)
        values = np.ascontiguousarray(values)
        if not (np.abs(values) * scales < MOST).all():
            # A number has more digits than the compiled function writes, or is not finite.
            return self.write(values)
        texts = [x.replace("%%", "%").encode() for x in self._texts]
        starts = np.append(0, np.cumsum([len(x) for x in texts]))
        text = np.frombuffer(b"".join(texts), dtype=np.uint8)
        row_size = len(text) + LONGEST * self.numbers
        out = np.empty(len(values) * row_size, dtype=np.uint8)
        size = write_numbers(values, scales, self._decimals, text, starts, out)
        return out[:size].tobytes().decode()


@compiled(inner=True)
def rounded_product(
    x: float,  # A number that is not negative
    scale: float,  # A power of ten
) -> int:
    """Return the integer nearest to the exact product, the even one of two.

    The rounding error of the product is computed exactly (Dekker, 1971).
    """
    product = x * scale
    # Halves of both factors, whose products are exact.
    shifted = SPLITTER * x
    x_high = shifted - (shifted - x)
    x_low = x - x_high
    shifted = SPLITTER * scale
    scale_high = shifted - (shifted - scale)
    scale_low = scale - scale_high
    error = x_high * scale_high - product
    error += x_high * scale_low
    error += x_low * scale_high
    error += x_low * scale_low
    # The exact product is `whole + 0.5 + beyond + error`.
    whole = int(product)
    beyond = (product - whole) - 0.5
    if beyond > -error or (beyond == -error and whole % 2 == 1):
        whole += 1
    return whole


@compiled()
def write_numbers(
    values: FloatArray,  # Numbers of the rows, (n, m)
    scales: FloatArray,  # Powers of ten by which the numbers of a row are integers, (m,)
    decimals: IntArray,  # Their exponents, (m,)
    text: ByteArray,  # Characters of a row without its numbers
    starts: IntArray,  # Where the text before each number and after the last begins, and ends
    out: ByteArray,  # Output: characters of all rows
) -> int:
    """Write rows of numbers with fixed decimals; return the number of characters."""
    place = 0
    last = values.shape[1]
    for i in range(values.shape[0]):
        for j in range(last + 1):
            # The text before the number, or after the last number.
            for k in range(starts[j], starts[j + 1]):
                out[place] = text[k]
                place += 1
            if j == last:
                continue
            x = values[i, j]
            if np.signbit(x):
                out[place] = MINUS
                place += 1
            number = np.uint64(rounded_product(abs(x), scales[j]))
            # At least one digit is before the point.
            count = decimals[j] + 1
            limit = np.uint64(10 * scales[j])
            while number >= limit:
                count += 1
                limit *= TEN
            # The digits from the last to the first.
            end = place + count + 1
            point = end - 1 - decimals[j]
            for k in range(end - 1, place - 1, -1):
                if k == point:
                    out[k] = POINT
                    continue
                tenth = number // TEN
                out[k] = ZERO + (number - TEN * tenth)
                number = tenth
            place = end
    return place
