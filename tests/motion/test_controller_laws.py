"""Interpolation laws of controllers against SciPy, and the times of their commands."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import BPoly, BSpline, CubicHermiteSpline, CubicSpline, make_interp_spline

import armcontour as ac
from armcontour.motion import CONTROLLERS, interpolate_points

RANDOM = np.random.default_rng(0)
COUNT = 12
Q, DQ, DDQ = RANDOM.normal(size=(3, COUNT, 2))
T = np.round(np.cumsum(RANDOM.uniform(0.01, 0.03, COUNT)), 6)
REGULAR = 0.01 * np.arange(COUNT)


def points(t=T, **derivatives):
    return SimpleNamespace(t=t, q=Q, **derivatives)


LAWS = [
    ("jtc", points(), "lines", make_interp_spline(T, Q, 1)),
    ("jtc", points(dq=DQ), "cubics", CubicHermiteSpline(T, Q, DQ)),
    (
        "jtc",
        points(dq=DQ, ddq=DDQ),
        "quintics",
        BPoly.from_derivatives(T, np.stack([Q, DQ, DDQ], 1)),
    ),
    ("jtc_spline", points(), "clamped spline", CubicSpline(T, Q, bc_type="clamped")),
    ("jtc_spline", points(dq=DQ), "cubics", CubicHermiteSpline(T, Q, DQ)),
]


@pytest.mark.parametrize(("controller", "given", "law", "expected"), LAWS)
def test_joint_trajectory_controller_interpolates_by_its_law(controller, given, law, expected):
    curve = interpolate_points(given, controller)
    inside = np.linspace(0, T[-1] - T[0], 997)
    assert curve.law == law
    for order in range(2 if law == "lines" else 3):
        exact = expected(T[0] + inside[1:-1], nu=order)
        assert curve(inside[1:-1], order) == pytest.approx(exact, rel=1e-8, abs=1e-8)
    # Commands are one cycle ahead, and the arm rests before and after them.
    t, commands = curve.commands(500.0)
    later = np.clip(t + 0.002, 0, T[-1] - T[0])
    assert commands == pytest.approx(expected(T[0] + later), abs=1e-8)
    assert np.diff(t) == pytest.approx(0.002)
    assert commands[0] == pytest.approx(Q[0]) and commands[-2] == pytest.approx(Q[-1])


def test_linuxcnc_interpolates_by_a_uniform_b_spline():
    # Its queue starts with the first point, and is filled with the last one.
    control = np.concatenate([Q[:1]] * 3 + [Q] + [Q[-1:]] * 3)
    spline = BSpline(0.01 * (np.arange(len(control) + 4) - 5), control, 3)
    curve = interpolate_points(points(REGULAR), "linuxcnc")
    t = np.linspace(-0.01, 0.01 * COUNT, 499)
    assert curve(t) == pytest.approx(spline(t), abs=1e-12)
    way_points = (Q[:-2] + 4 * Q[1:-1] + Q[2:]) / 6
    assert curve(REGULAR[1:-1]) == pytest.approx(way_points)
    t, commands = curve.commands(1000.0)
    # The newest point k comes at k T, where the queue is at way-point k - 2.
    assert commands[np.isclose(t, 0.05)][0] == pytest.approx(way_points[2])
    assert commands[0] == pytest.approx(Q[0]) and commands[-1] == pytest.approx(Q[-1])
    with pytest.raises(ac.InvalidInput, match="regular times"):
        interpolate_points(points(), "linuxcnc")


def test_held_points_are_not_interpolated():
    for name, first in (("hold", 0), ("jtc_none", 1)):
        t, commands = interpolate_points(points(REGULAR), name).commands(200.0)
        expected = np.minimum(np.repeat(np.arange(first, COUNT), 2), COUNT - 1)
        begin = int(np.flatnonzero(np.isclose(t, 0.0 if name == "hold" else -0.005))[0])
        assert commands[begin : begin + len(expected)] == pytest.approx(Q[expected])
        assert commands[0] == pytest.approx(Q[0]) and commands[-1] == pytest.approx(Q[-1])


def test_invalid_points_are_refused():
    assert set(CONTROLLERS) == {"jtc", "jtc_spline", "jtc_none", "linuxcnc", "hold"}
    with pytest.raises(ac.InvalidInput, match="at least two points"):
        interpolate_points(SimpleNamespace(t=[0.0], q=[[1.0]]), "jtc")
    with pytest.raises(ac.InvalidInput, match="accelerations without velocities"):
        interpolate_points(points(ddq=DDQ), "jtc")
    with pytest.raises(ac.InvalidInput, match="jtc_spline"):
        interpolate_points(points(), "moveit")
