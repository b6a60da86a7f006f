"""Tool poses that a path in space prescribes, and their derivatives along the arc length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Orientation, Path, RoundedPath
from armcontour.geometry.rounding import OUT_OF_PLANE
from armcontour.planning.tracing.knots import Knots
from armcontour.robot import SerialArm

# Jumps of the orientation below this are rounding errors [rad].
NO_JUMP = 1e-8
# A pose is out of reach if the tool stays farther away than this [m].
OUT_OF_REACH = 1e-7
# If the tool turns faster than this where the arm seems singular, the turning is the cause [rad/m].
TOO_FAST = 1e5


def task_dimension(path: Path, arm: SerialArm) -> int:
    """Number of the 6 degrees of freedom of the tool that the path prescribes.

    The task dimension is 6 (position and orientation), 5 (position and tool axis) or 3 (position).

    Raises:
        InvalidInput: The path lies in a plane; it has no orientation, though the arm has more than
            3 joints; the task dimension exceeds the number of joints; or the orientation jumps.
    """
    if path.dimension != 3:
        raise InvalidInput(
            f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} "
            f"moves in {arm.dimension}."
        )
    orientation = path.orientation
    if orientation is None:
        _refuse_position_only(arm)
        return 3
    task = 5 if orientation.axis_only else 6
    if task > arm.dof:
        raise InvalidInput(
            f"The arm {arm.name} has {arm.dof} joints, but a tool "
            f"{'axis' if task == 5 else 'orientation'} in space needs {task}"
            f"{'; leave turning about the tool axis free with axis_only' if arm.dof == 5 else ''}."
        )
    if not orientation.constant and (orientation.jumps > NO_JUMP).any():
        _refuse_jump(path, orientation)
    return task


def _refuse_position_only(arm: SerialArm) -> None:
    """Refuse an arm that cannot follow a path without orientation.

    Raises:
        InvalidInput: The arm does not have 3 joints.
    """
    if arm.dof > 3:
        raise InvalidInput(
            f"The path has no tool orientation, but the arm {arm.name} needs one: give the path an "
            "orientation (in a job, path.orientation; in Python, path.oriented(rotation), or "
            "path.pointing(direction) if only the tool axis matters)."
        )
    if arm.dof < 3:
        raise InvalidInput(
            f"The arm {arm.name} has {arm.dof} joints, but a path in space needs 3: describe "
            "an arm that moves in a plane by an arm file of two links."
        )


def _refuse_jump(path: Path, orientation: Orientation) -> None:
    """Raise InvalidInput for the first jump of the orientation, with its cause and remedy."""
    jumps = orientation.jumps
    i = int(np.argmax(jumps > NO_JUMP))
    s = float(orientation.breaks[i + 1])
    helps = "round a sharp corner: round the corner, with an angular tolerance"
    if _bends_out_of_plane(path, s):
        helps = (
            "round a corner that is not rounded, as its two segments do not lie in one plane: let "
            "them lie in one, or join them by an arc that touches both"
        )
    why = f", as it follows the tangent {helps}" if orientation.follows else ": make it turn evenly"
    raise InvalidInput(
        f"At {s:.6g} m along the path the tool's orientation jumps by "
        f"{np.degrees(jumps[i]):.3g}°{why}, or leave the orientation fixed there.",
        s=s,
        point=path(s).tolist(),
    )


def _bends_out_of_plane(path: Path, s: float) -> bool:
    """Whether a corner at an arc length [m] was left sharp since its segments are in no plane."""
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return False
    nearest = int(np.argmin(np.linalg.norm(path.corners.point - path(s), axis=1)))
    return bool(path.corners.reason[nearest] == OUT_OF_PLANE)


def what_helps(path: Path | None) -> str:
    """Advice for users whose arm cannot follow a path, as the end of a sentence."""
    orientation = None if path is None else path.orientation
    if orientation is None or orientation.axis_only:
        return "move the path or the arm"
    return "move the path or the arm, or leave turning about the tool axis free"


def turning_too_fast(path: Path, s: float) -> str:
    """Sentence for an arc length at which the path turns the tool far too fast; otherwise "".

    Args:
        path: The path.
        s: Arc length [m].
    """
    if path.orientation is None:
        return ""
    near = path.orientation.locate(np.array([s]))[0] + np.array([-1, 0, 1])
    near = near[(near >= 0) & (near < len(path.orientation))]
    middle = (path.orientation.breaks[near] + path.orientation.breaks[near + 1]) / 2
    rate = float(np.linalg.norm(path.orientation.rates(middle)[0], axis=1).max())
    if rate < TOO_FAST:
        return ""
    return (
        f"At {s:.6g} m along the path the tool turns by {rate * 1e-6:.3g} rad per micrometre, "
        "which no joint path can follow: put the points of the path farther apart there, "
        "or allow larger corners."
    )


def poses_at(path: Path, knots: Knots, u: FloatArray) -> FloatArray:
    """Rotation matrices and positions of the tool at distances `u` along segments, (n, 3, 4)."""
    poses, orientation = np.empty((len(u), 3, 4)), path.orientation
    poses[:, :, 3] = path.on_segment(knots.segment, u)
    if orientation is None:
        poses[:, :, :3] = np.eye(3)
    elif orientation.fixed:
        poses[:, :, :3] = orientation.starts[knots.piece]
    else:
        after = knots.at(u) - orientation.breaks[knots.piece]
        poses[:, :, :3] = orientation.on_piece(knots.piece, after)
    return poses


def tool_errors(
    arm: SerialArm, q: FloatArray, targets: FloatArray, task: int, tolerances: tuple[float, float]
) -> FloatArray:
    """Larger of position error and orientation error of the tool, over its tolerance, (n,).

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        targets: Poses that the tool should have, (n, 3, 4).
        task: Task dimension.
        tolerances: Largest distance of the tool from its place [m], and angle [rad].
    """
    off = arm.poses(q) - targets
    error: FloatArray = np.linalg.norm(off[:, :, 3], axis=1) / tolerances[0]
    if task == 3:
        return error
    turned = off[:, :, 2] if task == 5 else off[:, :, :3].reshape(-1, 9) / np.sqrt(2.0)
    angle: FloatArray = np.linalg.norm(turned, axis=1)
    return np.maximum(error, angle / tolerances[1])


def motion_at(path: Path, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tool poses as `poses_at`, and their derivatives along the arc length, (n, 4, 3).

    The rows of the derivatives are the tangent, its derivative, the angular rate [rad/m] and its
    derivative.
    """
    poses, rates, orientation = poses_at(path, knots, u), np.zeros((len(u), 4, 3)), path.orientation
    rates[:, 0] = path.on_segment(knots.segment, u, 1)
    rates[:, 1] = path.on_segment(knots.segment, u, 2)
    if orientation is not None and not orientation.fixed:
        after = knots.at(u) - orientation.breaks[knots.piece]
        rates[:, 2], rates[:, 3] = orientation.rates_on_piece(knots.piece, after)
    return poses, rates


