"""The entry point of the planners: what it takes and refuses."""

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
    other = ac.plan(rounded, arm, limits.replace(speed=0.05), method="mac", branch="negative")
    t = np.linspace(0, other.duration, 101)
    assert (other(t)[:, 1] < 0).all()
    assert rounded.project(arm.forward(other(t))).distance.max() < 1e-6


def test_refusals(arm, rounded, traced, objective, limits, refuses):
    spline = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    mac, rows = {"method": "mac"}, []
    for options in (
        {"method": "fast"},
        mac | {"intervals": 50},
        {"method": "conventional", "knots": 3},
        mac | {"knots": 7},
        mac | {"period": 0.0},
        mac | {"period": np.nan},
        mac | {"branch": "up"},
        *({"smoothing": x} for x in ("20 ms", -0.02, [0.0])),
    ):
        rows.append((rounded, limits, options, ac.InvalidInput, {}))
    for method in METHODS:
        # The arm's limits hold no assigned velocity, which the method needs.
        rows.append((rounded, None, {"method": method}, ac.InvalidInput, {}))
        rows.append((spline, limits, {"method": method}, ac.InvalidInput, {}))
        for name in ("joint_jerk", "tool_jerk", "path_jerk"):
            jerk = limits.replace(**{name: 10.0})
            rows.append((traced, jerk, {"method": method}, ac.NotRealizable, {"limit": name}))
    # Along a shaped path accelerations jump.
    jerk, shaped = limits.replace(joint_jerk=10.0, tool_jerk=5.0), {"tolerance": 1e-3}
    data = {"limit": "joint_jerk"}
    rows.append((objective, jerk, {"method": "shaped"} | shaped, ac.NotRealizable, data))
    refuses(lambda: ac.shape(objective, arm, jerk, **shaped), ac.NotRealizable, **data)
    for own in ({"joint_acceleration": None}, {"joint_acceleration": [1.0, 1.0, 1.0]}):
        rows.append((rounded, limits.replace(**own), mac, ac.InvalidInput, {}))
    rows.append((traced, limits, {"branch": "negative"}, ac.InvalidInput, {}))
    for path, own, options, kind, data in rows:
        refuses(lambda x=path, y=own, z=options: ac.plan(x, arm, y, **z), kind, **data)


def test_a_plan_is_smoothed_as_by_hand(arm, traced, limits):
    limits = limits.replace(centripetal_acceleration=None)
    plain = ac.plan(traced, arm, limits, reserve=0.3)
    for windows in (0.02, [0.02, 0.01]):
        found = ac.plan(traced, arm, limits, reserve=0.3, smoothing=windows)
        by_hand = smooth(plain, *np.atleast_1d(windows))
        t = np.linspace(0, found.duration, 101)
        np.testing.assert_array_equal(found(t), by_hand(t))


def test_smoothing_that_exceeds_a_limit_is_refused_with_what_would_do(arm, limits):
    corners = ac.Path.polyline([(0.3, 0.2), (0.35, 0.2), (0.35, 0.25)])
    corners = ac.round_corners(corners, tolerance=1e-5)
    free = limits.replace(centripetal_acceleration=None)
    windows, coarse = [0.02, 0.02], {"intervals": 800}
    smoothed = coarse | {"smoothing": windows}
    with pytest.raises(ac.NotRealizable, match="reserve, such as") as caught:
        ac.plan(corners, arm, free, **smoothed, reserve=0.05)
    assert caught.value.limit == "joint_acceleration" and caught.value.needed > 1.01
    # The excess is that of the judge, which shares no code with the plan.
    by_hand = smooth(ac.plan(corners, arm, free, reserve=0.05, **coarse), *windows)
    used = ac.check(by_hand, arm, free)["joint_acceleration"]
    assert caught.value.needed == pytest.approx(used.ratio, rel=2e-2)
    reserve = float(str(caught.value).rpartition("such as ")[2].rstrip("."))
    assert ac.plan(corners, arm, free, **smoothed, reserve=reserve).duration > 0
    with pytest.raises(ac.NotRealizable, match="lower limit, such as") as caught:
        ac.plan(corners, arm, limits, **smoothed, reserve=0.5)
    assert caught.value.limit == "centripetal_acceleration"


def test_an_infinite_limit_of_jerk_is_none(arm, traced, limits):
    slow = limits.replace(speed=0.04)
    endless = slow.replace(joint_jerk=[np.inf, np.inf])
    assert endless.jerk_limits == ()
    durations = [ac.plan(traced, arm, x, method="mac", knots=50).duration for x in (slow, endless)]
    assert durations[0] == durations[1]
