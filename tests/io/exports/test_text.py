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


def test_numbers_on_and_beside_ties_are_rounded_as_numpy_does() -> None:
    """Odd multiples of 2^-13 are ties of twelve decimals; their neighbours differ by one bit."""
    rng = np.random.default_rng(3)
    size = 10.0 ** rng.uniform(-4, 3.9, 2000)
    ties = (2 * np.floor(size * 2.0**12) + 1) * 2.0**-13
    units = np.floor(size * 1e12) * 1e-12 + 0.5e-12
    edges = np.array([9007.199254740992, 9.9999999999995, 99.9999999999995, 999.9999999999995])
    near = np.concatenate([ties, -units, edges, 10.0 ** np.arange(-13, 4)])
    rows = np.column_stack([near, np.nextafter(near, -np.inf), np.nextafter(near, np.inf)])
    assert csv_text(["a", "b", "c"], [rows]) == by_numpy(["a", "b", "c"], rows)
    for row in rows:
        assert csv_text(["a", "b", "c"], [row[None]]) == by_numpy(["a", "b", "c"], row[None])


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


def test_200_000_set_points_of_six_joints_are_text_in_a_fifth_of_a_second() -> None:
    rows = np.random.default_rng(0).normal(size=(200_000, 7))
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        csv_text(["x"] * 7, [rows])
        best = min(best, time.process_time() - start)
    assert best < 0.2
