"""Estimates against what was simulated, and what is said where a log cannot tell."""

import math
from functools import partial

import numpy as np
import pytest
from soak.identification import (
    FRICTION,
    NOISE,
    bound,
    case,
    commands,
    move,
    multisine,
    simulate,
)

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.identification import Identification, Log, identify

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def _measured(q, seed=0):
    return q + NOISE * np.random.default_rng(seed).normal(size=np.shape(q))


def _sine(seconds=3.0, highest=25.0, size=3e-3):
    t = np.arange(int(seconds * 1000)) * 1e-3
    return t, size * multisine(t, highest, 1)


def _one(t, u, y, **options):
    return identify(Log(t=t, command=u, measured=y, set_points=True), **options).joints[0]


def _assert_near(joint, *more):
    for x, expected in zip(joint.estimates, (*TRUTH.values(), *more), strict=False):
        assert abs(x.value - expected) < 4.5 * x.sd


@pytest.fixture(scope="module")
def usual():
    t, u = _sine()
    return t, u, move(t, u, **TRUTH)


@pytest.fixture(scope="module")
def white(usual):
    """The joint as identified with white noise."""
    t, u, q = usual
    return _one(t, u, _measured(q))


@pytest.fixture(scope="module")
def short(usual):
    """As much of it as shows that something is odd."""
    return tuple(x[:2000] for x in usual)


# `python -m soak identification` has the full bar.
@pytest.mark.parametrize(
    ("kind", "gains", "seeds", "samples"),
    [
        ("multisine", (25.0, 150.0, 12.3e-3), 2, 6000),
        ("multisine", (60.0, 60.0, 4.4e-3), 2, 6000),
        ("large step", (25.0, 150.0, 12.3e-3), 1, 1500),
    ],
)
def test_logs_are_told_as_well_as_their_bounds_allow(kind, gains, seeds, samples):
    saturates = kind != "multisine"
    for seed in range(seeds):
        joint, truth, sd = case(kind, *gains, seed, samples=samples)
        told = list(zip(joint.estimates, truth, sd, strict=False))[: 4 if saturates else 3]
        assert all(abs(x.value - y) < 4.5 * size and x.determined for x, y, size in told)
        assert joint.acceleration.determined is saturates


def test_without_noise_the_parameters_are_exact(short):
    joint = _one(*short)
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert x.value == pytest.approx(expected, rel=1e-6)
    assert joint.r_squared == pytest.approx(1.0, abs=1e-12)


def test_the_standard_deviation_is_the_bound(usual, white):
    expected = bound(*usual[:2], *TRUTH.values(), math.inf)
    for x, sd in zip(white.estimates[:3], expected[:3], strict=True):
        assert x.sd == pytest.approx(sd, rel=0.1)
    assert white.white
    assert white.noise == pytest.approx(NOISE, rel=0.05)


def test_a_step_tells_the_position_loop_but_hardly_the_velocity_loop():
    t, u = commands("step", 25.0, 150.0, 12.3e-3, 1)
    joint = _one(t, u, _measured(move(t, u, **TRUTH)))
    assert joint.kp.determined and joint.kp.low < 25 < joint.kp.high
    assert not joint.kv.determined and joint.kv.low < 150 < joint.kv.high
    assert not joint.acceleration.determined


def test_a_slow_ramp_tells_the_lag_only():
    t = np.arange(3000) * 1e-3
    u = 0.02 * t
    found = identify(Log(t=t, command=u, measured=_measured(move(t, u, **TRUTH))))
    (joint,) = found.joints
    assert not joint.kv.determined and not joint.dead_time.determined and not found.determined
    with pytest.raises(InvalidInput, match="does not determine"):
        found.servo_model()


def test_logs_that_begin_late_or_without_order(usual):
    t, u, q = usual
    some = slice(137, 2137)  # in motion
    _assert_near(_one(t[some], u[some], _measured(q)[some]))
    joint = _one(t, u, _measured(q) + 0.01)  # an encoder with another zero
    assert any("stands off the commands by 0.0" in x for x in joint.notes)
    _assert_near(joint)
    uneven = np.cumsum(np.random.default_rng(2).uniform(0.5e-3, 1.5e-3, 2500))
    u = np.interp(uneven, t, u)
    _assert_near(_one(uneven, u, _measured(move(uneven, u, **TRUTH, steps=30))))


def test_a_step_in_the_first_sample_of_a_joint_at_rest():
    t = np.arange(1500) * 1e-3
    u = np.full(1500, 0.05)
    joint = _one(t, u, _measured(move(t, u, **TRUTH, before=0.0, limit=20.0, steps=300)))
    assert joint.start == "rest"
    _assert_near(joint, 20.0)
    assert all(x.determined for x in joint.estimates)


def test_set_points_that_are_held(usual):
    t, u, _ = usual
    q = move(t, u, kp=25.0, kv=150.0, linear=False, steps=20)
    held = _one(t, u, _measured(q), interpolation="step")
    assert abs(held.dead_time.value) < 4.5 * held.dead_time.sd
    taken_for_lines = _one(t, u, _measured(q))
    # Held set-points come half an interval later than the lines through them.
    assert taken_for_lines.dead_time.value == pytest.approx(0.5e-3, abs=5 * held.dead_time.sd)


