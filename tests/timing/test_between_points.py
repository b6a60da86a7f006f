"""Hard cases of the guarantee between grid points, each once a real violation or a near miss."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.constraints import Constraint, Disc, JointVelocity
from armcontour.timing.grid import grid_through
from armcontour.timing.optimal import plan_optimal


class TwoJoints:
    """As much of an arm as planning a joint path needs."""

    dof = 2
    limits_hint = ""


def bent_path(low: float, high: float, lead: float, width: float) -> ac.JointPath:
    """Joint 1 goes at slope `low`, up to `high` and down again with a kink, and on at `low`."""
    lengths = [lead, width, width, lead]
    slopes = [(low, low), (low, high), (high, low), (low, low)]
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    coefficients = np.zeros((4, 6, 2))
    q = 0.0
    for k, (length, (first, last)) in enumerate(zip(lengths, slopes, strict=True)):
        coefficients[k, 0, 0] = q
        coefficients[k, 1, 0] = first * length
        coefficients[k, 2, 0] = (last - first) * length / 2
        q += (first + last) / 2 * length
    coefficients[:, 0, 1] = 0.1 * breaks[:-1]
    coefficients[:, 1, 1] = 0.1 * np.diff(breaks)
    return ac.JointPath(breaks=breaks, coefficients=coefficients)


def largest(trajectory: ac.Trajectory, order: int) -> np.ndarray:
    """Largest amounts at 50 random places of every interval and at its ends."""
    (law,) = trajectory.laws
    share = np.random.default_rng(0).random((len(law.breaks) - 1, 50))
    share = np.concatenate([share, np.zeros((len(share), 1)), np.ones((len(share), 1))], axis=1)
    t = law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * share
    i = np.repeat(np.arange(len(share)), share.shape[1])
    return np.abs(law.on_interval(i, t.ravel(), order)).max(axis=0)


@pytest.mark.parametrize("intervals", [20, 40, 400, 4000])
@pytest.mark.parametrize(("lead", "width", "acceleration"), [(3, 0.2, 0.5), (30, 0.2, 0.05)])
def test_a_velocity_limit_holds_beside_a_kink(lead, width, acceleration, intervals):
    limits = ac.Limits(joint_velocity=[1.0, 1.0], joint_acceleration=[acceleration, 50.0])
    path = bent_path(1.0, 2.0, lead, width)
    planned = plan_optimal(path, TwoJoints(), limits, intervals=intervals)
    assert largest(planned, 1)[0] <= 1 + 1e-9
    assert largest(planned, 2)[0] <= acceleration * (1 + 1e-9)


def test_between_two_rests_there_is_room_to_move():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.5)])
    limits = ac.Limits(joint_acceleration=[1.0, 1.0])
    planned = plan_optimal(path, TwoJoints(), limits, grid=np.array([0.0, path.length]))
    assert planned.duration == pytest.approx(2.0)
    assert len(grid_through(path, np.array([0.0]))) == 2


class Round(Constraint):
    """|dds| and curvature within a disc."""

    name = "mine"

    def disc(self, grid, path, bounds):
        return Disc(np.zeros((2, len(grid))), np.full(len(grid), 0.5))

    def largest_u(self, grid, path, x):
        return np.full(len(grid), 0.5)


def test_one_disc_limits_and_a_second_is_refused():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    limits = ac.Limits(joint_velocity=[10.0, 10.0])
    planned = plan_optimal(path, TwoJoints(), limits, constraints=[Round()])
    assert planned.duration == pytest.approx(2 * np.sqrt(1 / 0.5), rel=1e-6)
    with pytest.raises(ac.InvalidInput, match="one round constraint.*mine"):
        plan_optimal(path, TwoJoints(), limits, constraints=[Round(), Round()])


def test_a_constraint_that_limits_nothing_says_so():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    with pytest.raises(ac.InvalidInput, match="Nothing limits the acceleration"):
        plan_optimal(
            path, TwoJoints(), ac.Limits(), constraints=[JointVelocity(np.array([1.0, 1.0]))]
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"intervals": 1}, "intervals must be a whole number from 2"),
        ({"intervals": 0}, "intervals must be a whole number"),
        ({"intervals": 2.5}, "intervals must be a whole number"),
        ({"intervals": np.nan}, "intervals must be finite"),
        ({"grid": []}, "Grid points must be one row"),
        ({"grid": [0.0, 9.0]}, "Grid points must be one row"),
        ({"start_speed": -0.05}, "start_speed must not be negative"),
        ({"end_speed": np.inf}, "end_speed must be finite"),
    ],
)
def test_refused_options(options, words):
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    limits = ac.Limits(joint_acceleration=[1.0, 1.0])
    with pytest.raises(ac.InvalidInput, match=words):
        plan_optimal(path, TwoJoints(), limits, **options)


@pytest.mark.parametrize("chords", [500, 5000])
def test_a_circle_of_many_chords_takes_as_long_as_a_circle(chords):
    arm = ac.load_arm("pmk3s")
    turn = np.linspace(0, 2 * np.pi, chords + 1)
    points = np.column_stack([0.36 + 0.06 * np.cos(turn), 0.2 + 0.06 * np.sin(turn)])
    rounded = ac.round_corners(ac.Path.polyline(points), tolerance=1e-5)
    assert rounded.lengths.min() > 1e-12
    limits = arm.limits.replace(speed=0.15)
    circle = ac.Path.from_segments([ac.Arc(start=(0.42, 0.2), center=(0.36, 0.2), angle=2 * np.pi)])
    expected = ac.plan(circle, arm, limits).duration
    assert ac.plan(rounded, arm, limits).duration == pytest.approx(expected, rel=2e-3)


@pytest.fixture(scope="module")
def curved(arm):
    """A path whose curvature varies along its pieces, and the limits that it was shaped for."""
    limits = arm.limits.replace(tool_acceleration=0.3)
    objective = ac.Path.polyline([(0.3, 0.15), (0.4, 0.15), (0.4, 0.25)])
    return ac.shape(objective, arm, limits, tolerance=5e-3, iterations=5), limits


@pytest.mark.parametrize("intervals", [100, 1000])
def test_the_tool_acceleration_holds_where_the_curvature_varies_along_a_piece(
    arm, curved, intervals
):
    path, limits = curved
    (law,) = ac.plan(path, arm, limits, intervals=intervals).laws
    share = np.random.default_rng(0).random((len(law.breaks) - 1, 50))
    t = law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * np.insert(share, 0, 0, axis=1)
    i = np.repeat(np.arange(len(share)), 51)
    q, dq, ddq = (law.on_interval(i, t.ravel(), x) for x in range(3))
    used = np.linalg.norm(arm.tool_acceleration(q, dq, ddq), axis=1) / limits.tool_acceleration
    assert used.max() <= 1 + 1e-9
    # At the corner, where the curvature varies the most, hardly anything is left unused.
    assert used.max() > 0.9995
