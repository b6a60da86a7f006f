"""Preferences of joints: which are valid, and that no change of the arm loses or shifts them."""

import pickle

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.robot import JointPreference, Payload

RAIL = ac.Rail(axis=(0.0, 1.0, 0.0), lower=-1.0, upper=2.0, velocity=1.0, acceleration=1.0)
TURN = ac.PositionerAxis(
    name="turn", axis=(0.0, 0.0, 1.0), origin=(0.9, 0.0, 0.1), lower=-6.0, upper=6.0, velocity=1.0,
    acceleration=1.0,
)  # fmt: skip


def ur10e():
    return ac.load_arm("ur10e")


def by_name(arm):
    """The preferences of an arm by the names of its joints."""
    names = arm.joint_names
    chain = arm.chain
    return {
        "held": {names[k]: x for k, x in chain.held.items()},
        "still": {names[k] for k in chain.still},
        "ranges": {names[k]: x for k, x in chain.ranges.items()},
        "weights": {names[k]: x for k, x in enumerate(chain.weights) if x != 1.0},
        "prefer": chain.prefer,
    }


@pytest.mark.parametrize(
    "values",
    [
        {"weight": 0.0},
        {"weight": -1.0},
        {"weight": np.inf},
        {"hold": np.nan},
        {"range": (1.0, 1.0)},
        {"range": (1.0, 0.0)},
        {"range": (0.0, np.inf)},
        {"hold": 0.0, "weight": 2.0},
        {"hold": 0.0, "range": (0.0, 1.0)},
        {"hold": 0.0, "still": True},
        {"weight": 2.0, "still": True},
    ],
)
def test_preferences_without_meaning_are_refused(values):
    with pytest.raises(ac.InvalidInput):
        JointPreference(**values)


@pytest.mark.parametrize(
    ("name", "values", "key"),
    [
        ("rail", {"hold": 2.1}, ("rail", "hold")),
        ("rail", {"range": (-1.5, 1.0)}, ("rail", "range")),
        ("rail", {"range": (3.0, 4.0)}, ("rail", "range")),
        ("elbow_joint", {"hold": 4.0}, ("elbow_joint", "hold")),
        ("rails", {"hold": 0.0}, ("rails",)),
    ],
)
def test_preferences_that_do_not_fit_the_arm_are_refused(name, values, key):
    arm = ur10e().with_rail(RAIL)
    with pytest.raises(ac.InvalidInput) as error:
        arm.with_preferences({name: JointPreference(**values)})
    assert error.value.key == key
    text = str(error.value)
    if len(key) == 1:
        assert all(x in text for x in arm.joint_names)
    else:
        lower, upper = (x[arm.joint_names.index(name)] for x in arm.limits.joint_range(arm.dof))
        assert f"{lower:g}" in text and f"{upper:g}" in text


def test_arm_whose_joints_are_all_held_is_refused():
    arm = ur10e()
    with pytest.raises(ac.InvalidInput):
        arm.with_preferences({x: JointPreference(hold=0.0) for x in arm.joint_names})


def test_preferences_remain_with_their_joints():
    given = {
        "elbow_joint": JointPreference(weight=3.0),
        "wrist_1_joint": JointPreference(range=(-1.0, 2.0)),
        "wrist_2_joint": JointPreference(still=True),
        "wrist_3_joint": JointPreference(hold=0.5),
    }
    first = ur10e().with_preferences(given, prefer="fastest")
    expected = by_name(first)
    assert expected == {
        "held": {"wrist_3_joint": 0.5},
        "still": {"wrist_2_joint"},
        "ranges": {"wrist_1_joint": (-1.0, 2.0)},
        "weights": {"elbow_joint": 3.0},
        "prefer": "fastest",
    }
    railed = first.with_rail(RAIL)
    changed = [
        railed,
        railed.with_positioner(ac.Positioner(axes=(TURN,))),
        first.with_tool(Frame((0.0, 0.0, 0.1))),
        first.with_work(Frame((0.5, 0.0, 0.1))),
        first.with_limits(ac.Limits(speed=0.1)),
        first.with_dynamics(payload=Payload(mass=1.0)),
        pickle.loads(pickle.dumps(first)),
    ]
    for arm in changed:
        assert by_name(arm) == expected
        k = arm.joint_names.index("wrist_1_joint")
        lower, upper = arm.limits.joint_range(arm.dof)
        assert (lower[k], upper[k]) == (-1.0, 2.0)


def test_later_preferences_replace_those_of_the_same_joints_only():
    arm = ur10e().with_preferences(
        {"elbow_joint": JointPreference(weight=3.0), "wrist_1_joint": JointPreference(hold=0.1)}
    )
    arm = arm.with_preferences({"wrist_1_joint": JointPreference()})
    assert by_name(arm)["weights"] == {"elbow_joint": 3.0}
    assert not by_name(arm)["held"]


def test_ranges_stay_narrow_whatever_the_limits():
    arm = ur10e().with_rail(RAIL)
    arm = arm.with_preferences({"rail": JointPreference(range=(0.5, 1.5))})
    wide = ac.Limits(joint_lower=-9.0, joint_upper=9.0)
    lower, upper = arm.with_limits(wide).limits.joint_range(arm.dof)
    np.testing.assert_array_equal(lower, [0.5, *[-9.0] * 6])
    np.testing.assert_array_equal(upper, [1.5, *[9.0] * 6])
    removed = ac.Limits(joint_lower=np.inf, joint_upper=np.inf)
    lower, upper = arm.with_limits(removed).limits.joint_range(arm.dof)
    np.testing.assert_array_equal(lower, [0.5, *[-np.inf] * 6])
    np.testing.assert_array_equal(upper, [1.5, *[np.inf] * 6])
    narrow = ac.Limits(joint_upper=[1.0, *[6.0] * 6])
    assert arm.with_limits(narrow).limits.joint_upper[0] == 1.0
    with pytest.raises(ac.InvalidInput):
        arm.with_limits(ac.Limits(joint_upper=[0.4, *[6.0] * 6]))


def test_ends_of_the_own_range_may_be_rounded():
    arm = ur10e()
    arm = arm.with_preferences({"elbow_joint": JointPreference(range=(-3.1415926536, 0.0))})
    assert arm.limits.joint_lower[2] == ur10e().limits.joint_lower[2]


def test_check_finds_positions_outside_a_preferred_range():
    arm = ur10e().with_rail(RAIL)
    line = ac.JointPath.spline([[0.0, *[0.3] * 6], [1.2, *[0.4] * 6]])
    motion = ac.plan(line, arm)
    assert ac.check(motion, arm).verdict == "kept"
    narrow = arm.with_preferences({"rail": JointPreference(range=(0.0, 1.0))})
    found = ac.check(motion, narrow)
    assert found.violated
    with pytest.raises(ac.Unreachable) as error:
        ac.plan(line, narrow)
    assert error.value.joint == 0
    assert error.value.allowed == 1.0
