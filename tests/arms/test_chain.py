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
        ({"rotations": np.tile(2 * np.eye(3), (2, 1, 1))}, ("rotations of a chain", "no rotation")),
        ({"rotations": np.tile(-np.eye(3), (2, 1, 1))}, ("rotations of a chain", "right-handed")),
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


def test_a_chain_of_denavit_hartenberg_parameters():
    # As the page on arms makes it, against the product of the four elementary transforms.
    rng = np.random.default_rng(3)
    dh = rng.uniform(-1, 1, (6, 4))
    frames, before = [], ac.Frame()
    for a, alpha, d, offset in dh:
        frames.append(before @ ac.Frame.rpy((0, 0, d), (0, 0, offset)))
        before = ac.Frame.rpy((a, 0, 0), (alpha, 0, 0))
    chain = Chain(
        joints=tuple("abcdef"),
        positions=[x.position for x in frames],
        rotations=[x.rotation for x in frames],
        axes=[(0, 0, 1)] * 6,
        tip=before,
    )
    arm = ac.SerialArm(name="six", chain=chain, limits=ac.Limits())
    for q in rng.uniform(-3, 3, (20, 6)):
        whole = np.eye(4)
        for (a, alpha, d, offset), angle in zip(dh, q, strict=True):
            (c, s), (k, m) = ((np.cos(x), np.sin(x)) for x in (angle + offset, alpha))
            whole = whole @ [
                [c, -s * k, s * m, a * c],
                [s, c * k, -c * m, a * s],
                [0, m, k, d],
                [0, 0, 0, 1],
            ]
        point, rotation = arm.pose(q)
        np.testing.assert_allclose(point, whole[:3, 3], rtol=0, atol=1e-14)
        np.testing.assert_allclose(rotation, whole[:3, :3], rtol=0, atol=1e-14)
