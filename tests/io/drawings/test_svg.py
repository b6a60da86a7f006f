"""SVG drawings."""

import math
import warnings

import numpy as np
import pytest
import svgpathtools
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.io.drawings import svg
from armcontour.io.drawings.reading import Reading
from armcontour.io.drawings.svg import read_svg

MM = 'width="100mm" height="80mm" viewBox="0 0 100 80"'
SPACES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)


def read(body, page=MM, **reading):
    """A drawing; on the page `MM` a user unit is a millimetre."""
    data = body if isinstance(body, bytes) else f"<svg {SPACES} {page}>{body}</svg>".encode()
    return read_svg(data, source="a.svg", reading=Reading(**reading))


def only(body, page=MM, **reading):
    return read(body, page, **reading).path


def refused(body, page=MM, **reading):
    with pytest.raises(InvalidInput) as caught:
        read(body, page, **reading)
    return str(caught.value)


def upright(points, height=80.0):
    """Points of the drawing `MM` in metres with y up; complex or pairs."""
    array = np.asarray(points)
    if np.iscomplexobj(array):
        array = np.stack([array.real, array.imag], axis=-1)
    return np.stack([array[..., 0], height - array[..., 1]], axis=-1) * 1e-3


def is_arc(path, start, center, angle):
    """Whether a path is one arc; centre and start in millimetres on the page, y up."""
    assert len(path) == 1
    radius = math.dist(start, center) * 1e-3
    assert 1 / path.curvatures[0] == pytest.approx(radius, rel=1e-9)
    assert path.lengths[0] == pytest.approx(radius * abs(angle), rel=1e-9)
    np.testing.assert_allclose(path.starts[0], np.array(start) * 1e-3, atol=1e-12)
    middle = path.starts[0] + path.normals[0] * radius
    np.testing.assert_allclose(middle, np.array(center) * 1e-3, atol=1e-10)
    across = np.cross(np.append(path.tangents[0], 0), np.append(path.normals[0], 0))[2]
    assert np.sign(across) == np.sign(angle)


class TestPage:
    @pytest.mark.parametrize(
        ("page", "unit", "height"),
        [
            ('width="100mm" height="80mm" viewBox="0 0 100 80"', 1e-3, 80e-3),
            ('width="10cm" height="8cm" viewBox="0 0 1000 800"', 1e-4, 80e-3),
            ('width="2in" height="1in"', 0.0254 / 96, 0.0254),
            ('width="96" height="48px"', 0.0254 / 96, 0.0127),
            ('width="72pt" height="6pc" viewBox="0 0 1 1"', 0.0254, 0.0254),
            ('viewBox="0 0 96 192"', 0.0254 / 96, 2 * 0.0254),
            ('width="100%" height="100%" viewBox="0 0 96 192"', 0.0254 / 96, 2 * 0.0254),
            ('width="10mm" viewBox="0 0 5 20"', 2e-3, 40e-3),
            ('height="40mm" viewBox="0 0 5 20"', 2e-3, 40e-3),
        ],
    )
    def test_user_units_and_y_up_from_the_lower_edge(self, page, unit, height):
        vertices = only('<line x1="1" y1="2" x2="3" y2="5"/>', page).vertices
        wanted = [[unit, height - 2 * unit], [3 * unit, height - 5 * unit]]
        np.testing.assert_allclose(vertices, wanted, rtol=1e-12)

    def test_a_view_box_may_begin_elsewhere(self):
        page = 'width="100mm" height="80mm" viewBox="-50 -40 100 80"'
        np.testing.assert_allclose(only('<line x2="1"/>', page).starts[0], [50e-3, 40e-3])

    def test_the_unit_of_the_reading_goes_before_the_file(self):
        vertices = only('<line y2="10"/>', 'width="9in" viewBox="0 0 50 40"', unit=1e-3).vertices
        np.testing.assert_allclose(vertices, [[0, 40e-3], [0, 30e-3]], rtol=1e-12)

    def test_a_page_of_unknown_height_is_noted(self):
        program = read('<line y2="96"/>', page="")
        np.testing.assert_allclose(program.path.vertices, [[0, 0], [0, -0.0254]], atol=1e-15)
        assert "says no height of its page" in program.notes[0]

    @pytest.mark.parametrize(
        ("align", "corner", "size"),
        [
            ("", (25, 0), (50, 50)),
            ("xMidYMid meet", (25, 0), (50, 50)),
            ("xMinYMin", (0, 0), (50, 50)),
            ("xMaxYMax", (50, 0), (50, 50)),
            ("xMidYMid slice", (0, -25), (100, 100)),
            ("xMinYMax slice", (0, 0), (100, 100)),
            ("none", (0, 0), (100, 50)),
        ],
    )
    def test_preserve_aspect_ratio(self, align, corner, size):
        page = 'width="100mm" height="50mm" viewBox="0 0 10 10"'
        page += f' preserveAspectRatio="{align}"' if align else ""
        vertices = only('<line x1="0" y1="10" x2="10" y2="0"/>', page).vertices * 1e3
        np.testing.assert_allclose(vertices[0], corner, atol=1e-9)
        np.testing.assert_allclose(vertices[1] - vertices[0], size, atol=1e-9)

    @pytest.mark.parametrize(
        ("page", "said"),
        [
            ('width="0" height="1"', "width must be above zero"),
            ('width="4em" height="1"', "width='4em' is not a length that is read"),
            ('viewBox="0 0 1"', "viewBox='0 0 1' must be x, y, width and height"),
            ('viewBox="0 0 0 1"', "the last two above zero"),
            ('viewBox="0 0 1 1" preserveAspectRatio="middle"', "preserveAspectRatio='middle'"),
            (MM + ' transform="scale(2)"', "a transform of the outermost svg"),
        ],
    )
    def test_what_is_wrong_with_the_page(self, page, said):
        assert said in refused('<line x2="1"/>', page)


