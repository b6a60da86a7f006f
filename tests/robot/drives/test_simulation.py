"""The nominal robot's motion with dry friction, against the plant of MuJoCo."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.errors import ExecutionError
from armcontour.motion import SetPoints
from armcontour.robot.drives import Drives, simulate

pytest.importorskip("mujoco")
CYCLE = 4e-3
COULOMB = np.array([6.0, 6.0, 4.0, 1.5, 1.5, 1.5])
VISCOUS = np.array([8.0, 8.0, 5.0, 2.0, 2.0, 2.0])
SERVO = ac.ServoModel(kp=[25.0, 24.0, 26.0, 23.0, 25.0, 25.5], kv=150.0)
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])


@pytest.fixture(scope="module")
def nominal():
    return ac.load_arm("ur5e").with_dynamics(armature=0.1)


@pytest.fixture(scope="module")
def arm(nominal):
    load = ac.Payload(mass=2.0, center=[0.0, 0.05, 0.1])
    return nominal.with_dynamics(payload=load, coulomb=COULOMB, viscous=VISCOUS)


@pytest.fixture(scope="module")
def set_points():
    """Joints that swing, turn round several times, and stand still in between."""
    t = np.arange(0, 2.0, CYCLE)
    wave = np.sin(np.outer(t, 2 * np.pi * np.array([0.5, 0.7, 0.9, 1.1, 1.3, 1.5])))
    still = np.where(np.abs(t - 1.2) < 0.2, 0.0, 1.0)[:, None]
    path = np.cumsum(0.2 * wave * still * np.clip(t / 0.2, 0, 1)[:, None], axis=0) * CYCLE * 5
    return HOME + path


def commands(set_points, t):
    """The set-points, interpolated linearly."""
    times = np.arange(len(set_points)) * CYCLE
    return np.stack([np.interp(t, times, x) for x in set_points.T], axis=1)


def executed(arm, set_points, **options):
    rest = np.stack([HOME, set_points[-1]])
    plan = ac.plan(ac.JointPath.spline(rest), arm)
    data = SetPoints(cycle=CYCLE, q=set_points, trajectory=plan, method="none")
    limits = ac.Limits(joint_torque=np.full(6, 1e4))
    return ac.simulate(data, ac.RigidBodyPlant(arm, SERVO, limits, **options))


@pytest.mark.parametrize("controller", ["true load", "nominal load", "no feed-forward"])
def test_motion_with_friction_is_that_of_the_plant(arm, nominal, set_points, controller):
    options = {
        "nominal load": {"controller": nominal},
        "no feed-forward": {"gravity_feedforward": False},
    }
    options = options.get(controller, {})
    execution = executed(arm, set_points, **options)
    drives = Drives(arm=arm, servo=SERVO, **options)
    t = execution.t[: len(set_points) * 4]
    # Half a cycle of the drives, which keep their torque for 0.25 ms.
    lag = 1.25e-4
    near = execution.q[: len(t)] + 1e-3 * (t > 0.1)[:, None]
    simulated = simulate(drives, commands(set_points, t - lag), t, near, lag=lag)
    command = commands(set_points, t)
    moved = np.abs(command - execution.q[: len(t)]).max()
    assert moved > 5e-3
    assert np.abs(simulated.q - execution.q[: len(t)]).max() < 1e-3 * moved
    # Friction holds each joint for a while, and never exceeds what it can give.
    assert (np.abs(simulated.friction) <= COULOMB * (1 + 1e-12)).all()
    assert simulated.held.any(axis=0).all() and not simulated.held.all(axis=0).any()


def test_small_torques_move_the_simulated_robot_as_its_response_predicts(arm, set_points):
    drives = Drives(arm=arm, servo=SERVO)
    t = np.linspace(0, 2.0, 2001)
    command = commands(set_points, t)
    first = simulate(drives, command, t, command)
    change = 1e-6 * np.sin(np.outer(t, [5.0, 7, 9, 11, 13, 15]))
    second = simulate(drives, command + change, t, command)
    expected = first.to_torque((drives.stiffness * change)[:, :, None])[:, :, 0]
    simulated_change = second.q - first.q
    # Joints begin and cease to stick a little earlier or later.
    assert np.sqrt(np.mean((simulated_change - expected) ** 2)) < 0.05 * np.sqrt(
        np.mean(simulated_change**2)
    )


def test_a_load_that_sags_is_held_by_friction_where_it_starts(arm, nominal):
    """Friction carries what the controller does not know of, up to what friction can give."""
    drives = Drives(arm=arm, servo=SERVO, controller=nominal)
    t = np.linspace(0, 1.0, 501)
    command = np.tile(HOME, (len(t), 1))
    simulated = simulate(drives, command, t, command)
    missing = arm.dynamics.gravity(simulated.q[-1]) - nominal.dynamics.gravity(simulated.q[-1])
    weak = np.abs(missing) > COULOMB
    assert 0 < weak.sum() < 6
    moved = np.abs(simulated.q[-1] - HOME)
    rest = (np.abs(missing) - COULOMB) / drives.stiffness
    # They sag until friction can hold the rest, or a little farther, since they come with speed.
    assert (moved[weak] >= rest[weak]).all() and (moved[weak] < 1.05 * rest[weak]).all()
    assert moved[0] < 1e-7 and (simulated.q[-1] == simulated.q[-2])[~weak].all()


def test_a_start_speed_decays_with_the_loops_unless_they_are_unstable(nominal):
    """A joint that starts fast comes back to its command."""
    drives = Drives(arm=nominal, servo=SERVO)
    t = np.linspace(0, 1.0, 2001)
    command = np.tile(HOME, (len(t), 1))
    simulated = simulate(drives, command, t, command, speed=np.array([0, 0, 0, 0, 0, 0.1]))
    assert np.abs(simulated.q[:, 5] - HOME[5]).max() > 1e-4
    assert simulated.dq[1, 5] == pytest.approx(0.1, rel=0.2)
    np.testing.assert_allclose(simulated.q[-1], HOME, atol=1e-8)
    # As if the loops pushed joints away: a viscous friction far below zero.
    wild = {"speed": np.full(6, 0.1), "viscous": np.full(6, -5000.0)}
    with pytest.raises(ExecutionError, match="cannot be simulated"):
        simulate(drives, command, t, command, **wild)
