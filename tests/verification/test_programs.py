"""Programs are evaluated contour by contour."""

from functools import partial

import numpy as np
import pytest
from scipy.integrate import trapezoid

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.program import Contour, Dwell, Lead, Process, Program, Rapid, prepare, round_corners

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
SQUARE = Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14], [0.3, 0.14], [0.3, 0.1]])
BEND = Path.polyline([[0.3, 0.2], [0.35, 0.2], [0.35, 0.25]])
LEADS = Process(lead_in=Lead(length=0.01), lead_out=Lead(length=0.01))
DRAWN = Program(moves=(Contour(path=SQUARE), Dwell(duration=0.2), Contour(path=BEND)))


def executed(program, method="none"):
    trajectory = ac.plan(program, ARM, LIMITS, ac.Optimal(reserve=0.2))
    set_points = ac.compensate(trajectory, SERVO, COMPENSATIONS[method](), cycle=4e-3)
    return ac.simulate(set_points, ac.ServoPlant(ARM, SERVO, LIMITS))


@pytest.fixture(scope="module")
def objective():
    return prepare(DRAWN, LEADS)


@pytest.fixture(scope="module")
def program(objective):
    return round_corners(objective, tolerance=1e-3)


@pytest.fixture(scope="module")
def execution(program):
    return executed(program)


def nearest(path, points):
    """Distances to a path, segment by segment: feet on lines and circles, or the ends."""
    best = np.full(len(points), np.inf)
    for start, tangent, inward, k, length in zip(
        path.starts, path.tangents, path.normals, path.curvatures, path.lengths, strict=True
    ):
        if k == 0:
            foot = start + np.clip((points - start) @ tangent, 0, length)[:, None] * tangent
            best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
            continue
        arm = points - (start + inward / k)
        angle = np.arctan2(arm @ tangent, -arm @ inward) % (2 * np.pi)
        on = np.abs(np.linalg.norm(arm, axis=1) - 1 / k)
        best = np.minimum(best, np.where(angle <= k * length, on, np.inf))
    return best


def test_every_contour_is_evaluated_while_its_process_is_on(execution, program):
    evaluation = ac.evaluate(execution, program, limits=LIMITS)
    spans = [x for x in execution.set_points.trajectory.spans if x.kind == "contour"]
    assert len(evaluation.contours) == len(spans) == 2
    squares = 0.0
    times = 0.0
    for profile, span, contour in zip(evaluation.contours, spans, program.contours, strict=True):
        assert span.work is not None
        inside = (execution.t >= span.work[0]) & (execution.t < span.work[1])
        t = execution.t[inside]
        errors = nearest(contour.path, ARM.tool_position(execution.q[inside]))
        assert profile.max == pytest.approx(errors.max(), rel=1e-6)
        mean = trapezoid(errors**2, t) / (t[-1] - t[0])
        # Up to an interval between results at its ends.
        assert profile.rms == pytest.approx(np.sqrt(mean), rel=2e-3)
        assert span.work[0] <= profile.t[0] and profile.t[-1] == pytest.approx(span.work[1])
        assert span.work[0] <= profile.t_max <= span.work[1]
        assert span.s[0] <= profile.s_max <= span.s[1]
        positions = profile.s[np.isfinite(profile.s)]
        assert positions.min() >= span.s[0] - 1e-12 and positions.max() <= span.s[1] + 1e-12
        squares += profile.rms**2 * (profile.t[-1] - profile.t[0])
        times += profile.t[-1] - profile.t[0]
    assert evaluation.contour_error.rms == pytest.approx(np.sqrt(squares / times), rel=1e-12)
    assert evaluation.contour_error.max == max(x.max for x in evaluation.contours)
    # Not compensated, the tool cuts corners: there is something to see.
    assert evaluation.contour_error.max > 1e-5


def test_a_program_of_one_contour_has_the_evaluation_of_its_path():
    path = ac.round_corners(BEND, tolerance=1e-3)
    one = round_corners(Program(moves=(Contour(path=BEND),)), tolerance=1e-3)
    alone = executed(path)
    as_program = executed(one)
    np.testing.assert_array_equal(alone.q, as_program.q)
    first = ac.evaluate(alone, path, objective=BEND, limits=LIMITS, limit_use=True)
    objective = Program(moves=(Contour(path=BEND),))
    second = ac.evaluate(as_program, one, objective=objective, limits=LIMITS, limit_use=True)
    for name in ("contour_error", "tracking_error", "objective_error"):
        a, b = getattr(first, name), getattr(second, name)
        assert (a.max, a.t_max, a.rms) == (b.max, b.t_max, b.rms)
    assert first.corners == second.corners and len(first.corners) == 1
    assert first.limit_ratios == second.limit_ratios
    assert first.time_at_limit == second.time_at_limit
    for evaluation in (first, second):
        assert evaluation.end_time == evaluation.settled > alone.set_points.trajectory.duration
        assert [x.max for x in evaluation.contours] == [evaluation.contour_error.max]


