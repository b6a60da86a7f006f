"""Judges of evaluations, by more examples."""

from hypothesis import given, settings
from tests.verification import test_peaks
from tests.verification.test_following import judge_places


def test_no_sample_of_many_runs_between_is_higher():
    judge = test_peaks.test_no_sample_between_is_higher.hypothesis.inner_test
    settings(max_examples=15)(given(**test_peaks.RUNS)(judge))()


def test_places_are_those_of_the_motion():
    for seed in range(4, 12):
        judge_places(seed)
