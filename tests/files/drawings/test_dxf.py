"""DXF drawings made with ezdxf, compared with formulas and ezdxf's own polylines."""

import io
import itertools
import re

import ezdxf
import numpy as np
import pytest
from ezdxf import colors
from ezdxf.xclip import XClip
from scipy.interpolate import BSpline, CubicSpline
from tests.files.tables import refusals

import armcontour as ac
from armcontour.files.drawings.dxf import UNITS, read_dxf
from armcontour.files.drawings.read_options import ReadOptions

MM = 1e-3
TOLERANCE = 1e-5


def drawing(version="R2010", units=4):
    """A new document in mm and its model space."""
    document = ezdxf.new(version)
    if version != "R12":
        document.units = units
    return document, document.modelspace()


def alone(kind, *args, **options):
    """A new document with one entity, and the entity."""
    document, space = drawing()
    return document, getattr(space, f"add_{kind}")(*args, **options)


def written(document):
    text = io.StringIO()
    document.write(text)
    return text.getvalue().encode(document.output_encoding, errors="surrogateescape")


def read(document, **options):
    """Read a document, or the bytes of a file."""
    data = document if isinstance(document, bytes) else written(document)
    return read_dxf(data, source="part.dxf", options=ReadOptions(**options))


def only(document, **options):
    (contour,) = read(document, **options).contours
    return contour


def near(paths, polylines, tolerance=TOLERANCE):
    """Paths, and polylines [mm] within 0.2 µm of what was drawn, are near each other, both ways.

    Paths more than a millimetre apart in any coordinate are not compared.
    """
    drawn = []
    for points in polylines:
        points = MM * np.asarray(points, dtype=float)
        if paths[0].dimension == 2:
            assert np.abs(points[:, 2:]).max(initial=0) < 1e-9
        drawn.append(ac.Path.polyline(points[:, : paths[0].dimension]))
    path_samples, there = ([(x, sampled(x)) for x in some] for some in (paths, drawn))
    for these, others in ((path_samples, there), (there, path_samples)):
        for _, points in these:
            low = points.min(axis=0) - MM
            high = points.max(axis=0) + MM
            close = [
                other.project(points).distance
                for other, samples in others
                if np.all(samples.min(axis=0) <= high) and np.all(samples.max(axis=0) >= low)
            ]
            assert np.min(close, axis=0).max() <= tolerance + 2e-7


def sampled(path):
    return np.concatenate([path(np.linspace(0, path.length, 300)), path.vertices])


def densely(entities):
    """Polylines along ezdxf's entities; not of its paths, whose arcs are cubic curves."""
    for x in entities:
        if x.dxftype() == "LINE":
            yield [tuple(x.dxf.start), tuple(x.dxf.end)]
        elif x.dxftype() in ("POLYLINE", "LWPOLYLINE"):
            yield from densely(x.virtual_entities())
        else:
            yield [tuple(p) for p in x.flattening(1e-4)]


def exploded(entity):
    """The entities that a block draws, by ezdxf."""
    if entity.dxftype() != "INSERT":
        yield entity
        return
    for one in entity.multi_insert() if entity.mcount > 1 else [entity]:
        for x in one.virtual_entities():
            yield from exploded(x)


def as_ezdxf_says(document, **options):
    program = read(document, **options)
    drawn = list(densely(e for x in document.modelspace() for e in exploded(x)))
    near([x.path for x in program.contours], drawn)
    return program


