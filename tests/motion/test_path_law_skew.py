"""A path law whose path acceleration is linear in s: against an ODE solver, and its times."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import armcontour as ac
from armcontour.motion import PathLaw, Rates, interval_times

PATH = ac.JointPath.spline([(0.0,), (1.0,)])

# ds and dds at the start, the slope of dds over s, and the length of the interval.
RATES = {
    "hyperbolic, speeding up": (0.2, 0.3, 2.0, 0.5),
    "hyperbolic, slowing down": (1.0, -0.5, 1.5, 0.3),
    "hyperbolic, from rest": (0.0, 0.4, 3.0, 0.5),
    "circular, speeding up": (0.3, 0.9, -1.0, 0.4),
    "circular, slowing down": (1.0, -0.1, -2.0, 0.4),
    "circular, from rest": (0.0, 0.8, -1.0, 0.5),
    "nearly uniform, up": (0.3, 0.4, 1e-5, 0.5),
    "nearly uniform, down": (0.3, 0.4, -1e-5, 0.5),
    "uniform": (0.3, 0.4, 0.0, 0.5),
    "tiny": (2e-3, 0.5, -40.0, 1e-6),
}


def end_speed(begin, u, slope, width):
    """From ds d(ds) = dds ds."""
    return np.sqrt(begin**2 + 2 * u * width + slope * width**2)


def time_of(case):
    begin, u, slope, width = RATES[case]
    end = end_speed(begin, u, slope, width)
    return float(interval_times(*(np.array([x]) for x in (width, begin, end, slope)))[0])


@pytest.mark.parametrize("case", RATES)
def test_the_motion_solves_its_equation(case):
    begin, u, slope, width = RATES[case]
    duration = time_of(case)
    law = PathLaw(
        joint_path=PATH,
        breaks=np.array([0.0, duration]),
        s=np.array([0.0, width]),
        rates=Rates(*np.array([[begin], [u], [slope], [0.0]])),
    )
    t = np.linspace(0, duration, 21)
    found = solve_ivp(
        lambda _, y: [y[1], u + slope * y[0]],
        (0, duration),
        [0.0, begin],
        t_eval=t,
        rtol=1e-11,
        atol=1e-14,
        method="DOP853",
    )
    i = np.zeros(21, dtype=int)
    size = max(begin, end_speed(begin, u, slope, width))
    np.testing.assert_allclose(law.path_position(i, t), found.y[0], atol=1e-9 * width)
    np.testing.assert_allclose(law.path_position(i, t, 1), found.y[1], atol=1e-9 * size)
    np.testing.assert_allclose(
        law.path_position(i, t, 2), u + slope * found.y[0], rtol=1e-9, atol=1e-12
    )
    assert law.path_position(i[:1], t[-1:])[0] == pytest.approx(width, rel=1e-12)


@pytest.mark.parametrize("case", RATES)
def test_interval_times_are_the_integral_of_one_over_the_speed(case):
    begin, u, slope, width = RATES[case]
    # s = r² takes out the root at rest.
    expected, _ = quad(
        lambda r: 2 * r / end_speed(begin, u, slope, r * r),
        0,
        np.sqrt(width),
        epsabs=0,
        epsrel=1e-11,
    )
    assert time_of(case) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("sign", [-1, 1])
def test_times_do_not_jump_where_the_series_ends(sign):
    # slope (time / 2)² = z; the formulas change over at |z| = 1e-4.
    width, begin, end = np.full(2, 0.1), np.full(2, 0.4), np.full(2, 0.6)
    z = sign * 1e-4 * np.array([1 - 1e-9, 1 + 1e-9])
    below, above = interval_times(width, begin, end, z / 0.1**2)
    assert below == pytest.approx(above, rel=1e-12)
    # Both formulas at once, and the series alone.
    alone = interval_times(width[:1], begin[:1], end[:1], z[:1] / 0.1**2)[0]
    assert alone == pytest.approx(below, rel=1e-15)
    uniform = interval_times(width[:1], begin[:1], end[:1], np.zeros(1))[0]
    assert uniform == pytest.approx(0.2, rel=1e-15)
    assert np.sign(below - uniform) == sign  # 1 + z / 3 + ...
    assert below / uniform - 1 == pytest.approx(sign * 1e-4 / 3, rel=1e-3)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_motion_does_not_jump_where_the_series_ends(sign, order):
    # |slope| t² = 1e-4 is where the formulas change over.
    slope, t = sign * 1.0, 1e-2 * np.array([1 - 1e-9, 1 + 1e-9])
    law = PathLaw(
        joint_path=PATH,
        breaks=np.array([0.0, 0.1]),
        s=np.array([0.0, 0.1]),
        rates=Rates(*np.array([[0.5], [0.3], [slope], [0.0]])),
    )
    before, after = law.path_position(np.zeros(2, dtype=int), t, order)
    expected = [0.5, 0.3, 0.5 * slope][order] * 2e-11  # what time itself changes
    assert after - before == pytest.approx(expected, rel=0.1, abs=2e-15)


@pytest.mark.parametrize("ends", [False, True])
def test_uniform_jerk_from_rest_and_to_rest(ends):
    # Closed form: s = j t³ / 6 from rest, and its mirror image to rest.
    jerk, duration = 3.0, 0.8
    length = jerk * duration**3 / 6
    speed, rate = jerk * duration**2 / 2, jerk * duration
    start = (speed, -rate) if ends else (0.0, 0.0)
    law = PathLaw(
        joint_path=ac.JointPath.spline(np.array([[0.0, 0.0], [length, 2 * length]]), [0, length]),
        breaks=np.array([0.0, duration]),
        s=np.array([0.0, length]),
        rates=Rates(*np.array([[start[0]], [start[1]], [0.0], [jerk]])),
    )
    t = np.linspace(0.0, duration, 9)
    i = np.zeros(9, dtype=int)
    since = duration - t if ends else t
    way = jerk * since**3 / 6
    side = -1.0 if ends else 1.0
    for order, expected in enumerate(
        (
            length - way if ends else way,
            jerk * since**2 / 2,
            side * jerk * since,
            np.full(9, jerk),
        )
    ):
        found = law.path_position(i, t, order)
        np.testing.assert_allclose(found, expected, atol=1e-14)
        np.testing.assert_allclose(
            law.on_interval(i, t, order), np.outer(expected, [1, 2]), atol=1e-13
        )
    np.testing.assert_allclose(law.reach(law.path_position(i, t))[1], t, atol=1e-8)
