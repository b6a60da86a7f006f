"""Handles: planes, waypoints and obstacles that can be edited."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.studio.edits import changes_of
from armcontour.studio.handles import EditState, handles_of, obstacles_of

TAIL = """
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {own: {}}
"""


def handles(path, arm="ur5e", folder=None, more=""):
    text = f"name: a\narm: {arm}\npath: {path}{TAIL}{more}"
    return handles_of(parse_job(text, folder=folder), load(text, ""))


def test_a_planar_arm_is_drawn_in_its_own_plane():
    parsed = handles(
        "{points: [[0.3, 0.2], [360 mm, 0.25]], frame: {position: [1 cm, 0, 0]}}", "pmk3s"
    )
    np.testing.assert_allclose([x.uv for x in parsed.waypoints], [[0.31, 0.2], [0.37, 0.25]])
    assert parsed.waypoints[1].written == ("360 mm", 0.25) and parsed.editable
    assert parsed.waypoints[1].keys == ("path", "points", 1)
    np.testing.assert_allclose(parsed.centre, [0.34, 0.225])


BARE = parse_job(f"name: a\narm: ur5e\npath: {{points: [[0.4, 0, 0.2], [0.5, 0, 0.2]]}}{TAIL}")


@given(
    st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 2), min_size=3, max_size=6),
    st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_points_of_any_plane_lie_in_it_and_keep_their_distances(uv, turned):
    frame = ac.Frame.rpy([0.4, 0.1, 0.3], turned)
    points = np.array([frame.position + frame.rotation @ [*x, 0] for x in uv])
    try:
        path = ac.Path.polyline(points)
    except ac.InvalidInput:
        return
    parsed = handles_of(replace(BARE, path=path), {"path": {"points": points.tolist()}})
    plane = parsed.plane
    places = np.array([x.point for x in parsed.waypoints])
    assert np.abs((places - plane.origin) @ plane.normal).max() < 1e-9
    np.testing.assert_allclose(plane.lift(plane.uv(places)), places, atol=1e-9)
    axes = np.stack([plane.x, plane.y, plane.normal])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)


def test_drawings_and_obstacles_have_their_positions(tmp_path):
    (tmp_path / "a.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="90mm" viewBox="0 0 90 90">'
        '<path d="M0 0 L60 0 L60 40"/></svg>'
    )
    frame = "{position: [0.4, 0.1, 0.2], rpy: [90 deg, 0, 0]}"
    path = f"{{file: a.svg, frame: {frame}, orientation: {{axis: [0, 0, -1]}}}}"
    parsed = handles(path, folder=tmp_path)
    assert (parsed.kind, parsed.file, parsed.waypoints) == ("file", "a.svg", ())
    assert "come from a.svg" in (parsed.why_not or "")
    np.testing.assert_allclose(parsed.plane.normal, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(parsed.plane.uv([0.45, 0.1, 0.23]), [0.45, 0.23], atol=1e-12)


def test_obstacles_have_their_outline_in_the_picture():
    path = "{points: [[0.3, 0.2, 0], [0.36, 0.25, 0]], orientation: {axis: [0, 0, -1]}}"
    scene = """
scene:
  obstacles:
    - {type: box, name: b, size: [1 cm, 0.1, 1 m], at: [0, 5 mm, 0], rpy: [0.3, -0.5, 1.1]}
    - {type: halfspace, name: t}
"""
    parsed = handles(path, more=scene)
    box, table = obstacles_of(load(scene, ""), parsed.job, parsed.plane, parsed.frame)
    assert (box["type"], box["index"], box["size"], box["at"]) == (
        "box", 0, [0.01, 0.1, 1.0], [0.0, 0.005, 0.0],
    )  # fmt: skip
    assert box["written"]["size"] == ["1 cm", 0.1, "1 m"]
    assert table["name"] == "t" and "outline" not in table
    (pose,) = (x.place for x in parsed.job.scene.obstacles if x.name == "b")
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = (parsed.job.arm.chain.base @ pose).position + (signs * box["size"]) @ (
        parsed.job.arm.chain.base @ pose
    ).rotation.T
    projected = parsed.plane.uv(corners)
    hull = box["uv"] + box["outline"]
    # Every corner of the outline is one of the box, and no corner of the box is outside of it.
    assert np.linalg.norm(hull[:, None] - projected, axis=2).min(axis=1).max() < 1e-12
    sides = np.roll(hull, -1, axis=0) - hull
    away = projected[:, None] - hull
    assert (sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0]).min() > -1e-12


@pytest.mark.parametrize(
    "path",
    [
        "{points: [[0.3, 0.2], [0.36, 0.25]]}",
        "{points: [[0.3, 0.2], [0.36, 0.25], [0.3, 0.3]]}",
        "{start: [0.3, 0.2], segments: [{to: [0.35, 0.2]}, {via: [0.37, 0.22], to: [0.35, 0.24]}]}",
        "{start: [0.3, 0.2], segments: [{center: [0.3, 0.25], angle: 90 deg}, {to: [0.2, 0.3]}]}",
    ],
)
def test_points_are_offered_for_removal_and_insertion_where_that_works(path):
    parsed = handles(path, "pmk3s")
    data = load(f"name: a\narm: pmk3s\npath: {path}{TAIL}", "")
    state = EditState(data=data, run="own", handles=parsed)

    def works(edit):
        try:
            return bool(changes_of(edit, state))
        except InvalidInput:
            return False

    for point in parsed.waypoints:
        remove = {"do": "remove_waypoint", "index": point.index}
        assert parsed.is_removable(point) == works(remove), point
        if point in parsed.ends[1:]:
            insert = {"do": "insert_waypoint", "index": point.index, "at": [0.33, 0.22]}
            assert parsed.is_divisible(point.index) == works(insert), point
