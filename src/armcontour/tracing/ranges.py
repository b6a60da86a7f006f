"""Joint paths and the joints' ranges: exact extrema between knots, not samples."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.errors import Unreachable
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.tracing.poses import what_helps

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
        piece, joint, x, q = found
        s = float(joint_path.breaks[piece] + x * np.diff(joint_path.breaks)[piece])
        edge = float(upper[joint] if q > upper[joint] else lower[joint])
        raise out_of_range(joint_path.tool_path, s, int(joint), q, edge)


def out_of_range(
    path: Path | None, s: float, joint: int, q: float, edge: float, also: str = ""
) -> Unreachable:
    """What to say of a joint that leaves its range.

    Args:
        path: The tool path, if there is one.
        s: Where [m].
        joint: Which, from 0.
        q: Where it would stand [rad].
        edge: The end of its range that it leaves [rad].
        also: More to say of it.
    """
    name = "upper" if q > edge else "lower"
    return Unreachable(
        f"At {s:.6g} m along the path joint {joint + 1} would stand at {q:.6g} rad, "
        f"{abs(q - edge):.3g} rad beyond its {name} limit of {edge:.6g} rad{also}: "
        f"{what_helps(path)}.",
        s=s,
        point=None if path is None else path(s).tolist(),
        joint=joint + 1,
        limit=f"joint_{name}",
        needed=q,
        allowed=edge,
    )


def turn_into_range(joint_path: JointPath, limits: Limits) -> JointPath:
    """The same joint path with joints outside their ranges inside, where whole turns bring them."""
    if limits.joint_lower is None and limits.joint_upper is None:
        return joint_path
    lower, upper = limits.joint_range(joint_path.dof)
    q = joint_path(joint_path.breaks)
    least = np.ceil((lower - ROUNDING - q.min(axis=0)) / (2 * np.pi))
    most = np.floor((upper + ROUNDING - q.max(axis=0)) / (2 * np.pi))
    turns = np.where(least <= most, np.clip(0.0, least, most), 0.0)
    if not turns.any():
        return joint_path
    coefficients = joint_path.coefficients.copy()
    coefficients[:, 0] += 2 * np.pi * turns
    return dataclasses.replace(joint_path, coefficients=coefficients)


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