class TestShapes:
    def test_a_line(self):
        path = only('<line x1="1" y1="2" x2="3mm" y2="4"/>')
        np.testing.assert_allclose(path.vertices, upright([[1, 2], [3 * 96 / 25.4, 4]]), rtol=1e-12)

    def test_a_polyline_stays_open_and_a_polygon_is_closed(self):
        for tag, closed in (("polyline", False), ("polygon", True)):
            contour = read(f'<{tag} points="0,0 10 0,10,10"/>').contours[0]
            assert contour.closed == closed and len(contour.path) == 2 + closed
            assert not contour.path.curvatures.any()

    def test_a_rectangle(self):
        contour = read('<rect x="1" y="2" width="10" height="5"/>').contours[0]
        assert contour.closed and len(contour.path) == 4
        corners = [[1, 2], [11, 2], [11, 7], [1, 7], [1, 2]]
        np.testing.assert_allclose(contour.path.vertices, upright(corners), atol=1e-15)

    @pytest.mark.parametrize(
        ("radii", "rx"), [('rx="2"', 2), ('ry="2"', 2), ('rx="2" ry="2"', 2), ('rx="9" ry="2"', 5)]
    )
    def test_a_rectangle_with_round_corners(self, radii, rx):
        path = read(f'<rect x="1" y="2" width="10" height="8" {radii}/>').contours[0].path
        wanted = 2 * (10 - 2 * rx) + 2 * (8 - 2 * 2)
        straight = path.lengths[path.curvatures == 0].sum()
        assert straight == pytest.approx(wanted * 1e-3, abs=1e-12)
        assert (path.turns < TANGENT_TOLERANCE).all()
        if rx == 2:
            assert len(path) == 8
            np.testing.assert_allclose(1 / path.curvatures[1::2], 2e-3, rtol=1e-9)
            np.testing.assert_allclose(path.lengths[1::2], math.pi * 1e-3, rtol=1e-9)

    def test_a_circle_is_one_arc(self):
        for body in (
            '<circle cx="50" cy="30" r="10"/>',
            '<ellipse cx="50" cy="30" rx="10" ry="10"/>',
            '<ellipse cx="50" cy="30" rx="10"/>',
            '<ellipse cx="25" cy="60" rx="5" ry="20" transform="scale(2 0.5)"/>',
        ):
            contour = read(body).contours[0]
            assert contour.closed
            is_arc(contour.path, (60, 50), (50, 50), -2 * math.pi)

    def test_an_ellipse_is_tangent_arcs_within_the_chord_tolerance(self):
        for tolerance in (1e-5, 1e-6):
            contour = read(
                '<ellipse cx="50" cy="30" rx="20" ry="5"/>', chord_tolerance=tolerance
            ).contours[0]
            angle = np.linspace(0, 2 * np.pi, 2001)
            points = upright(np.stack([50 + 20 * np.cos(angle), 30 + 5 * np.sin(angle)], axis=1))
            assert contour.path.project(points).distance.max() <= tolerance
            assert contour.closed and (contour.path.turns < TANGENT_TOLERANCE).all()
            back = contour.path(np.linspace(0, contour.path.length, 2000)) * 1e3
            radius = np.hypot((back[:, 0] - 50) / 20, (back[:, 1] - 50) / 5)
            assert np.abs(radius - 1).max() <= tolerance / 5e-3 * 1.01

    @pytest.mark.parametrize(
        ("d", "start", "center", "angle"),
        [
            ("M10 10 A 5 5 0 0 1 20 10", (10, 70), (15, 70), -math.pi),
            ("M10 10 A 5 5 0 0 0 20 10", (10, 70), (15, 70), math.pi),
            ("M10 10 A 10 10 0 0 1 20 20", (10, 70), (10, 60), -math.pi / 2),
            ("M10 10 A 10 10 0 1 1 20 20", (10, 70), (20, 70), -3 * math.pi / 2),
            ("M10 10a10 10 77 0110 10", (10, 70), (10, 60), -math.pi / 2),
            ("M10 10A-5 5 0 0 1 20 10", (10, 70), (15, 70), -math.pi),
            ("M10 10A1 1 0 0 1 20 10", (10, 70), (15, 70), -math.pi),
        ],
    )
    def test_arcs_of_circles_stay_arcs(self, d, start, center, angle):
        is_arc(only(f'<path d="{d}"/>'), start, center, angle)

    def test_an_arc_of_nearly_a_whole_circle_lies_on_its_circle(self):
        path = only('<path d="M60 30 A 10 10 0 1 1 60 29.99"/>')
        points = path(np.linspace(0, path.length, 500)) * 1e3
        radius = np.linalg.norm(points - (50, 50.005), axis=1)
        assert np.ptp(radius) < 1e-5 and path.length == pytest.approx(2e-2 * np.pi, rel=1e-3)
        assert (path.turns < 1e-6).all()

    def test_an_arc_of_nearly_a_whole_and_nearly_round_ellipse_is_no_smaller(self):
        path = only('<path d="M60 30 A 10 10.00009 0 1 1 60 29.999"/>')
        assert len(path) == 2
        points = path(np.linspace(0, path.length, 500)) * 1e3
        assert np.abs(np.linalg.norm(points - (50, 50), axis=1) - 10).max() < 2e-3

    def test_an_arc_without_a_radius_is_a_line_and_one_of_no_length_is_nothing(self):
        path = only('<path d="M0 0 A 0 5 0 0 1 10 0 A 5 5 0 1 1 10 0 a 5 5 0 1 1 0 0 h 5"/>')
        assert len(path) == 2 and path.length == pytest.approx(15e-3)

    def test_curves_that_are_straight_are_lines(self):
        path = only('<path d="M0 0 C 1 1 5 5 10 10 Q 12 10 20 10"/>')
        assert len(path) == 2 and not path.curvatures.any()

    def test_each_subpath_is_a_contour_even_where_they_touch(self):
        program = read('<path id="p" d="M0 0 h5 M5 0 v5 m1 1 h5 v5 z h-3 M 0 50"/>')
        assert [x.name for x in program.contours] == ["p"] * 4
        assert [x.closed for x in program.contours] == [False, False, True, False]
        starts = [x.path.starts[0] for x in program.contours]
        np.testing.assert_allclose(starts, upright([[0, 0], [5, 0], [6, 6], [6, 6]]), atol=1e-15)

    def test_after_z_the_pen_is_where_the_subpath_began(self):
        contours = read('<path d="M1 2 h5 v5 z m 20 30 h5 v5 z a 5 5 0 0 1 -10 0"/>').contours
        starts = [x.path.starts[0] for x in contours]
        np.testing.assert_allclose(starts, upright([[1, 2], [21, 32], [21, 32]]), atol=1e-15)

    @pytest.mark.parametrize(
        "d",
        [
            "M0 0 h10 v10 z",
            "m 0.1 0.2 l 0.3 0.1 0.2 0.4 -0.1 0.7 -0.4 -1.2 z",
            "M0 0 h10 v10 C 10 20 0 20 0.002 0.001 z",
            "M10 10 h10 a 5 5 0 0 1 -10 0.003 z",
            "M0 0 C 10 0 10 10 0 10 z",
        ],
    )
    def test_z_closes_exactly(self, d):
        path = only(f'<path d="{d}"/>')
        np.testing.assert_allclose(path.vertices[-1], path.vertices[0], atol=1e-15)
        assert path.lengths.min() > 3e-6

    def test_closing_a_small_gap_keeps_the_tangent(self):
        path = only('<path d="M0 0 C 10 0 20 10 10 20 S -10 0.003 0 0.003 Z"/>')
        np.testing.assert_allclose(path(path.length, 1, side="left"), [1, 0], atol=1e-9)
        np.testing.assert_allclose(path(0.0, 1), [1, 0], atol=1e-9)

    def test_separate_elements_whose_ends_touch_are_chained(self):
        line, rest = '<line x2="10"/>', '<path d="M20 10 h-5 A 5 5 0 0 1 10 5 V 0"/>'
        assert len(only(line + rest)) == 4
        apart = f'<g id="a">{line}</g><g id="b">{rest}</g>'
        assert [x.layer for x in read(apart).contours] == ["a", "b"]

    @pytest.mark.parametrize(
        "body",
        [
            '<rect width="0" height="1"/>',
            "<circle/>",
            '<path d="M 1 1"/>',
            '<path d=""/>',
            "<line/>",
            '<polyline points="1 1"/>',
            '<line x2="5" transform="scale(0)"/>',
            '<line x2="5" transform="scale(1 0)"/>',
        ],
    )
    def test_what_has_no_size_is_left_out_and_noted(self, body):
        (note,) = read(body + '<line id="z" x2="1"/>').notes
        assert note.startswith("Left out because of no size: ") and note.endswith(" in line 1.")
        assert "has no contour to follow" in refused(body)

    @pytest.mark.parametrize(
        ("body", "said"),
        [
            ('<path id="p" d="M0 0 L1 x"/>', "path 'p' in line 1: path data has the unknown comma"),
            ('<path d="0 0 L1 1"/>', "must begin with M"),
            ('<path d="L1 1"/>', "must begin with M"),
            (
                '<path d="M0 0 L1"/>',
                "the command L at character 6 of the path data takes 2 numbers",
            ),
            ('<path d="M0 0 L"/>', "takes 2 numbers, but has 0"),
            ('<path d="M0 0 L1 1 z 4"/>', "takes 0 numbers, but has 1"),
            ('<path d="M0 0 L1 -"/>', "path data has '-' at character 9"),
            ('<path d="M0 0 L1;2"/>', "path data has ';2' at character 8"),
            ('<path d="M0 0 A1 1 0 2 0 1 1"/>', "path data has '1 1 0 2 0 1 1'"),
            ('<path d="M0 0 L1 1e999"/>', "a number that is too large"),
            ('<polygon points="0 0 1"/>', "pairs of x and y, but there are 3"),
            ('<polygon points="0 0 1 a"/>', "points has 'a' where a number should be"),
            ('<circle r="-1"/>', "r must not be negative"),
            ('<ellipse rx="1" ry="-1"/>', "ry must not be negative"),
            ('<rect width="-1" height="1"/>', "width must not be negative"),
            ('<circle r="5vw"/>', "r='5vw' is not a length that is read"),
            ('<line x2="1e12"/>', "it reaches 1e+09 m far"),
            ('<line x2="1" transform="turn(5)"/>', "transform has 'turn(5)'"),
            ('<line x2="1" transform="rotate(1 2)"/>', "rotate takes 1 or 3 numbers, but has 2"),
            ('<line x2="1" transform="scale(1) junk"/>', "transform has 'junk'"),
        ],
    )
    def test_what_is_wrong_is_said_with_its_element(self, body, said):
        message = refused(body)
        assert said in message and message.startswith("a.svg: ") and "in line 1: " in message

    def test_the_line_of_an_element_is_said(self):
        assert "circle 'c' in line 3: " in refused('<g>\n\n<circle id="c" r="-1"/></g>')


