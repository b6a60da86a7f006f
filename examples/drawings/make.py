"""Write the sample drawings: `python examples/drawings/make.py [FOLDER]`.

All were designed for this project. Coordinates are in mm.
"""

from __future__ import annotations

import io
import sys
from math import cos, hypot, pi, sin, sqrt, tan
from pathlib import Path
from typing import Any

# A quarter of a circle as the bulge of a DXF polyline, and of a full turn between two vertices.
QUARTER = tan(pi / 8)
# Where the control points of a quarter circle lie, in radii.
ROUND = 4 / 3 * tan(pi / 8)


def new_dxf() -> Any:
    """Make an empty DXF document in mm with the layers CUT and MARK."""
    import ezdxf

    # Else times and identifiers of the header would differ from day to day.
    ezdxf.options.write_fixed_meta_data_for_testing = True
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4  # mm
    document.layers.add("CUT", color=1)
    document.layers.add("MARK", color=5)
    return document


def text_of(document: Any) -> str:
    """Write a DXF document as text."""
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def plate() -> str:
    """Draw a small plate as DXF, for first steps: outline, a hole, a slot, and a mark."""
    document = new_dxf()
    space = document.modelspace()
    cut = {"layer": "CUT"}
    mark = {"layer": "MARK"}
    # The outline comes first, as many programs draw it; holes and slot have to be cut before it.
    outline = [(6, 0, 0), (54, 0, QUARTER), (60, 6, 0), (60, 40, 0), (0, 40, 0), (0, 6, QUARTER)]
    space.add_lwpolyline(outline, format="xyb", close=True, dxfattribs=cut)
    space.add_circle((14, 16), 5, dxfattribs=cut)
    slot = [(32, 12, 0), (46, 12, 1), (46, 20, 0), (32, 20, 1)]
    space.add_lwpolyline(slot, format="xyb", close=True, dxfattribs=cut)
    space.add_lwpolyline([(26, 30), (30, 35), (34, 30)], dxfattribs=mark)
    return text_of(document)


def gasket() -> str:
    """Draw a flange gasket as DXF: outline with bulges, bore, ports, bolt holes, and a mark."""
    document = new_dxf()
    space = document.modelspace()
    cut = {"layer": "CUT"}
    mark = {"layer": "MARK"}
    # The outline comes last, so that the part lies still until it is done. First an arrow that
    # says which side is up.
    space.add_line((70, 86), (70, 98), dxfattribs=mark)
    space.add_lwpolyline([(66, 93), (70, 98), (74, 93)], dxfattribs=mark)
    for x, y in ((14, 14), (126, 14), (126, 96), (14, 96)):
        space.add_circle((x, y), 5, dxfattribs=cut)
    space.add_circle((70, 55), 26, dxfattribs=cut)
    for x in (27, 113):
        space.add_ellipse((x, 55), major_axis=(0, 13), ratio=0.5, dxfattribs=cut)
    # Rounded corners, and an ear that bulges out on either long side. Holes go counter-clockwise
    # and this goes clockwise: to the left of every contour is waste, where leads may lie.
    outline = [
        (14, 0, -QUARTER),
        (0, 14, 0),
        (0, 96, -QUARTER),
        (14, 110, 0),
        (45, 110, -0.25),
        (95, 110, 0),
        (126, 110, -QUARTER),
        (140, 96, 0),
        (140, 14, -QUARTER),
        (126, 0, 0),
        (95, 0, -0.25),
        (45, 0, 0),
    ]
    space.add_lwpolyline(outline, format="xyb", close=True, dxfattribs=cut)
    return text_of(document)


# Letters of one stroke or two in a box 1 high, y down as in SVG: a bowl is a circle of Bézier
# curves, and a stem goes straight into the arch that follows.
A = (
    "M 0.62 0.2 C 0.5 0.02 0 0 0 0.5 C 0 1 0.5 0.98 0.62 0.8 "
    "M 0.62 0 L 0.62 0.8 C 0.62 1 0.7 1 0.8 0.96"
)
R = "M 0 1 L 0 0 M 0 0.42 C 0.05 0.1 0.28 -0.08 0.5 0.06"
C = "M 0.66 0.18 C 0.5 -0.06 0 -0.04 0 0.5 C 0 1.04 0.5 1.06 0.66 0.82"


def lettering() -> str:
    """Draw the word "arc" in slanted strokes and a round frame, as SVG with transforms."""
    frame = rounded_rectangle(4, 4, 132, 72, 12)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg"
     xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
     width="140mm" height="80mm" viewBox="0 0 140 80">
  <title>arc</title>
  <g id="strokes" inkscape:groupmode="layer" inkscape:label="letters"
     fill="none" stroke="#0072b2" stroke-width="0.025"
     transform="translate(26 18) skewX(-8)">
    <path id="a" transform="scale(40 42)" d="{A}"/>
    <path id="r" transform="translate(43 0) scale(40 42)" d="{R}"/>
    <path id="c" transform="translate(73 0) scale(40 42)" d="{C}"/>
  </g>
  <g id="outlines" inkscape:groupmode="layer" inkscape:label="frame"
     fill="none" stroke="#d55e00" stroke-width="1">
    <path id="border" d="{frame}"/>
    <g transform="translate(122 64) rotate(-30)">
      <ellipse id="leaf" rx="7" ry="3"/>
    </g>
  </g>
