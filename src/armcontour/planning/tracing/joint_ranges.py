"""Check of a joint path against the joint ranges, by its exact extrema between knots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import Unreachable
from armcontour.core.quintics import to_bernstein
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.tracing.knots import suggest_remedy
from armcontour.robot import Arm, Limits

# Tolerance of joint ranges [rad], above rounding errors and below the resolution of robots.
RANGE_TOLERANCE = 1e-9
BERNSTEIN = to_bernstein(5)


def check_joint_range(joint_path: JointPath, limits: Limits, arm: Arm) -> None:
    """Raise Unreachable if a joint leaves its range along a joint path."""
    if limits.joint_lower is None and limits.joint_upper is None:
        return
    lower, upper = limits.joint_range(joint_path.dof)
    c = joint_path.coefficients
    spread = np.abs(c[:, 1:]).sum(axis=1)
    if ((c[:, 0] - spread >= lower) & (c[:, 0] + spread <= upper)).all():
        return
    # Most pieces need no roots, because a polynomial is within the hull of its Bernstein
    # coefficients.
    hull = np.matmul(BERNSTEIN, joint_path.coefficients)
    suspect = (hull.min(axis=1) < lower - RANGE_TOLERANCE) | (
        hull.max(axis=1) > upper + RANGE_TOLERANCE
    )
    worst = RANGE_TOLERANCE
    largest = None
    for piece, joint in np.argwhere(suspect):
        for x in _extremum_candidates(joint_path.coefficients[piece, :, joint]):
            q = float(np.polynomial.polynomial.polyval(x, joint_path.coefficients[piece, :, joint]))
            beyond = max(lower[joint] - q, q - upper[joint])
            if beyond > worst:
                worst = float(beyond)
                largest = (piece, joint, x, q)
    if largest is not None:
        piece, joint, x, q = largest
        s = float(joint_path.breaks[piece] + x * np.diff(joint_path.breaks)[piece])
        edge = float(upper[joint] if q > upper[joint] else lower[joint])
        raise out_of_range(joint_path.tool_path, arm, s, int(joint), q, edge)


def out_of_range(
    path: Path | None, arm: Arm, s: float, joint: int, q: float, edge: float, also: str = ""
) -> Unreachable:
    """Make the error for a joint that leaves its range.

    - `s`: arc length at which the joint is out of range [m].
    - `joint`: index of the joint, from 0.
    - `q`: joint position that the path requires there [rad].
    - `edge`: end of the joint range that is exceeded [rad].
    - `also`: clause that is added to the message.
    """
    name = "upper" if q > edge else "lower"
    unit = arm.chain.unit("rad", joint)
    moved = called(joint, arm.joint_names[joint])
    return Unreachable(
        f"At {s:.6g} m along the path {moved} would be at {number(q, unit)}, "
        f"{number(abs(q - edge), unit)} beyond its {name} limit of {number(edge, unit)}{also}. "
        f"{suggest_remedy(path)}.",
        s=s,
        point=None if path is None else path(s).tolist(),
        joint=joint,
        limit=f"joint_{name}",
        needed=q,
        allowed=edge,
    )


def called(joint: int, name: str) -> str:
    """Return number and name of a joint for messages, such as "joint 1 (turn)".

    - `joint`: index of the joint, from 0.
    """
    number_only = f"joint {joint + 1}"
    return number_only if name == number_only else f"{number_only} ({name})"


def turn_into_range(joint_path: JointPath, limits: Limits) -> JointPath:
    """Shift joints by whole turns into their ranges, if possible."""
    if limits.joint_lower is None and limits.joint_upper is None:
        return joint_path
    lower, upper = limits.joint_range(joint_path.dof)
    q = joint_path(joint_path.breaks)
    min_turns = np.ceil((lower - RANGE_TOLERANCE - q.min(axis=0)) / (2 * np.pi))
    max_turns = np.floor((upper + RANGE_TOLERANCE - q.max(axis=0)) / (2 * np.pi))
    turns = np.where(min_turns <= max_turns, np.clip(0.0, min_turns, max_turns), 0.0)
    return turn_by(joint_path, turns)


def turn_by(joint_path: JointPath, turns: FloatArray) -> JointPath:
    """Shift the joints of a joint path by whole turns, (dof,)."""
    if not turns.any():
        return joint_path
    coefficients = joint_path.coefficients.copy()
    coefficients[:, 0] += 2 * np.pi * turns
    return replace(joint_path, coefficients=coefficients)


def _extremum_candidates(coefficients: FloatArray) -> FloatArray:
    """Return the ends 0 and 1 of a polynomial's interval, and the stationary points between."""
    slope = np.polynomial.polynomial.polyder(coefficients)
    # Leading coefficients that are zero or rounding errors would give infinite roots.
    size = float(np.abs(slope).max())
    used = np.flatnonzero(np.abs(slope) > 1e-15 * size)
    ends = np.array([0.0, 1.0])
    if size == 0 or used[-1] == 0:
        return ends
    roots = np.polynomial.polynomial.polyroots(slope[: used[-1] + 1])
    # Rounding can split a double root into a complex pair, so the real parts of all roots count.
    inside = np.real(roots[(np.real(roots) > 0) & (np.real(roots) < 1)])
    return np.concatenate([ends, inside])
