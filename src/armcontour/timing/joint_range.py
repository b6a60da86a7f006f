"""Whether a joint path stays within the joints' ranges: exact extrema, not samples."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Limits
from armcontour.errors import Unreachable
from armcontour.motion import JointPath

# Joint positions are rounded by less than this, and no robot resolves it [rad].
ROUNDING = 1e-9
# Bernstein coefficients of a quintic from its monomial ones: binomials of k over those of 5.
BERNSTEIN = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [1, 1 / 5, 0, 0, 0, 0],
        [1, 2 / 5, 1 / 10, 0, 0, 0],
        [1, 3 / 5, 3 / 10, 1 / 10, 0, 0],
        [1, 4 / 5, 6 / 10, 4 / 10, 1 / 5, 0],
        [1, 1, 1, 1, 1, 1],
    ]
)


def refuse_out_of_range(joint_path: JointPath, limits: Limits) -> None:
    """Refuse a joint path that leaves the range of a joint anywhere.

    Args:
        joint_path: The path.
        limits: With the joints' ranges.

    Raises:
        Unreachable: With the joint, the place that is farthest outside, and by how much.
    """
    if limits.joint_lower is None and limits.joint_upper is None:
        return
    lower, upper = limits.joint_range(joint_path.dof)
    # A polynomial lies within the hull of its Bernstein coefficients, so most pieces need no roots.
    hull = np.einsum("ij,pjd->pid", BERNSTEIN, joint_path.coefficients)
    suspect = (hull.min(axis=1) < lower - ROUNDING) | (hull.max(axis=1) > upper + ROUNDING)
    worst, found = ROUNDING, None
    for piece, joint in np.argwhere(suspect):
        for x in _places(joint_path.coefficients[piece, :, joint]):
            q = float(np.polynomial.polynomial.polyval(x, joint_path.coefficients[piece, :, joint]))
            beyond = max(lower[joint] - q, q - upper[joint])
            if beyond > worst:
                worst, found = float(beyond), (piece, joint, x, q)
    if found is not None:
        _refuse(joint_path, lower, upper, found, worst)


def _places(coefficients: FloatArray) -> FloatArray:
    """Ends and extrema of a polynomial on its interval from 0 to 1."""
    slope = np.polynomial.polynomial.polyder(coefficients)
    # Leading zeros, or what rounding left of them, would send roots to infinity.
    size = float(np.abs(slope).max())
    used = np.flatnonzero(np.abs(slope) > 1e-15 * size)
    ends = np.array([0.0, 1.0])
    if size == 0 or used[-1] == 0:
        return ends
    roots = np.polynomial.polynomial.polyroots(slope[: used[-1] + 1])
    # A double root may come out as a pair beside the real axis: its real part is a place too.
    inside = np.real(roots[(np.real(roots) > 0) & (np.real(roots) < 1)])
    return np.concatenate([ends, inside])


def _refuse(
    joint_path: JointPath,
    lower: FloatArray,
    upper: FloatArray,
    found: tuple[IntArray, IntArray, float, float],
    beyond: float,
) -> None:
    piece, joint, x, q = found
    s = float(joint_path.breaks[piece] + x * np.diff(joint_path.breaks)[piece])
    over = q > upper[joint]
    name, edge = ("upper", float(upper[joint])) if over else ("lower", float(lower[joint]))
    raise Unreachable(
        f"At {s:.6g} m along the path joint {joint + 1} would stand at {q:.6g} rad, "
        f"{beyond:.3g} rad beyond its {name} limit of {edge:.6g} rad: choose another "
        "configuration, or move the path.",
        s=s,
        joint=int(joint) + 1,
        limit=f"joint_{name}",
        needed=q,
        allowed=edge,
    )
