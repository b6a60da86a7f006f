"""Logs with saturated drives, coloured residuals, and unknown drive cycles."""

import math

import numpy as np
import pytest
from numba import njit

import armcontour as ac
from armcontour.control.identification import Log, identify

CYCLE = 1e-3


@njit
def run_loop(u, kp, kv, acceleration, velocity):
    """Positions of a sampled loop with limits of acceleration and of velocity."""
    q = u[0]
    w = 0.0
    measured = np.empty(len(u))
    for k in range(len(u)):
        measured[k] = q
        velocity_command = min(max(kp * (u[k] - q), -velocity), velocity)
        a = min(max(kv * (velocity_command - w), -acceleration), acceleration)
        w += CYCLE * a
        q += CYCLE * w
    return measured


def moves(top, seconds=5.0, seed=2):
    """Command of moves with a constant acceleration, whose largest one is `top` [rad/s²]."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds / CYCLE)) * CYCLE
    a = np.zeros(len(t))
    k = 200
    while k < len(t) - 900:
        n = random.integers(60, 220)
        size = top * random.choice([-1, 1]) * random.uniform(0.4, 1)
        rest = random.integers(0, 150)
        for sign, begin in ((1, k), (-1, k + n + rest)):
            a[begin : begin + n] = sign * size
        k += 2 * n + rest + random.integers(0, 150)
    return t, np.cumsum(np.cumsum(a)) * CYCLE**2


def log_of(t, u, y, noise=0.0):
    y = y + noise * np.random.default_rng(5).normal(size=y.shape)
    return Log(t=t, command=u, measured=y, interpolation="linear", source="log.csv")


@pytest.mark.parametrize(("noise", "near"), [(0.0, 2e-4), (2e-6, 2e-3)])
def test_saturation_does_not_change_the_identified_gains(noise, near):
    joints = []
    for top in (1.4, 0.6):
        t, u = moves(top)
        log = log_of(t, u, run_loop(u, 25.0, 150.0, 0.9, np.inf), noise)
        joints.append(identify(log).joints[0])
    hard, gentle = joints
    assert all(x in hard.saturation for x in ("joint 1", "0.9 rad/s²"))
    assert not gentle.saturation
    assert hard.acceleration_limit.value == pytest.approx(0.9, rel=0.01)
    assert hard.written and math.isinf(gentle.servo.acceleration_limit)
    assert hard.kp.value == pytest.approx(gentle.kp.value, rel=near)
    assert hard.kv.value == pytest.approx(gentle.kv.value, rel=10 * near)


def test_a_command_at_the_limit_that_the_joint_follows_is_not_saturation():
    t, u = moves(0.9)
    a = np.sign(np.diff(u, 2, append=[u[-1]] * 2)) * 0.9
    u = np.cumsum(np.cumsum(a)) * CYCLE**2
    joint = identify(log_of(t, u, run_loop(u, 40.0, 200.0, np.inf, np.inf), 2e-6)).joints[0]
    assert not joint.saturation and joint.order == "second"


def test_a_velocity_limit_is_identified():
    t, u = moves(3.0)
    log = log_of(t, u, run_loop(u, 25.0, 150.0, np.inf, 0.25), 1e-6)
    joint = identify(log).joints[0]
    assert "0.25 rad/s " in joint.saturation
    assert joint.kp.value == pytest.approx(25.0, rel=0.02)


@pytest.mark.parametrize(("kv", "limit"), [(150.0, 0.247), (120.0, 0.1)])
def test_a_joint_is_identified_from_samples_below_its_velocity_limit(kv, limit):
    """The excitation of the guide, with a step there and back."""
    t = np.arange(0, 30, CYCLE)
    f = np.fft.rfftfreq(len(t), CYCLE)
    band = (f >= 0.5) & (f <= 25.0)
    phases = np.random.default_rng(0).uniform(size=len(f))
    u = np.fft.irfft(band * np.exp(2j * np.pi * phases), len(t))
    u *= 5e-3 / np.abs(u).max()
    u[(t > 20) & (t < 25)] += 0.5
    joint = identify(log_of(t, u, run_loop(u, 25.0, kv, np.inf, limit), 1e-6)).joints[0]
    assert joint.order == "second" and f"{limit:g} rad/s " in joint.saturation
    assert joint.kp.value == pytest.approx(25.0, rel=0.02) and joint.share < 0.05


def test_a_limit_above_a_planned_plateau_is_identified():
    """Most moves have an acceleration of 0.9 times the limit."""
    t, u = moves(1.0)
    a = np.sign(np.diff(u, 2, append=[u[-1]] * 2)) * 0.9
    a[2000:2400] *= 1.5
    u = np.cumsum(np.cumsum(a)) * CYCLE**2
    joint = identify(log_of(t, u, run_loop(u, 40.0, 200.0, 1.0, np.inf))).joints[0]
    assert "1 rad/s² " in joint.saturation
    assert joint.kp.value == pytest.approx(40.0, rel=0.02)


@pytest.fixture(scope="module")
def hal():
    """Path, plan, robot and the saturating log of a run whose gains are wrong, as on LinuxCNC."""
    arm = ac.load_arm("pmk3s")
    points = ((0.35, 0.1), (0.41, 0.15), (0.28, 0.3))
    path = ac.round_corners(ac.Path.polyline(points), tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    plan = ac.plan(path, arm, limits, ac.Optimal(reserve=0.02))
    robot = ac.ServoPlant(arm, ac.ServoModel(kp=25.0, kv=150.0, drive_cycle=CYCLE))
    first = ac.compensate(plan, ac.ServoModel(kp=20.0, kv=120.0), cycle=4e-3)
    execution = ac.simulate(first, robot, resolution=CYCLE)
    times = first.start_time + np.arange(len(first.q)) * first.cycle
    u = np.stack([np.interp(execution.t, times, x) for x in first.q.T], axis=1)
    return path, plan, robot, log_of(execution.t, u, execution.q)


def test_the_log_of_a_saturated_run_gives_the_compensation_of_the_next_run(hal):
    path, plan, robot, log = hal
    exact = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
    for drive_cycle, bound in ((None, 5e-7), (CYCLE, 1e-7)):
        fit = identify(log, ac.ServoFit(drive_cycle=drive_cycle))
        assert all("0.72 rad/s²" in x.saturation for x in fit.joints)
        with pytest.warns(UserWarning, match="one program"):
            set_points = ac.compensate(plan, fit.servo_model(), exact, cycle=4e-3)
        assert ac.evaluate(ac.simulate(set_points, robot), path).contour_error.rms <= bound
