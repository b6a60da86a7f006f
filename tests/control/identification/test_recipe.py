"""Logs of the guide's recipe: time stamps, saturation, exchanged gains, and the error to expect."""

from dataclasses import replace

import numpy as np
import pytest
from soak.expectations import RATIOS, expect, logs
from soak.identification import move, multisine
from soak.loops import Joint, Robot, draw, record

import armcontour as ac

GAINS = {"kp": 20.0, "kv": 120.0, "delay": 0.011}
INTERVAL = 4e-3  # Time between samples [s]
LOST_FRACTION = 0.01  # Fraction of samples that a log has lost


def sample(t, u, times):
    """Log of a joint whose set-points u are at t; its positions are measured at `times`."""
    q = np.interp(times, t, move(t, u, **GAINS, steps=20))
    q += 1e-6 * np.random.default_rng(2).normal(size=len(q))
    return ac.Log(t=times, command=np.interp(times, t, u), measured=q)


def wave(seconds=8.0):
    """Return times [s] and commands [rad] of a multisine on a slow sine."""
    t = np.arange(0.0, seconds, 1e-3)
    return t, 5e-3 * multisine(t, 12.0, 1) * np.clip(t, 0, 1) + 0.2 * np.sin(t)


def test_jittered_time_stamps_of_regular_samples_are_replaced():
    t, u = wave()
    log = sample(t, u, t[::4])
    jitter = 3e-4 * np.random.default_rng(1).normal(size=len(log.t))
    found = ac.identify(replace(log, t=log.t + jitter))
    assert any("jitter" in x for x in found.remarks)
    assert found.joints[0].dead_time.value == pytest.approx(GAINS["delay"], abs=1e-3)
    assert found.trusted


def test_jittered_time_stamps_are_replaced_if_samples_are_lost():
    t, u = wave()
    log = sample(t, u, t[::4])
    jitter = 3e-4 * np.random.default_rng(1).normal(size=len(log.t))
    kept = np.random.default_rng(3).uniform(size=len(log.t)) > LOST_FRACTION
    with_gaps = ac.Log(
        t=(log.t + jitter)[kept], command=log.command[kept], measured=log.measured[kept]
    )
    found = ac.identify(with_gaps)
    assert any("jitter" in x for x in found.remarks)
    assert found.joints[0].dead_time.value == pytest.approx(GAINS["delay"], abs=1e-3)


def test_times_of_irregular_samples_are_kept():
    t, u = wave()
    jitter = 3e-4 * np.random.default_rng(1).normal(size=len(t[::4]))
    times = np.clip(t[::4] + jitter, 0.0, t[-1])
    found = ac.identify(sample(t, u, np.sort(times)))
    assert not any("jitter" in x for x in found.remarks)
    assert found.joints[0].dead_time.value == pytest.approx(GAINS["delay"], abs=1e-3)


def test_regular_times_have_no_note():
    t, u = wave(4.0)
    remarks = ac.identify(sample(t, u, t[::4])).remarks
    assert not any("jitter" in x for x in remarks)


def test_a_multisine_and_a_program_give_an_expectation():
    waves, program = logs(draw(5), 5)
    both = ac.identify([waves, program]).servo_model()
    alone = ac.identify(waves).servo_model()
    rates = np.gradient(program.command, program.t, axis=0)
    changes = np.gradient(rates, program.t, axis=0)
    assert both.is_similar(rates, changes)
    assert not alone.is_similar(rates, changes)
    assert both.program_ratio <= both.contour_ratio


def test_the_expected_error_holds_on_another_program():
    found = expect(draw(3), 3)
    assert RATIOS[0] < found.true / found.expected < RATIOS[1]
    assert not found.kept or found.true <= found.allowed
    # The drives differentiate the command faster than set-points arrive. Effective parameters are
    # not those of the drive, so they have no interval.
    for joint in found.identification.joints:
        assert joint.effective
        assert np.isnan(joint.acceleration_feedforward.low)
        assert np.isnan(joint.velocity_feedforward.low)
        assert np.isnan(joint.dead_time.low)
        assert not joint.acceleration_feedforward.determined


def test_the_expected_error_holds_if_the_log_contains_only_noise():
    found = expect(draw(7), 7)
    assert RATIOS[0] < found.true / found.expected < RATIOS[1]


def test_parameters_that_compensate_for_another_effect_have_no_interval():
    joint = ac.identify(logs(draw(18), 18)).joints[0]
    assert joint.effective
    assert joint.rms > 3 * joint.noise
    assert np.isnan(joint.kp.low) and np.isnan(joint.kp.high)
    assert joint.kp.sd > 0


def test_twin_with_exchanged_position_and_integral_gains_is_reported():
    """A P-PI servo has the same response to commands if kp and ki are exchanged."""
    joint = Joint(
        kp=20.0, kv=150.0, ki=5.0, pid=False, feed=1.0, bend=0.0, dead_time=2e-3, coulomb=0.0,
        viscous=0.0,
    )  # fmt: skip
    robot = Robot(kind="P-PI", period=INTERVAL, cycle=1e-4, joints=(joint,))
    t, u = wave()
    log = record(robot, u[::4, None], INTERVAL, 2e-6, 1)
    found = ac.identify(log).joints[0]
    assert found.order == "second"
    assert "5" in found.twin and "20" in found.twin
    assert found.effective
    assert np.isnan(found.kp.low) and np.isnan(found.ki.low)
    assert not found.kp.determined
