"""Set-points within limits of commands, judged by numpy.diff, Clarabel and simulations."""

import dataclasses
import json

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp

import armcontour as ac
from armcontour.core.render import number, plain
from armcontour.files import read_job
from armcontour.files.exports import CsvFormat, export, make_table
from armcontour.files.result_folder import to_json
from armcontour.report import render_report

# Limits of libfranka 0.15 for an FR3, rate_limiting.h; velocities of the arm, in its whole ranges.
LIBFRANKA = ac.Limits(
    joint_velocity=[2.0, 1.0, 1.5, 1.25, 3.0, 1.5, 3.0],
    joint_acceleration=10 - 1e-3,
    joint_jerk=5000 - 1e-3,
)
CYCLE = 1e-3
# Gains of franky-sim: kp / kv = 10 1/s at every joint.
SERVO = ac.ServoModel(kp=10.0, order="first")


def largest_shares(q, cycle, limits):
    """Largest differences of set-points between rests, over their limits."""
    q = np.pad(q, ((3, 3), (0, 0)), mode="edge")
    derivative_limits = (limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk)
    return [
        float((np.abs(np.diff(q, k, axis=0)) / cycle**k / limit).max())
        for k, limit in enumerate(derivative_limits, start=1)
        if limit is not None
    ]


def nearest(q, cycle, limits):
    """The nearest set-points by Clarabel, one joint after the other."""
    count = len(q)
    nearest_q = q.copy()
    rows = np.clip(np.arange(-3, count + 3), 0, count - 1)
    repeated = sp.csc_array((np.ones(len(rows)), (np.arange(len(rows)), rows)))
    scale = 1e3
    for j in range(q.shape[1]):
        parts = []
        sides = []
        now = repeated
        for k, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
            now = now[1:] - now[:-1]
            limit = np.broadcast_to(getattr(limits, f"joint_{name}"), q.shape[1])[j] * cycle**k
            for sign in (1.0, -1.0):
                parts.append(sign * now[:, 1:-1] / (limit * scale))
                sides.append(1 - sign * now @ q[:, j] / limit)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        size = sum(map(len, sides))
        solved = clarabel.DefaultSolver(
            sp.eye(count - 2, format="csc"),
            np.zeros(count - 2),
            sp.vstack(parts, format="csc"),
            np.concatenate(sides),
            [clarabel.NonnegativeConeT(size)],
            settings,
        ).solve()
        nearest_q[1:-1, j] += np.array(solved.x) / scale
    return nearest_q


@pytest.fixture(scope="module")
def arm():
    return ac.load_arm("fr3")


def planned(arm, reserve):
    """A square of 0.1 m at 250 mm/s, and its plan with a limit of jerk."""
    q = np.array([0.0, -0.785, 0.0, -2.056, 0.0, 1.771, 0.785])
    corners = np.array([(-1, 0, 0), (0, 0, 0), (0, 1, 0), (-1, 1, 0), (-1, 0, 0)])
    path = ac.Path.polyline(arm.tool_position(q[None])[0] + 0.1 * corners).pointing((0, 0, -1))
    path = ac.round_corners(path, tolerance=5e-4, continuity="curvature")
    limits = arm.limits.replace(speed=0.25, joint_jerk=4500.0)
    return path, ac.plan(path, arm, limits, ac.Optimal(seed=q, reserve=reserve))


@pytest.fixture(scope="module")
def square(arm):
    return planned(arm, 0.05)


def without_limits(plan):
    """The same motion, whose set-points have no limits."""
    return dataclasses.replace(plan, limits=None)


@pytest.fixture(scope="module")
def free(square):
    return ac.compensate(without_limits(square[1]), SERVO, cycle=CYCLE)


@pytest.fixture(scope="module")
def limited(square):
    return ac.compensate(square[1], SERVO, ac.Inverse(command_limits=LIBFRANKA), cycle=CYCLE)


def test_set_points_for_franky_sim_are_within_libfrankas_limits(square, free, limited):
    """Without these limits 44 times the acceleration and 58 times the jerk are needed."""
    plan = square[1]
    assert min(largest_shares(free.q, CYCLE, LIBFRANKA)[1:]) > 30
    assert max(largest_shares(limited.q, CYCLE, LIBFRANKA)) <= 1
    used = [x.max() for x in limited.use.ratios.values()]
    assert used == pytest.approx(largest_shares(limited.q, CYCLE, LIBFRANKA), rel=1e-9)
    # At rest at both ends of the plan.
    ends = plan([0.0, plan.duration])
    np.testing.assert_allclose(limited.q[[0, -1]], ends, atol=1e-9)
    assert "contour error" in str(limited.limit_cost)


