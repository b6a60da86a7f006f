"""DXF drawings made with ezdxf, read back, and compared with formulas and ezdxf's own lines."""

from __future__ import annotations

import io
import logging
import re
import subprocess
import sys
import time

import ezdxf
import numpy as np
import pytest
from ezdxf import colors
from ezdxf.fonts import fonts
from ezdxf.xclip import XClip
from scipy.interpolate import BSpline, CubicSpline

import armcontour as ac
from armcontour.io.drawings.colors import color_set
from armcontour.io.drawings.dxf import UNITS, read_dxf
from armcontour.io.drawings.reading import Reading
from armcontour.program import Program

MM = 1e-3
TOLERANCE = 1e-5


def drawing(version="R2010", units=4):
    """A new document in mm and its model space."""
    document = ezdxf.new(version)
    if version != "R12":
        document.units = units
    return document, document.modelspace()


def written(document):
    text = io.StringIO()
    document.write(text)
    return text.getvalue().encode(document.output_encoding, errors="surrogateescape")


def read(document, **options):
    return read_dxf(written(document), source="part.dxf", reading=Reading(**options))


def only(document, **options):
    (contour,) = read(document, **options).contours
    return contour


def near(paths, polylines, tolerance=TOLERANCE):
    """Paths, and fine polylines [mm] along what was drawn, are near each other, both ways."""
    drawn = []
    for points in polylines:
        points = MM * np.asarray(points, dtype=float)
        if paths[0].dimension == 2:
            assert np.abs(points[:, 2:]).max(initial=0) < 1e-9
        drawn.append(ac.Path.polyline(points[:, : paths[0].dimension]))
    here, there = ([(x, sampled(x)) for x in some] for some in (paths, drawn))
    for these, others in ((here, there), (there, here)):
        for _, points in these:
            low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
            apart = np.min(
                [
                    other.project(points).distance
                    for other, own in others
                    if np.all(own.min(axis=0) <= high) and np.all(own.max(axis=0) >= low)
                ],
                axis=0,
            )
            assert apart.max() <= tolerance + FLAT


def sampled(path):
    return np.concatenate([path(np.linspace(0, path.length, 300)), path.vertices])


# What is farther apart in all of their points is not near each other [m].
MARGIN = 1e-3


# How far such polylines are from what is drawn [m].
FLAT = 2e-7


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
    """What a block draws, by ezdxf."""
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


def test_a_line_is_one_line():
    document, space = drawing()
    space.add_line((10, 20), (110, 20), dxfattribs={"layer": "cut"})
    contour = only(document)
    assert contour.layer == "cut" and contour.name == f"handle {space[0].dxf.handle}"
    np.testing.assert_array_equal(contour.path.vertices, [(0.01, 0.02), (0.11, 0.02)])
    assert not contour.closed


def test_an_arc_is_one_arc_and_a_circle_a_full_one():
    document, space = drawing()
    space.add_arc((10, 0), 50, 30, 300)
    space.add_circle((200, 0), 25)
    arc, circle = read(document).contours
    assert len(arc.path) == len(circle.path) == 1
    np.testing.assert_allclose(arc.path.curvatures, 20)
    np.testing.assert_allclose(arc.path.lengths, 0.05 * np.radians(270))
    start = (0.01 + 0.05 * np.cos(np.pi / 6), 0.05 * np.sin(np.pi / 6))
    np.testing.assert_allclose(arc.path.starts[0], start)
    np.testing.assert_allclose(circle.path.lengths, 2 * np.pi * 0.025)
    assert circle.closed and not arc.closed


@pytest.mark.parametrize(
    ("begin", "end", "sweep"), [(350, 10, 20), (90, 90, 360), (0, 360, 360), (-30, 400, 70)]
)
def test_arcs_run_counter_clockwise_from_their_start(begin, end, sweep):
    document, space = drawing()
    space.add_arc((0, 0), 50, begin, end)
    contour = only(document)
    np.testing.assert_allclose(contour.path.lengths, 0.05 * np.radians(sweep))
    at = np.radians(begin + sweep / 3)
    middle = contour.path(contour.path.length / 3)
    np.testing.assert_allclose(middle, 0.05 * np.array([np.cos(at), np.sin(at)]), atol=1e-12)


def test_an_extrusion_downwards_mirrors():
    document, space = drawing()
    space.add_arc((10, 5), 50, 0, 90, dxfattribs={"extrusion": (0, 0, -1)})
    path = only(document).path
    assert path.dimension == 2 and len(path) == 1
    np.testing.assert_allclose(path.vertices, [(-0.06, 0.005), (-0.01, 0.055)], atol=1e-15)
    as_ezdxf_says(document)


def test_bulges_are_arcs():
    document, space = drawing()
    points = [(0, 0, 0.5), (50, 0, 0), (60, 40, -1), (0, 40, 0.2)]
    space.add_lwpolyline(points, format="xyb", close=True)
    contour = as_ezdxf_says(document).contours[0]
    assert contour.closed and len(contour.path) == 4
    assert (contour.path.curvatures > 0).tolist() == [True, False, True, True]
    turn = contour.path.curvatures * contour.path.lengths
    np.testing.assert_allclose(turn, 4 * np.arctan([0.5, 0, 1, 0.2]), atol=1e-12)
    assert contour.path.curvatures[2] == pytest.approx(1 / 0.03)


