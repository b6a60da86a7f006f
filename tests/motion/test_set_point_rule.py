"""Limits of set-points: their order, and what a controller reads, computed independently."""

import dataclasses
import json

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.render import jsonable
from armcontour.files import parse_job
from armcontour.motion import make_rule
from armcontour.motion.controller_facts import facts_of_format, facts_of_player

PLAN = ac.Limits(joint_velocity=[2.0, 3.0], joint_acceleration=[5.0, 6.0], joint_jerk=100.0)
JERK = ac.Limits(joint_jerk=1.0)
NAMES = ("joint_velocity", "joint_acceleration", "joint_jerk")
RANDOM = np.random.default_rng(0)


def upper(rule):
    """Upper bounds of velocities, accelerations and jerks."""
    return rule.bounds[1:, 1].tolist()


def test_the_smaller_limit_counts_and_replaces_an_assumed_one():
    none = [np.inf, np.inf]
    rule = make_rule(PLAN, 2)
    assert upper(rule) == [[2.0, 3.0], [15.0, 18.0], none]
    assert rule.sources == ("", "the plan", "assumed", "") and not rule.has_own_limits
    # A wider velocity changes nothing. A stated acceleration replaces the assumed one.
    wide = ac.Limits(joint_velocity=9.0, joint_acceleration=50.0, joint_jerk=1e4)
    rule = make_rule(PLAN, 2, wide)
    assert upper(rule) == [[2.0, 3.0], [50.0, 50.0], [1e4, 1e4]]
    assert (
        rule.sources == ("", "the plan", "command_limits", "command_limits") and rule.has_own_limits
    )
    # Of the user and of controllers, in any order
    ros = facts_of_format("ros-yaml")
    franka = dataclasses.replace(facts_of_player("franka"), limits=ac.Limits(joint_velocity=2.5))
    ur = facts_of_format("urscript")
    for targets in ((ros, franka, ur), (ur, franka, ros)):
        rule = make_rule(PLAN, 2, wide, targets)
        assert upper(rule) == [[2.0, 2.5], [5.0, 6.0], [1e4, 1e4]]
        # Joint 1 keeps the plan's velocity, joint 2 that of a controller.
        sources = ("", f"the plan, {franka.title}", ros.title, "command_limits")
        assert rule.sources == sources
        assert rule.cycle == franka.cycle


def test_infinity_removes_the_assumed_limit_only():
    free = ac.Limits(joint_velocity=np.inf, joint_acceleration=np.inf)
    rule = make_rule(PLAN, 2, free)
    assert upper(rule)[:2] == [[2.0, 3.0], [np.inf, np.inf]] and not rule.has_own_limits
    one = make_rule(PLAN, 2, ac.Limits(joint_acceleration=[np.inf, 7.0]))
    assert upper(one)[1] == [np.inf, 7.0]
    # A controller's limit counts in spite of it.
    assert upper(make_rule(PLAN, 2, free, [facts_of_format("ros-yaml")]))[1] == [5.0, 6.0]


def test_an_arm_without_limit_of_acceleration_has_no_assumed_one():
    rule = make_rule(ac.Limits(joint_velocity=2.0), 2)
    assert rule.sources == ("", "the plan", "", "")
    assert set(rule.judge(RANDOM.normal(size=(9, 2)), 4e-3).ratios) == {"joint_velocity"}
    with pytest.raises(ac.InvalidInput, match="joint_torque"):
        make_rule(PLAN, 2, ac.Limits(joint_torque=1.0))


def test_a_rule_is_restored_from_json():
    rule = make_rule(PLAN, 2, JERK, [facts_of_format("urscript")])
    data = json.loads(json.dumps(jsonable(rule.data())))
    restored = type(rule).from_data(data)
    assert restored.data().keys() == rule.data().keys()
    for name, value in rule.data().items():
        np.testing.assert_array_equal(getattr(restored, name), value)


def largest_read(q, cycle, read, delay=0.0):
    """Largest differences that a controller reads of lines, by order 1 to 3."""
    reads = delay + read * np.arange(-5, int(len(q) * cycle / read) + 5)
    values = np.interp(reads, cycle * np.arange(len(q)), q)
    return [np.abs(np.diff(values, k)).max() / read**k for k in (1, 2, 3)]


# Cycle of the controller and of the set-points [ms]
CYCLES = [(1.0, 4.0), (2.0, 3.0), (4.0, 5.0), (1.0, 2.7), (2.0, 2.0), (4.0, 1.0)]


