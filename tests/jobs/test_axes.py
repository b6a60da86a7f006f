"""Axes, grids and frames of places."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.jobs.axes import corners_of, read_axes, read_uncertainty
from armcontour.placement import Moves

NUMBERS = st.floats(-2, 2)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.lists(NUMBERS, min_size=3, max_size=3))
def test_angles_turn_about_the_anchor_and_lengths_move_it(x, y, z, yaw, tilt, anchor) -> None:
    a = np.array(anchor)
    frame = Moves(anchor=a).frame({"x": x, "y": y, "z": z, "yaw": yaw, "tilt": tilt})
    np.testing.assert_allclose(frame.position + frame.rotation @ a, a + [x, y, z], atol=1e-12)
    # The z axis leans by the tilt, towards the yaw.
    lean = [np.sin(tilt) * np.cos(yaw), np.sin(tilt) * np.sin(yaw), np.cos(tilt)]
    np.testing.assert_allclose(frame.rotation[:, 2], lean, atol=1e-12)


def test_absolute_values_are_where_the_anchor_goes() -> None:
    moves = Moves(anchor=np.array([0.4, 0.1, 0.2]), absolute=("x",))
    frame = moves.frame({"x": 0.7, "yaw": np.pi / 2})
    np.testing.assert_allclose(frame.position + frame.rotation @ moves.anchor, [0.7, 0.1, 0.2])


def test_axes_come_in_one_order_and_a_whole_turn_has_no_direction_twice() -> None:
    yaw, x = (0, 2 * np.pi, 4), (-0.1, 0.1, 5)
    axes = read_axes({"yaw": yaw, "x": x}, 3)
    assert [a.name for a in axes] == ["x", "yaw"]
    assert axes[0].values.tolist() == [-0.1, -0.05, 0.0, 0.05, 0.1]
    np.testing.assert_allclose(axes[1].values, np.array([0, 1, 2, 3]) * np.pi / 2, atol=1e-11)
    assert axes[1].whole_turn and not axes[0].whole_turn
    (half,) = read_axes({"yaw": (0, np.pi, 3)}, 3)
    np.testing.assert_allclose(half.values, [0, np.pi / 2, np.pi], atol=1e-11)


def test_corners_are_all_combinations() -> None:
    found = corners_of({"x": 0.1, "yaw": 0.2})
    assert {(c["x"], c["yaw"]) for c in found} == {
        (-0.1, -0.2), (-0.1, 0.2), (0.1, -0.2), (0.1, 0.2)
    }  # fmt: skip
    assert corners_of({}) == []


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({}, "over names the axes"),
        ({"w": (0, 1, 2)}, "no axis 'w': axes are x, y, z, yaw, tilt"),
        ({"x": (0.1, -0.1, 3)}, "range of x from 0.1 to -0.1 m is empty"),
        ({"x": (0, 0.1, 0)}, "number of places along x"),
        ({"x": (0, 0.1, 1)}, "1 place along x from 0 to 0.1 m"),
        ({"x": (0, 0, 3)}, "3 places along x from 0 to 0 m"),
        ({"x": (0, 0.1, 2.5)}, "number of places along x"),
        ({"x": (0, 0.1)}, "first value, the last value and the number"),
        ({"x": (0, float("nan"), 3)}, "over x"),
        ({"x": (0, 1e5, 3)}, "over x"),
        ({"yaw": (0, 1e5, 3)}, "over yaw"),
        ({"x": (0, 1, 2000), "y": (0, 1, 2000)}, "4,000,000 places, but at most 500,000"),
    ],
)
def test_wrong_axes_are_refused_with_a_sentence(over, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        read_axes(over, 3)


def test_the_plane_has_three_axes() -> None:
    with pytest.raises(InvalidInput, match="no axis 'z' for an arm in the plane"):
        read_axes({"z": (0, 1, 2)}, 2)
    with pytest.raises(InvalidInput, match="uncertainty has no axis 'tilt'"):
        read_uncertainty({"tilt": 0.1}, 2)
    with pytest.raises(InvalidInput, match="uncertainty of x"):
        read_uncertainty({"x": -0.1}, 2)


def test_an_axis_without_uncertainty_is_as_if_not_named() -> None:
    assert read_uncertainty({"x": 0.0, "yaw": 0.1}, 2) == {"yaw": 0.1}
