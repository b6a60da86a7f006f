"""Tables of waypoints."""

import io
import time
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armcontour import read_path
from armcontour.errors import InvalidInput
from armcontour.io.drawings.reading import Reading
from armcontour.io.drawings.waypoints import read_waypoints

SQUARE = "x [mm],y [mm]\n0,0\n100,0\n100,50\n"


def read(text, **reading):
    data = text if isinstance(text, bytes) else text.encode()
    return read_waypoints(data, source="points.csv", kind="csv", reading=Reading(**reading))


def parquet(**columns):
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)
    return file.getvalue()


def read_parquet(data, **reading):
    return read_waypoints(data, source="points.parquet", kind="parquet", reading=Reading(**reading))


def refused(text, **reading):
    with pytest.raises(InvalidInput) as caught:
        read(text, **reading)
    return str(caught.value)


def test_points_are_joined_by_lines_in_metres():
    path = read(SQUARE).path
    np.testing.assert_allclose(path.vertices, [[0, 0], [0.1, 0], [0.1, 0.05]], atol=1e-15)
    assert path.dimension == 2 and not path.curvatures.any()


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(
    "names", [("x [mm]", "y [mm]"), ("X(mm)", "Y (mm)"), ("x_mm", "y_mm"), ("x [cm]", "y [cm]")]
)
def test_dialects_and_units(separator, names):
    factor = 0.01 if "cm" in names[0] else 0.001
    text = "# made by hand\r\n" + separator.join(names) + "\r\n\r\n"
    text += "".join(f"{a}{separator} {b}\r\n" for a, b in ((0, 0), (1.5, 2e1)))
    vertices = read(b"\xef\xbb\xbf" + text.encode()).path.vertices
    np.testing.assert_allclose(vertices[1], [1.5 * factor, 20 * factor], rtol=1e-15)


def test_lengths_without_a_unit_are_in_that_of_the_reading_and_speeds_in_it_per_second():
    text = "x,y,speed,tolerance\n0,0,,\n10,0,5,0.1\n"
    plain, inches = read(text).path, read(text, unit=0.0254).path
    assert (plain.length, plain.speeds[0], plain.tolerances[0]) == (10, 5, 0.1)
    assert inches.length == pytest.approx(0.254)
    assert inches.speeds[0] == pytest.approx(0.127)
    assert inches.tolerances[0] == pytest.approx(0.00254)


def test_speed_and_tolerance_are_of_the_line_that_ends_at_the_row():
    text = "x,y,speed [mm/s],tolerance_mm\n0,0,,\n1,0,100,1\n1,1,,0.5\n2,1,50,\n"
    path = read(text).path
    np.testing.assert_allclose(path.speeds, [0.1, np.nan, 0.05])
    np.testing.assert_allclose(path.tolerances, [1e-3, 5e-4, np.nan])


def test_a_first_speed_that_no_line_has_is_noted():
    program = read("x,y,speed\n0,0,3\n1,0,2\n2,0,2\n")
    assert program.notes == (
        "points.csv, line 2, column 'speed': no line ends at the first waypoint of a contour, so "
        "its speed is not used.",
    )
    assert read("x,y,speed\n0,0,2\n1,0,2\n").notes == ()


def test_a_new_name_in_contour_or_layer_begins_a_contour_and_empty_cells_go_on():
    text = "x,y,contour,layer\n0,0,a,one\n1,0,,\n0,1,b,\n1,1,b,one\n0,2,b,two\n1,2,b,two\n"
    contours = read(text).contours
    assert [(x.name, x.layer) for x in contours] == [("a", "one"), ("b", "one"), ("b", "two")]
    assert [x.path.length for x in contours] == [1, 1, 1]


def test_events_come_at_their_rows():
    text = 'x,y,event\n0,0,laser=on\n2,0,"gas=2.5; mode=fine;beep"\n2,0,repeat=off\n3,0,laser=OFF\n'
    events = read(text).contours[0].events
    assert [(x.name, x.value, x.s) for x in events] == [
        ("laser", True, 0),
        ("gas", 2.5, 2),
        ("mode", "fine", 2),
        ("beep", True, 2),
        ("repeat", False, 2),
        ("laser", False, 3),
    ]


