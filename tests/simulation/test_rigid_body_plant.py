"""The rigid-body plant compared with hand calculations."""

import sys
from functools import partial
from itertools import product
from unittest.mock import ANY

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import LapLaw
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain
from armcontour.robot.serial import SerialArm
from armcontour.simulation import mujoco_model

pytest.importorskip("mujoco")

KP = 25.0  # 1/s
KV = 150.0  # 1/s
CYCLE = 4e-3  # s
MASS = 2.0  # kg, of the pendulum
LENGTH = 0.5  # m, from the joint to the pendulum's mass
ARMATURE = 0.1  # kg m²
G = 9.81  # m/s²
INERTIA = MASS * LENGTH**2 + ARMATURE  # kg m²
WEIGHT = MASS * G * LENGTH  # torque against gravity where the pendulum lies [N m]
WEIGHTLESS = np.zeros(3)


@pytest.fixture(autouse=True)
def no_log(monkeypatch, tmp_path):
    """MuJoCo writes a file where it finds something wrong; there must be nothing."""
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.iterdir())


@pytest.fixture
def fails(refuses):
    """A check of an execution that fails, with joint 1 as its cause."""
    return lambda call, *words, joint=0, **data: refuses(
        call, ac.ExecutionError, *words, **({} if joint is ANY else {"joint": joint}), **data
    )


def pendulum(limits=None, **changes):
    """A point mass on a rod, along x at 0 and upright at pi / 2."""
    data = {
        "joints": ("hinge",),
        "rotations": np.eye(3)[None],
        "positions": np.zeros((1, 3)),
        "axes": [[0.0, -1.0, 0.0]],
        "masses": [MASS],
        "centers": [[LENGTH, 0.0, 0.0]],
        "inertias": np.zeros((1, 3, 3)),
        "armature": [ARMATURE],
    }
    chain = Chain(**(data | changes))
    return SerialArm(name="pendulum", chain=chain, limits=limits or ac.Limits())


def two_link(limits=None, **changes):
    """Two thin rods of 0.4 m in a horizontal plane, 3 kg and 2 kg."""
    data = {
        "joints": ("shoulder", "elbow"),
        "rotations": np.tile(np.eye(3), (2, 1, 1)),
        "positions": [[0.0, 0.0, 0.2], [0.4, 0.0, 0.0]],
        "axes": [[0.0, 0.0, 1.0]] * 2,
        "masses": [3.0, 2.0],
        "centers": [[0.2, 0.0, 0.0]] * 2,
        "inertias": [np.diag([0, m * 0.4**2 / 12, m * 0.4**2 / 12]) for m in (3.0, 2.0)],
        "armature": [0.05, 0.02],
    }
    chain = Chain(**(data | changes))
    return SerialArm(name="two rods", chain=chain, limits=limits or ac.Limits())


def make_set_points(q, cycle=0.004):
    q = np.asarray(q, float)
    still = np.zeros((1, q.shape[1]))
    law = LapLaw(breaks=np.array([0.0, 1.0]), q=np.zeros((2, q.shape[1])), dq=still, ddq=still)
    trajectory = ac.Trajectory(laws=(law,), method="hand")
    return ac.SetPoints(cycle=cycle, q=q, trajectory=trajectory, method="x")


def swing(to=0.5, duration=1.0, cycle=0.004, start=0.0):
    """From `start` by `to`, gently, and a while of rest after it."""
    t = np.clip(np.arange(0, 1.5 * duration, cycle) / duration, 0, 1)
    return start + np.atleast_1d(to) * (1 - np.cos(np.pi * t))[:, None] / 2


def plant(arm, limits=None, kp=KP, kv=KV, interpolation="linear", **options):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    return ac.RigidBodyPlant(arm, servo, limits, **options)


def run(arm, q, limits=None, cycle=0.004, resolution=0.004, **options):
    set_points = make_set_points(q, cycle)
    return ac.simulate(set_points, plant(arm, limits, **options), resolution=resolution)


