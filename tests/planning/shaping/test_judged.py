"""An independent checker accepts shaped motions and rejects wrong motions."""

from dataclasses import replace

import numpy as np
import pytest
from soak.shaping import Problem, excess, judge, match, pieces_of, run

import armcontour as ac
from armcontour.geometry import ShapedPath, ShapingOutcome

# Jobs that are shaped in a moment; `python -m soak shaping` judges thousands.
SEEDS = (3, 4, 5, 6, 14, 24)
TOLERANCE = 2e-3
SPEED = 0.08


def problem_of(points, arm, limits, **options):
    objective = ac.Path.polyline(points)
    return Problem(seed=0, kind="", objective=objective, arm=arm, limits=limits, options=options)


@pytest.fixture(scope="module")
def problem(arm, limits):
    points = [(0.30, 0.15), (0.42, 0.15), (0.42, 0.25)]
    return problem_of(points, arm, limits.replace(speed=SPEED), tolerance=TOLERANCE)


@pytest.fixture(scope="module")
def planned(problem):
    """A motion whose shape is an arc."""
    rounded = ac.round_corners(problem.objective, tolerance=TOLERANCE)
    corner = 0.12
    ends = problem.objective.length
    tangent = rounded.corners.tangent[0]
    s = [0.0, rounded.corners.start[0], rounded.corners.end[0], rounded.length]
    shaped = ShapedPath(
        segments=rounded.segments,
        objective=problem.objective,
        places=np.column_stack([[0.0, corner - tangent, corner + tangent, ends], s]),
        tolerance=TOLERANCE,
        outcome=ShapingOutcome(start="arcs", durations={"shaped": 1.0}),
    )
    return ac.plan(shaped, problem.arm, problem.limits)


def test_the_independent_check_reports_only_exceeded_limits(problem, planned):
    assert judge(planned, problem) == []
    for limit in ("joint_acceleration", "speed", "centripetal_acceleration"):
        limit_value = getattr(problem.limits, limit)
        hair, tight = (
            replace(problem, limits=problem.limits.replace(**{limit: share * limit_value}))
            for share in (1 - 1e-6, 0.99)
        )
        assert judge(planned, hair)[0].startswith(limit.replace("_", " ") + " 1 +")
        # By a hundredth, positions alone show it.
        assert any("by differences" in x for x in judge(planned, tight)), limit


def test_the_independent_check_reports_parts_outside_the_tube(problem, planned):
    judgement = judge(planned, replace(problem, options={"tolerance": TOLERANCE - 1e-8}))
    # The arc is nearer to the lines than to the vertex, but its middle belongs to the vertex.
    assert len(judgement) == 2 and "too far from its place" in judgement[0]
    assert judgement[1] == "vertex 1 is 1e-08 m outside"
    judgement = judge(planned, replace(problem, options={"tolerance": 0.6 * TOLERANCE}))
    assert any(x.startswith("no way along the objective") for x in judgement)


def test_the_independent_check_refuses_a_change_to_a_crossing_line(arm, limits):
    points = np.array([(0.30, 0.20), (0.36, 0.20), (0.36, 0.26), (0.33, 0.26), (0.33, 0.14)])
    pieces = pieces_of(problem_of(points, arm, limits, tolerance=1e-4))
    along = ac.Path.polyline(points)(np.linspace(0, 0.27, 9001))
    assert match(along, pieces).lost < 0
    assert excess(along, pieces, match(along, pieces)).max() < 0
    # Every point is on the objective.
    hop = ac.Path.polyline(points[[0, 0, 4]] * [1, 1] + [(0, 0), (0.03, 0), (0, 0)])
    short = hop(np.linspace(0, hop.length, 9001))
    assert match(short, pieces).lost > 0


@pytest.fixture(scope="module")
def short(arm, limits):
    """A job that is shaped in a moment."""
    points = [(0.30, 0.20), (0.33, 0.20), (0.33, 0.22), (0.31, 0.24)]
    return problem_of(points, arm, limits, tolerance=1e-3)


def shape(problem, **more):
    options = problem.options | more
    return ac.plan(problem.objective, problem.arm, problem.limits, ac.Shaped(**options))


def test_every_iteration_satisfies_all_limits_and_is_no_slower(short):
    """A search that is interrupted has the plan of its last iteration."""
    durations = []
    for iterations in (0, 1, 5, 20):
        planned = shape(short, iterations=iterations)
        durations.append(planned.duration)
        assert judge(planned, short) == []
        history = planned.path.outcome.history
        assert len(history) <= iterations + 1 and (np.diff(history) <= 0).all()
    assert (np.diff(durations) <= 0).all() and durations[-1] < 0.97 * durations[0]
    # The same job is shaped the same to the bit.
    again = shape(short, iterations=20)
    assert again.duration == planned.duration
    for name in ("starts", "tangents", "curvatures", "lengths"):
        assert np.array_equal(getattr(again.path, name), getattr(planned.path, name))


@pytest.mark.parametrize("seed", SEEDS)
def test_random_jobs_are_shaped_without_notes(seed):
    outcome = run(seed)
    assert outcome.result == "shaped" and outcome.notes == [], outcome.kind
