"""Checks of given values."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from armcontour import InvalidInput, _checks


@pytest.mark.parametrize(
    ("given", "words"),
    [
        # A value that is missing must not come back as whatever stands below the mask.
        (np.ma.masked_array([0.1, 0.2], mask=[False, True]), "some are masked"),
        (None, "x must be numbers in m, not None."),
        ("5 mm", "not text"),
        ([0.1, np.nan], "finite, but is nan at index 1"),
    ],
)
def test_what_is_no_number_is_refused(refuses: Callable[..., None], given: Any, words: str) -> None:
    refuses(lambda: _checks.numbers("x", given, "m"), InvalidInput, words)


def test_a_masked_array_without_masked_values_is_an_array() -> None:
    given = np.ma.masked_array([0.1, 0.2], mask=False)
    assert _checks.numbers("x", given, "m").tolist() == [0.1, 0.2]


def test_a_list_in_the_place_of_a_number_is_said_to_be_one(refuses: Callable[..., None]) -> None:
    refuses(
        lambda: _checks.number("speed", [0.1], "m/s"),
        InvalidInput,
        "speed must be one number in m/s, not an array of 1.",
    )
