"""Learning on robots with other loops than the servo of the job.

The robots are simulated here in small steps, and share nothing with the package.
"""

import numpy as np
import pytest
from numba import njit

import armcontour as ac

from .robots import SERVO, gentle_plan, rods, rounded

CYCLE = 4e-3  # s, between set-points
STEP = 1e-3  # s, between simulated positions
# Steps of the simulation per position.
SUBSTEPS = 5
RUNS = 5
# Smallest error that may be called noise [m].
SMALL = 3e-6

# Loops of both joints: kp [1/s], kv [1/s] (0 for first order), ki [1/s], velocity feed-forward,
# dead time [s], acceleration limit [rad/s²].
FREE = (1e9, 1e9)
ROBOTS = {
    "first order": ((22, 27), (0, 0), (0, 0), (0, 0), (0, 0), FREE),
    "fast first order": ((40, 34), (0, 0), (0, 0), (0, 0), (0, 0), FREE),
    "first order, feed-forward": ((24, 30), (0, 0), (0, 0), (0.8, 0.6), (0, 0), FREE),
    "other gains": ((19, 31), (110, 210), (0, 0), (0, 0), (0, 0), FREE),
    "slow": ((12, 15), (90, 110), (0, 0), (0, 0), (0, 0), FREE),
    "some feed-forward": ((23, 27), (140, 170), (0, 0), (0.3, 0.2), (0, 0), FREE),
    "feed-forward": ((26, 24), (150, 130), (0, 0), (0.9, 0.95), (0.004, 0.004), FREE),
    "integrator": ((23, 26), (140, 170), (8, 20), (0, 0), (0, 0), FREE),
    "integrator, feed-forward": ((32, 20), (130, 170), (20, 10), (0.5, 0.2), (0, 0), FREE),
    "dead time": ((24, 27), (150, 150), (0, 0), (0, 0), (0.009, 0.002), FREE),
    "mixed": ((22, 33), (0, 180), (0, 15), (0.2, 0.0), (0.002, 0.005), FREE),
    "saturated": ((24, 26), (150, 150), (0, 0), (0, 0), (0, 0), (9.0, 2.5)),
}


@njit
def follow(q, duration, kp, kv, ki, ff, dead_time, limit):
    """Positions every millisecond by the midpoint rule, from rest at the first set-point."""
    count = int(duration / STEP)
    positions = np.zeros((count + 1, 2))
    h = STEP / SUBSTEPS
    for j in range(2):
        x = q[0, j]
        v = 0.0
        z = 0.0
        positions[0, j] = x
        for k in range(count * SUBSTEPS):
            xm = x
            vm = v
            zm = z
            t = k * h + 1e-9
            for part in (0.5, 1.0):
                place = min(max((t - dead_time[j]) / CYCLE, 0.0), len(q) - 1.0)
                i = min(int(place), len(q) - 2)
                rate = (q[i + 1, j] - q[i, j]) / CYCLE
                u = q[i, j] + rate * (place - i) * CYCLE
                rate = rate if 0 < place < len(q) - 1 else 0.0
                demanded = kp[j] * (u - xm) + ff[j] * rate
                error = demanded - vm
                a = min(max(kv[j] * (error + ki[j] * zm), -limit[j]), limit[j])
                moved = vm if kv[j] > 0 else demanded
                xm = x + part * h * moved
                vm = v + part * h * a
                zm = z + part * h * error
                t = (k + 0.5) * h
            x = xm
            v = vm
            z = zm
            if (k + 1) % SUBSTEPS == 0:
                positions[(k + 1) // SUBSTEPS, j] = x
    return positions


def tool(q):
    """Points of two links of 0.25 m each, with clockwise angles from the y axis."""
    both = np.cumsum(q, axis=1)
    return 0.25 * np.stack([np.sin(both).sum(axis=1), np.cos(both).sum(axis=1)], axis=1)


@njit
def distances(points, curve):
    """Distances of points to a polyline."""
    nearest = np.full(len(points), np.inf)
    for k in range(len(curve) - 1):
        a = curve[k + 1, 0] - curve[k, 0]
        b = curve[k + 1, 1] - curve[k, 1]
        for i in range(len(points)):
            x = points[i, 0] - curve[k, 0]
            y = points[i, 1] - curve[k, 1]
            share = min(max((x * a + y * b) / (a * a + b * b), 0.0), 1.0)
            nearest[i] = min(nearest[i], (x - share * a) ** 2 + (y - share * b) ** 2)
    return np.sqrt(nearest)


@pytest.fixture(scope="module")
def plan():
    limits = ac.Limits.only(speed=0.15, joint_acceleration=2.5, joint_velocity=2.0)
    return gentle_plan(rounded(), rods(), limits.for_joints(2))


def execute(set_points, loops):
    """The log of a robot, its RMS error until rest, and its distance from the end at rest [m]."""
    plan = set_points.trajectory
    q = follow(set_points.q, len(set_points.q) * CYCLE + 1.5, *map(np.asarray, loops))
    t = set_points.start_time + np.arange(len(q)) * STEP
    command = np.stack([np.interp(t, set_points.t, x) for x in set_points.q.T], axis=1)
    points = tool(q)
    curve = plan.path(np.linspace(0, plan.path.length, 4001))
    errors = distances(points, curve)
    speeds = np.linalg.norm(np.gradient(points, STEP, axis=0), axis=1)
    end = np.flatnonzero((t <= plan.duration) | (speeds > 1e-3))[-1] + 1
    log = ac.Log(t=t - t[0], command=command, measured=q)
    rest = float(np.linalg.norm(points[-1] - curve[-1]))
    return log, float(np.sqrt(np.mean(errors[:end] ** 2))), rest


@pytest.mark.parametrize("name", ROBOTS)
def test_the_best_run_has_the_smallest_error_and_learning_stays_near_it(plan, name):
    set_points = ac.compensate(plan, SERVO, ac.Inverse())
    errors = []
    rests = []
    for _ in range(RUNS):
        log, error, rest = execute(set_points, ROBOTS[name])
        errors.append(error)
        rests.append(rest)
        set_points = ac.learn(set_points, log, arm=rods(), servo=SERVO)
        assert errors[set_points.best] == min(errors)
        assert "noise" not in set_points.reason or min(errors) < SMALL
        assert set_points.runs[-1].rms == pytest.approx(error, rel=1e-3, abs=1e-8)
        if set_points.finished:
            best = set_points.runs[set_points.best].q
            np.testing.assert_array_equal(set_points.q, best)
    assert errors[-1] <= 1.2 * min(errors)
    assert max(rests) < 5e-6
    # Either learning reduces the error, or the servo is wrong.
    assert errors[-1] < 0.2 * errors[0] or "identify the servo" in set_points.reason.lower()
    if name == "saturated":
        assert any("joint 2 saturates at 2.5 rad/s²" in x for x in set_points.runs[0].notes)
