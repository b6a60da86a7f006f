"""What a path asks of the tool in space: poses, and how they change along it."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.tracing.knots import Knots

# A jump of the orientation below this is rounding [rad].
NO_JUMP = 1e-8
# Where an arm is found singular and the tool turns faster than this, that is the reason [rad/m].
TOO_FAST = 1e5


def task_dimension(path: Path, arm: SerialArm) -> int:
    """How many of a pose's 6 parts the path asks for: 6, 5 (tool axis) or 3 (tool point).

    Raises:
        InvalidInput: A path in the plane; one without orientation for an arm that has joints for
            one; more parts than the arm has joints; or an orientation that jumps.
    """
    if path.dimension != 3:
        raise InvalidInput(
            f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} "
            f"moves in {arm.dimension}."
        )
    orientation = path.orientation
    if orientation is None:
        if arm.dof > 3:
            raise InvalidInput(
                f"The path does not say how the arm {arm.name} is to hold its tool: give it an "
                "orientation (in a job, path.orientation; in Python, path.oriented(rotation), or "
                "path.pointing(direction) where only the tool axis counts)."
            )
        if arm.dof < 3:
            raise InvalidInput(
                f"The arm {arm.name} has {arm.dof} joints, but a path in space needs 3: describe "
                "an arm that moves in a plane by an arm file of two links."
            )
        return 3
    task = 5 if orientation.axis_only else 6
    if task > arm.dof:
        raise InvalidInput(
            f"The arm {arm.name} has {arm.dof} joints, but a tool "
            f"{'axis' if task == 5 else 'orientation'} in space needs {task}"
            f"{'; leave turning about the tool axis free with axis_only' if arm.dof == 5 else ''}."
        )
    jumps = orientation.jumps
    if (jumps > NO_JUMP).any():
        i = int(np.argmax(jumps > NO_JUMP))
        s = float(orientation.breaks[i + 1])
        point = path(s).tolist()
        k = int(path.locate(s))
        beside_an_arc = bool(path.curvatures[max(k - 1, 0) : k + 1].any())
        helps = (
            "beside an arc, where corners are not rounded: make line and arc tangent to each other"
            if beside_an_arc
            else "round a sharp corner: round the corner, with an angular tolerance"
        )
        why = (
            f", as it follows the tangent {helps}"
            if orientation.follows
            else ": make it turn evenly"
        )
        raise InvalidInput(
            f"At {s:.6g} m along the path the tool's orientation jumps by "
            f"{np.degrees(jumps[i]):.3g}°{why}, or leave the orientation fixed there.",
            s=s,
            point=point,
        )
    return task


def what_helps(path: Path | None) -> str:
    """What users can do where an arm cannot follow a path."""
    orientation = None if path is None else path.orientation
    if orientation is None or orientation.axis_only:
        return "move the path or the arm"
    return "move the path or the arm, or leave turning about the tool axis free"


def turning_too_fast(path: Path, s: float) -> str:
    """What to say of a place where the path turns the tool faster than anything could; or ""."""
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
    """Rotations and positions of the tool at places on the knots' segments, (n, 3, 4)."""
    poses = np.zeros((len(u), 3, 4))
    poses[:, :, 3] = path.on_segment(knots.segment, u)
    if path.orientation is None:
        poses[:, :, :3] = np.eye(3)
    else:
        after = knots.at(u) - path.orientation.breaks[knots.piece]
        poses[:, :, :3] = path.orientation.on_piece(knots.piece, after)
    return poses


def row_of_poses(path: Path, knots: Knots) -> FloatArray:
    """Poses at the starts of all intervals and the end of the last, (n + 1, 3, 4)."""
    last = knots.part(np.array([len(knots) - 1]))
    return np.concatenate([poses_at(path, knots, knots.u0), poses_at(path, last, last.u1)])


def rates_at(path: Path, knots: Knots, u: FloatArray) -> FloatArray:
    """Tangent and its derivative, rate of turning and its derivative, (n, 4, 3)."""
    rates = np.zeros((len(u), 4, 3))
    rates[:, 0] = path.on_segment(knots.segment, u, 1)
    rates[:, 1] = path.on_segment(knots.segment, u, 2)
    if path.orientation is not None:
        after = knots.at(u) - path.orientation.breaks[knots.piece]
        rates[:, 2], rates[:, 3] = path.orientation.rates_on_piece(knots.piece, after)
    return rates