def row_of_poses(path: Path, knots: Knots) -> FloatArray:
    """Poses at the start of every interval and at the end of the last one, (n + 1, 3, 4)."""
    every = knots.part(np.append(np.arange(len(knots)), len(knots) - 1))
    return poses_at(path, every, np.append(knots.u0, knots.u1[-1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstPoses:
    """What a path demands of the tool at its first knots; all configurations share it.

    Args:
        knots: The first knots, n intervals.
        places: The intervals, and again those whose end is not the start of the next one on the
            same segment, m in all.
        u: Distances along the segments: starts of the intervals, and then these ends [m], (m,).
        poses: Poses there, (m, 3, 4).
        rates: Their derivatives there, (m, 4, 3).
        ends: Row of the end of every interval among these places, (n,).
        between: Poses at the places between knots, as `Knots.places`.
        stops: Arc lengths at which the tool stops [m].
    """

    knots: Knots
    places: Knots
    u: FloatArray
    poses: FloatArray
    rates: FloatArray
    ends: IntArray
    between: FloatArray
    stops: FloatArray

    @classmethod
    def of(cls, path: Path, knots: Knots) -> FirstPoses:
        """Compute them."""
        row, u, ends = knots.ends()
        places = knots.part(row)
        poses, rates = motion_at(path, places, u)
        return cls(
            knots=knots,
            places=places,
            u=u,
            poses=poses,
            rates=rates,
            ends=ends,
            between=poses_at(path, *knots.places()),
            stops=path.stops,
        )

    @property
    def row(self) -> FloatArray:
        """Poses at the start of every interval and at the end of the last one, (n + 1, 3, 4)."""
        return np.concatenate([self.poses[: len(self.knots)], self.poses[-1:]])
