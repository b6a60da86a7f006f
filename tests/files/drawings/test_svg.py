"""SVG drawings: units, shapes, styles, references, clips and refusals."""

import math
import warnings

import numpy as np
import pytest
import svgpathtools
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.files.tables import refusals, rows

from armcontour.core.errors import InvalidInput
from armcontour.files.drawings import svg
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.drawings.svg import read_svg
from armcontour.geometry.segments import TANGENT_TOLERANCE

MM = 'width="100mm" height="80mm" viewBox="0 0 100 80"'
SPACES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)


def read(body, page=MM, **reading):
    """A drawing; on the page `MM` a user unit is a millimetre."""
    data = body if isinstance(body, bytes) else f"<svg {SPACES} {page}>{body}</svg>".encode()
    return read_svg(data, source="a.svg", options=ReadOptions(**reading))


def only(body, page=MM, **reading):
    return read(body, page, **reading).path


def upright(points, height=80.0):
    """Points of the drawing `MM` in metres with y up; complex or pairs."""
    array = np.asarray(points)
    if np.iscomplexobj(array):
        array = np.stack([array.real, array.imag], axis=-1)
    return np.stack([array[..., 0], height - array[..., 1]], axis=-1) * 1e-3


def check(points, expected, atol=1e-15):
    """Compare points with points of the drawing `MM`."""
    np.testing.assert_allclose(points, upright(expected), atol=atol)


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


def test_the_size_of_a_pixel_follows_from_the_program_that_wrote_the_file():
    inch = 0.0254
    line = '<line x1="0" y1="90" x2="90" y2="90"/>'
    illustrator = "<!-- Generator: Adobe Illustrator 24.0.1, SVG Export Plug-In -->"
    old = 'inkscape:version="0.48.4 r9939"'

    def drawn(page, comment="", body=line, **reading):
        return read(f"{comment}<svg {SPACES} {page}>{body}</svg>".encode(), **reading)

    for comment, page, pixel in (
        ("", f'{old} width="180" height="180px"', inch / 90),
        ("", 'inkscape:version="0.91 r13725" width="180" height="180"', inch / 90),
        ("", f'{old} viewBox="0 0 180 180"', inch / 90),
        ("", f'{old} width="50.8mm" height="50.8mm"', inch / 90),
        (illustrator, 'width="180px" height="180px" viewBox="0 0 180 180"', inch / 72),
        (illustrator, 'viewBox="0 0 180 180"', inch / 72),
        # The page has a size, or the version uses CSS pixels.
        ("", f'{old} width="180mm" height="180mm" viewBox="0 0 180 180"', 1e-3),
        (illustrator, 'width="180mm" height="180mm" viewBox="0 0 180 180"', 1e-3),
        ("", 'inkscape:version="0.92.4" width="180" height="180"', inch / 96),
        ("", 'inkscape:version="1.0" width="180" height="180"', inch / 96),
        # Inkscape keeps the coordinates of Illustrator.
        (illustrator, 'inkscape:version="1.2" width="180" height="180"', inch / 72),
        (illustrator, f'{old} width="180px" height="180px" viewBox="0 0 180 180"', inch / 72),
    ):
        program = drawn(page, comment)
        assert program.path.length == pytest.approx(90 * pixel, rel=1e-12), page
        # The page is 180 px high.
        np.testing.assert_allclose(program.path.vertices[:, 1], 90 * pixel, rtol=1e-9)
        noted = pixel in (inch / 90, inch / 72)
        assert any("px is 1/" in x for x in program.notes) == noted, page
        utf_16 = (
            f'<?xml version="1.0" encoding="UTF-16"?>{comment}<svg {SPACES} {page}>{line}</svg>'
        )
        again = read(utf_16.encode("utf-16"))
        assert again.path.length == pytest.approx(90 * pixel, rel=1e-12), page
    program = drawn(f'{old} width="180" height="180"', units=1e-3)
    assert program.path.length == pytest.approx(0.09) and program.notes == ()
    # The note of two programs has both sizes, and the unit of the other one.
    page = 'inkscape:version="0.92.1 r15371" width="595.275px" height="841.89px"'
    (note,) = drawn(page, illustrator).notes
    assert "210 mm" in note and "157.5 mm" in note and "Inkscape 0.92.1" in note
    other = float(note.split("units: ")[1].rstrip("."))
    program = drawn(page, illustrator, units=other)
    assert program.path.length == pytest.approx(90 * inch / 96, rel=1e-8) and not program.notes


