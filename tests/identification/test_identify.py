"""Identification of servos: parameters, intervals, predictions and simulated joints."""

import math
from functools import partial
from itertools import product
from pathlib import Path

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
from armcontour.identification import Identification, Log, _joint, identify
from armcontour.io.log_file import read_log
from armcontour.io.servo_file import identification_json
from armcontour.servo._sensitivity import COLUMNS

TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}


def _measured(q, seed=0):
    return q + NOISE * np.random.default_rng(seed).normal(size=np.shape(q))


def _sine(seconds=3.0, highest=25.0, size=3e-3):
    t = np.arange(int(seconds * 1000)) * 1e-3
    return t, size * multisine(t, highest, 1)


def _one(t, u, y, **options):
    return identify(Log(t=t, command=u, measured=y), **options).joints[0]


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


def test_the_standard_deviation_is_the_bound_and_without_noise_parameters_are_exact(
    short, usual, white
):
    joint = _one(*short)
    for x, expected in zip(joint.estimates, TRUTH.values(), strict=False):
        assert x.value == pytest.approx(expected, rel=1e-6)
    assert joint.r_squared == pytest.approx(1.0, abs=1e-12)
    expected = bound(*usual[:2], *TRUTH.values(), math.inf)
    for x, sd in zip(white.estimates[:3], expected[:3], strict=True):
        assert x.sd == pytest.approx(sd, rel=0.1)
    assert white.notes == () and white.rms == pytest.approx(NOISE, rel=0.05)


def test_a_step_tells_the_position_loop_and_a_slow_ramp_the_lag():
    t, u = commands("step", 25.0, 150.0, 12.3e-3, 1)
    joint = _one(t, u, _measured(move(t, u, **TRUTH)))
    assert joint.kp.determined and joint.kp.low < 25 < joint.kp.high
    assert not joint.kv.determined and joint.kv.low < 150 < joint.kv.high
    assert not joint.acceleration.determined
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
    assert any("offset from the command by 0.0" in x for x in joint.notes)
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
    assert joint.order == "first"
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
    for joint, words in zip(
        found.joints[1:], ("does not move", "No motion is commanded"), strict=True
    ):
        assert not any(x.determined for x in joint.estimates)
        assert words in joint.notes[0]


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
    told = next(x for x in joint.notes if "Dry friction or stiction of" in x)
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


KR300 = Path(__file__).parent / "kuka_kr300"
FED = {"kp": 12.0, "kv": 90.0, "delay": 6e-3, "feed": 0.95}