def test_lines_arcs_and_circles_are_read():
    document, space = drawing()
    space.add_line((10, 20), (110, 20), dxfattribs={"layer": "cut"})
    space.add_arc((10, 0), 50, 30, 300)
    space.add_circle((200, 0), 25)
    # An extrusion downwards mirrors.
    space.add_arc((10, 5), 50, 0, 90, dxfattribs={"extrusion": (0, 0, -1)})
    line, arc, circle, mirrored = as_ezdxf_says(document).contours
    assert line.layer == "cut" and line.name == "cut-1"
    assert [x.name for x in (arc, circle, mirrored)] == ["0-1", "0-2", "0-3"]
    np.testing.assert_array_equal(line.path.vertices, [(0.01, 0.02), (0.11, 0.02)])
    assert len(arc.path) == len(circle.path) == len(mirrored.path) == 1
    np.testing.assert_allclose(arc.path.curvatures, 20)
    np.testing.assert_allclose(arc.path.lengths, 0.05 * np.radians(270))
    start = (0.01 + 0.05 * np.cos(np.pi / 6), 0.05 * np.sin(np.pi / 6))
    np.testing.assert_allclose(arc.path.starts[0], start)
    np.testing.assert_allclose(circle.path.lengths, 2 * np.pi * 0.025)
    assert circle.closed and not arc.closed and not line.closed
    np.testing.assert_allclose(mirrored.path.vertices, [(-0.06, 0.005), (-0.01, 0.055)], atol=1e-15)
    for begin, end, sweep in ((350, 10, 20), (90, 90, 360), (0, 360, 360), (-30, 400, 70)):
        path = only(alone("arc", (0, 0), 50, begin, end)[0]).path
        np.testing.assert_allclose(path.lengths, 0.05 * np.radians(sweep))
        angle = np.radians(begin + sweep / 3)
        expected = 0.05 * np.array([np.cos(angle), np.sin(angle)])
        np.testing.assert_allclose(path(path.length / 3), expected, atol=1e-12)


def test_polylines_are_read_with_their_bulges():
    points = [(0, 0, 0.5), (50, 0, 0), (60, 40, -1), (0, 40, 0.2)]
    document, _ = alone("lwpolyline", points, format="xyb", close=True)
    contour = as_ezdxf_says(document).contours[0]
    assert contour.closed and len(contour.path) == 4
    assert (contour.path.curvatures > 0).tolist() == [True, False, True, True]
    turn = contour.path.curvatures * contour.path.lengths
    np.testing.assert_allclose(turn, 4 * np.arctan([0.5, 0, 1, 0.2]), atol=1e-12)
    assert contour.path.curvatures[2] == pytest.approx(1 / 0.03)
    document, space = drawing("R12")
    space.add_polyline2d([(0, 0, 1), (50, 0, 0), (50, 50, 0)], format="xyb", close=True)
    contour = only(document, units=MM)
    assert contour.closed and (contour.path.curvatures > 0).tolist() == [True, False, False]
    near([contour.path], densely(space))
    # In space, with points that repeat.
    points = [(0, 0, 0), (10, 0, 0), (10, 0, 0), (10, 10, 5), (0, 10, 5), (0, 10, 5)]
    path = only(alone("polyline3d", points)[0]).path
    np.testing.assert_allclose(path.vertices, MM * np.array(points)[[0, 1, 3, 4]])
    # A vertex of the frame that a fitted polyline has is not drawn.
    document, x = alone("polyline2d", [(0, 0), (9, 9), (10, 0)])
    x.vertices[1].dxf.flags = 16
    assert len(only(document).path) == 1
    contours = read(alone("mline", [(0, 0), (10, 0)])[0]).contours
    assert [x.path.length for x in contours] == pytest.approx([10 * MM, 10 * MM])
    assert len({x.name for x in contours}) == 2


def test_ellipses_are_read():
    ranges = (0, 2 * np.pi), (0.3, 2.5), (5, 1), (0, 6.28318530718)
    for flip, (begin, end) in itertools.product((1, -1), ranges):
        turned = {"dxfattribs": {"extrusion": (0, 0, flip)}}
        contour = only(alone("ellipse", (5, 6), (40, 10), 0.4, begin, end, **turned)[0])
        whole = begin == 0
        sweep = 2 * np.pi if whole else (end - begin) % (2 * np.pi)
        t = begin + np.linspace(0, sweep, 4001)[:, None]
        minor = flip * 0.4 * np.array([-10, 40, 0])
        points = np.array([5, 6, 0]) + np.cos(t) * [40, 10, 0] + np.sin(t) * minor
        near([contour.path], [points])
        assert contour.closed == whole
        np.testing.assert_allclose(contour.path(0.0), MM * points[0, :2], atol=1e-10)
        assert contour.path.turns.max() < 1e-9 and len(contour.path) < 80
    assert len(only(alone("ellipse", (0, 0), (40, 10), 1.0, 0.1, 4)[0]).path) == 1


RANDOM = np.random.default_rng(1)
CONTROL = [tuple(x) for x in np.column_stack([RANDOM.uniform(0, 100, (9, 2)), np.zeros(9)])]


