"""Torque-limited plans of a UR5e: against toppra, judged by MuJoCo with friction.

References are kept in `toppra_durations.json`; two are computed again here.
"""

from collections import namedtuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.oracle.toppra_kept import SAME, recorded_duration

import armcontour as ac
from armcontour.robot.bodies import Payload
from armcontour.robot.serial import SerialArm

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("toppra", reason="toppra has wheels for linux-x86_64 only")

from toppra import SplineInterpolator, setup_logging  # noqa: E402
from toppra.algorithm import TOPPRA  # noqa: E402
from toppra.constraint import DiscretizationType as Scheme  # noqa: E402
from toppra.constraint import JointTorqueConstraint, JointVelocityConstraint  # noqa: E402

setup_logging("CRITICAL")

# Numbers of intervals of toppra's plans: 10 and 2.5 times our 4000.
TEN_TIMES_FINER = 40_000
FINE = 10_000
REFERENCES = [(FINE, seed) for seed in range(12)]
REFERENCES += [(TEN_TIMES_FINER, seed) for seed in (58, 81)]
ALLOWED = 1e-3
# toppra's interpolation plans inside the limits, and so comes down on the optimum from above.
OWN_ERROR = 1e-4
VISCOUS = np.array([12.0, 12.0, 8.0, 2.0, 2.0, 1.0])


# An arm, perhaps with payload and dry friction, joint positions on its way, and limits.
Problem = namedtuple("Problem", "arm points limits")


def problem(seed):
    """Of a UR5e: 3 to 7 joint positions, half of the seeds with Coulomb friction."""
    rng = np.random.default_rng(seed)
    arm = ac.load_arm("ur5e")
    size = np.array([1.0, 1, 1, 0.2, 0.2, 0.2])
    mass = rng.uniform(0, 2)
    center = rng.uniform(-0.05, 0.05, 3)
    inertia = np.diag([0.01, 0.012, 0.015])
    chain = arm.chain.replace(
        payload=Payload(mass=mass, center=center, inertia=inertia),
        coulomb=rng.uniform(0, 5, 6) * size if seed % 2 else np.zeros(6),
        armature=rng.uniform(0, 1, 6) * size,
    )
    limits = ac.Limits.only(
        joint_torque=arm.limits.joint_torque * rng.uniform(0.6, 1, 6),
        joint_velocity=arm.limits.joint_velocity * rng.uniform(0.3, 1, 6),
    )
    points = rng.uniform(-np.pi, np.pi, (int(rng.integers(3, 8)), 6))
    return Problem(SerialArm(name="UR5e", chain=chain, limits=limits), points, limits)


def model_of(chain):
    """A chain as a model of MuJoCo, without its friction."""
    text = close = ""
    for k in range(len(chain)):
        inertia = chain.inertias[k][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        text += (
            f'<body pos="{_words(chain.positions[k])}" quat="{_quat(chain.rotations[k])}">'
            f'<joint axis="{_words(chain.axes[k])}" armature="{float(chain.armature[k])!r}"/>'
            f'<inertial pos="{_words(chain.centers[k])}" mass="{float(chain.masses[k])!r}" '
            f'fullinertia="{_words(inertia)}"/>'
        )
        close += "</body>"
    load = chain.payload
    if load is not None and load.mass:
        text += (
            f'<body pos="{_words(chain.tip.position)}" quat="{_quat(chain.tip.rotation)}">'
            f'<inertial pos="{_words(load.center)}" mass="{load.mass!r}" '
            f'diaginertia="{_words(np.diag(load.inertia))}"/></body>'
        )
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian"/>'
        f'<option gravity="{_words(chain.gravity)}"/><worldbody>{text}{close}</worldbody></mujoco>'
    )


def _words(numbers):
    return " ".join(repr(float(x)) for x in numbers)


def _quat(rotation):
    return _words(Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]])


def inverse_dynamics(chain):
    """Torque of one state by MuJoCo, friction apart."""
    model = model_of(chain)
    data = mujoco.MjData(model)

    def torque(q, dq, ddq):
        data.qpos[:] = q
        data.qvel[:] = dq
        data.qacc[:] = ddq
        mujoco.mj_inverse(model, data)
        return data.qfrc_inverse.copy()

    return torque


