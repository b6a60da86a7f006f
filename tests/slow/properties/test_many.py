"""More random problems than the suite has, each judged in the same way."""

import pytest
from soak import calls
from soak.timing import run
from tests.properties.test_numbers import FIELDS, HOSTILE, check_field, write_files
from tests.properties.test_rounding import check_polylines


@pytest.mark.parametrize("seed", range(1001, 1005))
def test_random_polylines(seed):
    check_polylines(seed, 2500)


@pytest.mark.parametrize("first", range(400, 2000, 200))
def test_random_problems_are_planned_within_their_limits(first):
    outcomes = {seed: run(seed) for seed in range(first, first + 200)}
    assert {seed: x.notes for seed, x in outcomes.items() if x.notes} == {}


def test_every_hostile_number_in_every_field(tmp_path):
    write_files(tmp_path)
    assert [x for place in FIELDS for x in check_field(place, HOSTILE, tmp_path)] == []


def test_calls_are_right_but_for_their_wrong_argument():
    with calls.folder():
        results = {call.name: calls.judge(call, {}) for call in calls.calls()}
    assert {name: x for name, x in results.items() if x != ("result", "")} == {}