def test_splines_of_all_kinds_are_read():
    document, space = drawing()
    moved = []
    for a, b in itertools.product((0, 200), (0, 200)):
        moved.append([(x + a, y + b, z) for x, y, z in CONTROL])
    space.add_open_spline(moved[0])
    space.add_rational_spline(moved[1], [1, 2, 1, 0.3, 5, 1, 1, 2, 1])
    space.add_open_spline(moved[2], degree=2)
    space.add_open_spline(moved[3], degree=5)
    for tolerance in (1e-4, 1e-6):
        contours = read(document, chord_tolerance=tolerance).contours
        for entity, contour in zip(space, contours, strict=True):
            tool = entity.construction_tool()
            points = [tuple(p) for p in tool.points(np.linspace(0, tool.max_t, 4001))]
            near([contour.path], [points], tolerance)
            # Inside, a spline of degree 2 or more has no corner.
            assert contour.path.turns.max() < 1e-8
    # Splines that are circles, that are closed, and with more knots than they need.
    weights = [1, np.sqrt(0.5), 1, np.sqrt(0.5), 1]
    knots = [0, 0, 0, 1, 1, 2, 2, 2]
    points = [(50, 0, 0), (50, 50, 0), (0, 50, 0), (-50, 50, 0), (-50, 0, 0)]
    path = only(alone("rational_spline", points, weights, degree=2, knots=knots)[0]).path
    assert len(path) == 1
    np.testing.assert_allclose(path.lengths, np.pi * 0.05, rtol=1e-12)
    document, x = alone("spline")
    x.set_closed(CONTROL)
    contour = only(document)
    knots = np.array(x.knots)
    points = np.array([tuple(p) for p in x.control_points])
    near([contour.path], [BSpline(knots, points, 3)(np.linspace(knots[3], knots[-4], 20001))])
    assert contour.closed and contour.path.turns.max() < 1e-9
    ends = contour.path(0.0, 1), contour.path(contour.path.length, 1)
    np.testing.assert_allclose(*ends, atol=1e-9)
    for extra in (1, 2):
        document, x = alone("open_spline", CONTROL)
        # Its first control points then count for nothing.
        x.knots = [*np.zeros(4 + extra), *np.arange(1, 6 - extra), *np.full(4, 7.0)]
        path = only(document).path
        near([path], [BSpline(x.knots, np.array(CONTROL), 3)(np.linspace(0, 7, 4001))])
        np.testing.assert_allclose(path(0.0), MM * np.array(CONTROL[extra][:2]), atol=1e-12)
    expected = 3 * np.hypot(2 * np.pi * 10, 2) * MM
    assert only(alone("helix", 10, 2, 3)[0]).path.length == pytest.approx(expected, rel=1e-3)


def fit(points, **ends):
    points = np.array(points, dtype=float)
    parameter = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return CubicSpline(parameter, points, **ends)(np.linspace(0, parameter[-1], 20001))


def test_splines_through_points_are_read():
    document, x = alone("spline", CONTROL)
    path = as_ezdxf_says(document).path
    near([path], [fit(CONTROL, bc_type="natural")])
    x.dxf.start_tangent = (0, 2, 0)
    x.dxf.end_tangent = (3, 0, 0)
    path = only(document).path
    near([path], [fit(CONTROL, bc_type=((1, (0, 1, 0)), (1, (1, 0, 0))))])
    np.testing.assert_allclose(path(0.0, 1), (0, 1), atol=1e-9)
    document, x = alone("spline", CONTROL)
    x.closed = True
    contour = only(document)
    near([contour.path], [fit([*CONTROL, CONTROL[0]], bc_type="periodic")])
    assert contour.closed


def test_broken_and_unknown_entities_are_refused_by_name_or_skipped():
    for name, value, words in (
        ("knots", [0, 0, 0, 0, 1], "9 control points and 5 knots"),
        ("knots", np.zeros(13), "do not increase"),
        ("knots", [0, 0, 0, 0, 1, 1, 1, 1, 2, 3, 3, 3, 3], "more than 3 times"),
        ("weights", [0.0, *np.ones(8)], "9 weights above zero"),
        ("degree", 99, "degree 99"),
    ):
        document, space = drawing()
        space.add_line((0, 0), (10, 0))
        x = space.add_open_spline(CONTROL)
        setattr(x.dxf if name == "degree" else x, name, value)
        handle = f"SPLINE handle {x.dxf.handle}"
        refusals(read, [(document, "part.dxf", handle, words)])
        program = read(document, unknown="skip")
        assert len(program.contours) == 1 and handle in program.notes[0]
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    x = space.new_entity("LINE", {"layer": "cut"})
    data = written(document).replace(b"LINE\n  5\n" + x.dxf.handle.encode(), b"NEWLINE\n  5\nAB")
    words = "NEWLINE handle AB on layer 'cut' ... --skip-unknown"
    refusals(read, [(data, words)])
    program = read(data, unknown="skip")
    assert len(program.contours) == 1 and "NEWLINE handle AB" in program.notes[0]
    assert read(data, layers=frozenset({"0"})).notes == ()


