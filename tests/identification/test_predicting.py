"""Models are chosen by what they predict of parts of a log that they were not fitted to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from soak.joint import move

import armcontour as ac
from armcontour.identification import Log
from armcontour.io.log_file import read_log

KR300 = Path(__file__).parent / "kuka_kr300"


def shaken(seconds: float, interval: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and commands of a multisine that fades in and out."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds / interval)) * interval
    u = sum(
        0.02 / (1 + f) * np.sin(2 * np.pi * f * t + random.uniform(0, 6.3))
        for f in random.uniform(0.3, 6.0, 12)
    )
    return t, u * np.clip(np.minimum(t, t[-1] - t) / 0.5, 0.0, 1.0)


def log_of(seed: int, noise: float = 2e-5, seconds: float = 10.0, **servo: float) -> Log:
    t, u = shaken(seconds, 4e-3, seed)
    y = move(t, u, steps=20, **servo)
    y = y + np.random.default_rng(seed + 100).normal(0, noise, len(t))
    return Log(t=t, command=u, measured=y)


FED = {"kp": 12.0, "kv": 90.0, "delay": 6e-3, "feed": 0.95}


@pytest.mark.parametrize("seed", range(3))
def test_feed_forward_is_found(seed):
    found = ac.identify(log_of(seed, **FED))
    (joint,) = found.joints
    assert joint.velocity_feedforward is not None
    for x, value in (
        (joint.kp, FED["kp"]),
        (joint.kv, FED["kv"]),
        (joint.velocity_feedforward, FED["feed"]),
    ):
        # Four standard deviations.
        assert abs(x.value - value) <= 4 * x.sd
    servo = found.servo_model()
    assert float(servo.velocity_feedforward[0]) == pytest.approx(FED["feed"], rel=0.05)
    assert joint.explained > 0.99 and joint.predicted_rms < 3e-5


def test_a_servo_without_feed_forward_gets_none():
    found = ac.identify(log_of(0, kp=25.0, kv=150.0, delay=6e-3))
    assert found.joints[0].velocity_feedforward is None
    assert not found.servo_model().has_feedforward


def test_the_identified_servo_moves_as_the_log_does():
    found = ac.identify(log_of(1, **FED))
    predicted = found.predict(log_of(7, noise=0.0, **FED))
    assert predicted.rms[0] < 5e-5 < 0.02 * predicted.tracking_rms[0]
    assert predicted.explained[0] > 0.999


def test_a_drive_that_only_delays():
    t, u = shaken(10.0, 4e-3, 3)
    y = np.interp(t - 0.016, t, u) + np.random.default_rng(0).normal(0, 2e-5, len(t))
    # A slow resonance that no model of a servo has.
    y += 1e-4 * np.sin(2 * np.pi * 1.3 * t)
    found = ac.identify(Log(t=t, command=u, measured=y))
    servo = found.servo_model()
    assert servo.response(2j * np.pi * np.array([0.5, 2.0, 4.0]))[:, 0] == pytest.approx(
        np.exp(-2j * np.pi * np.array([0.5, 2.0, 4.0]) * 0.016), abs=0.03
    )


def test_a_gap_splits_a_log_and_lost_samples_do_not_matter():
    log = log_of(2, **FED)
    lost = np.delete(np.arange(len(log.t)), [500, 501, 502, 503, *range(1200, 1500)])
    cut = Log(t=log.t[lost], command=log.command[lost], measured=log.measured[lost])
    assert len(cut.gaps) == 2
    whole, parts = ac.identify(log).joints[0], ac.identify(cut).joints[0]
    for name in ("kp", "kv", "dead_time"):
        one, other = getattr(whole, name), getattr(parts, name)
        assert abs(one.value - other.value) <= 4 * np.hypot(one.sd, other.sd)
    assert len(parts.t) == len(parts.residuals) == len(parts.simulated)


def test_a_gap_is_refused_where_it_matters():
    log = log_of(2, seconds=4.0, **FED)
    kept = np.r_[0:300, 400:1000]
    cut = Log(t=log.t[kept], command=log.command[kept], measured=log.measured[kept])
    with pytest.raises(ac.InvalidInput, match=r"gap of 0.404 s at t = 1.196 s"):
        cut.refuse_gaps()


def test_logs_are_joined():
    logs = [log_of(k, seconds=4.0, **FED) for k in range(3)]
    one, three = ac.identify(logs[0]), ac.identify(logs)
    assert three.joints[0].kp.sd < one.joints[0].kp.sd
    assert three.joints[0].kp.value == pytest.approx(FED["kp"], rel=0.05)
    other = Log(t=logs[0].t, command=logs[0].command, measured=logs[0].measured, joint_names=("x",))
    with pytest.raises(ac.InvalidInput, match="joint_names"):
        ac.identify([logs[0], other])


def test_what_does_not_follow_gets_no_servo():
    t, u = shaken(10.0, 4e-3, 3)
    # Half of the tracking error comes from elsewhere.
    y = move(t, u, kp=25.0, kv=150.0, steps=10)
    other = np.cumsum(np.random.default_rng(4).normal(0, 1, len(t)))
    y = y + 1.5 * np.std(u - y) * (other - other.mean()) / np.std(other)
    found = ac.identify(Log(t=t, command=u, measured=y))
    assert found.joints[0].explained < 0.5
    with pytest.raises(ac.InvalidInput, match="50% are needed"):
        found.servo_model()


def test_a_real_robot_is_predicted():
    """KUKA KR300, axes 1 to 3: program B from program A, both multisines (see its LICENSE).

    Bounds are RMS errors about the mean that were found, in mrad, and 20 % more.
    """
    a, b = (read_log(KR300 / f"{x}.csv") for x in "AB")
    found = ac.identify([_axes(a), _axes(b)])
    for log, bounds in ((a, (0.7, 2.4, 1.8)), (b, (0.5, 2.0, 2.2))):
        predicted = found.predict(_axes(log))
        assert (predicted.rms * 1e3 < bounds).all()
        assert (predicted.explained[[0, 2]] > 0.6).all()
    # Nothing is called determined while another parameter is at the edge of the search.
    for joint in found.joints:
        assert not any(x.determined for x in joint.estimates)


def _axes(log: Log) -> Log:
    """The first three axes of a log."""
    return Log(t=log.t, command=log.command[:, :3], measured=log.measured[:, :3], source=log.source)
