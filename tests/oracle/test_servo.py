"""The servo plant against SciPy: exact where it is linear, event by event where it saturates."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from tests.oracle.test_servo_models import taught_data

import armcontour as ac

OVERDAMPED, CRITICAL, UNDERDAMPED = (25.0, 150.0), (25.0, 100.0), (60.0, 40.0)
ALMOST_CRITICAL, HARDLY_DAMPED, STIFF = (25.0, 100.0000001), (500.0, 5.0), (5.0, 2000.0)
GAINS = (OVERDAMPED, ALMOST_CRITICAL, CRITICAL, UNDERDAMPED, HARDLY_DAMPED, STIFF)


def executed(arm, q, cycle, kp, kv, limit, resolution, interpolation="linear"):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    plant = ac.ServoPlant(arm, servo, ac.Limits.only(joint_acceleration=limit))
    return ac.simulate(taught_data(q, cycle), plant, resolution=resolution)


@pytest.mark.parametrize("interpolation", ["linear", "step"])
@pytest.mark.parametrize("cycle", [4e-3, 0.05])
def test_unsaturated_against_lsim(arm, interpolation, cycle):
    for kp, kv in GAINS:
        q = np.random.default_rng(2).normal(size=(40, 2))
        execution = executed(arm, q, cycle, kp, kv, None, cycle, interpolation)
        matrices = [[0, 1], [-kp * kv, -kv]], [[0], [kp * kv]], [[1, 0], [0, 1]], [[0], [0]]
        system, t = signal.StateSpace(*matrices), np.arange(40) * cycle
        for j in range(2):
            # Between set-points as the plant is: exact, not a discretisation.
            moved = q[:, j] - q[0, j]
            _, expected, _ = signal.lsim(system, moved, t, interp=interpolation == "linear")
            np.testing.assert_allclose(execution.q[:40, j] - q[0, j], expected[:, 0], atol=1e-9)
            np.testing.assert_allclose(execution.dq[:40, j], expected[:, 1], atol=1e-9 * kv)


def by_events(u, cycle, kp, kv, limit, linear=True):
    """(7) for one joint: integrate to high accuracy, and stop wherever the demand meets +-limit."""
    state, ends = np.array([u[0], 0.0]), [(u[0], 0.0)]
    saturated, peak = 0.0, 0.0
    for k in range(len(u) - 1):
        rate = (u[k + 1] - u[k]) / cycle if linear else 0.0

        def demand(t, x, k=k, rate=rate):
            return kv * (kp * (u[k] + rate * t - x[0]) - x[1])

        now = 0.0
        while now < cycle:
            z = demand(now, state)
            dz = kv * (kp * (rate - state[1]) - np.clip(z, -limit, limit))
            # On the edge the sign of the demand's slope tells the side.
            side = 0.0
            on_edge = abs(z) >= limit * (1 - 1e-10) and dz * np.sign(z) > 0
            if abs(z) > limit * (1 + 1e-10) or on_edge:
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
            solution = solve_ivp(
                motion, (now, cycle), state, method="DOP853", events=events,
                rtol=1e-12, atol=1e-14, max_step=0.3 / kv,
            )  # fmt: skip
            if side:
                saturated += solution.t[-1] - now
            peak = max(
                peak, *(abs(demand(t, x)) for t, x in zip(solution.t, solution.y.T, strict=True))
            )
            now, state = solution.t[-1], solution.y[:, -1]
            if solution.status == 0:
                break
        ends.append(tuple(state))
    return np.array(ends), saturated, peak


@pytest.mark.parametrize("gains", [OVERDAMPED, CRITICAL, UNDERDAMPED])
@pytest.mark.parametrize("interpolation", ["linear", "step"])
def test_saturated_against_events(arm, gains, interpolation):
    kp, kv = gains
    cycle, limits = 0.04, (0.72, 3.0)
    q = np.cumsum(np.random.default_rng(4).normal(size=(15, 2)), axis=0) * (3e-3, 1e-2)
    execution = executed(arm, q, cycle, kp, kv, limits, cycle, interpolation)
    long = executed(arm, np.tile(q[-1:], (2, 1)), cycle, kp, kv, limits, cycle)
    np.testing.assert_array_equal(long.saturated_time, 0)
    for j in range(2):
        arguments = q[:, j], cycle, kp, kv, limits[j], interpolation == "linear"
        ends, saturated, peak = by_events(*arguments)
        assert saturated > 0.02  # the case is worth its name
        np.testing.assert_allclose(execution.q[:15, j], ends[:, 0], atol=1e-10)
        np.testing.assert_allclose(execution.dq[:15, j], ends[:, 1], atol=1e-8)
        assert execution.peak_demand[j] >= peak * (1 - 1e-6)
        assert execution.saturated_time[j] >= saturated - 1e-7
