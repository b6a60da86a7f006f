"""The inverse of drives that move bodies, against the rigid bodies of MuJoCo."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from benchmarks.ur5e import CORNER, CORNER_ERROR, DOWN, square
from numpy.polynomial import Polynomial

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.motion import Law
from armcontour.robot.nominal_robot import Drives
from armcontour.robot.servo.simulation import command_pieces, sample_command

pytest.importorskip("mujoco")
DURATION = 0.4  # s, of the swing
CYCLE = 4e-3  # s, between set-points
START = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
SIZE = np.array([0.2, -0.1, 0.15, 0.2, 0.0, -0.3])
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
LIMITS = ac.Limits(joint_velocity=3.14, joint_acceleration=6.4, speed=0.25)


class Swing(Law):
    """A swing of five joints of six, with velocity, acceleration and jerk 0 at both ends."""

    breaks = np.array([0.0, DURATION])

    def on_interval(self, i, t, order):
        s = Polynomial([0, 0, 0, 0, 35, -84, 70, -20]).deriv(order)(t / DURATION)
        return (START if order == 0 else 0.0) + s[:, None] / DURATION**order * SIZE


SWING = ac.Trajectory(laws=(Swing(),), method="hand")


@pytest.fixture(scope="module")
def light():
    """Without inertia of the drives."""
    return ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def heavy(light):
    """With the inertia of the drives that MuJoCo Menagerie gives the arm."""
    return with_chain(light, armature=np.full(6, 0.1))


def with_chain(arm, **changes):
    return ac.SerialArm(name=arm.name, chain=arm.chain.replace(**changes), limits=arm.limits)


def compensate(plan, arm, servo=SERVO, cycle=CYCLE, **options):
    """Set-points without limits."""
    free = dataclasses.replace(plan, limits=None)
    return ac.compensate(free, servo, ac.InverseDynamics(**options), arm=arm, cycle=cycle)


def strong(arm, servo=SERVO, **options):
    """A plant whose drives do not saturate."""
    return ac.RigidBodyPlant(arm, servo, ac.Limits(joint_torque=1e4), **options)


def largest_deviation(arm, servo=SERVO, plan=SWING, plant=None, **options):
    """Largest distance of a joint from the plan, at any time until rest."""
    plant = plant or strong(arm, servo)
    execution = ac.simulate(compensate(plan, arm, servo, **options), plant)
    return np.abs(execution.q - plan(execution.t.clip(0, plan.duration))).max()


def contour_error(arm, rounded, plan, cycle=CYCLE):
    """RMS and largest contour error on rigid bodies [mm]."""
    plant = ac.RigidBodyPlant(arm, SERVO)
    execution = ac.simulate(compensate(plan, arm, cycle=cycle), plant, resolution=1e-3)
    error = ac.evaluate(execution, rounded).contour_error
    return error.rms * 1e3, error.max * 1e3


@pytest.fixture(scope="module")
def corners():
    return ac.round_corners(square(), tolerance=CORNER_ERROR, continuity="curvature")


@pytest.fixture(scope="module")
def fast(light, corners):
    """The square's plan, which no inertia changes as its limits are of acceleration."""
    plan = ac.plan(corners, light, LIMITS.replace(joint_jerk=640.0))
    assert plan.duration < 1.94
    return plan


@pytest.mark.parametrize(
    ("armature", "cycle", "rms", "largest"),
    [(0.1, 4e-3, 6e-4, 0.003), (0.0, 4e-3, 1e-3, 0.005), (0.0, 1e-3, 8e-4, 0.003)],
)
def test_a_square_at_full_speed_has_a_small_contour_error(
    light, corners, fast, armature, cycle, rms, largest
):
    """The servo's own inverse has 0.138 / 0.410 mm with inertias of drives, and more without."""
    arm = with_chain(light, armature=np.full(6, armature))
    errors = contour_error(arm, corners, fast, cycle)
    assert errors[0] < rms and errors[1] < largest


def test_the_papers_job_and_a_short_line_have_small_contour_errors(arm, rounded, limits, light):
    """The servo's own inverse has 0.017 / 0.032 mm."""
    plan = ac.plan(rounded, arm, limits)
    assert plan.duration < 5.33
    errors = contour_error(arm, rounded, plan)
    assert errors[0] < 2e-4 and errors[1] < 1e-3
    path = ac.Path.polyline([CORNER, (0.5, 0.08, 0.2)]).oriented(DOWN)
    plan = ac.plan(path, light, LIMITS.replace(joint_jerk=320.0))
    assert contour_error(light, path, plan)[0] < 0.001


def test_means_of_the_commands_equal_those_of_the_exact_command(heavy):
    """Means weighted by a triangle about every set-point, from sums over dense times.

    Simpson's rule is exact for lines only; of a cubic it leaves a share.
    """
    x = np.linspace(-1, 1, 401)
    weight = (1 - np.abs(x)) / (1 - np.abs(x)).sum()
    for interpolation, remainder in (("linear", 0.05), ("cubic", 0.25)):
        servo = SERVO.replace(interpolation=interpolation).for_joints(6)
        set_points = compensate(SWING, heavy, servo, cycle=0.02)
        drives = Drives(arm=heavy, servo=servo)
        pieces = command_pieces(set_points.q, 0.02, interpolation).plain
        for k in range(2, len(set_points.q) - 2):
            t = set_points.t[k] + 0.02 * x
            exact = drives.command(SWING(t), SWING(t, 1), SWING(t, 2))
            sampled = sample_command(pieces, 0.02, np.zeros(6), t - set_points.start_time)
            points = drives.command(*(SWING([set_points.t[k]], order) for order in range(3)))
            gap = np.abs(weight @ (sampled - exact)).max()
            assert gap < 2e-5
            # Which set-points at the exact command's values do not have.
            assert k != 5 or gap < remainder * np.abs(points - set_points.q[k]).max()
    servo = SERVO.replace(interpolation="step").for_joints(6)
    set_points = compensate(SWING, heavy, servo, cycle=0.02)
    drives = Drives(arm=heavy, servo=servo)
    for k in (4, 8, 13):
        t = set_points.t[k] + np.linspace(0, 0.02, 401)
        exact = drives.command(SWING(t), SWING(t, 1), SWING(t, 2))
        np.testing.assert_allclose(set_points.q[k], exact.mean(axis=0), atol=1e-5)


