"""Rows of constraints in the form in which the compiled planner takes them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.constraints import Disc, Rows

ROOM = np.arange(1.0, 4.0)
# The same bound of five intervals and three rows, in arrays of several forms.
FORMS = {
    "whole": np.tile(ROOM, (2, 5, 1)),
    "both ends": np.broadcast_to(np.tile(ROOM, (5, 1)), (2, 5, 3)),
    "all": np.broadcast_to(ROOM, (2, 5, 3)),
    "row by row": np.broadcast_to(np.full((5, 1), 2.0), (2, 5, 3)),
}


@pytest.mark.parametrize(("low", "high"), list(itertools.product(FORMS, FORMS)))
def test_both_bounds_have_one_shape_and_their_values(low, high):
    none = np.zeros((2, 5, 3))
    given = Rows(none, none, -FORMS[low], FORMS[high], none[0])
    # -x is a whole array, also of one that was broadcast.
    plain = Rows(none, none, np.broadcast_to(-FORMS[low][0, 0], (2, 5, 3)), FORMS[high], none[0])
    for rows in (given, plain):
        found = rows.compact(5, "force")
        assert found.low.shape == found.high.shape
        assert all(x.flags.c_contiguous and x.flags.writeable for x in (found.low, found.high))
        np.testing.assert_array_equal(np.broadcast_to(found.low, (2, 5, 3)), rows.low)
        np.testing.assert_array_equal(np.broadcast_to(found.high, (2, 5, 3)), rows.high)


def whole_rows(**changes):
    values = {name: np.ones((2, 5, 3)) for name in ("a", "b", "low", "high")}
    return Rows(**(values | {"margin": np.zeros((5, 3))} | changes))


@pytest.mark.parametrize(
    "changes",
    [
        {"a": np.ones((2, 4, 3))},
        {"b": np.ones((2, 5, 2))},
        {"low": np.ones((2, 5, 1))},
        {"high": np.ones((5, 3))},
        {"margin": np.zeros((1, 3))},
    ],
)
def test_arrays_of_another_shape_are_refused_with_their_name(changes):
    (name,) = changes
    # Compiled functions would read beyond them.
    with pytest.raises(ac.InvalidInput, match=rf"constraint force have {name} of shape"):
        whole_rows(**changes).compact(5, "force")


def test_discs_of_another_shape_are_refused():
    Disc(np.ones((2, 5)), np.ones(5)).refuse_shape(5, "force")
    for c, r in ((np.ones((2, 4)), np.ones(5)), (np.ones((2, 5)), np.ones(4))):
        with pytest.raises(ac.InvalidInput, match="disc of the constraint force"):
            Disc(c, r).refuse_shape(5, "force")
