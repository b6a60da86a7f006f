"""Identification of robots where its search takes long."""

import dataclasses

import numpy as np
import pytest
from tests.control.identification.bodies.robots import (
    KP,
    LOADED,
    NOMINAL,
    nominal_arm,
    nominal_servo,
    planar,
    record,
    set_points,
    true_arm,
)

import armcontour as ac
from armcontour import identify_bodies

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def nominal():
    return nominal_arm()


@pytest.fixture(scope="module")
def log(nominal):
    servo = nominal_servo().replace(kp=KP, dead_time=6e-3)
    return record(true_arm(nominal), servo, set_points(0, 6.0), controller=nominal)


def test_exchanged_columns_explain_nothing(log, nominal):
    order = [0, 1, 5, 3, 4, 2]
    signals = {"command": log.command[:, order], "measured": log.measured[:, order]}
    wrong = dataclasses.replace(log, **signals).between(0, 2.5)
    with pytest.raises(ac.InvalidInput, match="explains"):
        identify_bodies(wrong, nominal, nominal_servo(), NOMINAL)


def test_drive_inertias_set_the_scale_of_a_planar_arm():
    fit, coulomb = planar(0.05)
    assert fit.joints[0].kp.determined
    assert "payload_center_z" in fit.open and fit.payload_center[2].value == 0.0
    ratios = np.array([x.coulomb.value for x in fit.joints]) / coulomb
    np.testing.assert_allclose(ratios, 1.0, rtol=0.15)
    np.testing.assert_allclose(fit.joints[1].kp.value / fit.servo_model().kp[0], 24 / 26, rtol=5e-3)


def test_a_search_that_does_not_come_to_rest_determines_nothing(log, nominal, monkeypatch):
    module = "armcontour.control.identification.bodies.output_error"
    monkeypatch.setattr(f"{module}.MAX_NEXT_STEP", 1e-12)
    monkeypatch.setattr(f"{module}.LEAST_EXPLAINED", -np.inf)
    fit = identify_bodies(log.between(0, 2.1), nominal, nominal_servo(), NOMINAL)
    assert not any(x.determined for joint in fit.joints for x in joint.estimates)
    assert any("did not converge for kp of joint 1" in x for x in fit.notes)
    np.testing.assert_allclose(fit.servo_model().kp, 25.0, rtol=1e-12)


def test_logs_add_up(nominal):
    servo = nominal_servo().replace(kp=KP)
    logs = [
        record(true_arm(nominal), servo, set_points(k, 2.2, joints=joints), every=8)
        for k, joints in ((2, (0, 1, 2)), (3, (3, 4, 5)))
    ]
    fit = identify_bodies(logs, nominal, nominal_servo(), LOADED)
    assert not [x for x in fit.open if x.startswith(("kp", "coulomb"))]
    assert len(fit.logs) == 2
