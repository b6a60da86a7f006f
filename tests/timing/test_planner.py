"""The entry point of the planners: what it takes and refuses."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import smooth

# Those of the paper; the optimal planner has its own tests.
METHODS = ("mac", "conventional")


def test_a_path_is_traced_on_the_way(arm, rounded, traced, limits):
    direct = ac.plan(rounded, arm, limits, method="mac", knots=50)
    by_hand = ac.plan(traced, arm, limits, method="mac", knots=50)
    assert direct.duration == by_hand.duration
    assert direct.path is rounded and direct.method == "mac"


def test_the_branch_reaches_the_arm(arm, rounded, limits):
    planned = ac.plan(rounded, arm, limits.replace(speed=0.05), method="mac", branch="negative")
    t = np.linspace(0, planned.duration, 101)
    assert (planned(t)[:, 1] < 0).all()
    off = rounded.project(arm.forward(planned(t))).distance
    assert off.max() < 1e-6


def test_the_arms_limits_are_the_default(arm, rounded, refuses):
    # They hold no assigned velocity, which the method needs.
    for method in METHODS:
        refuses(
            lambda m=method: ac.plan(rounded, arm, method=m),
            ac.InvalidInput,
            f"The method {method} needs an assigned velocity",
            "give the limit speed",
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "fast"}, ("method must be one of", "mac, conventional", "'fast'")),
        ({"method": "mac", "knot": 3}, ("mac takes the options knots, period", "not knot")),
        ({"method": "conventional", "knots": 3}, ("conventional takes no options", "not knots")),
        ({"method": "mac", "knots": 7}, ("knots a line", "from 8 to", "is 7")),
        ({"method": "mac", "period": 0.0}, ("command interval", "above zero")),
        ({"method": "mac", "period": np.nan}, ("command interval", "finite")),
        ({"method": "mac", "branch": "up"}, ("branches positive, negative",)),
    ],
)
def test_refused_options(arm, rounded, limits, options, words, refuses):
    refuses(lambda: ac.plan(rounded, arm, limits, **options), ac.InvalidInput, *words)


def test_mac_needs_joint_limits(arm, rounded, limits, refuses):
    refuses(
        lambda: ac.plan(rounded, arm, limits.replace(joint_acceleration=None), method="mac"),
        ac.InvalidInput,
        "mac needs joint acceleration limits",
        "rad/s²",
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_path_without_a_tool_path_is_refused(arm, limits, method, refuses):
    spline = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    refuses(
        lambda: ac.plan(spline, arm, limits, method=method),
        ac.InvalidInput,
        f"The method {method} plans along a tool path",
        "traced one",
    )


def test_limits_for_another_arm_are_refused(arm, rounded, limits, refuses):
    refuses(
        lambda: ac.plan(
            rounded, arm, limits.replace(joint_acceleration=[1.0, 1.0, 1.0]), method="mac"
        ),
        ac.InvalidInput,
        "joint_acceleration has 3 values",
    )


def test_a_joint_path_takes_no_branch(arm, rounded, limits, refuses):
    joint_path = ac.trace(rounded, arm)
    refuses(
        lambda: ac.plan(joint_path, arm, limits, branch="negative"),
        ac.InvalidInput,
        "traced already",
    )


def test_a_plan_is_smoothed_as_by_hand(arm, traced, limits):
    limits = limits.replace(centripetal_acceleration=None)
    plain = ac.plan(traced, arm, limits, reserve=0.3)
    for windows in (0.02, [0.02, 0.01]):
        found = ac.plan(traced, arm, limits, reserve=0.3, smoothing=windows)
        by_hand = smooth(plain, *np.atleast_1d(windows))
        t = np.linspace(0, found.duration, 101)
        np.testing.assert_array_equal(found(t), by_hand(t))


def test_smoothing_that_exceeds_a_limit_is_refused_with_what_would_do(arm, limits):
    corners = ac.round_corners(
        ac.Path.polyline([(0.3, 0.2), (0.35, 0.2), (0.35, 0.25)]), tolerance=1e-5
    )
    free = limits.replace(centripetal_acceleration=None)
    with pytest.raises(ac.NotRealizable, match="reserve, such as") as caught:
        ac.plan(corners, arm, free, smoothing=[0.02, 0.02], reserve=0.05)
    assert caught.value.limit == "joint_acceleration" and caught.value.needed > 1.01
    # The excess is that of the judge, which shares no code with the plan.
    by_hand = smooth(ac.plan(corners, arm, free, reserve=0.05), 0.02, 0.02)
    used = ac.check(by_hand, arm, free)["joint_acceleration"]
    assert caught.value.needed == pytest.approx(used.ratio, rel=2e-2)
    reserve = float(str(caught.value).rpartition("such as ")[2].rstrip("."))
    assert ac.plan(corners, arm, free, smoothing=[0.02, 0.02], reserve=reserve).duration > 0
    with pytest.raises(ac.NotRealizable, match="lower limit, such as") as caught:
        ac.plan(corners, arm, limits, smoothing=[0.02, 0.02], reserve=0.5)
    assert caught.value.limit == "centripetal_acceleration"


@pytest.mark.parametrize(
    ("smoothing", "words"),
    [("20 ms", ("smoothing must be numbers",)), (-0.02, ("window", "above zero")), ([0.0], ())],
)
def test_windows_that_cannot_be(arm, traced, limits, smoothing, words, refuses):
    refuses(lambda: ac.plan(traced, arm, limits, smoothing=smoothing), ac.InvalidInput, *words)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["joint_jerk", "tool_jerk", "path_jerk"])
def test_methods_without_limits_of_jerk_refuse_them(arm, traced, limits, refuses, method, name):
    refuses(
        lambda: ac.plan(traced, arm, limits.replace(**{name: 10.0}), method=method),
        ac.NotRealizable,
        f"The method {method} keeps no limits of jerk, but there is {name}",
        "the method optimal",
        f"limits.replace({name}=None)",
        limit=name,
    )


def test_shaped_paths_are_not_for_limits_of_jerk(arm, objective, limits, refuses):
    jerk = limits.replace(joint_jerk=10.0, tool_jerk=5.0)
    for make in (
        lambda: ac.plan(objective, arm, jerk, method="shaped", tolerance=1e-3),
        lambda: ac.shape(objective, arm, jerk, tolerance=1e-3),
    ):
        refuses(
            make,
            ac.NotRealizable,
            "Along a shaped path accelerations jump, at places where joint_jerk and tool_jerk",
            'continuity="curvature"',
            "limits.replace(joint_jerk=None, tool_jerk=None)",
            limit="joint_jerk",
        )


def test_an_infinite_limit_of_jerk_is_none(arm, traced, limits):
    slow = limits.replace(speed=0.04)
    endless = slow.replace(joint_jerk=[np.inf, np.inf])
    assert endless.jerk_limits == ()
    planned = ac.plan(traced, arm, endless, method="mac", knots=50)
    assert planned.duration == ac.plan(traced, arm, slow, method="mac", knots=50).duration