class TestStructure:
    def test_names_and_layers(self):
        body = """<line x2="1"/><g id="g"><path d="M0 1h1"/><path id="leaf" d="M0 2h1"/></g>
        <g inkscape:groupmode="layer" inkscape:label="Cut" id="l1"><g id="inner">
        <path d="M0 3h1"/></g></g><g inkscape:groupmode="layer" id="l2"><line y1="5" x2="1"/></g>"""
        assert [(x.name, x.layer) for x in read(body).contours] == [
            ("line 1", ""),
            ("path 1", "g"),
            ("leaf", "g"),
            ("path 3", "Cut"),
            ("line 2", "l2"),
        ]

    def test_use_draws_again_what_it_refers_to(self):
        body = """<defs><g id="q"><path id="w" d="M0 0 l5 5"/></g></defs>
        <use href="#q" x="10" y="20"/><use xlink:href="#w" transform="rotate(90) scale(2)"/>"""
        first, second = (x.path.vertices for x in read(body).contours)
        np.testing.assert_allclose(first, upright([[10, 20], [15, 25]]), atol=1e-15)
        np.testing.assert_allclose(second, upright([[0, 0], [-10, 10]]), atol=1e-15)

    def test_symbols_and_nested_drawings_are_fitted_into_their_viewports(self):
        circle = '<circle cx="5" cy="5" r="5"/>'
        symbol = f'<symbol id="s" viewBox="0 0 10 10">{circle}</symbol>'
        for body, start, center in (
            (symbol + '<use href="#s" x="20" y="10" width="40" height="20"/>', (50, 60), (40, 60)),
            (symbol + '<use href="#s"/>', (90, 40), (50, 40)),
            (
                f'<svg x="20" y="10" width="40" height="20" viewBox="0 0 10 10">{circle}</svg>',
                (50, 60),
                (40, 60),
            ),
            (f'<svg x="3" y="4">{circle}</svg>', (13, 71), (8, 71)),
        ):
            is_arc(only(body), start, center, -2 * math.pi)

    def test_what_is_hidden_is_left_out_and_noted(self):
        body = """<g id="off" display="none"><path d="M0 0h1"/></g><g visibility="hidden">
        <path id="h" d="M0 1h1"/><path id="v" visibility="visible" d="M0 2h1"/></g>
        <path id="s" style="fill:none; display : none" d="M0 3h1"/>"""
        program = read(body)
        assert [x.name for x in program.contours] == ["v"]
        assert program.notes == (
            "Left out because hidden: g 'off' in line 1, path 'h' in line 2, path 's' in line 3.",
        )

    @pytest.mark.parametrize(
        ("body", "said"),
        [
            ('<line x2="1" clip-path="url(#c)"/>', "its clip-path is no single polygon"),
            (
                '<clipPath id="c"><circle r="9"/></clipPath><line x2="1" clip-path="url(#c)"/>',
                "its clip-path is no single polygon",
            ),
            ('<g style="mask:url(#c)"><line x2="1"/></g>', "its mask is not followed"),
            ('<line x2="1" style="transform:scale(2)"/>', "transforms by style"),
            ("<style>.a{display:none}</style>", "style sheets are not followed"),
        ],
    )
    def test_what_is_not_known_is_refused_or_skipped(self, body, said):
        message = refused(body)
        assert said in message and "in line 1: " in message
        program = read(body + '<line id="kept" x1="50" y2="1"/>', unknown="skip")
        assert program.notes[0].startswith(said) and "kept" in {x.name for x in program.contours}

    @pytest.mark.parametrize(
        ("body", "note"),
        [
            ("<text>a</text>", "Left out because it is no outline: text in line 1."),
            ('<image href="a.png"/>', "Left out because it is no outline: image in line 1."),
            ("<foreignObject/>", "Left out because it is no outline: foreignObject in line 1."),
            ('<path d="M0 5h9" marker-end="url(#m)"/>', "Left out: the markers of: path in line"),
        ],
    )
    def test_what_is_no_outline_is_left_out_with_one_note(self, body, note):
        program = read('<line id="kept" x2="1"/>' + body)
        (said,) = program.notes
        assert said.startswith(note) and program.contours[0].name == "kept"

    def test_clip_paths_cut(self):
        clip = '<clipPath id="c"><rect x="10" y="10" width="20" height="10"/></clipPath>'
        body = '<circle id="o" cx="20" cy="15" r="8"/><path id="w" d="M0 15H50"/><path d="M0 1h9"/>'
        program = read(f'{clip}<g clip-path="url(#c)">{body}</g>')
        across, *arcs = sorted(program.contours, key=lambda x: x.path.curvatures[0])
        np.testing.assert_allclose(across.path.vertices, upright([(10, 15), (30, 15)]), atol=1e-12)
        # The circle leaves the rectangle above and below; its start at the right is no cut.
        assert len(arcs) == 2
        half = math.asin(5 / 8)
        for arc in arcs:
            assert arc.path.length == pytest.approx(8e-3 * 2 * half, rel=1e-9)

    def test_strokes_choose(self):
        body = """<g stroke="red"><path id="a" d="M0 0h1"/><path id="b" stroke="#00F" d="M0 1h1"/>
        <path id="c" style="stroke: rgb(255, 0,0)" d="M0 2h1"/></g><path id="d" d="M0 3h1"/>"""
        names = [x.name for x in read(body, colors=frozenset({"#ff0000"})).contours]
        assert names == ["a", "c"]
        assert "3 #0000ff" in refused(
            body.replace("red", "blue").replace("255, 0,0", "0,0,255"),
            colors=frozenset({"#00ff00"}),
        )
        sheet = "<style>.a{stroke:red}</style>"
        assert "it sets stroke" in refused(sheet + body, colors=frozenset({"#ff0000"}))
        assert len(read(sheet + body).contours) == 4

    def test_percentages_and_em(self):
        # The page is 100 x 80 user units.
        path = only('<line x1="10%" y1="10%" x2="50%" y2="5em" style="font-size:4px"/>')
        np.testing.assert_allclose(path.vertices, upright([(10, 8), (50, 20)]), atol=1e-12)
        radius = 0.1 * math.hypot(100, 80) / math.sqrt(2)
        assert only('<circle r="10%"/>').length == pytest.approx(2e-3 * math.pi * radius)
        body = (
            '<svg x="10%" width="50%" height="40" font-size="2em"><line x2="100%" y2="1em"/></svg>'
        )
        path = only(body)
        np.testing.assert_allclose(path.vertices, upright([(10, 0), (60, 32)]), atol=1e-12)
        assert "where nothing says of what" in refused('<line x2="5%"/>', page="")

    def test_what_draws_nothing_is_passed_over(self):
        body = """<title>t</title><desc/><metadata><x xmlns="http://a"/></metadata>
        <defs><clipPath id="c"/><marker/><pattern/><filter/></defs><linearGradient/>
        <style>.a{stroke:red;text-transform:none;display:inline;marker-end:none}</style><x:y xmlns:x="http://a"/>
        <switch><foreignObject requiredExtensions="x"/><g>
        <line x2="1" class="a" style="text-transform:none;mask:none"/></g></switch>"""
        assert len(only(body)) == 1 and read(body).notes == ()

    @pytest.mark.parametrize(
        ("body", "said"),
        [
            ('<use href="#none"/>', "'#none', which is no element of this file"),
            ('<use href="other.svg#a"/>', "no element of this file"),
            ('<g id="a"><use href="#a"/></g>', "refers back to it"),
            ('<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>', "refers back to it"),
        ],
    )
    def test_references_that_lead_nowhere(self, body, said):
        assert said in refused(body)


