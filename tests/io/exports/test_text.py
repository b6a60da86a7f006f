"""Numbers as CSV: the same bytes as numpy's."""

from __future__ import annotations

import io
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from armcontour.io.exports import csv_text
from armcontour.io.exports.text import CHUNK


def by_numpy(header: list[str], rows: np.ndarray) -> str:
    text = io.StringIO()
    text.write(",".join(header) + "\n")
    np.savetxt(text, rows, fmt="%.12f", delimiter=",")
    return text.getvalue()


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 12), st.integers(1, 5)),
        elements=st.floats(-1e18, 1e18, allow_subnormal=True),
    )
)
def test_is_the_same_text_as_numpys(rows: np.ndarray) -> None:
    header = ["t [s]", *(f"joint {i} [rad]" for i in range(rows.shape[1]))]
    assert csv_text(header, [rows]) == by_numpy(header, rows)


@pytest.mark.parametrize("count", [CHUNK // 3 - 1, CHUNK // 3, CHUNK // 3 + 1, CHUNK])
def test_nothing_is_lost_between_pieces(count: int) -> None:
    rows = np.random.default_rng(0).normal(size=(count, 3))
    assert csv_text(["a", "b", "c"], [rows[:, 0], rows[:, 1:]]) == by_numpy(["a", "b", "c"], rows)


def test_ties_and_edges_are_rounded_as_numpy_does() -> None:
    rows = np.array([[2.0**-13, -(2.0**-13), 0.5e-12, -0.0, -1e-300, 1e300, np.pi]]).T
    assert csv_text(["x"], [rows]) == by_numpy(["x"], rows)


def test_a_comma_in_a_name_does_not_make_a_column() -> None:
    text = csv_text(["t [s]", 'wrist, "left" [rad]'], [np.zeros(1), np.zeros(1)])
    assert text.splitlines()[0] == 't [s],"wrist, ""left"" [rad]"'


def test_200_000_set_points_of_six_joints_are_text_in_about_a_second() -> None:
    rows = np.random.default_rng(0).normal(size=(200_000, 7))
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        csv_text(["x"] * 7, [rows])
        best = min(best, time.process_time() - start)
    assert best < 1.0
