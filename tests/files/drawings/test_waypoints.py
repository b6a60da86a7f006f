"""CSV tables of waypoints: columns, orientations, events and refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.files.tables import refusals

from armcontour import read_path
from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.drawings.waypoint_table import read_waypoints


def read(text, **reading):
    data = text if isinstance(text, bytes) else text.encode()
    return read_waypoints(data, source="points.csv", options=ReadOptions(**reading))


def refused(text, call=read, **reading):
    with pytest.raises(InvalidInput) as caught:
        call(text, **reading)
    return str(caught.value)


BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("x [mm],y [mm]", 1e-3),
        ("X(mm),Y (mm)", 1e-3),
        ("x_mm,y_mm", 1e-3),
        ("x [cm],y [cm]", 1e-2),
    ],
)
def test_headings_units_and_separators_of_csv_are_read(heading, unit, separator):
    table = f"# made by hand\r\n{heading}\r\n\r\n0, 0\r\n1.5, 2e1\r\n2,0"
    path = read(BYTE_ORDER_MARK + table.replace(",", separator).encode()).path
    expected = np.array([[0, 0], [1.5, 20], [2, 0]]) * unit
    np.testing.assert_allclose(path.vertices, expected, rtol=1e-15)
    assert path.dimension == 2 and not path.curvatures.any()


@pytest.mark.parametrize(("unit", "options"), [(1, {}), (0.0254, {"units": 0.0254})])
def test_columns_without_a_unit_have_the_unit_of_the_options(unit, options):
    """Speeds are in this unit of length per second."""
    path = read("x,y,speed,tolerance\n0,0,,\n10,0,5,0.1\n", **options).path
    values = (path.length, path.speeds[0], path.tolerances[0])
    np.testing.assert_allclose(values, np.array([10, 5, 0.1]) * unit, rtol=1e-12)


def test_decimal_commas_are_read_with_semicolons():
    (contour,) = read("x;y\n0;0\n1,5;-0,25\n").contours
    np.testing.assert_array_equal(contour.path.vertices, [[0, 0], [1.5, -0.25]])


def test_speed_and_tolerance_of_a_row_apply_to_the_line_that_ends_there():
    text = "x,y,speed [mm/s],tolerance_mm\n0,0,,\n1,0,100,1\n1,1,,0.5\n2,1,50,\n"
    path = read(text).path
    np.testing.assert_allclose(path.speeds, [0.1, np.nan, 0.05])
    np.testing.assert_allclose(path.tolerances, [1e-3, 5e-4, np.nan])


def test_repaired_coordinates_keep_the_numbers_of_their_waypoints():
    moves = [(0, 0), (10, 0.001), (20, 0), (30, 0.001), (40, 0), (40, 40), (80, 40.001), (90, 40)]
    closed = [(20, 0), (40, 0), (40, 40), (0, 40), (0, 0.001), (20, 0)]
    for points, gone in ((moves, (1, 2, 3, 6)), (closed, ())):
        path = read("x [mm],y [mm]\n" + "\n".join(f"{x},{y}" for x, y in points)).path
        assert path.merged == gone and (path.turns > 1e-9).sum() == len(points) - len(gone) - 2
        remaining = np.delete(np.array(points), gone, axis=0) / 1e3
        np.testing.assert_allclose(path.vertices[path.waypoints], remaining, atol=1e-12)


def test_names_of_contours_and_layers_are_read():
    # A row with a new name begins a contour. A row with an empty cell continues its contour.
    text = "x,y,contour,layer\n0,0,a,one\n1,0,,\n0,1,b,\n1,1,b,one\n0,2,b,two\n1,2,b,two\n"
    contours = read(text).contours
    assert [(x.name, x.layer) for x in contours] == [("a", "one"), ("b", "one"), ("b", "two")]
    assert [x.path.length for x in contours] == [1, 1, 1]


EULER_ANGLES = np.array([[10, 20, 30], [-40, 50, 60]])  # [deg]
ROTATIONS = Rotation.from_euler("xyz", EULER_ANGLES, degrees=True)


@pytest.mark.parametrize(
    ("columns", "values"),
    [
        ("roll [deg],pitch [deg],yaw [deg]", EULER_ANGLES),
        ("qx,qy,qz,qw", ROTATIONS.as_quat()),
    ],
)
def test_angles_and_quaternions_orient_the_tool(columns, values):
    rows = [f"{i},0,0," + ",".join(map(repr, x.tolist())) for i, x in enumerate(values)]
    path = read("\n".join([f"x,y,z,{columns}", *rows])).path
    np.testing.assert_allclose(path.orientation([0, 1]), ROTATIONS.as_matrix(), atol=1e-12)


def test_axes_of_any_length_orient_the_tool_axis():
    path = read("x,y,z,ax,ay,az\n0,0,0,0,0,-2\n1,0,0,0,3,-3\n").path
    assert path.orientation.axis_only
    axes = path.orientation([0, 1])[:, :, 2]
    np.testing.assert_allclose(axes, [[0, 0, -1], [0, 0.5**0.5, -(0.5**0.5)]], atol=1e-12)


def test_one_of_two_contours_can_have_axes():
    text = "x,y,z,ax,ay,az,contour\n0,0,0,0,0,-1,a\n1,0,0,0,0,-1,a\n0,1,0,,,,b\n1,1,0,,,,b\n"
    with_axes, without_axes = read(text).contours
    assert with_axes.path.orientation is not None
    assert without_axes.path.orientation is None


def test_repeated_points_with_equal_axes_are_merged():
    text = "x,y,z,ax,ay,az,speed\n0,0,0,0,0,-1,\n1,0,0,0,1,-1,1\n1,0,0,0,1,-1,2\n2,0,0,0,0,-1,3\n"
    path = read(text).path
    assert len(path) == 2 and path.merged == (2,)
    np.testing.assert_allclose(path.speeds, [1, 3])
    np.testing.assert_allclose(path.orientation(2.0)[:, 2], [0, 0, -1], atol=1e-12)


# A table, | between its rows => words of the message.
WRONG = """
x,y| => no rows
 => points.csv is empty
