"""The fastest configuration, and the lower bound that skips plans."""

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import JointPath
from armcontour.planning import program_tracing as here
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.optimal_timing import plan_optimal
from armcontour.planning.program_tracing import trace_by_duration
from armcontour.planning.tracing import trace_all

DOWN = np.diag([1.0, -1.0, -1.0])
CORNERS = [(0.45, 0.08, 0.2), (0.55, 0.08, 0.2), (0.55, 0.18, 0.25), (0.45, 0.2, 0.3)]


BASE = ac.Path.polyline(CORNERS)
SEAMS = {
    "rounded": ac.round_corners(BASE.oriented(DOWN), tolerance=1e-3),
    "axis": ac.round_corners(BASE.pointing([0.1, 0.2, -1]), tolerance=1e-2),
}


def roughly(joint_path, arm, limits):
    return plan_optimal(joint_path, arm, limits, here.COARSE_PLAN).duration


@pytest.fixture(scope="module", params=SEAMS)
def traced(request):
    """A path, its joint paths on a UR5e, and the limits."""
    arm = ac.load_arm("ur5e")
    path = SEAMS[request.param]
    limits = arm.limits.replace(speed=0.5, centripetal_acceleration=2.0)
    return arm, path, limits, trace_all(path, arm, limits=limits)


def test_plans_are_not_shorter_than_their_bound_and_sorted_by_duration(traced):
    arm, path, limits, candidates = traced
    durations = [roughly(x, arm, limits) for x in candidates]
    for joint_path, planned in zip(candidates, durations, strict=True):
        assert 0.95 * planned < bound_duration(joint_path, limits) <= planned
    ways = [x for group in trace_by_duration(path, arm, limits) for x in group]
    expected = [candidates[k] for k in np.argsort(durations, kind="stable")]
    assert len(ways) == len(expected) > 1
    # Chosen as if all had been planned.
    for candidate, other in zip(ways, expected, strict=True):
        assert np.array_equal(candidate.coefficients, other.coefficients)
    slow = limits.replace(speed=0.01)
    assert bound_duration(candidates[0], slow) == pytest.approx(path.length / 0.01, rel=1e-2)


def test_rounding_errors_do_not_select_among_equally_fast_configurations(monkeypatch):
    # The speed of the tool bounds all of the path, whichever way the arm reaches it.
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline(CORNERS[:2]).oriented(DOWN)
    slow = arm.limits.replace(speed=0.02, tool_acceleration=0.2, joint_torque=np.inf)
    usual = next(trace_by_duration(path, arm, slow))
    assert len(usual) > 1
    rng = np.random.default_rng(4)

    def noisy(*x, **named):
        planned = plan_optimal(*x, **named)
        return SimpleNamespace(duration=planned.duration * (1 + rng.uniform(-1e-9, 1e-9)))

    monkeypatch.setattr(here, "plan_optimal", noisy)
    for _ in range(5):
        candidates = next(trace_by_duration(path, arm, slow))
        assert [x(0.0).tolist() for x in candidates] == [x(0.0).tolist() for x in usual]


def test_lower_bounds_of_the_duration_have_the_closed_form():
    # One joint, 2 rad: up to speed within 0.5 rad, on for 1 rad, down within 0.5 rad.
    line = JointPath.spline([[0.0], [2.0]])
    limits = ac.Limits.only(joint_velocity=[2.0], joint_acceleration=[4.0])
    assert bound_duration(line, limits) == pytest.approx(0.5 + 0.5 + 0.5, rel=1e-12)
    slower = limits.replace(joint_velocity=[[-1e-3, 2.0]], joint_acceleration=[[-2.0, 4.0]])
    assert bound_duration(line, slower) == pytest.approx(0.5 + 0.25 + 1.0, rel=1e-12)
    line = JointPath.spline([[0.0, 0.0], [2.0, 1.0], [3.0, 4.0]])
    assert bound_duration(line, ac.Limits.only()) == 0.0
    # Velocities alone: the slower joint takes 4 rad at 2 rad/s.
    fast = bound_duration(line, ac.Limits.only(joint_velocity=[10.0, 2.0]))
    assert 0.98 * 2.0 < fast <= 2.0


def test_a_long_path_out_of_reach_is_refused_like_a_short_one(monkeypatch):
    arm = ac.load_arm("ur5e")
    messages = []
    path = ac.Path.polyline([(0.4, 0.1, 0.2), (0.6, 0.1, 0.2), (1.4, 0.1, 0.2)]).oriented(DOWN)
    for long in (here.MANY_SEGMENTS, 1):
        monkeypatch.setattr(here, "MANY_SEGMENTS", long)
        with pytest.raises(ac.Unreachable) as caught:
            next(trace_by_duration(path, arm))
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