def test_quaternions_angles_and_axes_hold_the_tool():
    angles = np.array([[10, 20, 30], [-40, 50, 60]])
    turned = Rotation.from_euler("xyz", angles, degrees=True)
    rows = [f"{i},0,0,{a},{b},{c}" for i, (a, b, c) in enumerate(angles)]
    path = read("\n".join(["x,y,z,roll [deg],pitch [deg],yaw [deg]", *rows])).path
    np.testing.assert_allclose(path.orientation([0, 1]), turned.as_matrix(), atol=1e-12)
    rows = [f"{i},0,0," + ",".join(map(repr, q.tolist())) for i, q in enumerate(turned.as_quat())]
    path = read("\n".join(["x,y,z,qx,qy,qz,qw", *rows])).path
    np.testing.assert_allclose(path.orientation([0, 1]), turned.as_matrix(), atol=1e-12)
    path = read("x,y,z,ax,ay,az\n0,0,0,0,0,-2\n1,0,0,0,3,-3\n").path
    assert path.orientation.axis_only
    axes = path.orientation([0, 1])[:, :, 2]
    np.testing.assert_allclose(axes, [[0, 0, -1], [0, 0.5**0.5, -(0.5**0.5)]], atol=1e-12)


def test_four_quaternions_that_look_like_a_matrix_are_quaternions():
    rows = [f"{i},0,0," + ",".join("1" if k == i else "0" for k in range(4)) for i in range(4)]
    message = refused("\n".join(["x,y,z,qx,qy,qz,qw", *rows]))
    assert "line 2, column 'qx qy qz qw': The tool orientations at waypoints 1 and 2" in message
    assert "differ by half a turn" in message


def test_a_contour_may_say_nothing_of_the_tool():
    text = "x,y,z,ax,ay,az,contour\n0,0,0,0,0,-1,a\n1,0,0,0,0,-1,a\n0,1,0,,,,b\n1,1,0,,,,b\n"
    first, second = read(text).contours
    assert first.path.orientation is not None and second.path.orientation is None


def test_repeated_points_are_merged_with_their_orientation():
    text = "x,y,z,ax,ay,az,speed\n0,0,0,0,0,-1,\n1,0,0,0,1,-1,1\n1,0,0,0,1,-1,2\n2,0,0,0,0,-1,3\n"
    path = read(text).path
    assert len(path) == 2 and path.merged == (2,)
    np.testing.assert_allclose(path.speeds, [1, 3])
    np.testing.assert_allclose(path.orientation(2.0)[:, 2], [0, 0, -1], atol=1e-12)
    message = refused(text.replace("1,0,0,0,1,-1,2", "1,0,0,1,1,-1,2"))
    assert message.startswith("points.csv, line 4, column 'ax ay az': ")
    assert "same point" in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "points.csv is empty"),
        ("x,y\n", "no waypoints"),
        ("0,0\n1,1\n", "line 1: the first line must name the columns"),
        ("x\n0\n1\n", "column y is missing"),
        ("x,y,qx\n0,0,0\n1,0,0\n", "column qy is missing"),
        ("x,y,temp\n0,0,0\n1,0,0\n", "unknown column 'temp'"),
        ("x,X,y\n0,0,0\n1,0,0\n", "'x' and 'X' hold the same"),
        ("x,x,y\n0,0,0\n1,0,0\n", "line 1: there are two columns 'x'"),
        ("x [mm],y\n0,0\n1,1\n", "'x [mm]' has a unit and 'y' has none"),
        (
            "x [kg],y [kg]\n0,0\n1,1\n",
            "unit 'kg' of the column 'x [kg]' is not one that converts to m",
        ),
        ("x,y,z,qx [mm],qy,qz,qw\n0,0,0,0,0,0,1\n1,0,0,0,0,0,1\n", "unit 'mm' of the column 'qx"),
        ("x,y,speed [mm]\n0,0,1\n1,0,1\n", "is not one that converts to m/s"),
        ("x,y\n0,0\n1\n", "line 3: 1 values, but 2 columns"),
        ("x,y\n0,0\n# note\n\n1,a\n", "line 5, column 'y': 'a' is not a finite number"),
        ("x;y\n0;0\n1,5;1\n", "line 3, column 'x': '1,5' is not a finite number: write a decimal"),
        ("x,y\n0,0\n1,nan\n", "line 3, column 'y': 'nan' is not a finite number"),
        ("x,y\n0,0\n1_0,1\n", "line 3, column 'x': '1_0' is not a finite number"),
        ("x,y\n0,0\n1,1e999\n", "line 3, column 'y': '1e999' is not a finite number"),
        ("x,y\n0,0\n1,1e9\n", "line 3, column 'y': must be within 1e+06 m"),
        ("x,y\n0,0\n,1\n", "line 3, column 'x': must not be empty"),
        ("x,y\n0,0\n0,0\n", "line 2 has no two different points"),
        ("x,y,contour\n0,0,a\n1,0,a\n2,0,b\n", "line 4 has no two different points"),
        ("x,y,speed\n0,0,1\n1,0,0\n", "line 3, column 'speed': must be above zero, but is 0"),
        ("x,y,tolerance\n0,0,\n1,0,-1\n", "line 3, column 'tolerance': must not be negative"),
        ("x,y,event\n0,0,=on\n1,0,\n", "line 2, column 'event': '=on' is no event"),
        ("x,y,event\n0,0,a=\n1,0,\n", "line 2, column 'event': 'a=' is no event"),
        ("x,y,ax,ay,az\n0,0,0,0,1\n1,0,0,0,1\n", "add the column z"),
        (
            "x,y,z,ax,ay,az\n0,0,0,0,0,0\n1,0,0,0,0,1\n",
            "line 2, column 'ax ay az': must have a len",
        ),
        ("x,y,z,ax,ay,az\n0,0,0,0,,1\n1,0,0,0,0,1\n", "line 2, column 'ax ay az': some are empty"),
        ("x,y,z,ax,ay,az\n0,0,0,0,0,1\n1,0,0,,,\n", "line 3, column 'ax ay az': empty"),
        ("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,2\n1,0,0,0,0,0,1\n", "must have the length 1, but has 2"),
        ("x,y,z,ax,ay,az\n0,0,0,0,0,1\n1,0,0,0,0,-1\n", "line 2, column 'ax ay az': The tool or"),
        (
            "x,y,z,ax,ay,az,roll,pitch,yaw\n0,0,0,0,0,1,0,0,0\n1,0,0,0,0,-1,0,0,0\n",
            "gives the tool orientation twice",
        ),
        ('x,y\n0,0\n1,"2\n', "line 3: "),
        (b"x,y\n0,\xff\n", "not UTF-8"),
    ],
)
def test_what_is_wrong_is_said_with_its_line_and_column(text, said):
    message = refused(text)
    assert said in message
    assert message.startswith("points.csv")


