"""Joint paths along lines whose dq_ds is very uneven: closed forms, shapes, and limits."""

import numpy as np
import pytest
from tests.oracle.one_joint import draw, find_turns, limits_of, shortest_time

import armcontour as ac
from armcontour.planning.constraints import Constraint

# Share of the shortest time by which a plan may be longer.
LONGEST = 1e-3


@pytest.mark.parametrize("rough", [True, False])
def test_one_joint_takes_its_shortest_time(rough):
    for seed in range(20):
        path, velocity, acceleration = draw(seed, rough=rough)
        planned = ac.plan(path, limits=limits_of(velocity, acceleration))
        loss = planned.duration / shortest_time(path, velocity, acceleration) - 1
        assert -1e-9 <= loss <= LONGEST, (seed, loss)


def test_the_joint_turns_back_where_its_path_does(worst_ratios):
    path, velocity, acceleration = draw(6, rough=True)
    limits = limits_of(velocity, acceleration)
    planned = ac.plan(path, limits=limits)
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9
    q = planned(np.linspace(0, planned.duration, 200_001))[:, 0]
    turns = find_turns(path)
    assert len(turns) > 3
    np.testing.assert_allclose(q[[0, -1]], [turns[0], turns[-1]], atol=1e-12)
    for turn in turns:
        assert np.abs(q - turn).min() < 1e-6
    way = np.abs(np.diff(q)).sum()
    assert way == pytest.approx(np.abs(np.diff(turns)).sum(), rel=1e-6)


def test_a_jerk_limit_costs_little_where_the_joint_turns_back():
    path, velocity, acceleration = draw(1, rough=True)
    limits = limits_of(velocity, acceleration).replace(joint_jerk=1000.0)
    planned = ac.plan(path, limits=limits)
    assert planned.duration < 1.005 * shortest_time(path, velocity, acceleration)
    times = np.linspace(0, planned.duration, 20_001)
    assert np.abs(planned(times, 3)).max() <= 1000.0 * (1 + 1e-9)


def test_joints_that_move_together_on_an_uneven_line_take_the_time_of_the_slowest():
    path, _, _ = draw(5, rough=True)
    ways = np.array([0.5, -1.0, 0.7])
    together = ac.JointPath(breaks=path.breaks, coefficients=path.coefficients * ways)
    limits = ac.Limits(joint_velocity=2.0, joint_acceleration=3.0)
    planned = ac.plan(together, limits=limits)
    best = shortest_time(path, (-2.0, 2.0), (-3.0, 3.0))
    assert planned.duration == pytest.approx(best, rel=LONGEST)


def uneven_line_into_a_bend():
    """An uneven line of two joints that turns back twice, and a bend that goes on from its end."""
    line, _, _ = draw(3, rough=True)
    direction = np.array([0.6, 0.8])
    coefficients = line.coefficients * direction
    end = line.breaks[-1]
    into = (line(end)[0] * direction, line(end, 1)[0] * direction, line(end, 2)[0] * direction)
    begin = [x[None] for x in into]
    target = [np.array([[1.0, -0.5]]), np.array([[1.0, 0.3]]), np.zeros((1, 2))]
    bend = ac.JointPath.hermite(np.array([end, end + 1.0]), tuple(begin), tuple(target))
    return ac.JointPath(
        breaks=[*line.breaks, end + 1.0],
        coefficients=np.concatenate([coefficients, bend.coefficients]),
    )


def test_a_line_into_a_bend_keeps_its_points(worst_ratios):
    path = uneven_line_into_a_bend()
    limits = ac.Limits(joint_velocity=2.0, joint_acceleration=3.0)
    planned = ac.plan(path, limits=limits)
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9
    q = planned(np.linspace(0, planned.duration, 100_001))
    np.testing.assert_allclose(q[-1], path(path.breaks[-1]), atol=1e-12)
    corner = path(path.breaks[-2])
    assert np.linalg.norm(q - corner, axis=1).min() < 1e-3


def test_constraints_of_the_caller_see_the_given_parameter():
    path, velocity, acceleration = draw(6, rough=True)
    lengths = []

    class Watch(Constraint):
        def discretize(self, path):
            lengths.append(path.grid.joint_path.length)
            return ()

    ac.plan(
        path,
        limits=limits_of(velocity, acceleration),
        options=ac.Optimal(constraints=(Watch(),)),
    )
    assert set(lengths) == {path.length}