class TestGuards:
    def test_what_is_no_svg(self):
        for data in (b"", b"hello", b"<html/>", b"<svg", b"\x1f\x8b\x08", b"<svg>\xff</svg>"):
            with pytest.raises(InvalidInput, match=r"a\.svg"):
                read(data)

    def test_entities_that_are_text_are_read(self):
        public = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://no.where/svg11.dtd">'
        body = f"<svg {SPACES} {MM}><line x2='1'/></svg>"
        assert read((public + body).encode()).length == pytest.approx(1e-3)
        one = "<!DOCTYPE svg [<!ENTITY ns 'http://a'><!ENTITY b '2'>]>"
        used = body.replace("<line x2='1'", "<line xmlns:x='&ns;' x2='&b;'")
        assert read((one + used).encode()).length == pytest.approx(2e-3)

    @pytest.mark.usefixtures("soon")
    @pytest.mark.parametrize(
        "entities",
        [
            "<!ENTITY a SYSTEM 'file:///etc/hosts'>",
            "<!ENTITY % a 'b'>",
            "<!ENTITY a 'b'><!ENTITY c '&a;&a;'>",
            f"<!ENTITY a '{'b' * 100_000}'>",
        ],
    )
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
    def test_entities_that_load_or_multiply_are_not(self, entities, encoding):
        body = f"<svg {SPACES} {MM}><line x2='1' id='{'&a;' * 100}'/></svg>"
        with pytest.raises(InvalidInput, match=r"line 1: the entity '[ac]'"):
            read(f"<!DOCTYPE svg [{entities}]>{body}".encode(encoding))

    def test_references_that_multiply_are_stopped(self):
        levels = "".join(
            f'<g id="u{i}">' + f'<use href="#u{i - 1}"/>' * 100 + "</g>" for i in range(1, 6)
        )
        body = f'<defs><g id="u0"/>{levels}</defs><use href="#u5"/>'
        assert "use repeats more than 100000 elements" in refused(body)

    def test_deep_groups_are_read(self):
        n = 20_000
        assert only("<g>" * n + '<line x2="1"/>' + "</g>" * n).length == pytest.approx(1e-3)
        deep = '<g transform="scale(2)">' * 2000 + '<line x2="1"/>' + "</g>" * 2000
        assert "numbers that are too large" in refused(deep)

    def test_more_segments_than_are_wanted_are_stopped(self, monkeypatch):
        monkeypatch.setattr(svg, "MOST_SEGMENTS", 100)
        assert read('<path d="M0 0' + "h1" * 99 + '"/>').length == pytest.approx(99e-3)
        assert "more than 100 segments" in refused('<path d="M0 0' + "h1" * 101 + '"/>')

    def test_path_data_is_read_without_another_library(self, monkeypatch):
        monkeypatch.setitem(__import__("sys").modules, "svgpathtools", None)
        assert len(only('<path d="M0 0 h1 q1 1 2 0 a 5 5 0 0 1 10 0"/>')) > 3