def filled(block):
    """One of everything, of some 20 mm."""
    block.add_line((-1, -1), (20, 5))
    block.add_arc((0, 0), 10, 10, 200)
    block.add_arc((3, 0), 6, 300, 80, dxfattribs={"extrusion": (0, 0, -1)})
    block.add_circle((-5, 8), 3)
    block.add_ellipse((4, 4), (8, 3), 0.3, 0.5, 4)
    points = [(0, 0, 0.4), (8, -3, 0), (12, 9, -2), (1, 20, 0)]
    block.add_lwpolyline(points, format="xyb", close=True)
    block.add_polyline2d([(0, -9, 0.4), (8, -13, 0), (12, -19, 0)], format="xyb")
    block.add_open_spline([(0, 0, 0), (5, 20, 0), (9, -9, 0), (15, 3, 0), (20, 20, 0)])


@pytest.mark.parametrize("seed", range(4))
def test_nested_blocks_are_rotated_scaled_mirrored_and_repeated(seed):
    rng = np.random.default_rng(seed)
    document, space = drawing()
    filled(document.blocks.new("inner", base_point=tuple(rng.uniform(-5, 5, 2))))
    outer = document.blocks.new("outer", base_point=(1, 2))

    def placed(layout, name, even):
        scale = rng.uniform(0.5, 2) * rng.choice([-1, 1], 2)
        factors = scale if not even else scale[0] * np.array([1, rng.choice([-1, 1])])
        insertion = tuple(rng.uniform(-50, 50, 2))
        attributes = {"xscale": factors[0], "yscale": factors[1], "zscale": 1}
        attributes |= {"rotation": rng.uniform(-180, 180), "extrusion": (0, 0, rng.choice([-1, 1]))}
        return layout.add_blockref(name, insertion, dxfattribs=attributes)

    # Uneven scales of the outer block make arcs ellipses, turned ones even skew ones.
    placed(outer, "inner", even=seed % 2)
    x = placed(space, "outer", even=seed % 3 == 0)
    x.dxf.row_count = 2
    x.dxf.column_count = 2
    x.dxf.row_spacing = 90
    x.dxf.column_spacing = -70
    as_ezdxf_says(document, join_tolerance=1e-9)


def test_scaled_blocks_keep_names_layers_and_attributes():
    document, space = drawing()
    filled(document.blocks.new("b"))
    attributes = {"xscale": -1.3, "yscale": 1.3, "zscale": 1.3, "rotation": 77}
    space.add_blockref("b", (7, 8), dxfattribs=attributes)
    contours = read(document, join_tolerance=1e-9).contours
    # Scaled evenly and mirrored, arcs stay arcs.
    lengths = [len(x.path) for x in contours]
    assert lengths[:4] == [1, 1, 1, 1] and lengths[5:7] == [4, 2]
    assert contours[1].path.curvatures[0] == pytest.approx(1 / 0.013)
    assert len({x.name for x in contours}) == len(contours)
    document, space = drawing()
    document.blocks.new("b").add_circle((0, 0), 1)
    counts = {"row_count": 2, "column_count": 3, "row_spacing": 10, "column_spacing": 20}
    space.add_blockref("b", (0, 0), dxfattribs=counts)
    contours = read(document).contours
    assert len(contours) == 6
    starts = [x.path(0.0) for x in contours]
    assert any(np.allclose(x, [41 * MM, 10 * MM], atol=1e-12) for x in starts)
    document, space = drawing()
    block = document.blocks.new("b")
    block.add_line((0, 0), (10, 0))
    block.add_line((0, 0), (0, 10), dxfattribs={"layer": "own"})
    block.add_attdef("NAME", (0, 0))
    x = document.blocks.new("c").add_blockref("b", (0, 0))
    space.add_blockref("c", (0, 0), dxfattribs={"layer": "cut"})
    program = read(document)
    assert [x.layer for x in program.contours] == ["cut", "own"] and program.notes == ()
    # Attributes of a block are text, and their patterns nothing.
    x.add_attrib("NAME", "gasket", (0, 0))
    assert read(document).notes[0].endswith(": ATTRIB.")


