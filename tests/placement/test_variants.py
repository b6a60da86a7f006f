"""A job with another arm or tool."""

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.placement import Case, best_case, with_arm, with_tool


def test_another_arm_has_its_own_limits_and_those_of_the_tool_stay(square):
    arm = ac.load_arm("panda")
    found = with_arm(square, arm)
    assert found.arm is arm and found.servo.kp.shape == (7,)
    limits = found.runs[0].limits
    assert limits.speed == 0.25
    np.testing.assert_array_equal(limits.joint_velocity, arm.limits.joint_velocity)
    uneven = replace(square, servo=square.servo.replace(kp=[25, 25, 25, 25, 25, 30]).for_joints(6))
    with pytest.raises(InvalidInput, match="6 values of kp, but the arm .* has 7 joints"):
        with_arm(uneven, arm)
    assert with_arm(uneven, ac.load_arm("ur10e")).servo.kp[5] == 30
    with pytest.raises(InvalidInput, match="moves its tool in 2 coordinates"):
        with_arm(square, ac.load_arm("pmk3s"))


def test_another_tool_is_another_frame(square, plane):
    tool = ac.Frame(position=[0, 0, 0.1])
    found = with_tool(square, tool)
    assert found.arm.chain.tool is tool
    with pytest.raises(InvalidInput, match="has no tool frame"):
        with_tool(plane, tool)


def test_the_best_case_has_the_least_score(square):
    over = {"x": (0.0, 0.0, 1)}
    cases = [
        Case(name=name, placement=ac.place(with_arm(square, ac.load_arm(name)), over=over))
        for name in ("ur5e", "ur10e")
    ]
    known = [x.placement.best.verdict.duration for x in cases]
    best = best_case([*cases, Case(name="none", refusal="too short")])
    assert best is cases[int(np.argmin(known))].placement
    assert best_case([Case(name="none", refusal="too short")]) is None
