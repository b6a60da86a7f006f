"""Rows as the compiled planner takes them; memory that is given back, and never overwritten."""

import itertools

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.constraints import Disc, Rows
from armcontour.timing.constraints.base import Constraint, JointDerivatives

ROOM = np.arange(1.0, 4.0)
# The same bound of five intervals and three rows, in arrays of several forms.
FORMS = {
    "whole": np.tile(ROOM, (2, 5, 1)),
    "both ends": np.broadcast_to(np.tile(ROOM, (5, 1)), (2, 5, 3)),
    "all": np.broadcast_to(ROOM, (2, 5, 3)),
    "row by row": np.broadcast_to(np.full((5, 1), 2.0), (2, 5, 3)),
}


def test_both_bounds_have_one_shape_and_their_values():
    none = np.zeros((2, 5, 3))
    for low, high in itertools.product(FORMS, FORMS):
        given = Rows(none, none, -FORMS[low], FORMS[high], none[0])
        # -x is a whole array, also of one that was broadcast.
        least = np.broadcast_to(-FORMS[low][0, 0], (2, 5, 3))
        for rows in (given, Rows(none, none, least, FORMS[high], none[0])):
            found = rows.compact(5, "force")
            assert found.low.shape == found.high.shape, (low, high)
            assert all(x.flags.c_contiguous and x.flags.writeable for x in (found.low, found.high))
            np.testing.assert_array_equal(np.broadcast_to(found.low, (2, 5, 3)), rows.low)
            np.testing.assert_array_equal(np.broadcast_to(found.high, (2, 5, 3)), rows.high)


def test_arrays_of_another_shape_are_refused_with_their_name():
    """Compiled functions would read beyond them."""
    right = {name: np.ones((2, 5, 3)) for name in ("a", "b", "low", "high")}
    right["margin"] = np.zeros((5, 3))
    Rows(**right).compact(5, "force")
    for name, shape in (
        ("a", (2, 4, 3)),
        ("b", (2, 5, 2)),
        ("low", (2, 5, 1)),
        ("high", (5, 3)),
        ("margin", (1, 3)),
    ):
        with pytest.raises(ac.InvalidInput, match=rf"constraint force have {name} of shape"):
            Rows(**right | {name: np.ones(shape)}).compact(5, "force")
    Disc(np.ones((2, 5)), np.ones(5)).refuse_shape(5, "force")
    for c, r in ((np.ones((2, 4)), np.ones(5)), (np.ones((2, 5)), np.ones(4))):
        with pytest.raises(ac.InvalidInput, match="disc of the constraint force"):
            Disc(c, r).refuse_shape(5, "force")


class Keeping(Constraint):
    """A constraint that limits nothing and keeps what it was given."""

    name = "keeping"

    def __init__(self):
        self.kept: list[JointDerivatives] = []
        self.copies: list[np.ndarray] = []

    def ceiling(self, grid, path, bounds):
        self.kept.append(path)
        self.copies.append(path.first.copy())
        return None


def test_arrays_of_one_plan_are_not_overwritten_by_the_next():
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.2)
    keeping = Keeping()
    for points in ([(0.3, 0.2), (0.4, 0.2)], [(0.3, 0.1), (0.3, 0.3)]):
        ac.plan(ac.Path.polyline(points), arm, limits, constraints=[keeping])
    assert len(keeping.kept) >= 2
    for kept, copy in zip(keeping.kept, keeping.copies, strict=True):
        np.testing.assert_array_equal(kept.first, copy)
