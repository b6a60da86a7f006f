"""Types of arguments as text, and back."""

from collections import namedtuple

import numpy as np
import pytest
from numba import typeof, types

from armcontour._signatures import from_text, to_text

Pair = namedtuple("Pair", "first second")


def locked(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "float64"),
        (True, "boolean"),
        (None, "none"),
        (np.zeros(3), "float64[::1]"),
        (np.zeros((2, 3)), "float64[:, ::1]"),
        (np.zeros((2, 3)).T, "float64[::1, :]"),
        (np.zeros((4, 3))[::2], "float64[:, :]"),
        (locked(np.zeros(3, dtype=np.int64)), "const(int64[::1])"),
        ((1.0, 2), "Tuple((float64, int64, ))"),
        ((1.0, 2.0), "Tuple((float64, float64, ))"),
        (Pair(1.0, 2), f'named("{__name__}", "Pair", float64, int64)'),
        (Pair(1.0, np.zeros(1)), f'named("{__name__}", "Pair", float64, float64[::1])'),
        (Pair(1.0, 2.0), f'named("{__name__}", "Pair", float64, float64)'),
    ],
)
def test_a_type_is_the_same_after_its_text(value, text):
    assert to_text([typeof(value)]) == text
    assert from_text(text) == (typeof(value),)


def test_several_arguments_and_none():
    kinds = (types.float64, types.literal(3), types.int64[:])
    assert to_text(kinds) == "float64, literal(3), int64[:]"
    assert from_text(to_text(kinds)) == kinds
    assert from_text("") == ()


def test_a_type_without_text_is_refused():
    with pytest.raises(ValueError, match="has no text yet"):
        to_text([types.ListType(types.float64)])