def test_user_units_are_converted_and_y_points_up():
    inch = 0.0254
    for page, unit, height in (
        ('width="100mm" height="80mm" viewBox="0 0 100 80"', 1e-3, 80e-3),
        ('width="10cm" height="8cm" viewBox="0 0 1000 800"', 1e-4, 80e-3),
        ('width="2in" height="1in"', inch / 96, inch),
        ('width="96" height="48px"', inch / 96, inch / 2),
        ('width="72pt" height="6pc" viewBox="0 0 1 1"', inch, inch),
        ('viewBox="0 0 96 192"', inch / 96, 2 * inch),
        ('width="100%" height="100%" viewBox="0 0 96 192"', inch / 96, 2 * inch),
        ('width="10mm" viewBox="0 0 5 20"', 2e-3, 40e-3),
        ('height="40mm" viewBox="0 0 5 20"', 2e-3, 40e-3),
    ):
        vertices = only('<line x1="1" y1="2" x2="3" y2="5"/>', page).vertices
        expected = [[unit, height - 2 * unit], [3 * unit, height - 5 * unit]]
        np.testing.assert_allclose(vertices, expected, rtol=1e-12, err_msg=page)
    page = 'width="100mm" height="80mm" viewBox="-50 -40 100 80"'
    np.testing.assert_allclose(only('<line x2="1"/>', page).starts[0], [50e-3, 40e-3])
    # The option `units` overrides the unit of the file.
    vertices = only('<line y2="10"/>', 'width="9in" viewBox="0 0 50 40"', units=1e-3).vertices
    np.testing.assert_allclose(vertices, [[0, 40e-3], [0, 30e-3]], rtol=1e-12)
    program = read('<line y2="96"/>', page="")
    np.testing.assert_allclose(program.path.vertices, [[0, 0], [0, -inch]], atol=1e-15)
    assert "no page height" in program.notes[0]
    for align, corner, size in (
        ("", (25, 0), (50, 50)),
        ("xMinYMin", (0, 0), (50, 50)),
        ("xMaxYMax", (50, 0), (50, 50)),
        ("xMidYMid slice", (0, -25), (100, 100)),
        ("none", (0, 0), (100, 50)),
    ):
        page = 'width="100mm" height="50mm" viewBox="0 0 10 10"'
        page += f' preserveAspectRatio="{align}"' if align else ""
        vertices = only('<line x1="0" y1="10" x2="10" y2="0"/>', page).vertices * 1e3
        expected = [corner, np.add(corner, size)]
        np.testing.assert_allclose(vertices, expected, atol=1e-9, err_msg=align)


def test_lines_polylines_polygons_and_rectangles_are_read():
    path = only('<line x1="1" y1="2" x2="3mm" y2="4"/>')
    np.testing.assert_allclose(path.vertices, upright([[1, 2], [3 * 96 / 25.4, 4]]), rtol=1e-12)
    for tag, closed in (("polyline", False), ("polygon", True)):
        contour = read(f'<{tag} points="0,0 10 0,10,10"/>').contours[0]
        assert contour.closed == closed and len(contour.path) == 2 + closed
        assert not contour.path.curvatures.any()
    contour = read('<rect x="1" y="2" width="10" height="5"/>').contours[0]
    assert contour.closed and len(contour.path) == 4
    check(contour.path.vertices, [[1, 2], [11, 2], [11, 7], [1, 7], [1, 2]])
    for radii, rx in (('rx="2"', 2), ('ry="2"', 2), ('rx="2" ry="2"', 2), ('rx="9" ry="2"', 5)):
        path = only(f'<rect x="1" y="2" width="10" height="8" {radii}/>')
        straight = path.lengths[path.curvatures == 0].sum()
        expected = 2 * (10 - 2 * rx) + 2 * (8 - 2 * 2)
        assert straight == pytest.approx(expected * 1e-3, abs=1e-12)
        assert (path.turns < TANGENT_TOLERANCE).all()
        if rx == 2:
            assert len(path) == 8
            np.testing.assert_allclose(1 / path.curvatures[1::2], 2e-3, rtol=1e-9)
            np.testing.assert_allclose(path.lengths[1::2], math.pi * 1e-3, rtol=1e-9)