def test_each_corner_and_each_short_contour_has_an_evaluation(execution, program, objective):
    evaluation = ac.evaluate(execution, program, objective=objective, limits=LIMITS)
    assert evaluation.objective_error is not None
    assert len(evaluation.corners) == 5  # four of the square, which begins on a side, and one
    assert evaluation.objective_error.max >= evaluation.contour_error.max * 0.5
    dot = Path.polyline([[0.3, 0.2], [0.3, 0.2 + 1e-6]])
    moves = (Contour(path=dot), Rapid(), Contour(path=BEND))
    program = Program(moves=moves)
    evaluation = ac.evaluate(executed(program), program, limits=LIMITS)
    assert len(evaluation.contours) == 2
    assert np.isfinite([x.rms for x in evaluation.contours]).all()


def test_rapids_are_not_compared_with_limits_of_the_tool():
    limits = LIMITS.replace(speed=0.02, tool_acceleration=0.1)
    trajectory = ac.plan(DRAWN, ARM, limits, ac.Optimal(reserve=0.2))
    (rapid,) = (x for x in trajectory.spans if x.kind == "rapid")
    t = np.linspace(*rapid.t, 200)
    speed = np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1)
    assert speed.max() > 0.05
    set_points = ac.compensate(trajectory, SERVO, ac.Inverse(), cycle=4e-3)
    execution = ac.simulate(set_points, ac.ServoPlant(ARM, SERVO, limits))
    evaluation = ac.evaluate(execution, DRAWN, limits=limits, limit_use=True)
    for name in ("speed", "tool_acceleration", "centripetal_acceleration"):
        assert evaluation.limit_ratios[name] <= 1 + 1e-6
    # Of the joints the rapid uses what the reserve leaves.
    assert evaluation.limit_ratios["joint_acceleration"] == pytest.approx(0.8, abs=1e-3)
    assert evaluation.speed < 0.021 and evaluation.speed_overshoot < 0.001
    # So does a check of the plan; a contour that is too fast is seen, at its own time.
    evaluation = ac.check(trajectory, ARM, limits)
    assert not evaluation.violated and evaluation["speed"].ratio == pytest.approx(1.0, abs=1e-6)
    assert evaluation["joint_acceleration"].ratio == pytest.approx(0.8, abs=1e-3)
    slower = ac.check(trajectory, ARM, limits.replace(speed=0.01))
    assert [x.name for x in slower.violations] == ["speed"]
    contours = [x.t for x in trajectory.spans if x.kind == "contour"]
    assert any(a <= slower["speed"].t <= b for a, b in contours)


def test_a_program_that_was_not_planned_is_refused(execution, program, refuses):
    one = Program(moves=program.contours[:1])
    plain = executed(BEND)
    for call, words in (
        (partial(ac.evaluate, execution, one), "2 contours"),
        (partial(ac.evaluate, execution, BEND, objective=one), "2 contours"),
        (partial(ac.evaluate, execution, program, objective=one), "program, 2,"),
        (partial(ac.evaluate, execution, program, objective=BEND), "program, 2,"),
        (partial(ac.evaluate, execution, BEND), "2 contours"),
        (partial(ac.evaluate, plain, program), "1 contour,"),
        (partial(ac.trace, one, ARM), "trace takes a Path, not a Program"),
        (partial(ac.check, plain.set_points.trajectory, ARM, LIMITS, "path"), "not 'path'"),
    ):
        refuses(call, InvalidInput, words)
    planned = plain.set_points.trajectory
    whole = Program(moves=(Contour(path=BEND),))
    deviations = [ac.check(planned, ARM, LIMITS, x).path_deviation for x in (whole, BEND)]
    assert deviations[0] == deviations[1]


def test_the_mean_speed_counts_only_while_the_process_is_on(execution, program):
    evaluation = ac.evaluate(execution, program)
    plan = execution.set_points.trajectory
    works = [x.work for x in plan.contour_spans]
    inside = np.any([(execution.t >= a) & (execution.t <= b) for a, b in works], axis=0)
    mean = np.average(execution.tool_speed[inside])
    assert evaluation.path_velocity == pytest.approx(mean, rel=0.01) and mean < evaluation.speed
