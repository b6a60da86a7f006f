"""Small files of every kind that readers support, which `soak.readers` damages."""

from __future__ import annotations

import io
import struct
from functools import cache

import numpy as np

GCODE = (
    """%
(a plate) N10 G21 G90 G17 G64 P0.05
N20 G0 X10 Y10
N30 M3 S12000
N40 G1 X60 F1200 ; first side
N50 G3 X70 Y20 I0 J10
N60 G1 Y50
N70 G2 X60 Y60 R10
X10
Y10
N80 M5
G4 P0.5
G0 X30 Y30
G1 X35 F600
G2 I-5 J0
M2
%
""",
    """g20 g91 g61
g0 x1. y.5
g1 x.25 y-.125 f10
/g1 x1
g91.1 g18 g2 x.5 z0 i.25 k0
g19 g3 y.5 z0 j.25 k0
g90.1 g90 g17 g2 x2 y1 i2.5 j1
g64
m8
g1 x3 y2
m9 m30
""",
    "G21\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG2 X10 Y0 Z-2 I5 J0\nG1 X20 Y5 Z-2\nG0 Z5\nM2\n",
    """G21 F600
G0 X-20 Y0
G41.1 D3 G1 X0
G2 X20 Y0 I10
G1 Y-30 Z-1
X40
Y0
G3 X60 Y20 J20
G0 Z5
G40 G1 X70
G42.1 D2 X80
G3 I5 Z1 P2
M2
""",
)
SVG = (
    """<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
 width="100mm" height="80mm" viewBox="0 0 200 160">
<defs><path id="leaf" d="M0,0 C10,20 30,20 40,0 S70,-20 80,0"/></defs>
<g id="cut" transform="translate(10 10) rotate(15)">
<rect x="5" y="5" width="60" height="30" rx="4"/>
<circle cx="120" cy="60" r="20"/>
<ellipse cx="60" cy="100" rx="30" ry="12" transform="skewX(10)"/>
<use xlink:href="#leaf" x="20" y="60"/>
</g>
<polyline points="0,0 10,5 20,0 30,5"/>
<polygon points="100,100 120,100 110,120"/>
<path d="M10 10 h20 v20 q5 5 10 0 t10 0 a5 8 30 1 0 10 10 z m5 5 l3 3"/>
</svg>
""",
    '<svg xmlns="http://www.w3.org/2000/svg"><line x1="0" y1="0" x2="9.5" y2="1e1"/></svg>',
)
CSV = (
    "x [mm],y [mm],speed [mm/s],tolerance [mm],event\n"
    "0,0,,,\n10,0,50,0.1,tool=on\n10,10,50,0.1,\n0,10,25,,tool=off\n",
    "x;y;z;qx;qy;qz;qw;contour\n0.1;0;0;0;0;0;1;a\n0.2;0;0;0;0;0.7071;0.7071;a\n"
    "0.3;0;0.1;0;0;0;1;b\n0.4;0;0;0;0;1;0;b\n",
)
JOB = (
    """name: plate
title: A plate, cut
arm: pmk3s
path:
  start: [350 mm, 100 mm]
  segments:
    - {to: [410 mm, 150 mm], speed: 0.05 m/s, tag: first}
    - {via: [380 mm, 260 mm], to: [280 mm, 300 mm]}
    - {to: [350 mm, 350 mm]}
process:
  lead_in: {length: 5 mm, shape: line, side: left}
  switch: {name: laser, on_lead: 20 ms}
  events: [{name: gas, value: 2.5, at: 5 mm}, {name: mode, value: fine}]
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: [2 ms, 3 ms]}
cycle: 4 ms
runs:
  compensated: &compensated
    timing: {method: optimal, reserve: 10 %}
  compared: {<<: *compensated, compensation: {method: inverse}}
""",
    """name: points
arm: {name: ur5e, tool: {position: [0, 0, 120 mm], rpy: [0, 0, 90 deg]}}
path: {points: [[0.4, 0.1, 0.3], [0.5, 0.1, 0.3], [0.5, 0.2, 0.3]], orientation: {axis: [0, 0, -1]}}
servo: {kp: 25.0, kv: 1.5e2}
runs: {one: {end_time: 5 s}, two: {limits: {joint_jerk: 100}}}
""",
)

# A wedge of 0.1 x 0.2 x 0.3 m, and cells.
CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
FACES = np.array([[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]])
OBJ = "".join(
    [
        "# a wedge\no wedge\n",
        *(f"v {a:g} {b:g} {c:g}\n" for a, b, c in CORNERS),
        *(f"f {a}/1 {b}//2 {c}\n" for a, b, c in FACES),
        "f -1 -2 -3 -4\n",
    ]
)
BODIES = {
    "obj": (OBJ,),
    "urdf": (
        """<robot name="cell"><link name="world"/><link name="table"><collision>
<origin xyz="0 0 -0.05" rpy="0 0 0.1"/><geometry><box size="2 1 0.1"/></geometry></collision>
<collision><geometry><cylinder radius="0.05" length="0.8"/></geometry></collision>
<collision><geometry><mesh filename="package://cell/part.stl" scale="1 1 1"/></geometry></collision>
</link><joint name="stand" type="revolute"><parent link="world"/><child link="table"/>
<origin xyz="0.5 0 0"/><axis xyz="0 0 1"/><limit lower="0.1" upper="1.5"/></joint></robot>""",
        """<robot name="cell"><link name="table"><collision>
<geometry><sphere radius="1"/></geometry></collision></link></robot>""",
    ),
    "Srdf": (
        """<robot name="cell"><disable_collisions link1="base" link2="beam" reason="Never"/>
</robot>""",
    ),
}


@cache
def samples(kind: str) -> tuple[bytes, ...]:
    """Return sample files of a kind: "gcode", "svg", "csv", "dxf", "job", or of bodies."""
    if kind == "dxf":
        return _dxf()
    if kind == "stl":
        return (_binary_stl(), _ascii_stl().encode())
    texts = {"gcode": GCODE, "svg": SVG, "csv": CSV, "job": JOB, **BODIES}
    return tuple(x.encode() for x in texts[kind])


def _binary_stl() -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *np.ravel(CORNERS[x]), 0) for x in FACES - 1]
    return b"a wedge".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def _ascii_stl() -> str:
    lines = ["solid wedge"]
    for x in FACES - 1:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {a:g} {b:g} {c:g}" for a, b, c in CORNERS[x]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid wedge\n"])


def _dxf() -> tuple[bytes, ...]:
    import logging

    import ezdxf

    # It warns of units that old versions do not have.
    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    drawings = []
    for version in ("R12", "R2010"):
        document = ezdxf.new(version)
        space = document.modelspace()
        part = document.blocks.new("PART")
        part.add_line((0, 0), (5, 0))
        part.add_arc((5, 2), 2, -90, 90)
        space.add_blockref("PART", (20, 20), dxfattribs={"xscale": 2, "rotation": 30})
        space.add_line((0, 0), (10, 0), dxfattribs={"layer": "CUT"})
        space.add_circle((30, 5), 4)
        space.add_polyline2d([(0, 0), (5, 5), (10, 0)])
        if version != "R12":
            document.header["$INSUNITS"] = 4
            space.add_lwpolyline([(0, 0, 0.5), (10, 0, 0), (10, 10, -1)], format="xyb", close=True)
            space.add_ellipse((5, 5), (4, 1), 0.5)
            space.add_spline([(0, 0), (3, 4), (6, 0), (9, 2)])
        text = io.StringIO()
        document.write(text)
        drawings.append(text.getvalue().encode())
    return tuple(drawings)