def shaken(seconds, interval, seed):
    """Times and commands of a multisine that fades in and out."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds / interval)) * interval
    u = sum(
        0.02 / (1 + f) * np.sin(2 * np.pi * f * t + random.uniform(0, 6.3))
        for f in random.uniform(0.3, 6.0, 12)
    )
    return t, u * np.clip(np.minimum(t, t[-1] - t) / 0.5, 0.0, 1.0)


def log_of(seed, noise=2e-5, seconds=10.0, **servo):
    t, u = shaken(seconds, 4e-3, seed)
    y = move(t, u, steps=20, **servo)
    return Log(
        t=t, command=u, measured=y + np.random.default_rng(seed + 100).normal(0, noise, len(t))
    )


def part(log, kept):
    return Log(t=log.t[kept], command=log.command[kept], measured=log.measured[kept])


@pytest.fixture(scope="module")
def found():
    return ac.identify(log_of(1, **FED))


def test_feed_forward_is_found_where_it_is(found):
    (joint,) = found.joints
    estimates = (joint.kp, joint.kv, joint.velocity_feedforward)
    for x, name in zip(estimates, ("kp", "kv", "feed"), strict=True):
        assert abs(x.value - FED[name]) <= 4 * x.sd, name
    servo = found.servo_model()
    assert float(servo.velocity_feedforward[0]) == pytest.approx(FED["feed"], rel=0.05)
    assert joint.explained > 0.99 and joint.predicted_rms < 3e-5
    predicted = found.predict(log_of(7, noise=0.0, **FED))
    assert predicted.rms[0] < 5e-5 < 0.02 * predicted.tracking_rms[0]
    assert predicted.explained[0] > 0.999
    found = ac.identify(log_of(0, kp=25.0, kv=150.0, delay=6e-3))
    assert found.joints[0].velocity_feedforward is None
    assert not found.servo_model().has_feedforward


def test_a_drive_that_only_delays():
    t, u = shaken(5.0, 4e-3, 3)
    y = np.interp(t - 0.016, t, u) + np.random.default_rng(0).normal(0, 2e-5, len(t))
    # A slow resonance that no model of a servo has.
    y += 1e-4 * np.sin(2 * np.pi * 1.3 * t)
    servo = ac.identify(Log(t=t, command=u, measured=y)).servo_model()
    s = 2j * np.pi * np.array([0.5, 2.0, 4.0])
    assert servo.response(s)[:, 0] == pytest.approx(np.exp(-s * 0.016), abs=0.03)


def test_a_gap_splits_a_log_and_lost_samples_do_not_matter(found):
    log = log_of(1, **FED)
    cut = part(log, np.delete(np.arange(len(log.t)), [*range(500, 504), *range(1200, 1500)]))
    assert len(cut.gaps) == 2
    whole, parts = found.joints[0], ac.identify(cut).joints[0]
    for name in ("kp", "kv", "dead_time"):
        one, other = getattr(whole, name), getattr(parts, name)
        assert abs(one.value - other.value) <= 4 * np.hypot(one.sd, other.sd)
    assert len(parts.t) == len(parts.residuals) == len(parts.simulated)
    with pytest.raises(ac.InvalidInput, match=r"gap of 0.404 s at t = 1.196 s"):
        part(log, np.r_[0:300, 400:1000]).refuse_gaps()


def test_logs_are_joined():
    logs = [log_of(k, seconds=4.0, **FED) for k in range(3)]
    one, three = ac.identify(logs[0]), ac.identify(logs)
    assert three.joints[0].kp.sd < one.joints[0].kp.sd
    assert three.joints[0].kp.value == pytest.approx(FED["kp"], rel=0.05)
    other = Log(t=logs[0].t, command=logs[0].command, measured=logs[0].measured, joint_names=("x",))
    with pytest.raises(ac.InvalidInput, match="joint_names"):
        ac.identify([logs[0], other])


def test_what_does_not_follow_gets_no_servo():
    t, u = shaken(3.0, 4e-3, 3)
    # Half of the tracking error comes from elsewhere.
    y = move(t, u, kp=25.0, kv=150.0, steps=10)
    other = np.cumsum(np.random.default_rng(4).normal(0, 1, len(t)))
    y = y + 1.5 * np.std(u - y) * (other - other.mean()) / np.std(other)
    found = ac.identify(Log(t=t, command=u, measured=y))
    assert found.joints[0].explained < 0.5
    with pytest.raises(ac.InvalidInput, match="50% are needed"):
        found.servo_model()


def test_the_first_axis_of_a_real_robot_is_predicted():
    """KUKA KR300, axis 1, programs A and B, both multisines (see its LICENSE).

    Bounds are RMS errors about the mean that were found, in mrad, and 20 % more. tests/slow has the
    other axes.
    """
    logs = [
        Log(t=x.t, command=x.command[:, :1], measured=x.measured[:, :1], source=x.source)
        for x in (read_log(KR300 / "A.csv"), read_log(KR300 / "B.csv"))
    ]
    found = ac.identify(logs)
    for log, most in zip(logs, (0.7, 0.5), strict=True):
        predicted = found.predict(log)
        assert predicted.rms[0] * 1e3 < most and predicted.explained[0] > 0.6
    # Nothing is called determined while another parameter is at the edge of the search.
    assert not any(x.determined for x in found.joints[0].estimates)


def test_misread_logs_are_refused(refuses):
    t = np.arange(1500) * 4e-3
    # From place to place; one sine alone would fit a turned sign, with a slow loop that resonates.
    places = np.random.default_rng(5).uniform(-0.3, 0.3, (2, 9))
    u = np.stack([np.interp(t, np.linspace(0.3, 5.5, 9), x) for x in places], axis=1) + [0.5, -1.5]
    q = np.stack([move(t, x, kp=25.0, kv=150.0, delay=10e-3) for x in u.T], axis=1)
    q += 2e-5 * np.random.default_rng(1).normal(size=q.shape)
    for times, measured, words in (
        (t, q[:, ::-1], "fit the joints in the order joint 2, joint 1"),
        (t, q * [1, -1], "of joint 2 have opposite signs"),
        (t, q * [-1, 1], "of joint 1 have opposite signs"),
        (t * 1e-3, q, "no joint is faster than 100 rad/s"),  # seconds labelled ms
    ):
        log = Log(t=times, command=u, measured=measured, source="log.csv")
        refuses(lambda log=log: identify(log), InvalidInput, words)


def ramp(noise=0.0, digits=9):
    t, rate = np.arange(1001) * 0.004, np.array([0.1, 0.05])
    measured = (t[:, None] - 0.04) * rate
    measured = measured + noise * np.random.default_rng(3).standard_normal(measured.shape)
    command, measured = (np.round(x, digits) for x in (t[:, None] * rate, measured))
    return Log(t=t, command=command, measured=measured, source="ramp.csv")


def test_a_ramp_tells_only_how_late_the_joint_is():
    for log in (ramp(), ramp(1e-5, 6)):
        found = identify(log)
        assert not found.determined
        for joint in found.joints:
            for x in joint.estimates:
                assert not x.determined and math.isnan(x.value)
            assert "lag of 40 ms" in joint.notes[0]
            assert joint.rms < 2e-5
        assert "Infinity" not in identification_json(found)


N = 400
GAINS = ((25.0, 150.0), (10.0, 300.0), (60.0, 60.0), (40.0, 160.0))  # 40, 160: a double pole
NAMES = ("kp", "kv", "delay", "q0", "dq0", "limit", "feed")


def _log(interval, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(N) * interval
    if interval > 5e-3:  # not uniform either
        t[1:] += rng.uniform(-0.3, 0.3, N - 1) * interval
    return t, np.cumsum(rng.normal(size=N)) * 0.01


def _run(t, u, linear, kp, kv, delay, limit, columns=1, q0=None, dq0=0.2, feed=0.0):
    q0 = u[0] + 0.01 if q0 is None else q0
    given = np.array([kp, kv, delay, q0, dq0, limit, feed])
    return _joint.second_order(t, u, linear, 0, len(t), False, given, columns)


def test_positions_are_those_of_fine_steps():
    cases = product(GAINS, ((0.0, 0.0), (0.0123, 1.1), (-0.0007, 0.0)), (True, False))
    for (kp, kv), (delay, feed), linear in cases:
        t, u = _log(1e-3)
        if delay < 0:  # what is commanded after the end is not in the log
            t, u = t[:-2], u[:-2]
        q, _ = _run(t, u, linear, kp, kv, delay, math.inf, feed=feed)
        more = {"delay": delay, "feed": feed, "linear": linear}
        expected = move(t, u, kp=kp, kv=kv, q0=u[0] + 0.01, dq0=0.2, steps=10, **more)
        case = str((kp, kv, delay, feed, linear))
        np.testing.assert_allclose(q[0, :-2], expected[:-2], rtol=0, atol=1e-9, err_msg=case)
    t, u = _log(7e-3)
    q, _ = _run(t, u, True, 25.0, 150.0, 0.0123, math.inf)
    expected = move(t, u, kp=25.0, kv=150.0, delay=0.0123, q0=u[0] + 0.01, dq0=0.2, steps=200)
    np.testing.assert_allclose(q[0], expected, rtol=0, atol=1e-7)
    for (kp, kv), limit, linear in product(GAINS, (20.0, 5.0), (True, False)):
        t, u = _log(1e-3)
        q, seen = _run(t, u, linear, kp, kv, 0.0123, limit)
        more = {"limit": limit, "linear": linear, "q0": u[0] + 0.01, "dq0": 0.2, "steps": 400}
        expected = move(t, u, kp=kp, kv=kv, delay=0.0123, **more)
        case = str((kp, kv, limit, linear))
        np.testing.assert_allclose(q[0], expected, rtol=0, atol=1e-7, err_msg=case)
        assert seen[0] > limit and seen[1] > 0.1, case


def test_derivatives_are_those_of_differences():
    t, u = _log(1e-3)
    steps = (1e-5, 1e-4, 1e-8, 1e-8, 1e-7, 1e-5, 1e-6)
    limits = ((math.inf, 0.0), (20.0, 0.0), (math.inf, 0.9), (2000.0, 1.2))
    for (kp, kv), (limit, feed), linear in product(GAINS, limits, (True, False)):
        base = np.array([kp, kv, 0.0123, u[0] + 0.01, 0.2, limit, feed])
        found, _ = _joint.second_order(t, u, linear, 0, N, False, base, COLUMNS)
        for k, (name, step) in enumerate(zip(NAMES, steps, strict=True)):
            case = str((name, kp, kv, limit, feed, linear))
            if name == "limit" and limit == math.inf:
                assert not found[k + 1].any(), case
                continue
            ends = [
                _joint.second_order(t, u, linear, 0, N, False, base + x, 1)[0][0]
                for x in np.outer((step, -step), np.arange(7) == k)
            ]
            expected = (ends[0] - ends[1]) / (2 * step)
            assert np.abs(found[k + 1] - expected).max() < 1e-5 * np.abs(expected).max(), case


def test_the_lag_is_a_loop_with_an_infinite_velocity_gain():
    t, u = _log(1e-3)
    for feed, linear in product((0.0, 0.9), (True, False)):
        base = np.array([25.0, 0.0, 0.0123, u[0], 0.0, 0.0, feed])
        lag = _joint.first_order(t, u, linear, 0, N, False, base, COLUMNS)
        for kv in (1e5, 1e6):
            loop, _ = _run(t, u, linear, 25.0, kv, 0.0123, math.inf, 1, u[0], 0.0, feed)
            assert np.abs(loop[0] - lag[0]).max() < 200 / kv
        for row, step in ((1, 1e-5), (3, 1e-8), (4, 1e-6), (7, 1e-6)):
            ends = [
                _joint.first_order(t, u, linear, 0, N, False, base + x, 1)[0]
                for x in np.outer((step, -step), np.arange(1, 8) == row)
            ]
            expected = (ends[0] - ends[1]) / (2 * step)
            assert np.abs(lag[row] - expected).max() < 1e-5 * np.abs(expected).max(), row


def test_a_joint_at_rest_stays_until_the_first_set_point_reaches_it():
    t, u = np.arange(N) * 1e-3, np.full(N, 0.1)
    given = np.array([25.0, 150.0, 0.0505, 0.02, 0.0, math.inf, 0.0])
    out, _ = _joint.second_order(t, u, True, 0, N, True, given, COLUMNS)
    assert (out[0, :51] == 0.02).all()
    expected = move(t, u, kp=25.0, kv=150.0, delay=0.0505, before=0.02, steps=20)
    np.testing.assert_allclose(out[0], expected, rtol=0, atol=1e-9)


def test_intervals_beyond_all_time_steps_are_told():
    t, u = np.arange(60) * 1e9, np.linspace(0.0, 1.0, 60)
    _, seen = _run(t, u, True, 25.0, 150.0, 0.0, 1e-30)
    assert np.isnan(seen[0])
