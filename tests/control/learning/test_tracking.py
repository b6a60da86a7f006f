"""Learning from positions of the tool."""

from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.control.learning import Recording

from .robots import SERVO, gentle_plan, rods


@pytest.fixture(scope="module")
def arm():
    return rods()


@pytest.fixture(scope="module")
def set_points(arm):
    plan = gentle_plan(ac.JointPath.spline([(0.1, 0.9), (0.5, 1.3)]), arm, arm.limits, 0.1)
    return ac.compensate(plan, SERVO, ac.Inverse())


def give_way(executed):
    """Tool positions of links that hang, and lag behind their encoders."""
    bent = executed.q - 2e-3 * executed.dq - [1e-3, -2e-3]
    return executed.t, executed.arm.tool_position(bent)


def test_the_tool_counts_where_encoders_see_nothing(arm, set_points):
    plant = ac.ServoPlant(arm, SERVO)
    errors = {"encoders": [], "tracker": []}
    for name, distances in errors.items():
        lesson = set_points
        for _ in range(4):
            execution = ac.simulate(lesson, plant)
            t, points = give_way(execution)
            plan = lesson.trajectory
            due = arm.tool_position(plan(np.clip(t, 0, plan.duration)))
            distances.append(float(np.linalg.norm(points - due, axis=1).max()))
            tool = (t, points) if name == "tracker" else None
            lesson = ac.learn(lesson, execution, arm=arm, servo=SERVO, tool=tool)
    assert errors["tracker"][-1] < 0.1 * errors["tracker"][0]
    assert errors["encoders"][-1] > 0.7 * errors["encoders"][0]


def test_a_tracker_may_have_a_clock_of_its_own(arm, set_points):
    """Its offset and rate are found from the motion; a lag of the tool is part of the offset."""
    execution = ac.simulate(set_points, ac.ServoPlant(arm, SERVO))
    log = Recording(t=execution.t + 2.0, q=execution.q)
    tool = 1.002 * execution.t - 5.0, arm.tool_position(execution.q)
    with_tool, alone = (
        ac.learn(set_points, log, arm=arm, servo=SERVO, tool=x).runs[0].error for x in (tool, None)
    )
    np.testing.assert_allclose(with_tool, alone, atol=1e-6)


def test_refusals(arm, set_points, refuses):
    execution = ac.simulate(set_points, ac.ServoPlant(arm, SERVO))
    t, x = give_way(execution)
    half = len(t) // 2
    for tool, words in (
        ((t, 1e3 * x), "positions by the encoders"),
        ((t, x[:, :1]), "rows of 2 or 3 coordinates"),
        ((t[::-1], x), "increasing times"),
        ((t[:half], x[:half]), "tool positions covers the plan"),
    ):
        call = partial(ac.learn, set_points, execution, arm=arm, servo=SERVO, tool=tool)
        refuses(call, ac.InvalidInput, words)
