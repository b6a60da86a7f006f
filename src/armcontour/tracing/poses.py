"""Tool poses that a path in space prescribes, and their derivatives along the arc length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm
from armcontour.errors import InvalidInput
from armcontour.geometry import Orientation, Path
from armcontour.tracing.knots import Knots

# Jumps of the orientation below this are rounding errors [rad].
NO_JUMP = 1e-8
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
    same = orientation.fixed and (orientation.starts == orientation.starts[0]).all()
    if not same and (orientation.jumps > NO_JUMP).any():
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
    why = f", as it follows the tangent {helps}" if orientation.follows else ": make it turn evenly"
    raise InvalidInput(
        f"At {s:.6g} m along the path the tool's orientation jumps by "
        f"{np.degrees(jumps[i]):.3g}°{why}, or leave the orientation fixed there.",
        s=s,
        point=path(s).tolist(),
    )


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
    poses = np.zeros((len(u), 3, 4))
    poses[:, :, 3] = path.on_segment(knots.segment, u)
    if path.orientation is None:
        poses[:, :, :3] = np.eye(3)
    else:
        after = knots.at(u) - path.orientation.breaks[knots.piece]
        poses[:, :, :3] = path.orientation.on_piece(knots.piece, after)
    return poses


def row_of_poses(path: Path, knots: Knots) -> FloatArray:
    """Poses at the start of every interval and at the end of the last one, (n + 1, 3, 4)."""
    last = knots.part(np.array([len(knots) - 1]))
    return np.concatenate([poses_at(path, knots, knots.u0), poses_at(path, last, last.u1)])


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstPoses:
    """What a path demands of the tool at its first knots; all configurations share it.

    Args:
        knots: The first knots.
        starts: Poses and their derivatives at the starts of the intervals, (n, 3, 4), (n, 4, 3).
        ends: The same at their ends.
        between: Poses at the places between knots, as `Knots.places`.
        row: Poses at the starts and at the end of the last interval, (n + 1, 3, 4).
        stops: Arc lengths at which the tool stops [m].
    """

    knots: Knots
    starts: tuple[FloatArray, FloatArray]
    ends: tuple[FloatArray, FloatArray]
    between: FloatArray
    row: FloatArray
    stops: FloatArray

    @classmethod
    def of(cls, path: Path, knots: Knots) -> FirstPoses:
        """Compute them."""
        starts, ends = (
            (poses_at(path, knots, u), pose_derivatives_at(path, knots, u))
            for u in (knots.u0, knots.u1)
        )
        return cls(
            knots=knots,
            starts=starts,
            ends=ends,
            between=poses_at(path, *knots.places()),
            row=np.concatenate([starts[0], ends[0][-1:]]),
            stops=path.stops,
        )


def pose_derivatives_at(path: Path, knots: Knots, u: FloatArray) -> FloatArray:
    """Derivatives of the tool poses along the arc length, (n, 4, 3).

    The rows are the tangent, its derivative, the angular rate [rad/m] and its derivative.
    """
    rates = np.zeros((len(u), 4, 3))
    rates[:, 0] = path.on_segment(knots.segment, u, 1)
    rates[:, 1] = path.on_segment(knots.segment, u, 2)
    if path.orientation is not None:
        after = knots.at(u) - path.orientation.breaks[knots.piece]
        rates[:, 2], rates[:, 3] = path.orientation.rates_on_piece(knots.piece, after)
    return rates
