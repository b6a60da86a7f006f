"""Set-points in closed form, plain and inverse compensation, and refusals."""

from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.control.compensation import CompensationOptions, inverse, set_point_times
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.motion import PathLaw, Rates

from .motions import laps

KP = np.array([25.0, 20.0])  # 1/s
KV = np.array([150.0, 100.0])  # 1/s
UNEVEN = ac.ServoModel(kp=KP, kv=KV)
NAMES = ("none", "inverse", "pole_placement")


def smooth(duration=1.0, size=(0.4, -0.3)):
    """From rest to rest with acceleration that starts and ends at zero: 10 x³ - 15 x⁴ + 6 x⁵."""
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 3:] = np.outer([10, -15, 6], size)
    law = PathLaw(
        joint_path=ac.JointPath(breaks=np.array([0.0, 1.0]), coefficients=coefficients),
        breaks=np.array([0.0, duration]),
        s=np.array([0.0, 1.0]),
        rates=Rates(*np.array([[1 / duration], [0.0], [0.0], [0.0]])),
    )
    return ac.Trajectory(laws=(law,), method="hand")


def test_set_points_of_a_ramp_have_the_closed_form():
    ramp = laps([0.0, 1.0], [(0.5, -1.0)], [(0.0, 0.0)])
    set_points = ac.compensate(ramp, UNEVEN, ac.Inverse(), cycle=0.01)
    t = set_points.t
    lead = np.array([0.5, -1.0]) / KP  # the velocity error of the servo
    expected = np.array([0.3, -0.2]) + np.outer(t, [0.5, -1.0]) + lead
    inside = (t > 0.125) & (t < 0.875)  # away from the jumps of velocity at both ends
    np.testing.assert_allclose(set_points.q[inside], expected[inside], atol=1e-14)
    # Before the motion, the arm rests at the start of the plan.
    np.testing.assert_array_equal(set_points.q[0], (0.3, -0.2))
    np.testing.assert_allclose(set_points.q[-1], (0.8, -1.2), atol=1e-14)
    assert set_points.start_time == -0.01
    assert len(set_points.q) == 103 and set_points.cycle == 0.01 and set_points.method == "inverse"


@pytest.mark.parametrize(("interpolation", "gain"), [("linear", 1 / 12), ("cubic", 0.0)])
def test_set_points_of_a_parabola_have_the_closed_form(interpolation, gain):
    a = np.array([0.7, -0.4])
    h = 0.01
    curve = laps([0.0, 1.0], [(0.1, 0.0)], [a])
    servo = UNEVEN.replace(interpolation=interpolation)
    set_points = ac.compensate(curve, servo, ac.Inverse(), cycle=h)
    inside = (set_points.t > 0.125) & (set_points.t < 0.875)
    t = set_points.t[inside, None]
    dq = np.array([0.1, 0.0]) + a * t
    q = np.array([0.3, -0.2]) + np.array([0.1, 0.0]) * t + a * t**2 / 2
    # Between points of a parabola lines are above it by a h² / 12 on average, cubics are on it.
    expected = q + dq / KP + a / (KP * KV) - gain * a * h**2
    np.testing.assert_allclose(set_points.q[inside], expected, atol=1e-14)


def test_set_points_begin_and_end_at_the_rests_of_the_plan():
    # At full acceleration from rest, as optimal plans begin.
    plan = laps([0.0, 0.5, 1.0], [(0.0, 0.0), (0.5, -0.5)], [(1.0, -1.0), (-1.0, 1.0)])
    still = laps([0.0, 1.0], np.zeros((1, 2)), np.zeros((1, 2)))
    for method in NAMES:
        set_points = ac.compensate(plan, UNEVEN, COMPENSATIONS[method](), cycle=0.01)
        np.testing.assert_array_equal(set_points.q[0], plan(0.0), err_msg=method)
        q = ac.compensate(still, UNEVEN, COMPENSATIONS[method](), cycle=0.05).q
        np.testing.assert_allclose(q, np.tile((0.3, -0.2), (len(q), 1)), atol=1e-14)
    trajectory = smooth()
    set_points = ac.compensate(trajectory, UNEVEN, ac.NoCompensation(), cycle=0.1)
    np.testing.assert_allclose(set_points.q, trajectory(set_points.t.clip(0, 1)), atol=1e-14)
    assert set_points.trajectory is trajectory