def number(rng, low=-30.0, high=30.0):
    return f"{rng.uniform(low, high):.{rng.integers(0, 6)}f}"


def random_path_data(rng):
    """Path data of all commands, long and short, absolute and relative."""
    parts = [f"M{number(rng, 0)} {number(rng, 0)}"]
    for _ in range(rng.integers(1, 9)):
        letter = rng.choice(list("LHVCSQTAlhvcsqta"))
        count = {"h": 1, "v": 1, "c": 6, "s": 4, "q": 4, "t": 2, "l": 2, "a": 0}[letter.lower()]
        values = [number(rng) for _ in range(count)]
        if not count:
            values = [number(rng, 1), number(rng, 1), number(rng, 0, 360)]
            if rng.random() < 0.5:
                values[1] = values[0]
            values += [str(rng.integers(2)), str(rng.integers(2)), number(rng), number(rng)]
        parts.append(letter + rng.choice([" ", ","]).join(values))
    return " ".join(parts) + (" Z" if rng.random() < 0.3 else "")


def random_transform(rng, similar):
    """Text of a transform list and its matrix, (3, 3), made by a formula of its own."""
    text, matrix = [], np.eye(3)
    for _ in range(rng.integers(0, 4)):
        kind = rng.integers(3 if similar else 6)
        a, b = (rng.uniform(0.4, 1.6, 2) * rng.choice([-1, 1], 2)).tolist()
        step = np.eye(3)
        if kind == 0:
            step[:2, 2] = 5 * a, 7 * b
            text.append(f"translate({5 * a!r},{7 * b!r})")
        elif kind == 1:
            step[0, 0], step[1, 1] = a, (a * np.sign(a * b) if similar else b)
            text.append(f"scale({float(step[0, 0])!r} {float(step[1, 1])!r})")
        elif kind == 2:
            z = np.exp(1j * np.radians(100 * a))
            step[:2, :2] = [[z.real, -z.imag], [z.imag, z.real]]
            about = np.array([3 * b, 4.0])
            step[:2, 2] = about - step[:2, :2] @ about
            text.append(f"rotate({100 * a!r} {3 * b!r}, 4)")
        elif kind in (3, 4):
            step[(0, 1) if kind == 3 else (1, 0)] = np.tan(np.radians(20 * a))
            text.append(f"skew{'XY'[kind - 3]}({20 * a!r})")
        else:
            step[:2] = [[a, 0.2 * b, 1], [0.1, b, 2]]
            text.append(f"matrix({a!r} 0.1 {0.2 * b!r} {b!r} 1 2)")
        matrix = matrix @ step
    return " ".join(text), matrix