def test_polylines_of_old_drawings():
    document, space = drawing("R12")
    space.add_polyline2d([(0, 0, 1), (50, 0, 0), (50, 50, 0)], format="xyb", close=True)
    contour = only(document, unit=MM)
    assert contour.closed and (contour.path.curvatures > 0).tolist() == [True, False, False]
    near([contour.path], densely(space))


def test_a_polyline_in_space_and_points_that_repeat():
    document, space = drawing()
    points = [(0, 0, 0), (10, 0, 0), (10, 0, 0), (10, 10, 5), (0, 10, 5), (0, 10, 5)]
    space.add_polyline3d(points)
    contour = only(document)
    np.testing.assert_allclose(contour.path.vertices, MM * np.array(points)[[0, 1, 3, 4]])


def test_the_frame_of_a_fitted_polyline_is_not_drawn():
    document, space = drawing()
    x = space.add_polyline2d([(0, 0), (9, 9), (10, 0)])
    x.vertices[1].dxf.flags = 16
    assert len(only(document).path) == 1


@pytest.mark.parametrize(("begin", "end"), [(0, 2 * np.pi), (0.3, 2.5), (5, 1), (0, 6.28318530718)])
@pytest.mark.parametrize("flip", [1, -1])
def test_ellipses(begin, end, flip):
    document, space = drawing()
    space.add_ellipse((5, 6), (40, 10), 0.4, begin, end, dxfattribs={"extrusion": (0, 0, flip)})
    contour = only(document)
    whole = begin == 0
    sweep = 2 * np.pi if whole else (end - begin) % (2 * np.pi)
    t = begin + np.linspace(0, sweep, 20001)[:, None]
    minor = flip * 0.4 * np.array([-10, 40, 0])
    points = np.array([5, 6, 0]) + np.cos(t) * [40, 10, 0] + np.sin(t) * minor
    near([contour.path], [points])
    assert contour.closed == whole
    np.testing.assert_allclose(contour.path(0.0), MM * points[0, :2], atol=1e-10)
    assert contour.path.turns.max() < 1e-9 and len(contour.path) < 80


def test_an_ellipse_that_is_a_circle_is_one_arc():
    document, space = drawing()
    space.add_ellipse((0, 0), (40, 10), 1.0, 0.1, 4)
    assert len(only(document).path) == 1


RANDOM = np.random.default_rng(1)
CONTROL = [tuple(x) for x in np.column_stack([RANDOM.uniform(0, 100, (9, 2)), np.zeros(9)])]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
def test_splines_of_all_kinds(tolerance):
    document, space = drawing()
    space.add_open_spline(CONTROL)
    space.add_rational_spline(
        [(x + 200, y, z) for x, y, z in CONTROL], [1, 2, 1, 0.3, 5, 1, 1, 2, 1]
    )
    space.add_open_spline([(x, y + 200, z) for x, y, z in CONTROL], degree=2)
    space.add_open_spline([(x + 200, y + 200, z) for x, y, z in CONTROL], degree=5)
    program = read(document, chord_tolerance=tolerance)
    assert len(program.contours) == 4
    for entity, contour in zip(space, program.contours, strict=True):
        tool = entity.construction_tool()
        points = [tuple(p) for p in tool.points(np.linspace(0, tool.max_t, 4001))]
        near([contour.path], [points], tolerance)
        # Inside, a spline of degree 2 or more has no corner.
        assert contour.path.turns.max() < 1e-8


def test_a_spline_with_weights_that_is_a_circle_is_one_arc():
    document, space = drawing()
    w = np.sqrt(0.5)
    points = [(50, 0, 0), (50, 50, 0), (0, 50, 0), (-50, 50, 0), (-50, 0, 0)]
    space.add_rational_spline(points, [1, w, 1, w, 1], degree=2, knots=[0, 0, 0, 1, 1, 2, 2, 2])
    path = only(document).path
    assert len(path) == 1
    np.testing.assert_allclose(path.lengths, np.pi * 0.05, rtol=1e-12)


def test_a_closed_spline_is_closed_and_smooth_all_around():
    document, space = drawing()
    x = space.add_spline()
    x.set_closed(CONTROL)
    contour = only(document)
    knots, points = np.array(x.knots), np.array([tuple(p) for p in x.control_points])
    whole = BSpline(knots, points, 3)
    t = np.linspace(knots[3], knots[len(points)], 20001)
    near([contour.path], [whole(t)])
    assert contour.closed and contour.path.turns.max() < 1e-9
    ends = contour.path(0.0, 1), contour.path(contour.path.length, 1)
    np.testing.assert_allclose(*ends, atol=1e-9)


