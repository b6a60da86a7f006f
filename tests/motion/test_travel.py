"""Bounds of the travel of joints."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import PathLaw, Trajectory
from armcontour.motion.derivative_bounds import joint_travel, travel_in_parts
from armcontour.motion.laws import Rates

ARM = ac.load_arm("pmk3s")
LIMITS = ARM.limits.replace(speed=0.1)
PATH = ac.round_corners(ac.Path.polyline([[0.35, 0.1], [0.41, 0.15], [0.28, 0.3]]), tolerance=0.005)


def bound_at(motion, t):
    times, travel = joint_travel(motion)
    return np.stack([np.interp(t, times, x) for x in travel.T], axis=1)


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
def test_no_joint_moves_farther_than_the_bound_of_its_travel():
    for limits, options in (
        ({}, ac.Optimal()),
        ({"centripetal_acceleration": 0.09}, ac.Paper()),
        ({}, ac.Conventional()),
        ({"joint_jerk": 50.0}, ac.Optimal()),
    ):
        line = ac.Path.polyline([[0.35, 0.1], [0.41, 0.15]])
        path = line if options.method == "conventional" else PATH
        motion = ac.plan(path, ARM, LIMITS.replace(**limits), options)
        t, travel = joint_travel(motion)
        assert t[0] == 0.0 and t[-1] == pytest.approx(motion.duration)
        dense = np.linspace(0.0, motion.duration, 20_001)
        moved = np.abs(np.diff(motion(dense), axis=0))
        assert (moved <= np.diff(bound_at(motion, dense), axis=0) + 1e-12).all(), (limits, options)
        # The bound is useful: not more than twice the true way.
        assert (travel[-1] < 2 * moved.sum(axis=0)).all(), (limits, options)


@pytest.mark.parametrize("name", ["slope", "jerk"])
@pytest.mark.parametrize("rounding", [-1e-13, -1e-9, 0.0, 1e-13])
def test_rounding_of_a_uniform_path_acceleration_does_not_raise_the_bound(name, rounding):
    # Rounding makes a parabola of the speed, whose peak is far behind the end of the law.
    joint_path = ac.trace(ac.Path.polyline([[0.35, 0.1], [0.41, 0.15]]), ARM)
    speed = 0.05
    acceleration = 1.9
    root = np.sqrt(speed**2 + 2 * acceleration * joint_path.length)
    duration = (root - speed) / acceleration
    values = {"ds": speed, "dds": acceleration, "slope": 0.0, "jerk": 0.0, name: rounding}
    rates = Rates(**{key: np.array([x]) for key, x in values.items()})
    ends = {"breaks": np.array([0.0, duration]), "s": np.array([0.0, joint_path.length])}
    motion = Trajectory(laws=(PathLaw(joint_path=joint_path, rates=rates, **ends),), method="test")
    dense = np.linspace(0.0, duration, 20_001)
    moved = np.abs(np.diff(motion(dense), axis=0))
    assert (moved <= np.diff(bound_at(motion, dense), axis=0) + 1e-12).all()
    # In a single interval, the largest speed applies to the whole duration.
    fastest = np.abs(motion(dense, 1)).max(axis=0) * duration
    assert (joint_travel(motion)[1][-1] < 1.2 * fastest).all()


def test_the_bounds_of_travel_apply_to_executed_motions(servo):
    plan = ac.plan(PATH, ARM, LIMITS)
    set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=0.004, arm=ARM)
    plant = ac.ServoPlant(ARM, servo, ARM.limits)
    coarse, fine = (ac.simulate(set_points, plant, resolution=x) for x in (4, 32))
    bound = bound_at(coarse, fine.t)
    assert (np.abs(np.diff(fine.q, axis=0)) <= np.diff(bound, axis=0) + 1e-12).all()


@pytest.mark.parametrize("size", [1, 50, 333, 100_000])
def test_travel_in_parts_is_that_of_the_whole_motion(size):
    # Parts begin and end within laws, and have several laws.
    squares = [ac.Path.polyline([[x, 0.1], [x + 0.01, 0.1], [x + 0.01, 0.12]]) for x in (0.35, 0.4)]
    program = ac.Program(moves=tuple(ac.Contour(path=x) for x in squares))
    motion = ac.plan(program, ARM, LIMITS, ac.Optimal(intervals=60))
    assert len(motion.laws) > 2
    times, travel = joint_travel(motion)
    first = 0
    for t, since_start in travel_in_parts(motion, size):
        last = first + len(t) - 1
        np.testing.assert_array_equal(t, times[first : last + 1])
        expected = travel[first : last + 1] - travel[first]
        np.testing.assert_allclose(since_start, expected, rtol=1e-12, atol=1e-12)
        assert len(t) - 1 == min(size, len(times) - 1 - first)
        first = last
    assert first == len(times) - 1