# Reserve, duration [s], and contour error, RMS and largest [mm]: docs/guides/compensations.md.
@pytest.mark.parametrize(
    ("reserve", "duration", "rms", "largest"),
    [(0.05, 1.752, 0.271, 1.28), (0.3, 1.817, 0.157, 0.509), (0.5, 1.918, 0.0344, 0.172)],
)
def test_the_stated_error_equals_that_of_the_execution(arm, reserve, duration, rms, largest):
    path, plan = planned(arm, reserve)
    plant = ac.ServoPlant(arm, SERVO, saturation="none")
    set_points = [
        ac.compensate(motion, SERVO, options, cycle=CYCLE)
        for motion, options in (
            (plan, ac.Inverse(command_limits=LIBFRANKA)),
            (without_limits(plan), ac.Inverse()),
            (plan, ac.NoCompensation()),
        )
    ]
    error, exact, plain = (
        ac.evaluate(ac.simulate(x, plant, resolution=CYCLE), path).contour_error for x in set_points
    )
    assert plan.duration == pytest.approx(duration, abs=6e-4)
    assert (error.rms * 1e3, error.max * 1e3) == pytest.approx((rms, largest), rel=0.01)
    cost = set_points[0].limit_cost
    assert (cost.contour_rms, cost.contour_max) == pytest.approx((error.rms, error.max), rel=0.03)
    assert exact.max < 1e-6
    if reserve == 0.05:
        assert (plain.rms * 1e3, plain.max * 1e3) == pytest.approx((2.18, 7.67), rel=0.01)
        used = largest_shares(set_points[1].q, CYCLE, LIBFRANKA)[1:]
        assert used == pytest.approx([44, 58], rel=0.01)
        assert largest_shares(set_points[2].q, CYCLE, LIBFRANKA)[1:] == pytest.approx(
            [0.95, 0.86], rel=0.01
        )


def test_limited_set_points_are_the_nearest_to_the_free_ones(free, limited):
    more = round((free.start_time - limited.start_time) / CYCLE)
    q = np.pad(free.q, ((more, more), (0, 0)), mode="edge")
    np.testing.assert_allclose(limited.q, nearest(q, CYCLE, LIBFRANKA), atol=2e-7)
    deviation = np.abs(limited.q - q).max(axis=0)
    np.testing.assert_allclose(limited.limit_cost.deviation, deviation, atol=1e-12)
    # Joint 7 does not move, and no limit is active.
    np.testing.assert_array_equal(limited.q[:, 6], q[:, 6])


def test_set_points_beyond_a_joint_range_are_moved_to_its_end(square, free):
    """Other limits do not bind, so the nearest set-points are those of numpy.minimum."""
    upper = np.full(7, 3.0)
    upper[5] = (free.q[:, 5].max() + square[1](np.linspace(0, 1.75, 999))[:, 5].max()) / 2
    options = ac.Inverse(command_limits=ac.Limits(joint_upper=upper))
    limited = ac.compensate(without_limits(square[1]), SERVO, options, cycle=CYCLE)
    more = round((free.start_time - limited.start_time) / CYCLE)
    q = np.pad(free.q, ((more, more), (0, 0)), mode="edge")
    assert (q > upper).any() and (limited.q <= upper).all()
    np.testing.assert_allclose(limited.q, np.minimum(q, upper), atol=1e-8)
    np.testing.assert_array_equal(limited.q[:, :5], q[:, :5])