def fit(points, **ends):
    points = np.array(points, dtype=float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return CubicSpline(at, points, **ends)(np.linspace(0, at[-1], 20001))


def test_a_spline_through_points():
    document, space = drawing()
    space.add_spline(CONTROL)
    contour = only(document)
    near([contour.path], [fit(CONTROL, bc_type="natural")])
    # As ezdxf takes it to be drawn, too.
    near([contour.path], densely(space))


def test_a_spline_through_points_with_tangents_at_its_ends():
    document, space = drawing()
    x = space.add_spline(CONTROL)
    x.dxf.start_tangent, x.dxf.end_tangent = (0, 2, 0), (3, 0, 0)
    contour = only(document)
    points = fit(CONTROL, bc_type=((1, (0, 1, 0)), (1, (1, 0, 0))))
    near([contour.path], [points])
    np.testing.assert_allclose(contour.path(0.0, 1), (0, 1), atol=1e-9)


def test_a_closed_spline_through_points():
    document, space = drawing()
    space.add_spline(CONTROL).closed = True
    contour = only(document)
    points = fit([*CONTROL, CONTROL[0]], bc_type="periodic")
    near([contour.path], [points])
    assert contour.closed


def filled(block):
    """One of everything, of some 20 mm."""
    block.add_line((-1, -1), (20, 5))
    block.add_arc((0, 0), 10, 10, 200)
    block.add_arc((3, 0), 6, 300, 80, dxfattribs={"extrusion": (0, 0, -1)})
    block.add_circle((-5, 8), 3)
    block.add_ellipse((4, 4), (8, 3), 0.3, 0.5, 4)
    block.add_lwpolyline(
        [(0, 0, 0.4), (8, -3, 0), (12, 9, -2), (1, 20, 0)], format="xyb", close=True
    )
    block.add_polyline2d([(0, -9, 0.4), (8, -13, 0), (12, -19, 0)], format="xyb")
    block.add_open_spline([(0, 0, 0), (5, 20, 0), (9, -9, 0), (15, 3, 0), (20, 20, 0)])


@pytest.mark.parametrize("seed", range(6))
def test_blocks_in_blocks_turned_scaled_mirrored_and_repeated(seed):
    rng = np.random.default_rng(seed)
    document, space = drawing()
    filled(document.blocks.new("inner", base_point=tuple(rng.uniform(-5, 5, 2))))
    outer = document.blocks.new("outer", base_point=(1, 2))

    def placed(layout, name, even):
        scale = rng.uniform(0.5, 2) * rng.choice([-1, 1], 2)
        factors = scale if not even else scale[0] * np.array([1, rng.choice([-1, 1])])
        return layout.add_blockref(
            name,
            tuple(rng.uniform(-50, 50, 2)),
            dxfattribs={
                "xscale": factors[0],
                "yscale": factors[1],
                "zscale": 1,
                "rotation": rng.uniform(-180, 180),
                "extrusion": (0, 0, rng.choice([-1, 1])),
            },
        )

    # Uneven scales of the outer block make arcs ellipses, turned ones even skew ones.
    placed(outer, "inner", even=seed % 2)
    x = placed(space, "outer", even=seed % 3 == 0)
    x.dxf.row_count, x.dxf.column_count = 2, 2
    x.dxf.row_spacing, x.dxf.column_spacing = 90, -70
    as_ezdxf_says(document, join_tolerance=1e-9)


def test_arcs_in_an_evenly_scaled_and_mirrored_block_stay_arcs():
    document, space = drawing()
    filled(document.blocks.new("b"))
    attributes = {"xscale": -1.3, "yscale": 1.3, "zscale": 1.3, "rotation": 77}
    space.add_blockref("b", (7, 8), dxfattribs=attributes)
    handle = space[0].dxf.handle
    contours = read(document, join_tolerance=1e-9).contours
    lengths = [len(x.path) for x in contours]
    assert lengths[:4] == [1, 1, 1, 1] and lengths[5:7] == [4, 2]
    assert contours[1].path.curvatures[0] == pytest.approx(1 / 0.013)
    assert all(x.name.startswith(f"handle {handle}/") for x in contours)


def test_an_arc_in_an_unevenly_scaled_block_is_an_ellipse():
    document, space = drawing()
    document.blocks.new("b").add_circle((1, 0), 10)
    space.add_blockref("b", (5, 0), dxfattribs={"xscale": 4, "yscale": 1, "rotation": 90})
    contour = only(document)
    t = np.linspace(0, 2 * np.pi, 20001)
    points = np.column_stack([5 - 10 * np.sin(t), 4 + 40 * np.cos(t), 0 * t])
    near([contour.path], [points])
    assert contour.closed


@pytest.mark.parametrize("seed", range(4))
def test_drawings_tilted_in_space(seed):
    rng = np.random.default_rng(seed)
    document, space = drawing()
    normal = tuple(rng.normal(size=3))
    space.add_arc((1, 2, 3), 30, 20, 250, dxfattribs={"extrusion": normal})
    space.add_circle((1, 2, 3), 12, dxfattribs={"extrusion": normal})
    x = space.add_lwpolyline([(0, 0, 0.4), (30, 5, 0), (12, 40, 0)], format="xyb")
    x.dxf.extrusion, x.dxf.elevation = normal, 5.0
    block = document.blocks.new("b")
    filled(block)
    space.add_blockref("b", (1, 2, 30), dxfattribs={"extrusion": normal, "rotation": 30})
    program = as_ezdxf_says(document, join_tolerance=1e-9)
    assert program.dimension == 3 and len(program.contours[0].path) == 1


def test_a_drawing_at_one_height_is_in_the_plane_only_at_zero():
    document, space = drawing()
    space.add_line((0, 0, 1e-8), (10, 0, -1e-8))
    assert read(document).dimension == 2
    document, space = drawing()
    space.add_line((0, 0, 5), (10, 0, 5))
    space.add_circle((0, 0, 5), 5)
    program = read(document)
    assert program.dimension == 3
    np.testing.assert_allclose(program.contours[1].path.starts[:, 2], 0.005)


def test_pieces_are_chained_and_gaps_of_the_join_tolerance_closed():
    document, space = drawing()
    space.add_arc((50, 50), 50, 0, 180)
    space.add_line((0, 50), (0, 0))
    space.add_line((100, 0), (0, 0.004))
    space.add_line((100, 0), (100, 50))
    contour = only(document)
    assert contour.closed and len(contour.path) == 4
    assert contour.name == f"handle {space[0].dxf.handle}"
    np.testing.assert_allclose(contour.path.curvatures, [20, 0, 0, 0], rtol=1e-4)
    assert len(read(document, join_tolerance=1e-6).contours) == 1
    assert not read(document, join_tolerance=1e-6).contours[0].closed


@pytest.mark.parametrize("code", UNITS)
def test_the_unit_of_the_drawing(code):
    document, space = drawing(units=code)
    space.add_line((0, 0), (1e-3 / UNITS[code], 0))
    assert only(document).path.length == pytest.approx(1e-3)


def test_units_are_those_of_ezdxf():
    for code, metres in UNITS.items():
        # What a metre is in that unit; a few are not there.
        theirs = ezdxf.units.METER_FACTOR[code]
        assert theirs is None or metres == pytest.approx(1 / theirs, rel=1e-5)


def test_a_given_unit_overrides_and_none_at_all_is_refused(refuses):
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    assert only(document, unit=0.0254).path.length == pytest.approx(0.254)
    document.units = 0
    words = ("part.dxf does not say its unit", "$INSUNITS", "units: mm")
    refuses(lambda: read(document), ac.InvalidInput, *words)
    assert only(document, unit=MM).path.length == pytest.approx(0.01)
    # Programs write either value, whatever the unit of the drawing is.
    for value in (0, 1):
        document.header["$MEASUREMENT"] = value
        with pytest.raises(ac.InvalidInput) as caught:
            read(document)
        assert "MEASUREMENT" not in str(caught.value)
    document.units = 20
    refuses(lambda: read(document), ac.InvalidInput, "unit 20", "not known")


def unknown_things(document, space):
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


def test_what_is_no_contour_is_left_out_and_counted():
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    unknown_things(document, space)
    program = read(document)
    assert len(program.contours) == 1
    (note,) = program.notes
    assert note == (
        "Left out, because it is no line, arc or curve: 1 3DFACE, 1 DIMENSION, 1 HATCH, 1 MTEXT, "
        "2 POINT, 1 SOLID, 1 TEXT, 1 XLINE, 1 mesh."
    )


def test_what_nobody_knows_is_refused_by_kind_handle_line_and_layer(refuses):
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    x = space.new_entity("LINE", {"layer": "cut"})
    data = written(document).replace(b"LINE\n  5\n" + x.dxf.handle.encode(), b"NEWLINE\n  5\nAB")
    line = data[: data.index(b"NEWLINE")].count(b"\n") + 3
    words = (f"NEWLINE handle AB in line {line} on layer 'cut'", "--skip-unknown", "--layer")
    refuses(lambda: read_dxf(data, source="part.dxf", reading=Reading()), ac.InvalidInput, *words)
    program = read_dxf(data, source="part.dxf", reading=Reading(unknown="skip"))
    assert len(program.contours) == 1 and "NEWLINE handle AB" in program.notes[0]
    other = Reading(layers=frozenset({"0"}))
    assert read_dxf(data, source="part.dxf", reading=other).notes == ()


def test_a_broken_entity_is_named_with_its_line_and_can_be_skipped(refuses):
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    x = space.add_open_spline(CONTROL)
    x.knots = [0, 0, 0, 0, 1]
    handle = x.dxf.handle
    refuses(lambda: read(document), ac.InvalidInput, f"SPLINE handle {handle} in line", "5 knots")
    program = read(document, unknown="skip")
    assert len(program.contours) == 1
    assert "cannot be read: SPLINE handle" in program.notes[0] and "5 knots" in program.notes[0]


def test_a_spline_without_the_marks_of_its_classes_is_read():
    document, space = drawing()
    space.add_open_spline(CONTROL)
    data = written(document)
    begin = data.index(b"\nSPLINE\n")
    end = data.index(b"ENDSEC", begin)
    bare = re.sub(rb"100\nAcDb(Entity|Spline)\n", b"", data[begin:end])
    bare = re.sub(rb"330\n[0-9A-F]+\n", b"", bare)
    program = read_dxf(data[:begin] + bare + data[end:], source="a.dxf", reading=Reading())
    assert program.contours[0].path.length == pytest.approx(only(document).path.length, rel=1e-9)


def test_the_end_of_a_file_that_was_cut_off_is_missed(refuses):
    document, space = drawing()
    for k in range(50):
        space.add_line((0, k), (10, k))
    data = written(document)
    assert read(document).notes == ()
    program = read_dxf(data[: data.rindex(b"ENDSEC")], source="a.dxf", reading=Reading())
    assert any("seems to be cut off" in x for x in program.notes)
    half = data[: data.index(b"\nENTITIES") + 5]
    refuses(lambda: read_dxf(half, source="a.dxf", reading=Reading()), ac.InvalidInput, "cut off")


def test_multilines_and_helices():
    document, space = drawing()
    space.add_mline([(0, 0), (10, 0)])
    program = read(document)
    assert sorted(x.path.length for x in program.contours) == pytest.approx([10 * MM, 10 * MM])
    assert len({x.name for x in program.contours}) == 2
    document, space = drawing()
    space.add_helix(10, 2, 3)
    assert only(document).path.length == pytest.approx(
        3 * np.hypot(2 * np.pi * 10, 2) * MM, rel=1e-3
    )


def test_colors_choose_by_number_name_layer_and_block():
    document, space = drawing()
    document.layers.add("red", color=1)
    document.layers.add("true", true_color=colors.rgb2int((255, 0, 0)))
    block = document.blocks.new("b")
    block.add_line((0, 0), (0, 1), dxfattribs={"color": 0})
    space.add_line((0, 0), (10, 0), dxfattribs={"layer": "red"})
    space.add_line((0, 1), (20, 1), dxfattribs={"layer": "true"})
    space.add_line((0, 2), (30, 2), dxfattribs={"layer": "red", "color": 5})
    space.add_line((0, 3), (40, 3))
    space.add_blockref("b", (0, 50), dxfattribs={"color": 1})

    def lengths(*colors):
        program = read(document, colors=color_set(colors))
        return [round(x.path.length / MM) for x in program.contours]

    assert lengths("red") == lengths("#F00") == [10, 20, 1]
    assert lengths(1) == [10, 1]
    assert lengths("blue", 7) == [30, 40]
    assert lengths("black") == lengths("white") == [40]
    with pytest.raises(ac.InvalidInput, match="1 #000000, 1 #0000ff, 3 #ff0000"):
        lengths("green")


def test_copies_in_rows_and_columns_have_their_own_names():
    document, space = drawing()
    document.blocks.new("b").add_circle((0, 0), 1)
    x = space.add_blockref("b", (0, 0))
    x.dxf.row_count, x.dxf.column_count = 2, 3
    x.dxf.row_spacing, x.dxf.column_spacing = 10, 20
    contours = read(document).contours
    places = {re.search(r"\[(\d),(\d)\]", c.name).groups(): c.path(0.0) for c in contours}
    assert len(places) == 6
    np.testing.assert_allclose(places["2", "3"], [41 * MM, 10 * MM], atol=1e-12)


@pytest.mark.parametrize("inverted", [False, True])
def test_clipped_blocks_are_cut(inverted):
    document, space = drawing()
    block = document.blocks.new("b", base_point=(1, 1))
    block.add_line((-10, 2), (10, 2))
    block.add_circle((0, 2), 3)
    x = space.add_blockref("b", (50, 0), dxfattribs={"xscale": 2, "yscale": 2, "rotation": 30})
    clip = XClip(x)
    clip.set_block_clipping_path([(-5, -9), (0, -9), (0, 9), (-5, 9)])
    if inverted:
        clip.invert_clipping_path([(-20, -20), (20, 20)], ignore_acad_compatibility=True)
    kept = {"line": 20 - 5 if inverted else 5, "circle": 3 * np.pi}
    program = read(document)
    length = sum(c.path.length for c in program.contours)
    assert length == pytest.approx(2 * MM * sum(kept.values()), rel=1e-9)
    m = x.matrix44()
    m.inverse()
    for c in program.contours:
        at = c.path(np.linspace(0, c.path.length, 50)) / MM
        back = np.array([tuple(p) for p in m.transform_vertices([(*p, 0) for p in at])])
        outside = (back[:, 0] < -5 - 1e-9) | (back[:, 0] > 1e-9)
        inside = (back[:, 0] > -5 + 1e-9) & (back[:, 0] < -1e-9)
        assert not (inside if inverted else outside).any()
        np.testing.assert_allclose(
            np.minimum(abs(back[:, 1] - 2), abs(np.hypot(back[:, 0], back[:, 1] - 2) - 3)),
            0.0,
            atol=1e-9,
        )


def test_attributes_of_a_block_are_text_and_their_patterns_nothing():
    document, space = drawing()
    block = document.blocks.new("b")
    block.add_line((0, 0), (10, 0))
    block.add_attdef("NAME", (0, 0))
    x = space.add_blockref("b", (0, 0))
    assert read(document).notes == ()
    x.add_attrib("NAME", "gasket", (0, 0))
    assert read(document).notes == ("Left out, because it is no line, arc or curve: 1 ATTRIB.",)


def test_layers_that_are_off_or_frozen_are_left_out_and_counted():
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
    assert program.notes == (
        "Left out, on layers that are off or frozen: 1 Cold, 2 hidden.",
        "Left out, because they are invisible: 1.",
    )


def test_layer_0_in_a_block_is_the_layer_of_what_places_it():
    document, space = drawing()
    block = document.blocks.new("b")
    block.add_line((0, 0), (10, 0))
    block.add_line((0, 0), (0, 10), dxfattribs={"layer": "own"})
    document.blocks.new("c").add_blockref("b", (0, 0))
    space.add_blockref("c", (0, 0), dxfattribs={"layer": "cut"})
    assert [x.layer for x in read(document).contours] == ["cut", "own"]


def test_what_has_no_length_is_left_out_and_named():
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    x = space.add_line((3, 3), (3, 3))
    y = space.add_lwpolyline([(1, 1)])
    program = read(document)
    assert len(program.contours) == 1
    names = f"handle {y.dxf.handle}, handle {x.dxf.handle}"
    assert program.notes == (f"Left out, because of no length: {names}.",)


def test_a_drawing_of_nothing_is_refused(refuses):
    document, space = drawing()
    refuses(lambda: read(document), ac.InvalidInput, "part.dxf has no contour to follow")
    space.add_text("x")
    refuses(lambda: read(document, unknown="skip"), ac.InvalidInput, "no contour", "1 TEXT")


def a_drawing(version):
    document, space = drawing(version)
    space.add_lwpolyline([(0, 0, 0.5), (50, 0), (50, 50)], format="xyb", close=True) if (
        version != "R12"
    ) else space.add_polyline2d([(0, 0, 0.5), (50, 0, 0), (50, 50, 0)], format="xyb", close=True)
    space.add_circle((0, 0), 5, dxfattribs={"layer": "Löcher"})
    return document


@pytest.mark.parametrize("version", ["R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018"])
@pytest.mark.parametrize("form", ["text", "binary", "text of Windows"])
def test_all_versions_as_text_and_binary(version, form):
    document = a_drawing(version)
    data = written(document)
    if form == "text of Windows":
        data = data.replace(b"\n", b"\r\n")
    elif form == "binary":
        stream = io.BytesIO()
        document.write(stream, fmt="bin")
        data = stream.getvalue()
    program = read_dxf(data, source="part.dxf", reading=Reading(unit=MM))
    assert [x.layer for x in program.contours] == ["0", "Löcher"]
    assert [len(x.path) for x in program.contours] == [3, 1]
    assert program.source == "part.dxf"


ENTITY = "  0\n{}\n  5\nA{}\n  8\n0\n"


def by_hand(*entities, blocks=""):
    """A small DXF file of entities as text, each of group codes and values."""
    text = "  0\nSECTION\n  2\nHEADER\n  9\n$ACADVER\n  1\nAC1009\n  0\nENDSEC\n"
    if blocks:
        text += f"  0\nSECTION\n  2\nBLOCKS\n{blocks}  0\nENDSEC\n"
    body = "".join(
        ENTITY.format(kind, i) + "".join(f"{code:3d}\n{value}\n" for code, value in tags)
        for i, (kind, *tags) in enumerate(entities)
    )
    return (text + f"  0\nSECTION\n  2\nENTITIES\n{body}  0\nENDSEC\n  0\nEOF\n").encode()


def from_hand(*entities, blocks="", **options):
    options = {"unit": MM, **options}
    data = by_hand(*entities, blocks=blocks)
    return read_dxf(data, source="part.dxf", reading=Reading(**options))


LINE = ("LINE", (10, 0), (20, 0), (11, 10), (21, 0))


def test_a_file_of_entities_alone():
    program = from_hand(LINE)
    assert program.contours[0].name == "handle A0"
    assert program.path.length == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("entity", "words"),
    [
        (("LINE", (10, 0), (20, 0)), ("LINE handle A0", "layer '0'", "no end")),
        (
            ("LINE", (10, 0), (20, 0), (11, "1e12"), (21, 0)),
            ("1e+09 m", "further than 1e+06 m", "unit"),
        ),
        (("LINE", (10, 0), (20, 0), (11, "1e308"), (21, "1e308")), ("further than",)),
        (("LINE", (10, 0), (20, 0), (11, "nan"), (21, 0)), ("not finite",)),
        (("CIRCLE", (10, 0), (20, 0)), ("CIRCLE", "no radius")),
        (("CIRCLE", (10, 0), (20, 0), (40, -1)), ("radius of -1", "above zero")),
        (("ARC", (10, 0), (20, 0), (40, 1), (50, "inf"), (51, 9)), ("angles", "not finite")),
        (("INSERT", (2, "none"), (10, 0), (20, 0)), ("block 'none'", "does not exist")),
    ],
)
def test_entities_that_are_wrong_are_refused_by_name(entity, words, refuses):
    refuses(lambda: from_hand(entity), ac.InvalidInput, "part.dxf", *words)


