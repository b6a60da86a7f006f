"""Boxes: what a robot can be, and what it cannot."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.robustness import Box


def test_a_number_is_plus_and_minus_and_two_are_a_range():
    np.testing.assert_array_equal(Box(payload=0.4).payload, [-0.4, 0.4])
    np.testing.assert_array_equal(Box(payload=[0.0, 2.0]).payload, [0.0, 2.0])
    np.testing.assert_array_equal(Box().friction, [0.0, 1.0])
    assert Box().of_bodies == ()
    box = Box(viscous=1.0, armature=0.1, payload_known=True)
    assert box.of_bodies == ("viscous", "armature", "payload_known")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"payload": [2.0, 0.0]}, "the least and the largest"),
        ({"payload": [0.0, 1.0, 2.0]}, "the least and the largest"),
        ({"friction": [1.0, 0.5]}, "the least and the largest"),
        ({"viscous": -1.0}, "N m s/rad"),
        ({"coulomb": [[1.0]]}, "one per joint"),
        ({"armature": 1.0}, "below 1"),
    ],
)
def test_a_box_that_cannot_be_is_refused(wrong, words):
    with pytest.raises(ac.InvalidInput, match=words):
        Box(**wrong)
