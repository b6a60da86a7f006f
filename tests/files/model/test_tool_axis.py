"""The tool axis along edges of CAD models, against closed forms."""

import math

import numpy as np
import pytest

import armcontour as ac
from armcontour.files.model import Bisector, EdgeRule, FaceNormal, FaceRule

pytest.importorskip("OCP")
from tests.files.model.step_parts import Named, box, cut, cylinder, write

MM = 1e-3
# Largest angle between the axis and the prescribed one [deg], with a reserve between samples.
LIMIT = 0.15


def axes_of(path, s):
    return path.orientation(np.asarray(s))[:, :, 2]


def angles(axes, expected):
    expected = np.asarray(expected) / np.linalg.norm(expected, axis=-1, keepdims=True)
    return np.degrees(np.arccos(np.clip((axes * expected).sum(axis=-1), -1, 1)))


def seam(steps, axis):
    model = ac.read_model(steps / "frame.step")
    rule = EdgeRule(seams=("post", "plate"), open=200 * MM)
    (contour,) = model.program(rule, axis=axis).contours
    return contour.path


def sides(path):
    """Arc lengths 25 to 35 mm after each corner, and the outward normals of the post there."""
    s = np.add.outer(60 * MM * np.arange(4), np.linspace(25, 35, 5) * MM).ravel()
    x, y, z = path(s).T
    assert np.abs(z - 12 * MM).max() < 1e-9
    on_x = np.abs(np.abs(x) - 30 * MM) < 1e-9
    normals = np.where(on_x[:, None], np.stack([np.sign(x), 0 * x, 0 * x], axis=1), 0.0)
    normals += np.where(~on_x[:, None], np.stack([0 * x, np.sign(y), 0 * x], axis=1), 0.0)
    return s, normals


def test_the_bisector_halves_the_angle_between_the_faces(steps):
    path = seam(steps, Bisector())
    s, normals = sides(path)
    assert angles(axes_of(path, s), -(normals + [0, 0, 1])).max() < LIMIT


@pytest.mark.parametrize("degrees", [-20, 15])
def test_work_and_travel_angles_lean_the_tool(steps, degrees):
    angle = math.radians(degrees)
    path = seam(steps, Bisector(work=angle))
    s, normals = sides(path)
    # The post is the first part, so a positive angle makes the tool steeper.
    steepness = math.pi / 4 + angle
    expected = -(math.cos(steepness) * normals + [0, 0, math.sin(steepness)])
    assert angles(axes_of(path, s), expected).max() < LIMIT
    path = seam(steps, Bisector(travel=angle))
    axes = axes_of(path, s)
    forwards = (axes * path(s, 1)).sum(axis=1)
    assert np.abs(np.degrees(np.arcsin(forwards)) - degrees).max() < LIMIT


def test_corners_are_blended_over_the_stated_length(steps):
    path = seam(steps, Bisector(blend=12 * MM))
    corner = 60 * MM
    near = axes_of(path, corner + np.array([-12.5, 12.5]) * MM)
    before, after = near
    assert angles(before, axes_of(path, [30 * MM])[0]) < LIMIT
    assert angles(after, axes_of(path, [90 * MM])[0]) < LIMIT
    # In the middle of the turn, the axis is between both.
    (middle,) = axes_of(path, [corner])
    assert angles(middle, before + after) < LIMIT
    turned = angles(axes_of(path, corner + np.linspace(-12, 12, 49) * MM), before)
    assert (np.diff(turned) > -LIMIT).all()
    # The axis turns without a jump of its rate, so only the corners of the path stop the tool.
    np.testing.assert_allclose(path.stops, [0.06, 0.12, 0.18], atol=1e-9)
    assert path.orientation.jumps.max() < 1e-9 and not path.orientation.kinks.any()


def test_rounded_corners_do_not_stop_the_tool(steps):
    model = ac.read_model(steps / "frame.step")
    rule = EdgeRule(seams=("post", "plate"), open=200 * MM)
    path = model.program(rule).contours[0].path
    rounded = ac.round_corners(path, tolerance=1 * MM)
    assert len(rounded.corners) == 3 and not rounded.corners.stopped.any()
    assert not len(rounded.stops)
    # Away from the corners nothing changes, and in their middle the axis is that of the corner.
    for s in (0.0, 0.03, 0.09, 0.2):
        place = rounded.place(s)
        assert angles(axes_of(rounded, [place])[0], axes_of(path, [s])[0]) < 1e-4
    middles = (rounded.corners.start + rounded.corners.end) / 2
    corners = axes_of(path, [0.06, 0.12, 0.18])
    assert angles(axes_of(rounded, middles), corners).max() < 1e-4