def test_unknown_columns_may_be_left_out():
    program = read("x,y,temp\n0,0,warm\n1,0,\n", unknown="skip")
    assert program.notes == ("The column 'temp' of points.csv is not known: left out.",)


def test_an_unknown_kind_is_refused():
    with pytest.raises(InvalidInput, match="one of csv, parquet"):
        read_waypoints(b"", source="a", kind="xls", reading=Reading())


class TestParquet:
    def test_numbers_text_and_empty_cells(self):
        data = parquet(
            **{
                "x [mm]": [0, 100, 200],
                "y [mm]": [0.0, 0.0, 50.0],
                "speed [mm/s]": [None, 150.0, float("nan")],
                "contour": [1, 1, 1],
                "event": ["laser=on", None, ""],
            }
        )
        program = read_parquet(data)
        assert program.contours[0].name == "1"
        assert [x.name for x in program.contours[0].events] == ["laser"]
        np.testing.assert_allclose(program.path.speeds, [0.15, np.nan])
        np.testing.assert_allclose(program.path.vertices[-1], [0.2, 0.05])

    def test_decimals_and_dictionaries(self):
        import pyarrow as pa

        text = pa.array(["a", "a"]).dictionary_encode()
        y = pa.array([Decimal("0"), Decimal("1.25")])
        contour = read_parquet(parquet(x=[0, 0], y=y, layer=text)).contours[0]
        assert (contour.layer, contour.path.length) == ("a", 1.25)

    @pytest.mark.parametrize(
        ("columns", "said"),
        [
            ({"x": [0.0, None], "y": [0, 1]}, "row 2, column 'x': must not be empty"),
            ({"x": [0.0, float("inf")], "y": [0, 1]}, "row 2, column 'x': 'inf' is not a finite"),
            ({"x": [0, 1], "y": ["0", "a"]}, "row 2, column 'y': 'a' is not a finite number"),
            ({"x": [0, 1], "y": [[0], [1]]}, "column 'y' has the type list"),
            ({"x": [], "y": []}, "no waypoints"),
        ],
    )
    def test_what_is_wrong_is_said_with_its_row_and_column(self, columns, said):
        with pytest.raises(InvalidInput) as caught:
            read_parquet(parquet(**columns))
        assert said in str(caught.value)

    def test_what_is_no_parquet_is_refused(self):
        good = parquet(x=[0, 1], y=[0, 1])
        for data in (b"", b"PAR1", b"PAR1" * 10, good[: len(good) // 2], good[5:]):
            with pytest.raises(InvalidInput, match=r"points\.parquet cannot be read as Parquet"):
                read_parquet(data)

    def test_broken_bytes_give_a_program_or_a_refusal(self):
        good = parquet(x=[0.0, 1.0, 2.0], y=[0.0, 1.0, 2.0], event=["a=1", "b", ""])
        rng = np.random.default_rng(5)
        for _ in range(150):
            data = bytearray(good)
            for i in rng.integers(0, len(data), rng.integers(1, 4)):
                data[i] = rng.integers(0, 256)
            try:
                read_parquet(bytes(data))
            except InvalidInput as error:
                assert "points.parquet" in str(error)


def lying(data, *sizes):
    """The Parquet file with other sizes in the place of those it tells, in as many bytes."""
    for size in sizes:
        old = varint(size)
        assert data.count(old) >= 1
        at = data.rindex(old)
        data = data[:at] + varint(100, len(old)) + data[at + len(old) :]
    return data


def varint(number, size=0):
    """A number as the compact protocol of Thrift has it, filled up to a size."""
    number, found = 2 * number, []
    while number or len(found) < size or not found:
        found.append(number & 127 | 128)
        number >>= 7
    found[-1] &= 127
    return bytes(found)


@pytest.fixture(scope="module")
def bomb():
    import pyarrow as pa
    import pyarrow.parquet as pq

    texts = ["a" * 80_000_000, "b" * 80_000_000]
    file = io.BytesIO()
    columns = {"x": [0.0, 1.0], "y": [0.0, 1.0], "event": texts}
    pq.write_table(pa.table(columns), file, compression="zstd", write_statistics=False)
    return file.getvalue()


class TestLargeParquet:
    """Files of some kilobytes that unpack to hundreds of megabytes."""

    def told(self, data, column=2):
        """Place of the pages of a column, and their size as the end of the file tells it."""
        import pyarrow.parquet as pq

        about = pq.ParquetFile(io.BytesIO(data)).metadata.row_group(0).column(column)
        return about.dictionary_page_offset, about.total_uncompressed_size

    def refused(self, data, **reading):
        import tracemalloc

        import pyarrow as pa

        usual = pa.default_memory_pool()
        pool = pa.proxy_memory_pool(usual)
        pa.set_memory_pool(pool)
        tracemalloc.start()
        try:
            with pytest.raises(InvalidInput) as caught:
                read_parquet(data, **reading)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
            pa.set_memory_pool(usual)
        assert most < 20e6 and pool.max_memory() < 20e6
        return str(caught.value)

    def test_what_unpacks_to_too_much_is_refused(self, bomb):
        assert len(bomb) < 20_000
        assert "points.parquet unpacks to 160 MB, more than the 128 MB" in self.refused(bomb)

    def test_a_size_that_is_not_true_does_not_help(self, bomb):
        place, told = self.told(bomb)
        lie = lying(bomb, told)
        assert self.told(lie) == (place, 100)
        assert "points.parquet unpacks to 160 MB" in self.refused(lie)

    def test_nor_does_another_one_in_the_header_of_a_page(self, bomb):
        _, told = self.told(bomb)
        of_page = 160_000_008
        assert bomb.count(varint(of_page)) == 1
        assert "cannot be read as Parquet" in self.refused(lying(bomb, told, of_page))

    def test_a_column_that_is_not_needed_is_not_unpacked(self, bomb):
        other = bomb.replace(b"event", b"extra")
        assert "unknown column 'extra'" in self.refused(other)
        assert len(read_parquet(other, unknown="skip").path) == 1

    def test_rows_that_are_equal_count(self):
        zeros = np.zeros(9_000_000)
        data = parquet(x=zeros, y=zeros)
        assert len(data) < 1_000_000
        assert "unpacks to 144 MB" in self.refused(data)

    def test_a_text_in_every_row_is_unpacked_once(self):
        text = ["e" * 9000] * 20_000
        with pytest.raises(InvalidInput, match="name in points.parquet, row 1, column 'contour'"):
            read_parquet(parquet(x=np.arange(2e4), y=np.zeros(20_000), contour=text))
        text = ["e" * 11_000] * 2
        with pytest.raises(InvalidInput, match="a cell has 11000 characters, more than the 10000"):
            read_parquet(parquet(x=[0, 1], y=[0, 1], contour=text))

    def test_an_end_that_is_too_large_is_refused(self):
        data = b"PAR1" + b"\0" * 5_000_000 + (5_000_000).to_bytes(4, "little") + b"PAR1"
        assert "metadata have 5 MB, more than the 4 MB" in self.refused(data)

    @pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "brotli", "lz4"])
    @pytest.mark.parametrize("version", ["1.0", "2.0"])
    @pytest.mark.parametrize("dictionary", [True, False])
    def test_whatever_is_written_is_measured_and_read(self, compression, version, dictionary):
        import pyarrow as pa
        import pyarrow.parquet as pq

        n = 500
        columns = {
            "x": np.arange(n) * 0.001,
            "y": np.zeros(n),
            "speed": [None if i % 2 else 0.1 for i in range(n)],
            "contour": ["a"] * 200 + ["b"] * 300,
            "event": pa.nulls(n),
        }
        file = io.BytesIO()
        pq.write_table(
            pa.table(columns),
            file,
            compression=compression,
            data_page_version=version,
            use_dictionary=dictionary,
            row_group_size=120,
            data_page_size=200,
        )
        program = read_parquet(file.getvalue())
        assert [len(x.path.vertices) for x in program.contours] == [200, 300]