def by_servo(arm, q, cycle=0.004, kv=KV, interpolation="linear"):
    simulated = ac.ServoPlant(arm, ac.ServoModel(kp=KP, kv=kv, interpolation=interpolation))
    return ac.simulate(make_set_points(q, cycle), simulated, resolution=cycle)


@pytest.mark.parametrize("interpolation", ["linear", "step"])
def test_one_joint_converges_to_the_servo_plant(interpolation):
    arm = pendulum(gravity=WEIGHTLESS)
    ideal = by_servo(arm, swing(), interpolation=interpolation)
    errors = []
    for step in (4e-3, 1e-3, 2.5e-4, 6.25e-5):
        execution = run(arm, swing(), step=step, interpolation=interpolation)
        n = min(len(execution.t), len(ideal.t))
        errors.append(np.abs(execution.q[:n] - ideal.q[:n]).max())
    # First order: the torque held over a step is half a step late.
    ratios = np.divide(errors[:-1], errors[1:])
    np.testing.assert_allclose(ratios[1:], 4, rtol=0.1)
    assert ratios[0] > 3.9 and errors[2] < (5e-6 if interpolation == "linear" else 2e-4)


def test_an_execution_starts_in_equilibrium_and_sags_as_predicted():
    held = run(pendulum(), [[0.3]])
    np.testing.assert_allclose(held.q, 0.3, atol=1e-12)
    np.testing.assert_allclose(held.torque, WEIGHT * np.cos(0.3), rtol=1e-9)
    np.testing.assert_allclose(held.peak_demand, 0, atol=1e-9)
    sagged = run(pendulum(), [[0.3]], gravity_feedforward=False)
    rest_angle = sagged.q[0, 0]
    assert rest_angle == pytest.approx(
        0.3 - WEIGHT * np.cos(rest_angle) / (INERTIA * KV * KP), abs=1e-12
    )
    np.testing.assert_allclose(sagged.q, rest_angle, atol=1e-9)
    execution = run(pendulum(), swing(0.8), gravity_feedforward=False)
    end = execution.q[-1, 0]
    assert end - 0.8 == pytest.approx(-WEIGHT * np.cos(end) / (INERTIA * KV * KP), rel=1e-5)
    assert run(pendulum(), swing(0.8)).q[-1, 0] == pytest.approx(0.8, abs=1e-7)


def test_an_integrator_compensates_gravity_without_sag():
    servo = ac.ServoModel(kp=KP, kv=KV, ki=8.0)
    sagging = {"gravity_feedforward": False}
    set_points = make_set_points(swing(1.2))
    execution = ac.simulate(set_points, ac.RigidBodyPlant(pendulum(), servo, **sagging))
    assert execution.q[0, 0] == 0.0 and execution.q[-1, 0] == pytest.approx(1.2, abs=1e-6)
    assert run(pendulum(), swing(1.2), **sagging).q[-1, 0] < 1.2 - 1e-3
    still = ac.simulate(make_set_points([[0.3]]), ac.RigidBodyPlant(pendulum(), servo, **sagging))
    assert np.ptp(still.q) < 1e-12
    np.testing.assert_allclose(still.torque, WEIGHT * np.cos(still.q), rtol=1e-9)


def test_coulomb_friction_leaves_an_error_within_its_dead_band():
    coulomb = 4.0
    band = coulomb / (INERTIA * KV * KP)
    arm = pendulum(gravity=WEIGHTLESS, coulomb=[coulomb])
    for to in (0.5, -0.5):
        still = np.full((1500, 1), to)  # 6 s: the joint must not creep through the band
        execution = run(arm, np.concatenate([swing(to), still]))
        assert execution.q[-1, 0] - to == pytest.approx(-np.sign(to) * band, rel=1e-3)
        free = run(pendulum(gravity=WEIGHTLESS), swing(to))
        assert free.q[-1, 0] == pytest.approx(to, abs=1e-7)
    # It moves once the servo asks for more than friction takes: 1/2 and 2 times that.
    for share, moves in ((0.5, False), (2.0, True)):
        pushed = run(arm, np.full((250, 1), share * band) * (np.arange(250) > 0)[:, None])
        assert (np.ptp(pushed.q) > 0.1 * band) == moves


