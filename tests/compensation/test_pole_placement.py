"""The paper's compensator (26), sign mended, against SciPy and what docs/method.md proves."""

from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy import integrate, signal

import armcontour as ac
from armcontour.compensation.pole_placement import default_poles

from .motions import laps

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
place = partial(ac.compensate, method="pole_placement")


def test_set_points_are_26_applied_to_the_trajectory():
    # Straight pieces between multiples of the period: SciPy's first-order hold is exact for them.
    velocities = np.random.default_rng(1).normal(size=(3, 2))
    start = np.array([0.4, -1.1])
    motion = laps([0.0, 0.04, 0.1, 0.2], velocities, np.zeros((3, 2)), start)
    for poles, period in product(POLES, (4e-3, 1e-3)):
        taught = place(motion, UNEVEN, period=period, poles=poles)
        at = taught.t[:-1]  # the last one is the end itself
        for j in range(2):
            system = compensator_26(UNEVEN.kp[j], UNEVEN.kv[j], *poles)
            source = motion(at.clip(0, 0.2))[:, j] - start[j]
            _, expected, _ = signal.lsim(system, source, at)
            near = 1e-9 * max(np.abs(expected).max(), 1.0)
            q = taught.q[:-1, j] - start[j]
            np.testing.assert_allclose(q, expected, atol=near, err_msg=f"{poles}, {period}")


def test_poles_per_joint():
    motion = laps([0.0, 0.2], [(1.0, 1.0)], [(0.0, 0.0)], (0.0, 0.0))
    poles = [POLES[0], POLES[2]]
    both = place(motion, UNEVEN, period=0.01, poles=poles)
    for j in range(2):
        one = place(motion, UNEVEN, period=0.01, poles=poles[j])
        n = min(len(one.q), len(both.q)) - 1
        np.testing.assert_allclose(both.q[:n, j], one.q[:n, j], atol=1e-12)


def test_a_curved_motion_too():
    # Parabolas: SciPy converges to the set-points as its grid gets finer.
    motion = laps([0.0, 0.1, 0.2], [(0.0, 0.2), (0.3, 0.0)], [(3.0, -2.0), (-3.0, 1.0)], (0.0, 0.0))
    taught = place(motion, UNEVEN, period=0.01, poles=[-75] * 3)
    system, errors = compensator_26(25.0, 150.0, -75, -75, -75), []
    for parts in (10, 100):
        t = np.arange(20 * parts + 1) * (0.01 / parts)
        _, expected, _ = signal.lsim(system, motion(t.clip(0, 0.2))[:, 0], t)
        errors.append(np.abs(expected[::parts] - taught.q[:21, 0])[:20].max())
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.2)
    assert errors[1] < 1e-6


def test_between_set_points_nothing_is_lost():
    times, dq = [0.0, 0.0137, 0.1011, 0.2], [(0.0, 0.2), (0.3, 0.0), (1.0, 1.0)]
    motion = laps(times, dq, np.ones((3, 2)), (0, 0))
    coarse, fine = (place(motion, UNEVEN, period=x) for x in (0.05, 0.001))
    n = len(coarse.q) - 1
    np.testing.assert_allclose(coarse.q[:n], fine.q[: 50 * n : 50], atol=1e-12)
    # DC gain 1: before the last set-point is put there, it is there already.
    motion = laps([0.0, 0.2], [(1.0, -2.0)], [(0.0, 0.0)], (0.5, 0.5))
    taught = place(motion, UNEVEN, period=0.01)
    np.testing.assert_allclose(taught.q[-2], motion(0.2), atol=1e-12)
    np.testing.assert_array_equal(taught.q[-1], motion(0.2))


