"""What can be grabbed: planes, points, obstacles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac
from armcontour._yaml import load
from armcontour.io import parse_job
from armcontour.jobs import Job
from armcontour.studio.handles import Handles, handles_of, obstacles_of

TAIL = """
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {own: {}}
"""


def handles(path: str, arm: str = "ur5e", folder: Path | None = None) -> Handles:
    text = f"name: a\narm: {arm}\npath: {path}{TAIL}"
    return handles_of(parse_job(text, folder=folder), load(text, ""))


def of_points(points: Any, **path: Any) -> Handles:
    return handles(str({"points": np.asarray(points).tolist(), **path}).replace("'", ""))


def test_the_plane_of_an_arm_in_the_plane_is_its_own() -> None:
    found = handles(
        "{points: [[0.3, 0.2], [360 mm, 0.25]], frame: {position: [1 cm, 0, 0]}}", "pmk3s"
    )
    np.testing.assert_allclose([x.uv for x in found.waypoints], [[0.31, 0.2], [0.37, 0.25]])
    assert found.waypoints[1].written == ("360 mm", 0.25) and found.editable
    assert found.waypoints[1].keys == ("path", "points", 1)
    np.testing.assert_allclose(found.centre, [0.34, 0.225])


@pytest.mark.parametrize(
    ("points", "x", "y", "flat"),
    [
        # On a table, on a wall across x, on a wall across y, up a line.
        ([[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.2]], [1, 0, 0], [0, 1, 0], True),
        ([[0.4, 0, 0.2], [0.4, 0.1, 0.2], [0.4, 0.1, 0.3]], [0, 1, 0], [0, 0, 1], True),
        ([[0.4, 0.2, 0.2], [0.5, 0.2, 0.2], [0.5, 0.2, 0.3]], [1, 0, 0], [0, 0, 1], True),
        ([[0.4, 0, 0.2], [0.5, 0.1, 0.2]], [1, 0, 0], [0, 1, 0], True),
        ([[0.4, 0.2, 0.2], [0.4, 0.2, 0.4]], [1, 0, 0], [0, 0, 1], True),
        # A saddle: the nearest of the planes of the frame.
        ([[0.4, 0, 0.2], [0.5, 0, 0.21], [0.5, 0.1, 0.2], [0.4, 0.1, 0.21]],
         [1, 0, 0], [0, 1, 0], False),
    ],
)  # fmt: skip
def test_the_plane_of_points_in_space_is_theirs_and_upright(points, x, y, flat) -> None:
    plane = of_points(points).plane
    np.testing.assert_array_equal([plane.x, plane.y], [x, y])
    assert plane.flat is flat


@given(
    st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 2), min_size=3, max_size=6),
    st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_points_of_any_plane_lie_in_it_and_keep_their_distances(uv, turned) -> None:
    job = parse_job(f"name: a\narm: pmk3s\npath: {{points: [[0.3, 0.2], [0.4, 0.2]]}}{TAIL}")
    frame = ac.Frame.rpy([0.4, 0.1, 0.3], turned)
    points = np.array([frame.position + frame.rotation @ [*x, 0] for x in uv])
    try:
        path = ac.Path.polyline(points)
    except ac.errors.InvalidInput:
        return
    job = Job(
        name="a",
        title="a",
        arm=ARM,
        path=path,
        servo=job.servo,
        plant_servo=job.servo,
        runs=job.runs,
    )
    found = handles_of(job, {"path": {"points": points.tolist()}})
    plane = found.plane
    places = np.array([x.point for x in found.waypoints])
    assert plane.flat and np.abs((places - plane.origin) @ plane.normal).max() < 1e-9
    np.testing.assert_allclose(plane.lift(plane.uv(places)), places, atol=1e-9)
    axes = np.stack([plane.x, plane.y, plane.normal])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)


ARM = ac.load_arm("ur5e")


def test_chains_have_points_at_ends_and_beside_them() -> None:
    found = handles(
        "{start: [0.3, 0.2], segments: [{to: [0.36, 0.2]}, {via: [0.37, 0.21], to: [0.38, 0.2]}, "
        "{center: [0.38, 0.22], angle: 90 deg}]}",
        "pmk3s",
    )
    roles = [(x.role, x.keys[-1] if x.keys else None) for x in found.waypoints]
    assert roles == [
        ("point", "start"), ("point", "to"), ("point", "to"), ("end", None),
        ("via", "via"), ("center", "center"),
    ]  # fmt: skip
    end = found.waypoints[3]
    np.testing.assert_allclose(end.uv, [0.40, 0.22], atol=1e-15)
    assert "follows from the centre" in (end.why_not or "") and found.waypoints[2].why_not is None
    assert [x.index for x in found.ends] == [0, 1, 2, 3]


def test_splines_have_their_points() -> None:
    found = handles("{spline: {points: [[0.3, 0.2], [0.35, 0.22], [0.4, 0.2]]}}", "pmk3s")
    assert [x.keys for x in found.waypoints] == [("path", "spline", "points", k) for k in range(3)]


def test_drawings_have_the_plane_of_their_frame_and_no_points(tmp_path: Path) -> None:
    (tmp_path / "a.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="90mm" viewBox="0 0 90 90">'
        '<path d="M0 0 L60 0 L60 40"/></svg>'
    )
    frame = "{position: [0.4, 0.1, 0.2], rpy: [90 deg, 0, 0]}"
    path = f"{{file: a.svg, frame: {frame}, orientation: {{axis: [0, 0, -1]}}}}"
    found = handles(path, folder=tmp_path)
    assert (found.kind, found.file, found.waypoints) == ("file", "a.svg", ())
    assert "come from a.svg" in (found.why_not or "")
    np.testing.assert_allclose(found.plane.normal, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(found.plane.uv([0.45, 0.1, 0.23]), [0.45, 0.23], atol=1e-12)
    assert found.plane.flat


def test_obstacles_are_told_in_si_units_and_as_written() -> None:
    text = """
scene:
  boxes: [{name: b, size: [1 cm, 0.1, 1 m], at: [0, 5 mm, 0]}]
  halfspaces: [{name: t}]
"""
    box, table = obstacles_of(load(text, ""))
    assert (box["kind"], box["index"], box["size"], box["at"]) == (
        "boxes", 0, [0.01, 0.1, 1.0], [0.0, 0.005, 0.0],
    )  # fmt: skip
    assert box["written"]["size"] == ["1 cm", 0.1, "1 m"]
    assert table["name"] == "t" and obstacles_of({}) == []
