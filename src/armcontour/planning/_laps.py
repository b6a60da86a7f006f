"""The compiled part of MAC: laps of maximum joint acceleration from knot to knot, (18)-(20)."""

from __future__ import annotations

import math

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled

# The tool speed is not computed from a joint that moves less than this share of the fastest one.
HARDLY_MOVING = 0.01


@compiled()
def laps(
    q: FloatArray, dq_ds: FloatArray, speed: float, limit: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int, int, float]:
    """Run from the first knot towards the last, as fast as (18)-(20) allow.

    The paper does not say with which velocity a lap starts. Plain `dq + ddq h` is not damped: a
    velocity error of a joint that does not set the lap's time alternates from lap to lap, and the
    acceleration it causes grows as 1 / h. So the joint that sets the lap's time keeps its velocity,
    and the other joints take theirs from the path, (28); the step in their velocity is of second
    order in h.

    Args:
        q: Joint positions at the knots [rad], (n + 1, dof).
        dq_ds: Their derivatives along the path, of the same shape.
        speed: Tool speed at the first knot [m/s].
        limit: Largest joint accelerations [rad/s²], (dof,).

    Returns:
        Lap times (n,); tool speed at the knots (n + 1,), NaN where the pass does not come; joint
        velocities at the start of the laps and joint accelerations in them, (n, dof); the number of
        laps that keep the limit; and for the first that does not, the joint (from 0) and the
        acceleration it would need. If all keep it, the joint is -1.
    """
    n = len(q) - 1
    dof = q.shape[1]
    h = np.empty(n)
    speeds = np.full(n + 1, np.nan)
    velocity = np.empty((n, dof))
    acceleration = np.empty((n, dof))
    speeds[0] = speed
    for k in range(n):
        longest = 0.0
        slowest = -1
        for j in range(dof):
            step = q[k + 1, j] - q[k, j]
            w = dq_ds[k, j] * speeds[k]
            velocity[k, j] = w
            if step == 0.0:
                time = 2.0 * abs(w) / limit[j]
            else:
                if step < 0.0:
                    w = -w
                root = math.sqrt(w * w + 2.0 * limit[j] * abs(step))
                # (18); where its printed form would cancel, as 2 d / (w + root).
                time = 2.0 * abs(step) / (w + root) if w > 0.0 else (root - w) / limit[j]
            if time > longest:
                longest = time
                slowest = j
        h[k] = longest
        fastest = 0.0
        for j in range(dof):
            step = q[k + 1, j] - q[k, j]
            needed = 2.0 * (step - velocity[k, j] * longest) / (longest * longest)
            rounding = 8e-16 * (abs(q[k, j]) + 1e-3) / (longest * longest)
            if j != slowest and abs(needed) > limit[j] * (1 + 1e-9) + rounding:
                return h, speeds, velocity, acceleration, k, j, abs(needed)
            if abs(needed) > limit[j]:
                needed = math.copysign(limit[j], needed)
            acceleration[k, j] = needed
            fastest = max(fastest, abs(dq_ds[k + 1, j]))
        lead = slowest
        if abs(dq_ds[k + 1, lead]) < HARDLY_MOVING * fastest:
            for j in range(dof):
                if abs(dq_ds[k + 1, j]) == fastest:
                    lead = j
        handed = velocity[k, lead] + acceleration[k, lead] * longest
        speeds[k + 1] = max(handed / dq_ds[k + 1, lead], 0.0)
    return h, speeds, velocity, acceleration, n, -1, 0.0
