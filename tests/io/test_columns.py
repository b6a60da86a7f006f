"""Titles of columns, by what all files have in common, and positions of the tool over time."""

import math

import numpy as np
import pytest
from tests.io.tables import refusals

from armcontour.io.columns import read_titles
from armcontour.io.tool_file import read_tool_positions

SI = {"t": "s", "q": "rad", "dq": "rad/s", "x": "m", "name": None}


def titles(*given):
    def key_of(name, has_unit):
        key, _, suffix = name.partition("_")
        return (key, suffix or None) if key in SI else None

    return read_titles(
        given,
        where="a.csv, line 1",
        example="t,q",
        key_of=key_of,
        si_of=SI.get,
        unknown=left_out.append,
    )


left_out = []


def test_units_become_factors():
    for title, key, factor in (
        ("t", "t", 1.0),
        ("t [ms]", "t", 1e-3),
        ("t(us)", "t", 1e-6),
        ("q [deg]", "q", math.pi / 180),
        ("q [°]", "q", math.pi / 180),
        ("q_mrad", "q", 1e-3),
        ("q [turn]", "q", 2 * math.pi),
        ("dq [rpm]", "dq", math.pi / 30),
        ("dq [deg/s]", "dq", math.pi / 180),
        ("x_mm", "x", 1e-3),
        ("x [ in ]", "x", 0.0254),
        ("name", "name", 1.0),
    ):
        left_out.clear()
        found = titles("other", title, "something [V]")
        assert left_out == ["other", "something [V]"]
        assert list(found) == [key]
        assert (found[key].index, found[key].title) == (1, title)
        assert found[key].factor == pytest.approx(factor, rel=1e-12), title


BAD = f"""
1|-2.5e3 => the first line must name the columns, such as t,q
t|q|q [deg] => the columns 'q' and 'q [deg]' hold the same
t|t => there are two columns 't'
q [1/s] => the unit '1/s' of the column 'q [1/s]' is not one that converts to rad
q [] => the unit '' of the column 'q []' is not one that converts to rad
q [1] => the unit '1' of the column 'q [1]' is not one that converts to rad
dq [1/s] => not one that converts to rad/s
dq [Hz] => not one that converts to rad/s
t [-ms] => not one that converts to s
x [deg] => not one that converts to m
name [m] => the unit 'm' of the column 'name [m]' is not wanted
q_deg [rad] => the column 'q_deg [rad]' has two units
x [{"m" * 9999}] => the unit 'mmmm
"""


def test_titles_that_are_refused():
    refusals(lambda x: titles(*x.split("|")), BAD, "a.csv, line 1: ", without="m" * 300)


POSITIONS = np.array([[0.0, 0.4, 0.1, 0.2], [0.008, 0.401, 0.1, 0.2]])
BAD_FILES = r"""
t,x,y\n0,1,2 => tool.csv, line 1 ... column z ... t,x,y,z
x,y,z\n0,1,2 => column t
t,x [deg],y,z\n0,1,2,3 => 'deg' ... one that converts to m
t,x,tool x,y,z\n0,1,1,2,3 => 'x' and 'tool x' hold the same
t,x,y,z\n0,1,2,many => line 2 ... 'many'
0,1,2,3\n1,1,2,3 => first line must name the columns
"""


@pytest.fixture
def read(tmp_path):
    def from_text(text, dimension=3):
        file = tmp_path / "tool.csv"
        file.write_text(text.replace(r"\n", "\n") + "\n", encoding="utf-8")
        return read_tool_positions(file, dimension)

    return from_text


def test_positions_of_the_tool(read):
    for text in (
        "t,x,y,z\n0,0.4,0.1,0.2\n0.008,0.401,0.1,0.2",
        "# tracker\nt [ms];x [mm];y [mm];z [mm]\n0;400;100;200\n8;401;100;200",
        "z_mm,frame,tool x [m],tcp_y_mm,time\n200,7,0.4,100,0\n200,8,0.401,100,0.008",
        "timestamp,actual x,actual y,actual z,speed x\n0,0.4,0.1,0.2,1\n0.008,0.401,0.1,0.2,1",
    ):
        np.testing.assert_allclose(np.column_stack(read(text)), POSITIONS, rtol=1e-15)
    t, points = read("t [ms],x [mm],y [mm]\n8,401,100\n16,402,100", 2)
    np.testing.assert_allclose(t, [0.008, 0.016])
    np.testing.assert_allclose(points, [[0.401, 0.1], [0.402, 0.1]])


def test_files_that_are_refused(read):
    refusals(read, BAD_FILES)