def test_a_circle_is_one_arc():
    for body in (
        '<circle cx="50" cy="30" r="10"/>',
        '<ellipse cx="50" cy="30" rx="10" ry="10"/>',
        '<ellipse cx="50" cy="30" rx="10"/>',
        '<ellipse cx="25" cy="60" rx="5" ry="20" transform="scale(2 0.5)"/>',
    ):
        contour = read(body).contours[0]
        assert contour.closed
        is_arc(contour.path, (60, 50), (50, 50), -2 * math.pi)
    pi = math.pi
    for d, start, center, angle in (
        ("M10 10 A 5 5 0 0 1 20 10", (10, 70), (15, 70), -pi),
        ("M10 10 A 5 5 0 0 0 20 10", (10, 70), (15, 70), pi),
        ("M10 10 A 10 10 0 0 1 20 20", (10, 70), (10, 60), -pi / 2),
        ("M10 10 A 10 10 0 1 1 20 20", (10, 70), (20, 70), -3 * pi / 2),
        ("M10 10a10 10 77 0110 10", (10, 70), (10, 60), -pi / 2),
        ("M10 10A-5 5 0 0 1 20 10", (10, 70), (15, 70), -pi),
        ("M10 10A1 1 0 0 1 20 10", (10, 70), (15, 70), -pi),
    ):
        is_arc(only(f'<path d="{d}"/>'), start, center, angle)


def test_ellipses_and_degenerate_arcs_are_read():
    path = only('<path d="M60 30 A 10 10 0 1 1 60 29.99"/>')
    points = path(np.linspace(0, path.length, 500)) * 1e3
    assert np.ptp(np.linalg.norm(points - (50, 50.005), axis=1)) < 1e-5
    assert path.length == pytest.approx(2e-2 * np.pi, rel=1e-3) and (path.turns < 1e-6).all()
    path = only('<path d="M60 30 A 10 10.00009 0 1 1 60 29.999"/>', repair_vertices=0.0)
    points = path(np.linspace(0, path.length, 500)) * 1e3
    assert len(path) == 2
    assert np.abs(np.linalg.norm(points - (50, 50), axis=1) - 10).max() < 2e-3
    # Without a radius it is a line; without a length it is nothing.
    path = only('<path d="M0 0 A 0 5 0 0 1 10 0 A 5 5 0 1 1 10 0 a 5 5 0 1 1 0 0 h 5"/>')
    assert len(path) == 2 and path.length == pytest.approx(15e-3)
    # Curves that are straight are lines.
    path = only('<path d="M0 0 C 1 1 5 5 10 10 Q 12 10 20 10"/>')
    assert len(path) == 2 and not path.curvatures.any()
    # Ellipses are tangent arcs within the chord tolerance.
    for tolerance in (1e-5, 1e-6):
        body = '<ellipse cx="50" cy="30" rx="20" ry="5"/>'
        contour = read(body, chord_tolerance=tolerance).contours[0]
        angle = np.linspace(0, 2 * np.pi, 2001)
        points = upright(np.stack([50 + 20 * np.cos(angle), 30 + 5 * np.sin(angle)], axis=1))
        assert contour.path.project(points).distance.max() <= tolerance
        assert contour.closed and (contour.path.turns < TANGENT_TOLERANCE).all()
        back = contour.path(np.linspace(0, contour.path.length, 2000)) * 1e3
        radius = np.hypot((back[:, 0] - 50) / 20, (back[:, 1] - 50) / 5)
        assert np.abs(radius - 1).max() <= tolerance / 5e-3 * 1.01


