"""The first problems of the soak of limits of jerk, and whether its judge sees faults."""

from dataclasses import replace

import numpy as np
import pytest
from soak.jerk import draw, early, judge, run, run_tool

import armcontour as ac

SEEDS = (2, 6, 13, 15, 22, 26, 36, 48, 54, 129, 139, 327)
TOOL_SEEDS = (2, 9, 20)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """Third differences of long motions at lower rates than `python -m soak jerk` takes."""
    monkeypatch.setattr("soak.jerk.MOST_SAMPLES", 4000)


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
@pytest.mark.parametrize(("judged", "seeds"), [(run, SEEDS), (run_tool, TOOL_SEEDS)])
def test_random_plans_keep_their_limits(judged, seeds):
    outcomes = {seed: judged(seed) for seed in seeds}
    assert {seed: x.notes for seed, x in outcomes.items() if x.notes} == {}


def test_searches_that_end_early_keep_all_limits():
    for seed in (5, 48):
        assert early(seed) == [], seed


@pytest.fixture(scope="module")
def problem():
    return draw(4)


@pytest.fixture(scope="module")
def planned(problem):
    return ac.plan(problem.path, limits=problem.limits, options=ac.Optimal(intervals=200))


def _with(planned, **changes):
    (law,) = planned.laws
    return ac.Trajectory(laws=(replace(law, **changes),), method=planned.method)


def test_the_judge_passes_the_plan_and_sees_a_faster_motion(problem, planned):
    """Slower by one part in 10,000 than time allows: jerk goes with the third power."""
    assert judge(planned, problem.limits)[0] == []
    law, fast = planned.laws[0], 1 + 1e-4
    rates = law.rates
    powers = zip(rates._fields, rates, (1, 2, 2, 3), strict=True)
    scaled = rates._replace(**{name: x * fast**k for name, x, k in powers})
    notes, worst = judge(_with(planned, breaks=law.breaks / fast, rates=scaled), problem.limits)
    assert worst > 1 + 5e-5
    assert any(x.startswith(("jerk", "acceleration", "velocity")) for x in notes)


def test_the_judge_sees_jumps_and_wrong_times(problem, planned):
    rates = planned.laws[0].rates
    for name in ("ds", "dds", "slope"):
        values = np.array(getattr(rates, name))
        values[len(values) // 2] *= 1 + 1e-6
        changed = _with(planned, rates=rates._replace(**{name: values}))
        assert judge(changed, problem.limits)[0], name
    breaks = np.array(planned.laws[0].breaks)
    breaks[len(breaks) // 2 :] += 1e-9 * planned.duration
    assert any("wrong time" in x for x in judge(_with(planned, breaks=breaks), problem.limits)[0])


def test_the_judge_sees_a_plan_without_limits_of_jerk(problem):
    plain = ac.plan(problem.path, limits=problem.limits.replace(joint_jerk=np.inf))
    notes, _ = judge(plain, problem.limits)
    assert any(x.startswith("third differences") for x in notes)