def test_torque_saturation_has_the_closed_form():
    limit = 3.0
    arm = pendulum(gravity=WEIGHTLESS)
    q = [[0.0]] + [[2.0]] * 300
    execution = run(arm, q, ac.Limits.only(joint_torque=limit), interpolation="step")
    constant = (execution.t >= 0.004) & (execution.t <= 0.5)
    since = execution.t[constant] - 0.004
    np.testing.assert_allclose(execution.q[constant, 0], limit / INERTIA * since**2 / 2, atol=1e-12)
    np.testing.assert_allclose(execution.torque[constant, 0], limit)
    np.testing.assert_allclose(execution.ddq[constant, 0], limit / INERTIA, rtol=1e-9)
    assert execution.saturated[constant, 0].all()
    assert execution.peak_demand[0] == pytest.approx(KV * KP * 2.0, rel=1e-3)
    assert execution.saturated_time[0] == pytest.approx(execution.saturated.sum() * 0.004, abs=0.02)
    free = run(arm, q, interpolation="step")
    assert free.saturated_time[0] == 0 and not free.saturated.any()
    assert np.abs(free.torque).max() > 100 * limit
    q = swing(1.0, 0.3)
    by_torque = run(pendulum(), q, ac.Limits.only(joint_torque=12.0, joint_acceleration=99.0))
    assert np.abs(by_torque.torque).max() == 12.0
    by_acceleration = run(pendulum(), q, ac.Limits.only(joint_acceleration=4.0))
    on_top = by_acceleration.torque[:, 0] - WEIGHT * np.cos(by_acceleration.q[:, 0])
    assert np.abs(on_top).max() == pytest.approx(4.0 * INERTIA)
    assert by_torque.saturated_time[0] > 0.05 and by_acceleration.saturated_time[0] > 0.05
    np.testing.assert_array_equal(by_acceleration.saturated.any(axis=0), [True])


def test_a_payload_changes_the_loop_gain_but_not_the_drives():
    load = Payload(mass=3.0, center=np.array([LENGTH, 0.0, 0.0]))
    light, loaded = (pendulum(gravity=WEIGHTLESS, payload=x) for x in (None, load))
    np.testing.assert_allclose(plant(loaded).nominal_inertia, INERTIA)
    execution = run(loaded, swing(), step=1e-4)
    ratio = INERTIA / (INERTIA + 3.0 * LENGTH**2)
    n = len(swing())
    expected = by_servo(loaded, swing(), kv=KV * ratio)
    np.testing.assert_allclose(execution.q[:n], expected.q[:n], atol=3e-6)
    assert np.abs(execution.q[:n] - run(light, swing()).q[:n]).max() > 5e-4
    # Where it is given against gravity, the controller knows it.
    held = run(pendulum(payload=load), [[0.3]])
    np.testing.assert_allclose(held.q, 0.3, atol=1e-12)


STIFFNESS = INERTIA * KV * KP  # of the position loop [N m/rad]
LOAD = Payload(mass=3.0, center=np.array([LENGTH, 0.0, 0.0]))
LOAD_WEIGHT = 3.0 * G * LENGTH