HOSTILE = {
    "powers in a unit": ("x [mm**9**9**9],y [mm]\n0,0\n1,1\n", "the unit 'mm**9**9**9'"),
    "powers in a suffix": ("x_mm^9^9^9,y_mm\n0,0\n1,1\n", "the unit 'mm^9^9^9'"),
    "digits in a unit": (f"x [{'9' * 20_000}!],y [mm]\n0,0\n1,1\n", "the unit '9999"),
    "a long cell": (f"x,y,contour\n0,0,{'a' * 140_000}\n1,1,\n", "140000 characters, more than 80"),
    "equal columns": (",".join(["x"] * 300_000) + "\n", "two columns 'x'"),
    "many columns": (",".join(f"x{i}" for i in range(300_000)) + "\n", "unknown column 'x0'"),
    "a long column": (f"x,y,{'q' * 100_000}\n0,0,1\n1,1,1\n", "unknown column 'qqq"),
    "digits of another script": ("x,y\n0,0\n٣,1\n", "line 3, column 'x': '٣' is not a finite"),
    "an underscore": ("x,y\n0,0\n1_0,1\n", "line 3, column 'x': '1_0' is not a finite number"),
    "nan": ("x,y\n0,0\nnan,1\n", "'nan' is not a finite number"),
    "inf": ("x,y\n0,0\n1,-inf\n", "column 'y': '-inf' is not a finite number"),
    "overflow": ("x,y\n0,0\n1,1e999\n", "'1e999' is not a finite number"),
    "many digits": (f"x,y\n0,0\n1,{'9' * 100_000}\n", "is not a finite number"),
    "escape": ("x,y,contour\n0,0,c\x1b]52;c;\x1b\\\n1,1,\n", "line 2, column 'contour' has the"),
    "direction": ("x,y,layer\n0,0,\u202eabc\n1,1,\n", "column 'layer' has the character U+202E"),
    "end of line": ("x,y,event\n0,0,a\u2028b=on\n1,1,\n", "line 2, column 'event': The name of an"),
    "value": ("x,y,event\n0,0,a=\x9b1m\n1,1,\n", "value of the event a has the character U+009B"),
    "long event": (f"x,y,event\n0,0,{'e' * 81}=on\n1,1,\n", "81 characters, more than 80"),
    "long contour": (f"x,y,contour\n0,0,{'e' * 81}\n1,1,\n", "81 characters, more than 80"),
}


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("name", HOSTILE)
def test_a_table_that_is_made_to_do_harm_is_refused_at_once(name):
    text, words = HOSTILE[name]
    message = refused(text)
    assert words in message and message.isprintable() and len(message) < 500


