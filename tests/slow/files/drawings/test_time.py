"""Processor time of reading large and hostile drawings: bounds several times the usual time."""

import io
import time
from functools import partial

import ezdxf
import numpy as np

import armcontour as ac
from armcontour.files.drawings.chaining import DrawnEntity, chain_pieces
from armcontour.files.drawings.dxf import read_dxf
from armcontour.files.drawings.gcode import read_gcode
from armcontour.files.drawings.options import ReadOptions
from armcontour.files.drawings.shapes import Outline, paths_of
from armcontour.files.drawings.splines import Spline
from armcontour.files.drawings.svg import read_svg
from armcontour.files.drawings.waypoints import read_waypoints

RNG = np.random.default_rng(0)
READ = {"source": "part", "options": ReadOptions()}
START = b"F1\nG1 X1\n"
HOSTILE_GCODE = [
    START + b"X1 " * 5_000_000,
    START + b"\n" * 300_000,
    START + b"G0 X1\nG0 X2\n" * 50_000,
    START + b"O1\n" * 20_000,
]
STYLES = ["display" + "a" * 300_000, "display" * 50_000, "display:" * 40_000]


def circle(n):
    turn = np.linspace(0, 2 * np.pi, n + 1)
    return np.column_stack([np.cos(turn), np.sin(turn)])


def long_drawings():
    rows = "\n".join(f"{x:.6f},{y:.6f}" for x, y in circle(150_000))
    yield partial(read_waypoints, f"x,y\n{rows}".encode(), **READ)
    lines = "G1 X" + rows.replace(",", " Y").replace("\n", "\nG1 X")
    yield partial(read_gcode, f"F1\n{lines}\n".encode(), **READ)
    document, text = ezdxf.new(units=4), io.StringIO()
    for row in RNG.random((5_000, 4)) * 100:
        document.modelspace().add_line(row[:2], row[2:])
    document.write(text)
    yield partial(read_dxf, text.getvalue().encode(), **READ)
    corners = RNG.uniform(0, 1, (5000, 1, 2)) + RNG.uniform(0, 0.01, (5000, 4, 2))
    yield partial(paths_of, [Outline([Spline(points=x)]) for x in corners], 1e-5)
    ring, order = circle(20_000), RNG.permutation(20_000)
    star, same = (np.zeros((6000, 2)), circle(5999)), (np.zeros((6000, 2)), np.ones((6000, 2)))
    for ends in ((ring[:-1][order], ring[1:][order]), star, same):
        pieces = [ac.Path.polyline(x) for x in zip(*ends, strict=True)]
        yield partial(chain_pieces, [DrawnEntity(path=x, name="", layer="") for x in pieces], 1e-5)


def test_reading_takes_time_in_proportion():
    svg = '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0h5" style="{}"/></svg>'
    calls = [partial(read_gcode, x, **READ) for x in HOSTILE_GCODE]
    calls += [partial(read_svg, svg.format(x).encode(), **READ) for x in STYLES]
    slow = []
    for i, call in enumerate([*calls, *long_drawings()]):
        begin = time.process_time()
        try:
            call()
        except ac.InvalidInput as error:
            assert str(error).startswith("part")
        if (seconds := time.process_time() - begin) > 15:
            slow.append((i, seconds))
    assert not slow
