"""Estimates against what was simulated, and what is said where a log cannot tell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from soak.encoders import FRICTION, estimate, simulate
from soak.identify import NOISE, bound, case, commands, judge, multisine
from soak.joint import move

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.identification import Identification, Log, identify

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def _measured(q, seed=0):
    return q + NOISE * np.random.default_rng(seed).normal(size=np.shape(q))


def _sine(seconds=6.0, highest=25.0, size=3e-3):
    t = np.arange(int(seconds * 1000)) * 1e-3
    return t, size * multisine(t, highest, 1)


def _one(t, u, y, **options):
    return identify(Log(t=t, command=u, measured=y, set_points=True), **options).joints[0]


@pytest.fixture(scope="module")
def usual():
    t, u = _sine()
    return t, u, move(t, u, **TRUTH)


@pytest.fixture(scope="module")
def short(usual):
    """As much of it as shows that something is odd."""
    return tuple(x[:2000] for x in usual)


@pytest.mark.parametrize(
    ("kp", "kv", "delay"),
    [(25.0, 150.0, 12.3e-3), (10.0, 60.0, 0.0), (60.0, 300.0, 100e-3), (60.0, 60.0, 4.4e-3)],
)
def test_the_reference_log_is_told_as_well_as_its_bound_allows(kp, kv, delay):
    # The seeds are the first ones; `python -m soak.identify` has the full bar.
    result = case("multisine", kp, kv, delay, range(4), samples=15_000)
    for row in judge(result)[:3]:
        errors = np.abs(row["errors"])
        # Of four estimates chance passes by either once in ten thousand.
        assert errors.max() < 4.5
        assert row["spread"] < 2.4
        assert row["determined"] == 1
    assert all(x[3][3] is False for x in result["found"])


@pytest.mark.parametrize("kind", ["saturating", "large step"])
def test_a_log_that_saturates_tells_the_limit(kind):
    result = case(kind, 25.0, 150.0, 12.3e-3, range(3))
    for row in judge(result):
        assert np.abs(row["errors"]).max() < 4.5
        assert row["determined"] == 1


def test_without_noise_the_parameters_are_exact(usual):
    joint = _one(*usual)
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert x.value == pytest.approx(expected, rel=1e-6)
    assert joint.r_squared == pytest.approx(1.0, abs=1e-12)


def test_the_standard_deviation_is_the_bound(usual):
    t, u, q = usual
    joint = _one(t, u, _measured(q))
    expected = bound(t, u, *TRUTH.values(), math.inf)
    for x, sd in zip(joint.estimates[:3], expected[:3], strict=True):
        assert x.sd == pytest.approx(sd, rel=0.1)
    assert joint.white
    assert joint.noise == pytest.approx(NOISE, rel=0.05)


def test_a_step_tells_the_position_loop_but_hardly_the_velocity_loop():
    t, u = commands("step", 25.0, 150.0, 12.3e-3, 1)
    joint = _one(t, u, _measured(move(t, u, **TRUTH)))
    assert joint.kp.determined
    assert joint.kp.low < 25 < joint.kp.high
    assert not joint.kv.determined
    assert joint.kv.low < 150 < joint.kv.high
    assert "multisine" in joint.kv.advice
    assert not joint.acceleration.determined
    assert "step" in joint.acceleration.advice


def test_a_slow_ramp_tells_the_lag_only():
    t = np.arange(3000) * 1e-3
    u = 0.02 * t
    found = identify(Log(t=t, command=u, measured=_measured(move(t, u, **TRUTH))))
    (joint,) = found.joints
    assert not joint.kv.determined
    assert not joint.dead_time.determined
    assert not found.determined
    with pytest.raises(InvalidInput, match="does not determine"):
        found.servo_model()


@pytest.mark.parametrize("start", [137, 1733])
def test_a_log_that_begins_in_motion(usual, start):
    t, u, q = usual
    some = slice(start, start + 3000)
    joint = _one(t[some], u[some], _measured(q)[some])
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert abs(x.value - expected) < 4.5 * x.sd


def test_a_step_in_the_first_sample_of_a_joint_at_rest():
    t = np.arange(1500) * 1e-3
    u = np.full(1500, 0.05)
    q = move(t, u, **TRUTH, before=0.0, limit=20.0, steps=300)
    joint = _one(t, u, _measured(q))
    assert joint.start == "rest"
    for x, expected in zip(joint.estimates, (*TRUTH.values(), 20.0), strict=True):
        assert abs(x.value - expected) < 4.5 * x.sd
        assert x.determined


def test_set_points_that_are_held():
    t, u = _sine()
    q = move(t, u, kp=25.0, kv=150.0, linear=False, steps=20)
    held = _one(t, u, _measured(q), interpolation="step")
    assert abs(held.dead_time.value) < 4.5 * held.dead_time.sd
    taken_for_lines = _one(t, u, _measured(q))
    # Held set-points come half an interval later than the lines through them.
    assert taken_for_lines.dead_time.value == pytest.approx(0.5e-3, abs=5 * held.dead_time.sd)


def test_times_that_are_not_uniform(usual):
    t0, u0, _ = usual
    t = np.cumsum(np.random.default_rng(2).uniform(0.5e-3, 1.5e-3, 5000))
    u = np.interp(t, t0, u0)
    joint = _one(t, u, _measured(move(t, u, **TRUTH, steps=30)))
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert abs(x.value - expected) < 4.5 * x.sd


def test_an_encoder_with_another_zero(usual):
    t, u, q = usual
    joint = _one(t, u, _measured(q) + 0.01)
    assert any("stands off the commands by 0.0" in x for x in joint.notes)
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert abs(x.value - expected) < 4.5 * x.sd


def test_noise_that_is_not_white_is_seen_and_widens_the_intervals(usual):
    t, u, q = usual
    white = _one(t, u, _measured(q))
    rng = np.random.default_rng(4)
    slow = np.convolve(NOISE * rng.normal(size=len(t)), np.ones(30) / np.sqrt(30), "same")
    joint = _one(t, u, q + slow)
    assert not joint.white
    assert any("not white" in x for x in joint.notes)
    assert joint.kp.sd > 2 * white.kp.sd
    assert abs(joint.kp.value - 25) < 4.5 * joint.kp.sd


def test_a_lag_is_taken_where_the_velocity_loop_is_surely_too_fast():
    t = np.arange(6000) * 1e-3
    u = np.where(t > 0.3, 0.01, 0.0)
    q = move(t, u, kp=30.0, kv=2e4, delay=0.02, steps=100)
    joint = _one(t, u, _measured(q))
    assert joint.order == "first"
    assert set(joint.bic) == {"second", "first"}
    assert joint.bic["first"] < joint.bic["second"]
    assert abs(joint.kp.value - 30) < 4.5 * joint.kp.sd
    assert math.isnan(joint.kv.value)
    forced = _one(t, u, _measured(q), model="second")
    assert forced.order == "second"
    assert forced.kv.high == math.inf
    assert not forced.kv.determined


def test_the_papers_job_tells_the_position_loop_roughly(mac, arm, servo):
    taught = ac.compensate(mac, servo, period=4e-3)
    done = ac.execute(taught, ac.ServoPlant(arm, servo), resolution=4e-3)
    command = np.vstack([taught.q, np.tile(taught.q[-1], (len(done.t) - len(taught.q), 1))])
    found = identify(Log(t=done.t, command=command, measured=_measured(done.q)))
    for joint in found.joints:
        # Nearly determined: a smooth motion of six seconds, at 4 ms.
        assert 0.02 < joint.kp.sd / joint.kp.value < 0.2
        assert joint.kp.low < 25 < joint.kp.high
        assert not joint.kv.determined
        assert not joint.acceleration.determined
        assert joint.kv.low < 150 < joint.kv.high


def test_the_servo_model_of_two_joints(usual):
    t, u, q = usual
    other = move(t, u, kp=40.0, kv=100.0, delay=2e-3)
    log = Log(
        t=t,
        command=np.column_stack([u, u]),
        measured=_measured(np.column_stack([q, other])),
        joint_names=("shoulder", "elbow"),
        set_points=True,
    )
    found = identify(log)
    assert isinstance(found, Identification)
    assert found.determined
    servo = found.servo_model()
    np.testing.assert_allclose(servo.kp, [25, 40], rtol=0.02)
    np.testing.assert_allclose(servo.kv, [150, 100], rtol=0.1)
    np.testing.assert_allclose(servo.dead_time, [12.3e-3, 2e-3], atol=1e-3)
    assert servo.order == "second"
    assert found["elbow"] is found[2]
    with pytest.raises(InvalidInput, match="no joint 'wrist'"):
        found["wrist"]


@pytest.mark.parametrize(
    ("command", "measured", "words"),
    [
        (1.0, math.degrees(1), "measured positions look like degrees"),
        (math.degrees(1), 1.0, "but those they belong to like degrees"),
        (1.0, -1.0, "opposite signs"),
    ],
)
def test_columns_that_do_not_fit_together(short, refuses, command, measured, words):
    t, u, q = short
    log = Log(t=t, command=command * u, measured=measured * _measured(q))
    refuses(lambda: identify(log), InvalidInput, "joint 1", words, joint=1)


def test_exchanged_columns(short, refuses):
    t, u, q = short
    log = Log(t=t, command=_measured(q), measured=u)
    refuses(lambda: identify(log), InvalidInput, "exchanged", joint=1)


def test_a_joint_that_does_not_move(usual):
    t, u, q = usual
    log = Log(
        t=t,
        command=np.column_stack([u, u, 0 * u]),
        measured=_measured(np.column_stack([q, 0 * q, 0 * q])),
    )
    found = identify(log)
    assert found.joints[0].kp.determined
    for joint, words in zip(found.joints[1:], ("does not move", "not told to move"), strict=True):
        assert not any(x.determined for x in joint.estimates)
        assert words in joint.kp.advice
    assert not found.determined


def test_columns_that_have_nothing_to_do_with_each_other(short):
    t, u, _ = short
    joint = _one(t, u, 3e-3 * multisine(t, 10.0, 7))
    assert not any(x.determined for x in joint.estimates)
    assert any("do the columns belong together" in x for x in joint.notes)


def test_unknown_options(usual, refuses):
    t, u, q = usual
    log = Log(t=t, command=u, measured=q, interpolation="step")
    refuses(lambda: identify(log, model="third"), InvalidInput, "model")
    refuses(lambda: identify(log, interpolation="cubic"), InvalidInput, "interpolation")
    refuses(lambda: identify(log, interpolation="linear"), InvalidInput, "leave one of them out")
    refuses(lambda: identify(log, longest_dead_time=0.0), InvalidInput, "above zero")


@pytest.mark.parametrize("interval", [2e-9, 5e-7, 0.11, 1.0, 1e4])
def test_samples_from_which_no_servo_can_be_told(usual, refuses, interval):
    t, u, q = usual
    log = Log(t=np.arange(len(t)) * interval, command=u, measured=q)
    refuses(lambda: identify(log), InvalidInput, "a sample every", "1e-06 s to 0.1 s", "unit")


@pytest.mark.parametrize("size", [5e-324, 1e-160, 1e-10, 1e-7, 2e3])
def test_motions_of_any_size_end_without_a_warning(size):
    """Below what an encoder can tell nothing is determined; a command that is no joint's is odd."""
    t, u = _sine(seconds=0.4)
    q = move(t, u, **TRUTH)
    tiny = _one(t, u / np.abs(u).max() * size, q)
    assert not tiny.kp.determined
    if size < 1e-9:
        assert not _one(t, u, q / np.abs(q).max() * size).kp.determined