def test_smooth_curvature_keeps_the_axis(steps):
    from armcontour.program import smooth_curvature

    model = ac.read_model(steps / "block.step")
    program = model.program(EdgeRule(face=FaceRule(near=[50 * MM, 50 * MM, 20 * MM]), loop="outer"))
    smoothed = smooth_curvature(program, tolerance=20e-6)
    path = smoothed.contours[0].path
    assert path.smoothing > 0 and not len(path.stops)
    s = np.linspace(0, path.length, 301)
    x, y, _ = path(s).T / MM
    inside = np.stack([np.clip(x, 12, 88), np.clip(y, 12, 48)], axis=1)
    outward = np.stack([x, y], axis=1) - inside
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    expected = -np.column_stack([outward, np.ones(len(s))])
    assert angles(axes_of(path, s), expected).max() < 1.0


def test_a_deburring_tool_halves_convex_edges(steps):
    model = ac.read_model(steps / "block.step")
    rules = [
        EdgeRule(face=FaceRule(near=[50 * MM, 50 * MM, 20 * MM]), loop=x)
        for x in ("outer", "inner")
    ]
    outline, *holes = model.program(*rules).contours
    s = np.linspace(0, outline.path.length, 401)
    x, y, _ = outline.path(s).T / MM
    inside = np.stack([np.clip(x, 12, 88), np.clip(y, 12, 48)], axis=1)
    outward = (np.stack([x, y], axis=1) - inside) / 12
    expected = -np.column_stack([outward, np.ones(len(s))])
    on_sides = (np.abs(x - np.clip(x, 12, 88)) < 1e-9) | (np.abs(y - np.clip(y, 12, 48)) < 1e-9)
    expected[on_sides] /= np.linalg.norm(expected[on_sides], axis=1, keepdims=True)
    # Where lines and arcs meet, the axis turns smoothly within its tolerance.
    assert angles(axes_of(outline.path, s), expected).max() < LIMIT
    for hole in holes:
        s = np.linspace(0, hole.path.length, 101)
        points = hole.path(s) / MM
        center = [30 if points[0, 0] < 50 else 70, 30, points[0, 2]]
        expected = (points - center) / 5 - [0, 0, 1]
        assert angles(axes_of(hole.path, s), expected).max() < LIMIT
        assert not len(hole.path.stops)


def test_a_face_normal_points_into_its_face(steps):
    model = ac.read_model(steps / "sheet.step")
    top = EdgeRule(face=FaceRule(near=[0, 0, 27 * MM]))
    for contour in model.program(top, axis=FaceNormal()).contours:
        s = np.linspace(0, contour.path.length, 201)
        x, y, _ = contour.path(s).T
        # The surface is close to the function through whose points it is drawn.
        dx = -25 / 110 * np.sin(x / 0.110) * np.cos(y / 0.140) + 0.4 * y
        dy = -25 / 140 * np.cos(x / 0.110) * np.sin(y / 0.140) + 0.4 * x
        normals = np.stack([-dx, -dy, 1 + 0 * x], axis=1)
        assert angles(axes_of(contour.path, s), -normals).max() < 0.5
        assert not len(contour.path.stops)


def test_up_selects_one_of_two_faces(steps):
    model = ac.read_model(steps / "frame.step")
    edge = EdgeRule(near=[100 * MM, 3 * MM, 12 * MM])
    for up, expected in (([0, 0, 1], [0, 0, -1]), ([1, 0, 0.1], [-1, 0, 0])):
        path = model.program(edge, axis=FaceNormal(up=up)).contours[0].path
        assert angles(axes_of(path, [0.0, 0.1]), [expected, expected]).max() < 1e-6
    with pytest.raises(ac.InvalidInput, match="up"):
        model.program(edge, axis=FaceNormal())


