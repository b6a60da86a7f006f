"""Edits of the points of a path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.studio.edits.editing import CHAIN, PLANE, SPACE, TURNED, again, edited, state_of

from armcontour.errors import InvalidInput
from armcontour.studio.handles import handles_of


@pytest.mark.parametrize("text", [PLANE, TURNED, CHAIN, SPACE])
@given(st.integers(0, 8), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_a_point_lies_where_it_was_moved_to(text, index, u, v) -> None:
    handles = state_of(text).handles
    index %= len(handles.waypoints)
    point = handles.waypoints[index]
    to = point.uv + [u, v]
    if point.why_not is not None:
        with pytest.raises(InvalidInput, match="Waypoint 4 cannot be moved. This end follows"):
            edited(text, do="move_waypoint", index=index, to=to.tolist())
        return
    found = edited(text, do="move_waypoint", index=index, to=to.tolist())
    moved = handles_of(handles.job, found).waypoints[index]
    # The plane of the first picture: that of the new points may be another one.
    np.testing.assert_allclose(handles.plane.uv(moved.point), to, rtol=0, atol=1e-12)
    off = (moved.point - point.point) @ handles.plane.normal
    assert abs(off) <= 1e-12


def test_a_point_moved_in_steps_has_round_digits() -> None:
    found = edited(PLANE, do="move_waypoint", index=1, to=[0.3614837, 0.2], step=1e-4)
    assert found["path"]["points"][1] == ["361.5 mm", "20 cm"]


def test_coordinates_are_set_as_typed() -> None:
    found = edited(PLANE, do="set_waypoint", index=1, value=["361", "210 mm"])
    assert found["path"]["points"][1] == ["361 mm", "210 mm"]
    with pytest.raises(InvalidInput, match="Waypoint 2 has 2 coordinates"):
        edited(PLANE, do="set_waypoint", index=1, value=["1 mm"])


def test_points_are_inserted_and_removed_with_orientations_and_numbers_of_corners() -> None:
    single = PLANE.replace("5 mm}", "5 mm, at: {2: 1 mm}}")
    found = edited(single, do="insert_waypoint", index=1, at=[0.33, 0.21])
    # In the form of the point that is there.
    assert found["path"]["points"][1] == ["330 mm", "21 cm"] and len(found["path"]["points"]) == 4
    assert found["corners"]["at"] == {3: "1 mm"}
    assert edited(single, do="insert_waypoint", index=3, at=[0.4, 0.2])["corners"]["at"] == {
        2: "1 mm"
    }
    # The point that becomes an end of the path has no corner any more.
    assert "at" not in edited(single, do="remove_waypoint", index=0)["corners"]
    assert "at" not in edited(single, do="remove_waypoint", index=2)["corners"]
    assert "at" not in edited(single, do="remove_waypoint", index=1)["corners"]
    found = edited(SPACE, do="insert_waypoint", index=3, at=[0.5, 0.1])
    assert len(found["path"]["orientation"]) == len(found["path"]["points"]) == 4
    found = edited(SPACE, do="remove_waypoint", index=1)
    assert found["path"]["orientation"] == [{"rpy": ["180 deg", 0, 0]}, {"rpy": [3.1, 0, 0]}]
    two = PLANE.replace(", [0.36, 0.26]", "")
    with pytest.raises(InvalidInput, match="A path needs two points"):
        edited(two, do="remove_waypoint", index=0)


def test_a_new_point_of_a_tilted_path_lies_in_its_plane() -> None:
    handles = state_of(SPACE).handles
    to = (handles.waypoints[1].uv + [0.01, 0.02]).tolist()
    job, found = again(SPACE, do="insert_waypoint", index=2, at=to)
    np.testing.assert_allclose(found.waypoints[2].uv, to, atol=1e-12)
    assert found.plane.flat and job.program.dimension == 3


def test_segments_take_points_and_lose_them() -> None:
    at = {"at": [0.33, 0.19]}
    job, found = again(CHAIN, do="insert_waypoint", index=1, **at)
    assert len(found.ends) == 6 and found.ends[1].written == (0.33, 0.19)
    assert job.path.speeds[:2].tolist() == [0.1, 0.1]
    job, found = again(CHAIN, do="insert_waypoint", index=0, **at)
    assert found.ends[0].written == (0.33, 0.19) and found.ends[1].written == (0.3, 0.2)
    _, found = again(CHAIN, do="insert_waypoint", index=5, **at)
    assert len(found.ends) == 6 and found.ends[5].written == (0.33, 0.19)
    _, found = again(CHAIN, do="remove_waypoint", index=0)
    assert len(found.ends) == 4 and found.ends[0].written == (0.36, 0.2)
    _, found = again(CHAIN, do="remove_waypoint", index=3)
    assert [x.role for x in found.waypoints] == ["point"] * 4 + ["via"]
    with pytest.raises(InvalidInput, match="Segment 2 is an arc"):
        edited(CHAIN, do="insert_waypoint", index=2, **at)
    with pytest.raises(InvalidInput, match="the via point of an arc"):
        edited(CHAIN, do="remove_waypoint", index=5)