def largest_ratios(planned, case, places, seed=0):
    """Torque, by MuJoCo and with friction, and velocity over their limits, at random times.

    At rest, friction takes any value up to Coulomb's: the one that helps most.
    """
    (law,) = planned.laws
    n = len(law.breaks) - 1
    share = np.column_stack([np.zeros(n), np.random.default_rng(seed).random((n, places))])
    t = np.append((law.breaks[:-1, None] + share * np.diff(law.breaks)[:, None]), law.breaks[-1])
    i = np.append(np.repeat(np.arange(n), places + 1), n - 1)
    q, dq, ddq = (law.on_interval(i, t, order) for order in (0, 1, 2))
    chain = case.arm.chain
    solve = inverse_dynamics(chain)
    torque = np.array([solve(*x) for x in zip(q, dq, ddq, strict=True)]) + chain.viscous * dq
    still = np.abs(dq) < 1e-6
    helping = -np.clip(torque, -chain.coulomb, chain.coulomb)
    dry = np.where(still, helping, chain.coulomb * np.sign(dq))
    return {
        "torque": float((np.abs(torque + dry) / case.limits.joint_torque).max()),
        "velocity": float((np.abs(dq) / case.limits.joint_velocity).max()),
    }


def peer(case, intervals):
    """Duration by toppra on that many intervals of a path parameter from 0 to 1."""
    chords = np.linalg.norm(np.diff(case.points, axis=0), axis=1)
    parameter = np.concatenate([[0], np.cumsum(chords)]) / chords.sum()
    path = SplineInterpolator(parameter, case.points, bc_type="natural")
    torque = case.limits.joint_torque
    velocity = case.limits.joint_velocity
    constraints = [
        JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        JointTorqueConstraint(
            inverse_dynamics(case.arm.chain),
            np.column_stack([-torque, torque]),
            case.arm.chain.coulomb,
            Scheme.Interpolation,
        ),
    ]
    how = {"solver_wrapper": "seidel", "parametrizer": "ParametrizeConstAccel"}
    instance = TOPPRA(constraints, path, gridpoints=np.linspace(0, 1, intervals + 1), **how)
    return float(instance.compute_trajectory(0, 0).duration)


def by_toppra(seed, intervals=TEN_TIMES_FINER):
    return peer(problem(seed), intervals)


def compare(seed, reference, places=10):
    """Our duration over toppra's, and the largest ratios of our plan."""
    case = problem(seed)
    planned = ac.plan(ac.JointPath.spline(case.points), case.arm, case.limits)
    return planned.duration / reference, largest_ratios(planned, case, places)


# One without dry friction and one with it.
@pytest.mark.parametrize("seed", [4, 5])
def test_stored_references_equal_the_results_of_toppra(seed):
    assert by_toppra(seed, FINE) == pytest.approx(recorded_duration(FINE, seed), rel=SAME)


@pytest.mark.parametrize(("intervals", "seed"), REFERENCES[:8] + REFERENCES[-2:])
def test_plans_are_as_fast_as_a_fine_reference_and_within_torque(intervals, seed):
    ratio, ratios = compare(seed, recorded_duration(intervals, seed))
    assert 1 - OWN_ERROR < ratio < 1 + ALLOWED
    assert 0.999 < max(ratios.values()) <= 1 + 1e-9


def with_friction(seed):
    case = problem(seed)
    chain = case.arm.chain.replace(viscous=VISCOUS)
    arm = SerialArm(name="dragged", chain=chain, limits=case.limits)
    return Problem(arm, case.points, case.limits)


def test_viscous_friction_is_respected_at_a_small_cost():
    seed = 1
    case = with_friction(seed)
    path = ac.JointPath.spline(case.points)
    planned = ac.plan(path, case.arm, case.limits)
    ratios = largest_ratios(planned, case, 10)
    assert max(ratios.values()) <= 1 + 1e-9
    assert ratios["torque"] > 0.9999
    # The linear bounds of friction cost almost no time.
    finer = ac.plan(path, case.arm, case.limits, ac.Optimal(intervals=40_000))
    assert planned.duration == pytest.approx(finer.duration, rel=2e-4)
    free = ac.plan(path, problem(seed).arm, case.limits)
    assert planned.duration > free.duration
