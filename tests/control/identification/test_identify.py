"""Servo identification: parameters, intervals, selection, and written files."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from soak.identification import LIMIT, NOISE, commands, move, multisine

import armcontour as ac
from armcontour.control.identification import Log, identify
from armcontour.core.errors import InvalidInput
from armcontour.files.limits_and_servo_files import servo_yaml
from armcontour.files.log_file import read_log
from armcontour.robot.servo.simulation import JointServo, LoggedCommand, follow

KR300 = Path(__file__).parent / "kuka_kr300"
FIRST, SECOND = (ac.ServoFit(model=x) for x in ("first", "second"))
TRUTH = {"kp": 25.0, "kv": 150.0, "delay": 12.3e-3}
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


def log_of(seed, noise=2e-5, seconds=6.0, t=None, u=None, **servo):
    """A log of one simulated joint with white noise."""
    if t is None:
        t, u = shaken(seconds, 4e-3, seed)
    y = move(t, u, steps=20, **servo)
    y = y + np.random.default_rng(seed + 100).normal(0, noise, len(t))
    return Log(t=t, command=u, measured=y, source=f"{seed}.csv")


def assert_near(joint, truth):
    names = {"delay": "dead_time", "feed": "velocity_feedforward", "limit": "acceleration_limit"}
    for name, value in truth.items():
        x = getattr(joint, names.get(name, name))
        assert abs(x.value - value) < 4.5 * x.sd, name
        assert x.determined, name


@pytest.fixture(scope="module")
def fed():
    return identify([log_of(k, **FED) for k in range(2)])


def test_a_multisine_determines_gains_and_noise():
    t = np.arange(3000) * 1e-3
    log = log_of(1, NOISE, t=t, u=2e-2 * multisine(t, 25.0, 1), **TRUTH)
    (joint,) = identify(log).joints
    assert joint.order == "second" and math.isnan(joint.velocity_feedforward.value)
    assert_near(joint, TRUTH)
    assert joint.noise == pytest.approx(NOISE, rel=0.1)


def test_feed_forward_and_limit_are_identified_together():
    t = np.arange(3000) * 2e-3
    truth = {"kp": 28.0, "kv": 160.0, "delay": 6e-3, "feed": 0.9, "limit": 12.0}
    u = 4e-3 * multisine(t, 20.0, 3)
    (joint,) = identify(log_of(3, 1e-5, t=t, u=u, **truth)).joints
    assert joint.order == "second"
    assert_near(joint, truth)


def test_the_reported_errors_are_those_of_the_written_servo(fed):
    """The figures of the result are those of the servo with the digits of the file."""
    joint = fed.joints[0]
    log = fed.logs[1]
    predictions = [fed.predict(x) for x in fed.logs]
    rms = math.sqrt(np.mean([x.rms[0] ** 2 for x in predictions]))
    assert joint.rms == pytest.approx(rms, rel=1e-3)
    assert joint.largest == pytest.approx(max(x.largest[0] for x in predictions), rel=1e-9)
    # The same motion with the servo plant, about its mean.
    servo = fed.servo_model()
    arm = ac.load_arm("pmk3s")
    both = ac.ServoModel(
        kp=servo.kp[0], kv=servo.kv[0], dead_time=servo.dead_time[0],
        velocity_feedforward=servo.velocity_feedforward[0], acceleration_limit=math.inf,
    )  # fmt: skip
    q = np.tile(log.command, 2)
    rest = ac.Trajectory(laws=(ac.dwell_law(q[0], log.t[-1]),), method="rest")
    set_points = ac.SetPoints(cycle=4e-3, q=q, trajectory=rest, method="none")
    execution = ac.simulate(set_points, ac.ServoPlant(arm, both, ac.Limits()))
    moved = np.interp(log.t, execution.t, execution.q[:, 0])
    some = predictions[1].used[:, 0]
    assert np.std((log.measured[:, 0] - moved)[some]) == pytest.approx(
        predictions[1].rms[0], rel=0.01
    )


def test_a_servo_with_a_drive_cycle_is_identified():
    drive_cycle = 4e-3
    u = 5e-3 * multisine(np.arange(2500) * 4e-3, 20.0, 5)
    q = w = 0.0
    y = np.zeros(2500)
    delayed = np.concatenate([[0.0, 0.0], u[:-2]])
    for i in range(2500):
        y[i] = q
        a = 150.0 * (25.0 * (delayed[i] - q) - w)
        q = q + drive_cycle * w + drive_cycle**2 / 2 * a
        w = w + drive_cycle * a
    y += np.random.default_rng(0).normal(0, 1e-5, len(y))
    log = Log(t=np.arange(2500) * drive_cycle, command=u, measured=y)
    fit = identify(log, ac.ServoFit(drive_cycle=drive_cycle))
    assert_near(fit.joints[0], {"kp": 25.0, "kv": 150.0, "delay": 8e-3})
    assert math.isnan(fit.joints[0].velocity_feedforward.value)
    assert fit.servo_model().drive_cycle == drive_cycle
    with pytest.raises(InvalidInput, match="drive_cycle"):
        ac.ServoFit(drive_cycle=0.1)


def test_a_pure_delay_is_identified():
    t, u = shaken(5.0, 4e-3, 3)
    y = np.interp(t - 0.016, t, u) + np.random.default_rng(0).normal(0, 2e-5, len(t))
    servo = identify(Log(t=t, command=u, measured=y)).servo_model()
    assert servo.order == "delay" and servo.kv is None
    assert servo.dead_time[0] == pytest.approx(0.016, abs=2e-4)


def test_held_set_points_are_identified_in_each_model():
    t = np.arange(3000) * 2e-3
    u = 3e-3 * multisine(t, 20.0, 1)
    y = move(t, u, kp=25.0, kv=150.0, linear=False, steps=20)
    log = Log(t=t, command=u, measured=y, interpolation="step")
    fit = identify(log)
    assert fit.interpolation == "step" and fit.joints[0].kv.value == pytest.approx(150, rel=0.02)
    first = identify(log, FIRST).joints[0]
    assert math.isnan(first.kv.value) and first.unseen_rms > 10 * fit.joints[0].unseen_rms
    with pytest.raises(InvalidInput, match="linear"):
        identify(log, ac.ServoFit(interpolation="linear"))


def test_dry_friction_is_identified_if_the_data_support_it():
    t, u = shaken(8.0, 4e-3, 2)
    with_friction = u - 2e-4 * np.tanh(np.gradient(u, t) / 5e-3)
    log = log_of(2, 1e-6, t=t, u=with_friction, kp=25.0, kv=150.0, delay=8e-3)
    log = Log(t=t, command=u, measured=log.measured)
    joint = identify(log).joints[0]
    assert joint.friction.value == pytest.approx(2e-4, rel=0.2)


def test_log_is_split_at_gaps_and_tolerates_lost_samples(fed):
    log = fed.logs[1]
    indices = np.delete(np.arange(len(log.t)), [*range(300, 304), *range(700, 900)])
    cut = Log(t=log.t[indices], command=log.command[indices], measured=log.measured[indices])
    assert len(cut.gaps) == 2
    joint = identify(cut).joints[0]
    assert abs(joint.kp.value - FED["kp"]) < 4.5 * joint.kp.sd
    (rest,) = joint.rests
    assert np.isnan(rest[cut.gaps[1] + 1]) and not np.isnan(rest[cut.gaps[1]])


@pytest.mark.parametrize("held", [2, 3])
def test_repeated_positions_in_a_log_do_not_bias_the_model(held):
    """A log that is sampled faster than its positions are renewed."""
    log = log_of(3, kp=20.0, kv=150.0)
    rows = np.arange(len(log.t)) // held * held
    fit = ac.identify(dataclasses.replace(log, measured=log.measured[rows]))
    joint = fit.joints[0]
    true = ac.identify(log).joints[0]
    assert fit.findings[0].kind == "renewed" and not ac.identify(log).findings
    assert joint.order == true.order
    assert joint.kp.value == pytest.approx(true.kp.value, rel=0.02)


def test_logs_with_different_joints_are_refused(fed):
    one = fed.logs[0]
    other = fed.logs[1]
    renamed = Log(t=other.t, command=other.command, measured=other.measured, joint_names=("x",))
    with pytest.raises(InvalidInput, match="joint_names"):
        identify([one, renamed])
    two = Log(t=one.t, command=np.tile(one.command, 2), measured=np.tile(one.measured, 2))
    with pytest.raises(InvalidInput, match="has 2 joints"):
        fed.predict(two)


def test_a_joint_that_no_model_explains_is_omitted_from_the_file():
    t, u = shaken(3.0, 4e-3, 3)
    y = move(t, u, kp=25.0, kv=150.0, steps=10)
    other = np.cumsum(np.random.default_rng(4).normal(0, 1, len(t)))
    bad = y + 1.5 * np.std(u - y) * (other - other.mean()) / np.std(other)
    fit = identify(Log(t=t, command=np.stack([u, u], 1), measured=np.stack([bad, y], 1)))
    assert [x.written for x in fit.joints] == [False, True]
    assert fit.joints[0].share > 0.3 and "no model" in fit.joints[0].note
    servo = fit.servo_model()
    assert servo.order == ("unknown", "second") and servo.kp[0] == math.inf
    np.testing.assert_allclose(fit.predict(fit.logs[0]).rms[0], fit.joints[0].rms)
    with pytest.raises(InvalidInput, match="servo of no joint"):
        identify(Log(t=t, command=u, measured=bad)).servo_model()


def test_joints_at_rest_or_at_uniform_velocity_have_no_model():
    t = np.arange(1000) * 4e-3
    still = np.random.default_rng(0).normal(0, 1e-5, len(t))
    ramp = 0.1 * t
    log = commands("step", 25.0, 150.0, 12.3e-3, 1)[1][: len(t)]
    command = np.stack([0 * t, log, ramp], 1)
    fit = identify(Log(t=t, command=command, measured=np.stack([still, still, ramp - 4e-3], 1)))
    for joint, words in zip(fit.joints, ("no motion", "is only noise", "uniform"), strict=True):
        assert not joint.written and words in joint.note


def test_joints_that_rest_keep_their_assumed_servo():
    """Of three joints, only the second moves; its servo is judged as if it were alone."""
    t, u = commands("step", 25.0, 150.0, 12.3e-3, 1)
    log = log_of(1, NOISE, t=t, u=u, **TRUTH)
    noise = np.random.default_rng(0).normal(0, 1e-6, (len(t), 2))
    place = np.full(len(t), 0.3)
    command = np.column_stack([place, log.command[:, 0], place])
    measured = np.column_stack([0.3 + noise[:, 0], log.measured[:, 0], 0.3 + noise[:, 1]])
    fit = identify(Log(t=log.t, command=command, measured=measured))
    alone = identify(log)
    assert [x.moves for x in fit.joints] == [False, True, False]
    assert fit.resting == ("joint 1", "joint 3")
    assert fit.moving_trusted is alone.moving_trusted is alone.trusted is True
    assert not fit.trusted
    assumed = ac.ServoModel(kp=[31.0, 32.0, 33.0], kv=[131.0, 132.0, 133.0], ki=[1.0, 2.0, 3.0])
    servo = fit.servo_model(assumed)
    found = alone.servo_model()
    np.testing.assert_allclose(servo.kp, [31.0, np.ravel(found.kp)[0], 33.0], rtol=1e-4)
    np.testing.assert_allclose(servo.kv, [131.0, np.ravel(found.kv)[0], 133.0], rtol=1e-4)
    assert servo.ki[0] == 1.0 and servo.ki[2] == 3.0
    assert servo.order == "second"
    # Without an assumed servo, these joints have no model.
    assert fit.servo_model().order == ("unknown", "second", "unknown")
    # A joint that should move, but does not, is not taken for one that rests.
    stuck = np.column_stack([log.command[:, 0], log.command[:, 0]])
    both = np.column_stack([log.measured[:, 0], 0.3 + noise[:, 0]])
    doubtful = identify(Log(t=log.t, command=stuck, measured=both))
    assert doubtful.resting == () and not doubtful.moving_trusted
    with pytest.raises(InvalidInput):
        fit.servo_model(ac.ServoModel(kp=[1.0, 2.0], kv=100.0))


def test_a_parameter_at_its_bound_is_reported_as_undetermined():
    """KUKA KR300, axes 1 and 2, program A, a multisine (see its LICENSE)."""
    log = read_log(KR300 / "A.csv")
    fit = identify(Log(t=log.t, command=log.command[:, :2], measured=log.measured[:, :2]))
    one, two = fit.joints
    assert one.written and one.share < 0.3
    assert not one.dead_time.determined and math.isnan(one.dead_time.sd)
    # Gravity is not modelled.
    assert not two.written and two.share > 0.5
    other = read_log(KR300 / "B.csv")
    other = Log(t=other.t, command=other.command[:, :2], measured=other.measured[:, :2])
    predicted = fit.predict(other)
    assert predicted.rms[0] < 0.5 * predicted.tracking_rms[0]


def test_the_predicted_tool_positions_have_small_errors(fed):
    log = fed.logs[0]
    both = Log(t=log.t, command=np.tile(log.command, 2), measured=np.tile(log.measured, 2))
    fit = identify(both)
    arm = ac.load_arm("pmk3s")
    errors = fit.predict(both).tool_errors(arm)
    assert 0 < np.sqrt(np.mean(errors**2)) < 1e-4


def test_misread_columns_are_refused(refuses):
    t = np.arange(1500) * 4e-3
    # From place to place; one sine alone would fit a turned sign, with a slow loop that resonates.
    places = np.random.default_rng(5).uniform(-0.3, 0.3, (2, 9))
    u = np.stack([np.interp(t, np.linspace(0.3, 5.5, 9), x) for x in places], axis=1) + [0.5, -1.5]
    q = np.stack([move(t, x, kp=25.0, kv=150.0, delay=10e-3) for x in u.T], axis=1)
    q += 2e-5 * np.random.default_rng(1).normal(size=q.shape)
    for measured in (q[:, ::-1], q * [1, -1], q * [-1, 1]):
        log = Log(t=t, command=u, measured=measured, source="log.csv")
        refuses(lambda log=log: identify(log), InvalidInput, "order and the signs")
    late = Log(t=t * 1e-3, command=u, measured=q, source="log.csv")  # seconds labelled ms
    refuses(lambda: identify(late), InvalidInput, "4e-06 s, so the log lasts 0.006 s")
    fast = Log(t=t / 40, command=20 * u, measured=20 * q, source="log.csv")
    refuses(lambda: identify(fast), InvalidInput, "no joint is faster than 100 rad/s")


def test_a_saturated_step_response_determines_the_acceleration_limit():
    t, u = commands("large step", 25.0, 150.0, 12.3e-3, 1)
    log = log_of(1, NOISE, t=t[:1500], u=u[:1500], limit=LIMIT, **TRUTH)
    joint = identify(log, SECOND).joints[0]
    assert joint.acceleration_limit.value == pytest.approx(LIMIT, rel=0.01)


def test_a_model_with_a_position_gain_at_its_bound_is_discarded():
    """The time constant of 50 s is longer than the log: only the feed-forward is visible."""
    t, u = shaken(6.0, 4e-3, 1)
    y = follow(LoggedCommand(t, u), JointServo(0.02, velocity_feedforward=0.9), 0.0, 0.0)
    joint = identify(Log(t=t, command=u, measured=y), FIRST).joints[0]
    assert not joint.written and "bounds" in joint.note


CASCADE = JointServo(11.6, 99.9, 0.0, 0.0, 2.25e-3, friction=4.25e-4, ki=5.92)


@pytest.mark.parametrize(
    ("truth", "interval", "drive_cycle"),
    [
        (CASCADE, 4e-3, 0.0),
        # Without the exchange of its gains the fit ends at kp 14.9 and ki 7.6.
        (JointServo(5.83, 82.9, 0.987, 0.0, 9e-3, friction=5.3e-4, ki=16.5), 4e-3, 0.0),
        (CASCADE, 1e-3, 1e-3),
        (JointServo(20.3, 41.7, 0.594, 0.0, 7.6e-4, friction=2e-4, ki=13.3), 4e-3, 1e-3),
        (JointServo(15.0, 150.0, 0.8, 0.0, 5e-3, friction=3e-4, ki=8.0), 4e-3, 8e-3),
    ],
)
def test_an_identified_cascade_predicts_other_programs(truth, interval, drive_cycle):
    logs = []
    for seed in range(3):
        t, u = shaken(6.0, interval, seed)
        y = follow(LoggedCommand(t, u), truth, float(u[0]), 0.0, drive_cycle)
        y += np.random.default_rng(seed + 100).normal(0, 1e-5, len(t))
        logs.append(Log(t=t, command=u, measured=y, source=f"{seed}.csv"))
    fit = identify(logs[:2], ac.ServoFit(drive_cycle=drive_cycle or None))
    joint = fit.joints[0]
    for name in joint.parameters:
        x = getattr(joint, name)
        assert abs(x.value - getattr(truth, name)) < 4.5 * x.sd, name
        assert x.determined, name
    assert joint.ki.value == pytest.approx(truth.ki, rel=0.01)
    assert math.isnan(joint.velocity_feedforward.value) == (truth.velocity_feedforward == 0)
    assert fit.predict(logs[2]).rms[0] < 1.1e-5
    servo = fit.servo_model()
    assert servo.ki[0] == pytest.approx(joint.ki.value, rel=1e-5)
    written = yaml.safe_load(servo_yaml(fit))["servo"]
    assert written["ki"] == [pytest.approx(truth.ki, rel=0.01)] and written["order"] == ["second"]
