"""Set-points in closed form, the plain and the inverse compensation, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import LapLaw, PathLaw, Rates

KP, KV = np.array([25.0, 20.0]), np.array([150.0, 100.0])


@pytest.fixture(scope="module")
def uneven():
    return ac.ServoModel(kp=KP, kv=KV)


def laps(times, dq, ddq, start=(0.3, -0.2)):
    """A trajectory of laps with given accelerations; velocities jump where `dq` says so."""
    h, dq, ddq = np.diff(times), np.asarray(dq, float), np.asarray(ddq, float)
    steps = dq * h[:, None] + ddq * h[:, None] ** 2 / 2
    q = np.concatenate([[start], start + np.cumsum(steps, axis=0)])
    law = LapLaw(breaks=np.asarray(times, float), q=q, dq=dq, ddq=ddq)
    return ac.Trajectory(laws=(law,), method="hand")


def smooth(duration=1.0, size=(0.4, -0.3)):
    """From rest to rest with acceleration that starts and ends at zero: 10 x³ - 15 x⁴ + 6 x⁵."""
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 3:] = np.outer([10, -15, 6], size)
    path = ac.JointPath(breaks=np.array([0.0, 1.0]), coefficients=coefficients)
    law = PathLaw(
        joint_path=path,
        breaks=np.array([0.0, duration]),
        s=np.array([0.0, 1.0]),
        rates=Rates(*np.array([[1 / duration], [0.0], [0.0], [0.0]])),
    )
    return ac.Trajectory(laws=(law,), method="hand")


def test_a_ramp_in_closed_form(uneven):
    ramp = laps([0.0, 1.0], [(0.5, -1.0)], [(0.0, 0.0)])
    taught = ac.compensate(ramp, uneven, method="inverse", period=0.1)
    t = np.arange(10) * 0.1
    lead = np.array([0.5, -1.0]) / KP  # the velocity error of the servo
    expected = np.array([0.3, -0.2]) + np.outer(t, [0.5, -1.0]) + lead
    # Before it the arm stands at the start of the plan.
    np.testing.assert_array_equal(taught.q[0], (0.3, -0.2))
    np.testing.assert_allclose(taught.q[1:-1], expected, atol=1e-14)
    np.testing.assert_allclose(taught.q[-1], (0.8, -1.2), atol=1e-14)
    assert taught.start_time == -0.1
    assert len(taught.q) == 12 and taught.period == 0.1 and taught.method == "inverse"


def test_a_parabola_in_closed_form(uneven):
    a = np.array([0.7, -0.4])
    curve = laps([0.0, 1.0], [(0.1, 0.0)], [a])
    taught = ac.compensate(curve, uneven, method="inverse", period=0.25)
    t = taught.t[1:-1, None]
    dq = np.array([0.1, 0.0]) + a * t
    q = np.array([0.3, -0.2]) + np.array([0.1, 0.0]) * t + a * t**2 / 2
    np.testing.assert_allclose(taught.q[1:-1], q + dq / KP + a / (KP * KV), atol=1e-14)


def test_where_derivatives_jump_the_right_side_counts(uneven):
    bent = laps([0.0, 0.5, 1.0], [(1.0, 0.0), (0.0, 1.0)], np.zeros((2, 2)))
    taught = ac.compensate(bent, uneven, method="inverse", period=0.25)
    np.testing.assert_allclose(taught.q[3], bent(0.5) + np.array([0.0, 1.0]) / KP, atol=1e-14)


@pytest.mark.parametrize("method", ["none", "inverse", "pole_placement"])
def test_the_arm_stands_at_the_start_of_the_plan_first(uneven, method):
    # At full acceleration from rest, as optimal plans begin.
    plan = laps([0.0, 0.5, 1.0], [(0.0, 0.0), (0.5, -0.5)], [(1.0, -1.0), (-1.0, 1.0)])
    taught = ac.compensate(plan, uneven, method=method, period=0.01)
    np.testing.assert_array_equal(taught.q[0], plan(0.0))


def test_none_teaches_the_trajectory_itself(uneven):
    trajectory = smooth()
    taught = ac.compensate(trajectory, uneven, method="none", period=0.1)
    np.testing.assert_allclose(taught.q, trajectory(taught.t.clip(0, 1)), atol=1e-14)
    assert taught.trajectory is trajectory


@pytest.mark.parametrize("method", ["none", "inverse", "pole_placement"])
@pytest.mark.parametrize("period", [0.1, 0.3, 4e-3, 5.0])
def test_the_last_set_point_is_the_end(uneven, method, period):
    trajectory = smooth()
    taught = ac.compensate(trajectory, uneven, method=method, period=period)
    np.testing.assert_array_equal(taught.q[-1], trajectory(1.0))
    # The first set-point that may be the end is the first at or after it.
    assert taught.t[-1] >= 1.0 - 1e-9
    if method != "pole_placement":
        assert taught.t[-1] < 1.0 + period


@pytest.mark.parametrize("method", ["none", "inverse"])
def test_set_points_at_the_rounded_end_are_not_doubled(uneven, method):
    # Durations are sums of many laps: a little more or less than 0.3 s is 0.3 s.
    for duration in (0.3 * (1 - 1e-11), 0.3, 0.3 * (1 + 1e-11)):
        for period, count in ((0.1, 4), (0.01, 31), (0.3, 2)):
            taught = ac.compensate(smooth(duration), uneven, method=method, period=period)
            assert len(taught.q) == count


@pytest.mark.parametrize("method", ["none", "inverse", "pole_placement"])
def test_compensation_is_linear(uneven, method):
    times = [0.0, 0.3, 0.5, 0.9]
    rng = np.random.default_rng(0)
    dq, ddq, start = rng.normal(size=(2, 3, 2)), rng.normal(size=(2, 3, 2)), rng.normal(size=(2, 2))
    a, b = 0.7, -2.5

    def taught(k):
        trajectory = laps(times, k[0] * dq[0] + k[1] * dq[1], k[0] * ddq[0] + k[1] * ddq[1],
                          k[0] * start[0] + k[1] * start[1])  # fmt: skip
        return ac.compensate(trajectory, uneven, method=method, period=0.01).q

    np.testing.assert_allclose(taught((a, b)), a * taught((1, 0)) + b * taught((0, 1)), atol=1e-11)


def test_the_inverse_undoes_the_servo(arm, uneven):
    trajectory = smooth()
    plant = ac.ServoPlant(arm, uneven, ac.Limits())
    errors = []
    for period in (8e-3, 4e-3, 2e-3):
        taught = ac.compensate(trajectory, uneven, method="inverse", period=period)
        done = ac.execute(taught, plant, resolution=period)
        off = done.q - trajectory(done.t.clip(0, 1.0))
        errors.append(np.abs(off).max())
    # Linear interpolation between exact set-points: second order in the period.
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.15)
    assert errors[2] < 2e-6


@pytest.mark.parametrize("method", ["none", "inverse", "pole_placement"])
def test_input_is_left_alone_and_time_shifts_do_nothing(uneven, method):
    still = laps([0.0, 1.0], np.zeros((1, 2)), np.zeros((1, 2)))
    taught = ac.compensate(still, uneven, method=method, period=0.05)
    np.testing.assert_allclose(taught.q, np.tile((0.3, -0.2), (len(taught.q), 1)), atol=1e-14)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"method": "magic"},
            ("method", "inverse, pole_placement, inverse_dynamics, none", "'magic'"),
        ),
        ({"method": "inverse", "poles": [-1, -1, -1]}, ("inverse takes no options", "not poles")),
        ({"method": "pole_placement", "pole": 1}, ("takes the option poles", "not pole")),
        ({"period": 0.0}, ("command interval", "above zero")),
        ({"period": -1e-3}, ("command interval", "-0.001 s")),
        ({"period": np.nan}, ("command interval", "finite")),
    ],
)
def test_refused_options(uneven, options, words, refuses):
    refuses(lambda: ac.compensate(smooth(), uneven, **options), ac.InvalidInput, *words)


def test_gains_for_another_arm_are_refused(refuses):
    servo = ac.ServoModel(kp=[1.0, 2.0, 3.0], kv=150.0)
    refuses(lambda: ac.compensate(smooth(), servo), ac.InvalidInput, "kp has 3 values", "2 joints")
