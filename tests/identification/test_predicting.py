"""Models are chosen by what they predict of parts of a log that they were not fitted to."""

from pathlib import Path

import numpy as np
import pytest
from soak.identification import move

import armcontour as ac
from armcontour.identification import Log
from armcontour.io.log_file import read_log

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


def test_feed_forward_is_found(found):
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


def test_a_servo_without_feed_forward_gets_none():
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
    for log, bound in zip(logs, (0.7, 0.5), strict=True):
        predicted = found.predict(log)
        assert predicted.rms[0] * 1e3 < bound and predicted.explained[0] > 0.6
    # Nothing is called determined while another parameter is at the edge of the search.
    assert not any(x.determined for x in found.joints[0].estimates)
