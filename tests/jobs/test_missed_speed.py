"""Contours that are far slower than assigned: when it is said, what binds, and what mends it."""

import numpy as np
import pytest
from tests.geometry.tables import each
from tests.jobs.making import a_job, a_run

import armcontour as ac
from armcontour.jobs import Rounding, teach
from armcontour.jobs.missed_speed import FIRST, bound_acceleration, measure_jitter
from armcontour.motion import JointPath, PathLaw
from armcontour.program import Contour, Program, Rapid


def job(path, **values):
    arm = ac.load_arm("ur5e" if ac.Program.of(path).contours[0].path.dimension == 3 else "pmk3s")
    limits = arm.limits.replace(speed=0.15, joint_torque=None, **values.pop("limits", {}))
    rounding = Rounding(tolerance=3e-4, angular_tolerance=0.03)
    asked = {"compensation": "none", "limits": limits, "rounding": rounding, "reserve": 0.1}
    return a_job(path, a_run(**asked | values), arm=arm)


def measured(noise, points=80):
    """A half circle of points whose tool axes have errors."""
    turn = np.linspace(0, np.pi, points)
    at = np.stack([0.45 + 0.06 * np.cos(turn), 0.06 * np.sin(turn), 0 * turn + 0.3], axis=1)
    axes = np.stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), 0 * turn - 1], axis=1)
    axes += np.random.default_rng(1).normal(scale=noise, size=axes.shape)
    return ac.Path.polyline(at).pointing(axes)


def told(asked):
    found = teach(asked)["one"].weak_points
    return [x for x in found if "reaches its" in x or "slower than assigned" in x]


def test_axes_that_turn_to_and_fro_are_told_with_what_binds():
    (said,) = told(job(measured(6e-3)))
    for words in ("the contour never reaches its 150 mm/s: ", " on average, ", " of joint "):
        assert words in said
    assert "turns to and fro from waypoint to waypoint, by 0.42° RMS" in said
    assert "path.smooth_axes: 1.5 deg" in said
    # Smooth axes, a given duration and lines without room for their speed are not told.
    assert told(job(measured(0.0))) == []
    assert told(job(measured(6e-3), duration=30.0)) == []
    for length in (1e-4, 5e-3, 0.05):
        line = ac.Path.polyline([(0.30, 0.20), (0.30 + length, 0.20)])
        assert told(job(line)) == [], length


def test_many_contours_are_told_once_with_the_worst():
    a, b = (Contour(path=measured(x), name=name) for x, name in ((4e-3, "a"), (6e-3, "b")))
    (said,) = told(job(Program(moves=(a, Rapid(), b))))
    assert said.startswith("2 contours are far slower than assigned, most of all contour b, which")


def test_tight_arcs_are_told_with_the_centripetal_acceleration():
    circle = ac.Path.from_segments([ac.Arc(start=(0.32, 0.2), center=(0.3, 0.2), angle=2 * np.pi)])
    (said,) = told(job(circle, limits={"centripetal_acceleration": 0.02}))
    assert "the centripetal acceleration binds: lower the velocity" in said


def test_jitter_is_the_error_of_the_axes_and_turns_are_none():
    # Errors along the axis do not turn it: two of three components count.
    for noise in (1e-3, 5e-3):
        found = measure_jitter(measured(noise, 2000))
        assert found == pytest.approx(noise * np.sqrt(2), rel=0.05)
    assert measure_jitter(measured(0.0)) == 0.0
    assert measure_jitter(measured(0.0).pointing((0, 0, -1))) == 0.0
    assert measure_jitter(ac.Path.polyline([(0.3, 0.2), (0.4, 0.2)])) == 0.0


def moved(s, x, slope):
    """A motion along a straight line of joints with given squares of the speed."""
    length = float(s[-1])
    line = np.zeros((1, 6, 2))
    line[0, 1] = length, -length
    path = JointPath(breaks=np.array([0.0, length]), coefficients=line)
    return ac.Trajectory(laws=(PathLaw.of_squares(path, s, x, slope),), method="optimal")


def shown(motion, length):
    """The acceleration that the ends of a motion show, at many times."""
    breaks = motion.laws[0].breaks
    t = np.unique(np.concatenate([np.linspace(0, motion.duration, 20_001), breaks]))
    s, v = motion.s(t), motion.s(t, 1)
    gone = np.minimum(s, length - s)
    inside = gone > FIRST * length
    return float((v[inside] ** 2 / (2 * gone[inside])).max())


@each("seed", range(40))
def test_the_bound_of_the_acceleration_that_ends_show_is_never_exceeded(seed):
    rng = np.random.default_rng(seed)
    n, length = int(rng.integers(2, 60)), 10 ** rng.uniform(-3, 0)
    s = length * np.concatenate([[0.0], np.sort(rng.uniform(0, 1, n - 1)), [1.0]])
    x = rng.uniform(0.01, 1, n + 1) * rng.choice([1e-3, 1.0], n + 1)
    if rng.random() < 0.7:
        x[[0, -1]] = 0.0
    # So bent that the speed stays above zero between the points.
    slope = rng.uniform(-0.9, 0.9, n) * np.minimum(x[:-1], x[1:]) / np.diff(s) ** 2
    motion = moved(s, x, slope)
    assert shown(motion, length) <= bound_acceleration(motion, length)


def test_that_bound_is_the_acceleration_of_a_motion_with_a_uniform_one():
    s = np.linspace(0.0, 0.1, 101)
    x = 2 * 0.7 * np.minimum(s, 0.1 - s)
    assert bound_acceleration(moved(s, x, np.zeros(100)), 0.1) == pytest.approx(0.7, rel=1e-6)
    # A fast part in the middle does not count as what the ends show.
    x = np.minimum(x, 0.02)
    x[45:56] = 0.05
    found = bound_acceleration(moved(s, x, np.zeros(100)), 0.1)
    assert found == pytest.approx(0.7, rel=0.02) and np.diff(x).max() / 2e-3 > 10
