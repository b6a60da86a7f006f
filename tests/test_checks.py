"""Arrays as compiled functions take them."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour._checks import check_name, for_kernel
from armcontour.errors import InvalidInput


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