coordinates = st.floats(-5, 5, allow_nan=False).map(lambda x: round(x, 6))


@settings(max_examples=60, deadline=None)
@given(
    points=st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=12),
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["csv", "parquet"]),
)
def test_what_was_written_is_read(points, seed, kind):
    points = np.array([points[0], *(b for a, b in zip(points, points[1:], strict=False) if a != b)])
    if len(points) < 2 or (np.linalg.norm(np.diff(points, axis=0), axis=1) < 1e-7).any():
        return
    rng = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(rng.uniform(-0.8, 0.8, (len(points), 3)))
    speeds = rng.uniform(0.01, 2, len(points))
    columns = {
        **{k: points[:, i].tolist() for i, k in enumerate(("x", "y", "z"))},
        **{k: turned.as_quat()[:, i].tolist() for i, k in enumerate(("qx", "qy", "qz", "qw"))},
        "speed [mm/s]": (1000 * speeds).tolist(),
    }
    if kind == "csv":
        rows = zip(*columns.values(), strict=True)
        text = "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)])
        path = read(text).path
    else:
        path = read_parquet(parquet(**columns)).path
    np.testing.assert_allclose(path.vertices, points, atol=1e-12)
    np.testing.assert_allclose(path.speeds, speeds[1:], rtol=1e-12)
    held = path.orientation(path.breaks[:-1])
    np.testing.assert_allclose(held, turned.as_matrix()[:-1], atol=1e-9)


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet='xyzqspeed,;\t\n\r"#[]m/0123456789.-+eE=on \x00\u2028', max_size=80))
def test_any_text_gives_a_program_or_a_refusal(text):
    for head in ("", "x,y\n0,0\n1,0\n", "x;y;speed [mm/s];event\n0;0;1;a\n"):
        try:
            read(head + text)
        except InvalidInput as error:
            assert "points.csv" in str(error)