def test_a_lag_is_taken_where_the_velocity_loop_is_surely_too_fast():
    t = np.arange(3000) * 1e-3
    u = np.where(t > 0.3, 0.01, 0.0)
    y = _measured(move(t, u, kp=30.0, kv=2e4, delay=0.02, steps=100))
    joint = _one(t, u, y)
    assert joint.order == "first" and joint.bic["first"] < joint.bic["second"]
    assert abs(joint.kp.value - 30) < 4.5 * joint.kp.sd
    assert math.isnan(joint.kv.value)
    forced = _one(t, u, y, model="second")
    assert forced.order == "second" and forced.kv.high == math.inf and not forced.kv.determined


def test_the_papers_job_tells_the_position_loop_roughly(mac, arm, servo):
    taught = ac.compensate(mac, servo, method="pole_placement", period=4e-3)
    done = ac.execute(taught, ac.ServoPlant(arm, servo), resolution=4e-3)
    command = np.vstack([taught.q, np.tile(taught.q[-1], (len(done.t) - len(taught.q), 1))])
    found = identify(Log(t=done.t, command=command, measured=_measured(done.q)))
    for joint in found.joints:
        # Nearly determined: a smooth motion of six seconds, at 4 ms.
        assert 0.02 < joint.kp.sd / joint.kp.value < 0.2
        assert joint.kp.low < 25 < joint.kp.high and joint.kv.low < 150 < joint.kv.high
        assert not joint.kv.determined and not joint.acceleration.determined


def test_the_servo_model_of_two_joints(usual):
    t, u, q = usual
    other = move(t, u, kp=40.0, kv=100.0, delay=2e-3)
    found = identify(
        Log(
            t=t,
            command=np.column_stack([u, u]),
            measured=_measured(np.column_stack([q, other])),
            joint_names=("shoulder", "elbow"),
            set_points=True,
        )
    )
    assert isinstance(found, Identification) and found.determined
    servo = found.servo_model()
    np.testing.assert_allclose(servo.kp, [25, 40], rtol=0.02)
    np.testing.assert_allclose(servo.kv, [150, 100], rtol=0.1)
    np.testing.assert_allclose(servo.dead_time, [12.3e-3, 2e-3], atol=1e-3)
    assert servo.order == "second"
    assert found["elbow"] is found[2]
    with pytest.raises(InvalidInput, match="no joint 'wrist'"):
        found["wrist"]


def test_columns_and_options_that_do_not_fit_are_refused(short, refuses):
    t, u, q = short
    y = _measured(q)
    for command, measured, words in (
        (u, math.degrees(1) * y, "measured positions look like degrees"),
        (math.degrees(1) * u, y, "but those they belong to like degrees"),
        (u, -y, "opposite signs"),
        (y, u, "exchanged"),
    ):
        log = Log(t=t, command=command, measured=measured)
        refuses(partial(identify, log), InvalidInput, words, joint=1)
    log = Log(t=t, command=u, measured=q, interpolation="step")
    for options, words in (
        ({"model": "third"}, "model"),
        ({"interpolation": "cubic"}, "interpolation"),
        ({"interpolation": "linear"}, "leave one of them out"),
        ({"longest_dead_time": 0.0}, "above zero"),
    ):
        refuses(partial(identify, log, **options), InvalidInput, words)
    for interval in (2e-9, 5e-7, 0.11, 1.0, 1e4):
        log = Log(t=np.arange(len(t)) * interval, command=u, measured=q)
        refuses(partial(identify, log), InvalidInput, "1e-06 s to 0.1 s")


def test_a_joint_that_does_not_move(short):
    t, u, q = short
    command, measured = np.column_stack([u, u, 0 * u]), np.column_stack([q, 0 * q, 0 * q])
    found = identify(Log(t=t, command=command, measured=_measured(measured)))
    assert found.joints[0].kp.determined and not found.determined
    for joint, words in zip(found.joints[1:], ("does not move", "not told to move"), strict=True):
        assert not any(x.determined for x in joint.estimates)
        assert words in joint.kp.advice


def test_motions_of_any_size_end_without_a_warning():
    """Below what an encoder can tell nothing is determined; a command that is no joint's is odd."""
    t, u = _sine(seconds=0.2)
    q = move(t, u, **TRUTH)
    for size in (5e-324, 2e3):
        assert not _one(t, u / np.abs(u).max() * size, q).kp.determined, size
    for size in (5e-324, 1e-160, 1e-10):
        assert not _one(t, u, q / np.abs(q).max() * size).kp.determined, size


def test_friction_is_named_and_leaves_nothing_determined():
    # The joint's limits are scanned too, where residuals are not noise: seconds.
    log, truth = simulate(16, 5e-5, 0, FRICTION)
    found = identify(log.between(0.0, 8.0))
    joint = found.joints[0]
    told = next(x for x in joint.notes if "dry friction or stiction of" in x)
    size = float(told.split("stiction of ")[1].split()[0])
    assert size == pytest.approx(FRICTION, rel=0.1)
    for x, value in zip(joint.estimates, truth, strict=False):
        assert not x.determined
        # What it puts off is what it does.
        assert x.low <= value <= x.high
    # What a job needs is that the motion is predicted, and it is.
    assert joint.explained > 0.99
    assert float(found.servo_model().kp[0]) == pytest.approx(truth[0], rel=0.15)


def test_a_little_friction_widens_the_intervals():
    log, truth = simulate(16, 5e-5, 1, 0.1)
    joint = identify(log).joints[0]
    assert any("friction" in x for x in joint.notes)
    for x, value in zip(joint.estimates, truth, strict=False):
        assert x.determined and x.low <= value <= x.high
