"""Angle between the tool axis and gravity, which a positioner keeps small by turning the part."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.frames import exp
from armcontour.motion import JointPath
from armcontour.motion.derivative_bounds import joint_travel
from armcontour.planning.tracing.angle_check import find_excess
from armcontour.robot import Chain, SerialArm

# Fraction of the largest angle from which the angle has a cost.
INNER_TILT = 0.7


def tilt_of(chain: Chain) -> float | None:
    """Return the largest angle allowed between tool axis and gravity [rad]; None if unlimited."""
    return None if chain.positioner is None else chain.positioner.tilt


def chord_of(tilt: float) -> float:
    """Return the distance of two unit vectors at an angle [rad]."""
    return float(2 * np.sin(tilt / 2))


def turn_down(chain: Chain, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the direction of gravity in the part's frame, and its derivatives by the joints.

    Returns unit vectors, (n, 3), and derivatives, (n, floor_link, 3).

    - `q`: joint positions [rad], (n, floor_link) or more columns, which are ignored.
    """
    # `link_poses` computes all joints and takes four times as long.
    turned = np.tile(chain.base.rotation, (len(q), 1, 1))
    axes = np.empty((len(q), 0, 3))
    for k in range(chain.floor_link):
        turned = turned @ chain.rotations[k]
        # An axis that slides does not turn the part.
        axis = np.zeros(3) if chain.slides[k] else chain.axes[k]
        axes = np.concatenate([axes, (turned @ axis)[:, None]], axis=1)
        turned = turned @ exp(q[:, k, None] * axis)
    down = turned @ chain.floor.rotation @ (chain.gravity / np.linalg.norm(chain.gravity))
    return down, np.cross(axes, down[:, None])


def angles_to_gravity(arm: SerialArm, q: FloatArray) -> FloatArray:
    """Return the angles between tool axis and gravity [rad], (n,), at q [rad], (n, dof)."""
    return _angles(arm.poses(q)[..., 2], turn_down(arm.chain, q)[0])


def _angles(axes: FloatArray, down: FloatArray) -> FloatArray:
    """Return the angles between unit vectors [rad], (n,), of tool axes and gravity, (n, 3) each."""
    chord = np.linalg.norm(axes - down, axis=1)
    return np.asarray(2 * np.arcsin(np.minimum(chord / 2, 1.0)))


def check_fixed_tilt(arm: SerialArm, s: FloatArray, poses: FloatArray) -> None:
    """Raise Unreachable if a tool pose is tilted too far from gravity and no axis turns the part.

    - `s`: arc lengths of the poses [m], (n,).
    - `poses`: tool poses, (n, 3, 4).
    """
    tilt = tilt_of(arm.chain)
    if tilt is None or arm.chain.floor_link:
        return
    angles = _angles(poses[..., 2], turn_down(arm.chain, np.zeros((1, 0)))[0])
    k = int(np.argmax(angles))
    if angles[k] > tilt:
        _refuse_tilt(float(s[k]), poses[k, :, 3], float(angles[k]), tilt)


def check_tilt(joint_path: JointPath, arm: SerialArm) -> None:
    """Raise Unreachable where the tool axis is too far from gravity, at any point of the path."""
    tilt = tilt_of(arm.chain)
    if tilt is None:
        return

    # The angle changes at most by the travel of the joints that turn the tool against the floor.
    s, travel = joint_travel(joint_path)
    turned = (travel * ~arm.chain.slides)[:, arm.chain.floor_link :].sum(axis=1)
    excess = find_excess(s, turned, lambda x: angles_to_gravity(arm, joint_path(x)), tilt)
    if excess is not None:
        point = arm.poses(joint_path(excess.s))[:, 3]
        _refuse_tilt(excess.s, point, excess.angle, tilt)


def _refuse_tilt(s: float, point: FloatArray, angle: float, tilt: float) -> None:
    """Raise Unreachable for a tool axis at an angle above the tilt [rad]."""
    raise Unreachable(
        f"At {s:.6g} m along the path the tool axis is {np.degrees(angle):.4g} deg from gravity, "
        f"but the tilt of the positioner allows at most {np.degrees(tilt):.4g} deg. Allow larger "
        "ranges of its axes, do not hold them, or specify a larger tilt.",
        point=point.tolist(),
        s=s,
        limit="tilt",
        needed=angle,
        allowed=tilt,
    )