def test_the_inverse_compensation_cancels_the_servo(arm):
    trajectory = smooth()
    plant = ac.ServoPlant(arm, UNEVEN, ac.Limits.only())
    errors = []
    for cycle in (8e-3, 4e-3, 2e-3):
        set_points = ac.compensate(trajectory, UNEVEN, ac.Inverse(), cycle=cycle)
        execution = ac.simulate(set_points, plant, resolution=cycle)
        errors.append(np.abs(execution.q - trajectory(execution.t.clip(0, 1.0))).max())
    # Means over intervals, and lines between them, leave errors of second order in the period. They
    # are made up for but next to both ends.
    assert errors[0] / errors[1] > 5 and errors[1] / errors[2] > 5
    assert errors[2] < 2e-7


def test_wrong_options_are_refused(refuses):
    three = ac.ServoModel(kp=[1.0, 2.0, 3.0], kv=150.0)
    for servo, options, words in (
        (UNEVEN, {"options": "inverse"}, "CompensationOptions"),
        (UNEVEN, {"cycle": 0.0}, "above zero"),
        (UNEVEN, {"cycle": -1e-3}, "-0.001 s"),
        (UNEVEN, {"cycle": np.nan}, "finite"),
        (three, {}, "kp has 3 values"),
    ):
        refuses(partial(ac.compensate, smooth(), servo, **options), ac.InvalidInput, words)
    refuses(lambda: ac.Inverse(poles=[-1, -1, -1]), ac.InvalidInput, "poles")
    refuses(lambda: ac.PolePlacement(gravity_feedforward=True), ac.InvalidInput, "gravity")
    refuses(CompensationOptions, ac.InvalidInput)


def test_the_inverse_compensates_joints_of_different_orders(refuses):
    servo = ac.ServoModel(
        kp=[25.0, np.inf], kv=[150.0, np.inf], order=("second", "delay"), dead_time=[0.0, 8e-3]
    )
    arm = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=ac.Limits())
    plan = smooth()
    set_points = ac.compensate(plan, servo)
    assert set_points.method == "inverse"
    errors = {}
    for method in ("inverse", "none"):
        execution = ac.simulate(
            ac.compensate(plan, servo, COMPENSATIONS[method]()), ac.ServoPlant(arm, servo)
        )
        errors[method] = np.abs(execution.q - plan(np.clip(execution.t, 0, plan.duration))).max(
            axis=0
        )
    assert (errors["inverse"] < 0.02 * errors["none"]).all()
    call = partial(ac.compensate, plan, servo, ac.PolePlacement())
    refuses(call, ac.InvalidInput, "order second, delay", "the compensation inverse")
    # A joint without a model keeps its plan; bodies take no other loops.
    unknown = ac.ServoModel(order="unknown")
    default = ac.compensate(plan, unknown)
    np.testing.assert_allclose(default.q, plan(np.clip(default.t, 0, plan.duration)), atol=1e-5)


@pytest.mark.parametrize("at_once", [1, 2])
def test_set_points_are_the_same_if_they_are_computed_in_groups(monkeypatch, at_once):
    end = np.array([0.4, -0.3])
    laws = (*smooth().laws, ac.dwell_law(end, 0.1), ac.dwell_law(end, 0.05))
    trajectory = ac.Trajectory(laws=laws, method="hand")
    whole = ac.compensate(trajectory, UNEVEN, ac.Inverse(), cycle=0.008)
    monkeypatch.setattr(set_point_times, "LAWS_AT_ONCE", at_once)
    monkeypatch.setattr(inverse, "TIMES_AT_ONCE", 7)
    grouped = ac.compensate(trajectory, UNEVEN, ac.Inverse(), cycle=0.008)
    np.testing.assert_array_equal(grouped.q, whole.q)
