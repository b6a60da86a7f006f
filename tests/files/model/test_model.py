"""CAD models that OCCT writes, against closed forms: parts, edges, contours, refusals."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.errors import FileError
from armcontour.files.model import EdgeRule, FaceRule

pytest.importorskip("OCP")
from tests.files.model import step_parts
from tests.files.model.step_parts import BRANCH, MAIN, Named, box, cut, cylinder, placed, write

MM = 1e-3
# Half of the stated tolerance of fitted curves is for the points between those that are compared.
TOLERANCE = 1e-5


def points_of(path, count=4001):
    return path(np.linspace(0.0, path.length, count))


def test_parts_have_names_colours_places_and_sizes(steps):
    model = ac.read_model(steps / "frame.step")
    plate, post, arm = model.parts
    assert [x.name for x in model.parts] == ["plate", "post", "arm"]
    assert plate.color == "#808080" and arm.color == "#ff0000"
    assert plate.faces == 6 and post.faces == 10
    # The transforms of the assembly: the post stands, the arm lies on its side.
    np.testing.assert_allclose(post.extent, [[-0.03, -0.03, 0.012], [0.03, 0.03, 0.312]], atol=1e-9)
    np.testing.assert_allclose(arm.extent, [[0.03, -0.03, 0.22], [0.28, 0.03, 0.28]], atol=1e-9)
    np.testing.assert_allclose(model.extent, [[-0.1, -0.1, 0], [0.28, 0.1, 0.312]], atol=1e-9)


def test_curved_parts_have_exact_sizes(tmp_path):
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere, BRepPrimAPI_MakeTorus

    ball = Named("ball", BRepPrimAPI_MakeSphere(7.0).Shape(), placed(50, 0, 0))
    ring = Named("ring", BRepPrimAPI_MakeTorus(20.0, 5.0).Shape())
    rod = Named("rod", cylinder(3, 40), placed(0, 50, 0, (1, 0, 0), math.pi / 2))
    model = ac.read_model(write(tmp_path / "round.step", ball, ring, rod))
    sizes = {x.name: x.extent / MM for x in model.parts}
    np.testing.assert_allclose(sizes["ball"], [[43, -7, -7], [57, 7, 7]], atol=1e-4)
    np.testing.assert_allclose(sizes["ring"], [[-25, -25, -5], [25, 25, 5]], atol=1e-4)
    np.testing.assert_allclose(sizes["rod"], [[-3, 10, -3], [3, 50, 3]], atol=1e-4)


def test_units_of_the_file_are_used_or_replaced(tmp_path):
    shape = box((0, 0, 0), (254, 127, 25.4))
    file = write(tmp_path / "plate.step", Named("plate", shape), unit="INCH")
    model = ac.read_model(file)
    assert model.unit == pytest.approx(0.0254)
    np.testing.assert_allclose(model.extent[1], [0.254, 0.127, 0.0254], rtol=1e-6)
    # The numbers of the file, 10 x 5 x 1, are in mm.
    replaced = ac.read_model(file, units="mm")
    np.testing.assert_allclose(replaced.extent[1], [0.010, 0.005, 0.001], rtol=1e-6)
    rule = EdgeRule(face=FaceRule(near=[5 * MM, 2 * MM, 1 * MM]))
    (contour,) = replaced.program(rule).contours
    assert contour.path.length == pytest.approx(0.030)
    program = ac.read_path(file, ac.ReadOptions(units="mm", scale=2.0, edges=[rule]))
    assert program.path.length == pytest.approx(0.060)


def test_lines_and_circles_are_exact(steps):
    model = ac.read_model(steps / "block.step")
    top = FaceRule(near=[50 * MM, 50 * MM, 20 * MM])
    program = model.program(
        EdgeRule(face=top, loop="outer", layer="TOP"),
        EdgeRule(kind="circle", radius=5 * MM, layer="HOLES"),
    )
    outline, *holes = program.contours
    assert outline.layer == "TOP" and [x.layer for x in holes] == ["HOLES"] * 4
    assert outline.path.length == pytest.approx(
        2 * (76 + 36) * MM + 2 * math.pi * 12 * MM, abs=1e-9
    )
    assert len(outline.path) == 8 and not len(outline.path.stops)
    for hole in holes:
        (radius,) = 1 / hole.path.curvatures
        assert radius == pytest.approx(5 * MM, abs=1e-12)
        assert hole.path.length == pytest.approx(10 * math.pi * MM, abs=1e-9)


def test_the_saddle_is_that_of_two_cylinders(steps):
    model = ac.read_model(steps / "saddle.step")
    rule = EdgeRule(seams=("branch", "main pipe"), open=200 * MM)
    (contour,) = model.program(rule).contours
    path = contour.path
    x, y, z = points_of(path).T / MM
    off = np.maximum(np.abs(np.hypot(x, y) - BRANCH), np.abs(np.hypot(y, z) - MAIN))
    assert off.max() * MM < TOLERANCE
    # Every direction from the axis of the branch is met once.
    angles = np.unwrap(np.arctan2(y, x))
    assert abs(angles[-1] - angles[0]) == pytest.approx(2 * math.pi, abs=1e-6)
    assert contour.closed and not len(path.stops)
    zeros = 0 * x
    normals = [np.stack([x, y, zeros], axis=1) / BRANCH, np.stack([zeros, y, z], axis=1) / MAIN]
    outward = sum(normals)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    axes = path.orientation(np.linspace(0, path.length, len(x)))[:, :, 2]
    cosines = np.clip(-(outward * axes).sum(axis=1), -1, 1)
    assert np.degrees(np.arccos(cosines)).max() < 0.2
    # The rate does not even jump where an overlap continues the closed contour.
    ends = [
        path.orientation.rates(s, side=side)[0] for s, side in ((0, "right"), (path.length, "left"))
    ]
    axis = axes[0]
    across = [x - (x @ axis) * axis for x in ends]
    np.testing.assert_allclose(*across, atol=1e-6 * np.linalg.norm(across[0]) + 1e-6)


def test_a_trimmed_sheet_follows_its_outline(steps):
    model = ac.read_model(steps / "sheet.step")
    top = FaceRule(near=[0, 0, 27 * MM])
    (contour,) = model.program(EdgeRule(face=top, loop="outer")).contours
    x, y, _ = np.abs(points_of(contour.path)).T / MM
    round_corner = (x > 140) & (y > 90)
    from_corner = np.abs(np.hypot(x - 140, y - 90) - 40)
    from_sides = np.minimum(np.abs(x - 180), np.abs(y - 130))
    assert np.where(round_corner, from_corner, from_sides).max() * MM < TOLERANCE
    assert contour.closed and not len(contour.path.stops)
    holes = model.program(EdgeRule(face=top, loop="inner")).contours
    x, y, _ = np.concatenate([points_of(h.path) for h in holes]).T / MM
    off = [np.abs(np.hypot(x - a, y - b) - r) for a, b, r in ((-80, 20, 25), (90, -30, 35))]
    assert np.minimum(*off).max() * MM < TOLERANCE


def test_seams_leave_out_the_inside_of_a_tube(steps):
    model = ac.read_model(steps / "frame.step")
    every = model.program(EdgeRule(seams=("post", "plate")))
    outer, inner = sorted(every.contours, key=lambda x: -x.path.length)
    assert outer.path.length == pytest.approx(4 * 60 * MM)
    assert inner.path.length == pytest.approx(4 * 52 * MM)
    (seam,) = model.program(EdgeRule(seams=("post", "plate"), open=200 * MM)).contours
    assert seam.path.length == pytest.approx(4 * 60 * MM)
    assert seam.name == "seam post/plate"
    # Both parts decide on the side: the second contour runs the other way round.
    (other,) = model.program(EdgeRule(seams=("plate", "post"), open=200 * MM)).contours

    def area(path):
        x, y, _ = points_of(path).T
        return np.sum(x[:-1] * np.diff(y) - y[:-1] * np.diff(x)) / 2

    assert area(seam.path) == pytest.approx(-area(other.path), rel=1e-6)
    assert abs(area(seam.path)) == pytest.approx((60 * MM) ** 2, rel=1e-3)


def test_rules_name_edges_by_what_they_are(steps):
    model = ac.read_model(steps / "frame.step")
    assert len(model.edges) == 60
    assert len(model.select(EdgeRule(fold="concave"))) == 8
    assert len(model.select(EdgeRule(fold="convex"))) == 52
    assert len(model.select(EdgeRule(part="plate"))) == 12
    assert len(model.select(EdgeRule(part="plate", fold="convex"), EdgeRule(fold="concave"))) == 20
    assert len(model.select(EdgeRule(color="red"))) == len(model.select(EdgeRule(part="arm"))) == 24
    (edge,) = model.select(EdgeRule(near=[100 * MM, 3 * MM, 12 * MM]))
    assert edge.length == pytest.approx(0.2) and edge.parts == ("plate",)
    np.testing.assert_allclose(edge.middle, [0.1, 0, 0.012], atol=1e-9)
    assert math.degrees(edge.angle) == pytest.approx(90)
    (same,) = model.select(EdgeRule(index=edge.index))
    assert same.index == edge.index
    top = EdgeRule(face=FaceRule(near=[90 * MM, 0, 12 * MM]), loop="all")
    assert len(model.select(top)) == 4
    # An edge that several rules select belongs to the first one.
    first, second = model.program(top, EdgeRule(part="plate", fold="convex")).contours[:2]
    assert first.name == "face" and second.name.startswith("convex")


def test_edges_of_cylinders_have_kinds_and_no_seam_line(steps):
    model = ac.read_model(steps / "saddle.step")
    assert all(x.fold == "smooth" for x in model.edges if x.kind == "line")
    radii = sorted({round(x.radius / MM) for x in model.edges if x.kind == "circle"})
    assert radii == [35, 40, 55, 60]


@pytest.mark.parametrize(
    ("rule", "named"),
    [
        (EdgeRule(near=[0, 0, 0.5]), "189.8 mm"),
        (EdgeRule(kind="circle"), "line"),
        (EdgeRule(radius=5 * MM), "no circles"),
        (EdgeRule(color="#123456"), "#808080"),
        (EdgeRule(part="leg"), "plate, post, arm"),
        (EdgeRule(seams=("post", "leg")), "plate, post, arm"),
        (EdgeRule(seams=("arm", "plate")), "208 mm"),
        (EdgeRule(seams=("post", "plate"), open=1e3, fold="convex"), "8 seam edges"),
        (EdgeRule(index=61), "60"),
        (EdgeRule(face=FaceRule(near=[0, 0, 1])), "688.5 mm"),
        (EdgeRule(face=FaceRule(near=[0.1, 0.1, 0.012])), "3 faces"),
        (EdgeRule(near=[0.1, 0.1, 0.012]), "3 edges"),
        (EdgeRule(fold="border"), "52 convex"),
    ],
)
def test_a_rule_without_an_edge_says_what_there_is(steps, rule, named):
    model = ac.read_model(steps / "frame.step")
    with pytest.raises(ac.InvalidInput) as error:
        model.select(rule)
    assert named in str(error.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"seams": ("a", "a")},
        {"open": 0.1},
        {"loop": "outer"},
        {"seams": ("a", "b"), "part": "a"},
        {"kind": "line", "radius": 0.1},
        {"near": [0.0, 0.0]},
        {"fold": "sharp"},
        {"index": 0},
    ],
)
def test_contradicting_rules_are_refused(wrong):
    with pytest.raises(ac.InvalidInput):
        EdgeRule(**wrong)


def test_few_edges_need_no_rule_and_many_are_counted(tmp_path, steps):
    file = write(tmp_path / "box.step", Named("box", box((0, 0, 0), (10, 20, 30))))
    program = ac.read_model(file).program()
    assert len(program.contours) == 12
    assert program.length == pytest.approx(4 * 60 * MM)
    with pytest.raises(ac.InvalidInput) as error:
        ac.read_model(steps / "frame.step").program()
    assert all(x in str(error.value) for x in ("60 contours", "52 convex", "plate, post, arm"))


def test_obstacles_are_the_parts(steps):
    plate, post, arm = ac.read_model(steps / "frame.step").obstacles(margin=0.01, allow=("tool",))
    assert [x.name for x in (plate, post, arm)] == ["plate", "post", "arm"]
    assert post.fixed_to == "part" and post.margin == 0.01 and post.allow == ("tool",)
    points = post.shape.points
    np.testing.assert_allclose(
        [points.min(axis=0), points.max(axis=0)],
        [[-0.03, -0.03, 0.012], [0.03, 0.03, 0.312]],
        atol=1e-6,
    )
    a, b, c = points[post.shape.triangles].swapaxes(0, 1)
    volume = np.sum(a * np.cross(b, c)) / 6
    assert volume == pytest.approx((60**2 - 52**2) * 300 * MM**3, rel=1e-6)


def test_triangles_are_near_curved_surfaces(steps):
    main, _ = ac.read_model(steps / "saddle.step").obstacles()
    corners = main.shape.points / MM
    middles = corners[main.shape.triangles].mean(axis=1)
    radii = np.hypot(middles[:, 1], middles[:, 2])
    inner = np.abs(middles[:, 0]) < 149
    off = np.minimum(np.abs(radii - MAIN), np.abs(radii - (MAIN - 5)))[inner]
    assert off.max() < 0.101


def test_wrong_files_are_refused_in_one_sentence(tmp_path, steps):
    whole = (steps / "block.step").read_bytes()
    shapeless = (
        b"ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        b"FILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\n"
        b"DATA;\n%sENDSEC;\nEND-ISO-10303-21;\n"
    )
    external = b"#1=DOCUMENT_TYPE('');\n#2=DOCUMENT_FILE('other.stp','','',#1,'',$);\n"
    files = {
        "empty.step": (b"", "is empty"),
        "text.step": (b"solid cube\n", "ISO-10303-21"),
        "half.step": (whole[: len(whole) // 2], "incomplete"),
        "none.step": (shapeless % b"", "none.step"),
        "parts.step": (shapeless % external, "other files"),
    }
    for name, (content, named) in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileError) as error:
            ac.read_model(tmp_path / name)
        assert named in str(error.value) and name in str(error.value)
        assert str(error.value).endswith(".") and "\n" not in str(error.value)
    with pytest.raises(FileError):
        ac.read_model(tmp_path / "missing.step")
    with pytest.raises(FileError, match="dxf"):
        ac.read_model(tmp_path / "part.dxf")


def test_an_assembly_with_a_part_in_another_file_is_refused(tmp_path):
    parts = (Named("a", box((0, 0, 0), (10, 10, 10))), Named("b", box((20, 0, 0), (30, 10, 10))))
    text = write(tmp_path / "both.step", *parts).read_text(encoding="latin-1")
    assert len(ac.read_model(tmp_path / "both.step").parts) == 2
    shape = r"ADVANCED_BREP_SHAPE_REPRESENTATION\('([^']*)',\((#\d+),\s*#\d+\),(#\d+)\)"
    text, count = re.subn(shape, r"SHAPE_REPRESENTATION('\1',(\2),\3)", text, count=1)
    assert count == 1
    reference = "#90001=DOCUMENT_TYPE('');\n#90002=DOCUMENT_FILE('a.stp','','',#90001,'',$);\n"
    head, end, tail = text.rpartition("ENDSEC;")
    (tmp_path / "one.step").write_text(head + reference + end + tail, encoding="latin-1")
    with pytest.raises(FileError, match="other files"):
        ac.read_model(tmp_path / "one.step")


def test_triangles_without_surfaces_are_refused(tmp_path):
    from OCP.BRep import BRep_Builder, BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.Interface import Interface_Static
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS, TopoDS_Face

    solid = box((0, 0, 0), (10, 10, 10))
    BRepMesh_IncrementalMesh(solid, 0.1)
    as_face = getattr(TopoDS, "Face", None) or TopoDS.Face_s
    face = as_face(TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_FACE).Current())
    bare = TopoDS_Face()
    BRep_Builder().MakeFace(bare, BRep_Tool.Triangulation_s(face, TopLoc_Location()))
    Interface_Static.SetIVal_s("write.step.tessellated", 1)
    try:
        file = write(tmp_path / "triangles.step", Named("triangles", bare))
    finally:
        Interface_Static.SetIVal_s("write.step.tessellated", 2)
    with pytest.raises(FileError, match="triangles.step"):
        ac.read_model(file)


def test_a_failing_kernel_ends_with_one_sentence(tmp_path, monkeypatch):
    from armcontour.files.model import kernel_process

    file = write(tmp_path / "box.step", Named("box", box((0, 0, 0), (1, 2, 3))))
    monkeypatch.setattr(kernel_process, "TIME_LIMIT", 0.01)
    with pytest.raises(FileError, match="takes more than"):
        ac.read_model(file)
    monkeypatch.setattr(kernel_process, "TIME_LIMIT", 60.0)
    # Too little memory for the libraries of the kernel: the process fails at its start.
    file = write(tmp_path / "other.step", Named("other", box((0, 0, 0), (1, 2, 4))))
    monkeypatch.setattr(kernel_process, "MEMORY_LIMIT", 300_000_000)
    with pytest.raises(FileError, match="the CAD kernel failed"):
        ac.read_model(file)


def test_ends_that_almost_touch_are_joined(tmp_path):
    # Two boxes whose edges continue one another with a gap of 4 micrometres.
    parts = (
        Named("a", box((0, 0, 0), (50, 10, 10))),
        Named("b", box((50.004, 0, 0), (100, 10, 10))),
    )
    model = ac.read_model(write(tmp_path / "gap.step", *parts))
    rules = [EdgeRule(near=[x, 0, 0]) for x in (25 * MM, 75 * MM)]
    separate = model.program(*rules)
    assert len(separate.contours) == 2
    both = EdgeRule(face=FaceRule(near=[25 * MM, 5 * MM, 0]))
    assert len(model.program(both).contours) == 1


def test_edges_shorter_than_the_join_tolerance_are_points(tmp_path):
    # A step of 5 micrometres in the outline of a plate.
    shape = step_parts.fused(box((0, 0, 0), (50, 20, 5)), box((0, 0, 0), (20, 20.005, 5)))
    model = ac.read_model(write(tmp_path / "step.step", Named("step", shape)))
    (contour,) = model.program(EdgeRule(face=FaceRule(near=[10 * MM, 10 * MM, 5 * MM]))).contours
    assert contour.closed and contour.path.length == pytest.approx(80 * MM, abs=2e-5)
    short = min(model.edges, key=lambda x: x.length)
    assert short.length < 1e-5
    with pytest.raises(ac.InvalidInput, match="join_tolerance"):
        model.program(EdgeRule(index=short.index))


def test_holes_and_bodies_of_one_part_are_numbered(tmp_path):
    shape = cut(box((0, 0, 0), (60, 30, 5)), *(cylinder(4, 20, (x, 15, -5)) for x in (15, 45)))
    model = ac.read_model(write(tmp_path / "plate.step", Named("plate", shape)))
    program = model.program(EdgeRule(kind="circle", radius=4 * MM))
    assert [x.name for x in program.contours] == [f"circle {k}" for k in (1, 2, 3, 4)]
    assert [x.number for x in program.contours] == [1, 2, 3, 4]


def test_files_are_named_by_path(steps):
    assert ac.read_model(str(steps / "block.step")).source == "block.step"
    assert Path(steps / "block.step").exists()
    assert step_parts.BRANCH < step_parts.MAIN


def test_edges_are_rules(refuses):
    rule = EdgeRule(kind="circle")
    assert ac.ReadOptions(edges=rule).rules == (rule,)
    # An iterator is read once.
    assert ac.ReadOptions(edges=iter([rule, rule])).rules == (rule, rule)
    for wrong in (-1, "circle", {"kind": "circle"}, [{"kind": "circle"}], [rule, None]):
        refuses(lambda x=wrong: ac.ReadOptions(edges=x), ac.InvalidInput, "edges")
    refuses(lambda: ac.ReadOptions(edges=[]), ac.InvalidInput, "at least one rule")