def test_a_hundred_thousand_rows_take_a_moment():
    angle = np.linspace(0, 60, 150_000)
    rows = "\n".join(f"{x:.6f},{y:.6f}" for x, y in zip(np.cos(angle), np.sin(angle), strict=True))
    begun = time.perf_counter()
    path = read("x,y\n" + rows, mend_vertices=0.0).path
    assert len(path) == 149_999
    # It takes 0.4 s; a loop that grows with the square would take minutes.
    assert time.perf_counter() - begun < 10


def test_tool_axes_are_smoothed_within_the_angle():
    rows = [f"{k},0,0,{0.01 * (-1) ** k},0,-1" for k in range(40)]
    # A repeated point has the axis of the one before it.
    text = "x [mm],y [mm],z [mm],ax,ay,az\n" + "\n".join([*rows[:20], rows[19], *rows[20:]])
    plain, program = read(text), read(text, smooth_axes=0.02)
    given, found = (x.path.orientation(x.path.breaks)[:, :, 2] for x in (plain, program))
    angle = np.linalg.norm(given - found, axis=1)
    assert 0.009 < angle.max() <= 0.02
    assert np.linalg.norm(np.diff(found, 2, axis=0), axis=1).max() < 1e-5
    (said,) = program.remarks
    assert said.startswith("Smoothed the tool axes of 40 waypoints from line 2 on: they are turned")
    assert said.endswith("and 1.15° are allowed (path.smooth_axes).") and plain.remarks == ()


def test_smooth_axes_need_axes():
    assert "for tool axes in the columns ax, ay, az" in refused(SQUARE, smooth_axes=0.01)
    turned = "x,y,z,roll,pitch,yaw\n0,0,0,0,0,0\n1,0,0,0,0,0.1\n"
    assert "for tool axes in the columns ax, ay, az" in refused(turned, smooth_axes=0.01)


def test_other_files_have_no_axes_to_smooth(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text("G21 G90 F600\nG1 X50\nM2\n")
    with pytest.raises(InvalidInput, match=r"for tables of waypoints .* part.ngc is none"):
        read_path(file, smooth_axes=0.01)


@pytest.mark.parametrize(
    "text",
    [
        "1,10,20,9\n2,30,20,9\n",
        "count 2\nn,a,b,c\n1,10,20,9\n2,30,20,9\n",
        "1 10 20 9\n2 30 20 9\n",
    ],
)
def test_columns_may_be_named_for_files_with_other_first_lines_or_none(tmp_path, text):
    file = tmp_path / "part.csv"
    file.write_text(text)
    (contour,) = read_path(file, columns="-,x [mm],y [mm],-").contours
    np.testing.assert_allclose(contour.path.vertices, [[0.01, 0.02], [0.03, 0.02]])
    with pytest.raises(InvalidInput, match="columns, but names of 2"):
        read_path(file, columns="x,y")
    with pytest.raises(InvalidInput, match="columns.* is for waypoints in CSV"):
        read_path(tmp_path / "part.dxf", columns="x,y")