@pytest.mark.parametrize(
    ("limits", "name", "allowed"),
    [
        (ac.Limits(joint_acceleration=5.0, joint_jerk=5000.0), "joint_acceleration", 5.0),
        (ac.Limits(joint_velocity=0.2), "joint_velocity", 0.2),
        (ac.Limits(joint_upper=[3.0, 3.0, 3.0, 0.0, 3.0, 1.1, 3.0]), "joint_upper", 1.1),
        (ac.Limits(joint_jerk=1.0), "joint_jerk", 1.0),
    ],
)
def test_a_plan_above_the_limits_is_refused(square, limits, name, allowed):
    with pytest.raises(ac.CompensationError, match="command_limits") as refusal:
        ac.compensate(square[1], SERVO, ac.Inverse(command_limits=limits), cycle=CYCLE)
    error = refusal.value
    assert error.limit == name and error.allowed == allowed < error.needed
    orders = {"joint_upper": 0, "joint_velocity": 1, "joint_acceleration": 2}
    if name in orders:
        planned = square[1].with_rests(np.array([error.t]), orders[name])[0, error.joint]
        assert abs(planned) == pytest.approx(error.needed, rel=0.1)


def test_written_set_points_are_within_the_limits(limited, arm, tmp_path):
    export(limited, tmp_path / "set_points.csv", CsvFormat(derivatives=0), arm=arm)
    table = np.genfromtxt(tmp_path / "set_points.csv", delimiter=",", skip_header=1)
    assert max(largest_shares(table[:, 1:8], CYCLE, LIBFRANKA)) <= 1
    # By default, a file has what the limits refer to, so that a check of the file agrees.
    export(limited, tmp_path / "default.csv", arm=arm)
    allowed = arm.limits.replace(joint_acceleration=LIBFRANKA.joint_acceleration)
    checked = ac.check(ac.read_trajectory(tmp_path / "default.csv", arm.joint_names), arm, allowed)
    assert checked["joint_acceleration"].ratio == pytest.approx(1, abs=1e-4)
    assert make_table(limited, name="square", derivatives=2).ddq is not None


def test_learning_respects_the_command_limits(square, arm, limited):
    """Of a robot with other gains than its model; lessons without limits exceed them."""
    robot = ac.ServoPlant(arm, SERVO.replace(kp=9.0), saturation="none")
    set_points = limited
    errors = []
    for _ in range(3):
        execution = ac.simulate(set_points, robot, resolution=CYCLE)
        errors.append(ac.evaluate(execution, square[0]).contour_error.rms)
        set_points = ac.learn(set_points, execution, arm=arm, servo=SERVO)
        assert max(largest_shares(set_points.q, CYCLE, LIBFRANKA)) <= 1 + 1e-9
    assert errors[-1] < errors[0]


JOB = """
name: square
arm: fr3
path:
  points: [[0.45, -0.05, 0.4], [0.55, -0.05, 0.4], [0.55, 0.05, 0.4]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 250 mm/s, joint_velocity: 9 rad/s, joint_jerk: 4500 rad/s^3}
corners: {tolerance: 0.5 mm}
servo: {kp: 10 1/s, order: first}
cycle: 1 ms
command_limits: {joint_acceleration: 9.999 rad/s^2, joint_jerk: 4999 rad/s^3}
runs:
  strict: {timing: {reserve: 5 %}}
  wide: {timing: {reserve: 5 %}, command_limits: {joint_acceleration: inf, joint_jerk: 1e7}}
"""


def test_a_job_has_command_limits_and_its_results_state_use_and_cost(tmp_path):
    place = tmp_path / "job.yaml"
    place.write_text(JOB, encoding="utf-8")
    job = read_job(place)
    assert job.runs[1].compensation.command_limits.joint_acceleration is None
    job_result = ac.jobs.run(job)
    strict, wide = job_result.runs.values()
    limits = ac.Limits(joint_acceleration=9.999, joint_jerk=4999.0)
    assert max(largest_shares(strict.set_points.q, CYCLE, limits)) <= 1
    error = strict.evaluation.contour_error
    assert strict.set_points.limit_cost.contour_max == pytest.approx(error.max, rel=0.02)
    cost = number(strict.set_points.limit_cost.contour_max, "m")
    assert any(cost in x for x in strict.warnings)
    assert wide.set_points.limit_cost is None and wide.evaluation.contour_error.max < 1e-6
    runs = json.loads(to_json(plain(job_result.to_data())))["runs"]
    assert runs["strict"]["limit_contour_max"] == strict.set_points.limit_cost.contour_max
    assert max(runs["strict"]["command_use"]["joint_jerk"]) == pytest.approx(1, abs=1e-5)
    assert runs["wide"]["limit_contour_max"] == 0
    assert cost in render_report(job_result)