</svg>
"""


def rounded_rectangle(x: float, y: float, width: float, height: float, radius: float) -> str:
    """Draw a rounded rectangle from Bézier curves, as the data of an SVG path."""
    right = x + width
    bottom = y + height
    k = radius * (1 - ROUND)
    return (
        f"M {x + radius} {y} H {right - radius} "
        f"C {right - k:.4f} {y} {right} {y + k:.4f} {right} {y + radius} V {bottom - radius} "
        f"C {right} {bottom - k:.4f} {right - k:.4f} {bottom} {right - radius} {bottom} "
        f"H {x + radius} "
        f"C {x + k:.4f} {bottom} {x} {bottom - k:.4f} {x} {bottom - radius} V {y + radius} "
        f"C {x} {y + k:.4f} {x + k:.4f} {y} {x + radius} {y} Z"
    )


def pocket() -> str:
    """Mill a pocket in two depths as G-code: zigzag with round turns, then along its wall."""
    lines = [
        "(A pocket of 80 x 50 mm in two depths)",
        "G21 G90 G17",
        "G64 P0.05",
        "S12000 M3",
        "M8",
    ]
    for depth in (-1.5, -3):
        lines += [f"(depth {depth:g} mm)", "G0 Z5", "G0 X20 Y20", "G0 Z1", f"G1 Z{depth:g} F300"]
        lines += zigzag(x_min=20, right=84, bottom=20, top=56, step=6)
        lines += ["G0 Z5", *wall(depth, x_min=12, right=92, bottom=12, top=62, radius=8)]
    return "\n".join([*lines, "G0 Z5", "M5", "M9", "G0 X0 Y0", "M2", ""])


def zigzag(x_min: float, right: float, bottom: float, top: float, step: float) -> list[str]:
    """Return the rows back and forth, each joined to the next one by half a circle."""
    lines = []
    y = bottom
    forth = True
    while True:
        lines.append(f"G1 X{right if forth else x_min:g} F1800")
        if y + step > top:
            return lines
        y += step
        lines.append(f"{'G3' if forth else 'G2'} Y{y:g} J{step / 2:g}")
        forth = not forth


def wall(
    depth: float, *, x_min: float, right: float, bottom: float, top: float, radius: float
) -> list[str]:
    """Return one lap along the wall, onto it and off it by quarter circles."""
    middle = (x_min + right) / 2
    on = 6.0
    slant = on * (1 - cos(pi / 4)), on * sin(pi / 4)
    return [
        f"G0 X{middle - on:g} Y{bottom + on:g}",
        "G0 Z1",
        f"G1 Z{depth:g} F300",
        f"G3 X{middle:g} Y{bottom:g} I{on:g} J0 F1200",
        f"G1 X{right - radius:g}",
        f"G3 X{right:g} Y{bottom + radius:g} J{radius:g}",
        f"G1 Y{top - radius:g}",
        f"G3 X{right - radius:g} Y{top:g} I{-radius:g}",
        f"G1 X{x_min + radius:g}",
        f"G3 X{x_min:g} Y{top - radius:g} J{-radius:g}",
        f"G1 Y{bottom + radius:g}",
        f"G3 X{x_min + radius:g} Y{bottom:g} I{radius:g}",
        f"G1 X{middle:g}",
        f"G3 X{middle + slant[1]:.4f} Y{bottom + slant[0]:.4f} J{on:g}",
        f"G0 Z{depth + 1:g}",
    ]


def pipe_saddle() -> str:
    """Return the seam of a 100 mm branch on a 200 mm pipe, with the torch between the walls."""
    lines = ["x [mm],y [mm],z [mm],ax,ay,az"]
    pipe = 100
    branch = 50
    for k in range(121):
        x, y = branch * cos(pi * k / 60), branch * sin(pi * k / 60)
        z = sqrt(pipe**2 - y**2)
        # The torch points along the sum of the two walls' inward normals.
        normal = [-x / branch, -y / branch - y / pipe, -z / pipe]
        row = [x, y, z, *(v / hypot(*normal) for v in normal)]
        lines.append(",".join(f"{round(v, 6) + 0.0:.6f}" for v in row))
    return "\n".join(lines) + "\n"


FILES = {
    "plate.dxf": plate,
    "gasket.dxf": gasket,
    "lettering.svg": lettering,
    "pocket.ngc": pocket,
    "pipe_saddle.csv": pipe_saddle,
}


def main(folder: Path) -> None:
    """Write all of them."""
    for name, make in FILES.items():
        (folder / name).write_text(make(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