def test_drawings_may_be_tilted_or_at_one_height():
    for seed in range(2):
        document, space = drawing()
        tilted = {"extrusion": tuple(np.random.default_rng(seed).normal(size=3))}
        space.add_arc((1, 2, 3), 30, 20, 250, dxfattribs=tilted)
        space.add_circle((1, 2, 3), 12, dxfattribs=tilted)
        points = [(0, 0, 0.4), (30, 5, 0), (12, 40, 0)]
        space.add_lwpolyline(points, format="xyb", dxfattribs={**tilted, "elevation": 5.0})
        filled(document.blocks.new("b"))
        space.add_blockref("b", (1, 2, 30), dxfattribs={**tilted, "rotation": 30})
        program = as_ezdxf_says(document, join_tolerance=1e-9)
        assert program.dimension == 3 and len(program.contours[0].path) == 1
    # Only zero height is in the plane.
    for height, dimension in (((1e-8, -1e-8), 2), ((5, 5), 3)):
        document, space = drawing()
        space.add_line((0, 0, height[0]), (10, 0, height[1]))
        space.add_circle((0, 0, height[0]), 5)
        program = read(document)
        assert program.dimension == dimension
    np.testing.assert_allclose(program.contours[1].path.starts[:, 2], 0.005)


def test_coordinates_have_the_unit_of_the_drawing(refuses):
    for code, metres in UNITS.items():
        document, space = drawing(units=code)
        space.add_line((0, 0), (1e-3 / metres, 0))
        assert only(document).path.length == pytest.approx(1e-3), code
        # ezdxf has the inverse, and not for all units.
        theirs = ezdxf.units.METER_FACTOR[code]
        assert theirs is None or metres == pytest.approx(1 / theirs, rel=1e-5), code
    document, _ = alone("line", (0, 0), (10, 0))
    assert only(document, units=0.0254).path.length == pytest.approx(0.254)
    document.units = 0
    assert only(document, units=MM).path.length == pytest.approx(0.01)
    refusals(read, [(document, "part.dxf ... $INSUNITS ... mm")])
    document.units = 20
    refuses(lambda: read(document), ac.InvalidInput, "unit 20")


def pairs(*tags):
    return "".join(f"{code}\n{value}\n" for code, value in tags).encode()


def bare(*entity, header=b""):
    """A file as generators write it, with the tags of one entity."""
    begin = (0, "SECTION"), (2, "ENTITIES")
    end = (0, "ENDSEC"), (0, "EOF")
    return header + pairs(*begin, *entity, *end)


CUT = ((0, "LINE"), (8, "CUT"), (10, 0), (20, 0), (11, 10), (21, 0))


def test_a_file_without_a_header_has_no_unit(refuses):
    r12 = pairs((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"), (0, "ENDSEC"))
    for header in (b"", r12, r12.replace(b"AC1009", b"AC1015")):
        refusals(read, [(bare(*CUT, header=header), "part.dxf ... $INSUNITS ... mm")])
        assert only(bare(*CUT, header=header), units=MM).path.length == pytest.approx(0.01)
    stated = r12.replace(b"0\nENDSEC", b"9\n$INSUNITS\n70\n1\n0\nENDSEC")
    assert only(bare(*CUT, header=stated)).path.length == pytest.approx(0.254)


def test_entities_that_are_not_contours_are_skipped_and_counted():
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    space.add_text("gasket").dxf.layer = "notes"
    space.add_mtext("gasket")
    space.add_point((1, 1))
    space.add_point((2, 1))
    space.add_hatch().paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])
    space.add_3dface([(0, 0), (1, 0), (1, 1), (0, 1)])
    space.add_solid([(0, 0), (1, 0), (1, 1)])
    space.add_linear_dim(base=(0, 2), p1=(0, 0), p2=(3, 0)).render()
    space.add_polymesh((3, 3))
    space.add_xline((0, 0), (1, 0))
    program = read(document)
    assert len(program.contours) == 1
    (note,) = program.notes
    others = note.rstrip(".").split(": ")[-1]
    kinds = "TEXT, 3DFACE, DIMENSION, HATCH, MTEXT, 2 POINT, SOLID, XLINE, mesh".split(", ")
    assert sorted(others.split(", ")) == sorted(kinds)
    document, space = drawing()
    refuses_nothing = [(document, "part.dxf has no contour")]
    refusals(read, refuses_nothing)
    space.add_text("x")
    refusals(lambda x: read(x, unknown="skip"), refuses_nothing, "TEXT")


