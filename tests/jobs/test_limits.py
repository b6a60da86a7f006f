"""Limits have the same meaning in job files and in Python."""

from __future__ import annotations

import math
import pickle
import warnings

import numpy as np
import pytest

import armcontour as ac
from armcontour.files.job_file import parse_job
from armcontour.jobs import warnings_of
from armcontour.robot import resolve_limits
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, TOOL_LIMITS, UNITS

ARMS = ("fr3", "panda", "pmk3s", "ur10e", "ur5e")
# Values below those of all arms; ranges are wide.
GIVEN = {
    "joint_acceleration": 0.7,
    "joint_velocity": 0.9,
    "joint_torque": 90.0,
    "joint_jerk": 3000.0,
    "joint_lower": -6.0,
    "joint_upper": 6.0,
    "speed": 0.1,
    "tool_acceleration": 1.5,
    "centripetal_acceleration": 0.3,
    "angular_speed": 1.2,
    "angular_acceleration": 9.0,
}


def values_of(limits):
    """The values of all limits as lists, and the names of those that are removed."""
    values = {x: getattr(limits, x) for x in UNITS}
    return {x: None if y is None else np.asarray(y).tolist() for x, y in values.items()}


def points_of(arm):
    return [(0.3, 0.15), (0.36, 0.2)] if arm.dimension == 2 else [(0.4, 0.1, 0.3), (0.46, 0.1, 0.3)]


def job_of(name, limits, runs="{one: {timing: {method: optimal}}}"):
    path = f"points: {[list(x) for x in points_of(ac.load_arm(name))]}"
    if name != "pmk3s":
        path += ", orientation: {axis: [0, 0, -1]}"
    limit_text = ", ".join(f"{x}: {y}" for x, y in limits.items())
    servo = "servo: {kp: 25 1/s, kv: 150 1/s}"
    text = (
        f"name: x\narm: {name}\npath: {{{path}}}\nlimits: {{{limit_text}}}\n{servo}\nruns: {runs}\n"
    )
    return parse_job(text)


@pytest.mark.parametrize("name", ARMS)
def test_a_job_and_python_use_the_same_limits_if_some_are_omitted(name):
    arm = ac.load_arm(name)
    specified = dict(GIVEN)
    if arm.limits.joint_upper is not None:
        # Narrower than the arm's own.
        specified |= {"joint_lower": 0.99 * arm.limits.joint_lower.max(), "joint_upper": 2.0}
        specified["joint_lower"] = (
            -0.05 if specified["joint_lower"] > -0.05 else specified["joint_lower"]
        )
    for omitted in (None, *UNITS):
        some = {x: y for x, y in specified.items() if x != omitted}
        if omitted in JOINT_RANGE and arm.limits.joint_upper is not None:
            some = {x: y for x, y in some.items() if x not in JOINT_RANGE}
        (of_job,) = (x.limits for x in job_of(name, some).runs)
        of_call = resolve_limits("a test", arm, ac.Limits(**some))
        assert values_of(of_job) == values_of(of_call)
        assert of_job.removed == of_call.removed == frozenset()
        for x in UNITS:
            expected = some.get(x, getattr(arm.limits, x))
            if expected is None:
                assert getattr(of_job, x) is None
            else:
                np.testing.assert_array_equal(
                    np.broadcast_to(expected, np.shape(getattr(of_job, x))), getattr(of_job, x)
                )
        # Resolving once more changes nothing.
        assert resolve_limits("a test", arm, of_call) is of_call


@pytest.mark.parametrize("removal", ["inf", ".inf", "none"])
def test_infinity_removes_a_limit_in_jobs_and_in_python(removal):
    arm = ac.load_arm("panda")
    for name in sorted({*JOINT_LIMITS, *JOINT_RANGE, *TOOL_LIMITS}):
        (of_job,) = (x.limits for x in job_of("panda", {name: removal}).runs)
        of_call = resolve_limits("a test", arm, ac.Limits(**{name: math.inf}))
        for limits in (of_job, of_call, resolve_limits("again", arm, of_call)):
            assert getattr(limits, name) is None and limits.removed == {name}


def test_a_null_limit_is_unspecified_and_a_run_replaces_limits_of_its_job():
    runs = "{one: {limits: {speed: null, joint_torque: inf}}, two: {limits: {joint_velocity: 0.5}}}"
    specified = {"speed": "null", "joint_velocity": "inf", "joint_jerk": 9.0}
    one, two = (x.limits for x in job_of("ur5e", specified, runs).runs)
    arm = ac.load_arm("ur5e")
    assert one.speed is two.speed is None and (one.joint_jerk == two.joint_jerk).all()
    assert one.removed == {"joint_velocity", "joint_torque"} and not two.removed
    np.testing.assert_array_equal(two.joint_velocity, np.full(6, 0.5))
    np.testing.assert_array_equal(two.joint_torque, arm.limits.joint_torque)