def test_a_payload_unknown_to_the_controller_causes_sag():
    loaded = pendulum(payload=LOAD)
    held = run(loaded, [[0.3]], controller=pendulum())
    rest_angle = held.q[0, 0]
    # What is fed forward is lacking the load: K (u - q) = g_true(q) - g_known(q).
    assert rest_angle == pytest.approx(
        0.3 - LOAD_WEIGHT * np.cos(rest_angle) / STIFFNESS, abs=1e-12
    )
    np.testing.assert_allclose(held.q, rest_angle, atol=1e-9)
    np.testing.assert_allclose(held.torque, (WEIGHT + LOAD_WEIGHT) * np.cos(rest_angle), rtol=1e-6)
    end = run(loaded, swing(0.8), controller=pendulum()).q[-1, 0]
    assert end - 0.8 == pytest.approx(-LOAD_WEIGHT * np.cos(end) / STIFFNESS, rel=1e-4)
    # A controller that adds nothing lacks all of it, whatever it knows.
    without = run(loaded, [[0.3]], controller=pendulum(), gravity_feedforward=False).q[0, 0]
    weight = (WEIGHT + LOAD_WEIGHT) * np.cos(without)
    assert without == pytest.approx(0.3 - weight / STIFFNESS, abs=1e-12)
    # A controller that assumes a missing load lifts the arm.
    lifted = run(pendulum(), [[0.3]], controller=loaded).q[0, 0]
    assert lifted == pytest.approx(0.3 + LOAD_WEIGHT * np.cos(lifted) / STIFFNESS, abs=1e-12)


def test_loop_gains_are_scaled_by_the_masses_that_the_controller_knows():
    drives = pendulum(gravity=WEIGHTLESS, armature=[0.4])
    nominal = pendulum(gravity=WEIGHTLESS)
    simulated = plant(drives, controller=nominal, step=1e-4)
    np.testing.assert_allclose(simulated.nominal_inertia, INERTIA)
    assert simulated.arm is drives
    execution = ac.simulate(make_set_points(swing()), simulated, resolution=0.004)
    expected = by_servo(drives, swing(), kv=KV * INERTIA / (INERTIA + 0.3))
    n = len(swing())
    np.testing.assert_allclose(execution.q[:n], expected.q[:n], atol=3e-6)
    servo = ac.ServoModel(kp=KP, kv=KV, inertia=0.7)
    np.testing.assert_allclose(
        ac.RigidBodyPlant(drives, servo, controller=nominal).nominal_inertia, 0.7
    )
    # A drive that is rated for accelerations is rated for the bodies that its maker knew of.
    rated = plant(drives, ac.Limits.only(joint_acceleration=4.0), controller=nominal)
    np.testing.assert_allclose(rated.torque_limit, 4.0 * INERTIA)