def test_the_sagging_arm_rests_at_the_planned_positions_at_both_ends(heavy):
    loaded = with_chain(heavy, payload=ac.Payload(mass=3.0, center=(0.02, 0.0, 0.1)))
    plant = strong(loaded, gravity_feedforward=False)
    set_points = compensate(SWING, loaded, gravity_feedforward=False)
    assert (
        np.abs(set_points.q[0] - START).max() > 1e-3 < np.abs(set_points.q[-1] - START - SIZE).max()
    )
    execution = ac.simulate(set_points, plant)
    np.testing.assert_allclose(execution.q[0], START, atol=1e-9)
    np.testing.assert_allclose(execution.q[-1], START + SIZE, atol=1e-6)
    assert np.abs(execution.q - SWING(execution.t.clip(0, DURATION))).max() < 3e-5
    fed = compensate(SWING, loaded)
    np.testing.assert_array_equal(fed.q[[0, -1]], [START, SWING([DURATION], side="left")[0]])


@pytest.mark.parametrize("interpolation", ["linear", "step", "cubic"])
@pytest.mark.parametrize("feed", [0.0, 0.8])
@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize(("friction", "share"), [(0.0, 1.1), (3.0, 1.6)])
def test_drives_with_integrators_are_compensated_exactly(
    heavy, interpolation, feed, gravity, friction, share
):
    """There is no sag either, and what is cut off of the transient is bounded.

    The drives' cycle is left, of which viscous friction damps more where there is no integrator.
    """
    rough = with_chain(heavy, coulomb=np.full(6, friction), viscous=np.full(6, 2 * friction))
    errors = []
    for ki in (0.0, [8.0, 20.0, 8.0, 3.0, 8.0, 30.0]):
        servo = SERVO.replace(
            ki=ki, interpolation=interpolation, velocity_feedforward=feed, dead_time=2.5e-3
        )
        set_points = compensate(SWING, rough, servo, gravity_feedforward=gravity)
        execution = ac.simulate(set_points, strong(rough, servo, gravity_feedforward=gravity))
        error = np.abs(execution.q - SWING(execution.t.clip(0, DURATION)))
        errors.append(error[execution.t < DURATION].max())
    assert errors[1] < share * errors[0]
    np.testing.assert_allclose(set_points.q[[0, -1]], [START, START + SIZE], atol=1e-12)
    assert 1e-4 < set_points.truncated.max()
    assert (error[execution.t >= DURATION].max(axis=0) < set_points.truncated + 2 * errors[0]).all()


def test_set_points_compensate_a_payload_that_the_controller_does_not_know(heavy):
    loaded = with_chain(heavy, payload=ac.Payload(mass=2.0, center=(0.02, 0.0, 0.1)))
    plant = strong(loaded, controller=heavy)
    assert (
        largest_deviation(loaded, plant=plant, controller=heavy)
        < 3e-5
        < 1e-3
        < largest_deviation(loaded, plant=plant)
    )


def test_friction_is_compensated_but_not_at_rest(heavy):
    coulomb, viscous = np.array([[6.0, 6.0, 4.0, 1.5, 1.5, 1.5], [8.0, 8.0, 5.0, 2.0, 2.0, 2.0]])
    rough = with_chain(heavy, coulomb=coulomb, viscous=viscous)
    plant = strong(rough)
    assert largest_deviation(rough) < 3e-5 < 5e-4 < largest_deviation(heavy, plant=plant)
    set_points = compensate(SWING, rough)
    smooth_one = compensate(SWING, heavy)
    # Joint 5 stays at rest in the plan: no term of friction pushes it.
    np.testing.assert_allclose(set_points.q[:, 4], smooth_one.q[:, 4], atol=1e-15)
    np.testing.assert_array_equal(set_points.q[[0, -1]], smooth_one.q[[0, -1]])


def test_unsupported_plans_arms_and_servos_are_refused(light, refuses):
    rods = ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=ac.Limits())
    path = ac.JointPath.spline([(0.1, 0.2), (0.4, 0.6)])
    plan = ac.plan(path, rods, ac.Limits(joint_velocity=1.0, joint_acceleration=9.0))
    first = ac.ServoModel(kp=25.0, order="first")
    for call, words in (
        (partial(compensate, SWING, None), "requires an arm with masses"),
        (partial(compensate, SWING, light, first), "order second"),
        (partial(compensate, SWING, light, poles=[-1.0, -1.0, -1.0]), "poles"),
        (partial(compensate, SWING, rods), "rods has 2 joints"),
        (partial(compensate, plan, rods), "masses of the arm rods"),
    ):
        refuses(call, ac.InvalidInput, words)
    for method in ("none", "inverse", "pole_placement"):
        first, second = (
            ac.compensate(SWING, SERVO, COMPENSATIONS[method](), arm=x).q for x in (None, light)
        )
        np.testing.assert_array_equal(first, second)
