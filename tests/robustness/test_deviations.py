"""The linear model of a box: against MuJoCo, and its bound against all corners."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.robustness import Box
from armcontour.robustness.deviations import Across, deviations_of
from armcontour.robustness.unknowns import Unknowns

# Errors that are small, each alone.
SMALL = {
    "payload": Box(payload=[0.0, 0.02]),
    "viscous friction": Box(viscous=[0.0, 0.02]),
    "kp": Box(gains=[[0.0, 0.005], [0.0, 0.0]]),
    "kv": Box(gains=[[0.0, 0.0], [0.005, 0.0]]),
    "drive inertia": Box(armature=[0.01, 0.0]),
    "dead time": Box(dead_time=[2e-4, 0.0], dead_time_shared=False),
}


def executed(u, taught, errors):
    """Joint positions on the rigid bodies, every drive cycle."""
    arm, known, servo = u.robot(errors)
    limits = ac.Limits(joint_torque=[40.0, 40.0])
    return ac.execute(taught, ac.RigidBodyPlant(arm, servo, limits, known=known), resolution=5e-4)


@pytest.fixture(scope="module")
def nominal(planar):
    arm, servo, _, taught = planar
    return executed(Unknowns.of(Box(), arm, servo), taught, np.zeros(0))


@pytest.mark.parametrize("name", SMALL)
def test_small_errors_do_what_mujoco_does(planar, nominal, name):
    arm, servo, path, taught = planar
    u = Unknowns.of(SMALL[name], arm, servo)
    found = deviations_of(taught, path, u)
    done = executed(u, taught, u.high)
    t = nominal.t[nominal.t < min(nominal.t[-1], done.t[-1], found.t[-1])]
    change = done.q[: len(t)] - nominal.q[: len(t)]
    said = np.array([np.interp(t, found.t, x) for x in (found.each @ u.high).T]).T
    assert np.abs(change).max() > 1e-6
    np.testing.assert_allclose(said, change, atol=0.03 * np.abs(change).max())


def test_the_nominal_robot_does_what_mujoco_does(planar, nominal):
    arm, servo, path, taught = planar
    found = deviations_of(taught, path, Unknowns.of(Box(), arm, servo))
    linear = np.abs(found.across().nominal).max()
    plant = ac.evaluate(nominal, path).contour_error.max
    assert linear == pytest.approx(plant, rel=0.25) and plant < 2e-5


def test_unknown_weight_sags_from_the_start_to_the_end():
    arm = ac.load_arm("ur5e")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    path = ac.Path.polyline([(0.45, 0.08, 0.2), (0.46, 0.08, 0.2)])
    path = path.oriented(np.diag([1.0, -1.0, -1.0]))
    taught = ac.compensate(ac.plan(path, arm), servo, method="inverse_dynamics", arm=arm)
    u = Unknowns.of(Box(payload=[0.0, 0.5]), arm, servo)
    found = deviations_of(taught, path, u)
    load = ac.Payload(mass=0.5, center=arm.chain.tool.position)
    plant = ac.RigidBodyPlant(arm.with_dynamics(payload=load), servo, known=arm)
    done = ac.execute(taught, plant, resolution=5e-4)
    said = found.each[:, :, 0] * 0.5
    for i in (0, -1):
        np.testing.assert_allclose(said[i], done.q[i] - found.q[i], rtol=0.01, atol=1e-7)
    # At its ends the path has no length to slide along: all of the sag is an error there.
    tool = arm.jacobian(found.q[:1])[0] @ said[0]
    assert found.across().worst().bound[0] == pytest.approx(np.linalg.norm(tool), rel=1e-6)
    weighed = Unknowns.of(Box(payload=[0.0, 0.5], payload_known=True), arm, servo)
    assert np.abs(deviations_of(taught, path, weighed).each[0]).max() < 1e-12


def brute(across):
    """Contour error over time of the worst corner, by all corners."""
    off = across.nominal[:, :, None] + across.each @ across.unknowns.corners().T
    return np.linalg.norm(off, axis=1).max(axis=1)


def test_the_bound_is_that_of_the_worst_of_all_corners(planar):
    arm, servo, path, taught = planar
    box = Box(gains=0.05, payload=[0.0, 0.3], viscous=1.0, coulomb=0.5)
    u = Unknowns.of(box, arm, servo)
    found = deviations_of(taught, path, u)
    across = found.across()
    worst = across.worst()
    np.testing.assert_allclose(worst.bound, brute(across), rtol=1e-9)
    # And no robot of the box is worse.
    assert across.largest(u.draw(2000, 3)).max() <= worst.largest
    # Its parts add up.
    assert sum(worst.shares().values()) == pytest.approx(worst.largest, rel=1e-9)
    assert set(worst.shares()) == {"payload", "friction", "kp", "kv", "sampling"}
    # The corner that has it comes first, in any number of corners.
    first = worst.errors[np.argmax(worst.bound)]
    most = [across.largest(x)[0] for x in (worst.corners(200)[:1], first[None])]
    assert most[0] == pytest.approx(most[1], rel=1e-9)
    assert len(worst.corners(200)) == 2**7
    few = worst.corners(5)
    assert len(few) == 5 and (few[0] == first).all()


def test_the_bound_in_space_is_that_of_the_worst_of_all_corners(planar):
    arm, servo, _, _ = planar
    u = Unknowns.of(Box(gains=0.05, payload=[0.0, 0.3], viscous=1.0), arm, servo)
    rng = np.random.default_rng(5)
    nominal, each = rng.normal(size=(60, 3)), rng.normal(size=(60, 3, len(u)))
    each[:, :, :2] *= 0.0 + (np.arange(60) % 2)[:, None, None]
    nominal[1:-1, 2], each[1:-1, 2] = 0.0, 0.0
    across = Across(t=np.arange(60.0), nominal=nominal, each=each / (u.high - u.low), unknowns=u)
    worst = across.worst()
    np.testing.assert_allclose(worst.bound, brute(across), rtol=1e-9)
    for i in (0, 7, 59):
        off = across.nominal[i] + across.each[i] @ worst.errors[i]
        assert np.linalg.norm(off) == pytest.approx(worst.bound[i], rel=1e-9)
