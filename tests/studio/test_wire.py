"""Frames as bytes."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from armcontour.errors import InvalidInput
from armcontour.studio.wire import TYPES, Frame

arrays = st.dictionaries(
    st.text(max_size=5),
    st.sampled_from(TYPES).flatmap(
        lambda kind: hnp.arrays(kind, hnp.array_shapes(max_dims=2, min_side=0, max_side=7))
    ),
    max_size=4,
)


@given(arrays=arrays)
def test_what_is_unpacked_is_what_was_packed(arrays):
    frame = Frame("picture", {"text": "0,5 µm", "n": [1, None, True, 0.1]}, arrays)
    found = Frame.unpack(frame.pack())
    assert (found.kind, found.header) == (frame.kind, frame.header)
    assert found.arrays.keys() == arrays.keys()
    for name, values in arrays.items():
        assert found.arrays[name].dtype == values.dtype
        np.testing.assert_array_equal(found.arrays[name], values)


def test_arrays_are_where_the_page_reads_them():
    data = Frame("k", {}, {"a": np.array([7], np.uint8), "b": np.array([[1.5, 2.5]])}).pack()
    (count,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + count].decode())
    begin = (4 + count + 7) // 8 * 8
    assert header["kind"] == "k"
    assert header["arrays"] == {
        "a": {"type": "u1", "shape": [1], "at": 0},
        "b": {"type": "f8", "shape": [1, 2], "at": 8},
    }
    assert data[begin] == 7
    assert struct.unpack_from("<dd", data, begin + 8) == (1.5, 2.5)


def test_headers_are_plain_json():
    header = {
        "a": np.float64(2.5),
        "b": np.array([[1, 2]]),
        "c": float("nan"),
        "d": (np.int64(3), float("-inf")),
        "e": {1: np.bool_(True)},
    }
    found = Frame.unpack(Frame("k", header).pack()).header
    assert found == {"a": 2.5, "b": [[1, 2]], "c": None, "d": [3, None], "e": {"1": True}}


def test_arrays_of_other_types_are_refused():
    with pytest.raises(InvalidInput, match="array x of a frame has the type int64"):
        Frame("k", {}, {"x": np.array([1])}).pack()