def test_the_noise_of_an_execution_is_reproducible_by_its_seed():
    arm = pendulum()
    q = swing()
    clean = run(arm, q)
    one, same, other = (run(arm, q, noise=2e-5, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.q, same.q)
    n = len(q)
    assert not np.array_equal(one.q[:n], other.q[:n])
    moved = np.std(one.q[:n] - clean.q[:n])
    # White noise through the loop: kp h / 2 of its variance is left, all but for the slow part.
    assert moved == pytest.approx(2e-5 * np.sqrt(KP * 2.5e-4 / 2), rel=0.5)
    assert one.q[-1, 0] == pytest.approx(0.5, abs=2e-5)


@pytest.mark.parametrize("name", ["pmk3s", "ur5e", "panda"])
def test_every_built_in_arm_is_simulated(name):
    arm = ac.load_arm(name).with_dynamics(coulomb=0.0, viscous=0.0)
    low, high = arm.limits.joint_range(arm.dof)
    middle = plant(arm).reference
    assert ((middle >= low) & (middle <= high)).all()
    # Stretched, some joints turn about one line, where arms without drives are light.
    q = middle + 0.8 + swing(np.full(arm.dof, 0.02), duration=2.0)
    execution = run(arm, q)
    np.testing.assert_allclose(execution.q[-1], q[-1], atol=2e-6)
    needed = arm.dynamics.torque(execution.q, execution.dq, execution.ddq)
    # ddq is the mean over the step that follows: half a step off.
    np.testing.assert_allclose(execution.torque, needed, atol=0.02 * np.abs(needed).max() + 1e-3)


def test_an_execution_locks_its_torques_and_has_both_or_neither(refuses):
    one = np.ones((1, 1))
    fields = {"q": 0 * one, "dq": 0 * one, "ddq": one, "demand": one, "t": np.zeros(1)}
    fields |= {"arm": pendulum(), "set_points": make_set_points([[0.0]])}
    fields |= {"demand_range": np.ones((2, 1)), "saturated_time": np.zeros(1)}
    torque = np.array([[2.0]])
    execution = ac.Execution(**fields, torque=torque, torque_demand=[[-3.0]])
    torque[:] = 0
    assert execution.torque.tolist() == [[2.0]] and execution.saturated.all()
    with pytest.raises(ValueError, match="read-only"):
        execution.torque[0] = 1
    assert not ac.Execution(**fields, torque=[[2.0]], torque_demand=[[2.0]]).saturated.any()
    assert ac.Execution(**fields).torque is None
    refuses(lambda: ac.Execution(**fields, torque=torque), ac.InvalidInput, "torque_demand")


def test_a_step_too_long_for_the_gains_is_an_error(fails):
    q = swing()
    free = pendulum(gravity=WEIGHTLESS)
    assert len(run(free, q, kv=490.0, step=4e-3).t) > len(q)
    fails(
        partial(run, free, q, kv=510.0, step=4e-3),
        "unstable at t = 0 s",
        "Shorten the step to 0.002 s",
        t=0.0,
        allowed=2 / 510.0,
        needed=4e-3,
    )
    # Folded, the two rods have a mode that is far lighter than either joint alone.
    folding = np.column_stack([np.zeros(501), np.linspace(0, 3.0, 501)])
    fails(partial(run, two_link(), folding, kv=1500.0, step=1e-3), "unstable", joint=1)
    assert run(two_link(), folding, kv=1500.0, step=2e-4).q[-1, 1] == pytest.approx(3.0, abs=1e-6)


def test_joints_that_diverge_or_do_not_settle_are_errors(fails, monkeypatch):
    # The plant looks at no pose before it runs.
    monkeypatch.setattr(mujoco_model, "MAX_CHECKS", 0)
    fails(partial(run, pendulum(), swing(), kv=1000.0, step=4e-3), "runs away")
    # If saturated, the joint oscillates within steps, and seems to rest at their ends.
    free = pendulum(gravity=WEIGHTLESS)
    weak = ac.Limits.only(joint_torque=5.0)
    fails(partial(run, free, swing(), weak, kv=1000.0, step=4e-3), "not at rest")
    slow = {"kp": 0.01, "cycle": 0.02, "step": 5e-3, "resolution": 0.02}
    for arm, words in (
        (pendulum(gravity=WEIGHTLESS), "the joint does not settle."),
        (pendulum(gravity=WEIGHTLESS, armature=[0.0]), "its drive (armature) is missing."),
    ):
        fails(partial(run, arm, [[0.0], [1.0]], **slow), "not at rest", words)
    loose = {"kp": 0.1, "kv": 1.0, "gravity_feedforward": False}
    fails(partial(run, pendulum(), [[0.5]], **loose), "has no equilibrium")


def test_drives_that_are_too_weak_are_errors(fails):
    weak = ac.Limits.only(joint_torque=5.0)
    data = {"limit": "joint_torque", "needed": WEIGHT, "allowed": 5.0, "t": 0.0}
    fails(partial(run, pendulum(), [[0.0]], weak), "against gravity", **data)
    # Gravity feed-forward is not part of a torque limit for accelerations.
    slow = ac.Limits.only(joint_acceleration=10.0)
    loaded = pendulum(payload=LOAD)
    assert run(loaded, [[0.0]], slow).torque[0, 0] > 10.0 * INERTIA
    words = ("requires 14.71 N m", "in addition to gravity feed-forward", "is 6 N m")
    fails(partial(run, loaded, [[0.0]], slow, controller=pendulum()), *words)
    falling = swing(-np.pi / 2, start=np.pi / 2)
    fails(partial(run, pendulum(viscous=[5.0]), falling, weak), "rests ", limit="joint_torque")


def test_invalid_arms_servos_and_limits_are_refused(refuses, monkeypatch):
    bare = ac.PlanarTwoLink(name="bare", base=0.1, links=(0.3, 0.2), limits=ac.Limits())
    one_way = ac.Limits.only(joint_acceleration=[[-2.0, 1.0]])
    light = pendulum(centers=[[0.0, 0.0, 0.0]], armature=[0.0])
    empty = pendulum(masses=[0.0])
    assert run(empty, swing()).q[-1, 0] == pytest.approx(0.5, abs=1e-6)
    first = ac.ServoModel(kp=KP, order="first")

    def plant_of(**options):
        return ac.RigidBodyPlant(two_link(), ac.ServoModel(**{"kp": 25.0, "kv": 150.0, **options}))

    for call, words in (
        (partial(plant, pendulum(masses=None)), "those of the arm pendulum are not known"),
        (partial(plant, bare), "those of the arm bare are not known"),
        (partial(plant, pendulum(), step=0.0), "step"),
        (partial(plant, pendulum(), noise=-1e-5), "noise"),
        (partial(plant, pendulum(), seed=1.5), "seed"),
        (partial(plant, pendulum(), kp=[1.0, 2.0]), "kp has 2 values"),
        (partial(plant, pendulum(), one_way), "joint_acceleration"),
        (partial(plant, light), "joint 1 (hinge) moves none"),
        (partial(plant, pendulum(), controller=two_link()), "the controller has 2"),
        (partial(plant, pendulum(), controller=pendulum(masses=None)), "pendulum are not known"),
        (partial(run, pendulum(), np.zeros((4, 3))), "have 3 joints"),
        (partial(run, pendulum(), swing(), resolution=1e-4), "coarser"),
        (partial(ac.RigidBodyPlant, two_link(), first), "of order second"),
        (
            partial(plant_of, order=("second", "delay"), kp=[25, np.inf], kv=[150, np.inf]),
            "of order",
        ),
        (partial(plant_of, friction=1e-3), "without friction and cycle"),
        (partial(plant_of, drive_cycle=1e-3), "without friction and cycle"),
        (partial(plant_of, acceleration_limit=5.0), "acceleration_limit of 5.0 rad/s²"),
    ):
        refuses(call, ac.InvalidInput, words)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refuses(partial(plant, pendulum()), ac.InvalidInput, "armcontour[experiment]")


def test_delayed_and_cubic_commands_move_rigid_bodies_like_the_servo_plant():
    # With heavy drives the joints are almost decoupled, as in the servo plant.
    arm = two_link(centers=np.zeros((2, 3)), positions=np.zeros((2, 3)), armature=[10.0, 10.0])
    t = np.linspace(0, 1, 26)[:, None]
    set_points = make_set_points(np.array([0.3, -0.2]) * t**3 * (10 - 15 * t + 6 * t * t), 0.02)
    for interpolation, dead in product(("linear", "step", "cubic"), (0.0, 0.0123, [0.008, 0.0321])):
        prompt = ac.ServoModel(kp=KP, kv=KV, interpolation=interpolation)
        servo = prompt.replace(dead_time=dead)
        positions = ac.simulate(set_points, ac.RigidBodyPlant(arm, servo)).q[:1000]
        exact = ac.simulate(set_points, ac.ServoPlant(arm, servo, ac.Limits.only())).q[:1000]
        assert np.abs(positions - exact).max() < 3e-4, (interpolation, dead)
        if np.any(dead):
            other = ac.simulate(set_points, ac.ServoPlant(arm, prompt, ac.Limits.only())).q[:1000]
            assert np.abs(positions - other).max() > 3e-3, (interpolation, dead)


def test_friction_that_brakes_a_link_within_a_step_is_integrated_more_finely(fails):
    stiff = pendulum(gravity=WEIGHTLESS, viscous=[1e9])
    fails(partial(run, stiff, swing()), "at most 50", joint=ANY)
    slow = {"kp": 10.0, "kv": 40.0, "cycle": 0.02, "step": 0.02, "resolution": 0.02}
    rubbed = run(pendulum(gravity=WEIGHTLESS, viscous=[200.0]), swing(0.1, cycle=0.02), **slow)
    assert np.diff(rubbed.q[:, 0]).min() > -1e-9
    assert rubbed.q[-1, 0] == pytest.approx(0.1, abs=1e-5)
