"""The timing of joint splines, against sampled limits and the timing of the traced tool path."""

import math
from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning.shaping.spline_rows import JointSpline, Neighbour
from armcontour.planning.shaping.spline_timing import time_spline

SPANS = 160
# Samples of each span.
SAMPLES = 50
ACCELERATION = 0.72
SPEED = 0.15
CENTRIPETAL = 0.09
ALL_SPEEDS = np.full(SPANS, SPEED)
NO_RATES = (0.0, 0.0)


@pytest.fixture(scope="module")
def limits():
    only = ac.Limits.only(
        joint_acceleration=ACCELERATION, speed=SPEED, centripetal_acceleration=CENTRIPETAL
    )
    return only.for_joints(2)


@pytest.fixture(scope="module")
def spline():
    """A spline of two joints along a bent curve, from rest to rest."""
    t = np.linspace(0, 1, SPANS)
    q = np.stack([0.4 + 0.5 * t, 1.1 + 0.3 * np.sin(5 * t)], axis=1)
    rest = np.isin(np.arange(SPANS + 1), (0, SPANS))
    return JointSpline(q=q, h=np.full(SPANS, 0.0125), rest=rest)


def tool(q):
    """Tool positions of the arm [m], from its link lengths; angles are from the axis y."""
    first = q[..., 0]
    both = first + q[..., 1]
    x = 0.135 + 0.250 * np.sin(first) + 0.215 * np.sin(both)
    y = 0.250 * np.cos(first) + 0.215 * np.cos(both)
    return np.stack([x, y], axis=-1)


def test_the_timing_of_a_spline_reaches_and_keeps_its_limits(arm, limits, spline):
    timing = time_spline(spline, arm, limits, ALL_SPEEDS, NO_RATES)
    assert timing.rates[0] == timing.rates[-1] == 0
    h = spline.h[0]
    step = 1e-4
    used = []
    for i in range(1, SPANS - 2):
        # Span i in time h, a parabola by the control points before, in and after it.
        begin, middle, end = (spline.q[i - 1 + k] for k in range(3))
        velocities = (middle - begin) / h, (end - middle) / h
        change = (velocities[1] - velocities[0]) / h
        for p, rate in ((step, timing.rates[i]), (h - step, timing.rates[i + 1])):
            t = p + np.array([[-step], [0.0], [step]])
            q = (begin + middle) / 2 + velocities[0] * t + change * t**2 / 2
            before, here, after = tool(q)
            velocity = (after - before) / (2 * step)
            bend = (after - 2 * here + before) / step**2
            speed = np.linalg.norm(velocity)
            turning = abs(velocity[0] * bend[1] - velocity[1] * bend[0]) / speed
            used.append((speed * rate / SPEED, turning * rate**2 / CENTRIPETAL))
        # The mean acceleration of the joints in the span
        jump = velocities[1] * timing.rates[i + 1] - velocities[0] * timing.rates[i]
        mean = np.abs(jump).max() / timing.times[i]
        used.append((mean / ACCELERATION, 0.0))
    assert np.max(used) == pytest.approx(1, abs=5e-3)


def test_a_part_of_a_spline_is_timed_as_in_the_whole(arm, limits, spline):
    whole = time_spline(spline, arm, limits, ALL_SPEEDS, NO_RATES)
    for first, end in ((0, 80), (40, 120), (60, SPANS)):
        at_start = first == 0
        at_end = end == SPANS
        part = replace(
            spline,
            q=spline.q[first:end],
            h=spline.h[first:end],
            rest=spline.rest[first : end + 1],
            before=None if at_start else Neighbour(spline.q[first - 1], spline.h[first - 1]),
            after=None if at_end else Neighbour(spline.q[end], spline.h[end]),
        )
        np.testing.assert_allclose(part.knots, spline.knots[first : end + 1])
        np.testing.assert_allclose(part.velocities, spline.velocities[first : end + 1])
        rates = whole.rates[first], whole.rates[end]
        timing = time_spline(part, arm, limits, ALL_SPEEDS[first:end], rates)
        assert timing.times.sum() == pytest.approx(whole.times[first:end].sum(), rel=1e-4)


def test_rates_that_no_motion_reaches_are_refused(arm, limits, spline):
    part = replace(
        spline,
        q=spline.q[:80],
        h=spline.h[:80],
        rest=spline.rest[:81],
        after=Neighbour(spline.q[80], spline.h[80]),
    )
    with pytest.raises(ac.ArmContourError):
        time_spline(part, arm, limits, ALL_SPEEDS[:80], (0.0, 1e3))


def test_rests_between_spans_stop_the_motion(arm, limits, spline):
    rest = spline.rest.copy()
    rest[80] = True
    q = spline.q.copy()
    q[80] = q[79]
    timing = time_spline(replace(spline, q=q, rest=rest), arm, limits, ALL_SPEEDS, NO_RATES)
    assert timing.rates[80] == 0 and (timing.rates[1:80] > 0).all()
    assert math.isfinite(timing.times.sum()) and (timing.times > 0).all()