def test_a_truncated_file_is_refused(refuses):
    document, space = drawing()
    for k in range(10):
        space.add_line((0, k), (10, k))
    data = written(document)
    assert read(document).notes == ()
    for end in (data.rindex(b"ENDSEC"), -20):
        (note,) = read(data[:end]).notes
        assert "no end mark (EOF)" in note
    half = data[: data.index(b"\nENTITIES") + 5]
    refuses(lambda: read(half), ac.InvalidInput, "cut off")
    damaged = re.sub(rb" +0\nENDSEC\n( +0\nSECTION\n +2\nENTITIES)", rb"\1", data)
    program = read(damaged)
    assert len(program.contours) == 10 and "repaired in 1 place;" in program.notes[0]


def test_colors_select_contours_by_number_name_layer_and_block():
    document, space = drawing()
    document.layers.add("red", color=1)
    document.layers.add("true", true_color=colors.rgb2int((255, 0, 0)))
    document.blocks.new("b").add_line((0, 0), (0, 1), dxfattribs={"color": 0})
    space.add_line((0, 0), (10, 0), dxfattribs={"layer": "red"})
    space.add_line((0, 1), (20, 1), dxfattribs={"layer": "true"})
    space.add_line((0, 2), (30, 2), dxfattribs={"layer": "red", "color": 5})
    space.add_line((0, 3), (40, 3))
    space.add_blockref("b", (0, 50), dxfattribs={"color": 1})

    def lengths(*colors):
        program = read(document, colors=colors)
        return [round(x.path.length / MM) for x in program.contours]

    assert lengths("red") == lengths("#F00") == [10, 20, 1]
    assert lengths(1) == [10, 1]
    assert lengths("blue", 7) == [30, 40]
    assert lengths("black") == lengths("white") == [40]
    refusals(lengths, [("green", "#000000 ... #0000ff ... 3 #ff0000")])


def test_a_clipped_insert_is_refused():
    document, space = drawing()
    block = document.blocks.new("b", base_point=(1, 1))
    block.add_line((-4, 2), (-1, 2))
    x = space.add_blockref("b", (50, 0))
    clip = XClip(x)
    clip.set_block_clipping_path([(-5, -9), (0, -9), (0, 9), (-5, 9)])
    refusals(read, [(document, f"INSERT handle {x.dxf.handle} on layer '0' is clipped")])
    clip.disable_clipping()
    assert len(read(document).contours) == 1


def test_layers_that_are_off_or_frozen_are_skipped_and_counted():
    document, space = drawing()
    document.layers.add("hidden").off()
    document.layers.add("Cold").freeze()
    block = document.blocks.new("b")
    block.add_line((0, 0), (10, 0))
    block.add_line((0, 0), (0, 10), dxfattribs={"layer": "cut"})
    space.add_line((0, 5), (10, 5), dxfattribs={"layer": "cut"})
    space.add_line((0, 6), (10, 6), dxfattribs={"layer": "HIDDEN"})
    # Off hides what the block has on layer 0, frozen all of it.
    space.add_blockref("b", (20, 0), dxfattribs={"layer": "hidden"})
    space.add_blockref("b", (40, 0), dxfattribs={"layer": "cold"})
    space.add_line((0, 7), (1, 7)).dxf.invisible = 1
    program = read(document)
    assert [x.layer for x in program.contours] == ["cut", "cut"]
    hidden, invisible = program.notes
    assert hidden.endswith(": 2 hidden, Cold.") and invisible.endswith("invisible: LINE.")