def _cover(excitation, bits, noise, seeds):
    """How many of the 95 % intervals hold the truth, per parameter, and errors over their sd."""
    rows = np.array([estimate((excitation, bits, noise, s))[0] for s in seeds], dtype=float)
    inside = (rows[:, :, 1] <= 0) & (rows[:, :, 2] >= 0)
    return inside.sum(axis=0), np.sqrt(np.mean((rows[:, :, 0] / rows[:, :, 4]) ** 2, axis=0))


@pytest.mark.parametrize(("excitation", "bits"), [("guide", 14), ("repeating", 14)])
def test_intervals_on_a_coarse_encoder(excitation, bits):
    """`python -m soak.encoders` has the full bar; they once held 45 %, with errors of 3.4 sd."""
    covered, spread = _cover(excitation, bits, 0.0, range(3))
    assert covered.sum() >= 7  # of 9
    assert spread.max() < 2.2


def test_an_error_that_repeats_is_not_averaged_away(usual):
    """The same residual in each period is one residual, however often it is seen."""
    t = np.arange(10_000) * 2e-3
    u = 3e-3 * multisine(t, 25.0, 1)
    q = move(t, u, **TRUTH, steps=20)
    rng = np.random.default_rng(3)
    once = NOISE * rng.normal(size=1000)
    always = _one(t, u, q + NOISE * rng.normal(size=len(t)))
    again = _one(t, u, q + np.tile(once, 10))
    assert always.white
    # Ten periods: less known by the root of ten.
    assert again.kp.sd / always.kp.sd == pytest.approx(math.sqrt(10), rel=0.4)
    assert any("repeat" in x for x in again.notes)
    assert not any("repeat" in x for x in always.notes)