def test_subpaths_are_contours_and_elements_are_chained():
    contours = read('<path id="p" d="M0 0 h5 M5 0 v5 m1 1 h5 v5 z h-3 M 0 50"/>').contours
    assert [x.name for x in contours] == ["p"] * 4
    assert [x.closed for x in contours] == [False, False, True, False]
    check([x.path.starts[0] for x in contours], [[0, 0], [5, 0], [6, 6], [6, 6]])
    contours = read('<path d="M1 2 h5 v5 z m 20 30 h5 v5 z a 5 5 0 0 1 -10 0"/>').contours
    check([x.path.starts[0] for x in contours], [[1, 2], [21, 32], [21, 32]])
    # Separate elements whose ends touch are chained in each layer.
    line = '<line x2="10"/>'
    rest = '<path d="M20 10 h-5 A 5 5 0 0 1 10 5 V 0"/>'
    assert len(only(line + rest)) == 4
    apart = f'<g id="a">{line}</g><g id="b">{rest}</g>'
    assert [x.layer for x in read(apart).contours] == ["a", "b"]
    # Z closes exactly.
    for d in (
        "M0 0 h10 v10 z",
        "m 0.1 0.2 l 0.3 0.1 0.2 0.4 -0.1 0.7 -0.4 -1.2 z",
        "M0 0 h10 v10 C 10 20 0 20 0.002 0.001 z",
        "M10 10 h10 a 5 5 0 0 1 -10 0.003 z",
        "M0 0 C 10 0 10 10 0 10 z",
    ):
        path = only(f'<path d="{d}"/>')
        np.testing.assert_allclose(path.vertices[-1], path.vertices[0], atol=1e-15, err_msg=d)
        assert path.lengths.min() > 3e-6, d
    # Closing a small gap keeps the tangent.
    path = only('<path d="M0 0 C 10 0 20 10 10 20 S -10 0.003 0 0.003 Z"/>')
    np.testing.assert_allclose(path(path.length, 1, side="left"), [1, 0], atol=1e-9)
    np.testing.assert_allclose(path(0.0, 1), [1, 0], atol=1e-9)


NO_SIZE = (
    '<rect width="0" height="1"/>|<circle/>|<path d="M 1 1"/>|<path d=""/>|<line/>|<polyline '
    'points="1 1"/>|<line x2="5" transform="scale(0)"/>|<line x2="5" transform="scale(1 0)"/>'
).split("|")
# Body => words of the message. All are in line 1.
WRONG = """
<path id="p" d="M0 0 L1 x"/> => path 'p' in line 1: path data has the unknown comma
<path d="0 0 L1 1"/> => must begin with M
<path d="M0 0 L1"/> => the command L at character 6 ... must have 2 numbers
<path d="M0 0 L1 -"/> => '-' at character 9
<path d="M0 0 A1 1 0 2 0 1 1"/> => '1 1 0 2 0 1 1'
<path d="M0 0 L1 1e999"/> => too large
<polygon points="0 0 1"/> => pairs of x and y ... 3
<circle r="-1"/> => r must not be negative
<circle r="5vw"/> => r='5vw'
<line x2="1e12"/> => 1e+09 m
<line x2="1" transform="turn(5)"/> => transform must be ... 'turn(5)'
<line x2="1" transform="rotate(1 2)"/> => rotate must have 1 or 3 numbers, but has 2
<path d="M0 0 L5 5" style=" fill : red; display:inline ;display : none !important"/> => hidden
<use href="other.svg#a"/> => 'other.svg#a', which is not an element of this file
<use href="#none"/> => no contour to follow ... refer to elements ... use
<g id="a"><use href="#a"/></g> => refers back to this element
<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g> => refers back to this element
"""
# Refused, or skipped with a note.
UNKNOWN = """
<clipPath id="c"><line/><line/></clipPath><line x2="1" clip-path="url(#c)"/> => other than one
<mask id="c"/><g style="mask:url(#c)"><line x2="1"/></g> => masks are not supported
<line x2="1" style="transform:scale(2)"/> => in a style or with an origin
<style>.a{display:none}</style> => sheets that set display are not supported
"""
PAGES = f"""
width="0" height="1" => width must be above zero
viewBox="0 0 1" => viewBox must be ... '0 0 1'
viewBox="0 0 0 1" => width and height above zero
viewBox="0 0 1 1" preserveAspectRatio="middle" => preserveAspectRatio ... 'middle'
{MM} transform="scale(2)" => a transform of the outermost svg
height="9" => because the reference of the percentage is unknown
"""


