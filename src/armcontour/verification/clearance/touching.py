"""Pairs of an arm's own bodies whose shapes touch in every posture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot import Arm
from armcontour.robot.scene import ArmShapes, LeftOut, Scene
from armcontour.verification.clearance.distances import UNCERTAINTY, Distances, can_measure
from armcontour.verification.clearance.pairs import pairs_of

REASON = "touching with all joints at 0, and in every other posture that was tried"
# Number of other postures that are tried.
POSTURES = 15


def exclude_touching(arm: Arm) -> ArmShapes:
    """Shapes of an arm, with pairs excluded that touch with all joints at 0 and elsewhere."""
    # The arm may not be able to take the posture with all joints at 0, so a pair is excluded only
    # if it touches in all other sampled postures, too.
    assert arm.shapes is not None
    pairs, _ = pairs_of(arm, Scene())
    if not pairs or not can_measure():
        return arm.shapes
    assert arm.chain is not None
    distances = Distances(arm.chain, pairs)
    remaining = np.arange(len(pairs))
    for q in _postures(arm):
        distance = distances.measure(q[None], np.zeros(len(remaining), dtype=np.intp), remaining)
        remaining = remaining[distance <= UNCERTAINTY]
    touching = (pairs[k] for k in remaining.tolist())
    left_out = [LeftOut(first=x.first.name, second=x.second.name, reason=REASON) for x in touching]
    return replace(arm.shapes, left_out=(*arm.shapes.left_out, *dict.fromkeys(left_out)))


def _postures(arm: Arm) -> FloatArray:
    """All joints at 0, and postures distributed over the joint ranges [rad], (n, dof)."""
    low, high = (np.clip(x, -np.pi, np.pi) for x in arm.limits.joint_range(arm.dof))
    # Multiples of square roots of primes are evenly distributed, differently for each joint.
    steps = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37][: arm.dof])
    steps = np.concatenate([steps, np.sqrt(41 + np.arange(arm.dof - len(steps)))])
    shares = np.arange(1, POSTURES + 1)[:, None] * steps % 1
    return np.vstack([np.zeros(arm.dof), low + shares * (high - low)])
