"""Command and response of the nominal robot, compared with MuJoCo."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import SetPoints
from armcontour.robot.nominal_robot import Drives, respond_along
from armcontour.robot.servo.simulation import command_pieces, command_weights, sample_command

pytest.importorskip("mujoco")
CYCLE = 4e-3
T = np.arange(0, 1.0, CYCLE)
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
CASCADE = SERVO.replace(ki=[9.0, 0.0, 4.0, 20.0, 9.0, 9.0])
STRONG = ac.Limits(joint_torque=np.full(6, 1e4))
# A change of the set-points by up to 1e-4 rad.
CHANGE = 1e-4 * np.sin(np.outer(T, 10.0 * np.arange(1, 7))) * np.sin(np.pi * T)[:, None]


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("ur5e")


def swing(t, order):
    """Smooth joint motions from rest to rest in 0.8 s, each joint by another angle."""
    x = np.clip(t / 0.8, 0.0, 1.0)[:, None]
    shape = (
        35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7,
        (140 * x**3 - 420 * x**4 + 420 * x**5 - 140 * x**6) / 0.8,
        (420 * x**2 - 1680 * x**3 + 2100 * x**4 - 840 * x**5) / 0.8**2,
    )
    begin = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
    return begin * (order == 0) + 0.1 * np.arange(1, 7) * shape[order]


def simulate(q, plant, arm):
    plan = ac.plan(ac.JointPath.spline([swing(np.zeros(1), 0)[0], swing(np.ones(1), 0)[0]]), arm)
    set_points = SetPoints(cycle=CYCLE, q=q, trajectory=plan, method="none")
    return ac.simulate(set_points, plant)


def regular_times(end):
    return np.linspace(0.0, end, int(np.ceil(end / 1e-3 * (1 - 1e-12))) + 1)


def solved(response, command):
    """Deviations of the joints under a command at the drives [rad], (n, dof)."""
    left, seen, _ = response.equations()
    width = left.shape[1]
    x = np.zeros(command.shape)
    for k in range(len(x)):
        rows = np.maximum(np.arange(k - width + 1, k + 1), 0)
        torque = (seen[k] * command[rows]).sum(axis=0)
        torque -= np.einsum("sab,sb->a", left[k, :-1], x[rows[:-1]])
        x[k] = np.linalg.solve(left[k, -1], torque)
    return x


def command_at(q, t, servo=SERVO):
    """The command that set-points give, by weights."""
    index, weight = command_weights(len(q), CYCLE, servo.interpolation, t)
    return np.einsum("nk,nkj->nj", weight, q[index])


def rods():
    """A planar arm without masses."""
    limits = ac.Limits(joint_velocity=[9.0, 9.0], joint_acceleration=[900.0, 900.0])
    return ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)


def test_the_nominal_inertia_equals_that_of_the_plant():
    loaded = ac.load_arm("ur5e", payload=ac.Payload(mass=3.0))
    inertia = ac.RigidBodyPlant(loaded, SERVO).nominal_inertia
    np.testing.assert_allclose(Drives(arm=loaded, servo=SERVO).inertia, inertia, rtol=1e-12)
    assert (Drives(arm=loaded, servo=SERVO.replace(inertia=2.0)).inertia == 2.0).all()


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("servo", [SERVO, CASCADE])
def test_the_computed_command_moves_the_plant_along_the_plan(arm, gravity, servo):
    """All errors left come from the set-points' lines and the drives' cycle: quadratic, linear."""
    drives = Drives(arm=arm, servo=servo, gravity_feedforward=gravity)
    q = drives.command(*(swing(T, order) for order in range(3)), CYCLE)
    plant = ac.RigidBodyPlant(arm, servo, STRONG, gravity_feedforward=gravity, step=5e-5)
    done = simulate(q, plant, arm)
    plain = simulate(swing(T, 0), plant, arm)
    # Integrators are not empty after the last set-point.
    error, reference_error = (np.abs(x.q - swing(x.t, 0))[x.t < T[-1]].max() for x in (done, plain))
    assert error < 3e-5 and error < 1e-3 * reference_error


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("servo", [SERVO, CASCADE])
def test_the_predicted_response_equals_that_of_the_plant(arm, gravity, servo):
    """The plant's drives hold torques for a step."""
    drives = Drives(arm=arm, servo=servo, gravity_feedforward=gravity)
    plant = ac.RigidBodyPlant(arm, servo, STRONG, gravity_feedforward=gravity)
    q = drives.command(*(swing(T, order) for order in range(3)), CYCLE)
    first, second = (simulate(x, plant, arm) for x in (q, q + CHANGE))
    n = min(len(first.t), len(second.t))
    change = second.q[:n] - first.q[:n]
    times = regular_times(first.t[n - 1])
    response = respond_along(swing, times, arm, servo, gravity_feedforward=gravity)
    expected = solved(response, command_at(CHANGE, times))
    assert np.abs(change - expected).max() < 3e-3 * np.abs(change).max()


