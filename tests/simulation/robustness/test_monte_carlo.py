"""Robustness against the reference: the servo plant and evaluate, execution by execution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from soak.certificates import random_job

import armcontour as ac
from armcontour.control.compensation import METHODS
from armcontour.geometry.kernels import search_along
from armcontour.geometry.projection import pack_segments
from armcontour.motion import LapLaw
from armcontour.robot.planar import LinkTube
from armcontour.simulation.robustness import monte_carlo as robustness
from armcontour.simulation.robustness.monte_carlo import (
    Uncertainty,
    jitter_of,
    spread,
    worst_corner,
)

CYCLE = 4e-3
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


@pytest.fixture(scope="module")
def job(mac, rounded, arm, limits):
    """Set-points without compensation, path, arm, servo, limits."""
    set_points = ac.compensate(mac, SERVO, ac.NoCompensation(), cycle=CYCLE)
    return set_points, rounded, arm, SERVO, limits


@pytest.fixture(scope="module")
def leading(mac, job):
    """The same with set-points that saturates most robots of a box."""
    return ac.compensate(mac, SERVO, ac.Inverse(), cycle=CYCLE), *job[1:]


def reference(set_points, path, arm, servo, limits, end_time=None, resolution=1e-3):
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo, limits), resolution=resolution)
    return executed, ac.evaluate(executed, path, end_time=end_time)


def agrees(sampled, set_points, path, arm, servo, limits, end_time=None, resolution=1e-3):
    for i in range(len(sampled)):
        robot_servo = sampled.servo(i, servo)
        executed, judged = reference(
            set_points, path, arm, robot_servo, limits, end_time, resolution
        )
        error = judged.contour_error
        assert (sampled.rms[i], sampled.max[i]) == pytest.approx((error.rms, error.max), rel=1e-3)
        assert sampled.end_time[i] == pytest.approx(judged.end_time, abs=3e-3)
        if servo.order == "second" and end_time is None:
            bounds = np.array(limits.for_joints(arm.dof).acceleration_bounds(arm.dof))
            ratio = (executed.demand_range / bounds).max()
            assert sampled.demand_ratio[i] == pytest.approx(ratio, rel=1e-4)
            longest = executed.saturated_time.max()
            # A demand without steps touches its limit for long, by rounding or not at all.
            slack = 2e-2 if servo.interpolation == "cubic" else 2e-3
            assert sampled.saturated[i] * sampled.end_time[i] == pytest.approx(longest, abs=slack)


SERVOS = {
    "linear": {},
    "step": {"interpolation": "step"},
    "cubic": {"interpolation": "cubic"},
    "late": {"dead_time": [0.0063, 0.0081]},
    "first order": {"kv": None, "order": "first", "interpolation": "linear"},
    "first order, cubic": {"kv": None, "order": "first", "interpolation": "cubic"},
    "underdamped": {"kp": 60.0, "kv": 90.0},
    "fed forward": {"velocity_feedforward": 0.5, "acceleration_feedforward": 0.2},
    "cascade, fed forward": {"ki": [6.0, 0.0], "friction": 2e-4, "velocity_feedforward": 0.3},
    "held and fed forward": {"velocity_feedforward": 0.3, "interpolation": "step"},
}


@pytest.mark.parametrize("kind", SERVOS)
def test_executions_are_those_of_the_servo_plant(kind, job):
    set_points, path, arm, _, limits = job
    servo = ac.ServoModel(**{"kp": 25.0, "kv": 150.0, **SERVOS[kind]})
    setting = set_points, path, arm, servo, limits
    box = Uncertainty(
        gains=0.1, dead_time=1.5e-3 if kind == "late" else 0.0, dead_time_shared=False
    )
    agrees(spread(*setting, box, samples=6, seed=3), *setting)
    if "fed forward" not in kind:
        # Next to no jitter is none.
        sampled = spread(*setting, Uncertainty(jitter=1e-9), samples=1)
        nominal = sampled.nominal_rms, sampled.nominal_max
        assert (sampled.rms[0], sampled.max[0]) == pytest.approx(nominal, rel=1e-4)


@pytest.mark.parametrize(("since", "end_time"), [(0.5, 1.7), (0.1234, 0.8765), (2.0, 2.1)])
def test_errors_between_two_times(job, since, end_time):
    """As on a contour of a program, whose set-points starts with what leads to it."""
    set_points, path, arm, servo, limits = job
    sampled = spread(
        *job, Uncertainty(gains=0.1), samples=4, seed=3, since=since, end_time=end_time
    )
    for i in range(4):
        plant = ac.ServoPlant(arm, sampled.servo(i, servo), limits)
        # Looked at as often as the spread is: between that, errors of micrometres differ by more.
        executed = ac.simulate(set_points, plant, resolution=2e-3)
        deviation = path.project(executed.tool).distance
        inside = executed.t[(executed.t > since) & (executed.t < end_time)]
        t = np.concatenate([[since], inside, [end_time]])
        error = np.interp(t, executed.t, deviation)
        rms = np.sqrt(trapezoid(error**2, t) / (end_time - since))
        assert (sampled.rms[i], sampled.max[i]) == pytest.approx((rms, error.max()), rel=1e-3)


def test_saturated_executions_and_other_limits_and_periods(mac, job):
    _, path, arm, servo, limits = job
    uneven = limits.replace(joint_acceleration=limits.joint_acceleration[:, None] * (-0.8, 1.0))
    for method, cycle, plant_limits in (
        ("inverse", CYCLE, limits),
        ("pole_placement", CYCLE, limits),
        ("inverse", 0.011, uneven),
    ):
        set_points = ac.compensate(mac, servo, METHODS[method](), cycle=cycle)
        setting = set_points, path, arm, servo, plant_limits
        sampled = spread(*setting, Uncertainty(gains=0.1), samples=6)
        assert sampled.saturated.max() > 0.3
        agrees(sampled, *setting)


def test_errors_cover_the_time_asked_for_and_all_between_results(leading):
    for end_time in (5.0, 7.0):
        agrees(
            spread(*leading, Uncertainty(gains=0.1), samples=4, end_time=end_time),
            *leading,
            end_time,
        )
    set_points, path, arm, servo, limits = leading
    sampled = spread(*leading, Uncertainty(gains=0.2), samples=3)
    for i in range(3):
        setting = set_points, path, arm, sampled.servo(i, servo), limits
        error = reference(*setting, resolution=1e-4)[1].contour_error
        assert (sampled.rms[i], sampled.max[i]) == pytest.approx((error.rms, error.max), rel=1e-3)


def test_the_largest_error_of_a_short_motion_is_found_between_results():
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=35.6, kv=106.6, dead_time=4e-3)
    points = [[0.35, 0.2], [0.378, 0.1689], [0.3775, 0.1689]]
    path = ac.round_corners(ac.Path.polyline(points), tolerance=0.15e-3)
    limits = ac.Limits(joint_acceleration=4.1, speed=0.17)
    plan = ac.plan(path, arm, limits, ac.Optimal(reserve=0.1))
    set_points = ac.compensate(plan, servo, cycle=8e-3)
    corner = worst_corner(
        set_points, path, arm, servo, plan.limits, Uncertainty(gains=0.05, dead_time=1e-3)
    )
    for i in range(0, len(corner), 3):
        setting = set_points, path, arm, corner.servo(i, servo), plan.limits
        largest = reference(*setting, resolution=1e-4)[1].contour_error.max
        assert (1 - 1e-4) * largest <= corner.max[i] <= (1 + 1e-3) * largest


def test_a_tool_slower_than_a_millimetre_per_second_still_leaves_its_path():
    job = replace(random_job(16), configuration="positive")
    plan = ac.certify(job)
    setting = plan.set_points, plan.path.path, job.arm, job.plant_servo, plan.run.limits
    sampled = spread(*setting, Uncertainty(), samples=1)
    result = reference(*setting, resolution=1e-4)[1]
    error = result.contour_error
    assert error.t_max > result.settled
    assert sampled.nominal_max == pytest.approx(error.max, rel=1e-3, abs=5e-9)


def test_a_box_of_nothing_is_the_nominal_robot(leading):
    sampled = spread(*leading, Uncertainty(), samples=3)
    assert sampled.names == () and sampled.worst_deviations == {}
    assert (sampled.max == sampled.nominal_max).all() and (sampled.rms == sampled.nominal_rms).all()
    np.testing.assert_array_equal(sampled.kp, 25.0)
    error = reference(*leading)[1].contour_error
    assert sampled.nominal_rms == pytest.approx(error.rms, rel=1e-3)
    corner = worst_corner(*leading, Uncertainty())
    assert len(corner) == 1 and corner.max[0] == sampled.nominal_max


def test_seeds(job):
    box = Uncertainty(gains=[[0.1], [0.05]], jitter=5e-4)
    one, two = (spread(*job, box, samples=40, threads=x) for x in (1, 3))
    np.testing.assert_array_equal(one.max, two.max)
    np.testing.assert_array_equal(spread(*job, box, samples=9).max, one.max[:9])
    assert (spread(*job, box, samples=9, seed=1).max != one.max[:9]).all()
    # What does not vary changes nothing of what does.
    still = spread(*job, Uncertainty(gains=[0.1, 0.0]), samples=9)
    np.testing.assert_array_equal(still.kp[:, 0], one.kp[:9, 0])
    assert (still.kp[:, 1] == 25.0).all()
    assert (np.abs(one.kp / 25 - 1) <= 0.1).all() and (np.abs(one.kv / 150 - 1) <= 0.05).all()
    assert not one.max.flags.writeable


def test_a_dead_time_that_joints_share_draws_the_same_contour(job):
    set_points, path, arm, _, limits = job
    setting = set_points, path, arm, SERVO.replace(dead_time=4e-3), limits
    shared = spread(
        *setting, Uncertainty(dead_time=2e-3, dead_time_shared=True), samples=8, end_time=6.0
    )
    assert shared.names == ("dead time",)
    assert (shared.dead_time[:, 0] == shared.dead_time[:, 1]).all()
    np.testing.assert_allclose(shared.max, shared.nominal_max, rtol=1e-4)
    apart = spread(*setting, Uncertainty(dead_time=2e-3), samples=8)
    assert apart.names == ("dead time of joint 1", "dead time of joint 2")
    assert np.ptp(apart.max) > 0.1 * apart.nominal_max


def test_the_worst_of_a_monotone_box_is_a_corner(job):
    box = Uncertainty(gains=[[0.1], [0.0]])
    corners, drawn = worst_corner(*job, box), spread(*job, box, samples=300)
    assert len(corners) == 4 and corners.seed is None
    assert drawn.max.max() <= corners.max.max()
    # Joints whose gains differ most draw the largest error.
    worst = corners.worst_deviations
    assert worst["kp of joint 1"] == -worst["kp of joint 2"]
    assert abs(worst["kp of joint 1"]) == pytest.approx(0.1)


def test_robots_that_do_not_settle_have_errors_too(job):
    set_points, path, arm, servo, limits = job
    slow = servo.replace(kp=0.02)
    usual, slow_spread = (
        spread(set_points, path, arm, x, limits, Uncertainty(), samples=1) for x in (servo, slow)
    )
    assert 10 * usual.nominal_max < slow_spread.nominal_max < path.length


def test_too_many_corners_are_searched():
    weights = np.random.default_rng(1).normal(size=15)
    signs = robustness._search_corners(lambda x: x @ weights + 0.1 * x[:, 0] * x[:, 1], 15)
    assert signs.shape == (robustness.MAX_CORNERS, 15) and (np.abs(signs) == 1).all()
    np.testing.assert_array_equal(signs[np.argmax(signs @ weights)], np.sign(weights))


def test_jitter_is_a_command_that_comes_unevenly(job):
    """Against set-points every 0.1 ms on the same uneven polyline."""
    set_points, jitter = job[0], 1.5e-3
    sampled = spread(*job, Uncertainty(jitter=jitter), samples=2, seed=5)
    for i in range(2):
        due = np.arange(len(set_points.q)) * CYCLE + jitter_of(5, i, len(set_points.q), jitter)
        fine = np.arange(0, due[-1] + 1e-4, 1e-4)
        q = np.column_stack([np.interp(fine, due, set_points.q[:, j]) for j in range(2)])
        dense = ac.SetPoints(cycle=1e-4, q=q, trajectory=set_points.trajectory, method="x")
        error = reference(dense, *job[1:])[1].contour_error
        assert sampled.rms[i] == pytest.approx(error.rms, rel=3e-3)
        assert sampled.max[i] == pytest.approx(error.max, rel=1e-2)
    assert sampled.nominal_max != sampled.max[0]


def test_a_payload_takes_gain_and_limit_away(job):
    """At the joint behind which nothing turns: its inertia is the same in every pose."""
    set_points, path, arm, servo, limits = job
    tube = LinkTube(outer_diameter=0.05, wall=0.005, density=2700.0)
    loaded = ac.PlanarTwoLink(
        name="loaded",
        base=arm.base,
        links=(arm.link1, arm.link2),
        limits=limits,
        tubes=(tube, tube),
        payload=ac.Payload(mass=0.5),
    )
    sampled = spread(set_points, path, loaded, servo, limits, Uncertainty(payload=0.4), samples=4)
    assert sampled.names == ("payload",) and (np.abs(sampled.payload) <= 0.4).all()
    loaded_mass = loaded.dynamics.mass_matrix(set_points.q)
    for i in range(4):
        chain = loaded.chain.replace(payload=ac.Payload(mass=0.5 + sampled.payload[i]))
        more = type(loaded.dynamics)(chain).mass_matrix(set_points.q)
        ratio = 1 + sampled.payload[i] * robustness._payload_inertia(
            loaded, set_points, Uncertainty(payload=0.4)
        )
        for j in (0, 1):
            np.testing.assert_allclose(ratio[j], (more / loaded_mass)[:, j, j], rtol=1e-9)
        # A constant share would be another servo; along this path it hardly changes.
        kv = 150 / ratio.mean(axis=1)
        bounds = limits.replace(joint_acceleration=limits.joint_acceleration * kv / 150)
        like = ac.ServoModel(kp=25.0, kv=kv)
        error = reference(set_points, path, loaded, like, bounds, resolution=4e-3)[1].contour_error
        assert sampled.max[i] == pytest.approx(error.max, rel=0.05)
    assert np.ptp(sampled.max) > 0.02 * sampled.nominal_max


def test_a_serial_arm_in_space():
    """All joints of a UR5e, on the polyline and arc that its tool draws."""
    arm = ac.load_arm("ur5e")
    t = np.arange(201) * 8e-3
    x = t / t[-1]
    ease = (x - np.sin(2 * np.pi * x) / (2 * np.pi))[:, None]
    q = np.array([0.1, -1.2, 1.4, -1.0, -1.5, 0.2]) + ease * [0.5, 0.2, -0.3, 0.2, 0.1, 0.4]
    dq = np.diff(q, axis=0) / 8e-3
    law = LapLaw(breaks=t, q=q, dq=dq, ddq=np.zeros_like(dq))
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    set_points = ac.SetPoints(cycle=8e-3, q=q, trajectory=trajectory, method="x")
    servo, limits = ac.ServoModel(kp=20.0, kv=100.0), ac.Limits.only(joint_acceleration=2.0)
    setting = set_points, ac.Path.polyline(arm.tool_position(q[::8])), arm, servo, limits
    sampled = spread(*setting, Uncertainty(gains=0.1), samples=4)
    # The error comes to a point at every corner of the path.
    agrees(sampled, *setting, resolution=1e-4)
    corners = worst_corner(*setting, Uncertainty(gains=[[0.1], [0.0]]))
    assert len(corners) == 64 and corners.max.max() >= sampled.nominal_max


def test_another_branch_is_not_the_nearest_and_closed_paths_are_closed():
    """There and back again, 0.1 mm beside the way there."""
    path = ac.Path.polyline([(0, 0), (0.3, 0), (0.3, 1e-4), (0, 1e-4)])
    d2, segment = search_along((0.1, 9e-5, 0.0), pack_segments(path.segments), 0.0, 0, 0.05, 0.15)
    assert segment == 0 and np.sqrt(d2) == pytest.approx(9e-5)
    # The window of time is behind; from joint to joint the nearest place is found all the same.
    path = ac.Path.polyline([(0.01 * i, 0.002 * (i % 2)) for i in range(40)])
    x, y = path(np.array([0.3]))[0] + [0.0, 0.02]
    rows, segment = pack_segments(path.segments), 0
    for _ in range(40):
        squared, segment = search_along((x, y, 0.0), rows, 0.0, segment, -1.0, 0.0)
    expected = path.project(np.array([[x, y]])).distance[0]
    assert np.sqrt(squared) == pytest.approx(expected)
    starts = (0.40, 0.2), (0.30, 0.2)
    half = [ac.Arc(start=x, center=(0.35, 0.2), angle=np.pi) for x in starts]
    path = ac.Path.from_segments(half)
    x, y = path(np.array([0.01]))[0]
    rows, window = pack_segments(path.segments), (1, path.length - 0.02, path.length)
    open_, _ = search_along((x, y, 0.0), rows, 0.0, *window)
    closed, segment = search_along((x, y, 0.0), rows, path.length, *window)
    assert np.sqrt(closed) < 1e-12 and segment == 0 and np.sqrt(open_) > 5e-3


def test_refusals(job, refuses):
    set_points, path, arm, servo, limits = job
    lag, flat = ac.ServoModel(kp=25.0, order="first"), ac.Path.polyline([(0, 0, 0), (1, 0, 0)])
    for box, spread_servo, way, more in (
        (Uncertainty(gains=[0.1, 0.1, 0.1]), servo, path, {}),
        (Uncertainty(dead_time=1e-3), servo, path, {}),
        (Uncertainty(jitter=2e-3), servo, path, {}),
        (Uncertainty(payload=1.0), servo, path, {}),
        (Uncertainty(payload=1.0), lag, path, {}),
        (Uncertainty(), servo, flat, {}),
        *((Uncertainty(), servo, path, x) for x in ({"samples": 0}, {"threads": 0})),
        (Uncertainty(), servo, path, {"since": 1.0, "end_time": 0.5}),
        (Uncertainty(), lambda: ac.ServoModel(kp=1e9, kv=1e300), path, {}),
    ):

        def call(box=box, spread_servo=spread_servo, way=way, more=more):
            spread(
                set_points,
                way,
                arm,
                spread_servo() if callable(spread_servo) else spread_servo,
                limits,
                box,
                **more,
            )

        refuses(call, ac.InvalidInput)
