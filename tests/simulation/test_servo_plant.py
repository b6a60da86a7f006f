"""The servo plant: rest, settling, saturation, sample interval and refusals."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

import armcontour as ac
from armcontour.motion import LapLaw
from armcontour.robot.chain import Chain
from armcontour.robot.serial import SerialArm


def make_set_points(q, cycle=0.02):
    law = LapLaw(
        breaks=np.array([0.0, 1.0]), q=np.zeros((2, 2)), dq=np.zeros((1, 2)), ddq=np.zeros((1, 2))
    )
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    return ac.SetPoints(cycle=cycle, q=np.asarray(q, float), trajectory=trajectory, method="x")


def plant(arm, kp=25.0, kv=150.0, limit=np.inf, interpolation="linear"):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    return ac.ServoPlant(arm, servo, ac.Limits.only(joint_acceleration=limit))


SERVO = ac.ServoModel(kp=25.0, kv=150.0)
LAG = ac.ServoModel(kp=25.0, order="first")
RANDOM = 0.1 * np.random.default_rng(0).normal(size=(30, 2))


def test_an_execution_starts_and_ends_at_rest(arm):
    execution = ac.simulate(make_set_points(RANDOM), plant(arm, limit=0.72))
    np.testing.assert_array_equal(execution.q[0], RANDOM[0])
    np.testing.assert_array_equal(execution.dq[0], 0)
    np.testing.assert_allclose(execution.q[-1], RANDOM[-1], atol=1e-8)
    np.testing.assert_allclose(execution.dq[-1], 0, atol=1e-8)
    np.testing.assert_allclose(np.diff(execution.t), execution.t[1], rtol=1e-9)
    execution = ac.simulate(make_set_points([(0.3, 0.4)]), plant(arm, limit=0.72))
    np.testing.assert_array_equal(execution.q, [(0.3, 0.4)] * len(execution.q))
    np.testing.assert_array_equal(execution.peak_demand, 0)
    np.testing.assert_array_equal(execution.saturated_time, 0)


def test_the_resolution_changes_only_the_sample_interval(arm):
    delayed = ac.ServoModel(kp=25.0, kv=150.0, interpolation="cubic", dead_time=[0.0123, 0.0567])
    uneven = ac.Limits.only(joint_acceleration=[[-1.0, 3.0], [-2.0, 0.5]])
    plants = [
        plant(arm, limit=limit, interpolation=interpolation)
        for limit, interpolation in product((None, 0.72, [3.0, 0.5]), ("linear", "step"))
    ]
    for simulated in (*plants, ac.ServoPlant(arm, delayed, uneven)):
        coarse = ac.simulate(make_set_points(RANDOM), simulated, resolution=0.02)
        fine = ac.simulate(make_set_points(RANDOM), simulated, resolution=0.001)
        n = len(coarse.t) - 1
        np.testing.assert_allclose(fine.t[: 20 * n + 1 : 20], coarse.t, atol=1e-9)
        np.testing.assert_allclose(fine.q[: 20 * n + 1 : 20], coarse.q, atol=1e-10)
        np.testing.assert_allclose(fine.dq[: 20 * n + 1 : 20], coarse.dq, atol=1e-8)
        np.testing.assert_allclose(fine.peak_demand, coarse.peak_demand, rtol=1e-9)
        np.testing.assert_allclose(fine.saturated_time, coarse.saturated_time, rtol=1e-6, atol=1e-9)
    for resolution in (0.02, 0.03, 0.0061, 1e-3):
        execution = ac.simulate(make_set_points(RANDOM), plant(arm), resolution=resolution)
        assert execution.t[1] <= resolution * (1 + 1e-12)
        assert np.abs(np.mod(0.02 / execution.t[1] + 0.5, 1) - 0.5) < 1e-9, resolution


def test_saturated_time_and_peak_demand_are_those_of_the_demand(arm):
    execution = ac.simulate(
        make_set_points(RANDOM, 0.05), plant(arm, limit=[2.0, 5.0]), resolution=1e-5
    )
    counted = (np.abs(execution.demand) > [2.0, 5.0]).sum(axis=0) * execution.t[1]
    np.testing.assert_allclose(execution.saturated_time, counted, rtol=2e-3)
    np.testing.assert_allclose(
        execution.peak_demand, np.abs(execution.demand).max(axis=0), rtol=1e-4
    )
    assert (execution.saturated_time > 0.1).all()
    execution = ac.simulate(make_set_points(RANDOM), plant(arm, limit=[0.72, 3.0]), resolution=1e-3)
    np.testing.assert_array_equal(
        execution.ddq, np.clip(execution.demand, [-0.72, -3.0], [0.72, 3.0])
    )
    assert (np.abs(execution.demand).max(axis=0) > [0.72, 3.0]).all()
    # And they are what moves the joints: dq is their integral. Edges of saturation are kinks.
    moved = np.cumsum((execution.ddq[1:] + execution.ddq[:-1]) / 2 * execution.t[1], axis=0)
    np.testing.assert_allclose(execution.dq[1:], moved, atol=2e-2)


def test_without_limits_the_servo_does_not_saturate(arm, servo):
    execution = ac.simulate(make_set_points(1e3 * RANDOM), plant(arm))
    np.testing.assert_array_equal(execution.saturated_time, 0)
    np.testing.assert_array_equal(execution.ddq, execution.demand)
    simulated = ac.ServoPlant(arm, LAG)
    assert simulated.saturation == "none" and np.isinf(simulated.acceleration).all()
    execution = ac.simulate(make_set_points(RANDOM), simulated)
    assert (execution.peak_demand > 0.72).all()  # what it would have taken is said all the same
    np.testing.assert_array_equal(execution.saturated_time, 0)
    np.testing.assert_array_equal(ac.ServoPlant(arm, servo).acceleration, [0.72, 0.72])
    free = ac.ServoPlant(arm, servo, ac.Limits.only())
    np.testing.assert_array_equal(free.acceleration, [np.inf, np.inf])


def test_dead_time_and_start_time_delay_the_command(arm):
    # A motion that is over before the first joint begins: rest is when the last set-point arrived.
    q = np.linspace((0.0, 0.0), (0.01, 0.02), 5)
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=[0.5, 0.25])
    execution = ac.simulate(
        make_set_points(q), ac.ServoPlant(arm, servo, ac.Limits.only()), resolution=0.01
    )
    np.testing.assert_array_equal(execution.q[execution.t <= 0.5, 0], 0.0)
    np.testing.assert_array_equal(execution.q[execution.t <= 0.25, 1], 0.0)
    np.testing.assert_allclose(execution.q[-1], q[-1], atol=1e-8)
    prompt = ac.simulate(make_set_points(q), plant(arm), resolution=0.01)
    np.testing.assert_allclose(execution.q[50:100, 0], prompt.q[:50, 0], atol=1e-12)
    np.testing.assert_allclose(execution.q[25:75, 1], prompt.q[:50, 1], atol=1e-12)
    first = make_set_points(RANDOM)
    one = ac.simulate(first, plant(arm, limit=0.72))
    for start in (-0.06, -0.0537):
        other = ac.simulate(replace(first, start_time=start), plant(arm, limit=0.72))
        np.testing.assert_allclose(other.t, one.t + start, atol=1e-12)
        np.testing.assert_array_equal(other.q, one.q)
        assert (0.0 in other.t) == (start == -0.06)


def test_acceleration_limits_can_differ_by_direction(arm):
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    limits = ac.Limits.only(joint_acceleration=[[-0.5, 2.0]])
    execution = ac.simulate(make_set_points(RANDOM), ac.ServoPlant(arm, servo, limits))
    assert execution.ddq.max() == 2.0 and execution.ddq.min() == -0.5
    same = ac.Limits.only(joint_acceleration=[[-2.0, 2.0]])
    one, other = (
        ac.simulate(make_set_points(RANDOM), ac.ServoPlant(arm, servo, x))
        for x in (same, ac.Limits.only(joint_acceleration=2.0))
    )
    np.testing.assert_array_equal(one.q, other.q)


def pendulum(viscous, gravity=0.0):
    """A point mass of 2 kg at 0.5 m that lies along x at 0, with an inertia of 0.6 kg m²."""
    chain = Chain(
        joints=("hinge",),
        rotations=np.eye(3)[None],
        positions=np.zeros((1, 3)),
        axes=[[0.0, -1.0, 0.0]],
        masses=[2.0],
        centers=[[0.5, 0.0, 0.0]],
        inertias=np.zeros((1, 3, 3)),
        armature=[0.1],
        viscous=[viscous],
        gravity=[0.0, 0.0, -gravity],
    )
    return SerialArm(name="pendulum", chain=chain, limits=ac.Limits())


def test_saturation_is_by_default_that_of_the_limited_quantity():
    torque = ac.Limits.only(joint_torque=30.0)
    both = torque.replace(joint_acceleration=1.0)
    hung = pendulum(0.0)
    for plant_arm, limits, model, expected in (
        (hung, both, SERVO, "acceleration"),
        (hung, torque, SERVO, "none"),
        (hung, ac.Limits.only(joint_velocity=1.0), SERVO, "none"),
        (hung, both, LAG, "none"),
        (hung, torque, LAG, "none"),
    ):
        assert ac.ServoPlant(plant_arm, model, limits).saturation == expected


def test_demand_range_has_minimum_and_maximum(arm):
    limits = ac.Limits.only(joint_acceleration=[[-1.0, 2.0], [-3.0, 5.0]])
    lag = LAG.replace(interpolation="cubic")
    cases = [
        (SERVO.replace(interpolation=x), bounds, 1e-3)
        for x in ("linear", "cubic")
        for bounds in (limits, ac.Limits.only(), ac.Limits.only(joint_acceleration=3.0))
    ]
    for servo, bounds, near in (*cases, (lag, ac.Limits.only(), 1e-2)):
        simulated = ac.ServoPlant(arm, servo, bounds)
        execution = ac.simulate(make_set_points(RANDOM, 0.05), simulated, resolution=2e-5)
        demand_range = [execution.demand.min(axis=0), execution.demand.max(axis=0)]
        np.testing.assert_allclose(execution.demand_range, demand_range, rtol=near)
        np.testing.assert_array_equal(
            execution.peak_demand, np.abs(execution.demand_range).max(axis=0)
        )


def test_a_motion_that_does_not_settle_ends_with_its_remaining_error(arm):
    """Within a minute of patience, however long the motion was."""
    execution = ac.simulate(make_set_points([(0, 0), (0, 1)]), plant(arm, kp=0.01), resolution=0.02)
    waited = execution.t[-1] - 0.02
    assert 60.0 < waited < 61.0
    # The slow one of both decay rates of s² + kv s + kp kv, and its part of a step.
    fast, slow = sorted(np.roots([1.0, 150.0, 1.5]).real)
    remainder = (fast * np.exp(slow * waited) - slow * np.exp(fast * waited)) / (fast - slow)
    np.testing.assert_allclose(execution.unsettled, [0.0, remainder], rtol=2e-4)
    np.testing.assert_array_equal(execution.unsettled, np.abs(execution.q[-1] - (0, 1)))
    settled = ac.simulate(make_set_points([(0, 0), (0, 1)]), plant(arm))
    assert settled.unsettled is None and settled.t[-1] < 5.0


def test_invalid_set_points_and_options_are_refused(arm, refuses):
    set_points = make_set_points(RANDOM)
    for call, words in (
        (partial(ac.simulate, set_points, "plant"), "plant must be a Plant"),
        (partial(ac.simulate, set_points, plant(arm), resolution=0.0), "above zero"),
        (partial(ac.simulate, set_points, plant(arm), resolution=np.nan), "finite"),
        (partial(ac.simulate, make_set_points(np.zeros((4, 3))), plant(arm)), "have 3 joints"),
        (partial(plant, arm, kp=[1.0, 2.0, 3.0]), "kp has 3 values"),
        (partial(plant, arm, limit=[1.0]), "joint_acceleration has 1 values"),
        (partial(ac.ServoPlant, arm, SERVO, saturation="jerk"), "acceleration, none"),
        (partial(ac.ServoPlant, arm, LAG, saturation="acceleration"), "is of order first"),
    ):
        refuses(call, ac.InvalidInput, words)
    assert np.isinf(ac.ServoPlant(arm, SERVO, saturation="none").acceleration).all()


def test_a_loop_that_is_unstable_at_the_cycle_of_its_drive_is_refused(arm, refuses):
    set_points = make_set_points(RANDOM)
    for servo, joint, words in (
        (SERVO.replace(kv=[100.0, 150.0], drive_cycle=0.016), 1, "kv times drive_cycle is 2.4"),
        (LAG.replace(kp=120.0, drive_cycle=0.02), 0, "kp times drive_cycle is 2.4"),
    ):
        for saturation in ("none", None):
            refuses(
                partial(ac.simulate, set_points, ac.ServoPlant(arm, servo, saturation=saturation)),
                ac.ExecutionError,
                words,
                "unstable",
                joint=joint,
                allowed=2.0,
            )
    # The remedy of the message works.
    stable = ac.ServoPlant(arm, SERVO.replace(kv=124.0, drive_cycle=0.016), saturation="none")
    assert np.isfinite(ac.simulate(set_points, stable).q).all()