def test_invalid_elements_are_refused_by_name():
    refusals(read, WRONG, "a.svg", "in line 1")
    refusals(lambda page: read('<line x2="5%"/>', page), PAGES)
    third = '<g>\n\n<circle id="c" r="-1"/></g>'
    font = '<defs><font id="a"><glyph unicode="a" d="M0 0H9"/></font></defs>'
    refusals(read, [(third, "circle 'c' in line 3: "), (font, "a.svg has no contour")])
    data = (b"", b"hello", b"<html/>", b"<svg", b"\x1f\x8b\x08", b"<svg>\xff</svg>")
    refusals(read, [(x, "a.svg") for x in data])
    line = '<line id="kept" x1="50" y2="1"/>'
    refusals(read, UNKNOWN, "in line 1: ")
    for body, words in rows(UNKNOWN):
        program = read(body + line, unknown="skip")
        assert words in program.notes[0].lower(), body
        assert "kept" in {x.name for x in program.contours}, body
    for body in NO_SIZE:
        (note,) = read(body + line).notes
        assert note.startswith("Skipped because they have no size: "), body
        assert note.endswith(" in line 1."), body
    left_out = ("text", "image", "foreignObject")
    marked = ('<path d="M0 5h9" marker-end="url(#m)"/>', "markers of: path")
    for body, name in (*((f"<{x}/>", x) for x in left_out), marked):
        program = read(line + body)
        (note,) = program.notes
        assert f"{name} in line 1." in note and program.contours[0].name == "kept"


def test_names_and_layers_are_read_and_skipped_elements_counted():
    body = """<line x2="1"/><g id="g"><path d="M0 1h1"/><path id="leaf" d="M0 2h1"/></g>
    <g inkscape:groupmode="layer" inkscape:label="Cut" id="l1"><g id="inner">
    <path d="M0 3h1"/></g></g><g inkscape:groupmode="layer" id="l2"><line y1="5" x2="1"/></g>"""
    contours = [(x.name, x.layer) for x in read(body).contours]
    paths = [("path 1", "g"), ("leaf", "g"), ("path 3", "Cut")]
    assert contours == [("line 1", ""), *paths, ("line 2", "l2")]
    body = """<title>t</title><desc/><metadata><x xmlns="http://a"/></metadata>
    <defs><clipPath id="c"/><marker/><pattern/><filter/></defs><linearGradient/><x:y xmlns:x="http://a"/>
    <style>.a{stroke:red;text-transform:none;display:inline;marker-end:none}</style>
    <switch><foreignObject requiredExtensions="x"/><g>
    <line x2="1" class="a" style="text-transform:none;mask:none"/></g></switch>"""
    assert len(only(body)) == 1 and read(body).notes == ()
    # Text on a layer that is not chosen is ignored.
    body = '<g id="CUT"><line x2="20"/></g><g id="FRAME"><text x="1" y="1">title</text></g>'
    program = read(body, layers=frozenset({"CUT"}))
    assert program.notes == () and "text in line 1" in read(body).notes[0]


def test_use_symbols_and_nested_drawings_are_read():
    body = """<defs><g id="q"><path id="w" d="M0 0 l5 5"/></g></defs>
    <use href="#q" x="10" y="20"/><use xlink:href="#w" transform="rotate(90) scale(2)"/>"""
    first, second = (x.path.vertices for x in read(body).contours)
    check(first, [[10, 20], [15, 25]])
    check(second, [[0, 0], [-10, 10]])
    circle = '<circle cx="5" cy="5" r="5"/>'
    symbol = f'<symbol id="s" viewBox="0 0 10 10">{circle}</symbol>'
    place = 'x="20" y="10" width="40" height="20"'
    for body, start, center in (
        (f'{symbol}<use href="#s" {place}/>', (50, 60), (40, 60)),
        (f'{symbol}<use href="#s"/>', (90, 40), (50, 40)),
        (f'<svg {place} viewBox="0 0 10 10">{circle}</svg>', (50, 60), (40, 60)),
        (f'<svg x="3" y="4">{circle}</svg>', (13, 71), (8, 71)),
    ):
        is_arc(only(body), start, center, -2 * math.pi)


