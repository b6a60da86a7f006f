"""Whether a joint path stays inside the ranges of the joints, between its knots too."""

from __future__ import annotations

import numpy as np

from armcontour.arms import Arm
from armcontour.errors import Unreachable
from armcontour.motion import JointPath

# A joint may be beyond the end of its range by this, which is rounding [rad].
PLAY = 1e-9
# Powers of x as sums of Bernstein polynomials of degree 5: a polynomial stays between its
# coefficients in those.
TO_BERNSTEIN = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [1, 1 / 5, 0, 0, 0, 0],
        [1, 2 / 5, 1 / 10, 0, 0, 0],
        [1, 3 / 5, 3 / 10, 1 / 10, 0, 0],
        [1, 4 / 5, 6 / 10, 4 / 10, 1 / 5, 0],
        [1, 1, 1, 1, 1, 1],
    ]
)


def refuse_out_of_range(joint_path: JointPath, arm: Arm) -> None:
    """Refuse a joint path that leaves a joint's range.

    Raises:
        Unreachable: It does; names the joint and where it goes farthest.
    """
    lower, upper = arm.limits.joint_range(arm.dof)
    hull = np.einsum("bk,nkj->nbj", TO_BERNSTEIN, joint_path.coefficients)
    near = (hull.min(axis=1) < lower - PLAY) | (hull.max(axis=1) > upper + PLAY)
    worst, where, value = PLAY, (0, 0.0), 0.0
    for i, j in np.argwhere(near):
        c = joint_path.coefficients[i, :, j]
        turning = np.roots((c[1:] * np.arange(1, 6))[::-1])
        inner = turning.real[np.abs(turning.imag) < 1e-6]
        x = np.concatenate([[0.0, 1.0], inner[(inner > 0) & (inner < 1)]])
        q = np.polynomial.polynomial.polyval(x, c)
        beyond = np.maximum(lower[j] - q, q - upper[j])
        k = int(np.argmax(beyond))
        if beyond[k] > worst:
            worst, where, value = float(beyond[k]), (int(j), float(x[k])), float(q[k])
            width = joint_path.breaks[i + 1] - joint_path.breaks[i]
            s = float(joint_path.breaks[i] + x[k] * width)
    if worst == PLAY:
        return
    joint = where[0]
    limit = float(lower[joint] if value < lower[joint] else upper[joint])
    point = arm.forward(joint_path(s)).tolist()
    raise Unreachable(
        f"At {s:.6g} m of {joint_path.length:.6g} m along the path joint {joint + 1} of the arm "
        f"{arm.name} would be at {value:.4g} rad, {worst:.3g} rad beyond the end of its range at "
        f"{limit:.4g} rad: move the path or the arm, or leave turning about the tool axis free.",
        s=s,
        point=point,
        joint=joint + 1,
        limit="joint range",
        needed=value,
        allowed=limit,
    )