def test_layers_that_are_not_plotted_are_read_only_by_name():
    document, space = drawing()
    document.layers.add("guides").dxf.plot = 0
    document.layers.add("locked").lock()
    block = document.blocks.new("b")
    block.add_line((0, 0), (10, 0))
    block.add_line((0, 0), (0, 10), dxfattribs={"layer": "locked"})
    for k, layer in enumerate(("locked", "guides", "Defpoints")):
        space.add_line((0, k), (10, k), dxfattribs={"layer": layer})
    space.add_blockref("b", (20, 0), dxfattribs={"layer": "GUIDES"})
    program = read(document)
    assert [x.layer for x in program.contours] == ["locked", "locked"]
    (note,) = program.notes
    assert "not plotted" in note and note.endswith(": 2 guides, Defpoints.")
    program = read(document, layers=["guides", "Defpoints"])
    assert [x.layer for x in program.contours] == ["guides", "Defpoints", "guides"]
    assert program.notes == ()
    # A layer without an entry in the table of layers, and a drawing without anything else.
    points = "0|LINE|8|DEFPOINTS|10|0|20|0|11|9|21|0|"
    assert len(from_hand(LINE + points).contours) == 1
    refusals(from_hand, [(points, "no contour ... not plotted ... --layer: Defpoints")])


NUMBERS = [
    ("0|LINE|8|0|10|0|20|0|11|10|21|0|", [10, 20, 11, 21]),
    ("0|CIRCLE|8|0|10|0|20|0|40|5|", [10, 20, 40]),
    ("0|ARC|8|0|10|0|20|0|40|5|50|10|51|80|", [40, 50, 51]),
    ("0|ELLIPSE|8|0|10|0|20|0|11|5|21|0|40|1|41|0|42|3|", [11, 21, 40, 42]),
    ("0|POLYLINE|8|0|66|1|0|VERTEX|8|0|10|0|20|0|42|1|0|VERTEX|8|0|10|9|20|0|0|SEQEND|", [20, 42]),
    ("0|INSERT|2|A|8|0|10|0|20|0|41|2|42|2|50|30|70|2|44|20|", [10, 41, 50, 70, 44]),
]


@pytest.mark.parametrize("wrong", ["12,7", "-1.#IND", ""])
def test_dxf_values_that_are_not_numbers_are_refused(wrong):
    blocks = f"0|BLOCK|8|0|2|A|70|0|10|0|20|0|{LINE}0|ENDBLK|8|0|"
    for entity, codes in NUMBERS:
        assert from_hand(entity, blocks).contours
        for code in codes:
            tags = entity.split("|")
            k = max(i for i in range(0, len(tags) - 1, 2) if tags[i] == str(code))
            tags[k + 1] = wrong
            damaged = "|".join(tags)
            refusals(
                lambda x: from_hand(x, blocks),
                [(damaged, f"{wrong!r} in line ... group code {code}) ... a decimal point")],
            )
    assert read(from_text("0|LINE|8|0|10|0|20|0|11|1.5E+1|21|-.5|"), units=MM).contours
    # Numbers that no contour needs are not compared.
    read(from_text(LINE + "0|TEXT|8|0|10|0|20|0|40|2,5|1|a|"), units=MM)


@pytest.mark.parametrize("version", ["R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018"])
def test_all_dxf_versions_are_read_as_text_and_binary(version):
    document, space = drawing(version)
    points = [(0, 0, 0.5), (50, 0, 0), (50, 50, 0)]
    add = space.add_polyline2d if version == "R12" else space.add_lwpolyline
    add(points, format="xyb", close=True)
    space.add_circle((0, 0), 5, dxfattribs={"layer": "Löcher"})
    data = written(document)
    binary = io.BytesIO()
    document.write(binary, fmt="bin")
    for form in (data, data.replace(b"\n", b"\r\n"), binary.getvalue()):
        program = read(form, units=MM)
        assert [x.layer for x in program.contours] == ["0", "Löcher"]
        assert [len(x.path) for x in program.contours] == [3, 1]
        assert program.source == "part.dxf"


AT = "5|A0|8|0|10|0|20|0"
LINE = f"0|LINE|{AT}|11|10|21|0|"


def from_text(entities, blocks=""):
    """A small DXF file of group codes and values, | between them."""
    parts = "9|$ACADVER|1|AC1009|", blocks, entities
    names = "HEADER", "BLOCKS", "ENTITIES"
    text = "".join(f"0|SECTION|2|{a}|{b}0|ENDSEC|" for a, b in zip(names, parts, strict=True))
    return f"{text}0|EOF|".replace("|", "\n").encode()


