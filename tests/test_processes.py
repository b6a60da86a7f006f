"""Work on many items in other processes."""

import sys
from functools import partial
from operator import truediv

import pytest

import armcontour as ac
from armcontour._processes import map_in_processes

# Functions that other processes can import.
halve = partial(truediv, 1.0)


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order(processes):
    told = []
    items = list(range(1, 31))
    found = map_in_processes(halve, items, processes=processes, done=told.append)
    assert found == [1 / x for x in items]
    assert len(told) == 30 and max(told) in (29, 30)


def test_an_error_ends_the_work_with_its_text():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        map_in_processes(halve, [1.0] * 20 + [0.0], processes=2)
    with pytest.raises(ZeroDivisionError):
        map_in_processes(halve, [0.0])


def test_a_process_that_ends_is_said():
    with pytest.raises(ac.ExecutionError, match="has ended"):
        map_in_processes(sys.exit, [3] * 20, processes=2)
