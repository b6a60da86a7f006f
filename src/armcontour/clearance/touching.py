"""Pairs of an arm's own bodies that touch with all joints at 0: they do so by their shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.arms import Arm
from armcontour.clearance.distances import UNCERTAINTY, Distances
from armcontour.clearance.pairs import pairs_of
from armcontour.scene import ArmShapes, LeftOut, Scene

REASON = "touching with all joints at 0"


def leave_out_touching(arm: Arm) -> ArmShapes:
    """The shapes of an arm, with pairs left out that touch with all joints at 0.

    Args:
        arm: An arm with shapes.

    Raises:
        InvalidInput: The arm has no shapes, or distances cannot be computed here.
    """
    assert arm.shapes is not None
    pairs, _ = pairs_of(arm, Scene())
    if not pairs:
        return arm.shapes
    assert arm.chain is not None
    every = np.arange(len(pairs))
    at = Distances(arm.chain, pairs).measure(np.zeros((1, arm.dof)), 0 * every, every)
    found = [
        LeftOut(first=x.first.name, second=x.second.name, reason=REASON)
        for x, distance in zip(pairs, at.tolist(), strict=True)
        if distance <= UNCERTAINTY
    ]
    return replace(arm.shapes, left_out=(*arm.shapes.left_out, *dict.fromkeys(found)))
