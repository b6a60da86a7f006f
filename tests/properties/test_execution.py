"""The servo plant comes to an end, whatever it is taught: also on the very edge of saturation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.motion import LapLaw

LIMIT = 0.72


def still(q=(0.0, 0.0)):
    rest = np.zeros((1, 2))
    law = LapLaw(breaks=np.array([0.0, 1.0]), q=np.array([q, q]), dq=rest, ddq=rest)
    return ac.Trajectory(laws=(law,), method="hand")


def run(arm, q, period, kp, kv, limit, interpolation="linear"):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    taught = ac.TaughtData(period=period, q=q, trajectory=still(), method="x")
    plant = ac.ServoPlant(arm, servo, ac.Limits(joint_acceleration=limit))
    done = ac.execute(taught, plant, resolution=period)
    np.testing.assert_allclose(done.q[-1], taught.q[-1], atol=1e-8)
    np.testing.assert_allclose(done.dq[-1], 0, atol=1e-8)
    assert (done.saturated_time <= done.t[-1] * (1 + 1e-9)).all()
    assert np.isfinite(done.peak_demand).all()
    # No joint ever moves faster than the limit lets it.
    assert (np.abs(np.diff(done.dq, axis=0)) <= limit * period * (1 + 1e-9)).all()
    return done


gains = st.floats(1.0, 200.0)
periods = st.sampled_from([1e-4, 1e-3, 4e-3, 0.03, 0.2])


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-1e-3, 1e-3)), min_size=1, max_size=12),
    periods,
    gains,
    gains,
    st.sampled_from(["linear", "step"]),
)
def test_any_set_points_come_to_rest(arm, q, period, kp, kv, interpolation):
    kv = max(kv, kp / 10)  # hardly damped servos do settle, but take their time
    run(arm, np.array(q), period, kp, kv, 5.0, interpolation)


@given(
    st.lists(st.sampled_from([-1, 0, 1]), min_size=2, max_size=10),
    periods,
    st.sampled_from([10.0, 25.0, 37.5, 60.0]),
    st.sampled_from([40.0, 100.0, 150.0]),
    st.sampled_from([1.0, 1 - 1e-15, 1 + 1e-15, 1 - 1e-12, 1 + 1e-12, 1 + 1e-9, 1 - 1e-9]),
)
def test_steps_to_the_very_limit(arm, signs, period, kp, kv, share):
    # A held step of limit / (K_p K_v) makes the demand start exactly at the limit.
    q = np.cumsum(signs) * LIMIT / (kp * kv) * share
    run(arm, np.stack([q, -q], axis=1), period, kp, kv, LIMIT, "step")


@given(
    st.lists(st.sampled_from([-1, 0, 1]), min_size=1, max_size=6),
    st.sampled_from([1e-4, 1e-3, 4e-3]),
    st.sampled_from([1.0, 1 - 1e-15, 1 + 1e-15, 1 - 1e-12, 1 + 1e-12, 1 + 1e-9]),
    st.sampled_from([(25.0, 150.0), (25.0, 100.0), (60.0, 40.0)]),
    st.floats(0.003, 0.2),
)
def test_plans_at_the_very_limit(arm, signs, period, share, gain, lap):
    # The exact inverse of laps at full acceleration keeps the demand at the limit, lap after lap.
    kp, kv = gain
    h, a = np.full(len(signs), lap), np.array(signs) * LIMIT * share
    dq = np.concatenate([[0.0], np.cumsum(a * h)])
    q = np.concatenate([[0.0], np.cumsum(dq[:-1] * h + a * h**2 / 2)])
    law = LapLaw(
        breaks=np.concatenate([[0.0], np.cumsum(h)]),
        q=np.stack([q, -q], axis=1),
        dq=np.stack([dq, -dq], axis=1)[:-1],
        ddq=np.stack([a, -a], axis=1),
    )
    servo = ac.ServoModel(kp=kp, kv=kv)
    planned = ac.Trajectory(laws=(law,), method="hand")
    taught = ac.compensate(planned, servo, method="inverse", period=period)
    done = run(arm, taught.q, period, kp, kv, LIMIT)
    np.testing.assert_allclose(done.q[:, 0], -done.q[:, 1], atol=1e-9)  # the two mirror each other


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-1e-3, 1e-3)), min_size=2, max_size=12),
    st.sampled_from([1e-3, 4e-3, 0.03]),
    st.sampled_from([(25.0, 150.0), (25.0, 100.0), (60.0, 40.0)]),
    st.sampled_from([0.0, 1e-16, 3e-16, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3]),
    st.sampled_from(["linear", "step"]),
)
def test_a_limit_that_the_demand_just_touches(arm, q, period, gain, below, interpolation):
    # The demand's largest value without a limit, taken as the limit: it touches and turns round.
    kp, kv = gain
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    taught = ac.TaughtData(period=period, q=np.array(q), trajectory=still(), method="x")
    free = ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=period)
    limit = np.maximum(free.peak_demand * (1 - below), 0.1)
    run(arm, np.array(q), period, kp, kv, limit, interpolation)
