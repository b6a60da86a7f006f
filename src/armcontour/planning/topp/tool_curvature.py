"""Compiled speed and curvature of the tool along a joint path, at ds = 1."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernel_cache import FUSED, compiled


def speed_and_acceleration(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return speeds, and accelerations along and normal to the motion, (3, n).

    - `velocity`, `acceleration`: of the tool, (n, 2 or 3) each.
    """
    out = np.empty((3, len(velocity)))
    write_speed_and_acceleration(velocity, acceleration, out)
    return out


@compiled(fastmath=FUSED)
def write_speed_and_acceleration(
    velocity: FloatArray, acceleration: FloatArray, out: FloatArray
) -> None:
    """Write speeds, and accelerations along and normal to the motion, (3, n).

    If the tool rests, the whole acceleration counts as normal.
    """
    dimension = velocity.shape[1]
    for i in range(len(velocity)):
        square = 0.0
        product = 0.0
        for d in range(dimension):
            square += velocity[i, d] * velocity[i, d]
            product += acceleration[i, d] * velocity[i, d]
        speed = math.sqrt(square)
        inverse = 1.0 / speed if speed > 0.0 else 1.0
        along = product * inverse
        normal = 0.0
        for d in range(dimension):
            part = acceleration[i, d] - along * inverse * velocity[i, d]
            normal += part * part
        out[0, i] = speed
        out[1, i] = along
        out[2, i] = math.sqrt(normal)


@compiled(fastmath=FUSED)
def write_chords(
    inside: FloatArray, ends: FloatArray, ends_alone: BoolArray, smallest: float, chords: FloatArray
) -> None:
    """Write curvatures at both ends of intervals whose chord bounds the curvature between them.

    The values at both ends are multiplied by 1 plus twice the largest relative excess of the
    samples inside over the chord of these values.

    - `inside`: curvatures at evenly spaced fractions of n intervals, from 0 on, (samples, n).
    - `ends`: curvatures at the ends of the intervals in `ends_alone`.
    - `ends_alone`: mask of the intervals whose end is not the start of the next one, (n,).
    - `smallest`: smallest curvature that counts.
    - `chords`: output, (2, n).
    """
    samples, n = inside.shape
    alone = 0
    for i in range(n):
        begin = max(inside[0, i], smallest)
        if ends_alone[i]:
            end = max(ends[alone], smallest)
            alone += 1
        else:
            end = max(inside[0, i + 1], smallest)
        excess = 0.0
        for k in range(1, samples):
            on_chord = begin + k / samples * (end - begin)
            excess = max(excess, inside[k, i] / on_chord - 1)
        chords[0, i] = begin * (1 + 2 * excess)
        chords[1, i] = end * (1 + 2 * excess)
