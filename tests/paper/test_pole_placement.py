"""Compensation by pole placement, its fastest poles, and the lead of set-points in time."""

from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy import signal
from tests.control.compensation.motions import laps

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.motion import Law
from armcontour.paper.pole_placement import default_poles

UNEVEN = ac.ServoModel(kp=[25.0, 10.0], kv=[150.0, 300.0])


def compensator_26(kp, kv, m1, m2, g):
    """F of (26) with the paper's a0 to a3; the leading minus is dropped, or F(0) were -1."""
    x = (kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g
    a0 = -m1 * m2 * g
    a1 = x - m1 * m2 * g / kp
    a2 = x / kp - m1 * m2 * g / (kp * kv)
    a3 = x / (kp * kv)
    numerator = np.real([a3, a2, a1, a0])
    denominator = np.real(np.poly([m1, m2, g]))
    return signal.TransferFunction(numerator, denominator)


POLES = (
    [-75, -75, -75],
    [-50, -50, -50],  # the paper's, without a velocity error
    [-60, -90, -140],
    [-400, -500, -700],
    [-100 + 80j, -100 - 80j, -150],
    [-5, -20, -3000],
    [-3 + 2j, -3 - 2j, -2000],
)


def place(motion, servo, poles=None, **more):
    return ac.compensate(motion, servo, ac.PolePlacement(poles=poles), **more)


def test_pole_placement_equals_equation_26_applied_to_the_trajectory():
    # Straight pieces between multiples of the period: SciPy's first-order hold is exact for them.
    velocities = np.random.default_rng(1).normal(size=(3, 2))
    start = np.array([0.4, -1.1])
    motion = laps([0.0, 0.04, 0.1, 0.2], velocities, np.zeros((3, 2)), start)
    for poles, cycle in product(POLES, (4e-3, 1e-3)):
        set_points = place(motion, UNEVEN, cycle=cycle, poles=poles)
        times = set_points.t[:-1]  # the last one is the end itself
        for j in range(2):
            system = compensator_26(UNEVEN.kp[j], UNEVEN.kv[j], *poles)
            source = motion(times.clip(0, 0.2))[:, j] - start[j]
            _, expected, _ = signal.lsim(system, source, times)
            near = 1e-9 * max(np.abs(expected).max(), 1.0)
            q = set_points.q[:-1, j] - start[j]
            np.testing.assert_allclose(q, expected, atol=near, err_msg=f"{poles}, {cycle}")
    # Parabolas: SciPy converges to the set-points as its grid gets finer.
    motion = laps([0.0, 0.1, 0.2], [(0.0, 0.2), (0.3, 0.0)], [(3.0, -2.0), (-3.0, 1.0)], (0.0, 0.0))
    set_points = place(motion, UNEVEN, cycle=0.01, poles=[-75] * 3)
    system = compensator_26(25.0, 150.0, -75, -75, -75)
    errors = []
    for parts in (10, 100):
        t = np.arange(20 * parts + 1) * (0.01 / parts)
        _, expected, _ = signal.lsim(system, motion(t.clip(0, 0.2))[:, 0], t)
        errors.append(np.abs(expected[::parts] - set_points.q[:21, 0])[:20].max())
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.2)
    assert errors[1] < 1e-6


def test_poles_differ_per_joint_and_interpolation_adds_no_error():
    motion = laps([0.0, 0.2], [(1.0, 1.0)], [(0.0, 0.0)], (0.0, 0.0))
    poles = [POLES[0], POLES[2]]
    both = place(motion, UNEVEN, cycle=0.01, poles=poles)
    for j in range(2):
        one = place(motion, UNEVEN, cycle=0.01, poles=poles[j])
        n = min(len(one.q), len(both.q)) - 1
        np.testing.assert_allclose(both.q[:n, j], one.q[:n, j], atol=1e-12)
    times = [0.0, 0.0137, 0.1011, 0.2]
    dq = [(0.0, 0.2), (0.3, 0.0), (1.0, 1.0)]
    motion = laps(times, dq, np.ones((3, 2)), (0, 0))
    coarse, fine = (place(motion, UNEVEN, cycle=x) for x in (0.05, 0.001))
    n = len(coarse.q) - 1
    np.testing.assert_allclose(coarse.q[:n], fine.q[: 50 * n : 50], atol=1e-12)
    # DC gain 1: before the last set-point is put there, it is there already.
    motion = laps([0.0, 0.2], [(1.0, -2.0)], [(0.0, 0.0)], (0.5, 0.5))
    set_points = place(motion, UNEVEN, cycle=0.01)
    np.testing.assert_allclose(set_points.q[-2], motion(0.2), atol=1e-12)
    np.testing.assert_array_equal(set_points.q[-1], motion(0.2))


