"""Robots of a box as rigid bodies."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.robustness import Box
from armcontour.robustness.unknowns import Unknowns

SERVO = ac.ServoModel(kp=25.0, kv=150.0)
ALL = Box(
    gains=[[0.1], [0.05]],
    payload=[-0.2, 0.6],
    viscous=[2.0, 1.0],
    coulomb=0.5,
    friction=[0.0, 1.0],
    armature=0.2,
    dead_time=[1e-3, 2e-3],
)


def test_columns_are_named_and_ranged(planar):
    arm, servo, _, _ = planar
    u = Unknowns.of(ALL, arm, servo)
    assert u.names[:4] == ("payload", "friction of joint 1", "friction of joint 2", "kp of joint 1")
    assert u.names[-1] == "dead time" and len(u) == 10
    corners = u.corners()
    assert len(np.unique(corners, axis=0)) == 2**10
    assert (corners.min(axis=0) == u.low).all() and (corners.max(axis=0) == u.high).all()
    drawn = u.draw(500, 1)
    assert ((u.low <= drawn) & (drawn <= u.high)).all()
    assert (np.ptp(drawn, axis=0) > 0.95 * (u.high - u.low)).all()
    shared = Unknowns.of(Box(viscous=1.0, friction_shared=True), arm, servo)
    assert shared.names == ("friction",)
    assert len(Unknowns.of(Box(), arm, servo)) == 0


def test_a_robot_has_its_errors(planar):
    arm, servo, _, _ = planar
    u = Unknowns.of(ALL, arm, servo)
    true, known, own = u.robot(u.high)
    assert true.chain.payload.mass == pytest.approx(1.1)
    np.testing.assert_allclose(true.chain.viscous, [2.0, 1.0])
    np.testing.assert_allclose(true.chain.coulomb, [0.5, 0.5])
    np.testing.assert_allclose(true.chain.armature, 0.06)
    np.testing.assert_allclose(own.kp, 27.5)
    np.testing.assert_allclose(own.kv, 157.5)
    np.testing.assert_allclose(own.dead_time, [3e-3, 4e-3])
    # The controller knows none of it, unless it weighs its payload.
    assert known is u.arm
    weighed = Unknowns.of(Box(payload=[0.0, 1.0], payload_known=True), arm, servo)
    assert weighed.robot(np.ones(1))[1].chain.payload.mass == pytest.approx(1.5)


def test_an_arm_without_payload_carries_it_at_the_tool():
    tool = ac.Frame(position=[0.0, 0.0, 0.12])
    arm = ac.load_arm("ur5e").with_tool(tool)
    u = Unknowns.of(Box(payload=[0.0, 2.0]), arm, SERVO)
    load = u.robot(np.array([2.0]))[0].chain.payload
    assert load.mass == 2.0 and load.center[2] == 0.12
    assert u.robot(np.zeros(1))[0].chain.payload is None


@pytest.mark.parametrize(
    ("box", "words"),
    [
        (Box(jitter=1e-3), "without jitter"),
        (Box(gains=[0.1] * 3), "2 joints"),
        (Box(dead_time=3e-3), "cannot be negative"),
        (Box(payload=1.0), "carries only 0.5 kg"),
        (Box(viscous=1.0, friction=0.5), "from 0 on"),
    ],
)
def test_a_box_that_does_not_fit_is_refused(planar, box, words):
    arm, servo, _, _ = planar
    with pytest.raises(ac.InvalidInput, match=words):
        Unknowns.of(box, arm, servo)


def test_rigid_bodies_need_masses_and_drives(planar):
    arm, servo, _, _ = planar
    with pytest.raises(ac.InvalidInput, match="armature"):
        Unknowns.of(Box(armature=0.1), ac.load_arm("pmk3s"), servo)
    with pytest.raises(ac.InvalidInput, match="order second"):
        Unknowns.of(Box(), arm, ac.ServoModel(kp=25.0))