def test_hidden_or_clipped_elements_are_skipped():
    body = """<g id="off" display="none"><path d="M0 0h1"/></g><g visibility="hidden">
    <path id="h" d="M0 1h1"/><path id="v" visibility="visible" d="M0 2h1"/></g>
    <path id="s" style="fill:none; display : none" d="M0 3h1"/>"""
    program = read(body)
    assert [x.name for x in program.contours] == ["v"]
    (note,) = program.notes
    assert note.endswith("hidden: g 'off' in line 1, path 'h' in line 2, path 's' in line 3.")
    # The last of equal properties holds.
    assert only('<path d="M0 0 L5 5" style="display:none;display : inline"/>').length > 0
    clip = '<clipPath id="c"><rect x="10" y="10" width="20" height="10"/></clipPath>'
    inside = '<circle id="o" cx="20" cy="15" r="4"/><rect x="10" y="10" width="20" height="10"/>'
    body = inside + '<path d="M0 1h9"/>'
    program = read(f'{clip}<g clip-path="url(#c)">{body}</g>')
    assert "path in line 1" in program.notes[0] and len(program.contours) == 2
    body = f'{clip}<g clip-path="url(#c)">{inside}<path id="w" d="M0 15H50"/></g>'
    refusals(read, [(body, "cuts path 'w' in line 1 ... --skip-unknown")])
    assert len(read(body, unknown="skip").contours) == 2


@pytest.mark.parametrize(("beyond", "drawn"), [(5e-5, 1), (0.2, 0)], ids=["0.05 um", "0.2 mm"])
def test_outlines_beyond_a_clip_by_less_than_join_tolerance_are_drawn(beyond, drawn):
    # In mm: a rectangle, a path along the border, and a spike that ends beyond it.
    edge = 30 + beyond
    shapes = [
        f"M20 12H{edge}V18H20Z",
        f"M{edge} 10V20",
        f"M20 11L{edge} 15L20 19",
    ]
    clip = '<clipPath id="c"><rect x="10" y="10" width="20" height="10"/></clipPath>'
    for shape in shapes:
        body = f'{clip}<g clip-path="url(#c)"><path d="{shape}"/><path d="M11 11h1"/></g>'
        program = read(body, unknown="skip")
        assert len(program.contours) == 1 + drawn
        # The tolerance is that of the option.
        assert len(read(body, unknown="skip", join_tolerance=3e-4).contours) == 2
        assert len(read(body, unknown="skip", join_tolerance=1e-9).contours) == 1


def test_nested_drawings_are_clipped_at_their_viewport():
    place = 'x="10" y="10" width="20" height="20"'
    for y, drawn in ((5, 1), (-9, 0)):
        body = f'<rect x="0" y="{y}" width="20" height="5"/><path d="M1 1h1"/>'
        symbol = f'<symbol id="s" viewBox="0 0 20 20">{body}</symbol>'
        for nested in (f"<svg {place}>{body}</svg>", f'{symbol}<use href="#s" {place}/>'):
            program = read(nested)
            assert len(program.contours) == 1 + drawn and len(program.notes) == 1 - drawn
    body = '<rect x="-5" y="5" width="50" height="5"/>'
    refusals(read, [(f"<svg {place}>{body}</svg>", "a clip or viewport cuts rect in line 1")])
    program = read(f'<svg {place} style="overflow:visible">{body}</svg>')
    assert program.path.length == pytest.approx(0.11) and program.notes == ()


def test_strokes_select_contours_and_lengths_are_relative():
    body = """<g stroke="red"><path id="a" d="M0 0h1"/><path id="b" stroke="#00F" d="M0 1h1"/>
    <path id="c" style="stroke: rgb(255, 0,0)" d="M0 2h1"/></g><path id="d" d="M0 3h1"/>"""
    sheet = "<style>.a{stroke:red}</style>" + body
    red = frozenset({"#ff0000"})
    green = frozenset({"#00ff00"})
    assert [x.name for x in read(body, colors=red).contours] == ["a", "c"]
    assert len(read(sheet).contours) == 4
    blue = body.replace("red", "blue").replace("255, 0,0", "0,0,255")
    table = [((blue, green), "3 #0000ff"), ((sheet, red), "style sheets that set stroke")]
    refusals(lambda x: read(x[0], colors=x[1]), table)
    # Lengths in %; the page is 100 x 80 user units.
    path = only('<line x1="10%" y1="10%" x2="50%" y2="20"/>')
    check(path.vertices, [(10, 8), (50, 20)], atol=1e-12)
    radius = 0.1 * math.hypot(100, 80) / math.sqrt(2)
    assert only('<circle r="10%"/>').length == pytest.approx(2e-3 * math.pi * radius)
    body = '<svg x="10%" width="50%" height="40"><line x2="100%" y2="80%"/></svg>'
    check(only(body).vertices, [(10, 0), (60, 32)], atol=1e-12)


