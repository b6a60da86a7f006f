"""Checks of given values, and arrays as compiled functions take them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from armcontour import InvalidInput, _checks
from armcontour._checks import check_name, for_kernel


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


def test_arrays_for_kernels_are_copied_where_needed_only() -> None:
    own = np.arange(6.0).reshape(2, 3)
    assert for_kernel(own) is own
    locked = own.copy()
    locked.setflags(write=False)
    for other in (locked, own.T, own[:, ::2], own.astype(int), own.tolist(), own.astype(">f8")):
        found = for_kernel(other)
        assert found is not other and np.array_equal(found, np.asarray(other))
        assert found.dtype == np.float64 and found.dtype.isnative
        assert found.flags.c_contiguous and found.flags.writeable


def test_a_name_has_printable_characters_only() -> None:
    assert check_name("name", "Kreis 1 – Ω") == "Kreis 1 – Ω" and check_name("name", "") == ""
    with pytest.raises(InvalidInput, match=r"The name has the character U\+0007"):
        check_name("name", "a\x07b")
