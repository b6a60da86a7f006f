"""Limits, chains and payloads: what they are, how they are changed, what they refuse."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from tests.geometry.tables import refused

import armcontour as ac
from armcontour.arms import Chain, Payload
from armcontour.arms.limits import UNITS, or_unlimited
from armcontour.arms.tube import Tube

GOOD = {
    "joints": ("a", "b"),
    "rotations": np.tile(np.eye(3), (2, 1, 1)),
    "positions": np.zeros((2, 3)),
    "axes": [[0, 0, 1], [0, 1, 0]],
    "masses": [1.0, 2.0],
    "centers": np.zeros((2, 3)),
    "inertias": np.tile(np.eye(3), (2, 1, 1)),
}
PLANE = {"name": "a", "base": 0.1, "links": (0.2, 0.3), "limits": ac.Limits()}
TUBE = {"outer_diameter": 0.08, "wall": 0.01, "density": 2700}
ODD_LIMITS = (
    ({"joint_acceleration": 0.0}, "rad/s²", {"limit": "joint_acceleration"}),
    ({"joint_acceleration": [0.7, -0.1]}, "[0.7, -0.1]", {"limit": "joint_acceleration"}),
    ({"joint_velocity": [[-1.0, 1.0]]}, "joint_velocity", "(dof,)", {"limit": "joint_velocity"}),
    ({"joint_velocity": [1.0, np.nan]}, "joint_velocity", "finite", {"index": 1}),
    ({"speed": 0.0}, "speed", "0 m/s"),
    ({"speed": [0.1, 0.2]}, "speed", "one number"),
    ({"speed": np.inf}, "speed", "finite"),
    ({"centripetal_acceleration": -1.0}, "centripetal_acceleration", "-1 m/s²"),
    ({"joint_lower": "wide"}, "joint_lower", "in rad"),
    ({"joint_lower": [np.nan, 1.0]}, "joint_lower", "angle"),
    ({"joint_lower": [[1.0]]}, "joint_lower", "angle"),
)
ODD_CHAINS = (
    ({"joints": ()}, "at least one revolute joint"),
    ({"centers": None}, "needs centres of mass"),
    ({"positions": [0, 0, 0]}, "positions of a chain", "(2, 3)"),
    ({"rotations": np.tile(2 * np.eye(3), (2, 1, 1))}, "rotations of a chain", "no rotation"),
    ({"rotations": np.tile(-np.eye(3), (2, 1, 1))}, "rotations of a chain", "right-handed"),
    ({"gravity": [0, 0, np.inf]}, "gravity", "finite"),
    ({"axes": [[0, 0, 2], [0, 1, 0]]}, "unit vectors"),
    ({"armature": [-1, 0]}, "armature"),
    ({"masses": [1, -1]}, "link after b", "-1 kg"),
    ({"inertias": [np.eye(3), np.diag([1, 1, 3])]}, "link after b", "No body", "1, 1, 3"),
    ({"inertias": [np.triu(np.ones((3, 3))), np.eye(3)]}, "link after a", "symmetric"),
)
ODD_PAYLOADS = (
    ({"mass": -1.0}, "payload mass"),
    ({"center": [0, 0]}, "centre of 3 coordinates"),
    ({"inertia": np.diag([1.0, 1.0, 3.0])}, "inertia of the payload", "No body"),
)
ODD_PLANES = (
    ({"base": np.nan}, "base", "finite"),
    ({"base": (1, 2)}, "base", "one number"),
    ({"links": (0.0, 0.3)}, "first link length"),
    ({"links": (0.2, -0.3)}, "second link length", "-0.3 m"),
    ({"links": ("long", 0.3)}, "first link length", "numbers in m"),
    ({"limits": ac.Limits(joint_velocity=[1.0, 2.0, 3.0])}, "has 3 values", "2 joints"),
)
ODD_TUBES = (
    ({"outer_diameter": 0}, "outer_diameter"),
    ({"wall": 0.05}, "wall of a tube", "0.08 m", "0.05 m"),
    ({"density": np.nan}, "density"),
)


def test_limits_chains_payloads_and_arms_that_cannot_be_are_refused():
    assert ac.PlanarTwoLink(**PLANE).link2 == 0.3
    for kind, good, rows in (
        (ac.Limits, {}, ODD_LIMITS),
        (Chain, GOOD, ODD_CHAINS),
        (Payload, {"mass": 1.0}, ODD_PAYLOADS),
        (ac.PlanarTwoLink, PLANE, ODD_PLANES),
        (Tube, TUBE, ODD_TUBES),
    ):
        refused(*((partial(kind, **good | x), *more) for x, *more in rows))
    two, jerk = ac.Limits(joint_acceleration=[1.0, 1.0]), ac.Limits(joint_jerk=[np.inf, 5.0])
    refused(
        (lambda: two.replace(sped=0.2), "Unknown limit 'sped'", "centripetal_acceleration"),
        (lambda: two.replace(speed=-1), "speed"),
        (lambda: two.for_joints(3), "joint_acceleration has 2 values", "3 joints"),
        (lambda: jerk.for_joints(3), "joint_jerk has 2 values", "3 joints"),
    )


def test_limits_are_replaced_added_lifted_and_spread_over_joints():
    assert set(UNITS) == {x.name for x in dataclasses.fields(ac.Limits)}
    values = np.array([1.0, 2.0])
    limits = ac.Limits(joint_acceleration=values, speed=0.1)
    values[0] = 9.0
    other = limits.replace(speed=0.2, centripetal_acceleration=0.5)
    assert (other.speed, other.centripetal_acceleration) == (0.2, 0.5)
    np.testing.assert_array_equal(other.joint_acceleration, [1.0, 2.0])
    assert limits.speed == 0.1 and limits.centripetal_acceleration is None
    assert other.replace(speed=None).speed is None
    with pytest.raises(ValueError, match="read-only"):
        limits.joint_acceleration[0] = 9.0
    spread = ac.Limits(joint_acceleration=0.7, joint_velocity=[1.0, 2.0]).for_joints(2)
    np.testing.assert_array_equal(spread.joint_acceleration, [0.7, 0.7])
    np.testing.assert_array_equal(spread.joint_velocity, [1.0, 2.0])
    assert ac.Limits().for_joints(3).joint_acceleration is None
    np.testing.assert_array_equal(or_unlimited(None, 2), [np.inf, np.inf])
    np.testing.assert_array_equal(or_unlimited([1.0, 2.0], 2), [1.0, 2.0])


def test_jerk_is_limited_where_it_is_finite():
    for endless in (np.inf, [np.inf, np.inf]):
        limits = ac.Limits(joint_jerk=endless)
        assert limits.jerk_limits == ()
        np.testing.assert_array_equal(limits.for_joints(2).joint_jerk, [np.inf, np.inf])
    some = ac.Limits(joint_jerk=[np.inf, 5.0], path_jerk=1.0)
    assert some.jerk_limits == ("joint_jerk", "path_jerk")
    assert some.of_joints.jerk_limits == ("joint_jerk",)
    assert some.of_tool.jerk_limits == ("path_jerk",)
    np.testing.assert_array_equal(some.for_joints(2).joint_jerk, [np.inf, 5.0])


def test_what_a_chain_is_not_given_is_zero_and_all_is_locked():
    chain = Chain(**GOOD)
    assert len(chain) == 2
    for name in ("armature", "viscous", "coulomb"):
        np.testing.assert_array_equal(getattr(chain, name), [0, 0])
    np.testing.assert_array_equal(chain.gravity, [0, 0, -9.81])
    with pytest.raises(ValueError, match="read-only"):
        chain.masses[0] = 3
    np.testing.assert_array_equal(chain.replace(masses=[3, 4]).masses, [3, 4])
    assert chain.replace(masses=None, centers=None, inertias=None).masses is None


def test_a_chain_of_denavit_hartenberg_parameters():
    # As the page on arms makes it, against the product of the four elementary transforms.
    rng = np.random.default_rng(3)
    dh = rng.uniform(-1, 1, (6, 4))
    frames, before = [], ac.Frame()
    for a, alpha, d, offset in dh:
        frames.append(before @ ac.Frame.rpy((0, 0, d), (0, 0, offset)))
        before = ac.Frame.rpy((a, 0, 0), (alpha, 0, 0))
    places = {"positions": [x.position for x in frames], "rotations": [x.rotation for x in frames]}
    chain = Chain(joints=tuple("abcdef"), **places, axes=[(0, 0, 1)] * 6, tip=before)
    arm = ac.SerialArm(name="six", chain=chain, limits=ac.Limits())
    for q in rng.uniform(-3, 3, (20, 6)):
        whole = np.eye(4)
        for (a, alpha, d, offset), angle in zip(dh, q, strict=True):
            (c, s), (k, m) = ((np.cos(x), np.sin(x)) for x in (angle + offset, alpha))
            first, second = [c, -s * k, s * m, a * c], [s, c * k, -c * m, a * s]
            whole = whole @ [first, second, [0, m, k, d], [0, 0, 0, 1]]
        point, rotation = arm.pose(q)
        np.testing.assert_allclose(point, whole[:3, 3], rtol=0, atol=1e-14)
        np.testing.assert_allclose(rotation, whole[:3, :3], rtol=0, atol=1e-14)
