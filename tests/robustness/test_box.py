"""Boxes of errors, deviations on rigid bodies, and their spread."""

import dataclasses
import pickle

import numpy as np
import pytest

import armcontour as ac
from armcontour.robustness import Box
from armcontour.robustness.bodies import BodyRuns, describe, spread_on_bodies
from armcontour.robustness.deviations import Across, deviations_of
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


def test_a_box_its_columns_and_their_ranges(planar):
    np.testing.assert_array_equal(Box(payload=0.4).payload, [-0.4, 0.4])
    np.testing.assert_array_equal(Box(payload=[0.0, 2.0]).payload, [0.0, 2.0])
    np.testing.assert_array_equal(Box().friction, [0.0, 1.0])
    assert Box().of_bodies == ()
    box = Box(viscous=1.0, armature=0.1, payload_known=True)
    assert box.of_bodies == ("viscous", "armature", "payload_known")
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


def test_refusals(planar, refuses):
    for wrong in (
        *({"payload": x} for x in ([2.0, 0.0], [0.0, 1.0, 2.0], -1.0)),
        *({"gains": x} for x in (-0.1, 1.0)),
        {"friction": [1.0, 0.5]},
        {"viscous": -1.0},
        {"coulomb": [[1.0]]},
        {"armature": 1.0},
        {"dead_time": -1e-3},
    ):
        with pytest.raises(ac.InvalidInput):
            Box(**wrong)
    # Boxes that do not fit the arm or the servo.
    arm, servo, _, _ = planar
    first = ac.ServoModel(kp=25.0, order="first")
    for box, own, model, *words in (
        (Box(jitter=1e-3), arm, servo),
        (Box(gains=[0.1] * 3), arm, servo, "2 joints"),
        (Box(dead_time=3e-3), arm, servo, "cannot be negative"),
        (Box(payload=1.0), arm, servo, "0.5 kg"),
        (Box(viscous=1.0, friction=0.5), arm, servo),
        (Box(armature=0.1), ac.load_arm("pmk3s"), servo),
        (Box(), arm, first),
    ):
        refuses(lambda x=(box, own, model): Unknowns.of(*x), ac.InvalidInput, *words)


def test_a_robot_has_its_errors(planar):
    arm, servo, _, _ = planar
    u = Unknowns.of(ALL, arm, servo)
    true, known, own = u.robot(u.high)
    for found, expected in (
        (true.chain.payload.mass, 1.1),
        (true.chain.viscous, [2.0, 1.0]),
        (true.chain.coulomb, [0.5, 0.5]),
        (true.chain.armature, 0.06),
        (own.kp, 27.5),
        (own.kv, 157.5),
        (own.dead_time, [3e-3, 4e-3]),
    ):
        np.testing.assert_allclose(found, expected)
    # The controller knows none of it, unless it weighs its payload.
    assert known is u.arm
    weighed = Unknowns.of(Box(payload=[0.0, 1.0], payload_known=True), arm, servo)
    assert weighed.robot(np.ones(1))[1].chain.payload.mass == pytest.approx(1.5)
    arm = ac.load_arm("ur5e").with_tool(ac.Frame(position=[0.0, 0.0, 0.12]))
    u = Unknowns.of(Box(payload=[0.0, 2.0]), arm, SERVO)
    load = u.robot(np.array([2.0]))[0].chain.payload
    assert load.mass == 2.0 and load.center[2] == 0.12
    assert u.robot(np.zeros(1))[0].chain.payload is None


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
    limits = ac.Limits.only(joint_torque=[40.0, 40.0])
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
    taught = ac.compensate(ac.plan(path, arm), servo, ac.InverseDynamics(), arm=arm)
    u = Unknowns.of(Box(payload=[0.0, 0.5]), arm, servo)
    found = deviations_of(taught, path, u)
    load = ac.Payload(mass=0.5, center=arm.chain.tool.position)
    plant = ac.RigidBodyPlant(arm.with_dynamics(payload=load), servo, known=arm)
    done = ac.execute(taught, plant, resolution=5e-4)
    said = found.each[:, :, 0] * 0.5
    for i in (0, -1):
        np.testing.assert_allclose(said[i], done.q[i] - found.q[i], rtol=0.01, atol=1e-7)
    # At its ends the path has no length to slide along: all of the sag is an error there.
    tool = arm.tool_jacobian(found.q[:1])[0] @ said[0]
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


LIMITS = ac.Limits.only(joint_torque=[40.0, 40.0])
# Drives with a long cycle, of which a run takes a moment.
COARSE = {"step": 1e-3}


@pytest.fixture(scope="module")
def runs(planar):
    arm, servo, path, taught = planar
    u = Unknowns.of(Box(gains=[[0.05], [0.0]], payload=[0.0, 0.4], payload_known=True), arm, servo)
    return BodyRuns(taught=taught, path=path, unknowns=u, limits=LIMITS, options=COARSE)


def test_a_spread_is_what_the_plant_does(planar, runs):
    arm, servo, path, taught = planar
    errors = np.array([[0.4, 0.05, -0.05]])
    found = spread_on_bodies(runs, errors)
    load = ac.Payload(mass=0.9, center=arm.chain.payload.center)
    known = arm.with_dynamics(payload=load)
    plant = ac.RigidBodyPlant(known, servo.replace(kp=[26.25, 23.75]), LIMITS, **COARSE)
    done = ac.execute(taught, plant, resolution=1e-3)
    # A spread is of samples.
    result = ac.evaluate(dataclasses.replace(done, plant=None), path)
    assert found.max[0] == pytest.approx(max(result.contour_error.max, result.missed.max), rel=1e-9)
    off = path.project(done.tool).distance
    assert found.rms[0] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-9)
    assert found.worst_deviations == {"payload": 0.4, "kp of joint 1": 0.05, "kp of joint 2": -0.05}
    assert found.payload[0] == 0.4 and (found.kp[0] == [26.25, 23.75]).all()
    assert 0 < found.nominal_max < found.max[0]


def test_other_processes_find_the_same(runs, monkeypatch):
    """What is sent to them survives that."""
    errors = runs.unknowns.draw(4, 5)
    here = spread_on_bodies(runs, errors, seed=5, processes=1)

    def send(work, items, **_):
        return [pickle.loads(pickle.dumps(work))(x) for x in items]

    monkeypatch.setattr("armcontour.robustness.bodies.map_in_processes", send)
    np.testing.assert_array_equal(here.max, spread_on_bodies(runs, errors).max)
    assert here.seed == 5 and len(here) == 4


def test_a_robot_that_cannot_be_controlled_is_named(planar, runs):
    arm, servo, path, taught = planar
    wild = Unknowns.of(runs.unknowns.box, arm, servo.replace(kv=9e3))
    wrong = BodyRuns(taught=taught, path=path, unknowns=wild, limits=LIMITS, options={})
    with pytest.raises(ac.ExecutionError, match="The robot with no errors: .*unstable"):
        spread_on_bodies(wrong, wild.high[None])
    assert describe(wild, wild.high) == "payload +0.4 kg; kp +0.05"
