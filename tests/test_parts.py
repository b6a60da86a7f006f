"""Parts of wholes, numbered."""

import numpy as np

from armcontour._parts import number_parts


def test_parts_of_each_whole_are_numbered_from_zero():
    whole, number = number_parts(np.array([2, 0, 3, 1]))
    assert whole.tolist() == [0, 0, 2, 2, 2, 3]
    assert number.tolist() == [0, 1, 0, 1, 2, 0]
    assert [x.tolist() for x in number_parts(np.zeros(0, dtype=np.intp))] == [[], []]
