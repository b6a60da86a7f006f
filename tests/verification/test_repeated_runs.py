"""Repeated runs: largest error, spread, and runs that differ from the others."""

import numpy as np
import pytest

from armcontour.verification import RepeatedRuns


@pytest.mark.parametrize(
    ("largest", "different"),
    [
        # Five runs of a robot whose execution changed after the third one.
        ([0.437, 0.433, 0.435, 1.444, 1.438], [3, 4]),
        ([1.4, 0.43, 0.44, 0.43], [0]),
        ([0.43, 0.44, 1.40, 1.41], [2, 3]),
        ([0.30, 0.31, 0.295, 0.32], []),
        # Two runs do not show which of them is usual.
        ([0.43, 1.40], []),
        # Differences within the repeatability of robots.
        ([0.001, 0.001, 0.008], []),
        # Errors that scatter.
        ([0.30, 0.42, 0.55, 0.68], []),
    ],
)
def test_runs_that_differ_from_the_others_are_found(largest, different):
    runs = RepeatedRuns(largest=np.array(largest) * 1e-3)
    assert runs.different.tolist() == different
    assert bool(runs.note) == bool(different)
    assert runs.spread == pytest.approx(1e-3 * (max(largest) - min(largest)))


def test_scattered_runs_do_not_differ():
    """Errors with a standard deviation of 3 %, as is typical: no run stands out."""
    rng = np.random.default_rng(1)
    for count in (3, 4, 5, 9):
        for largest in 0.4e-3 * (1 + 0.03 * rng.standard_normal((200, count))):
            assert not len(RepeatedRuns(largest=largest).different)
