"""Poses that an arm surely cannot reach: they are farther away than its links are long."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot import Chain

# Axes are parallel if the cosine of their angle is above this; what lies along them then is known
# to 1e-6 of a link.
PARALLEL = 1 - 1e-12


def longest_reach(chain: Chain, task: int) -> tuple[FloatArray, FloatArray, float]:
    """A ball in the frame of the base that holds a point of the tool in every posture.

    Links between parallel axes are taken together: what lies along these axes adds up with its
    sign, as turning does not change it. Along the first axes it moves the middle of the ball.

    Args:
        chain: The arm.
        task: Task dimension. With 6 the point is on the last axis, else it is the tool point.

    Returns:
        The point in the frame of the tool [m], (3,), the middle of the ball [m], (3,), and its
        radius [m].
    """
    end = chain.tip @ chain.tool
    point = end.inverse.position if task == 6 else np.zeros(3)
    steps = [*chain.positions[1:], *([] if task == 6 else [end.position])]
    middle, radius = chain.positions[0].copy(), 0.0
    along = across = 0.0
    sense, first = 1.0, True
    for k, step in enumerate(steps):
        axis = chain.axes[k]
        part = float(axis @ step)
        along += sense * part
        across += float(np.linalg.norm(step - part * axis))
        last = k + 1 == len(steps)
        cosine = 0.0 if last else float(axis @ chain.rotations[k + 1] @ chain.axes[k + 1])
        if abs(cosine) > PARALLEL:
            sense *= float(np.sign(cosine))
            continue
        if first:
            middle += chain.rotations[0] @ (along * chain.axes[0])
            radius += across
        else:
            radius += float(np.hypot(along, across))
        along = across = 0.0
        sense, first = 1.0, False
    return point, middle, radius


def beyond_links(chain: Chain, task: int, poses: FloatArray, bases: FloatArray) -> FloatArray:
    """How far poses are beyond the links of an arm whose base stands in several places [m].

    Args:
        chain: The arm.
        task: Task dimension.
        poses: Rotations and positions of the tool in the work frame, (m, 3, 4).
        bases: Rotations and positions of the base in the work frame, (n, 3, 4).

    Returns:
        The largest distance over all poses that no posture bridges, (n,); 0 or less where the
        links are long enough.
    """
    point, middle, radius = longest_reach(chain, task)
    wanted = poses[:, :, 3] + poses[:, :, :3] @ point
    middles = bases[:, :, 3] + bases[:, :, :3] @ middle
    far = np.linalg.norm(wanted[None] - middles[:, None], axis=2)
    return np.asarray(far.max(axis=1) - radius)
