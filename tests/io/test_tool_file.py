"""Positions of the tool over time from CSV."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.io.tool_file import read_tool_positions

SI = np.array([[0.0, 0.4, 0.1, 0.2], [0.008, 0.401, 0.1, 0.2]])


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y,z\n0,0.4,0.1,0.2\n0.008,0.401,0.1,0.2\n",
        "# tracker\nt [ms];x [mm];y [mm];z [mm]\n0;400;100;200\n8;401;100;200\n",
        "z_mm,frame,tool x [m],tcp_y_mm,time\n200,7,0.4,100,0\n200,8,0.401,100,0.008\n",
        "timestamp,actual x,actual y,actual z,speed x\n0,0.4,0.1,0.2,1\n0.008,0.401,0.1,0.2,1\n",
    ],
)
def test_units_and_names_of_columns(tmp_path, text):
    file = tmp_path / "tool.csv"
    file.write_text(text, encoding="utf-8")
    t, points = read_tool_positions(file, 3)
    np.testing.assert_allclose(t, SI[:, 0], rtol=1e-15)
    np.testing.assert_allclose(points, SI[:, 1:], rtol=1e-15)


def test_a_tool_in_the_plane(tmp_path):
    file = tmp_path / "tool.csv"
    file.write_text("t [ms],x [mm],y [mm]\n8,401,100\n16,402,100\n", encoding="utf-8")
    t, points = read_tool_positions(file, 2)
    np.testing.assert_allclose(t, [0.008, 0.016])
    np.testing.assert_allclose(points, [[0.401, 0.1], [0.402, 0.1]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,x,y\n0,1,2\n", ["tool.csv, line 1", "column z", "t,x,y,z"]),
        ("x,y,z\n0,1,2\n", ["column t"]),
        ("t,x [deg],y,z\n0,1,2,3\n", ["'deg'", "one that converts to m"]),
        ("t,x,tool x,y,z\n0,1,1,2,3\n", ["'x' and 'tool x' hold the same"]),
        ("t,x,y,z\n0,1,2,many\n", ["line 2", "'many'"]),
        ("0,1,2,3\n1,1,2,3\n", ["first line must name the columns"]),
    ],
)
def test_refusals(refuses, tmp_path, text, words):
    file = tmp_path / "tool.csv"
    file.write_text(text, encoding="utf-8")
    refuses(lambda: read_tool_positions(file, 3), InvalidInput, *words)