def test_large_drawings_are_read_or_refused(monkeypatch):
    n = 20_000
    assert only("<g>" * n + '<line x2="1"/>' + "</g>" * n).length == pytest.approx(1e-3)
    deep = '<g transform="scale(2)">' * 2000 + '<line x2="1"/>' + "</g>" * 2000
    refusals(read, [(deep, "too large")])
    monkeypatch.setattr(svg, "MAX_REPEATED", 1000)
    groups = [f'<g id="u{i}">' + f'<use href="#u{i - 1}"/>' * 100 + "</g>" for i in range(1, 6)]
    body = f'<defs><g id="u0"/>{"".join(groups)}</defs><use href="#u5"/>'
    refusals(read, [(body, "more than 1000 elements drawn by use")])
    monkeypatch.setattr(svg, "MAX_SEGMENTS", 100)
    assert read('<path d="M0 0' + "h1" * 99 + '"/>').length == pytest.approx(99e-3)
    refusals(read, [('<path d="M0 0' + "h1" * 101 + '"/>', "more than 100 segments")])


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
    text = []
    matrix = np.eye(3)
    for _ in range(rng.integers(0, 4)):
        a, b = (rng.uniform(0.4, 1.6, 2) * rng.choice([-1, 1], 2)).tolist()
        c = a * math.copysign(1, b) if similar else b
        bend = 20 * a
        angle = math.radians(100 * a)
        cos = math.cos(angle)
        sin = math.sin(angle)
        x = 3 * b
        y = 4
        kinds = {
            f"translate({5 * a!r},{7 * b!r})": [[1, 0, 5 * a], [0, 1, 7 * b]],
            f"scale({a!r} {c!r})": [[a, 0, 0], [0, c, 0]],
            f"rotate({100 * a!r} {x!r}, 4)": [
                [cos, -sin, x - cos * x + sin * y],
                [sin, cos, y - sin * x - cos * y],
            ],
            f"skewX({bend!r})": [[1, math.tan(math.radians(bend)), 0], [0, 1, 0]],
            f"skewY({bend!r})": [[1, 0, 0], [math.tan(math.radians(bend)), 1, 0]],
            f"matrix({a!r} 0.1 {0.2 * b!r} {b!r} 1 2)": [[a, 0.2 * b, 1], [0.1, b, 2]],
        }
        text.append(list(kinds)[rng.integers(3 if similar else 6)])
        matrix = matrix @ np.vstack([kinds[text[-1]], [0, 0, 1]])
    return " ".join(text), matrix


@given(seed=st.integers(0, 2**32 - 1), similar=st.booleans())
def test_svg_paths_equal_those_of_svgpathtools(seed, similar):
    rng = np.random.default_rng(seed)
    d = random_path_data(rng)
    text, matrix = random_transform(rng, similar)
    tolerance = 1e-5
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        segments = [x for x in svgpathtools.parse_path(d) if x.start != x.end]
    assume(segments)
    path = only(f'<g transform="{text}"><path d="{d}"/></g>', chord_tolerance=tolerance)

    def on_page(points):
        z = np.asarray(points)
        plain = np.stack([z.real, z.imag, np.ones(len(z))], axis=1)
        return upright((plain @ matrix.T)[:, :2])

    t = np.linspace(0, 1, 41)
    expected = np.concatenate([on_page([x.point(u) for u in t]) for x in segments])
    assert path.project(expected).distance.max() <= tolerance
    # And nothing else: every point of the path is near one that is wanted.
    back = path(np.linspace(0, path.length, 400))
    step = np.linalg.norm(np.diff(expected, axis=0), axis=1).max()
    nearest = np.linalg.norm(back[:, None] - expected[None], axis=2).min(axis=1)
    assert nearest.max() <= tolerance + step
    np.testing.assert_allclose(path.vertices[[0, -1]], expected[[0, -1]], atol=1e-8)
    if d.endswith("Z"):
        np.testing.assert_allclose(path.vertices[-1], path.vertices[0], atol=1e-12)
    lines = sum(isinstance(x, svgpathtools.Line) for x in segments)
    arcs = [x for x in segments if isinstance(x, svgpathtools.Arc)]
    assert (path.curvatures == 0).sum() >= lines
    circles = [x for x in arcs if x.radius.real == x.radius.imag]
    if similar and lines + len(circles) == len(segments):
        assert len(path) <= lines + 2 * len(circles)
        scale = math.sqrt(abs(np.linalg.det(matrix[:2, :2]))) * 1e-3
        radii = np.array([x.radius.real * scale for x in arcs])
        for radius in 1 / path.curvatures[path.curvatures > 0]:
            assert np.abs(radii / radius - 1).min() < 1e-6


