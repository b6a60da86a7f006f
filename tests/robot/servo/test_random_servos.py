"""Random servos compared with a Runge-Kutta method whose steps are halved."""

import numpy as np
from numba import njit

import armcontour as ac
from armcontour.robot.servo.simulation import ServoSimulation

CYCLE = 4e-3  # s, between set-points
POINTS = 30  # set-points
AFTER = 20  # cycles that are simulated beyond the set-points
JOINTS = 10
SLIDING = 5e-3  # rad/s, at which friction is 1/√2 of what it is at high speeds
# Largest difference of a joint that saturates, at which the method of steps has kinks [rad].
SATURATED = 1e-7
# Largest difference of a joint that never saturates [rad].
LINEAR = 1e-10


def random_servo(rng, interpolation):
    """Ten joints with gains, feed-forward, friction, dead time, integrator and saturation."""

    def some(share, low, high):
        return rng.uniform(low, high, JOINTS) * (rng.random(JOINTS) < share)

    second = rng.random(JOINTS) < 0.85
    kp, kv = np.exp(rng.uniform(np.log([[4.0], [30.0]]), np.log([[60.0], [300.0]]), (2, JOINTS)))
    # Cubics support acceleration feed-forward only without integrators.
    cascade = interpolation != "cubic" or rng.random() < 0.5
    ki = some(0.5, 1.0, 25.0) * second * cascade
    velocity = some(0.6, 0.3, 1.0)
    acceleration = some(0.5, 0.1, 0.5) * np.where(second, 1.0, 0.01) * (velocity > 0)
    acceleration *= interpolation == "linear" or (interpolation == "cubic" and not cascade)
    limit = np.where(rng.random(JOINTS) < 0.6, rng.uniform(0.3, 3.0, JOINTS), np.inf)
    return ac.ServoModel(
        kp=kp, kv=np.where(second, kv, np.inf), ki=ki, interpolation=interpolation,
        order=tuple("second" if x else "first" for x in second), acceleration_limit=limit,
        # Multiples of the largest step, so that no step contains a kink of the command.
        dead_time=rng.integers(0, 25, JOINTS) * CYCLE / 8, friction=some(0.3, 1e-5, 3e-4),
        velocity_feedforward=velocity, acceleration_feedforward=acceleration,
    )  # fmt: skip


@njit
def command(q, kind, k, s):
    """Command, its derivatives, and the rate for friction at time s of piece k, by definition."""
    last = len(q) - 1
    if k < 0 or k >= last:
        return q[min(max(k, 0), last)], 0.0, 0.0, 0.0
    chord = (q[k + 1] - q[k]) / CYCLE
    before = (q[k] - q[max(k - 1, 0)]) / CYCLE
    if kind == "step":
        return q[k], before, 0.0, before
    if kind == "linear":
        return q[k] + s * chord, chord, (chord - before) / CYCLE, chord
    start = (q[k + 1] - q[k - 1]) / (2 * CYCLE) if k > 0 else 0.0
    end = (q[k + 2] - q[k]) / (2 * CYCLE) if k + 1 < last else 0.0
    a = (3 * chord - 2 * start - end) / CYCLE
    b = (start + end - 2 * chord) / CYCLE**2
    return (
        q[k] + s * (start + s * (a + s * b)), start + s * (2 * a + 3 * s * b), 2 * a + 6 * s * b,
        chord,
    )  # fmt: skip


@njit
def rates(state, gains, q, kind, k, s):
    """Derivatives of position, velocity and integral, (3,)."""
    kp, kv, ki, f, g, friction, limit = gains
    u, du, ddu, rate = command(q, kind, k, s)
    rub = friction * rate / np.hypot(rate, SLIDING)
    if np.isinf(kv):
        return np.array([kp * (u - rub - state[0]) + f * du + g * ddu, 0.0, 0.0])
    error = kp * (u - state[0]) + f * du - state[1]
    demand = kv * (error + ki * state[2] - kp * rub) + g * ddu
    ddq = min(max(demand, -limit), limit)
    return np.array([state[1], ddq, error - (demand - ddq) / kv])


@njit
def integrate(gains, q, kind, delay, divisions):
    """Positions at the set-point times, by the classical method; `delay` in eighths of a cycle."""
    h = CYCLE / divisions
    state = np.array([q[0], 0.0, 0.0])
    positions = np.empty(POINTS + AFTER)
    for n in range(len(positions) * divisions):
        k, step = divmod(n - delay * (divisions // 8), divisions)
        s = step * h
        k1 = rates(state, gains, q, kind, k, s)
        k2 = rates(state + h / 2 * k1, gains, q, kind, k, s + h / 2)
        k3 = rates(state + h / 2 * k2, gains, q, kind, k, s + h / 2)
        k4 = rates(state + h * k3, gains, q, kind, k, s + h)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        positions[n // divisions] = state[0]
    return positions


def test_random_servos_match_runge_kutta():
    rng = np.random.default_rng(0)
    saturated = 0
    for n in range(50):
        servo = random_servo(rng, ("linear", "cubic", "step")[n % 3])
        q = np.cumsum(rng.normal(0, 1e-3, (POINTS, JOINTS)) + rng.normal(0, 2e-3, JOINTS), axis=0)
        limit = servo.acceleration_limit
        run = ServoSimulation(q, CYCLE, servo, -limit, limit).run(
            0, POINTS + AFTER, q[0], np.zeros(JOINTS)
        )
        names = "kp kv ki velocity_feedforward acceleration_feedforward friction acceleration_limit"
        for j in range(JOINTS):
            gains = tuple(getattr(servo, x)[j] for x in names.split())
            delay = round(servo.dead_time[j] / CYCLE * 8)
            arguments = gains, q[:, j].copy(), servo.interpolation, delay
            tolerance = SATURATED if np.isfinite(limit[j]) else LINEAR
            divisions = 8
            difference = 1.0
            finer = integrate(*arguments, 8)
            while difference > tolerance / 4:
                divisions = 2 * divisions
                coarser = finer
                finer = integrate(*arguments, divisions)
                difference = np.abs(finer - coarser).max()
            np.testing.assert_allclose(run.states[j, :, 0], finer, atol=tolerance, rtol=0)
        saturated += (run.saturated > 0).sum()
    assert saturated > 150
