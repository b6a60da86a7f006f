"""Hard cases for limits between grid points; each was a violation or nearly one."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.planning import optimal_timing
from armcontour.planning.constraints import (
    CommandVelocity,
    Constraint,
    JointMotion,
    SecondOrder,
    constraints_of,
)
from armcontour.planning.optimal_timing import plan_optimal
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import A, Rounds


class TwoJoints:
    """As much of an arm as planning a joint path needs."""

    dof = 2
    limits_hint = ""


def bent_path(low, high, lead, width):
    """Joint 1 goes at slope `low`, up to `high` and down again with a kink, and on at `low`."""
    lengths = np.array([lead, width, width, lead])
    first, last = np.array([(low, low), (low, high), (high, low), (low, low)]).T
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    coefficients = np.zeros((4, 6, 2))
    coefficients[1:, 0, 0] = np.cumsum((first + last) / 2 * lengths)[:-1]
    coefficients[:, 1, 0] = first * lengths
    coefficients[:, 2, 0] = (last - first) * lengths / 2
    coefficients[:, 0, 1] = 0.1 * breaks[:-1]
    coefficients[:, 1, 1] = 0.1 * lengths
    return ac.JointPath(breaks=breaks, coefficients=coefficients)


def inside(law):
    """50 random places of every interval and its ends: intervals and times."""
    share = np.random.default_rng(0).random((len(law.breaks) - 1, 52))
    share[:, :2] = 0.0, 1.0
    t = law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * share
    return np.repeat(np.arange(len(share)), 52), t.ravel()


def largest(trajectory, order):
    (law,) = trajectory.laws
    return np.abs(law.on_interval(*inside(law), order)).max(axis=0)


@pytest.mark.parametrize(("lead", "acceleration"), [(3, 0.5), (30, 0.05)])
def test_a_velocity_limit_is_satisfied_next_to_a_kink(lead, acceleration):
    limits = ac.Limits.only(joint_velocity=[1.0, 1.0], joint_acceleration=[acceleration, 50.0])
    path = bent_path(1.0, 2.0, lead, 0.2)
    for intervals in (20, 40, 400, 4000):
        planned = plan_optimal(path, TwoJoints(), limits, ac.Optimal(intervals=intervals))
        assert largest(planned, 1)[0] <= 1 + 1e-9, intervals
        assert largest(planned, 2)[0] <= acceleration * (1 + 1e-9), intervals


@pytest.mark.parametrize("jerk", [None, [60.0, 60.0]])
@pytest.mark.parametrize(("lead", "acceleration"), [(3, 0.5), (30, 0.05)])
@pytest.mark.parametrize("gain", [1.0, 10.0])
def test_velocity_of_set_points_is_bounded_next_to_a_kink(lead, acceleration, gain, jerk):
    limits = ac.Limits.only(joint_acceleration=[acceleration, 50.0])
    if jerk is not None:
        limits = limits.replace(joint_jerk=jerk)
    path = bent_path(1.0, 2.0, lead, 0.2)
    bound = 0.4
    both = np.full(2, bound)
    command = CommandVelocity(np.full(2, 1 / gain), -both, both)
    for intervals in (20, 40, 400, 4000):
        options = ac.Optimal(intervals=intervals, constraints=[command])
        (law,) = plan_optimal(path, TwoJoints(), limits, options).laws
        places = inside(law)
        dq, ddq = (law.on_interval(*places, order) for order in (1, 2))
        largest_velocity = np.abs(dq + ddq / gain).max()
        assert largest_velocity <= bound * (1 + 1e-9), intervals
    assert largest_velocity > 0.99 * bound


def test_an_interval_between_two_rests_is_planned():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.5)])
    limits = ac.Limits.only(joint_acceleration=[1.0, 1.0])
    planned = plan_optimal(path, TwoJoints(), limits, ac.Optimal(intervals=2))
    assert planned.duration == pytest.approx(2.0)


class Round(Constraint):
    """|dds| within a radius."""

    name = "mine"

    def __init__(self, radius):
        self.radius = radius

    def discretize(self, path):
        ends = np.zeros((len(path), 2, 1, 2, 3))
        ends[..., A, 0] = 1.0
        return (Rounds(ends, np.full((len(path), 1), self.radius), np.zeros((len(path), 1, 4))),)


def test_the_smaller_of_two_bounds_limits_the_speed():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    limits = ac.Limits.only(joint_velocity=[10.0, 10.0])
    for radii in ([0.5], [0.5, 0.7]):
        constraints = [Round(x) for x in radii]
        planned = plan_optimal(path, TwoJoints(), limits, ac.Optimal(constraints=constraints))
        assert planned.duration == pytest.approx(2 * np.sqrt(1 / 0.5), rel=1e-6)


WIDTH = 2.0**-5
# Joint 1 moves evenly and then takes off: a limit that ends at the break in the middle jumps there.
EVEN = ac.JointPath(
    breaks=np.array([0.0, 2.0, 4.0]),
    coefficients=np.array(
        [[[0.0], [2.0], [0.0], [0.0], [0.0], [0.0]], [[2.0], [2.0]] + 4 * [[0.0]]]
    ),
)


class Vectors(Constraint):
    """|a u + b x| within 1 until the middle, for vectors a = share 2 w b + off."""

    name = "vectors"

    def __init__(self, share, constant, b=(3.0, 2.0, 0.0)):
        self.b = np.array(b)
        self.a = -2 * WIDTH * share * self.b + np.array([0.0, 0.0, constant])

    def discretize(self, path):
        before = (path.grid.s[:-1] < 2.0).astype(float)[:, None]
        places = np.concatenate(
            [before, before, np.zeros((len(path.places[1]) - 2 * len(path), 1))]
        )
        places[path.after] = before
        return (path.round(places * self.a, places * self.b, 1.0),)


def planned_on(limits, constraint, s):
    """A plan of EVEN with a constraint on the grid points `s`, which is not refined."""
    s = np.union1d(s, EVEN.breaks)
    grid = Grid(EVEN, s, EVEN.locate((s[1:] + s[:-1]) / 2))
    active = [*constraints_of(EVEN, None, limits.for_joints(EVEN.dof)), constraint]
    law = optimal_timing.time_optimal(grid, active, None, 0.0, 0.0, np.inf)
    return ac.Trajectory(laws=(law,), method="optimal")


def near_the_middle(planned):
    """U and x of a plan shortly before its middle, and in all of its first half."""
    end = planned.time_at(2.0)
    t = end - np.concatenate([np.geomspace(1e-9, 0.1, 500) * end, np.linspace(1e-9, 1, 5000) * end])
    return planned.s(t, 2), planned.s(t, 1) ** 2


# Of the interval whose end is the middle, of the one before it, and of its start.
@pytest.mark.parametrize("steps", [1, 2, -1])
@pytest.mark.parametrize("share", [1.0, 1 + 1e-16, 1 - 1e-12, 1 + 1e-12, 1 - 1e-8, 1 + 1e-8])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_limit_is_satisfied_if_its_terms_cancel_at_the_mean(steps, share, sign):
    w = WIDTH * steps

    def coefficients(s, side):
        before = ((s < 2) | ((s == 2) & (side == "left"))).astype(float)[:, None]
        return -2 * w * share * sign * before, sign * before, 0 * before

    bounds = ([-1e3], [1.0]) if sign > 0 else ([-1.0], [1e3])
    limits = ac.Limits.only(joint_acceleration=[10.0])
    grid = np.arange(0, 4 + WIDTH / 2, WIDTH)
    constraint = SecondOrder("own", coefficients, *bounds)
    u, x = near_the_middle(planned_on(limits, constraint, grid))
    assert (-2 * w * share * u + x).max() <= 1 + 1e-9
    assert (-2 * w * share * u + x).max() > 0.99


@pytest.mark.parametrize("constant", [0.0, 1e-16, 1e-12, 1e-8, 1e-5])
@pytest.mark.parametrize("share", [1.0, 1 - 1e-12, 1 + 1e-8, 0.5])
def test_a_vector_limit_is_satisfied_if_its_terms_cancel_at_the_mean(share, constant):
    limits = ac.Limits.only(joint_acceleration=[10.0])
    grid = np.arange(0, 4 + WIDTH / 2, WIDTH)
    constraint = Vectors(share, constant)
    u, x = near_the_middle(planned_on(limits, constraint, grid))
    size = np.linalg.norm(constraint.a * u[:, None] + constraint.b * x[:, None], axis=1)
    assert size.max() <= 1 + 1e-9
    assert size.max() > 0.99


def test_wrong_planning_options_are_refused(refuses):
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    limits = ac.Limits.only(joint_acceleration=1.0)
    for options in (
        *({"intervals": x} for x in (1, 0, 2.5, np.nan)),
        {"start_speed": -0.05},
        {"end_speed": np.inf},
    ):
        refuses(
            lambda x=options: plan_optimal(path, TwoJoints(), limits, ac.Optimal(**x)),
            ac.InvalidInput,
        )
    # A constraint without an effect has no forms.
    more = ac.Optimal(constraints=[JointMotion((-np.ones(2), np.ones(2)))])
    words = "Nothing limits the acceleration"
    refuses(lambda: plan_optimal(path, TwoJoints(), ac.Limits.only(), more), ac.InvalidInput, words)


def test_the_tool_acceleration_is_satisfied_where_the_curvature_varies(arm):
    limits = arm.limits.replace(tool_acceleration=0.3)
    objective = ac.Path.polyline([(0.3, 0.15), (0.4, 0.15), (0.4, 0.25)])
    path = ac.shape(objective, arm, limits, ac.Shaped(tolerance=5e-3, iterations=5))
    for intervals in (100, 1000):
        (law,) = ac.plan(path, arm, limits, ac.Optimal(intervals=intervals)).laws
        state = (law.on_interval(*inside(law), x) for x in range(3))
        used = np.linalg.norm(arm.tool_acceleration(*state), axis=1) / limits.tool_acceleration
        # At the corner, where the curvature varies the most, hardly anything is left unused.
        assert 0.9995 < used.max() <= 1 + 1e-9, intervals
