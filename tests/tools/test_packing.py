"""`tools.packing` finds assignments that pack several statements into one."""

import pytest
from tools.packing import packed

FUNCTION = "def f(x, y, low, high, values):\n    {}\n"


@pytest.mark.parametrize(
    "statement",
    [
        "a, b = b, a",
        "n, x = x, n + x",
        "x[0], x[1] = x[1], x[0]",
        "low, high = min(x), max(x)",
        "x1, y1 = values[0], values[1]",
        "low, high = limits(x)",
        "a, *b = x, y",
        "a = x, y",
    ],
)
def test_swaps_pairs_and_returned_tuples_are_not_packed_statements(statement):
    assert list(packed(FUNCTION.format(statement))) == []


@pytest.mark.parametrize(
    "statement",
    [
        "names, count = [], 0",
        "job, runs = job_result.job, job_result.runs",
        "low, high = min(x), len(y)",
        "x.low, x.high = min(y), max(y)",
        "low, mean, high = min(x), sum(x), max(x)",
        "low, high = min(values_of_the_first_run), max(values_of_the_last_run)",
    ],
)
def test_independent_statements_in_one_line_are_found(statement):
    assert list(packed(FUNCTION.format(statement))) == [2]


def test_constants_of_a_module_are_one_per_line():
    assert list(packed("X = 1\nLOW, HIGH = 0, 1\n")) == [2]
    assert list(packed("LOW, HIGH = range(2)\n")) == []