@pytest.mark.parametrize("extra", [1, 2])
def test_a_spline_with_more_equal_knots_at_an_end_than_it_needs(extra):
    document, space = drawing()
    x = space.add_open_spline(CONTROL)
    # Its first control points then count for nothing.
    x.knots = [*np.zeros(4 + extra), *np.arange(1, 6 - extra), *np.full(4, 7.0)]
    whole = BSpline(x.knots, np.array(CONTROL), 3)
    contour = only(document)
    near([contour.path], [whole(np.linspace(0, 7, 4001))])
    np.testing.assert_allclose(contour.path(0.0), MM * np.array(CONTROL[extra][:2]), atol=1e-12)


def spline_by_hand(change):
    document, space = drawing()
    x = space.add_open_spline(CONTROL)
    change(x)
    return document


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: setattr(x, "knots", [0, 0, 0, 0, 1]), ("9 control points and 5 knots",)),
        (lambda x: setattr(x, "knots", [*np.arange(12.0), 3.0]), ("do not increase",)),
        (lambda x: setattr(x, "knots", np.zeros(13)), ("do not increase",)),
        (
            lambda x: setattr(x, "knots", [0, 0, 0, 0, 1, 1, 1, 1, 2, 3, 3, 3, 3]),
            ("is not continuous", "more than 3 times"),
        ),
        (lambda x: setattr(x, "weights", [0.0, *np.ones(8)]), ("9 weights above zero",)),
        (lambda x: setattr(x.dxf, "degree", 99), ("degree 99", "from 1 to 25")),
    ],
)
def test_splines_that_are_wrong_are_refused_by_name(change, words, refuses):
    document = spline_by_hand(change)
    handle = document.modelspace()[0].dxf.handle
    refuses(lambda: read(document), ac.InvalidInput, f"SPLINE handle {handle}", *words)


