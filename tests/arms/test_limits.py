"""Limits: what they are, how they are changed, what they refuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms.limits import UNITS, or_unlimited


@pytest.mark.parametrize(
    ("values", "words", "data"),
    [
        ({"joint_acceleration": 0.0}, ("joint_acceleration", "above zero", "rad/s²"),
         {"limit": "joint_acceleration"}),
        ({"joint_acceleration": [0.7, -0.1]}, ("every joint", "[0.7, -0.1]"),
         {"limit": "joint_acceleration"}),
        ({"joint_velocity": [[1.0]]}, ("joint_velocity", "rad/s"), {"limit": "joint_velocity"}),
        ({"joint_velocity": [1.0, np.nan]}, ("joint_velocity", "finite"), {"index": 1}),
        ({"speed": 0.0}, ("speed", "above zero", "0 m/s"), {}),
        ({"speed": [0.1, 0.2]}, ("speed", "one number", "not an array of 2"), {}),
        ({"speed": np.inf}, ("speed", "finite", "inf"), {}),
        ({"centripetal_acceleration": -1.0}, ("centripetal_acceleration", "-1 m/s²"), {}),
    ],
)  # fmt: skip
def test_refused(values, words, data, refuses):
    refuses(lambda: ac.Limits(**values), ac.InvalidInput, *words, **data)


def test_every_limit_has_a_unit():
    assert set(UNITS) == {x.name for x in dataclasses.fields(ac.Limits)}


def test_replace_changes_adds_and_lifts():
    limits = ac.Limits(joint_acceleration=[1.0, 2.0], speed=0.1)
    other = limits.replace(speed=0.2, centripetal_acceleration=0.5)
    assert (other.speed, other.centripetal_acceleration) == (0.2, 0.5)
    np.testing.assert_array_equal(other.joint_acceleration, [1.0, 2.0])
    assert limits.speed == 0.1 and limits.centripetal_acceleration is None
    assert other.replace(speed=None).speed is None


def test_replace_refuses_unknown_names_and_bad_values(refuses):
    limits = ac.Limits(speed=0.1)
    refuses(
        lambda: limits.replace(sped=0.2),
        ac.InvalidInput,
        "Unknown limit 'sped'",
        "the limits are joint_acceleration",
        "speed",
        "centripetal_acceleration",
    )
    refuses(lambda: limits.replace(speed=-1), ac.InvalidInput, "speed", "above zero")


def test_one_value_serves_all_joints():
    limits = ac.Limits(joint_acceleration=0.7, joint_velocity=[1.0, 2.0]).for_joints(2)
    np.testing.assert_array_equal(limits.joint_acceleration, [0.7, 0.7])
    np.testing.assert_array_equal(limits.joint_velocity, [1.0, 2.0])
    assert ac.Limits().for_joints(3).joint_acceleration is None


def test_wrong_number_of_joints_is_refused(refuses):
    refuses(
        lambda: ac.Limits(joint_acceleration=[1.0, 1.0]).for_joints(3),
        ac.InvalidInput,
        "joint_acceleration has 2 values",
        "3 joints",
    )


def test_arrays_are_copied_and_locked():
    values = np.array([1.0, 2.0])
    limits = ac.Limits(joint_acceleration=values)
    values[0] = 9.0
    assert limits.joint_acceleration[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        limits.joint_acceleration[0] = 9.0


def test_what_is_not_given_is_not_limited():
    np.testing.assert_array_equal(or_unlimited(None, 2), [np.inf, np.inf])
    np.testing.assert_array_equal(or_unlimited([1.0, 2.0], 2), [1.0, 2.0])


def test_a_range_that_is_no_angle_is_refused(refuses):
    for values, word in (("wide", "in rad"), ([np.nan, 1.0], "angle"), ([[1.0]], "angle")):
        refuses(lambda x=values: ac.Limits(joint_lower=x), ac.InvalidInput, "joint_lower", word)


def test_jerk_is_limited_where_it_is_finite(refuses):
    for endless in (np.inf, [np.inf, np.inf]):
        limits = ac.Limits(joint_jerk=endless)
        assert limits.jerk_limits == ()
        np.testing.assert_array_equal(limits.for_joints(2).joint_jerk, [np.inf, np.inf])
    some = ac.Limits(joint_jerk=[np.inf, 5.0], path_jerk=1.0)
    assert some.jerk_limits == ("joint_jerk", "path_jerk")
    assert some.of_joints.jerk_limits == ("joint_jerk",)
    assert some.of_tool.jerk_limits == ("path_jerk",)
    np.testing.assert_array_equal(some.for_joints(2).joint_jerk, [np.inf, 5.0])
    refuses(lambda: some.for_joints(3), ac.InvalidInput, "joint_jerk has 2 values", "3 joints")
