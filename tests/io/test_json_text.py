"""Data as JSON."""

import json
from types import MappingProxyType

import numpy as np
import pytest

from armcontour.io.json_text import plain, to_json


def test_arrays_are_lists_and_numbers_that_are_not_finite_null():
    data = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "number": np.float64(0.1),
        "count": np.int64(3),
        "flag": np.bool_(True),
        "none": None,
        "tuple": (1, "two", -np.inf),
        "view": MappingProxyType({1: "one"}).values(),
        "nested": MappingProxyType({2: {"x": np.float32(0.5)}}),
    }
    found = json.loads(to_json(data))
    assert found == {
        "array": [[1.0, None], [None, 2.0]],
        "number": 0.1,
        "count": 3,
        "flag": True,
        "none": None,
        "tuple": [1, "two", None],
        "view": ["one"],
        "nested": {"2": {"x": 0.5}},
    }
    assert to_json({"a": 1}) == '{\n  "a": 1\n}\n'


def test_what_is_no_data_is_an_error():
    with pytest.raises(TypeError):
        plain({"x": object()})
