"""The first problems of the soak; `make soak` runs many more."""

from __future__ import annotations

import pytest
from soak.judge import run

BATCH = 200
# Random places per interval of a law, beside its ends; `make soak` looks at 8.
PLACES = 3


@pytest.mark.parametrize("first", range(0, 600, BATCH))
def test_random_problems_are_planned_within_their_limits(first, monkeypatch):
    monkeypatch.setattr("soak.judge.PLACES", PLACES)
    outcomes = [run(seed) for seed in range(first, first + BATCH)]
    failed = [f"seed {x.seed} ({x.kind}) {x.result}: {x.note}" for x in outcomes if x.failed]
    assert not failed, "\n".join(failed)
    assert sum(x.result == "planned" for x in outcomes) > 0.9 * BATCH
