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
from armcontour.robot.chain import floor_poses

# Fraction of the largest angle from which the angle has a cost.
INNER_TILT = 0.7
# Number of samples of the positions of the positioner at the start of a path.
TILT_SAMPLES = 400
# Largest number of positions of the positioner that are found at the start of a path.
MAX_POSITIONS = 6
# Smallest distance of two of these positions: largest difference of a joint [rad].
DISTINCT_TILTS = 0.5
# Number of iterations by which the positioner levels a pose at the start.
START_ROUNDS = 50
# Number of iterations by which the positioner levels every other pose.
ROUNDS = 3
# Damping of the steps of these iterations [rad^-2].
TILT_DAMPING = 1e-3


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


def level_positions(arm: SerialArm, axis: FloatArray) -> FloatArray:
    """Find positions of a positioner with the smallest tool tilt, (k, floor_link) [rad].

    - `axis`: tool axis in the frame of the part, (3,).
    """
    count = arm.chain.floor_link
    lower, upper = (x[:count] for x in arm.limits.joint_range(arm.dof))
    low = np.maximum(lower, -np.pi)
    high = np.minimum(upper, np.pi)
    samples = low + np.random.default_rng(0).uniform(size=(TILT_SAMPLES, count)) * (high - low)
    tried = _level(arm, samples, axis, START_ROUNDS)
    chords = np.linalg.norm(turn_down(arm.chain, tried)[0] - axis, axis=1)
    allowed = chord_of(tilt_of(arm.chain) or np.pi)
    order = np.argsort(chords, kind="stable")
    found: list[FloatArray] = []
    for k in order[chords[order] <= max(allowed, chords.min() + 1e-9)]:
        if all(np.abs(tried[k] - x).max() > DISTINCT_TILTS for x in found):
            found.append(tried[k])
        if len(found) == MAX_POSITIONS:
            break
    return np.array(found)


def follow_level(arm: SerialArm, axes: FloatArray, start: FloatArray) -> FloatArray:
    """Return the positions of a positioner along a path [rad], (n, k, floor_link).

    Each of the k rows follows the tool axis downwards from its start.

    - `axes`: tool axes along the path in the frame of the part, (n, 3).
    - `start`: positions at the start [rad], (k, floor_link).
    """
    profile = np.empty((len(axes), *start.shape))
    profile[0] = start
    for i in range(1, len(axes)):
        profile[i] = _level(arm, profile[i - 1], axes[i], ROUNDS)
    return profile


def _level(arm: SerialArm, positions: FloatArray, axis: FloatArray, rounds: int) -> FloatArray:
    """Turn a tool axis downwards by damped least-squares steps within the positioner's range.

    Returns the positions of the positioner after the last step [rad], (k, floor_link).

    - `positions`: first positions [rad], (k, floor_link).
    - `axis`: tool axis in the frame of the part, (3,).
    - `rounds`: number of steps.
    """
    count = arm.chain.floor_link
    q = positions.copy()
    lower, upper = (x[:count] for x in arm.limits.joint_range(arm.dof))
    for _ in range(rounds):
        down, by_joint = turn_down(arm.chain, q)
        square = by_joint @ np.swapaxes(by_joint, 1, 2) + TILT_DAMPING * np.eye(count)
        q += np.linalg.solve(square, by_joint @ (axis - down)[..., None])[..., 0]
        np.clip(q, lower, upper, out=q)
    return q


def poses_from_floor(arm: SerialArm, poses: FloatArray, positions: FloatArray) -> FloatArray:
    """Return tool poses in the frame of the floor, (n, 3, 4), at positions of a positioner.

    - `poses`: tool poses in the frame of the part, (n, 3, 4).
    - `positions`: (n, floor_link) [rad].
    """
    chain = arm.chain
    q = np.pad(positions, ((0, 0), (0, arm.dof - positions.shape[1])))
    floor = floor_poses(chain, q)
    moved = poses.copy()
    moved[..., 3] -= floor[..., 3]
    return np.ascontiguousarray(np.swapaxes(floor[..., :3], 1, 2) @ moved)


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
