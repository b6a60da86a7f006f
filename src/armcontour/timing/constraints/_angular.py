"""The compiled rows of angular acceleration: a polygon in the plane in which the tool turns."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Two vectors count as parallel if at most this share of one is at right angles to the other.
PARALLEL = 1e-9


@compiled(inner=True)
def _size(vector: FloatArray) -> float:
    """Length of a vector in space."""
    return math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@compiled(inner=True)
def _dot(a: FloatArray, b: FloatArray) -> float:
    """Scalar product of two vectors in space."""
    found: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return found


@compiled(inner=True)
def _write_cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the vector product of two vectors into a third array."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled(inner=True)
def _write_plane(w: FloatArray, dw: FloatArray, rest: FloatArray, plane: FloatArray) -> None:
    """Write two orthonormal vectors that span w and w', and their normal.

    Where w and w' span no plane, any plane that contains them.

    Args:
        w: Angular velocity at ds = 1, (3,).
        dw: Its derivative over s, (3,).
        rest: Memory, (3,).
        plane: Output: the vectors, (3, 3).
    """
    along, normal = plane[0], plane[2]
    length = _size(w)
    turning = w if length > 0.0 else dw
    length = length if length > 0.0 else _size(dw)
    for k in range(3):
        along[k] = turning[k] / length if length > 0.0 else 1.0 if k == 0 else 0.0
    part, thinnest = _dot(dw, along), 0
    for k in range(3):
        rest[k] = dw[k] - part * along[k]
        if abs(along[k]) < abs(along[thinnest]):
            thinnest = k
    if _size(rest) <= PARALLEL * _size(dw):
        # What is left is rounding only: take the axis farthest from both instead.
        for k in range(3):
            rest[k] = 1.0 if k == thinnest else 0.0
    _write_cross(along, rest, normal)
    length = _size(normal)
    for k in range(3):
        normal[k] /= length
    _write_cross(normal, along, plane[1])


@compiled(inner=True)
def _write_sides(
    vector: FloatArray, plane: FloatArray, polygon: FloatArray, out: FloatArray
) -> None:
    """Write the parts of a vector along the directions of a polygon in a plane.

    Args:
        vector: The vector, (3,).
        plane: Of `_write_plane`.
        polygon: Cosines and sines of the directions, (2, directions).
        out: Output, (directions,).
    """
    x, y = _dot(vector, plane[0]), _dot(vector, plane[1])
    for k in range(len(out)):
        out[k] = polygon[0, k] * x + polygon[1, k] * y


@compiled()
def write_rows(
    w: FloatArray,
    dw: FloatArray,
    middle_w: FloatArray,
    middle_dw: FloatArray,
    polygon: FloatArray,
    ends: FloatArray,
    middles: FloatArray,
    out: FloatArray,
) -> None:
    """Write the coefficients of `w u + w' x` along the directions of a polygon.

    The plane of the polygon is that of w and w' in the middle of an interval, and their directions
    are the same on all of it.

    Args:
        w: Angular velocity at ds = 1 at the starts and ends of all intervals, (2, n, 3).
        dw: Its derivative over s there, (2, n, 3).
        middle_w: The same as `w` in the middles, (n, 3).
        middle_dw: The same as `dw` in the middles, (n, 3).
        polygon: Cosines and sines of the directions, (2, directions).
        ends: Takes the coefficients of u, and then those of x, at the starts and ends,
            (2, 2, n, directions).
        middles: Takes them in the middles, (2, n, directions).
        out: Takes the larger parts of w and of w' at either end that leave the plane, (2, n).
    """
    plane, rest = np.empty((3, 3)), np.empty(3)
    for i in range(len(middle_w)):
        _write_plane(middle_w[i], middle_dw[i], rest, plane)
        _write_sides(middle_w[i], plane, polygon, middles[0, i])
        _write_sides(middle_dw[i], plane, polygon, middles[1, i])
        out[0, i] = out[1, i] = 0.0
        for end in range(2):
            _write_sides(w[end, i], plane, polygon, ends[0, end, i])
            _write_sides(dw[end, i], plane, polygon, ends[1, end, i])
            out[0, i] = max(out[0, i], abs(_dot(w[end, i], plane[2])))
            out[1, i] = max(out[1, i], abs(_dot(dw[end, i], plane[2])))
