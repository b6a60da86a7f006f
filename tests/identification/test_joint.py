"""The exact simulation of a joint and its derivatives, against steps far below a sample."""

import math
from itertools import product

import numpy as np
from soak.identification import move

from armcontour.identification import _joint
from armcontour.servo._sensitivity import COLUMNS

N = 400
GAINS = ((25.0, 150.0), (10.0, 300.0), (60.0, 60.0), (40.0, 160.0))  # 40, 160: a double pole
NAMES = ("kp", "kv", "delay", "q0", "dq0", "limit", "feed")


def _log(interval, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(N) * interval
    if interval > 5e-3:  # not uniform either
        t[1:] += rng.uniform(-0.3, 0.3, N - 1) * interval
    return t, np.cumsum(rng.normal(size=N)) * 0.01


def _run(t, u, linear, kp, kv, delay, limit, columns=1, q0=None, dq0=0.2, feed=0.0):
    q0 = u[0] + 0.01 if q0 is None else q0
    given = np.array([kp, kv, delay, q0, dq0, limit, feed])
    return _joint.second_order(t, u, linear, 0, len(t), False, given, columns)


def test_positions_are_those_of_fine_steps():
    cases = product(GAINS, ((0.0, 0.0), (0.0123, 1.1), (-0.0007, 0.0)), (True, False))
    for (kp, kv), (delay, feed), linear in cases:
        t, u = _log(1e-3)
        if delay < 0:  # what is commanded after the end is not in the log
            t, u = t[:-2], u[:-2]
        q, _ = _run(t, u, linear, kp, kv, delay, math.inf, feed=feed)
        more = {"delay": delay, "feed": feed, "linear": linear}
        expected = move(t, u, kp=kp, kv=kv, q0=u[0] + 0.01, dq0=0.2, steps=10, **more)
        case = str((kp, kv, delay, feed, linear))
        np.testing.assert_allclose(q[0, :-2], expected[:-2], rtol=0, atol=1e-9, err_msg=case)


def test_saturated_positions_are_those_of_fine_steps():
    for (kp, kv), limit, linear in product(GAINS, (20.0, 5.0), (True, False)):
        t, u = _log(1e-3)
        q, seen = _run(t, u, linear, kp, kv, 0.0123, limit)
        more = {"limit": limit, "linear": linear, "q0": u[0] + 0.01, "dq0": 0.2, "steps": 400}
        expected = move(t, u, kp=kp, kv=kv, delay=0.0123, **more)
        case = str((kp, kv, limit, linear))
        np.testing.assert_allclose(q[0], expected, rtol=0, atol=1e-7, err_msg=case)
        assert seen[0] > limit and seen[1] > 0.1, case


def test_times_need_not_be_uniform():
    t, u = _log(7e-3)
    q, _ = _run(t, u, True, 25.0, 150.0, 0.0123, math.inf)
    expected = move(t, u, kp=25.0, kv=150.0, delay=0.0123, q0=u[0] + 0.01, dq0=0.2, steps=200)
    np.testing.assert_allclose(q[0], expected, rtol=0, atol=1e-7)


def test_derivatives_are_those_of_differences():
    t, u = _log(1e-3)
    steps = (1e-5, 1e-4, 1e-8, 1e-8, 1e-7, 1e-5, 1e-6)
    limits = ((math.inf, 0.0), (20.0, 0.0), (math.inf, 0.9), (2000.0, 1.2))
    for (kp, kv), (limit, feed), linear in product(GAINS, limits, (True, False)):
        base = np.array([kp, kv, 0.0123, u[0] + 0.01, 0.2, limit, feed])
        found, _ = _joint.second_order(t, u, linear, 0, N, False, base, COLUMNS)
        for k, (name, step) in enumerate(zip(NAMES, steps, strict=True)):
            case = str((name, kp, kv, limit, feed, linear))
            if name == "limit" and limit == math.inf:
                assert not found[k + 1].any(), case
                continue
            ends = [
                _joint.second_order(t, u, linear, 0, N, False, base + x, 1)[0][0]
                for x in np.outer((step, -step), np.arange(7) == k)
            ]
            expected = (ends[0] - ends[1]) / (2 * step)
            assert np.abs(found[k + 1] - expected).max() < 1e-5 * np.abs(expected).max(), case


def test_the_lag_is_a_loop_with_an_infinite_velocity_gain():
    t, u = _log(1e-3)
    for feed, linear in product((0.0, 0.9), (True, False)):
        base = np.array([25.0, 0.0, 0.0123, u[0], 0.0, 0.0, feed])
        lag = _joint.first_order(t, u, linear, 0, N, False, base, COLUMNS)
        for kv in (1e5, 1e6):
            loop, _ = _run(t, u, linear, 25.0, kv, 0.0123, math.inf, 1, u[0], 0.0, feed)
            assert np.abs(loop[0] - lag[0]).max() < 200 / kv
        for row, step in ((1, 1e-5), (3, 1e-8), (4, 1e-6), (7, 1e-6)):
            ends = [
                _joint.first_order(t, u, linear, 0, N, False, base + x, 1)[0]
                for x in np.outer((step, -step), np.arange(1, 8) == row)
            ]
            expected = (ends[0] - ends[1]) / (2 * step)
            assert np.abs(lag[row] - expected).max() < 1e-5 * np.abs(expected).max(), row


def test_a_joint_at_rest_stays_until_the_first_set_point_reaches_it():
    t, u = np.arange(N) * 1e-3, np.full(N, 0.1)
    given = np.array([25.0, 150.0, 0.0505, 0.02, 0.0, math.inf, 0.0])
    out, _ = _joint.second_order(t, u, True, 0, N, True, given, COLUMNS)
    assert (out[0, :51] == 0.02).all()
    expected = move(t, u, kp=25.0, kv=150.0, delay=0.0505, before=0.02, steps=20)
    np.testing.assert_allclose(out[0], expected, rtol=0, atol=1e-9)


def test_intervals_beyond_all_time_steps_are_told():
    t, u = np.arange(60) * 1e9, np.linspace(0.0, 1.0, 60)
    _, seen = _run(t, u, True, 25.0, 150.0, 0.0, 1e-30)
    assert np.isnan(seen[0])