0,0|1,1 => line 1: the first line must name the columns
x|0|1 => column y is missing
x,y,qx|0,0,0|1,0,0 => column qy is missing
x,y,temp|0,0,0|1,0,0 => unknown column 'temp'
x,x,y|0,0,0|1,0,0 => line 1: the columns 'x' and 'x' have the same quantity
x [mm],y|0,0|1,1 => 'x [mm]' has a unit, but the column 'y' has none
x,y,z,qx [mm],qy,qz,qw|0,0,0,0,0,0,1|1,0,0,0,0,0,1 => unit 'mm' of the column 'qx
x,y|0,0|1 => line 3: the row has 1 values, but must have 2
x,y|0,0|# note||1,a => line 5, column 'y': 'a' is not a finite number
x;y|0;0|1,5,;1 => line 3, column 'x': '1,5,' is not a finite number
x,y,layer|0,0,"gas|1,0, => line 2: ... quotes
x,y|0,0|1,1e9 => line 3, column 'y': the value must be within 1e+06 m
x,y|0,0|,1 => line 3, column 'x': the value must not be empty
x,y|0,0|0,0 => line 2 has no two different points
x,y,speed|0,0,1|1,0,0 => line 3, column 'speed': the value must be above zero, but is 0
x,y,event|0,0,gas=on|1,0, => line 1: unknown column 'event'
x,y,ax,ay,az|0,0,0,0,1|1,0,0,0,1 => the column z
x,y,z,qx,qy,qz,qw|0,0,0,0,0,0,2|1,0,0,0,0,0,1 => length 1, but has length 2
x,y,z,ax,ay,az,roll,pitch,yaw|0,0,0,0,0,1,0,0,0|1,0,0,0,0,-1,0,0,0 => orientation twice
x,y,z,ax,ay,az|0,0,0,0,0,-1|1,0,0,0,1,-1|1,0,0,1,1,-1|2,0,0,0,0,-1 => line 4, column 'ax ay az': 
"""
# Tables made to do harm, and words of the message.
HOSTILE = [
    ("x [mm**9**9**9],y [mm]\n0,0\n1,1\n", "the unit 'mm**9**9**9'"),
    (f"x [{'9' * 20_000}!],y [mm]\n0,0\n1,1\n", "the unit '9999"),
    (f"x,y,contour\n0,0,{'a' * 140_000}\n1,1,\n", "140000 characters, more than 80"),
    (f"x,y,{'q' * 100_000}\n0,0,1\n1,1,1\n", "unknown column 'qqq"),
    ("x,y,contour\n0,0,c\x1b]52;c;\x1b\\\n1,1,\n", "line 2, column 'contour' has the"),
    ("x,y,layer\n0,0,\u202eabc\n1,1,\n", "column 'layer' has the character U+202E"),
]


def test_errors_are_reported_with_line_and_column():
    refusals(lambda text: read(text.replace("|", "\n") + "\n" * (len(text) > 1)), WRONG)
    refusals(read, [(b"x,y\n0,\xff\n", "UTF-8")], "points.csv")


@pytest.mark.parametrize(("text", "words"), HOSTILE)
def test_messages_about_hostile_tables_are_short_and_printable(text, words):
    message = refused(text)
    assert words in message and message.isprintable() and len(message) < 500


def test_unknown_columns_can_be_skipped_with_a_note():
    program = read("x,y,temp\n0,0,warm\n1,0,\n", unknown="skip")
    assert "'temp'" in program.notes[0]


coordinates = st.floats(-5, 5, allow_nan=False).map(lambda x: round(x, 6))


@given(
    points=st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=12),
    seed=st.integers(0, 2**32 - 1),
)
def test_written_waypoints_are_read_again(points, seed):
    points = np.array([points[0], *(b for a, b in zip(points, points[1:], strict=False) if a != b)])
    if len(points) < 2 or (np.linalg.norm(np.diff(points, axis=0), axis=1) < 1e-7).any():
        return
    rng = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(rng.uniform(-0.8, 0.8, (len(points), 3)))
    speeds = rng.uniform(0.01, 2, len(points))
    columns = dict(zip("xyz", points.T.tolist(), strict=True))
    columns |= dict(zip(("qx", "qy", "qz", "qw"), turned.as_quat().T.tolist(), strict=True))
    columns["speed [mm/s]"] = (1000 * speeds).tolist()
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)])
    path = read(text).path
    np.testing.assert_allclose(path.vertices, points, atol=1e-12)
    np.testing.assert_allclose(path.speeds, speeds[1:], rtol=1e-12)
    held = path.orientation(path.breaks[:-1])
    np.testing.assert_allclose(held, turned.as_matrix()[:-1], atol=1e-9)


@pytest.mark.parametrize(
    ("heading", "separator"), [("", ","), ("count 2\nn,a,b,c\n", ","), ("", " ")]
)
def test_an_option_names_the_columns_of_a_table(tmp_path, heading, separator):
    file = tmp_path / "part.csv"
    file.write_text(heading + "1,10,20,9\n2,30,20,9\n".replace(",", separator))
    (contour,) = read_path(file, ReadOptions(columns="-,x [mm],y [mm],-")).contours
    np.testing.assert_allclose(contour.path.vertices, [[0.01, 0.02], [0.03, 0.02]])
    refusals(lambda x: read_path(x, ReadOptions(columns="x,y")), [(file, "columns, but ")])


def test_an_option_for_columns_is_refused_for_a_drawing(tmp_path):
    drawing = tmp_path / "part.dxf"
    refusals(
        lambda x: read_path(x, ReadOptions(columns="x,y")),
        [(drawing, "columns ... waypoints in CSV")],
    )
