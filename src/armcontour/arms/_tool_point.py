"""Compiled computation of the tool point alone, with few evaluations of sines and cosines."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour._checks import FloatArray
from armcontour._kernels import FUSED, compiled

# Up to this angle [rad] from a known angle, sine and cosine come from a series, which is exact to
# rounding there.
NEAR_ANGLE = 0.125


class Robot(NamedTuple):
    """An arm as arrays: the lengths of a planar arm, or the arrays of a chain.

    `planar` holds the position of the base and the two link lengths [m], (3,); the lengths are 0
    for a chain. The other arrays are those of `_chain.write_kinematics`.
    """

    planar: FloatArray
    rotations: FloatArray
    positions: FloatArray
    axes: FloatArray
    base: FloatArray
    end: FloatArray


@compiled(inner=True, fastmath=FUSED)
def _sine_and_cosine(q: float, anchors: FloatArray, j: int) -> tuple[float, float]:
    """Sine and cosine of joint j's angle q, from the stored sine and cosine of an angle near q.

    Row j of `anchors` stores that angle, its sine and its cosine; it is updated if q is too far.
    """
    x = q - anchors[j, 0]
    if not -NEAR_ANGLE < x < NEAR_ANGLE:
        anchors[j, 0], anchors[j, 1], anchors[j, 2] = q, math.sin(q), math.cos(q)
        return anchors[j, 1], anchors[j, 2]
    y = x * x
    s = x * (1 - y * (1 / 6 - y * (1 / 120 - y * (1 / 5040 - y * (1 / 362880)))))
    c = 1 - y * (1 / 2 - y * (1 / 24 - y * (1 / 720 - y * (1 / 40320 - y * (1 / 3628800)))))
    return anchors[j, 1] * c + anchors[j, 2] * s, anchors[j, 2] * c - anchors[j, 1] * s


@compiled(inner=True, fastmath=FUSED)
def tool_in_plane(
    planar: FloatArray, q: FloatArray, anchors: FloatArray
) -> tuple[float, float, float]:
    """Tool point [m] of a planar arm; the arguments are those of `tool_point`."""
    s, c = _sine_and_cosine(q[0], anchors, 0)
    s2, c2 = _sine_and_cosine(q[0] + q[1], anchors, 1)
    return planar[0] + planar[1] * s + planar[2] * s2, planar[1] * c + planar[2] * c2, 0.0


@compiled(inner=True, fastmath=FUSED)
def tool_in_space(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    anchors: FloatArray,
) -> tuple[float, float, float]:
    """Tool point [m] of a chain, computed from its end to its base.

    The arrays of the chain are those of `Robot`; q and anchors are those of `tool_point`.
    """
    x, y, z = end[0, 3], end[1, 3], end[2, 3]
    for j in range(len(q) - 1, -1, -1):
        s, c = _sine_and_cosine(q[j], anchors, j)
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


@compiled(inner=True, fastmath=FUSED)
def tool_point(robot: Robot, q: FloatArray, anchors: FloatArray) -> tuple[float, float, float]:
    """Tool point [m] at one joint position.

    Args:
        robot: The arm.
        q: Joint positions [rad], (dof,).
        anchors: For each joint an angle with its sine and cosine, (dof, 3), updated when the joint
            moves far from the angle; 0, 0, 1 before the first call.
    """
    r = robot
    if r.planar[1] > 0.0:
        return tool_in_plane(r.planar, q, anchors)
    return tool_in_space(r.rotations, r.positions, r.axes, r.base, r.end, q, anchors)