def from_hand(entities, blocks="", **options):
    return read(from_text(entities, blocks), units=MM, **options)


def block(name, *inserts):
    body = "".join(f"0|INSERT|2|{x}|{AT}|" for x in inserts)
    return f"0|BLOCK|8|0|2|{name}|70|0|10|0|20|0|{LINE}{body}0|ENDBLK|8|0|"


def test_a_dxf_file_with_entities_only_is_read():
    program = from_hand(LINE)
    assert program.contours[0].name == "0-1"
    assert program.path.length == pytest.approx(0.01)


def test_invalid_values_of_entities_are_refused():
    table = f"""
0|LINE|{AT}| => LINE handle A0 ... layer '0' ... no end
0|LINE|{AT}|11|1e12|21|0| => 1e+09 m ... 1e+06 m ... origin ... unit
0|LINE|{AT}|11|1e308|21|1e308| => 1e+06 m
0|LINE|{AT}|11|nan|21|0| => not finite
0|CIRCLE|{AT}| => CIRCLE ... no radius
0|CIRCLE|{AT}|40|-1| => radius -1
0|ARC|{AT}|40|1|50|inf|51|9| => angles ... not finite
0|INSERT|2|none|{AT}| => block 'none'
0|LINE|{AT}|11|x|21|0| => 'x' in line ... LINE, group code 11
"""
    refusals(from_hand, table, "part.dxf")


INSERT_OF_A = f"0|INSERT|2|A|{AT}|"


def test_blocks_that_contain_themselves_or_grow_without_bound_are_refused():
    # Each of 40 blocks contains the next one twice.
    doubling = "".join(block(f"B{i}", *[f"B{i + 1}"] * 2) for i in range(40))
    table = [
        (block("A", "B") + block("B", "a"), "'a' in itself"),
        (block("A", "B0") + doubling + block("B40"), "copied"),
    ]
    refusals(lambda blocks: from_hand(INSERT_OF_A, blocks), table)


def test_arrays_with_too_many_copies_of_a_block_are_refused():
    # Each copy contains six lines.
    blocks = block("A", *["B"] * 5) + block("B")
    rows_and_columns = [(30000, 30000), (2_000_000_000, 1), (400, 200), (30000, 3)]
    arrays = [
        f"{INSERT_OF_A}70|{columns}|71|{rows}|44|5|45|5|" for rows, columns in rows_and_columns
    ]
    table = [(x, "INSERT handle A0 ... copied") for x in arrays]
    refusals(lambda array: from_hand(array, blocks), table)


def test_files_that_are_not_dxf_are_refused():
    table = [
        (b"", "empty"),
        (b"\x00\xff\x12 not a drawing", "DXF"),
        (b"AC1032\x00\x00", "DWG ... Save it as DXF"),
        (b"  0\nSECTION\nwhat\nENTITIES\n", "cannot be read as DXF"),
        (b"AutoCAD Binary DXF\r\n\x1a\x00\x01\x02", "DXF"),
    ]
    refusals(read, table, "part.dxf")


def test_invalid_contour_names_become_printable_and_short():
    document, space = drawing()
    for k in range(2):
        space.add_line((0, 10 * k), (5, 10 * k), dxfattribs={"layer": f"LAYER{k}"})
    data = written(document).replace(b"LAYER0", b"a\x1b]52;c").replace(b"LAYER1", b"l" * 100)
    layers = [x.layer for x in read(data).contours]
    assert layers[0] == r"a\x1b]52;c" and len(layers[1]) == 80


def test_dashed_lines_are_read_with_a_note():
    document = ezdxf.new("R2010", setup=True)
    document.units = 4
    space = document.modelspace()
    document.layers.add("FOLD", linetype="DASHED")
    space.add_line((0, 0), (10, 0), dxfattribs={"linetype": "CENTER"})
    space.add_line((0, 5), (10, 5), dxfattribs={"layer": "FOLD"})
    space.add_line((0, 9), (10, 9), dxfattribs={"layer": "FOLD", "linetype": "CONTINUOUS"})
    space.add_line((0, 12), (10, 12))
    program = read(document)
    assert len(program.contours) == 4
    (note,) = program.notes
    assert "dashes" in note and "2" in note
    continuous, space = drawing()
    space.add_line((0, 0), (10, 0))
    assert not read(continuous).notes
