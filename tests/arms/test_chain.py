"""Chains and payloads: what they copy, and what no body could be."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms import Chain, Payload

GOOD = {
    "joints": ("a", "b"),
    "rotations": np.tile(np.eye(3), (2, 1, 1)),
    "positions": np.zeros((2, 3)),
    "axes": [[0, 0, 1], [0, 1, 0]],
    "masses": [1.0, 2.0],
    "centers": np.zeros((2, 3)),
    "inertias": np.tile(np.eye(3), (2, 1, 1)),
}


def test_what_is_not_given_is_zero_and_all_is_locked():
    chain = Chain(**GOOD)
    assert len(chain) == 2
    for name in ("armature", "viscous", "coulomb"):
        np.testing.assert_array_equal(getattr(chain, name), [0, 0])
    np.testing.assert_array_equal(chain.gravity, [0, 0, -9.81])
    with pytest.raises(ValueError, match="read-only"):
        chain.masses[0] = 3
    np.testing.assert_array_equal(chain.replace(masses=[3, 4]).masses, [3, 4])
    bare = chain.replace(masses=None, centers=None, inertias=None)
    assert bare.masses is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joints": ()}, ("at least one revolute joint",)),
        ({"centers": None}, ("needs centres of mass",)),
        ({"positions": [0, 0, 0]}, ("positions of a chain", "(2, 3)")),
        ({"gravity": [0, 0, np.inf]}, ("gravity", "finite")),
        ({"axes": [[0, 0, 2], [0, 1, 0]]}, ("unit vectors",)),
        ({"armature": [-1, 0]}, ("armature", "negative")),
        ({"masses": [1, -1]}, ("link after b", "-1 kg")),
        ({"inertias": [np.eye(3), np.diag([1, 1, 3])]}, ("link after b", "No body", "1, 1, 3")),
        ({"inertias": [np.triu(np.ones((3, 3))), np.eye(3)]}, ("link after a", "symmetric")),
    ],
)
def test_chains_that_are_none_are_refused(change, words, refuses):
    refuses(lambda: Chain(**GOOD | change), ac.InvalidInput, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass": -1.0}, ("payload mass", "negative")),
        ({"center": [0, 0]}, ("centre of 3 coordinates",)),
        ({"inertia": np.diag([1.0, 1.0, 3.0])}, ("inertia of the payload", "No body")),
    ],
)
def test_payloads_that_are_none_are_refused(change, words, refuses):
    refuses(lambda: Payload(**{"mass": 1.0} | change), ac.InvalidInput, *words)