def test_default_poles_cancel_the_zero_and_all_joints_lag_equally(arm):
    placed = default_poles(UNEVEN.for_joints(2))
    np.testing.assert_array_equal(placed, [[-150, -150, -150], [-150, -150, -300]])
    for kv, (m1, m2, g) in zip(UNEVEN.kv, placed, strict=True):
        x = (kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g
        # F G = (X s - m1 m2 g) / ((s - m1)(s - m2)(s - g)) = 150² / (s + 150)² on every joint.
        s = np.array([1j, 30j, 500j])
        together = (x * s - m1 * m2 * g) / ((s - m1) * (s - m2) * (s - g))
        np.testing.assert_allclose(together, 150**2 / (s + 150) ** 2, rtol=1e-12)
    alike = laps([0.0, 0.2, 0.4], [(1.0, 1.0), (-1.0, -1.0)], np.zeros((2, 2)), (0.0, 0.0))
    plant = ac.ServoPlant(arm, UNEVEN, ac.Limits.only())
    gap = {}
    for method in ("pole_placement", "none"):
        set_points = ac.compensate(alike, UNEVEN, COMPENSATIONS[method](), cycle=2e-4)
        execution = ac.simulate(set_points, plant, resolution=2e-4)
        gap[method] = np.abs(np.diff(execution.q, axis=1)).max()
    assert gap["pole_placement"] < 1e-4 < 1e-2 < gap["none"]


def test_invalid_poles_are_refused(refuses):
    motion = laps([0.0, 0.2], [(1.0, 1.0)], [(0.0, 0.0)], (0.0, 0.0))
    for poles, words, joint in (
        ([-1, -1, 0], "negative real parts", 0),
        ([[-1, -1, -1], [-1, 2, -1]], "without bound", 1),
        ([1 + 1j, 1 - 1j, -1], "negative real parts", 0),
        ([-1, -1], "2 rows of three", None),
        ([[-1, -1, -1]] * 3, "three finite numbers", None),
        ([-1, -1, np.nan], "finite", None),
        ([-1 + 1j, -1 + 1j, -1], "complex conjugates", None),
        ([-1 + 1j, -1, -1], "complex conjugates", None),
        ([-1, -1 + 1j, -1 - 1j], "observer pole real", None),
        ("fast", "three finite numbers", None),
    ):
        kind = ac.CompensationError if joint is not None else ac.InvalidInput
        refuses(partial(place, motion, UNEVEN, poles=poles), kind, words, joint=joint)


def test_a_servo_of_first_order_is_refused(mac, refuses):
    first = ac.ServoModel(kp=25.0, order="first")
    call = partial(ac.compensate, mac, first, ac.PolePlacement())
    refuses(call, ac.InvalidInput, "order second", "the compensation inverse")


DURATION = 0.6


class Smooth(Law):
    """A swing with velocity, acceleration and jerk 0 at both ends."""

    breaks = np.array([0.0, DURATION])

    def on_interval(self, i, t, order):
        x = t / DURATION
        s = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]).deriv(order)(x)
        start = np.array([0.3, -0.2]) if order == 0 else 0.0
        return start + s[:, None] / DURATION**order * np.array([0.5, -0.8])


SWING = ac.Trajectory(laws=(Smooth(),), method="hand")
DEAD_TIMES = (0.0, 0.04, 0.0345, [0.0115, 0.087], 1.001)  # the last is longer than the motion


def gains(order):
    return {"kp": [25.0, 40.0], "kv": [150.0, 90.0] if order == "second" else None, "order": order}


