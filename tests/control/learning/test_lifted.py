"""The lifted model against dense least squares."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import armcontour as ac
from armcontour.control.learning import banded_conditions
from armcontour.control.learning.lifted_model import Lifted, Nominal
from armcontour.motion import SetPoints


def rods():
    """A planar arm without masses."""
    limits = ac.Limits.only(joint_velocity=[9.0, 9.0], joint_acceleration=[900.0, 900.0])
    return ac.PlanarTwoLink(name="rods", links=(0.25, 0.25), base=0.0, limits=limits)


CYCLE = {"drive_cycle": 4e-3, "velocity_feedforward": 0.6}
SERVOS = {
    "linear": {},
    "step": {"interpolation": "step"},
    "cubic": {"interpolation": "cubic"},
    "cascade": {"ki": [9.0, 0.0], "velocity_feedforward": 0.6, "acceleration_feedforward": 0.4},
    "drive_cycle": {**CYCLE, "acceleration_feedforward": 0.4},
    "first order, cycle": {**CYCLE, "order": ("second", "first"), "kv": [150.0, np.inf]},
    "cascade, cycle": {**CYCLE, "ki": [9.0, 0.0], "acceleration_feedforward": 0.4},
}


@pytest.fixture(scope="module", params=SERVOS)
def lifted(request):
    arm = rods()
    plan = ac.plan(
        ac.JointPath.spline([(0.1, 0.2), (0.4, 0.1)]),
        arm,
        ac.Limits.only(joint_velocity=9.0, joint_acceleration=20.0),
    )
    servo = ac.ServoModel(
        **{"kp": [25.0, 20.0], "kv": 150.0, "dead_time": 3e-3, **SERVOS[request.param]}
    ).for_joints(2)
    count = int(np.ceil(plan.duration / 8e-3)) + 1
    q = np.zeros((count, 2))
    set_points = SetPoints(cycle=8e-3, q=q, trajectory=plan, method="none", start_time=-8e-3)
    return Lifted(set_points, Nominal(arm=arm, servo=servo))


@pytest.fixture(scope="module")
def dense(lifted):
    """The response, column by column, (n dof, count dof)."""
    size = lifted.count * lifted.dof
    units = np.eye(size).reshape(size, lifted.count, lifted.dof)
    return np.stack([lifted.respond(x).ravel() for x in units], axis=1)


def weights(lifted):
    """Square roots of the weights of the times: the last 0.1 s count as 10 s, (n dof,)."""
    return np.repeat(np.where(lifted.t > lifted.t[-1] - 0.1, 100.0, 1.0), 2) ** 0.5


def test_shifted_set_points_shift_the_joints(lifted):
    """All joints rest where their first set-points are, and end where the last ones are."""
    change = np.tile([1e-3, -2e-3], (lifted.count, 1))
    np.testing.assert_allclose(lifted.respond(change), np.tile(change[0], (len(lifted.t), 1)))


def test_the_correction_is_that_of_dense_least_squares(lifted, dense):
    error = np.random.default_rng(1).normal(size=(len(lifted.t), 2)).cumsum(axis=0) * 1e-4
    jump = np.diff(np.eye(lifted.count), axis=0)
    for penalty in (1e-4, 1.0):
        change, response = lifted.correct(error, penalty)
        weighted = weights(lifted)[:, None] * np.column_stack([dense, -error.ravel()])
        rows = np.concatenate([weighted[:, :-1], np.sqrt(penalty) * np.kron(jump, np.eye(2))])
        right = np.concatenate([weighted[:, -1], np.zeros(len(rows) - error.size)])
        expected, *_ = np.linalg.lstsq(rows, right, rcond=None)
        # Rounding errors grow with the weights.
        np.testing.assert_allclose(change.ravel(), expected, atol=1e-7)
        np.testing.assert_allclose(response.ravel(), dense @ expected, atol=1e-7)


def test_the_lifted_model_has_the_expected_response(lifted):
    arm = rods()
    servo = lifted.nominal.servo
    rng = np.random.default_rng(3)
    q = lifted.plan(0.0) + 1e-3 * rng.normal(size=(lifted.count, 2)).cumsum(axis=0)
    set_points = SetPoints(
        cycle=lifted.cycle, q=q, trajectory=lifted.plan, method="x", start_time=lifted.start
    )
    execution = ac.simulate(
        set_points, ac.ServoPlant(arm, servo, saturation="none"), resolution=1e-3
    )
    expected = CubicSpline(execution.t, execution.q)(lifted.t.clip(execution.t[0], execution.t[-1]))
    assert np.abs(expected - lifted.expected(q)).max() < 3e-3 * np.ptp(q)
    # Differences of two motions are exact at the times of the drives' cycles.
    near = 1e-9 if servo.drive_cycle else 2e-2
    more = 1e-3 * rng.normal(size=q.shape).cumsum(axis=0)
    moved = ac.simulate(
        replace(set_points, q=q + more),
        ac.ServoPlant(arm, servo, saturation="none"),
        resolution=1e-3,
    )
    n = min(len(execution.t), len(moved.t))
    rows = np.searchsorted(execution.t[:n] + 1e-9, lifted.t)
    inside = rows < n
    change = (moved.q[:n] - execution.q[:n])[rows[inside]]
    assert np.abs(lifted.respond(more)[inside] - change).max() < near * np.ptp(more)


def test_windows_of_any_length_give_the_same_correction(lifted, monkeypatch):
    """Short windows, whose factors are computed again for each solution."""
    monkeypatch.setattr(banded_conditions, "WINDOW_VALUES", 500)
    monkeypatch.setattr(banded_conditions, "KEPT_VALUES", 0)
    q = np.zeros((lifted.count, 2))
    set_points = SetPoints(
        cycle=lifted.cycle, q=q, trajectory=lifted.plan, method="x", start_time=lifted.start
    )
    divided = Lifted(set_points, lifted.nominal)
    error = 1e-3 * np.sin(np.outer(lifted.t, [40.0, 90.0]))
    for last in (None, np.array([1e-3, np.nan])):
        for values, expected in zip(
            divided.correct(error, 1e-2, last), lifted.correct(error, 1e-2, last), strict=True
        ):
            # Integrators amplify rounding errors.
            np.testing.assert_allclose(values, expected, atol=5e-7)
    likelihoods = [x.negative_log_likelihood(error, 1e-2, 1e-8) for x in (divided, lifted)]
    assert likelihoods[0] == pytest.approx(likelihoods[1], rel=1e-6)


@pytest.mark.parametrize("kp", [20.0, 0.5])
def test_a_correction_takes_little_memory(kp):
    """Also for a slow joint, which rests for long after the last set-point."""
    arm = rods()
    slow = ac.Limits.only(joint_velocity=0.01, joint_acceleration=1.0)
    plan = ac.plan(ac.JointPath.spline([(0.1, 0.2), (0.4, 0.1)]), arm, slow)
    q = np.zeros((int(np.ceil(plan.duration / 8e-3)) + 1, 2))
    set_points = SetPoints(cycle=8e-3, q=q, trajectory=plan, method="none")
    servo = ac.ServoModel(kp=kp, kv=150.0).for_joints(2)
    tracemalloc.start()
    model = Lifted(set_points, Nominal(arm=arm, servo=servo))
    for penalty in (1e-4, 1e-2, 1.0, 1e2):
        model.correct(model.planned, penalty)
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert largest < 800 * model.planned.size


def test_a_motion_that_takes_too_much_memory_is_refused():
    arm = rods()
    plan = ac.plan(ac.JointPath.spline([(0.1, 0.2), (0.4, 0.1)]), arm, arm.limits)
    set_points = SetPoints(cycle=1e-3, q=np.zeros((20, 2)), trajectory=plan, method="none")
    model = Nominal(arm=arm, servo=ac.ServoModel(kp=25.0, kv=150.0).for_joints(2))
    with pytest.raises(ac.InvalidInput) as refused:
        Lifted(set_points, model, times=20_000_000)
    assert refused.value.needed > refused.value.allowed > 1e9