def test_a_contour_without_an_axis_has_no_orientation(steps):
    model = ac.read_model(steps / "frame.step")
    edge = EdgeRule(near=[100 * MM, 3 * MM, 12 * MM])
    assert model.program(edge, axis=None).contours[0].path.orientation is None


def test_faces_that_define_no_axis_are_refused(tmp_path):
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt

    plane = gp_Pln(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))
    face = BRepBuilderAPI_MakeFace(plane, 0, 40, 0, 30).Face()
    model = ac.read_model(write(tmp_path / "face.step", Named("face", face)))
    assert {x.fold for x in model.edges} == {"border"}
    with pytest.raises(ac.InvalidInput, match="face"):
        model.program()
    path = model.program(axis=FaceNormal()).contours[0].path
    assert angles(np.abs(axes_of(path, [0.0, 0.1])), [[0, 0, 1]] * 2).max() < 1e-6


def test_a_mixed_outline_is_tangent(tmp_path):
    # A pocket of lines and of ellipses, which are no arcs: the spline continues the lines.
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Ax2, gp_Dir, gp_Elips, gp_Pnt, gp_Vec

    wire = BRepBuilderAPI_MakeWire()
    right = gp_Elips(gp_Ax2(gp_Pnt(30, 0, 0), gp_Dir(0, 0, 1)), 20, 15)
    left = gp_Elips(gp_Ax2(gp_Pnt(-30, 0, 0), gp_Dir(0, 0, 1)), 20, 15)
    quarter = math.pi / 2
    for edge in (
        BRepBuilderAPI_MakeEdge(gp_Pnt(-30, -15, 0), gp_Pnt(30, -15, 0)),
        BRepBuilderAPI_MakeEdge(right, -quarter, quarter),
        BRepBuilderAPI_MakeEdge(gp_Pnt(30, 15, 0), gp_Pnt(-30, 15, 0)),
        BRepBuilderAPI_MakeEdge(left, quarter, 3 * quarter),
    ):
        wire.Add(edge.Edge())
    solid = BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire.Wire()).Face(), gp_Vec(0, 0, 8))
    model = ac.read_model(write(tmp_path / "oval.step", Named("oval", solid.Shape())))
    rule = EdgeRule(face=FaceRule(near=[0, 0, 8 * MM]))
    path = model.program(rule).contours[0].path
    assert not len(path.stops)
    x, y, _ = path(np.linspace(0, path.length, 2001)).T / MM
    beyond = np.clip(np.abs(x) - 30, 0, None)
    level = np.hypot(beyond / 20, y / 15)
    assert np.abs(level - 1).max() * 15 * MM < 1e-5


def test_a_hole_in_a_cylinder_is_fitted(tmp_path):
    # Two cylinders of radius 20 and 8, whose axes cross: a curve on both.
    shape = cut(cylinder(20, 80), cylinder(8, 60, (0, 0, 40), (1, 0, 0)))
    model = ac.read_model(write(tmp_path / "pipe.step", Named("pipe", shape)))
    rim = EdgeRule(kind="curve", near=[math.sqrt(400 - 64) * MM, 8 * MM, 40 * MM])
    (contour,) = model.program(rim).contours
    x, y, z = contour.path(np.linspace(0, contour.path.length, 2001)).T / MM
    off = np.maximum(np.abs(np.hypot(x, y) - 20), np.abs(np.hypot(y, z - 40) - 8))
    assert off.max() * MM < 1e-5
    assert not len(contour.path.stops)


@pytest.mark.parametrize(
    "wrong",
    [{"work": 2.0}, {"travel": -1.6}, {"blend": 0.0}],
)
def test_impossible_angles_are_refused(wrong):
    with pytest.raises(ac.InvalidInput):
        Bisector(**wrong)


def test_a_box_without_corners_of_the_axis_needs_no_blend(tmp_path):
    model = ac.read_model(write(tmp_path / "box.step", Named("box", box((0, 0, 0), (40, 30, 20)))))
    rule = EdgeRule(face=FaceRule(near=[20 * MM, 15 * MM, 20 * MM]))
    path = model.program(rule, axis=FaceNormal()).contours[0].path
    assert path.orientation.constant or path.orientation.jumps.max() < 1e-9
    s = np.linspace(0, path.length, 101)
    assert angles(axes_of(path, s), [[0, 0, -1]] * 101).max() < 1e-6