PIECES = ["M", "m", "L", "Z", "A", "c", "1", "-2.5", " ", ",", "e3", ".", "0", "#", "1e-9", "99"]


@given(st.lists(st.sampled_from(PIECES), max_size=20), st.lists(st.sampled_from(PIECES)))
def test_any_path_data_is_read_or_refused(d, points):
    body = f'<path id="p" d="M0 0 {"".join(d)}"/><polygon id="q" points="{"".join(points)}"/>'
    try:
        read(body)
    except InvalidInput as error:
        assert "in line 1" in str(error)


def test_svg_use_of_missing_element_is_skipped_with_a_note():
    rect = '<rect x="10" y="10" width="30" height="20"/>'
    for dead in ('<use href="#gone" x="5"/>', '<use xlink:href="#gone"/>', "<use/>"):
        for body in (
            rect + dead,
            f"<g>{dead}{rect}</g>",
            f'<defs><g id="d">{dead}</g></defs>{rect}<use href="#d"/>',
        ):
            program = read(body)
            np.testing.assert_array_equal(program.path.vertices, only(rect).vertices)
            (note,) = program.notes
            assert "use" in note


def test_a_reference_to_a_missing_clip_path_or_mask_is_skipped_with_a_note():
    rect = '<rect x="10" y="10" width="30" height="20"{}/>'
    for dead in ('clip-path="url(#gone)"', 'style="clip-path: url(#gone)"', 'mask="url(#gone)"'):
        program = read(rect.format(f" {dead}"))
        np.testing.assert_array_equal(program.path.vertices, only(rect.format("")).vertices)
        (note,) = program.notes
        assert "rect" in note


def test_a_comment_with_two_hyphens_is_named_as_the_cause():
    rect = '<rect x="10" y="10" width="30" height="20"/>'
    for text in ("use --laser", "cut --", "a -- b"):
        with pytest.raises(InvalidInput, match="comment.*--"):
            read(f"<!-- {text} -->{rect}")
    assert read(f"<!-- a - b -->{rect}").length == only(rect).length
    with pytest.raises(InvalidInput) as broken:
        read(f"<!-- a - b --><g{rect}")
    assert "comment" not in str(broken.value)


def test_dashed_lines_are_read_with_a_note():
    rect = '<rect x="10" y="10" width="30" height="20"/>'
    for dashes in ('stroke-dasharray="6 4"', 'style="stroke-dasharray: 2mm"'):
        program = read(f'{rect}<path {dashes} d="M1 1H5"/>')
        assert len(program.contours) == 2
        (note,) = program.notes
        assert "dashes" in note and "path" in note
    for dashes in ("none", "0", ""):
        assert not read(f'{rect}<path stroke-dasharray="{dashes}" d="M1 1H5"/>').notes


EMPTY = """
<font><glyph unicode="a" d="M0 0h9v9z"/></font> => defines a font ... convert it to paths
<defs><path d="M0 0h9"/></defs><symbol><rect width="2" height="3"/></symbol> => 2 outlines ... use
<text>a</text> => has no contour to follow (Skipped because they have no outline: text
"""


def test_a_drawing_without_contours_is_refused_with_the_reason():
    # The note on the missing size of the page is no reason.
    head = '<svg xmlns="http://www.w3.org/2000/svg">'
    table = [(f"{head}{x}</svg>".encode(), y) for x, y in rows(EMPTY)]
    refusals(lambda x: read_svg(x, source="a.svg", options=ReadOptions()), table)
