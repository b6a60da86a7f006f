"""A path law whose path acceleration is linear in s: against an ODE solver, and its times."""

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


def law_of(duration, length, *rates, path=PATH):
    """One interval; the rates are ds, dds, slope and jerk."""
    return PathLaw(
        joint_path=path,
        breaks=np.array([0.0, duration]),
        s=np.array([0.0, length]),
        rates=Rates(*np.array(rates)[:, None]),
    )


def test_the_law_agrees_with_the_integral_of_one_over_the_speed():
    i = np.zeros(21, dtype=int)
    for case, (begin, u, slope, width) in RATES.items():

        def end_speed(width, begin=begin, u=u, slope=slope):  # from ds d(ds) = dds ds
            return np.sqrt(begin**2 + 2 * u * width + slope * width**2)

        end = end_speed(width)
        duration = float(interval_times(*np.array([[width], [begin], [end], [slope]]))[0])
        # s = r² takes out the root at rest.
        expected, _ = quad(
            lambda r, x=end_speed: 2 * r / x(r * r), 0, np.sqrt(width), epsabs=0, epsrel=1e-11
        )
        assert duration == pytest.approx(expected, rel=1e-9), case
        law = law_of(duration, width, begin, u, slope, 0.0)
        t = np.linspace(0, duration, 21)

        def rates(_, y, u=u, slope=slope):
            return [y[1], u + slope * y[0]]

        options = {"t_eval": t, "rtol": 1e-11, "atol": 1e-14, "method": "DOP853"}
        s, ds = solve_ivp(rates, (0, duration), [0, begin], **options).y
        near = 1e-9 * width, 1e-9 * max(begin, end), 1e-12
        for order, exact in enumerate((s, ds, u + slope * s)):
            value = law.path_position(i, t, order)
            options = {"rtol": 1e-9, "err_msg": case}
            np.testing.assert_allclose(value, exact, atol=near[order], **options)
        assert law.path_position(i[:1], t[-1:])[0] == pytest.approx(width, rel=1e-12), case


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_law_is_continuous_where_its_series_ends(sign):
    # slope (time / 2)² = z; the formulas of times change over at |z| = 1e-4.
    width = np.full(2, 0.1)
    begin = np.full(2, 0.4)
    end = np.full(2, 0.6)
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
    # |slope| t² = 1e-4 is where those of the motion do.
    law = law_of(0.1, 0.1, 0.5, 0.3, sign, 0.0)
    t = 1e-2 * np.array([1 - 1e-9, 1 + 1e-9])
    for order, rate in enumerate((0.5, 0.3, 0.5 * sign)):
        before, after = law.path_position(np.zeros(2, dtype=int), t, order)
        # What time itself changes.
        assert after - before == pytest.approx(rate * 2e-11, rel=0.1, abs=2e-15), order


@pytest.mark.parametrize("ends", [False, True])
def test_the_jerk_is_uniform_from_rest_and_to_rest(ends):
    # Closed form: s = j t³ / 6 from rest, and its mirror image to rest.
    jerk = 3.0
    duration = 0.8
    length = jerk * duration**3 / 6
    start = (jerk * duration**2 / 2, -jerk * duration) if ends else (0.0, 0.0)
    path = ac.JointPath.spline(np.array([[0.0, 0.0], [length, 2 * length]]), [0, length])
    law = law_of(duration, length, *start, 0.0, jerk, path=path)
    t = np.linspace(0.0, duration, 9)
    i = np.zeros(9, dtype=int)
    since, side = (duration - t, -1.0) if ends else (t, 1.0)
    way = jerk * since**3 / 6
    derivatives = (
        length - way if ends else way,
        jerk * since**2 / 2,
        side * jerk * since,
        0 * t + jerk,
    )
    for k, expected in enumerate(derivatives):
        np.testing.assert_allclose(law.path_position(i, t, k), expected, atol=1e-14)
        both = np.outer(expected, [1, 2])
        np.testing.assert_allclose(law.on_interval(i, t, k), both, atol=1e-13)
    np.testing.assert_allclose(law.reach(law.path_position(i, t))[1], t, atol=1e-8)
