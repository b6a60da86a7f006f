"""Every servo model against SciPy: its command, its dead time, its saturation."""

import math

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

import armcontour as ac
from armcontour.motion import LapLaw

CYCLE = 0.02
# Overdamped, critical, underdamped.
GAINS = ((25.0, 150.0), (25.0, 100.0), (60.0, 40.0))
# Also nearly critical, hardly damped and stiff.
LINEAR_GAINS = (*GAINS, (25.0, 100.0000001), (500.0, 5.0), (5.0, 2000.0))


def make_set_points(q, cycle=CYCLE):
    rest = np.zeros((1, 2))
    law = LapLaw(breaks=np.array([0.0, 1.0]), q=np.zeros((2, 2)), dq=rest, ddq=rest)
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    return ac.SetPoints(cycle=cycle, q=q, trajectory=trajectory, method="x")


def command(q, interpolation, cycle=CYCLE):
    """The command of one joint as a function of time, from its definition."""
    t = np.arange(len(q)) * cycle
    if interpolation == "linear":
        return lambda time: float(np.interp(time, t, q))
    if interpolation == "step":
        return lambda time: float(q[min(max(math.floor(time / cycle + 1e-9), 0), len(q) - 1)])
    slope = np.concatenate([[0.0], (q[2:] - q[:-2]) / (2 * cycle), [0.0]])
    spline = CubicHermiteSpline(t, q, slope)
    return lambda time: float(spline(min(max(time, 0.0), t[-1])))


def integrated(servo, j, u, dead, times, start, bounds=(-np.inf, np.inf), cycle=CYCLE, fine=1.0):
    """One joint by DOP853, piece by piece between the instants at which its command has a kink."""
    kp, kv = servo.kp[j], servo.kv[j]
    kinks = np.arange(-1, len(times) + 50) * cycle + dead
    stops = np.union1d(times, kinks[(kinks > 0) & (kinks < times[-1])])
    stops = stops[np.append(True, np.diff(stops) > 1e-10)]

    def motion(t, x, inside):
        # A held command jumps at the ends of a piece, so it is evaluated inside.
        command_seen = u(min(max(t, inside[0] + 1e-11), inside[1] - 1e-11) - dead)
        # `np.clip` would take ten times as long.
        return [
            x[1],
            min(max(kv * (kp * (command_seen - x[0]) - x[1]), bounds[0]), bounds[1]),
        ]

    state = np.array([start, 0.0])
    states = {float(stops[0]): state}
    for a, b in zip(stops[:-1], stops[1:], strict=True):
        step = np.inf if np.isinf(bounds[1]) else fine
        state = solve_ivp(
            motion, (a, b), state, method="DOP853", args=((a, b),), rtol=1e-11, atol=1e-13,
            max_step=step,
        ).y[:, -1]  # fmt: skip
        states[float(b)] = state
    keys = np.array(list(states))
    return np.array([states[keys[np.argmin(np.abs(keys - t))]] for t in times])


@pytest.mark.parametrize("interpolation", ["linear", "step"])
@pytest.mark.parametrize("cycle", [4e-3, 0.05])
def test_unsaturated_servos_match_scipy_lsim(arm, interpolation, cycle):
    for kp, kv in LINEAR_GAINS:
        q = np.random.default_rng(2).normal(size=(40, 2))
        servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
        plant = ac.ServoPlant(arm, servo, ac.Limits.only())
        execution = ac.simulate(make_set_points(q, cycle), plant, resolution=cycle)
        matrices = [[0, 1], [-kp * kv, -kv]], [[0], [kp * kv]], [[1, 0], [0, 1]], [[0], [0]]
        system = signal.StateSpace(*matrices)
        t = np.arange(40) * cycle
        for j in range(2):
            # Between set-points as the plant is: exact, not a discretisation.
            moved = q[:, j] - q[0, j]
            _, expected, _ = signal.lsim(system, moved, t, interp=interpolation == "linear")
            np.testing.assert_allclose(execution.q[:40, j] - q[0, j], expected[:, 0], atol=1e-9)
            np.testing.assert_allclose(execution.dq[:40, j], expected[:, 1], atol=1e-9 * kv)


@pytest.mark.parametrize("gains", GAINS)
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "step"])
def test_saturated_servos_match_a_numerical_integration(arm, gains, interpolation):
    kp, kv = gains
    # With and without dead time, in turn.
    dead = 0.0137 if (gains == GAINS[1]) == (interpolation == "step") else 0.0
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation, dead_time=dead).for_joints(2)
    limits = ac.Limits.only(joint_acceleration=[[-2.0, 0.72], [-1.0, 3.0]])
    q = np.cumsum(np.random.default_rng(4).normal(size=(12, 2)), axis=0) * (3e-3, 1e-2)
    execution = ac.simulate(make_set_points(q), ac.ServoPlant(arm, servo, limits), resolution=2e-4)
    n = round(0.3 / execution.t[1])
    every = 100
    lower, upper = limits.acceleration_bounds(2)
    for j in range(2):
        u = command(q[:, j], interpolation)
        times = execution.t[: n + 1 : every]
        expected = integrated(servo, j, u, dead, times, q[0, j], (lower[j], upper[j]), fine=1e-3)
        np.testing.assert_allclose(execution.q[: n + 1 : every, j], expected[:, 0], atol=2e-9)
        np.testing.assert_allclose(execution.dq[: n + 1 : every, j], expected[:, 1], atol=2e-7)
    over = np.maximum(execution.demand - upper, lower - execution.demand) > 0
    np.testing.assert_allclose(
        execution.saturated_time, over.sum(axis=0) * execution.t[1], atol=0.02
    )
    assert (execution.saturated_time > 0.05).all()
    assert (execution.peak_demand >= np.abs(execution.demand).max(axis=0) * (1 - 1e-9)).all()
    np.testing.assert_array_equal(execution.ddq, np.clip(execution.demand, lower, upper))


def test_brief_saturation_on_a_cubic_is_found(arm):
    # The limit is a little below the largest demand without one, wherever in an interval that is.
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = np.cumsum(rng.normal(size=(8, 2)), axis=0) * 1e-3
        dead = rng.uniform(0, 0.03)
        servo = ac.ServoModel(kp=25.0, kv=150.0, interpolation="cubic", dead_time=dead)
        plant = ac.ServoPlant(arm, servo, ac.Limits.only())
        free, fine = (ac.simulate(make_set_points(q), plant, resolution=x) for x in (CYCLE, 1e-5))
        peaks = np.abs(fine.demand).max(axis=0)
        np.testing.assert_allclose(free.peak_demand, peaks, rtol=1e-6)
        limits = ac.Limits.only(joint_acceleration=free.peak_demand * (1 - 1e-9))
        execution = ac.simulate(
            make_set_points(q), ac.ServoPlant(arm, servo, limits), resolution=CYCLE
        )
        assert (execution.saturated_time > 0).all() and (execution.saturated_time < 1e-3).all()