def test_friction_is_named_and_leaves_nothing_determined():
    # The joint's limits are scanned too, where residuals are not noise: seconds.
    log, truth = simulate("guide", 16, 5e-5, 0, FRICTION)
    found = identify(log)
    joint = found.joints[0]
    told = next(x for x in joint.notes if "dry friction or stiction of" in x)
    size = float(told.split("stiction of ")[1].split()[0])
    assert size == pytest.approx(FRICTION, rel=0.1)
    for x, value in zip(joint.estimates, truth, strict=False):
        assert not x.determined
        assert "friction" in x.advice
        # What it puts off is what it does.
        assert x.low <= value <= x.high
    # What a job needs is that the motion is predicted, and it is.
    assert joint.explained > 0.99
    assert float(found.servo_model().kp[0]) == pytest.approx(truth[0], rel=0.15)


@pytest.mark.parametrize(("friction", "standstill"), [(0.3, 0.0), (0.3, 100.0), (0.0, 100.0)])
def test_standstill_does_not_hide_friction(friction, standstill):
    """A joint that is shaken for 20 s, and stands still while the others are."""
    truth = {"kp": 20.0, "kv": 72.2, "delay": 11e-3}
    t = np.arange(round((20 + standstill) / 4e-3)) * 4e-3
    shaken = np.minimum(t, 20.0)
    fade = np.clip((20 - shaken) / 0.5, 0.0, 1.0)
    phases = np.random.default_rng(7).uniform(0, 2 * np.pi, 20)
    waves = [
        np.sin(2 * np.pi * f * shaken + p) / (1 + f)
        for f, p in zip(np.linspace(0.1, 5, 20), phases, strict=True)
    ]
    u = 3e-3 * fade * np.sum(waves, axis=0)
    joint = _one(t, u, _measured(move(t, u, **truth, steps=40, friction=friction)))
    assert any("dry friction" in x for x in joint.notes) == (friction > 0)
    for x, value in zip(joint.estimates, truth.values(), strict=False):
        assert x.determined == (friction == 0)
        assert x.low <= value <= x.high


def test_a_little_friction_widens_the_intervals():
    rows, notes = estimate(("guide", 16, 5e-5, 1, 0.1))
    assert any("friction" in x for x in notes)
    assert all(x[3] for x in rows)
    assert all(low <= 0 <= high for _, low, high, _, _ in rows)
