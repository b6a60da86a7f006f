"""Bounds of the travel of joints."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion.derivative_bounds import joint_travel

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


def test_the_bounds_of_travel_apply_to_executed_motions(servo):
    plan = ac.plan(PATH, ARM, LIMITS)
    set_points = ac.compensate(plan, servo, ac.Inverse(), cycle=0.004, arm=ARM)
    plant = ac.ServoPlant(ARM, servo, ARM.limits)
    coarse, fine = (ac.simulate(set_points, plant, resolution=x) for x in (4, 32))
    bound = bound_at(coarse, fine.t)
    assert (np.abs(np.diff(fine.q, axis=0)) <= np.diff(bound, axis=0) + 1e-12).all()
