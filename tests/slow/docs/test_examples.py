"""The examples that the fast suite does not run."""

import pytest
from docs.gallery import pages
from tests.test_examples import QUICK, check_example


@pytest.mark.parametrize("name", [x for x in pages.SHOWN if x not in QUICK])
def test_an_example_prints_its_figures(name):
    check_example(name)
