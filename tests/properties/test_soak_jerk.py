"""The first problems of the soak of jerk limits, and tests of its checker."""

import pytest
from soak.jerk import early, run, run_tool

SEEDS = (2, 6, 13, 15, 22, 26, 36, 48, 54, 129, 139, 327)
TOOL_SEEDS = (2, 9, 20)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """Third differences of long motions at lower rates than `python -m soak jerk` takes."""
    monkeypatch.setattr("soak.jerk.MOST_SAMPLES", 4000)


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
@pytest.mark.parametrize(("judged", "seeds"), [(run, SEEDS), (run_tool, TOOL_SEEDS)])
def test_random_plans_satisfy_their_limits(judged, seeds):
    outcomes = {seed: judged(seed) for seed in seeds}
    assert {seed: x.notes for seed, x in outcomes.items() if x.notes} == {}


def test_jerk_limited_searches_that_end_early_satisfy_all_limits():
    for seed in (5, 48):
        assert early(seed) == [], seed