def block_text(name, *inserts):
    body = "".join(f"  0\nINSERT\n  8\n0\n  2\n{x}\n 10\n0\n 20\n0\n{more}" for x, more in inserts)
    line = "  0\nLINE\n  8\n0\n 10\n0\n 20\n0\n 11\n1\n 21\n1\n"
    head = f"  0\nBLOCK\n  8\n0\n  2\n{name}\n 70\n0\n 10\n0\n 20\n0\n"
    return f"{head}{line}{body}  0\nENDBLK\n  8\n0\n"


INSERT = ("INSERT", (2, "A"), (10, 0), (20, 0))


def test_a_block_in_itself_is_refused(refuses):
    blocks = block_text("A", ("B", "")) + block_text("B", ("a", ""))
    refuses(lambda: from_hand(INSERT, blocks=blocks), ac.InvalidInput, "'a' in itself")


@pytest.mark.parametrize(
    ("rows", "columns"), [(30000, 30000), (2_000_000_000, 1), (400, 200), (30000, 3)]
)
def test_arrays_without_end_are_refused_at_once(rows, columns, refuses):
    many = ("INSERT", (2, "A"), (10, 0), (20, 0), (70, columns), (71, rows), (44, 5), (45, 5))
    # Of 100 lines each, or of many.
    blocks = block_text("A", *[("B", "")] * 5) + block_text("B")
    begin = time.process_time()
    refuses(lambda: from_hand(many, blocks=blocks), ac.InvalidInput, "INSERT handle A0", "copies")
    assert time.process_time() - begin < 3