def test_command_and_response_include_a_payload_unknown_to_the_controller(arm):
    """Command and response of a loaded arm, whose controller holds and scales for the bare one."""
    loaded = ac.load_arm("ur5e", payload=ac.Payload(mass=2.0))
    drives = Drives(arm=loaded, servo=SERVO, controller=arm)
    assert (drives.inertia == Drives(arm=arm, servo=SERVO).inertia).all()
    q = drives.command(*(swing(T, order) for order in range(3)))
    plant = ac.RigidBodyPlant(loaded, SERVO, STRONG, controller=arm, step=1e-4)
    done, moved = (simulate(x, plant, arm) for x in (q, q + CHANGE))
    assert np.abs(done.q - swing(done.t, 0)).max() < 5e-5
    n = min(len(done.t), len(moved.t))
    change = moved.q[:n] - done.q[:n]
    times = regular_times(done.t[n - 1])
    response = respond_along(swing, times, loaded, SERVO, controller=arm)
    expected = solved(response, command_at(CHANGE, times))
    rows = np.searchsorted(done.t[:n], times)
    assert np.abs(change[rows] - expected).max() < 3e-3 * np.abs(change).max()


@pytest.mark.parametrize(
    "options",
    [
        {"kp": 25.0, "kv": 150.0},
        {"kp": 25.0, "order": "first"},
        {"order": "delay"},
        {"kp": [25.0, np.inf], "kv": [150.0, np.inf], "order": ("second", "delay")},
    ],
)
def test_the_response_without_masses_is_that_of_the_servo(options):
    arm = rods()
    servo = ac.ServoModel(**options)
    change = 0.1 * np.sin(np.outer(T, [6.0, 9.0])) * np.sin(np.pi * T)[:, None]
    plan = ac.plan(ac.JointPath.spline([(0.1, 0.2), (0.4, 0.6)]), arm)
    data = SetPoints(cycle=CYCLE, q=change, trajectory=plan, method="none")
    execution = ac.simulate(data, ac.ServoPlant(arm, servo))
    times = regular_times(execution.t[-1])
    response = respond_along(lambda t, order: 0 * t, times, arm, servo)
    q = solved(response, command_at(change, times, servo))
    np.testing.assert_allclose(q, execution.q[: len(times)], atol=2e-5)


def test_the_command_is_the_weighted_sum_of_set_points():
    for kind in ("linear", "step", "cubic"):
        for count in (2, 3, 8):
            rng = np.random.default_rng(count)
            q = rng.normal(size=(count, 1))
            t = np.concatenate([rng.uniform(-0.01, 0.05, 200), np.arange(count) * CYCLE])
            index, weight = command_weights(count, CYCLE, kind, t)
            pieces = command_pieces(q, CYCLE, kind).plain
            expected = sample_command(pieces, CYCLE, np.zeros(1), t)[:, 0]
            commands = (q[index, 0] * weight).sum(axis=1)
            np.testing.assert_allclose(commands, expected, atol=1e-12, err_msg=f"{kind} {count}")


def test_drives_need_a_velocity_loop_and_masses(arm):
    for servo in (
        ac.ServoModel(kp=25.0, order="first"),
        SERVO.replace(friction=1e-3),
        SERVO.replace(drive_cycle=1e-3),
    ):
        with pytest.raises(ac.InvalidInput, match="order second"):
            Drives(arm=arm, servo=servo)
    with pytest.raises(ac.InvalidInput, match="masses"):
        Drives(arm=rods(), servo=SERVO)


def test_rounding_errors_at_rest_cause_no_friction_torque(arm):
    """A joint at rest has velocities of 1e-16 rad/s of either sign; a moving one has friction."""
    rubbing = arm.with_dynamics(coulomb=np.full(6, 5.0), viscous=np.full(6, 2.0))
    speed = np.array([[0.5, -0.5, 1e-16, -1e-16, 0.0, 5e-4]])
    still = np.zeros((1, 6))
    torque, plain = (
        Drives(arm=x, servo=SERVO).moving_torque(swing(np.zeros(1), 0), speed, still)
        for x in (rubbing, arm)
    )
    expected = [[6.0, -6.0, 0.0, 0.0, 0.0, 2.5 + 1e-3]]
    np.testing.assert_allclose(torque - plain, expected, atol=1e-12)