@settings(max_examples=120, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), similar=st.booleans())
def test_paths_are_what_svgpathtools_says(seed, similar):
    rng = np.random.default_rng(seed)
    d = random_path_data(rng)
    text, matrix = random_transform(rng, similar)
    tolerance = 1e-5
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        segments = [x for x in svgpathtools.parse_path(d) if x.start != x.end]
    assume(segments)
    outer, inner = f'<g transform="{text}">', f'<path d="{d}"/></g>'
    path = only(outer + inner, chord_tolerance=tolerance)

    def on_page(points):
        z = np.asarray(points)
        plain = np.stack([z.real, z.imag, np.ones(len(z))], axis=1)
        return upright((plain @ matrix.T)[:, :2])

    t = np.linspace(0, 1, 41)
    wanted = np.concatenate([on_page([x.point(u) for u in t]) for x in segments])
    assert path.project(wanted).distance.max() <= tolerance
    # And nothing else: every point of the path is near one that is wanted.
    back = path(np.linspace(0, path.length, 400))
    step = np.linalg.norm(np.diff(wanted, axis=0), axis=1).max()
    nearest = np.linalg.norm(back[:, None] - wanted[None], axis=2).min(axis=1)
    assert nearest.max() <= tolerance + step
    np.testing.assert_allclose(path.vertices[[0, -1]], wanted[[0, -1]], atol=1e-8)
    if d.endswith("Z"):
        np.testing.assert_allclose(path.vertices[-1], path.vertices[0], atol=1e-12)
    lines = sum(isinstance(x, svgpathtools.Line) for x in segments)
    straight = path.lengths[path.curvatures == 0]
    assert len(straight) >= lines
    of_circles = [
        isinstance(x, svgpathtools.Arc) and x.radius.real == x.radius.imag for x in segments
    ]
    lined = [isinstance(x, svgpathtools.Line) for x in segments]
    if similar and all(np.logical_or(of_circles, lined)):
        assert len(path) <= lines + 2 * sum(of_circles)
        scale = math.sqrt(abs(np.linalg.det(matrix[:2, :2]))) * 1e-3
        radii = [x.radius.real * scale for x in segments if isinstance(x, svgpathtools.Arc)]
        for found in 1 / path.curvatures[path.curvatures > 0]:
            assert np.abs(np.array(radii) / found - 1).min() < 1e-6


