"""`tools.bars` finds the places of an option and of a quantity, and no uses in algorithms."""

import ast

import pytest

from tools import bars

OPTION = '''
class Job:
    """A job.

    Args:
        name, reserve: See above.
    """
    reserve: float = 0.0
def plan(path, reserve=0.0):
    return time(path, reserve=reserve) * (1 - reserve)
def _time(path, reserve):
    return f"{reserve}"
LABELS = ["timing.reserve", "--reserve", "reserves"]
'''
QUANTITY = """
def rows(e):
    if e.duration > 1:
        raise ValueError(f"{e.duration} s")
    longest = max(e.duration, 2)
    return {"duration": e.duration}, ("motion", e.duration), f"{e.duration} s"
def text(e):
    return Row("duration", e.duration) + seconds(e.duration)
"""


def test_places_of_an_option():
    line_numbers = sorted(set(bars.option_lines(ast.parse(OPTION), OPTION, "reserve")))
    assert line_numbers == [6, 8, 9, 10, 13]


def test_places_of_a_quantity():
    assert sorted(set(bars.quantity_lines(ast.parse(QUANTITY), r"\.duration\b"))) == [6, 8]


@pytest.mark.parametrize("name", [*bars.OPTIONS, *bars.QUANTITIES])
def test_every_option_and_quantity_has_places(name):
    assert bars.find_lines()[name]
