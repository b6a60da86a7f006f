"""MAC's laps against (18)-(20) in plain Python, and its passes against the phase plane."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armcontour as ac
from armcontour.paper.timing import PaperLine, run_laps


def shortest_time(step, velocity, limit):
    """(18): the smallest time in which a joint makes its step at full acceleration."""
    if step == 0:
        return 2 * abs(velocity) / limit
    toward = velocity if step > 0 else -velocity
    roots = np.roots([limit / 2, toward, -abs(step)])
    return min(float(r.real) for r in roots if abs(r.imag) < 1e-12 * abs(r) and r.real > 0)


def slow_laps(q, dq_ds, speed, limit):
    """Lap after lap as docs/method.md words it, with lists."""
    times = []
    speeds = [speed]
    used = []
    for k in range(len(q) - 1):
        velocity = [speeds[-1] * x for x in dq_ds[k]]
        step = [b - a for a, b in zip(q[k], q[k + 1], strict=True)]
        each = [shortest_time(*x) for x in zip(step, velocity, limit, strict=True)]
        h = max(each)  # (19)
        binding = each.index(h)
        acceleration = [2 * (d - w * h) / h**2 for d, w in zip(step, velocity, strict=True)]  # (20)
        if any(abs(a) > m * (1 + 1e-7) for a, m in zip(acceleration, limit, strict=True)):
            return times, speeds, used, k
        times.append(h)
        used.append(acceleration)
        speeds.append((velocity[binding] + acceleration[binding] * h) / dq_ds[k + 1][binding])
    return times, speeds, used, len(q) - 1


@pytest.mark.parametrize("seed", range(12))
def test_laps_satisfy_equations_18_to_20(arm, seed):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform((0.2, 0.1), (0.45, 0.3), size=(2, 2))
    path = ac.Path.polyline([start, end])
    traced = ac.trace(path, arm, tolerance=1e-11)
    s = np.linspace(0, path.length, 41)
    q = traced(s)
    dq_ds = traced(s, 1)
    limit = rng.uniform(0.5, 1.0, 2)
    speed = rng.choice([0.0, 0.02])
    h, speeds, dq, ddq, laps_done, joint, _ = run_laps(q, dq_ds, speed, limit)
    slow = slow_laps(q.tolist(), dq_ds.tolist(), speed, limit.tolist())
    times, expected_speeds, accelerations, expected_done = slow
    assert laps_done == expected_done > 0
    assert (joint == -1) == (laps_done == 40)
    np.testing.assert_allclose(h[:laps_done], times, rtol=1e-7)
    np.testing.assert_allclose(speeds[: laps_done + 1], expected_speeds, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(ddq[:laps_done], accelerations, atol=1e-6 * limit.max())
    assert (np.abs(ddq[:laps_done]) <= limit).all()
    # (21) with these carries every joint from knot to knot.
    moved = dq[:laps_done] * h[:laps_done, None] + ddq[:laps_done] * h[:laps_done, None] ** 2 / 2
    np.testing.assert_allclose(moved, np.diff(q, axis=0)[:laps_done], atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lap_in_which_a_joint_reverses_satisfies_equations_18_to_20(sign):
    # Joint 1 moves away from its next knot at first: the root takes the sign of its step.
    q = sign * np.array([[0.0, 0.0], [0.01, 0.01]])
    dq_ds = sign * np.array([[-1.0, 1.0], [1.0, 1.0]])
    limit = np.array([0.5, 0.5])
    h, speeds, _, ddq, laps_done, *_ = run_laps(q, dq_ds, 0.05, limit)
    times, expected, accelerations, _ = slow_laps(q.tolist(), dq_ds.tolist(), 0.05, limit.tolist())
    assert laps_done == 1
    assert h[0] == pytest.approx((math.sqrt(0.05**2 + 2 * 0.5 * 0.01) + 0.05) / 0.5)
    assert h[0] == pytest.approx(times[0]) and speeds[1] == pytest.approx(expected[1])
    np.testing.assert_allclose(ddq[0], accelerations[0], rtol=1e-9)
    assert abs(ddq[0, 0]) == pytest.approx(0.5)


def phase_plane(traced, limit, s, speed):
    """Speed at places `s` under the largest path acceleration: d(v²)/ds = 2 min_j(...)."""

    def slope(x, y):
        dq = traced(np.clip(x, 0, traced.length), 1)
        ddq = traced(np.clip(x, 0, traced.length), 2)
        return [2 * np.min((limit - np.sign(dq) * ddq * y[0]) / np.abs(dq))]

    # Small steps: the slope has kinks where another joint begins to bind.
    how = {"rtol": 1e-9, "atol": 1e-12, "max_step": (s[-1] - s[0]) / 500}
    solution = solve_ivp(slope, (s[0], s[-1]), [speed**2], t_eval=s, **how)
    return np.sqrt(solution.y[0])


@pytest.mark.parametrize(
    ("segment", "backwards", "begin"),
    [(0, False, 0.0), (2, True, 0.02)],
)
def test_passes_follow_the_phase_plane(arm, rounded, limits, segment, backwards, begin):
    path = ac.Path.polyline(rounded.vertices[[segment, segment + 1]][:: -1 if backwards else 1])
    traced = ac.trace(path, arm, tolerance=1e-11)
    s = np.linspace(0, path.length, 401)
    limit = limits.joint_acceleration
    line = PaperLine(name="line", joint_path=traced, arm=arm, limit=limit, s=s, assigned=0.15)
    run = line.forward(begin)
    last = run.last_within(0.15)
    assert last > 40
    expected = phase_plane(traced, limit, s[: last + 1], begin)
    np.testing.assert_allclose(run.speed[: last + 1], expected, rtol=1e-4)
