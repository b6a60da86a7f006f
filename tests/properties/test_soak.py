"""The first problems of the soaks; `make soak` runs many more."""

from collections import Counter

import pytest
from soak import check, corners, off_drawing, timing
from tests.dynamics_extra import needs_dynamics

# Seeds of `soak.timing` per test.
BATCH = 200
# Seeds of `soak.check`.
CHECKS = 25
# Seeds of `soak.corners`.
CORNERS = 150
# One job of each kind.
JOBS = len(off_drawing.KINDS)
# Random times per interval of a law, in addition to its ends; `make soak` uses 8.
PLACES = 3


@pytest.mark.parametrize("first", range(0, 400, BATCH))
def test_random_problems_of_the_soak_are_planned_within_their_limits(first, monkeypatch):
    monkeypatch.setattr("soak.timing.PLACES", PLACES)
    outcomes = {seed: timing.run(seed) for seed in range(first, first + BATCH)}
    assert {seed: x.notes for seed, x in outcomes.items() if x.notes} == {}
    assert sum(x.result == "planned" for x in outcomes.values()) > 0.9 * BATCH


def test_random_corners_next_to_arcs_are_tangent_and_within_their_tolerance():
    wrong = []
    kinds = Counter()
    for seed in range(CORNERS):
        case = corners.draw(seed)
        problem, stopped = corners.judge(case)
        kinds[case.kind, stopped] += 1
        if problem:
            wrong.append(f"seed {seed} ({case.kind}, turn {case.turn:.6g}): {problem}")
    assert not wrong, "\n".join(wrong)
    # Nearly all are rounded, of every kind.
    assert len({kind for kind, stopped in kinds if not stopped}) == 9
    assert sum(n for (_, stopped), n in kinds.items() if stopped) < CORNERS / 50


@needs_dynamics
@pytest.mark.parametrize("seed", range(JOBS))
def test_the_stated_distance_from_the_drawing_is_that_of_dense_points(seed):
    outcome = off_drawing.run(seed)
    assert outcome.notes == [], outcome.kind


@pytest.mark.parametrize("violating", [True, False])
def test_no_verdict_on_printed_trajectories_contradicts_the_samples(violating):
    outcomes = [check.judge(check.draw(seed, violating)) for seed in range(CHECKS)]
    assert [(x.case.seed, x.case.kind, x.said, x.proof) for x in outcomes if x.wrong] == []
    # Most must be decided; "cannot tell" is not accepted for all.
    verdicts = Counter(x.said for x in outcomes)
    assert verdicts["violated" if violating else "kept"] > CHECKS * 0.6