PIECES = ["M", "m", "L", "Z", "A", "c", "1", "-2.5", " ", ",", "e3", ".", "0", "#", "1e-9", "99"]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=20), st.lists(st.sampled_from(PIECES)))
def test_any_path_data_gives_a_program_or_a_refusal(d, points):
    body = f'<path id="p" d="M0 0 {"".join(d)}"/><polygon id="q" points="{"".join(points)}"/>'
    try:
        read(body)
    except InvalidInput as error:
        assert "in line 1" in str(error)


def test_broken_bytes_give_a_program_or_a_refusal():
    body = (
        '<defs><symbol id="s" viewBox="0 0 9 9"><circle r="3"/></symbol></defs><g id="a" '
        'transform="translate(1,2) rotate(30 5 5)"><path d="M0 0C1 0 2 3 4 5S6 7 8 8Q9 9 9 1T3 4'
        'A5 3 20 1 1 7 4z"/><rect width="9" height="4" rx="1"/></g><use href="#s" width="20"/>'
    )
    good = f"<svg {SPACES} {MM}>{body}</svg>".encode()
    rng = np.random.default_rng(7)
    for _ in range(150):
        data = bytearray(good)
        for i in rng.integers(150, len(data), rng.integers(1, 3)):
            data[i] = rng.choice(list(b'0123456789.-eMZAC, ("<>#&\x00\xff'))
        try:
            read(bytes(data))
        except InvalidInput as error:
            assert str(error).startswith("a.svg")


