"""Methods: each does its own work, also a method of the caller; jobs name them in one place."""

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.control.compensation import CompensationOptions
from armcontour.core.fields import declared
from armcontour.jobs.methods import COMPENSATIONS, TIMINGS
from armcontour.motion import Method
from armcontour.planning import PlanOptions

PATH = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


@declared(eq=False)
class Half(PlanOptions):
    """The fastest timing, at half its speed."""

    method = "half"

    def time(self, joint_path, arm, limits):
        """Plan the motion along a contour."""
        return replace(ac.Optimal().time(joint_path, arm, limits).stretched(0.5), method="half")


@declared(eq=False)
class Early(CompensationOptions):
    """Set-points on the trajectory, 10 ms earlier."""

    method = "early"

    def set_points(self, trajectory, servo, cycle, arm):
        """Compute set-points."""
        _, q = ac.NoCompensation().set_points(trajectory, servo, cycle, arm)
        return -0.01, q


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("pmk3s")


@pytest.fixture(scope="module")
def limits(arm):
    return arm.limits.replace(speed=0.1)


def test_timing_method_of_the_caller_plans_paths_and_programs(arm, limits):
    fastest = ac.plan(PATH, arm, limits)
    half = ac.plan(PATH, arm, limits, Half())
    assert half.method == "half"
    assert half.duration == pytest.approx(2 * fastest.duration)
    program = ac.Program(moves=(ac.Contour(path=PATH), ac.Dwell(duration=0.5)))
    both = ac.plan(program, arm, limits, Half())
    assert both.duration == pytest.approx(2 * fastest.duration + 0.5)


def test_timing_method_of_the_caller_refuses_jerk_limits_by_its_name(arm, limits):
    with pytest.raises(ac.NotRealizable, match="method half"):
        ac.plan(PATH, arm, limits.replace(joint_jerk=100.0), Half())


def test_compensation_of_the_caller_sends_its_set_points(arm, limits):
    plan = ac.plan(PATH, arm, limits)
    sent = ac.compensate(plan, SERVO, Early())
    plain = ac.compensate(plan, SERVO, ac.NoCompensation())
    assert sent.method == "early"
    assert sent.start_time == -0.01
    np.testing.assert_array_equal(sent.q, plain.q)


def test_jobs_name_all_methods_except_shaped_which_is_a_kind_of_corner():
    assert sorted([*TIMINGS, Method.SHAPED]) == sorted(Method)
    assert list(COMPENSATIONS) == ["inverse", "pole_placement", "inverse_dynamics", "none"]


def test_free_corners_of_a_run_are_the_options_of_plan(limits):
    rounding = ac.Rounding(shape="free", tolerance=1e-3, iterations=7, angular_tolerance=0.1)
    timing = ac.Optimal(reserve=0.2, intervals=300, duration=9.0)
    shaping = ac.Run(name="free", limits=limits, rounding=rounding, timing=timing).shaping
    assert shaping.tolerance == 1e-3 and shaping.angular_tolerance == 0.1
    assert shaping.iterations == 7 and shaping.intervals == 300 and shaping.reserve == 0.2
    assert ac.Run(name="arcs", limits=limits, rounding=ac.Rounding(tolerance=1e-3)).shaping is None
