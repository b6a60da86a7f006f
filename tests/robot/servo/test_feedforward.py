"""Servo models, their feed-forward and their simulation."""

import dataclasses

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.motion import SetPoints

CYCLE = 4e-3  # s, between set-points
LATE = 5.3e-3  # s, dead time
FEED = ("velocity_feedforward", "acceleration_feedforward")
KINDS = {
    "linear": {"velocity_feedforward": 1.01, "acceleration_feedforward": 0.6},
    "step": {"velocity_feedforward": 0.8, "interpolation": "step"},
    "cubic": dict(zip((*FEED, "interpolation"), (0.9, 1.0, "cubic"), strict=True)),
    "first order": {"kv": None, "order": "first", "velocity_feedforward": 1.02},
}


@pytest.fixture(scope="module")
def arm():
    limits = ac.Limits(joint_velocity=[3.0, 3.0], joint_acceleration=[20.0, 20.0])
    return ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)


@pytest.fixture(scope="module")
def plan(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.36, 0.20), (0.36, 0.26)])
    limits = ac.Limits.only(joint_acceleration=[20.0, 20.0], speed=0.2)
    plan = ac.plan(
        ac.round_corners(path, tolerance=2e-3),
        arm,
        limits,
        ac.Optimal(intervals=400, reserve=0.5, configuration="positive"),
    )
    # Its set-points have no limits.
    return dataclasses.replace(plan, limits=None)


def servo_of(kind, **more):
    return ac.ServoModel(**{"kp": 20.0, "kv": 90.0, "dead_time": LATE, **KINDS[kind], **more})


def cubic_of(q):
    """Coefficients of the cubics through set-points, highest power first, (4, intervals)."""
    slope = np.zeros_like(q)
    slope[1:-1] = (q[2:] - q[:-2]) / (2 * CYCLE)
    return CubicHermiteSpline(np.arange(len(q)) * CYCLE, q, slope).c


def rates(q, k, x, kind, cubic):
    """Command of one joint in its interval k after x seconds, and its two rates."""
    if k < 0 or k >= len(q) - 1:
        return q[0 if k < 0 else -1], 0.0, 0.0
    before = (q[k] - q[k - 1]) / CYCLE if k else 0.0
    chord = (q[k + 1] - q[k]) / CYCLE
    if kind == "step":
        return q[k], before, 0.0
    if kind != "cubic":
        return q[k] + x * chord, chord, (chord - before) / CYCLE
    a, b, c, d = cubic[:, k]
    return ((a * x + b) * x + c) * x + d, (3 * a * x + 2 * b) * x + c, 6 * a * x + 2 * b