def test_a_text_on_a_layer_that_is_not_chosen_is_no_matter(tmp_path):
    file = tmp_path / "part.svg"
    file.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
        '<g id="CUT"><line x1="0" y1="10" x2="20" y2="10"/></g>'
        '<g id="FRAME"><text x="1" y="1">title</text></g></svg>'
    )
    assert len(ac.read_path(file, layers=["CUT"]).contours) == 1
    assert ac.read_path(file, layers=["CUT"]).notes == ()
    assert "text in line 1" in ac.read_path(file).notes[0]


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    "style",
    ["display" + "a" * 300_000, "display" * 50_000, "display:" * 40_000, "display" + " " * 300_000],
)
def test_the_time_to_read_a_style_grows_with_its_length(style):
    assert len(read(f'<path d="M0 0 L5 5" style="{style}"/>').contours) == 1


def test_the_last_of_equal_properties_holds():
    body = '<path d="M0 0 L5 5" style=" fill : red; display:inline ;display : none !important"/>'
    assert "hidden" in refused(body)
    assert only(body.replace("none !important", "inline")).length > 0


def test_names_that_no_contour_can_have_are_changed_with_a_note():
    long = "x" * 200
    body = "".join(f'<path id="{long}{k}" d="M{9 * k} 0 L{9 * k} 5"/>' for k in range(3))
    body = f'<g id="a&#x85;&#x202e;b">{body}<path id="ok" d="M50 0 L50 5"/></g>'
    program = read(body)
    names = [x.name for x in program.contours]
    assert names == ["x" * 68 + "...", "x" * 68 + "... (2)", "x" * 68 + "... (3)", "ok"]
    assert {x.layer for x in program.contours} == {r"a\x85\u202eb"}
    (note,) = (x for x in program.notes if "Names" in x)
    assert "more than 80 characters" in note and "(4)" in note and note.isprintable()
    # The name that the note tells chooses the layer.
    chosen = read(body + "<text>a</text>", layers=frozenset({r"a\x85\u202eb"}))
    assert [x.name for x in chosen.contours] == names


def test_a_font_is_named(refuses):
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg"><defs><font id="a">'
        '<glyph unicode="a" d="M0 0H9"/></font></defs></svg>'
    )
    refuses(
        lambda: read_svg(text.encode(), source="a.svg", reading=Reading()), InvalidInput, "font"
    )
