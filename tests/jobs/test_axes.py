"""Axes, grids and frames of places, and where a placement looks."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.geometry.tables import refused

from armcontour.jobs import PlaceSearch
from armcontour.jobs.axes import corners_of, read_axes, read_uncertainty
from armcontour.placement import Moves

NUMBERS = st.floats(-2, 2)
OVER = {"x": (0.0, 0.1, 3), "yaw": (0.0, 0.2, 2)}


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.lists(NUMBERS, min_size=3, max_size=3))
def test_angles_turn_about_the_anchor_and_lengths_move_it(x, y, z, yaw, tilt, anchor):
    a = np.array(anchor)
    frame = Moves(anchor=a).frame({"x": x, "y": y, "z": z, "yaw": yaw, "tilt": tilt})
    np.testing.assert_allclose(frame.position + frame.rotation @ a, a + [x, y, z], atol=1e-12)
    # The z axis leans by the tilt, towards the yaw.
    lean = [np.sin(tilt) * np.cos(yaw), np.sin(tilt) * np.sin(yaw), np.cos(tilt)]
    np.testing.assert_allclose(frame.rotation[:, 2], lean, atol=1e-12)


def test_absolute_values_corners_and_replaced_axes():
    moves = Moves(anchor=np.array([0.4, 0.1, 0.2]), absolute=("x",))
    frame = moves.frame({"x": 0.7, "yaw": np.pi / 2})
    np.testing.assert_allclose(frame.position + frame.rotation @ moves.anchor, [0.7, 0.1, 0.2])
    found = {(c["x"], c["yaw"]) for c in corners_of({"x": 0.1, "yaw": 0.2})}
    assert found == {(-0.1, -0.2), (-0.1, 0.2), (0.1, -0.2), (0.1, 0.2)}
    assert corners_of({}) == []
    # An axis without uncertainty is as if not named.
    assert read_uncertainty({"x": 0.0, "yaw": 0.1}, 2) == {"yaw": 0.1}
    own = PlaceSearch(over=OVER, uncertainty={"x": 1e-3}, every=True, run="only")
    over = {"yaw": (0.1, 0.1, 1), "y": (0, 1, 2)}
    new = own.replaced({"over": over, "every": False, "objective": None})
    assert new.over == {"x": OVER["x"], **over} and list(new.over) == ["x", "y", "yaw"]
    assert (new.every, new.objective, new.run) == (False, "cycle", "only")
    assert new.replaced({"uncertainty": {"yaw": 0.1}}).uncertainty == {"x": 1e-3, "yaw": 0.1}
    assert own.over == OVER


def test_axes_come_in_one_order_and_a_whole_turn_has_no_direction_twice():
    axes = read_axes({"yaw": (0, 2 * np.pi, 4), "x": (-0.1, 0.1, 5)}, 3)
    assert [a.name for a in axes] == ["x", "yaw"]
    assert axes[0].values.tolist() == [-0.1, -0.05, 0.0, 0.05, 0.1]
    np.testing.assert_allclose(axes[1].values, np.array([0, 1, 2, 3]) * np.pi / 2, atol=1e-11)
    assert axes[1].whole_turn and not axes[0].whole_turn
    (half,) = read_axes({"yaw": (0, np.pi, 3)}, 3)
    np.testing.assert_allclose(half.values, [0, np.pi / 2, np.pi], atol=1e-11)


def test_wrong_axes_and_searches_are_refused():
    axes = (
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
    )
    refused(*((lambda x=x: read_axes(x, 3), word) for x, word in axes))
    searches = (
        ({"over": {"w": (0, 1, 2)}}, "over has no axis 'w'"),
        ({"over": {"x": (1, 0, 2)}}, "range of x from 1 to 0 m is empty"),
        ({"over": {"x": (0, 1e5, 2)}}, "over x"),
        ({"uncertainty": {"x": -1}}, "uncertainty of x"),
        ({"objective": "beauty"}, "objective"),
        ({"what": "table"}, "what must be one of part, base"),
        ({"about": "end"}, "about must be one of middle, origin"),
        ({"about": (0, 0)}, "about is a point of 3 coordinates"),
        ({"about": (0, 0, 1e6)}, "about"),
        ({"about": ("a", 0, 0)}, "about"),
    )
    refused(*((lambda x=x: PlaceSearch(**x), word) for x, word in searches))
    refused(*((lambda x=x: PlaceSearch(over=OVER).replaced(x), word) for x, word in searches))
    refused(
        (lambda: read_axes({"z": (0, 1, 2)}, 2), "no axis 'z' for an arm in the plane"),
        (lambda: read_uncertainty({"tilt": 0.1}, 2), "uncertainty has no axis 'tilt'"),
        (lambda: read_uncertainty({"x": -0.1}, 2), "uncertainty of x"),
        (lambda: PlaceSearch(over={"z": (0, 1, 2)}).check(2), "over has no axis 'z'"),
        (lambda: PlaceSearch(uncertainty={"tilt": 0.1}).check(2), "uncertainty"),
    )
