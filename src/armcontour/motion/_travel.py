"""Compiled bounds of the joint velocities between arc lengths."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled


@compiled()
def fastest_joints(
    breaks: FloatArray, coefficients: FloatArray, s: FloatArray, speeds: FloatArray
) -> FloatArray:
    """Bounds of the joint velocities between neighbouring arc lengths [rad/s], (n, dof).

    On each piece dq_ds is a polynomial of degree 4: over an interval it is between the least and
    the largest of its Bernstein coefficients.

    Args:
        breaks: Of the joint path [m], (pieces + 1,).
        coefficients: Of its pieces [rad], (pieces, 6, dof).
        s: Arc lengths, which do not decrease [m], (n + 1,).
        speeds: Bounds of the path speed between them [m/s], (n,).
    """
    c, last = coefficients, len(breaks) - 2
    n, dof = len(s) - 1, c.shape[2]
    found = np.empty((n, dof))
    piece = 0
    for i in range(n):
        for j in range(dof):
            found[i, j] = 0.0
        begin, end = s[i], s[i + 1]
        while piece < last and breaks[piece + 1] <= begin:
            piece += 1
        k = piece
        while True:
            # Most laws have the breaks of their joint path, and those of uniform speed may not.
            until = end if k == last else min(end, breaks[k + 1])
            width = breaks[k + 1] - breaks[k]
            x, h = (begin - breaks[k]) / width, (until - begin) / width
            for j in range(dof):
                a, b, d = c[k, 1, j], 2 * c[k, 2, j], 3 * c[k, 3, j]
                e, f = 4 * c[k, 4, j], 5 * c[k, 5, j]
                # Coefficients about the start of the interval, by repeated division by z - x.
                e += x * f
                d += x * e
                b += x * d
                a += x * b
                e += x * f
                d += x * e
                b += x * d
                e += x * f
                d += x * e
                e += x * f
                # Coefficients over 0 to 1 within it.
                b, d, e, f = h * b, h * h * d, h * h * h * e, h * h * h * h * f
                most = max(abs(a), abs(a + b / 4), abs(a + b / 2 + d / 6))
                most = max(most, abs(a + 3 * b / 4 + d / 2 + e / 4), abs(a + b + d + e + f))
                found[i, j] = max(found[i, j], most / width)
            if until >= end:
                break
            k, begin = k + 1, until
        for j in range(dof):
            found[i, j] *= speeds[i]
    return found