def test_default_poles_cancel_the_zero():
    placed = default_poles(UNEVEN.for_joints(2))
    np.testing.assert_array_equal(placed, [[-150, -150, -150], [-150, -150, -300]])
    for kv, (m1, m2, g) in zip(UNEVEN.kv, placed, strict=True):
        x = (kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g
        # F G = (X s - m1 m2 g) / ((s - m1)(s - m2)(s - g)) = 150² / (s + 150)² on every joint.
        s = np.array([1j, 30j, 500j])
        together = (x * s - m1 * m2 * g) / ((s - m1) * (s - m2) * (s - g))
        np.testing.assert_allclose(together, 150**2 / (s + 150) ** 2, rtol=1e-12)


def test_by_default_all_joints_trail_alike(arm):
    alike = laps([0.0, 0.2, 0.4], [(1.0, 1.0), (-1.0, -1.0)], np.zeros((2, 2)), (0.0, 0.0))
    plant = ac.ServoPlant(arm, UNEVEN, ac.Limits())
    gap = {}
    for method in ("pole_placement", "none"):
        taught = ac.compensate(alike, UNEVEN, method=method, period=2e-4)
        done = ac.execute(taught, plant, resolution=2e-4)
        gap[method] = np.abs(np.diff(done.q, axis=1)).max()
    assert gap["pole_placement"] < 1e-4 < 1e-2 < gap["none"]


def demand_over_acceleration(arm, poles, accelerations, times, kv=150.0):
    """Largest demand of an unsaturated servo, as a share of the plan's largest acceleration."""
    servo = ac.ServoModel(kp=25.0, kv=kv)
    a = np.asarray(accelerations, float)
    h = np.diff(times)
    dq = np.concatenate([[0.0], np.cumsum(a * h)[:-1]])
    both = np.stack([dq, dq], axis=1), np.stack([a, a], axis=1)
    motion = laps(times, *both, (0.0, 0.0))
    taught = place(motion, servo, period=2e-4, poles=poles)
    # Up to the end of the motion only: there the velocity jumps to zero.
    kept = round(times[-1] / 2e-4) + 1
    cut = ac.TaughtData(period=2e-4, q=taught.q[:kept], trajectory=motion, method="cut")
    done = ac.execute(cut, ac.ServoPlant(arm, servo, ac.Limits()), resolution=2e-4)
    return np.abs(done.demand[:kept]).max() / np.abs(a).max()


def test_l1_norm_of_the_triple_pole_at_minus_50(arm):
    # Impulse response of F G at K_v = 150: (7500 t - 125000 t²) exp(-50 t), negative from 0.06 s.
    def response(t):
        return (7500 * t - 125000 * t**2) * np.exp(-50 * t)

    norm = sum(abs(integrate.quad(response, *ab)[0]) for ab in ((0, 0.06), (0.06, 1.0)))
    assert norm == pytest.approx(1.498, abs=5e-4)  # docs/method.md
    # The worst plan turns its full acceleration round just when the response changes its sign.
    worst = demand_over_acceleration(arm, [-50] * 3, [-1.0, 1.0], [0.0, 0.6, 0.66])
    assert worst == pytest.approx(norm, rel=2e-3)


def test_no_headroom_is_needed_for_triple_poles_from_half_kv_to_kv(arm):
    # The response (X t + (p³ - p X) t² / 2) exp(-p t) changes sign at t0, if at all.
    kv = 150.0
    for pole in (60, 65, 75, 100, 150, 250, 300):
        x = kv**2 - 3 * kv * pole + 3 * pole**2
        bend = (pole**3 - pole * x) / 2
        if 75 <= pole <= 150:
            switches = np.cumsum(np.random.default_rng(pole).uniform(0.01, 0.05, 20))
            times = np.round(np.concatenate([[0.0], switches]) / 2e-4) * 2e-4
            signs = np.where(np.arange(20) % 2, 1.0, -1.0)
            assert demand_over_acceleration(arm, [-pole] * 3, signs, times) <= 1 + 1e-3, pole
        else:
            turn = round(-x / bend / 2e-4) * 2e-4
            assert turn > 0
            times = [0.0, 0.6, 0.6 + turn]
            assert demand_over_acceleration(arm, [-pole] * 3, [-1.0, 1.0], times) > 1 + 2e-3, pole


def test_velocity_error_vanishes_when_the_poles_sum_to_minus_kv(arm, servo):
    ramp = laps([0.0, 1.0], [(1.0, 1.0)], [(0.0, 0.0)], (0.0, 0.0))
    for poles, vanishes in (([-50] * 3, True), ([-30, -50, -70], True), ([-75] * 3, False)):
        taught = place(ramp, servo, period=1e-3, poles=poles)
        done = ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=1e-3)
        lag = 0.99 - done.q[990, 0]
        m1, m2, g = poles
        # Coefficient with which velocity enters the error, from F G at low frequency.
        assert abs(lag - 150 * (150 + g + m1 + m2) / (g * m1 * m2)) < 1e-5
        assert (abs(lag) < 1e-5) == vanishes, poles


def test_poles_that_cannot_be_are_refused(refuses):
    motion = laps([0.0, 0.2], [(1.0, 1.0)], [(0.0, 0.0)], (0.0, 0.0))
    for poles, words, joint in (
        ([-1, -1, 0], "negative real parts", 1),
        ([[-1, -1, -1], [-1, 2, -1]], "without bound", 2),
        ([1 + 1j, 1 - 1j, -1], "negative real parts", 1),
        ([-1, -1], "2 rows of three", None),
        ([[-1, -1, -1]] * 3, "three finite numbers", None),
        ([-1, -1, np.nan], "finite", None),
        ([-1 + 1j, -1 + 1j, -1], "complex conjugates", None),
        ([-1 + 1j, -1, -1], "complex conjugates", None),
        ([-1, -1 + 1j, -1 - 1j], "observer pole real", None),
        ("fast", "three finite numbers", None),
    ):
        kind = ac.CompensationError if joint else ac.InvalidInput
        refuses(partial(place, motion, UNEVEN, poles=poles), kind, words, joint=joint)
