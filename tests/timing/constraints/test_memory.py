"""Memory of plans: given back when nobody looks at it, never written to while somebody does."""

from __future__ import annotations

import weakref

import numpy as np

import armcontour as ac
from armcontour.timing.constraints.base import (
    Bounds,
    Ceiling,
    Constraint,
    JointDerivatives,
)
from armcontour.timing.grid import Grid, place_grid


class Keeping(Constraint):
    """A constraint that limits nothing and keeps what it was given."""

    name = "keeping"

    def __init__(self) -> None:
        self.kept: list[JointDerivatives] = []
        self.copies: list[np.ndarray] = []

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling | None:
        self.kept.append(path)
        self.copies.append(path.first.copy())
        return None


def test_arrays_of_one_plan_are_not_overwritten_by_the_next() -> None:
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.2)
    keeping = Keeping()
    for points in ([(0.3, 0.2), (0.4, 0.2)], [(0.3, 0.1), (0.3, 0.3)]):
        ac.plan(ac.Path.polyline(points), arm, limits, constraints=[keeping])
    assert len(keeping.kept) >= 2
    for kept, copy in zip(keeping.kept, keeping.copies, strict=True):
        np.testing.assert_array_equal(kept.first, copy)


def test_memory_that_nobody_refers_to_is_given_back() -> None:
    arm = ac.load_arm("pmk3s")
    joint_path = ac.trace(ac.Path.polyline([(0.3, 0.2), (0.4, 0.2)]), arm)
    first = JointDerivatives.on(place_grid(joint_path, 200))
    memory = weakref.ref(first.first.base)
    del first
    assert memory() is None
