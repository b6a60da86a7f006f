"""The tool point of an arm, compiled: nothing else of its pose, and few sines."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled

# Sines are continued over this angle [rad], as far as their series is exact to rounding.
NEAR_ANGLE = 0.125


class Robot(NamedTuple):
    """An arm: base and links of a planar one, or the arrays of a chain.

    `planar` has base and two links [m], (3,), and links of 0 for a chain; the others are as in
    `_chain.place`.
    """

    planar: FloatArray
    rotations: FloatArray
    positions: FloatArray
    axes: FloatArray
    base: FloatArray
    end: FloatArray


@compiled(fastmath=FUSED)
def _turn(q: float, anchors: FloatArray, j: int) -> tuple[float, float]:
    """Sine and cosine of joint j's angle, from those of an angle near by, which are kept."""
    x = q - anchors[j, 0]
    if not -NEAR_ANGLE < x < NEAR_ANGLE:
        anchors[j, 0], anchors[j, 1], anchors[j, 2] = q, math.sin(q), math.cos(q)
        return anchors[j, 1], anchors[j, 2]
    y = x * x
    s = x * (1 - y * (1 / 6 - y * (1 / 120 - y * (1 / 5040 - y * (1 / 362880)))))
    c = 1 - y * (1 / 2 - y * (1 / 24 - y * (1 / 720 - y * (1 / 40320 - y * (1 / 3628800)))))
    return anchors[j, 1] * c + anchors[j, 2] * s, anchors[j, 2] * c - anchors[j, 1] * s


@compiled(fastmath=FUSED)
def tool_in_plane(
    planar: FloatArray, q: FloatArray, anchors: FloatArray
) -> tuple[float, float, float]:
    """Tool point of a planar arm at joint positions q; the arguments are those of `tool_point`."""
    s, c = _turn(q[0], anchors, 0)
    s2, c2 = _turn(q[0] + q[1], anchors, 1)
    return planar[0] + planar[1] * s + planar[2] * s2, planar[1] * c + planar[2] * c2, 0.0


@compiled(fastmath=FUSED)
def tool_in_space(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    anchors: FloatArray,
) -> tuple[float, float, float]:
    """Tool point of a chain, from its end to its base."""
    x, y, z = end[0, 3], end[1, 3], end[2, 3]
    for j in range(len(q) - 1, -1, -1):
        s, c = _turn(q[j], anchors, j)
        a, b, d = axes[j, 0], axes[j, 1], axes[j, 2]
        along = (a * x + b * y + d * z) * (1 - c)
        x, y, z = (
            c * x + s * (b * z - d * y) + along * a,
            c * y + s * (d * x - a * z) + along * b,
            c * z + s * (a * y - b * x) + along * d,
        )
        r, p = rotations, positions
        x, y, z = (
            p[j, 0] + r[j, 0, 0] * x + r[j, 0, 1] * y + r[j, 0, 2] * z,
            p[j, 1] + r[j, 1, 0] * x + r[j, 1, 1] * y + r[j, 1, 2] * z,
            p[j, 2] + r[j, 2, 0] * x + r[j, 2, 1] * y + r[j, 2, 2] * z,
        )
    return (
        base[0, 3] + base[0, 0] * x + base[0, 1] * y + base[0, 2] * z,
        base[1, 3] + base[1, 0] * x + base[1, 1] * y + base[1, 2] * z,
        base[2, 3] + base[2, 0] * x + base[2, 1] * y + base[2, 2] * z,
    )


@compiled(fastmath=FUSED)
def tool_point(robot: Robot, q: FloatArray, anchors: FloatArray) -> tuple[float, float, float]:
    """Tool point [m] at joint positions q.

    Args:
        robot: The arm.
        q: (dof,) [rad].
        anchors: Angles near by and their sines and cosines, (dof, 3), which are kept up to date; at
            first 0, 0, 1.
    """
    r = robot
    if r.planar[1] > 0.0:
        return tool_in_plane(r.planar, q, anchors)
    return tool_in_space(r.rotations, r.positions, r.axes, r.base, r.end, q, anchors)