@pytest.mark.parametrize(("read", "cycle"), np.array(CYCLES) * 1e-3)
def test_the_judge_reads_what_a_controller_reads(read, cycle):
    limits = ac.Limits(joint_velocity=2.0, joint_acceleration=30.0, joint_jerk=1e4)
    rule = dataclasses.replace(make_rule(ac.Limits(), 1, limits), cycle=read)
    for count in (1, 2, 3, 10, 50):
        q = RANDOM.normal(size=count)
        use = rule.judge(q[:, None], cycle)
        beyond = {}
        for name, value in zip(NAMES, largest_read(q, cycle, read), strict=True):
            limit = getattr(limits, name)
            assert use.ratios[name] == pytest.approx(value / limit, rel=1e-6)
            if value > limit:
                beyond[name] = value
        assert {x.limit: x.needed for x in use.excesses} == pytest.approx(beyond, rel=1e-6)


@pytest.mark.parametrize(("read", "cycle"), np.array(CYCLES[:4]) * 1e-3)
@pytest.mark.parametrize(("order", "limits"), [(2, ac.Limits(joint_acceleration=1.0)), (3, JERK)])
def test_bounds_at_a_longer_cycle_are_kept_and_tight(read, cycle, order, limits):
    """Whenever the controller reads, from lines that change by the bound from rest to rest."""
    rule = dataclasses.replace(make_rule(ac.Limits(), 1, limits), cycle=read)
    bound = rule.at_cycle(cycle)[2, 1, 0]
    largest = 0.0
    for x in (*RANDOM.uniform(-1, 1, size=(20, 8)), np.resize([1.0, -1.0], 8)):
        changes = np.r_[x, -x] / np.abs(x).max()
        q = bound * cycle**2 * np.cumsum(np.cumsum(np.r_[0.0, changes, 0.0]))
        for delay in np.linspace(0, read, 21):
            largest = max(largest, largest_read(q, cycle, read, delay)[order - 1])
    assert largest == pytest.approx(1.0, abs=1e-6)


def test_compensated_set_points_keep_the_limits_and_others_are_judged(arm, servo):
    path = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3)])
    path = ac.round_corners(path, tolerance=2e-3)
    plan = ac.plan(path, arm, ac.Limits.only(speed=0.2, joint_acceleration=2.0))
    limited = ac.compensate(plan, servo)
    exact = ac.compensate(plan, servo, ac.Inverse(command_limits=ac.Limits.only()))
    largest = []
    for set_points in (limited, exact):
        largest.append(max(largest_read(x, 4e-3, 4e-3)[1] for x in set_points.q.T) / 6.0)
        used = limited.rule.judge(set_points.q, 4e-3).ratios["joint_acceleration"]
        assert used.max() == pytest.approx(largest[-1], rel=1e-6)
        assert not set_points.use.excesses
    assert largest[0] == pytest.approx(1.0, abs=1e-6) and largest[1] > 2
    assert limited.limit_cost.deviation.max() > 0 and exact.limit_cost is None
    assert 0 < limited.use.limited_share < 1
    # Set-points that compensate nothing stay, whatever their limits are.
    narrow = ac.NoCompensation(command_limits=ac.Limits(joint_acceleration=1.0))
    with pytest.warns(UserWarning, match="command_limits"):
        judged = ac.compensate(plan, servo, narrow)
    np.testing.assert_array_equal(judged.q, ac.compensate(plan, servo, ac.NoCompensation()).q)
    assert judged.use.stated_excess.ratio == pytest.approx(2.0, rel=0.01)


JOB = """
name: line
arm: ur5e
path: {points: [[0.45, -0.05, 0.4], [0.55, 0.05, 0.4]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 250 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 8 ms
command_limits: {joint_velocity: 3 rad/s}
export: {formats: [urscript]}
runs: {only: {compensation: {method: inverse}}}
"""


def test_assumed_limits_refuse_no_plan():
    """The controller reads every 2 ms, so even the plan exceeds 3 times its acceleration."""
    result = ac.run(parse_job(JOB)).runs["only"]
    assert result.set_points.limit_cost is not None and not result.verdict.violations
    assert result.set_point_use.ratios["joint_acceleration"].max() == pytest.approx(4.0, rel=1e-5)
    assert any("(assumed)" in x for x in result.warnings)


def test_an_excess_has_the_unit_of_its_joint():
    rail = ac.Rail(axis=(0, 1, 0), upper=3.0, velocity=1.0, acceleration=1.0)
    ends = np.outer([0.0, 0.5], np.eye(7)[0])
    plan = ac.plan(ac.JointPath.spline(ends), ac.load_arm("ur10e").with_rail(rail))
    slow = ac.NoCompensation(command_limits=ac.Limits(joint_acceleration=[0.1, *[9.0] * 6]))
    with pytest.warns(UserWarning, match="joint 1 have an acceleration of .* m/s².* 0.1 m/s²"):
        ac.compensate(plan, ac.ServoModel(kp=25.0, kv=150.0), slow)
