"""The first problems of the soak of limits of jerk, and whether its judge sees faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from soak import jerk_tools
from soak.jerk import early, starts, units
from soak.jerk_judge import judge, run
from soak.jerk_problems import draw

import armcontour as ac

SEEDS = (2, 6, 13, 15, 22, 26, 36, 48, 54, 129, 139, 327)
TOOL_SEEDS = (2, 7, 9, 16, 20, 22)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """Third differences of long motions at lower rates than `python -m soak.jerk` takes."""
    monkeypatch.setattr("soak.jerk_judge.MOST_SAMPLES", 4000)


@pytest.mark.parametrize("seed", SEEDS)
def test_random_plans_keep_their_limits(seed):
    outcome = run(seed)
    assert not outcome.failed, outcome.notes


@pytest.mark.parametrize("seed", TOOL_SEEDS)
def test_random_plans_keep_their_limits_of_the_tool(seed):
    outcome = jerk_tools.run(seed)
    assert not outcome.failed, outcome.notes


@pytest.mark.parametrize("seed", (5, 48))
def test_searches_that_end_early_keep_all_limits(seed):
    assert early(seed) == []


@pytest.mark.parametrize("seed", (2, 25))
def test_units_do_not_matter(seed):
    assert units(seed) == []


@pytest.mark.parametrize("seed", (5, 26))
def test_where_the_search_starts_does_not_matter(seed):
    assert starts(seed) == []


@pytest.fixture(scope="module")
def problem():
    return draw(4)


@pytest.fixture(scope="module")
def planned(problem):
    return ac.plan(problem.path, limits=problem.limits, intervals=200)


def _with(planned, **changes):
    (law,) = planned.laws
    return ac.Trajectory(laws=(replace(law, **changes),), method=planned.method)


def test_the_judge_passes_the_plan(problem, planned):
    assert judge(planned, problem.limits)[0] == []


def test_the_judge_sees_a_faster_motion(problem, planned):
    """Slower by one part in 10,000 than time allows: jerk goes with the third power."""
    law, fast = planned.laws[0], 1 + 1e-4
    rates = law.rates
    powers = (1, 2, 2, 3)
    scaled = rates._replace(
        **{name: x * fast**k for name, x, k in zip(rates._fields, rates, powers, strict=True)}
    )
    notes, worst = judge(_with(planned, breaks=law.breaks / fast, rates=scaled), problem.limits)
    assert worst > 1 + 5e-5
    assert any(x.startswith(("jerk", "acceleration", "velocity")) for x in notes)


@pytest.mark.parametrize("name", ["ds", "dds", "slope"])
def test_the_judge_sees_jumps(problem, planned, name):
    rates = planned.laws[0].rates
    values = np.array(getattr(rates, name))
    values[len(values) // 2] *= 1 + 1e-6
    assert judge(_with(planned, rates=rates._replace(**{name: values})), problem.limits)[0]


def test_the_judge_sees_wrong_times(problem, planned):
    breaks = np.array(planned.laws[0].breaks)
    breaks[len(breaks) // 2 :] += 1e-9 * planned.duration
    assert any("wrong time" in x for x in judge(_with(planned, breaks=breaks), problem.limits)[0])


def test_the_judge_sees_a_plan_without_limits_of_jerk(problem):
    plain = ac.plan(problem.path, limits=problem.limits.replace(joint_jerk=None))
    notes, _ = judge(plain, problem.limits)
    assert any(x.startswith("third differences") for x in notes)
