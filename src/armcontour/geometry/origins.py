"""Origins of segments: the places in a file from which segments were read, one integer each.

- 0: unknown, as for a lead.
- Below 0: the entity of a drawing, -1 for the first one in `Contour.entities`.
- Above 0: lines of a text. The lower 32 bits are the number of the first line. The upper bits are 0
  for one line, an even number `2 (N + 1)` for one line with the block number N, and an odd number
  `2 k + 1` for a segment that replaces this line and the k lines after it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import IntArray

# Number of bits of a line number.
LINE_BITS = 32
LINE_MASK = (1 << LINE_BITS) - 1
# Largest block number (N) that an origin can contain.
LARGEST_BLOCK_NUMBER = 999_999_999


def line_origin(line: int, block_number: int | None = None) -> int:
    """Return the origin of a segment that one line of a text defines.

    - `line`: number of the line, from 1.
    - `block_number`: number after the letter N of G-code, if the line has one.
    """
    if block_number is None or block_number > LARGEST_BLOCK_NUMBER:
        return line
    return line | 2 * (block_number + 1) << LINE_BITS


def entity_origins(number: IntArray | int) -> IntArray:
    """Return the origins of segments of a drawing.

    - `number`: index of each segment's entity in `Contour.entities`, from 0.
    """
    return np.asarray(-1 - np.asarray(number, dtype=np.intp))


def first_line(origin: int) -> int:
    """Return the number of the first line of an origin; 0 if it is not in a text."""
    return origin & LINE_MASK if origin > 0 else 0


def first_lines(origins: IntArray) -> IntArray:
    """Return the number of the first line of each origin, 0 if it is not in a text, (n,)."""
    return np.where(origins > 0, origins & LINE_MASK, 0)


def join_origins(first: IntArray, last: IntArray) -> IntArray:
    """Return the origins of segments that replace sequences of segments, (n,).

    If not both ends come from a text, the origin is that of the first segment.

    - `first`, `last`: origins of the first and of the last segment of each sequence, (n,).
    """
    lines = np.stack([first_lines(first), first_lines(last)])
    ends = lines + np.stack([_further_lines(first), _further_lines(last)])
    begin = lines.min(axis=0)
    further = ends.max(axis=0) - begin
    are_lines = (first > 0) & (last > 0) & (further > 0)
    return np.where(are_lines, begin | (2 * further + 1) << LINE_BITS, first)


def _further_lines(origins: IntArray) -> IntArray:
    """Return the number of lines of each origin after its first one, (n,)."""
    upper = origins >> LINE_BITS
    return np.where(upper % 2 == 1, upper // 2, 0)


def describe_origin(origin: int, entities: Sequence[str] = ()) -> str:
    """Name an origin for messages, such as "line 12 (N120)"; empty if it is unknown.

    - `entities`: names of the entities of a drawing.
    """
    if origin < 0:
        return entities[-origin - 1] if -origin <= len(entities) else ""
    if origin == 0:
        return ""
    line = origin & LINE_MASK
    upper = origin >> LINE_BITS
    if upper == 0:
        return f"line {line}"
    if upper % 2 == 1:
        return f"lines {line} to {line + upper // 2}"
    return f"line {line} (N{upper // 2 - 1})"
