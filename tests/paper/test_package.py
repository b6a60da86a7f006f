"""The docstring of the package is the guide from the paper's equations to the code."""

import re
from functools import reduce
from importlib import import_module

import pytest

from armcontour import paper

NAMES = re.findall(r"`([\w.]+)`", paper.__doc__)


@pytest.mark.parametrize("name", NAMES)
def test_the_guide_names_code_that_exists(name):
    full = name if name.startswith("armcontour.") else f"armcontour.paper.{name}"
    parts = full.split(".")
    for count in range(len(parts), 1, -1):
        try:
            module = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        reduce(getattr, parts[count:], module)
        return
    raise AssertionError(name)


def test_the_guide_covers_all_equations():
    numbers = set()
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", paper.__doc__):
        numbers |= set(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, 29))
