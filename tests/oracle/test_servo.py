"""The servo plant against SciPy: exact where it is linear, event by event where it saturates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

import armcontour as ac
from armcontour.motion import LapLaw

GAINS = {
    "overdamped": (25.0, 150.0),
    "almost critical": (25.0, 100.0000001),
    "critical": (25.0, 100.0),
    "underdamped": (60.0, 40.0),
    "hardly damped": (500.0, 5.0),
    "stiff": (5.0, 2000.0),
}


def taught_data(q, period):
    law = LapLaw(
        breaks=np.array([0.0, 1.0]), q=np.zeros((2, 2)), dq=np.zeros((1, 2)), ddq=np.zeros((1, 2))
    )
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    return ac.TaughtData(period=period, q=q, trajectory=trajectory, method="x")


def executed(arm, q, period, kp, kv, limit, resolution, interpolation="linear"):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    plant = ac.ServoPlant(arm, servo, ac.Limits(joint_acceleration=limit))
    return ac.execute(taught_data(q, period), plant, resolution=resolution)


@pytest.mark.parametrize("name", GAINS)
@pytest.mark.parametrize("period", [4e-3, 0.05])
def test_unsaturated_against_lsim(arm, name, period):
    kp, kv = GAINS[name]
    q = np.random.default_rng(2).normal(size=(40, 2))
    done = executed(arm, q, period, kp, kv, None, period)
    system = signal.StateSpace(
        [[0, 1], [-kp * kv, -kv]], [[0], [kp * kv]], [[1, 0], [0, 1]], [[0], [0]]
    )
    t = np.arange(40) * period
    for j in range(2):
        # Linear between set-points, as the plant is: exact, not a discretisation.
        _, expected, _ = signal.lsim(system, q[:, j] - q[0, j], t)
        np.testing.assert_allclose(done.q[:40, j] - q[0, j], expected[:, 0], atol=1e-9)
        np.testing.assert_allclose(done.dq[:40, j], expected[:, 1], atol=1e-9 * kv)


def test_step_hold_against_lsim(arm):
    kp, kv, period = 25.0, 150.0, 0.01
    q = np.random.default_rng(3).normal(size=(30, 2))
    done = executed(arm, q, period, kp, kv, None, period, "step")
    system = signal.StateSpace([[0, 1], [-kp * kv, -kv]], [[0], [kp * kv]], [[1, 0]], [[0]])
    t = np.arange(30) * period
    _, expected, _ = signal.lsim(system, q[:, 0] - q[0, 0], t, interp=False)
    np.testing.assert_allclose(done.q[:30, 0] - q[0, 0], np.ravel(expected), atol=1e-9)


def by_events(u, period, kp, kv, limit, linear=True):
    """(7) for one joint: integrate to high accuracy, and stop wherever the demand meets +-limit."""
    state, ends = np.array([u[0], 0.0]), [(u[0], 0.0)]
    saturated, peak = 0.0, 0.0
    for k in range(len(u) - 1):
        rate = (u[k + 1] - u[k]) / period if linear else 0.0

        def demand(t, x, k=k, rate=rate):
            return kv * (kp * (u[k] + rate * t - x[0]) - x[1])

        now = 0.0
        while now < period:
            z = demand(now, state)
            dz = kv * (kp * (rate - state[1]) - np.clip(z, -limit, limit))
            # On the edge the sign of the demand's slope tells the side.
            side = 0.0
            if abs(z) > limit * (1 + 1e-10) or (
                abs(z) >= limit * (1 - 1e-10) and dz * np.sign(z) > 0
            ):
                side = np.sign(z)

            def motion(t, x, side=side, demand=demand):
                return [x[1], side * limit if side else demand(t, x)]

            events = []
            for edge in (limit, -limit):

                def event(t, x, edge=edge, demand=demand):
                    return demand(t, x) - edge

                event.terminal = True
                # Leaving saturation inwards, or the linear range outwards.
                event.direction = -np.sign(edge) if side else np.sign(edge)
                events.append(event)
            found = solve_ivp(
                motion, (now, period), state, method="DOP853", events=events,
                rtol=1e-12, atol=1e-14, max_step=0.3 / kv,
            )  # fmt: skip
            if side:
                saturated += found.t[-1] - now
            peak = max(peak, *(abs(demand(t, x)) for t, x in zip(found.t, found.y.T, strict=True)))
            now, state = found.t[-1], found.y[:, -1]
            if found.status == 0:
                break
        ends.append(tuple(state))
    return np.array(ends), saturated, peak


@pytest.mark.parametrize("name", ["overdamped", "critical", "underdamped"])
@pytest.mark.parametrize("interpolation", ["linear", "step"])
def test_saturated_against_events(arm, name, interpolation):
    kp, kv = GAINS[name]
    period, limits = 0.04, (0.72, 3.0)
    q = np.cumsum(np.random.default_rng(4).normal(size=(15, 2)), axis=0) * (3e-3, 1e-2)
    done = executed(arm, q, period, kp, kv, limits, period, interpolation)
    long = executed(arm, np.tile(q[-1:], (2, 1)), period, kp, kv, limits, period)
    np.testing.assert_array_equal(long.saturated_time, 0)
    for j in range(2):
        ends, saturated, peak = by_events(
            q[:, j], period, kp, kv, limits[j], interpolation == "linear"
        )
        assert saturated > 0.02  # the case is worth its name
        np.testing.assert_allclose(done.q[:15, j], ends[:, 0], atol=1e-10)
        np.testing.assert_allclose(done.dq[:15, j], ends[:, 1], atol=1e-8)
        assert done.peak_demand[j] >= peak * (1 - 1e-6)
        assert done.saturated_time[j] >= saturated - 1e-7


def by_small_steps(u, period, kp, kv, limit, steps):
    """(7) by Heun's method with plain numbers."""
    x, w, h = float(u[0]), 0.0, period / steps
    for k in range(len(u) - 1):
        rate = (u[k + 1] - u[k]) / period
        for i in range(steps):
            a, b = u[k] + rate * h * i, u[k] + rate * h * (i + 1)
            now = min(max(kv * (kp * (a - x) - w), -limit), limit)
            x1, w1 = x + h * w, w + h * now
            then = min(max(kv * (kp * (b - x1) - w1), -limit), limit)
            x, w = x + h * (w + w1) / 2, w + h * (now + then) / 2
    return x, w


def test_small_steps_converge_to_the_plant(arm):
    kp, kv, limit, period = 25.0, 150.0, 0.72, 0.04
    q = 2e-3 * np.cumsum(np.random.default_rng(4).normal(size=(10, 2)), axis=0)
    exact = executed(arm, q, period, kp, kv, limit, period).q[9, 0]
    errors = [
        abs(by_small_steps(q[:, 0], period, kp, kv, limit, n)[0] - exact) for n in (50, 200, 800)
    ]
    # Second order in the step, but for the kinks, where it is at least that on the whole.
    assert errors[0] / errors[1] > 8 and errors[1] / errors[2] > 8
    assert errors[2] < 1e-8
