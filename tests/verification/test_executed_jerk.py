"""Executed and commanded jerk of motions whose jerk is known."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import dwell_law
from armcontour.verification.evaluation import commanded_jerk, executed_jerk

ARM = ac.load_arm("pmk3s")
STILL = ac.Trajectory(laws=(dwell_law(np.zeros(2), 1.0),), method="by hand")


def executed(ddq, step, cycle):
    """An execution with given accelerations; nothing else of it counts here."""
    none = np.zeros_like(ddq)
    return ac.Execution(
        arm=ARM,
        set_points=ac.SetPoints(cycle=cycle, q=np.zeros((2, 2)), trajectory=STILL, method="none"),
        t=step * np.arange(len(ddq)),
        q=none,
        dq=none,
        ddq=ddq,
        demand=ddq,
        demand_range=np.stack([ddq.min(axis=0), ddq.max(axis=0)]),
        saturated_time=np.zeros(2),
    )


@pytest.mark.parametrize("step", [1e-3, 2.5e-4])
def test_a_jump_of_acceleration_has_the_jerk_over_one_command_interval(step):
    t = step * np.arange(round(0.2 / step) + 1)
    ramp = 5.0 * np.minimum(t, 0.1) - 8.0 * np.clip(t - 0.1, 0, 0.05)
    jump = np.where(t > 0.05 + step / 4, 0.6, 0.0)
    jerk = executed_jerk(executed(np.stack([ramp, jump], axis=1), step, 4e-3))
    np.testing.assert_allclose(jerk, [8.0, 0.6 / 4e-3], rtol=1e-9)


def test_an_acceleration_at_the_start_counts_as_a_jump():
    jerk = executed_jerk(executed(np.ones((30, 2)) * [0.5, -0.2], 1e-3, 4e-3))
    np.testing.assert_allclose(jerk, [125.0, 50.0])
    # A cycle that is longer than the execution, and an execution of one time.
    np.testing.assert_allclose(executed_jerk(executed(np.ones((3, 2)), 1e-3, 4e-3)), 250.0)
    assert not executed_jerk(executed(np.zeros((1, 2)), 1e-3, 4e-3)).any()


def test_the_jerk_of_set_points_is_their_third_difference():
    cycle = 4e-3
    # Phases of whole cycles, from rest to rest: 7 rad/s³ up, down for twice as long, up.
    jerks = np.repeat([7.0, -7.0, -7.0, 7.0], 10)
    q = 0.3
    v = 0.0
    a = 0.0
    rows = [0.3]
    for j in jerks:
        q += cycle * (v + cycle * (a / 2 + cycle * j / 6))
        v = v + cycle * (a + cycle * j / 2)
        a = a + cycle * j
        rows.append(q)
    points = np.stack([rows, np.full(len(rows), 0.9)], axis=1)
    data = ac.SetPoints(cycle=cycle, q=points, trajectory=STILL, method="none")
    np.testing.assert_allclose(commanded_jerk(data), [7.0, 0.0], rtol=1e-6)
    # One that ends in full motion stops within one interval.
    cut = ac.SetPoints(cycle=cycle, q=points[:21], trajectory=STILL, method="none")
    speed = (points[20, 0] - points[19, 0]) / cycle
    assert commanded_jerk(cut)[0] == pytest.approx(speed / cycle**2, rel=0.1)
    one = ac.SetPoints(cycle=cycle, q=points[:1], trajectory=STILL, method="none")
    assert not commanded_jerk(one).any()


def test_the_execution_of_a_jerk_limited_plan_stays_near_that_jerk():
    path = ac.Path(segments=[ac.Arc(start=(0.40, 0.25), center=(0.35, 0.25), angle=2.0)])
    limits = ac.Limits(joint_acceleration=0.72, joint_jerk=7.2)
    planned = ac.plan(path, ARM, limits)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(planned, servo, ac.Inverse(), cycle=1e-3)
    plant = ac.ServoPlant(ARM, servo, limits)
    evaluation = ac.evaluate(ac.simulate(set_points, plant), path, limits=limits, limit_use=True)
    np.testing.assert_allclose(evaluation.jerk_ratio, evaluation.jerk / 7.2)
    assert 0.99 < evaluation.jerk_ratio.max() < 1.005
    assert evaluation.limit_ratios["joint_jerk"] == pytest.approx(1, abs=1e-4)
    # Without the limit, the plan jumps, and so do set-points without limits.
    free = ac.plan(path, ARM, limits.replace(joint_jerk=np.inf))
    raw = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
    set_points = ac.compensate(free, servo, raw, cycle=1e-3)
    rough = ac.evaluate(ac.simulate(set_points, plant), path, limits=limits)
    assert rough.jerk_ratio.max() > 10 and rough.command_jerk.max() > evaluation.command_jerk.max()
    assert not ac.evaluate(ac.simulate(set_points, plant), path).jerk_ratio.any()