def test_blocks_that_double_fifty_times_are_refused(refuses):
    twice = "".join(block_text(f"B{i}", *[(f"B{i + 1}", "")] * 2) for i in range(40))
    blocks = block_text("A", ("B0", "")) + twice + block_text("B40")
    refuses(lambda: from_hand(INSERT, blocks=blocks), ac.InvalidInput, "copies")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", ("empty",)),
        (b"\x00\xff\x12 not a drawing", ("no DXF file",)),
        (b"AC1032\x00\x00", ("DWG", "save it as DXF")),
        (b"  0\nSECTION\nwhat\nENTITIES\n", ("no DXF file that can be read",)),
        (b"AutoCAD Binary DXF\r\n\x1a\x00\x01\x02", ("no DXF file",)),
    ],
)
def test_what_is_no_dxf_file_is_refused(data, words, refuses):
    call = lambda: read_dxf(data, source="part.dxf", reading=Reading())  # noqa: E731
    refuses(call, ac.InvalidInput, "part.dxf", *words)


def test_a_damaged_file_is_mended_and_says_so():
    document, space = drawing()
    space.add_line((0, 0), (10, 0))
    data = re.sub(
        rb" +0\nENDSEC\n +0\nSECTION\n +2\nENTITIES",
        b"  0\nSECTION\n  2\nENTITIES",
        written(document),
    )
    program = read_dxf(data, source="part.dxf", reading=Reading())
    assert len(program.contours) == 1
    assert "damaged" in program.notes[0] and "mended in 1 place;" in program.notes[0]
    # Nothing is mended in a file that is cut off behind its entities: one sentence says that.
    program = read_dxf(written(document)[:-20], source="part.dxf", reading=Reading())
    (note,) = program.notes
    assert "no end mark (EOF)" in note


