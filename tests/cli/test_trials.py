"""Command lines that once went wrong for users: each gives one sentence, or the right result.

The numbers are those of the notes on these trials: parts 1 (a user), 2 (an audit), 3 (files).
"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath

import ezdxf
import numpy as np
import pytest
from ezdxf.xclip import XClip
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.errors import ArmContourError
from armcontour.io.cell import cell_names

Call = Callable[[str], tuple[int, str]]

BRACKET = """name: bracket
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.10 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 4 ms
runs:
  as-planned: {compensation: {method: none}}
  compensated: {compensation: {method: pole_placement}}
"""
# A speed and a tolerance of a layer that are above those of the cell.
CAPPED = """name: capped
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
start: [0.2, -1.7, -2.4, -0.6, 1.6, 2.5]
path:
  frame: {position: [380 mm, -70 mm, 50 mm]}
  orientation: {axis: [0, 0, -1]}
  layers: {MARK: {speed: 150 mm/s, tolerance: 0.5 mm}}
limits: {speed: 100 mm/s}
corners: {tolerance: 0.25 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 4 ms
runs: {taught: {compensation: {method: inverse}}}
"""
CUT = """process:
  order: drawn
  lead_in: {length: 3 mm, shape: arc}
  lead_out: {length: 3 mm, shape: arc}
  switch: {name: laser}
"""
# The beginning of a print by Cura, with jerk control in the middle of it.
CURA = """T0
G92 E0
G0 Z20.001
G1 F1500 E-6.5
M205 X100 Y100
G1 F600 Z2.2
M205 X50 Y50
G1 F600 Z0.2
G1 F1200 X10 Y10 E0
G1 X40 Y10 E1
M205 X200 Y200
"""
FANUC = """%
O1000 (PART)
G00 G17 G21 G40 G49 G80 G90
G28 G91 Z0
G90
T1 M6
G43 H1
G54
G0 X0 Y0 Z5
G1 Z0 F600
G1 X50 Y0
G1 X50 Y20
M30
%
"""
GCODE = {
    "cura.gcode": CURA,
    "fanuc.nc": FANUC,
    "comp.ngc": "G21 G90 F600\nG0 X0 Y0\nG41 D1\nG1 X10 Y0\nG1 X20 Y10\nG40\nM2\n",
    "g55.ngc": "G21 G90 F600\nG55\nG0 X0 Y0\nG1 X10\nG54\nG1 X20\nM2\n",
    "m98.ngc": "G21 G90 F600\nG0 X0 Y0\nM98 P100\nM2\n",
    "inch.ngc": "G20 F6\nG0 X0 Y0\nG1 X1\nM2\n",
    "words.ngc": "G21 G90 F600\nM115 U6.3.0+10\nM117 printing part\nG4 S1\nG1 X10\nM2\n",
    "formula.ngc": "G21 G90 F600\n#1=10\nG1 X[#1*2]\nM2\n",
    "cycle.ngc": "G21 G90 F600\nG0 X0 Y0 Z5\nG81 X10 Z-2 R1\nX20\nG80\nM2\n",
    "probe.ngc": "G21 G90 F600\nG38.2 Z-10\nG1 X10\nM2\n",
}


@pytest.fixture
def folder(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> FilePath:
    """The current folder, with the files of most command lines."""
    monkeypatch.chdir(tmp_path)
    for name, text in GCODE.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    (tmp_path / "stiff.yaml").write_text(BRACKET.replace("kv: 150 1/s", "kv: 1e9"))
    (tmp_path / "capped.yaml").write_text(CAPPED)
    (tmp_path / "mm.csv").write_text("x,y,z\n300,0,100\n400,0,100\n400,100,100\n")
    (tmp_path / "two.csv").write_text("t [s],q1 [deg],q2 [deg]\n0,0,0\n0.01,0,0\n0.02,0,0.001\n")
    (tmp_path / "old.dwg").write_bytes(b"AC1027" + bytes(100))
    document = drawing()
    space = document.modelspace()
    space.add_line((0, 0), (100, 0))
    space.add_line((0, 20), (100, 20), dxfattribs={"layer": "MARK", "color": 1})
    space.add_text("a note", dxfattribs={"layer": "NOTES"})
    document.saveas(tmp_path / "lines.dxf")
    text = (tmp_path / "lines.dxf").read_text()
    (tmp_path / "half.dxf").write_text(text[: text.index("ENTITIES") + 10])
    no_unit = drawing(units=0)
    no_unit.modelspace().add_line((0, 0), (100, 0))
    no_unit.header["$MEASUREMENT"] = 1
    no_unit.saveas(tmp_path / "no_unit.dxf")
    return tmp_path


@pytest.fixture
def call(folder: FilePath) -> Call:
    """A command line in the folder: its exit code, and what is said, an error at the end."""

    def called(line: str) -> tuple[int, str]:
        words = [x.strip("'") for x in re.findall(r"'[^']*'|\S+", line)]
        done = CliRunner().invoke(app, words, env={"COLUMNS": "300"})
        error = done.exception
        if isinstance(error, ArmContourError):
            return error.exit_code, f"{done.output}{error}"
        if error is not None and not isinstance(error, SystemExit):
            raise error
        return done.exit_code, done.output

    return called


def drawing(units: int = 4) -> ezdxf.document.Drawing:
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units
    return document


def is_one_sentence(text: str) -> bool:
    return "\n" not in text and text.endswith(".") and len(text) < 600


RUN = "--no-simulation --out out"
REFUSED = {
    "1.D1": ("run stiff.yaml --out out", "kv must be from 0.001 to 1e+06 1/s"),
    "1.D2-turn": (f"run lines.dxf --cell ur5e --turn '0,0,90' {RUN}", "'90 deg'"),
    "1.D2-at": (
        f"run lines.dxf --cell ur5e --at '380,-70,50' {RUN}",
        "'380' has no unit: write one, as in '5 mm'",
    ),
    "1.D2-speed": (
        f"run lines.dxf --cell ur5e --speed 5 {RUN}",
        "'5' has no unit: write one, as in '0.15 m/s'",
    ),
    "1.D5": ("certify lines.dxf", "--cell"),
    "1.D8-G41": ("show comp.ngc --skip-unknown", "line 3: G41"),
    "1.D8-M98": ("show m98.ngc", "line 3: a call of 100"),
    "1.D14-certify": ("certify bracket.yaml --run compensated", "by --servo (certify takes"),
    "1.D14-sweep": ("sweep bracket.yaml --run compensated --out out", "key `certificate`"),
    "1.D16-open": (f"run lines.dxf --cell ur5e --open {RUN}", "leave --no-simulation out"),
    "1.D16-units": (f"run mm.csv --cell ur5e {RUN}", "--units mm"),
    "1.D16-plane": (f"run mm.csv --cell pmk3s --flat {RUN}", "--units mm"),
    "1.D16-half": ("show half.dxf", "it seems to be cut off"),
    "1.D16-parsec": ("show lines.dxf --units parsec", "1e+12 m"),
    "1.D16-layer": (
        "show lines.dxf --layer FOO",
        "no contour on the layer 'FOO': it has entities on '0', 'MARK'",
    ),
    "1.D16-dwg": ("show old.dwg", "save it as DXF"),
    "1.D16-check": ("check two.csv --arm ur5e", "two.csv has positions of 2 joints"),
    "1.D16-from": ("identify two.csv --from 0.5", "'0.5' has no unit: write one, as in '2 s'"),
    "3.W3": ("show g55.ngc --skip-unknown", "line 6: a coordinate X in the coordinate system G54"),
    "3.4.4": ("check two.csv --arm hand.URDF", "no robot description hand.URDF"),
    "3.5-probe": ("show probe.ngc", "line 2"),
    "3.5-unit": (
        "show no_unit.dxf",
        "does not say its unit ($INSUNITS): give it, such as `units: mm`",
    ),
    "3.5-colour": ("show lines.dxf --color 5", "1 #ff0000"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_one_clear_sentence(name: str, call: Call, folder: FilePath) -> None:
    line, words = REFUSED[name]
    code, said = call(line)
    assert code in (2, 3), said
    assert words in said and is_one_sentence(said), said
    assert not (folder / "out").exists()


def facts(call: Call, line: str) -> dict[str, object]:
    """What `show --json` says of a drawing."""
    code, said = call(f"show {line} --json")
    assert code == 0, said
    found: dict[str, object] = json.loads(said)
    return found


READ = {
    # File, length [mm], extent in x and y [mm], words of the notes.
    "1.D8": ("fanuc.nc", 5 + 50 + 20, (50, 20), "Tool length compensation"),
    "1.D16-notes": ("lines.dxf", 200, (100, 20), "1 TEXT"),
    "3.W1": ("cura.gcode", None, (40, 10), "M205 (3 times, first in line 5)"),
    "3.4.10": ("inch.ngc", 25.4, (25.4, 0), ""),
    "3.4.11": ("fanuc.nc", 5 + 50 + 20, (50, 20), "G28 (1 time, first in line 4)"),
    "3.5-words": ("words.ngc", 10, (10, 0), "M117"),
    "3.5-formula": ("formula.ngc", 20, (20, 0), ""),
    "3.5-cycle": ("cycle.ngc", 3 + 3, (10, 0), ""),
    "3.5-colour": ("lines.dxf --color red", 100, (100, 0), ""),
}


@pytest.mark.parametrize("name", READ)
def test_drawings_are_read_as_they_are(name: str, call: Call) -> None:
    file, length, size, words = READ[name]
    found = facts(call, file)
    low, high = np.array(found["extent"])[:, :2]
    np.testing.assert_allclose((high - low) * 1e3, size, atol=1e-9)
    if length is not None:
        assert found["length"] == pytest.approx(length * 1e-3, abs=1e-12)
    assert words in " ".join(found["notes"])


def test_3_w2_a_clipped_block_is_cut(call: Call, folder: FilePath) -> None:
    document = drawing()
    document.blocks.new("b").add_line((-10, 0), (10, 0))
    x = document.modelspace().add_blockref("b", (50, 0))
    XClip(x).set_block_clipping_path([(-5, -9), (0, -9), (0, 9), (-5, 9)])
    document.saveas("clipped.dxf")
    found = facts(call, "clipped.dxf")
    assert np.array(found["extent"])[:, 0] == pytest.approx([0.045, 0.050], abs=1e-12)


def test_3_42_splines_of_pieces_are_split(call: Call) -> None:
    document = drawing()
    pieces = [(0, 0), (10, 20), (20, 20), (30, 0), (30, 0), (40, -20), (50, 10), (60, 0)]
    spline = document.modelspace().add_spline(degree=3)
    spline.control_points = [(*p, 0) for p in pieces]
    spline.knots = np.repeat([0.0, 1.0, 2.0], 4).tolist()
    document.saveas("pieces.dxf")
    u = np.linspace(0, 1, 20_001)[:, None]
    length = 0.0
    for k in (0, 4):
        a, b, c, d = np.array(pieces[k : k + 4], dtype=float)
        x = a * (1 - u) ** 3 + 3 * b * u * (1 - u) ** 2 + 3 * c * u**2 * (1 - u) + d * u**3
        length += np.linalg.norm(np.diff(x, axis=0), axis=1).sum() * 1e-3
    assert facts(call, "pieces.dxf")["length"] == pytest.approx(length, rel=1e-4)


def test_3_43_a_broken_entity_is_named_with_its_line(call: Call, folder: FilePath) -> None:
    document = drawing()
    space = document.modelspace()
    space.add_line((0, 0), (100, 0))
    spline = space.add_spline(degree=3)
    spline.control_points = [(0, 0, 0), (1, 2, 0), (3, 2, 0), (4, 0, 0)]
    spline.knots = [0, 1]
    document.saveas("broken.dxf")
    code, said = call("show broken.dxf")
    assert code == 2 and re.search(r"SPLINE.*line \d+|line \d+.*SPLINE", said), said
    assert facts(call, "broken.dxf --skip-unknown")["length"] == pytest.approx(0.1, abs=1e-12)


def test_3_412_sizes_in_percent_and_colours_of_strokes(call: Call, folder: FilePath) -> None:
    FilePath("percent.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="50mm" viewBox="0 0 100 50">'
        '<rect width="100%" height="100%" stroke="red" fill="none"/><text x="3" y="5">hi</text>'
        '<path d="M10 10 L50 10" stroke="#00f"/></svg>'
    )
    assert facts(call, "percent.svg")["length"] == pytest.approx(0.34, abs=1e-12)
    assert facts(call, "percent.svg --color blue")["length"] == pytest.approx(0.04, abs=1e-12)


# The three wrist joints, one more before them, and what stands beside: a finger that cannot be at
# 0, a link that mimics the elbow, and an inertia that no body can have.
JOINT = """<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 0.2"/><axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="{effort}"
velocity="2"/>{more}</joint>"""


def describe_arm(*, effort: str = "0", inertia: str = "", beside: str = "") -> str:
    names = ("base_link", "l1", "l2", "l3", "l4")
    links = "".join(f'<link name="{x}">{inertia if x == "l2" else ""}</link>' for x in names)
    joints = "".join(
        JOINT.format(
            name=f"joint_{k + 1}",
            type="revolute",
            parent=names[k],
            child=names[k + 1],
            axis=("0 0 1", "0 1 0", "0 1 0", "0 0 1")[k],
            lower=-3,
            upper=3,
            effort=effort,
            more="",
        )
        for k in range(4)
    )
    return f'<robot name="arm">{links}{joints}{beside}</robot>'


def beside(kind: str, lower: float, upper: float, more: str = "") -> str:
    given = {"parent": "l1", "child": "side", "axis": "0 1 0", "effort": "1", "name": "side_joint"}
    joint = JOINT.format(**given, type=kind, lower=lower, upper=upper, more=more)
    return f'<link name="side"/>{joint}'


NO_BODY = (
    '<inertial><mass value="2"/><inertia ixx="0.003" iyy="0.007" izz="0.013" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)
ARMS = {
    # File, description, options, words of a note.
    "1.D9 3.4.1": ("arm.urdf", describe_arm(), "", "limits of effort are left out"),
    "3.4.4": ("arm.URDF", describe_arm(), "", ""),
    "3.4.7": ("arm.urdf", describe_arm(effort="9", inertia=NO_BODY), "", "l2"),
    "3.4.8": (
        "arm.urdf",
        describe_arm(beside=beside("prismatic", 0.015, 0.037)),
        "--tip l4",
        "side_joint",
    ),
    "3.4.9": (
        "arm.urdf",
        describe_arm(beside=beside("revolute", -1, 1, '<mimic joint="joint_2"/>')),
        "--tip l4",
        "",
    ),
}


@pytest.mark.parametrize("name", ARMS)
def test_robot_descriptions_load(name: str, call: Call, folder: FilePath) -> None:
    file, text, options, words = ARMS[name]
    FilePath(file).write_text(text)
    rows = ["t,q1,q2,q3,q4,i1 [A],TCP_x"]
    rows += [f"{0.01 * k:.2f},{0.001 * math.sin(k / 30):.9f},0,0,0,1,2" for k in range(40)]
    FilePath("log.csv").write_text("\n".join(rows) + "\n")
    code, said = call(f"check log.csv --arm {file} {options}")
    assert code == 0, said
    assert words in said
    # 3.4.5: columns that are not known are left out.
    assert "Left out of log.csv, since they are not known: 'i1 [A]', 'TCP_x'" in said


def test_1_d16_the_tip_is_named_as_the_command_takes_it(call: Call, folder: FilePath) -> None:
    FilePath("arm.urdf").write_text(describe_arm(beside=beside("revolute", -1, 1)))
    code, said = call("check two.csv --arm arm.urdf")
    assert code == 2 and is_one_sentence(said)
    assert "in a job, arm: {tip: l4}; for check, --tip l4" in said


@pytest.mark.parametrize("measured", ["q1_actual", "q1_measured", "q1_meas", "q1_feedback"])
def test_1_d3_columns_of_the_guide_are_read(measured: str, call: Call, folder: FilePath) -> None:
    t = np.arange(400) * 4e-3
    command = 0.2 * np.sin(2 * np.pi * t) + 0.05 * np.sin(2 * np.pi * 3.3 * t)
    q, found = 0.0, []
    for u in command:
        found.append(q)
        q += (u - q) * (1 - math.exp(-25 * 4e-3))
    rows = [f"{a:.4f};{b:.7f};{c:.7f}" for a, b, c in zip(t, command, found, strict=True)]
    head = f"# commands: set-points\nt [s];q1_cmd [rad];{measured} [rad]"
    FilePath("log.csv").write_text("\n".join([head, *rows]))
    line = "identify log.csv --model first --interpolation step --longest-dead-time '20 ms' --json"
    code, said = call(line)
    assert code == 0, said
    (kp, *_) = json.loads(said)["joints"][0]["parameters"]
    assert kp["name"] == "kp" and kp["value"] == pytest.approx(25, rel=1e-2)


def rounded_rectangle(decimals: int) -> str:
    """80 x 50 mm with corners of 8 mm, turned by 23 degrees, in G-code."""
    a = math.radians(23)
    turn = np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]])
    sides = [(8, 0), (72, 0), (80, 8), (80, 42), (72, 50), (8, 50), (0, 42), (0, 8), (8, 0)]
    centres = [(72, 8), (72, 42), (8, 42), (8, 8)]
    points, middles = np.array(sides) @ turn.T, np.array(centres) @ turn.T

    def said(*words: tuple[str, float]) -> str:
        return " ".join(f"{letter}{value:.{decimals}f}" for letter, value in words)

    lines = ["G21 G90 G64 P0.1 F6000", "G0 " + said(("X", points[0, 0]), ("Y", points[0, 1]))]
    for k in range(4):
        x, y = points[2 * k + 1]
        lines.append("G1 " + said(("X", x), ("Y", y)))
        (i, j), (u, v) = middles[k] - (x, y), points[2 * k + 2]
        lines.append("G3 " + said(("X", u), ("Y", v), ("I", i), ("J", j)))
    return "\n".join([*lines, "M2", ""])


def test_2_d1_printed_arcs_do_not_stop(call: Call, folder: FilePath) -> None:
    found = {}
    for decimals in (3, 14):
        FilePath("rr.ngc").write_text(rounded_rectangle(decimals))
        code, said = call(f"run rr.ngc --cell pmk3s {RUN} --force")
        assert code == 0 and "full stop" not in said, said
        found[decimals] = json.loads(FilePath("out/summary.json").read_text())["runs"]["taught"]
    assert found[3]["full_stops"]["count"] == 0
    assert found[3]["duration"] <= 1.01 * found[14]["duration"]


def warnings(said: str) -> list[str]:
    return [x for x in said.splitlines() if x.startswith("Warning: ")]


def test_1_d4_capped_layers_are_said(call: Call) -> None:
    document = drawing()
    mark = {"layer": "MARK", "color": 1}
    document.modelspace().add_lwpolyline([(0, 20), (100, 20), (100, 60)], dxfattribs=mark)
    document.saveas("angle.dxf")
    code, said = call(f"run angle.dxf --cell capped.yaml {RUN}")
    speed, tolerance = warnings(said)
    assert code == 0
    assert "150 mm/s of segment 1, segment 2 is capped at 100 mm/s by limits.speed" in speed
    assert "0.5 mm of segment 1, segment 2 is capped at 0.25 mm by corners.tolerance" in tolerance


def test_no_corner_tolerance_is_capped_without_corners(call: Call) -> None:
    code, said = call(f"run lines.dxf --cell capped.yaml {RUN}")
    speed, *others = warnings(said)
    assert code == 0
    assert "150 mm/s of segment 1 is capped at 100 mm/s by limits.speed" in speed
    assert all("TEXT" in x for x in others)


def test_1_d6_d10_order_and_slow_leads_are_said_once(call: Call, folder: FilePath) -> None:
    document = drawing()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (80, 0), (80, 60), (0, 60)], close=True)
    for x in (20, 40, 60):
        space.add_circle((x, 30), 6)
    document.saveas("flange.dxf")
    cell = CAPPED.replace("  layers: {MARK: {speed: 150 mm/s, tolerance: 0.5 mm}}\n", "")
    cell = cell.replace("limits: {", "limits: {centripetal_acceleration: 1 m/s^2, ")
    FilePath("cut.yaml").write_text(cell + CUT)
    code, said = call(f"run flange.dxf --cell cut.yaml {RUN}")
    assert code == 0, said
    (order,) = (x for x in warnings(said) if "is cut before" in x)
    assert "the order inside_first cuts what lies inside first" in order
    (lead,) = (x for x in warnings(said) if "lead" in x)
    assert re.search(r"4\d\.\d of 100 mm/s.* with [\d.]+ mm in place of 3 mm", lead), lead


def test_1_d7_d12_d13_exports_of_one_run(call: Call, folder: FilePath) -> None:
    FilePath("on.ngc").write_text("G21 G90 F3000\nG0 X0 Y0\nM3 S1\nG1 X50\nG1 Y30\nM5\nM2\n")
    line = f"run on.ngc --cell ur5e --at '350 mm, -100 mm, 100 mm' {RUN} --export urscript "
    both = line + "--template abb --period '48 ms' --export ros-yaml --output "
    for given, words in (("3", "abb:tool=doTool"), ("doArc", "urscript:spindle=0")):
        code, said = call(both + f"spindle={given}")
        assert code == 2 and is_one_sentence(said) and words in said, said
    code, said = call(both + "urscript:spindle=3 --output abb:spindle=doArc")
    assert code == 0, said
    jumps, speed = warnings(said)
    assert "times the acceleration limit of" in jumps and "joint_jerk" in jumps
    assert "nothing is switched for spindle speed" in speed
    (program,) = FilePath("out").rglob("reference*.mod")
    duration = json.loads(FilePath("out/summary.json").read_text())["runs"]["taught"]["duration"]
    assert abs(program.read_text().count("MoveAbsJ") - duration / 48e-3) <= 3


def test_1_d16_seconds_for_milliseconds_are_said_once(call: Call, folder: FilePath) -> None:
    for interval in ("4", "2"):
        text = BRACKET.replace("command_interval: 4 ms", f"command_interval: {interval}")
        FilePath(f"slow{interval}.yaml").write_text(text)
    code, said = call(f"run slow4.yaml {RUN}")
    assert code == 2 and is_one_sentence(said) and "`command_interval: 4 ms`" in said
    code, said = call(f"run slow2.yaml {RUN}")
    assert code == 0
    (warning,) = warnings(said)
    assert warning.startswith("Warning: Runs as-planned, compensated: the command interval of 2 s")
    assert "write command_interval: 4 ms" in warning


def test_1_4_the_help_lists_the_cells(call: Call) -> None:
    code, said = call("run --help")
    plain = " ".join(re.sub(r"[\s│]+", " ", said).split())
    assert code == 0 and f"a built-in cell ({', '.join(cell_names())})" in plain, plain


def test_1_d16_a_pipe_that_ends_early_has_its_exit_code(folder: FilePath) -> None:
    command = [sys.executable, "-m", "armcontour", "schema"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as done:
        assert done.stdout is not None and done.stderr is not None
        done.stdout.close()
        assert done.stderr.read() == b""
    assert done.returncode == 141


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("-V", "armcontour"),
        ("-h", "--install-completion"),
        ("--help", "130, 141 and 143 interrupted"),
        ("run -h", "-o"),
        ("init --help", "work cell"),
    ],
)
def test_1_4_what_a_command_line_is_expected_to_have(line: str, words: str, call: Call) -> None:
    code, said = call(line)
    assert code == 0 and words in " ".join(said.split()), said
