"""Servos with feed-forward: against SciPy's integrator, and what compensation makes of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

import armcontour as ac
from armcontour.motion import TaughtData

PERIOD = 4e-3
KINDS = {
    "linear": {"velocity_feedforward": 1.01, "acceleration_feedforward": 0.6},
    "step": {"velocity_feedforward": 0.8, "interpolation": "step"},
    "cubic": {
        "velocity_feedforward": 0.9,
        "acceleration_feedforward": 1.0,
        "interpolation": "cubic",
    },
    "first order": {"kv": None, "order": "first", "velocity_feedforward": 1.02},
}


@pytest.fixture(scope="module")
def arm():
    limits = ac.Limits(joint_velocity=[3.0, 3.0], joint_acceleration=[20.0, 20.0])
    return ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)


@pytest.fixture(scope="module")
def plan(arm):
    path = ac.Path.polyline([(0.30, 0.20), (0.36, 0.20), (0.36, 0.26)])
    limits = ac.Limits(joint_acceleration=[20.0, 20.0], speed=0.2)
    return ac.plan(ac.round_corners(path, tolerance=2e-3), arm, limits, intervals=400, reserve=0.5)


def servo_of(kind: str, **more: object) -> ac.ServoModel:
    return ac.ServoModel(**{"kp": 20.0, "kv": 90.0, "dead_time": 5.3e-3, **KINDS[kind], **more})


def rates(q, k, x, kind):
    """Command of one joint in its interval k after x seconds, and its two rates."""
    if k < 0 or k >= len(q) - 1:
        return q[0 if k < 0 else -1], 0.0, 0.0
    before = (q[k] - q[k - 1]) / PERIOD if k else 0.0
    chord = (q[k + 1] - q[k]) / PERIOD
    if kind == "step":
        return q[k], before, 0.0
    if kind != "cubic":
        return q[k] + x * chord, chord, (chord - before) / PERIOD
    slope = np.zeros_like(q)
    slope[1:-1] = (q[2:] - q[:-2]) / (2 * PERIOD)
    cubic = CubicHermiteSpline([0.0, PERIOD], q[k : k + 2], slope[k : k + 2])
    return cubic(x), cubic(x, 1), cubic(x, 2)


@pytest.mark.parametrize("limit", [1e3, 4.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_response_is_that_of_the_differential_equation(kind, limit, arm, plan):
    """Integrated from event to event of the command, in the words of the model's docstring."""
    if kind == "first order" and limit < 100:
        return
    t = np.arange(60) * PERIOD
    q = np.stack([0.3 + 0.05 * np.sin(20 * t) * t / t[-1], 0.2 - 0.1 * t**2], axis=1)
    servo = servo_of(kind)
    taught = TaughtData(period=PERIOD, q=q, trajectory=plan, method="none")
    limits = ac.Limits(joint_acceleration=[limit, limit])
    plant = ac.ServoPlant(arm, servo, None if kind == "first order" else limits)
    done = ac.execute(taught, plant, resolution=PERIOD)
    f, g = float(servo.velocity_feedforward), float(servo.acceleration_feedforward)
    kp, kv, late = 20.0, 90.0, 5.3e-3
    for j in range(2):
        state, found = np.array([q[0, j], 0.0]), [q[0, j]]
        edges = np.union1d(np.arange(70) * PERIOD, np.arange(70) * PERIOD + late)
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            middle = (begin + end) / 2 - late
            k = int(np.floor(middle / PERIOD))

            def law(now, x, k=k, own=q[:, j]):
                u, du, ddu = rates(own, k, now - late - k * PERIOD, kind)
                if kind == "first order":
                    return [kp * (u - x[0]) + f * du, 0.0]
                ask = kv * (kp * (u - x[0]) + f * du - x[1]) + g * ddu
                return [x[1], np.clip(ask, -limit, limit)]

            step = solve_ivp(law, (begin, end), state, rtol=1e-9, atol=1e-11, max_step=2e-4)
            state = step.y[:, -1]
            if np.abs(end / PERIOD - np.round(end / PERIOD)) < 1e-6:
                found.append(state[0])
        n = min(len(found), len(done.q))
        assert n > 60
        np.testing.assert_allclose(done.q[:n, j], found[:n], atol=2e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_the_transfer_function(kind):
    servo = servo_of(kind)
    f, g = float(servo.velocity_feedforward), float(servo.acceleration_feedforward)
    omega = np.array([0.0, 1.0, 30.0, 500.0])
    system = (np.trim_zeros([g, 90 * f, 1800], "f"), [1.0, 90.0, 1800.0])
    if servo.kv is None:
        system = ([f, 20.0], [1.0, 20.0])
    _, expected = signal.freqresp(system, omega)
    late = np.exp(-1j * omega * 5.3e-3)
    np.testing.assert_allclose(servo.response(1j * omega)[:, 0], late * expected, rtol=1e-12)


@pytest.mark.parametrize("method", ["inverse", "pole_placement"])
@pytest.mark.parametrize("kind", KINDS)
def test_compensated_joints_follow_the_plan_as_well_as_without_feedforward(kind, method, arm, plan):
    servo = servo_of(kind)
    if servo.kv is None and method == "pole_placement":
        return
    plain = servo.replace(velocity_feedforward=0.0, acceleration_feedforward=0.0)
    off = []
    for own in (plain, servo):
        taught = ac.compensate(plan, own, method=method, period=PERIOD)
        done = ac.execute(taught, ac.ServoPlant(arm, own, arm.limits))
        inside = (done.t > 0) & (done.t < plan.duration)
        off.append(np.abs(done.q[inside] - plan(done.t[inside])).max())
        # The motion starts and ends at rest, where the plan does.
        assert (taught.q[0] == plan(0.0)).all() and (taught.q[-1] == plan(plan.duration)).all()
        np.testing.assert_allclose(done.q[-1], plan(plan.duration), atol=1e-7)
    # Lines have steps in their slope, which feed-forward follows.
    assert off[1] < (2.5 if method == "inverse" else 1.01) * off[0]
    if method == "pole_placement":
        return
    # Without compensation, feed-forward leaves a small share of the deviation of the plain servo.
    alone = []
    for own in (plain, servo):
        taught = ac.compensate(plan, own.replace(dead_time=0.0), method="none", period=PERIOD)
        done = ac.execute(taught, ac.ServoPlant(arm, own.replace(dead_time=0.0), arm.limits))
        alone.append(np.abs(done.q - plan(np.clip(done.t, 0, plan.duration))).max())
    assert off[1] < 0.2 * alone[1] < 0.2 * 0.35 * alone[0]


def test_held_set_points_cancel_feedforward_exactly(arm, plan):
    servo = servo_of("step")
    plain = servo.replace(velocity_feedforward=0.0)
    one, other = (
        ac.execute(ac.compensate(plan, x, method="inverse", period=PERIOD), ac.ServoPlant(arm, x))
        for x in (plain, servo)
    )
    n = min(len(one.t), len(other.t))
    np.testing.assert_allclose(one.q[:n], other.q[:n], atol=1e-9)


def test_rigid_bodies_follow_with_feedforward_and_its_compensation():
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.4, -0.1, 0.3), (0.4, 0.1, 0.3)]).oriented(np.diag([1.0, -1, -1]))
    limits = arm.limits.replace(speed=0.25, joint_jerk=100.0)
    plan = ac.plan(path, arm, limits)
    errors = {}
    for f in (0.0, 1.0):
        servo = ac.ServoModel(kp=25.0, kv=150.0, velocity_feedforward=f)
        for method in ("none", "inverse_dynamics"):
            taught = ac.compensate(plan, servo, method=method, arm=arm)
            done = ac.execute(taught, ac.RigidBodyPlant(arm, servo))
            errors[f, method] = ac.evaluate(done, path).contour_error.rms
    assert errors[1.0, "inverse_dynamics"] < 1e-6
    assert errors[1.0, "inverse_dynamics"] < 0.1 * errors[1.0, "none"]
