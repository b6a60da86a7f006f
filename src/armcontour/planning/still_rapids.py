"""Rapids of an arm with joints that are still within contours and move between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import JointPath
from armcontour.planning.tracing import trace, trace_between, trace_to
from armcontour.program import Contour, Move, Rapid
from armcontour.robot import SerialArm


def rapids_to_contour(moves: Sequence[Move], i: int) -> tuple[dict[int, Path], int | None]:
    """Return the rapids with a path from move i to the next contour, and the contour's index.

    The rapids are paths by the index of the move. The contour's index is None if none follows.
    """
    rapids: dict[int, Path] = {}
    for k, move in enumerate(moves[i:], i):
        if isinstance(move, Contour):
            return rapids, k
        if isinstance(move, Rapid) and move.path is not None:
            rapids[k] = move.path
    return rapids, None


def find_gap(moves: Sequence[Move], i: int, contour: int, before: Path | None) -> int | None:
    """Return the index of the last move before a contour to which a joint motion leads.

    This joint motion is a rapid without a path, or connects two paths that do not meet. None if
    all paths meet.

    - `i`: index of the first move after the previous contour.
    - `contour`: index of the contour.
    - `before`: path of the move before move i; None if the first position is free.
    """
    gap = None if before is not None else i
    apart = False
    point = None if before is None else before(before.length)
    for k in range(i, contour + 1):
        move = moves[k]
        path = move.path if isinstance(move, Contour | Rapid) else None
        if isinstance(move, Rapid) and path is None:
            apart = True
        if path is None:
            continue
        if point is not None and np.linalg.norm(path(0.0) - point) > REPEATED_POINT:
            apart = True
        if apart:
            gap = k
        apart = False
        point = path(path.length)
    return gap


def trace_away(paths: Sequence[Path], arm: SerialArm, end: FloatArray) -> list[JointPath]:
    """Trace paths that begin at joint positions `end` [rad], (dof,), at which still joints stay."""
    joint_paths = []
    for path in paths:
        joint_paths.append(trace(path, arm.hold_still(end), seed=end))
        end = joint_paths[-1](path.length)
    return joint_paths


def trace_towards(paths: Sequence[Path], arm: SerialArm, start: FloatArray) -> list[JointPath]:
    """Trace paths that end at joint positions `start` [rad], (dof,), as `trace_away`."""
    joint_paths = []
    for path in reversed(paths):
        joint_paths.append(trace_to(path, arm, start))
        start = joint_paths[-1](0.0)
    return joint_paths[::-1]


def trace_across(
    paths: Sequence[Path], arm: SerialArm, end: FloatArray, start: FloatArray
) -> list[JointPath]:
    """Trace paths up to a contour that all meet; still joints move along the last but one path.

    If they cannot, they stay where they are.

    - `paths`: paths of the rapids, and that of the contour.
    - `end`: joint positions before the paths [rad], (dof,).
    - `start`: joint positions at the start of the contour [rad], (dof,), at which the still joints
      should be.
    """
    *first, last, contour = paths
    joint_paths = trace_away(first, arm, end)
    before = joint_paths[-1](joint_paths[-1].length) if joint_paths else end
    try:
        moving = trace_between(last, arm, before, start)
        (on_contour,) = trace_away([contour], arm, moving(moving.length))
    except Unreachable:
        return [*joint_paths, *trace_away([last, contour], arm, before)]
    return [*joint_paths, moving, on_contour]
