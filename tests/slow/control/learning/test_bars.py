"""Errors over three runs: the figure of docs/concepts/learning.md."""

from tests.control.learning.test_bars import in_space


def test_a_loaded_arm_in_space():
    assert in_space(runs=3)[-1] <= 1.2e-5
