"""Plans keep the velocity of compensated set-points, where they would exceed it without."""

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.files import parse_job
from armcontour.studio.preview import CoarsePlanner

SQUARE = [[0.40, -0.05, 0.3], [0.50, -0.05, 0.3], [0.50, 0.05, 0.3], [0.40, 0.05, 0.3]]
VELOCITY = [1.98, 0.98, 1.48, 1.23, 2.98, 1.48, 2.98]
FAST = {
    "name": "fast",
    "arm": "fr3",
    "path": {"points": [*SQUARE, SQUARE[0]], "orientation": {"axis": [0, 0, -1]}},
    "corners": {"tolerance": "0.5 mm"},
    "cycle": "1 ms",
    "accuracy": "5 mm",
    "limits": {"speed": 1.0, "joint_velocity": VELOCITY, "joint_acceleration": 7 * [9.99]},
    "command_limits": {"joint_velocity": VELOCITY, "joint_acceleration": 7 * [29.97]},
    "servo": {"kp": "10 1/s", "order": "first"},
    "runs": {
        "none": {"compensation": {"method": "none"}, "timing": {"reserve": "5 %"}},
        "inverse": {"timing": {"reserve": "5 %"}},
    },
}
SLOW = {**FAST["limits"], "speed": 0.1, "joint_acceleration": 7 * [5.0]}
JERK = {"limits": {**FAST["limits"], "joint_jerk": 7 * [4750]}}


def job_of(**changes):
    return parse_job(yaml.safe_dump(data_of(**changes)))


def data_of(**changes):
    return {**FAST, **changes}


def use_of_velocity(result):
    rate = np.diff(result.set_points.q, axis=0) / result.set_points.cycle
    return np.abs(rate / VELOCITY).max()


# With limits of jerk, corners have transitions, in which the limit of acceleration alone costs
# 0.16 mm.
@pytest.mark.parametrize(("changes", "error"), [({}, 0.15e-3), (JERK, 0.16e-3)])
def test_bounded_set_points_of_fast_motion_follow_it(changes, error):
    runs = ac.run(job_of(**changes)).runs
    uncompensated = runs["none"]
    compensated = runs["inverse"]
    # The plan of the run without compensation does not know the set-points of the other.
    assert uncompensated.command_velocity is None
    slower = compensated.trajectory.duration / uncompensated.trajectory.duration
    assert 1.03 < slower <= 1.055
    assert compensated.kept
    assert compensated.evaluation.contour_error.max <= error
    assert use_of_velocity(compensated) <= 1 + 1e-6
    assert compensated.explanation.kinds["command velocity"] > 0.3


def test_bounds_of_set_points_do_not_change_a_plan_within_them():
    runs = ac.run(job_of(limits=SLOW), simulate=False).runs
    assert runs["inverse"].command_velocity is None
    assert runs["inverse"].trajectory is runs["none"].trajectory


def test_smaller_of_both_velocity_limits_counts():
    half = [0.5 * x for x in VELOCITY]
    limits = {**FAST["command_limits"], "joint_velocity": half}
    runs = {"only": {"timing": {"reserve": "5 %"}}}
    result = ac.run(job_of(command_limits=limits, runs=runs), simulate=False).runs["only"]
    assert use_of_velocity(result) == pytest.approx(0.5, rel=1e-6)


def test_preview_depends_on_the_servo_only_where_set_points_reach_their_limit():
    planner = CoarsePlanner()
    faster = {"kp": "12 1/s", "order": "first"}

    def plan(**changes):
        return planner.plan(data_of(**changes), "inverse").trajectory

    # The first plan determines the configuration of the next ones.
    plan()
    assert plan(limits=SLOW) is plan(limits=SLOW, servo=faster)
    bounded = plan()
    assert plan(servo=faster).duration < bounded.duration
    assert plan() is bounded
    free = planner.plan(data_of(), "none").trajectory
    assert free.duration < bounded.duration