@pytest.mark.parametrize("seed", range(3))
def test_broken_bytes_make_a_program_or_a_refusal(seed):
    rng = np.random.default_rng(seed)
    whole = np.frombuffer(by_hand(LINE, INSERT, blocks=block_text("A")), dtype=np.uint8)
    for _ in range(60):
        data = whole.copy()
        at = rng.integers(0, len(data), rng.integers(1, 4))
        data[at] = rng.integers(0, 256, len(at))
        try:
            found = read_dxf(data.tobytes(), source="part.dxf", reading=Reading(unit=MM))
        except ac.InvalidInput as error:
            assert str(error).endswith(".") and "\n" not in str(error)
        else:
            assert isinstance(found, Program)


def test_nothing_is_logged_and_the_logger_stays_as_it_was(caplog):
    logger = logging.getLogger("ezdxf")
    assert not logger.disabled
    with caplog.at_level(logging.DEBUG, logger="ezdxf"):
        from_hand(LINE)
    assert not caplog.records and not logger.disabled


def test_without_ezdxf_the_message_says_what_to_install(monkeypatch, refuses):
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    refuses(lambda: from_hand(LINE), ac.InvalidInput, "pip install 'armcontour[drawings]'")


def test_the_import_does_not_bring_ezdxf():
    code = "import sys, armcontour.io.drawings.dxf; assert 'ezdxf' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_five_thousand_lines_take_a_second_or_two():
    document, space = drawing()
    points = np.random.default_rng(0).random((5_000, 4)) * 100
    for row in points:
        space.add_line(row[:2], row[2:], dxfattribs={"color": colors.RED})
    data = written(document)
    begin = time.process_time()
    program = read_dxf(data, source="part.dxf", reading=Reading())
    assert time.process_time() - begin < 8  # it takes 0.8 s
    assert len(program.contours) > 4_900