def largest_deviation(arm, servo, cycle, method="inverse", plant=None, **options):
    """Largest distance of a joint from the plan that it shall follow, at any time."""
    set_points = ac.compensate(SWING, servo, COMPENSATIONS[method](**options), cycle=cycle)
    execution = ac.simulate(
        set_points, ac.ServoPlant(arm, plant or servo, ac.Limits.only()), resolution=1e-3
    )
    assert execution.t[0] == set_points.start_time == set_points.t[0]
    return np.abs(execution.q - SWING(execution.t.clip(0, DURATION))).max()


def test_the_compensated_joint_follows_the_plan_without_delay(arm):
    bounds = {"linear": 3e-5, "cubic": 2e-5, "step": 2e-4}
    for order, interpolation, dead in product(("second", "first"), bounds, DEAD_TIMES):
        servo = ac.ServoModel(**gains(order), interpolation=interpolation, dead_time=dead)
        errors = [largest_deviation(arm, servo, cycle) for cycle in (4e-3, 2e-3)]
        # What is left is interpolation: of second order in the period or better, but for the ripple
        # of held set-points, which a servo of first order passes on.
        assert errors[0] < bounds[interpolation], servo
        assert errors[0] / errors[1] > 3, servo


def test_the_inverse_holds_the_ends_and_no_compensation_has_no_advance():
    servo = ac.ServoModel(**gains("second"), dead_time=[0.01, 0.035])
    set_points = ac.compensate(SWING, servo, ac.Inverse(), cycle=0.01)
    assert set_points.start_time == pytest.approx(-0.04)
    assert 0.0 in set_points.t  # the plan begins at a set-point
    t = set_points.t[:, None] + servo.dead_time
    # A set-point is a mean over the interval about its time.
    before = t <= -0.005
    after = t >= DURATION + 0.005
    np.testing.assert_array_equal(set_points.q[before[:, 0], 0], 0.3)
    np.testing.assert_array_equal(set_points.q[before[:, 1], 1], -0.2)
    for j in range(2):
        np.testing.assert_array_equal(set_points.q[after[:, j], j], SWING(DURATION)[j])
    t_inside = t.clip(0, DURATION)
    for j in range(2):
        q, dq, ddq = (SWING(t_inside[:, j], order)[:, j] for order in (0, 1, 2))
        u = q + dq / servo.kp[j] + ddq / (servo.kp[j] * servo.kv[j])
        np.testing.assert_allclose(set_points.q[:, j], u, atol=3e-4)
    assert set_points.t[-2] < DURATION + 0.005 - servo.dead_time.min() <= set_points.t[-1] + 1e-12
    servo = ac.ServoModel(**gains("second"), dead_time=0.05, interpolation="step")
    set_points = ac.compensate(SWING, servo, ac.NoCompensation(), cycle=0.01)
    assert set_points.start_time == 0.0
    np.testing.assert_allclose(set_points.q, SWING(set_points.t.clip(0, DURATION)), atol=1e-14)


def test_pole_placement_also_advances_set_points_by_the_dead_time(arm):
    prompt = ac.ServoModel(**gains("second"))
    for dead, poles in product((0.04, 0.0345, [0.0115, 0.087]), (None, [-75.0, -75.0, -75.0])):
        done = []
        for servo in (prompt, prompt.replace(dead_time=dead)):
            set_points = ac.compensate(SWING, servo, ac.PolePlacement(poles=poles), cycle=1e-3)
            done.append(
                ac.simulate(
                    set_points, ac.ServoPlant(arm, servo, ac.Limits.only()), resolution=1e-3
                )
            )
        first, second = (x.q[np.searchsorted(x.t, 0.0) :][:600] for x in done)
        np.testing.assert_allclose(first, second, atol=1e-6)


def test_the_inverse_of_a_first_order_servo_has_the_closed_form():
    servo = ac.ServoModel(kp=[25.0, 40.0], order="first")
    set_points = ac.compensate(SWING, servo, ac.Inverse(), cycle=2.5e-3)
    inside = (set_points.t > 0.035) & (set_points.t < DURATION - 0.035)
    t = set_points.t[inside]
    u, bend = (SWING(t, k) + SWING(t, k + 1) / servo.kp for k in (0, 2))
    # Lines between points of a curve deviate from it by u'' T² / 12 on average.
    expected = u - bend * 2.5e-3**2 / 12
    np.testing.assert_allclose(set_points.q[inside], expected, atol=3e-7)
    assert np.abs(set_points.q[inside] - u).max() > 5e-6
