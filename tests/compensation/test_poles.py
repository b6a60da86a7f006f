"""What poles do, and the fastest ones that a plan leaves room for."""

from functools import partial

import numpy as np
import pytest
from scipy import integrate

import armcontour as ac
from armcontour.compensation.poles import extreme_demands, fastest_poles, pole_behaviour

from .motions import laps

SERVO = ac.ServoModel(kp=25.0, kv=150.0)


@pytest.fixture(scope="module")
def plan(traced, arm, limits):
    # With 1.4 % of the acceleration to spare.
    return ac.plan(traced, arm, limits.replace(joint_acceleration=0.71), method="mac", knots=200)


def test_lag_and_demand():
    for poles, lag, demand in (
        ([-50, -50, -50], 0.0, 1.498),
        ([-75, -75, -75], 2 / 75, 1.0),
        ([-150, -150, -150], 2 / 150, 1.0),
        ([-30, -30, -30], -1 / 3, 6.728),
        ([-300, -300, -300], 1 / 240, 1.047),
        ([-800, -800, -150], 2 / 800, 1.0),
    ):
        found = pole_behaviour(SERVO, poles)
        np.testing.assert_allclose(found.lag, lag, atol=1e-12)
        np.testing.assert_allclose(found.demand, demand, rtol=1e-4)
        assert (found.peaking[0] > 1.0001) == (demand > 1), poles


def test_peaking_and_demand_of_complex_poles():
    poles = np.array([-60 + 80j, -60 - 80j, -90])
    found = pole_behaviour(ac.ServoModel(kp=25.0, kv=[150.0, 40.0]), poles)
    m1, m2, g = poles
    for j, kv in enumerate((150.0, 40.0)):
        x = (kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g
        rest = [(x * p - m1 * m2 * g) / np.prod([p - r for r in poles if r != p]) for p in poles]

        def response(t, rest=rest):
            return float(np.real(sum(a * np.exp(p * t) for a, p in zip(rest, poles, strict=True))))

        norm = integrate.quad(lambda t, f=response: abs(f(t)), 0, 0.5, limit=500)[0]
        np.testing.assert_allclose(found.demand[j], norm, rtol=1e-3)
        w = 1j * np.linspace(0, 500, 100001)
        size = np.abs((x * w - m1 * m2 * g) / ((w - m1) * (w - m2) * (w - g)))
        np.testing.assert_allclose(found.peaking[j], size.max(), rtol=1e-4)


def test_demands_are_those_of_the_plant(arm):
    q = np.cumsum(np.random.default_rng(3).normal(size=(40, 2)), axis=0) * 1e-3
    still = laps([0.0, 1.0], np.zeros((1, 2)), np.zeros((1, 2)))
    for interpolation in ("linear", "step", "cubic"):
        servo = ac.ServoModel(kp=[25.0, 60.0], kv=[150.0, 40.0], interpolation=interpolation)
        low, high = extreme_demands(servo.for_joints(2), q, 0.01)
        taught = ac.TaughtData(period=0.01, q=q, trajectory=still, method="x")
        done = ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=1e-5)
        n = np.searchsorted(done.t, 0.39 - 1e-9)
        # A held command jumps, and so does the demand: the plant lists what is before, the other
        # both.
        np.testing.assert_allclose(np.maximum(-low, high), done.peak_demand, rtol=2e-5)
        assert (done.demand[:n].min(axis=0) >= low * (1 + 1e-5)).all()
        assert (done.demand[:n].max(axis=0) <= high * (1 + 1e-5)).all()


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_the_fastest_poles_just_do_not_saturate(arm, plan, interpolation):
    servo = ac.ServoModel(kp=[25.0, 20.0], kv=[150.0, 120.0], interpolation=interpolation)
    poles = fastest_poles(servo, plan, arm.limits)
    p = -poles[0, 0]
    np.testing.assert_array_equal(poles, [[-p, -p, -150.0], [-p, -p, -120.0]])
    assert p > {"linear": 300, "cubic": 100}[interpolation]
    for share, saturates in ((1.0, False), (1.03, True)):
        placed = np.column_stack([share * poles[:, :2], poles[:, 2]])
        taught = ac.compensate(plan, servo, method="pole_placement", poles=placed)
        done = ac.execute(taught, ac.ServoPlant(arm, servo))
        assert (done.peak_demand > 0.72).any() == saturates


def test_they_follow_better_than_the_default(arm, plan, rounded, limits):
    rms = []
    for poles in (None, fastest_poles(SERVO, plan, limits)):
        taught = ac.compensate(plan, SERVO, method="pole_placement", poles=poles)
        done = ac.execute(taught, ac.ServoPlant(arm, SERVO))
        rms.append(ac.evaluate(done, rounded, limits=limits).contour_error.rms)
    assert rms[1] < rms[0] / 5


def test_with_room_to_spare_they_stop_at_the_interval(plan):
    loose = ac.Limits(joint_acceleration=100.0)
    poles = fastest_poles(SERVO, plan, loose, period=0.02)
    np.testing.assert_allclose(poles[:, 0], -20 / 0.02)


def test_refused(mac, arm, refuses):
    # A plan at the limit leaves nothing for the corners of the interpolated command.
    call = partial(fastest_poles, SERVO, mac, arm.limits, period=4e-3)
    data = {"limit": "joint_acceleration", "allowed": 0.72}
    refuses(call, ac.CompensationError, "saturates with any poles", **data)
    call = partial(fastest_poles, SERVO, mac, ac.Limits())
    refuses(call, ac.InvalidInput, "give joint_acceleration")
    first = ac.ServoModel(kp=25.0, order="first")
    for call in (
        partial(fastest_poles, first, mac, arm.limits),
        partial(pole_behaviour, first, [-1, -1, -1]),
        partial(ac.compensate, mac, first, method="pole_placement"),
    ):
        refuses(call, ac.CompensationError, "order second")