def test_what_is_unknown_on_layers_that_are_not_chosen_is_no_matter(tmp_path):
    drawing = ezdxf.new(units=4)
    space = drawing.modelspace()
    space.add_line((0, 0), (10, 0), dxfattribs={"layer": "CUT"})
    space.add_text("title", dxfattribs={"layer": "FRAME"})
    file = tmp_path / "part.dxf"
    drawing.saveas(file)
    program = ac.read_path(file, layers=["CUT"])
    assert len(program.contours) == 1
    assert program.notes == ()
    assert "1 TEXT" in ac.read_path(file).notes[0]


def test_layers_that_are_not_run_are_listed_with_their_lines_arcs_and_curves(tmp_path):
    drawing = ezdxf.new(units=4)
    space = drawing.modelspace()
    for layer, count in (("CUT", 1), ("HOLES", 3), ("MARK", 1)):
        for k in range(count):
            space.add_circle((10 * k, 0), 2, dxfattribs={"layer": layer})
    space.add_text("title", dxfattribs={"layer": "FRAME"})
    drawing.saveas(tmp_path / "part.dxf")
    (remark,) = ac.read_path(tmp_path / "part.dxf", layers={"CUT": {}}).remarks
    assert "HOLES (3), MARK (1)" in remark and "FRAME" not in remark and "CUT" not in remark


def test_layers_that_no_contour_can_have_are_changed_with_a_note():
    document, space = drawing()
    given = (b"a\x1b]52;c;cA==\x1b", b"l" * 100, b"l" * 101, b"caf\xe9", b"CUT")
    for k in range(len(given)):
        space.add_line((0, 10 * k), (5, 10 * k), dxfattribs={"layer": f"LAYER{k}"})
    data = written(document)
    for k, layer in enumerate(given):
        data = data.replace(f"LAYER{k}".encode(), layer)
    program = read_dxf(data, source="part.dxf", reading=Reading())
    long = "l" * 68 + "..."
    layers = [r"a\x1b]52;c;cA==\x1b", long, f"{long} (2)", r"caf\udce9", "CUT"]
    assert [x.layer for x in program.contours] == layers
    (note,) = (x for x in program.notes if "Names" in x)
    assert note.isprintable() and "(4)" in note
    assert len(program.selected(layers=[r"caf\udce9"]).contours) == 1


@pytest.mark.skipif(not fonts.font_manager.fallback_font_name(), reason="this machine has no font")
def test_letters_of_a_text_are_contours_if_asked():
    document = ezdxf.new(units=4)
    space = document.modelspace()
    space.add_line((0, 0), (10, 0))
    space.add_text("OH", dxfattribs={"height": 10, "insert": (5, 5), "layer": "mark"})
    left_out = read(document)
    assert len(left_out.contours) == 1 and "1 TEXT" in " ".join(left_out.notes)
    found = read(document, texts="contours")
    letters = [x for x in found.contours if x.layer == "mark"]
    # Two outlines of O, one of H, all closed, as high as the text.
    assert len(letters) == 3 and all(x.closed for x in letters)
    low, high = (
        np.min([x.path.segments.extent for x in letters], axis=0)[0],
        np.max([x.path.segments.extent for x in letters], axis=0)[1],
    )
    assert low[1] == pytest.approx(0.005, abs=3e-4) and high[1] == pytest.approx(0.015, abs=3e-4)
    assert "Drawn through a font" in " ".join(found.notes)
