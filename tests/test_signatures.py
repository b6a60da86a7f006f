"""Types of arguments as text, and back."""

from collections import namedtuple

import numpy as np
import pytest
from numba import typeof, types

from armcontour._signatures import from_text, to_text

Pair = namedtuple("Pair", "first second")
LOCKED = np.zeros(3, dtype=np.int64)
LOCKED.flags.writeable = False


def test_a_type_is_the_same_after_its_text():
    for value, text in (
        (1.0, "float64"),
        (True, "boolean"),
        (None, "none"),
        (np.zeros(3), "float64[::1]"),
        (np.zeros((2, 3)), "float64[:, ::1]"),
        (np.zeros((2, 3)).T, "float64[::1, :]"),
        (np.zeros((4, 3))[::2], "float64[:, :]"),
        (LOCKED, "const(int64[::1])"),
        ((1.0, 2), "Tuple((float64, int64, ))"),
        ((1.0, 2.0), "Tuple((float64, float64, ))"),
        (Pair(1.0, 2), f'named("{__name__}", "Pair", float64, int64)'),
        (Pair(1.0, np.zeros(1)), f'named("{__name__}", "Pair", float64, float64[::1])'),
        (Pair(1.0, 2.0), f'named("{__name__}", "Pair", float64, float64)'),
    ):
        assert to_text([typeof(value)]) == text
        assert from_text(text) == (typeof(value),)
    kinds = (types.float64, types.literal(3), types.int64[:])
    assert to_text(kinds) == "float64, literal(3), int64[:]"
    assert from_text(to_text(kinds)) == kinds
    assert from_text("") == ()
    with pytest.raises(ValueError):
        to_text([types.ListType(types.float64)])
