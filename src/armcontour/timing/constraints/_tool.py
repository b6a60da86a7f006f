"""The compiled part of tool limits: speed and acceleration of the tool at ds = 1."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def measure(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Speed, and acceleration at right angles to the motion and along it, without sign, (3, n).

    Args:
        velocity: Velocities of the tool, (n, dimension).
        acceleration: Accelerations of the tool, (n, dimension).
    """
    n, dimension = velocity.shape
    found = np.empty((3, n))
    for i in range(n):
        square = along = across = 0.0
        for k in range(dimension):
            square += velocity[i, k] * velocity[i, k]
        speed = math.sqrt(square)
        for k in range(dimension):
            along += acceleration[i, k] * (velocity[i, k] / speed)
        for k in range(dimension):
            across += (acceleration[i, k] - along * (velocity[i, k] / speed)) ** 2
        found[0, i], found[1, i], found[2, i] = speed, math.sqrt(across), abs(along)
    return found