@pytest.mark.parametrize("limit", [1e3, 4.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_response_solves_the_differential_equation(kind, limit, arm, plan):
    """Integrated from event to event of the command, in the words of the model's docstring."""
    first = kind == "first order"
    if first and limit < 100:
        return
    t = np.arange(25) * CYCLE
    q = np.stack([0.3 + 0.05 * np.sin(40 * t) * t / t[-1], 0.2 - 0.3 * t**2], axis=1)
    servo = servo_of(kind)
    set_points = SetPoints(cycle=CYCLE, q=q, trajectory=plan, method="none")
    limits = None if first else ac.Limits(joint_acceleration=[limit, limit])
    execution = ac.simulate(set_points, ac.ServoPlant(arm, servo, limits), resolution=CYCLE)
    f, g = (float(getattr(servo, name)) for name in FEED)
    kp, kv = 20.0, 90.0
    edges = np.union1d(np.arange(30) * CYCLE, np.arange(30) * CYCLE + LATE)
    for j in range(2):
        joint_command = q[:, j]
        state = np.array([q[0, j], 0.0])
        positions = [q[0, j]]
        cubic = cubic_of(joint_command)
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            k = int(np.floor(((begin + end) / 2 - LATE) / CYCLE))

            def law(now, x, k=k, joint_command=joint_command, cubic=cubic):
                u, du, ddu = rates(joint_command, k, now - LATE - k * CYCLE, kind, cubic)
                if first:
                    return [kp * (u - x[0]) + f * du, 0.0]
                ask = kv * (kp * (u - x[0]) + f * du - x[1]) + g * ddu
                return [x[1], np.clip(ask, -limit, limit)]

            step = solve_ivp(law, (begin, end), state, rtol=1e-9, atol=1e-11, max_step=2e-4)
            state = step.y[:, -1]
            if np.abs(end / CYCLE - np.round(end / CYCLE)) < 1e-6:
                positions.append(state[0])
        n = min(len(positions), len(execution.q))
        assert n > 25
        np.testing.assert_allclose(execution.q[:n, j], positions[:n], atol=2e-8)
    assert first or execution.saturated.any() == (limit < 100)


def test_the_response_equals_the_transfer_function_of_scipy():
    omega = np.array([0.0, 1.0, 30.0, 500.0])
    for kind in KINDS:
        servo = servo_of(kind)
        f, g = (float(getattr(servo, name)) for name in FEED)
        system = (np.trim_zeros([g, 90 * f, 1800], "f"), [1.0, 90.0, 1800.0])
        if servo.kv is None:
            system = ([f, 20.0], [1.0, 20.0])
        expected = np.exp(-1j * omega * LATE) * signal.freqresp(system, omega)[1]
        np.testing.assert_allclose(servo.response(1j * omega)[:, 0], expected, rtol=1e-12)


def follow(plan, arm, servo, limits, method):
    set_points = ac.compensate(plan, servo, COMPENSATIONS[method](), cycle=CYCLE)
    return set_points, ac.simulate(set_points, ac.ServoPlant(arm, servo, limits))


@pytest.mark.parametrize("method", ["inverse", "pole_placement"])
@pytest.mark.parametrize("kind", KINDS)
def test_feedforward_does_not_change_the_error_of_compensated_joints(kind, method, arm, plan):
    servo = servo_of(kind)
    if servo.kv is None and method == "pole_placement":
        return
    plain = servo.replace(**dict.fromkeys(FEED, 0.0))
    errors = []
    alone = []
    for model in (plain, servo):
        set_points, execution = follow(plan, arm, model, arm.limits, method)
        inside = (execution.t > 0) & (execution.t < plan.duration)
        errors.append(np.abs(execution.q[inside] - plan(execution.t[inside])).max())
        # The motion starts and ends at rest, where the plan does.
        assert (set_points.q[0] == plan(0.0)).all() and (
            set_points.q[-1] == plan(plan.duration)
        ).all()
        np.testing.assert_allclose(execution.q[-1], plan(plan.duration), atol=1e-7)
        _, execution = follow(plan, arm, model.replace(dead_time=0.0), arm.limits, "none")
        alone.append(np.abs(execution.q - plan(np.clip(execution.t, 0, plan.duration))).max())
    # Lines have steps in their slope, which feed-forward follows.
    assert errors[1] < (2.5 if method == "inverse" else 1.01) * errors[0]
    # Without compensation, feed-forward leaves a small share of the deviation of the plain servo.
    assert method != "inverse" or errors[1] < 0.2 * alone[1] < 0.2 * 0.35 * alone[0]


OMEGA = np.array([0.0, 1.0, 30.0, 500.0])


def test_the_response_equals_equation_5_and_its_rate_that_of_the_slowest_pole():
    for kp, kv in ((25.0, 150.0), (25.0, 100.0), (60.0, 40.0)):
        response = ac.ServoModel(kp=kp, kv=kv).response(1j * OMEGA)[:, 0]
        _, expected = signal.freqresp(([kp * kv], [1.0, kv, kp * kv]), OMEGA)
        np.testing.assert_allclose(response, expected, rtol=1e-12)
    servo = ac.ServoModel(kp=[25.0, 10.0], kv=150.0).for_joints(2)
    # No static error.
    both = [(1, 1), (3750 / 4054, 1500 / 1804)]
    np.testing.assert_allclose(servo.response([0.0, 2.0]), both)
    for kp, kv in [(25.0, 150.0), (25.0, 100.0), (25.0, 40.0)]:
        slowest = -np.roots([1.0, kv, kp * kv]).real.max()
        np.testing.assert_allclose(ac.ServoModel(kp=kp, kv=kv).slowest, slowest, rtol=1e-6)
    assert ac.ServoModel(kp=[5.0, 7.0], order="first").slowest == 5.0


def test_invalid_servo_models_are_refused(refuses):
    both = {"kp": 25.0, "kv": 150.0}
    for values, *words in (
        ({"kp": 25.0}, "kv"),
        (both | {"order": "first"}, "kv"),
        ({"kp": 25.0, "order": "third"}, "order"),
        *((both | {"dead_time": x}, "dead_time") for x in (-0.01, [0.1, -1], np.inf, 1e5, 1e308)),
        *((both | {"kp": x}, "kp") for x in (0.0, [25.0, 0.0], [], [[25.0]], np.nan, "high")),
        (both | {"kv": -1.0}, "kv", "-1"),
        *((both | {k: x}, k) for k in both for x in (1e300, 1e15, 1e9, 1e-12, 5e-324)),
        *((both | {"velocity_feedforward": x}, "velocity_feed") for x in (3.5, [1.0, -0.1])),
        (both | {"acceleration_feedforward": 1.0}, "specify velocity_feedforward"),
        (
            both | {"order": ("second", "delay"), "kv": [150.0, np.inf], "kp": np.inf},
            "kp is missing",
        ),
        ({"order": ("second", "first"), "kp": 20.0, "kv": np.inf}, "kv is missing"),
        ({"order": ("delay", "third")}, "third"),
        ({"order": "delay", "kv": 90.0}, "delay has no velocity loop"),
        (both | {"friction": -1e-3}, "friction"),
        (both | {"drive_cycle": 1.0}, "drive_cycle"),
        (both | {"acceleration_limit": [1.0, 0.0]}, "acceleration_limit"),
        (both | {"interpolation": "step", "acceleration_feedforward": 1.0}, "held set-points"),
        (both | {"interpolation": "quintic"}, "interpolation"),
    ):
        refuses(lambda x=values: ac.ServoModel(**x), ac.InvalidInput, *words)
    for servo in (
        ac.ServoModel(kp=[25.0, 25.0], kv=150.0),
        ac.ServoModel(order=("delay", "unknown")),
    ):
        refuses(lambda x=servo: x.for_joints(3), ac.InvalidInput, "2 values", "3 joints")
    # Gains fit the cycle.
    servo = ac.ServoModel(kp=25.0, kv=1e6)
    servo.check_gains(1e-3)
    refuses(lambda: servo.check_gains(4e-3), ac.InvalidInput, "0.004 s", "250000 1/s")


SLOW = {
    "first": {"kp": [0.05, 0.4], "order": "first"},
    "lead": {"kp": [0.3, 0.4], "order": "first", "acceleration_feedforward": [0.02, 0.01]},
    "second": {"kp": [0.3, 2.0], "kv": [40.0, 5.0]},
    "swinging": {"kp": [5.0, 3.0], "kv": [4.0, 6.0]},
    "rubbing": {"kp": [0.3, 1.0], "order": "first", "friction": 1e-4},
    "held": {"kp": [0.3, 1.0], "order": "first", "interpolation": "step"},
    "cubic": {"kp": [0.3, 1.0], "kv": 50.0, "interpolation": "cubic"},
}


@pytest.mark.parametrize("kind", SLOW)
def test_a_slow_transient_is_truncated_with_a_bound_of_the_error(kind, arm, plan):
    servo = ac.ServoModel(**SLOW[kind], velocity_feedforward=[0.8, 1.2], acceleration_limit=np.inf)
    set_points = ac.compensate(plan, servo, ac.Inverse())
    end = plan(plan.duration, side="left")
    # A fifth of the motion, in the end at rest at the end of the plan.
    assert set_points.t[-1] < 1.2 * plan.duration + 2 * CYCLE
    np.testing.assert_array_equal(set_points.q[-1], end)
    assert (np.abs(np.diff(set_points.q, axis=0)[-3:]) < 1e-2 * np.ptp(set_points.q, axis=0)).all()
    execution = ac.simulate(set_points, ac.ServoPlant(arm, servo), resolution=1e-3)
    error = np.abs(execution.q - end)[execution.t > plan.duration + CYCLE].max(axis=0)
    assert (error > 1e-5).all()
    # The inverse has interpolation errors.
    simulation_error = 1e-5 if kind != "held" else 2e-4
    assert (error < set_points.truncated + simulation_error).all() and (
        error > 0.5 * set_points.truncated - simulation_error
    ).all()


def test_rigid_bodies_follow_with_feedforward_and_its_compensation():
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.4, -0.1, 0.3), (0.4, 0.1, 0.3)]).oriented(np.diag([1.0, -1, -1]))
    plan = ac.plan(path, arm, arm.limits.replace(speed=0.25, joint_jerk=100.0))
    servo = ac.ServoModel(kp=25.0, kv=150.0, velocity_feedforward=1.0)
    errors = []
    for method in ("inverse_dynamics", "none"):
        set_points = ac.compensate(plan, servo, COMPENSATIONS[method](), arm=arm)
        execution = ac.simulate(set_points, ac.RigidBodyPlant(arm, servo))
        errors.append(ac.evaluate(execution, path).contour_error.rms)
    assert errors[0] < min(1e-6, 0.1 * errors[1])