def test_removed_limits_are_shown_and_specified_limits_are_not_removed():
    limits = ac.Limits(speed=math.inf, joint_velocity=[math.inf] * 6, joint_acceleration=2.0)
    assert limits.removed == {"speed", "joint_velocity"}
    assert str(limits).count("none") == 2 and "speed" in repr(limits)
    copied = pickle.loads(pickle.dumps(limits))
    assert copied.removed == limits.removed and values_of(copied) == values_of(limits)
    changed = limits.replace(speed=0.2, joint_torque=5.0)
    assert changed.removed == {"joint_velocity"} and changed.speed == 0.2
    assert limits.replace(speed=None).removed == {"joint_velocity"}
    arm = ac.load_arm("ur5e")
    for part, names in (
        (limits.of_joints, TOOL_LIMITS),
        (limits.without_jerk, ("joint_jerk",)),
        (limits.of_tool, (*JOINT_LIMITS, *JOINT_RANGE)),
    ):
        resolved = resolve_limits("a test", arm, part)
        assert all(getattr(resolved, x) is None for x in names)
        assert resolved.removed == limits.removed | set(names)
    alone = resolve_limits("a test", arm, ac.Limits.only(speed=0.1, joint_jerk=math.inf))
    assert alone.speed == 0.1 and alone.removed == set(UNITS) - {"speed"}
    assert all(getattr(alone, x) is None for x in alone.removed)
    with pytest.raises(ac.InvalidInput, match="Unknown limit 'sped'"):
        ac.Limits.only(sped=0.1)
    with pytest.raises(ac.InvalidInput, match="range of joint 1"):
        resolve_limits("a test", arm, ac.Limits(joint_lower=9.0))


def test_limits_above_those_of_the_arm_cause_one_warning():
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline(points_of(arm)).pointing([0, 0, -1])
    above = ac.Limits(joint_velocity=[3.0, 3.0, 3.0, 3.0, 3.5, 3.0], joint_upper=6.4)
    with pytest.warns(UserWarning) as caught:
        planned = ac.plan(path, arm, above)
    (warning,) = caught
    assert warning.filename == __file__
    text = str(warning.message)
    for words in ("joint_velocity of joint 5", "3.5 rad/s", "3.14159 rad/s", "joint_upper", "6.4"):
        assert words in text
    np.testing.assert_array_equal(planned.limits.joint_velocity, above.joint_velocity)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # The arm's value with four digits, a lower value, and no limit.
        ac.plan(path, arm, ac.Limits(joint_velocity=3.1416, joint_torque=20.0))
        ac.plan(path, arm, ac.Limits(joint_velocity=math.inf, joint_lower=math.inf))
    specified = {"joint_velocity": 3.5}
    job_result = ac.run(job_of("ur5e", specified, "{one: {}, two: {limits: {speed: 0.1}}}"))
    (range_warning,) = (
        x for x in warnings_of(job_result.runs.values()) if "joint_velocity of joint 1" in x
    )
    assert (
        "one, two" in range_warning
        and "3.5 rad/s" in range_warning
        and "3.14159 rad/s" in range_warning
    )


def test_later_steps_use_the_limits_of_the_plan():
    arm = ac.load_arm("pmk3s")
    corner = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3)])
    path = ac.round_corners(corner, tolerance=2e-3)
    limits = ac.Limits(speed=0.1, joint_acceleration=0.4)
    program = ac.Program(moves=(ac.Contour(path=path), ac.Rapid(), ac.Contour(path=path)))
    for plan in (
        ac.plan(path, arm, limits, ac.Optimal(reserve=0.02)),
        ac.plan(program, arm, limits),
        ac.plan(path, arm, limits, ac.Optimal(duration=9.0)),
        ac.plan(path, arm, limits, ac.Conventional()),
    ):
        np.testing.assert_array_equal(plan.limits.joint_acceleration, [0.4, 0.4])
        assert plan.limits.speed == 0.1
        for span in plan.spans:
            speed = span.trajectory.limits.speed
            assert speed == (0.1 if span.kind == "contour" else None)
        assert ac.check(plan, arm)["joint_acceleration"].limit == 0.4
    plan = ac.plan(path, arm, limits, ac.Optimal(reserve=0.02))
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    # Drives saturate at the limits of the plan, and explicit limits win over these.
    set_points = ac.compensate(plan, servo, ac.NoCompensation())
    for plant_limits, bound in ((None, 0.4), (ac.Limits(joint_acceleration=0.6), 0.6)):
        execution = ac.simulate(set_points, ac.ServoPlant(arm, servo, plant_limits))
        np.testing.assert_array_equal(execution.plant.acceleration, [bound, bound])
        result = ac.evaluate(execution, path, limits=plant_limits)
        np.testing.assert_allclose(result.demand_ratio, execution.peak_demand / bound)
    # The reserve is known, too: limits bind where they are used as far as the plan may.
    reserved = ac.explain(plan, arm)
    assert {x.name for x in reserved.bindings} >= {"joint 1 acceleration"}
    whole = ac.explain(plan, arm, ac.Limits(joint_acceleration=0.4))
    assert len(whole.bindings) < len(reserved.bindings) or not whole.bindings
    fast = ac.plan(path, arm.with_limits(ac.Limits(joint_velocity=0.3)))
    set_points = ac.compensate(fast, servo)
    assert np.abs(np.diff(set_points.q, axis=0)).max() <= 0.3 * set_points.cycle * (1 + 1e-9)
