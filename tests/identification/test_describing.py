"""Logs of joints at a uniform velocity, which tell no parameter."""

import math

import numpy as np
import pytest

import armcontour as ac
from armcontour.identification import identify
from armcontour.io.servo_file import identification_json

T = np.arange(2001) * 0.004


def ramp(noise=0.0, digits=9):
    rate = np.array([0.1, 0.05])
    command = np.round(T[:, None] * rate, digits)
    measured = (T[:, None] - 0.04) * rate
    measured = measured + noise * np.random.default_rng(3).standard_normal(measured.shape)
    return ac.Log(
        t=T, command=command, measured=np.round(measured, digits),
        joint_names=("joint 1", "joint 2"), source="ramp.csv",
    )  # fmt: skip


@pytest.mark.parametrize("log", [ramp(), ramp(1e-5, 6)], ids=["exact", "noisy"])
def test_a_ramp_tells_only_how_late_the_joint_is(log):
    found = identify(log)
    assert not found.determined
    for joint in found.joints:
        for x in joint.estimates:
            assert not x.determined and math.isnan(x.value)
            assert "a uniform velocity" in x.advice and "40 ms late" in x.advice
            assert "A multisine around the bandwidth" in x.advice and "inf" not in x.words
        assert joint.rms < 2e-5
    assert "Infinity" not in identification_json(found)


def test_a_change_of_velocity_is_no_ramp():
    log = ramp()
    bent = np.maximum(log.t - 4.0, 0.0)[:, None] * 0.2
    late = np.maximum(log.t - 4.04, 0.0)[:, None] * 0.2
    found = identify(
        ac.Log(t=log.t, command=log.command + bent, measured=log.measured + late,
               joint_names=log.joint_names, source="bent.csv")
    )  # fmt: skip
    assert "uniform velocity" not in found.joints[0].kp.advice


def test_a_ramp_of_an_arm_is_refused_with_its_cause():
    arm = ac.load_arm("pmk3s")
    with pytest.raises(ac.InvalidInput, match="stands or moves at a uniform velocity"):
        identify(ramp(), arm=arm)
