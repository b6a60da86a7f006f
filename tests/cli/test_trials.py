"""Command lines that once went wrong for users: each gives one sentence, or the right result.

The numbers are those of the notes on these trials: parts 1 (a user), 2 (an audit), 3 (files).
"""

import json
import re
from pathlib import Path as FilePath

import ezdxf
import numpy as np
import pytest
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.errors import ArmContourError

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
    "g55.ngc": "G21 G90 F600\nG55\nG0 X0 Y0\nG1 X10\nG54\nG1 X20\nM2\n",
    "inch.ngc": "G20 F6\nG0 X0 Y0\nG1 X1\nM2\n",
    "on.ngc": "G21 G90 F3000\nG0 X0 Y0\nM3 S1\nG1 X50\nG1 Y30\nM5\nM2\n",
    "words.ngc": "G21 G90 F600\nM115 U6.3.0+10\nM117 printing part\nG4 S1\nG1 X10\nM2\n",
    "formula.ngc": "G21 G90 F600\n#1=10\nG1 X[#1*2]\nM2\n",
    "cycle.ngc": "G21 G90 F600\nG0 X0 Y0 Z5\nG81 X10 Z-2 R1\nX20\nG80\nM2\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with the files of most command lines."""
    monkeypatch.chdir(tmp_path)
    for name, text in GCODE.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    (tmp_path / "stiff.yaml").write_text(BRACKET.replace("kv: 150 1/s", "kv: 1e9"))
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
def call(folder):
    """A command line in the folder: its exit code, and what is said, an error at the end."""

    def called(line):
        words = [x.strip("'") for x in re.findall(r"'[^']*'|\S+", line)]
        done = CliRunner().invoke(app, words, env={"COLUMNS": "300"})
        error = done.exception
        if isinstance(error, ArmContourError):
            return error.exit_code, f"{done.output}{error}"
        if error is not None and not isinstance(error, SystemExit):
            raise error
        return done.exit_code, done.output

    return called


def drawing(units=4):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units
    return document


def is_one_sentence(text):
    return "\n" not in text and text.endswith(".") and len(text) < 600


RUN = "--no-simulation --out out"
ROBOT = FilePath(__file__).parents[1] / "io" / "robots" / "data" / "robot.urdf"
ON = f"run on.ngc --cell ur5e --at 0.35m,-0.1m,0.1m {RUN} --export urscript --template abb"
REFUSED = {
    "1.D1": ("run stiff.yaml --out out", "kv must be from 0.001 to 1e+06 1/s"),
    "1.D5": ("certify lines.dxf", "--cell"),
    "1.D14-certify": ("certify bracket.yaml --run compensated --out out", "key `certificate`"),
    "1.D16-open": (f"run lines.dxf --cell ur5e --open {RUN}", "leave --no-simulation out"),
    "1.D16-units": (f"run mm.csv --cell ur5e {RUN}", "--units mm"),
    "1.D16-plane": (f"run mm.csv --cell pmk3s --flat {RUN}", "--units mm"),
    "1.D16-half": ("show half.dxf", "it seems to be cut off"),
    "1.D16-layer": (
        "show lines.dxf --layer FOO",
        "no contour on the layer 'FOO': it has entities on '0', 'MARK'",
    ),
    "1.D16-dwg": ("show old.dwg", "save it as DXF"),
    "1.D16-check": ("check two.csv --arm ur5e", "two.csv has positions of 2 joints"),
    "1.D16-from": ("identify two.csv --from 0.5", "'0.5' has no unit: write one, as in '2 s'"),
    "3.W3": ("show g55.ngc --skip-unknown", "line 6: a coordinate X in the coordinate system G54"),
    "3.4.4": ("check two.csv --arm hand.URDF", "no robot description hand.URDF"),
    "1.D16-tip": (f"check two.csv --arm {ROBOT}", "arm: {tip: cover}; for check, --tip cover)"),
    "1.D7-abb": (f"{ON} --output spindle=3", "abb:tool=doTool"),
    "1.D7-urscript": (f"{ON} --output spindle=doArc", "urscript:spindle=0"),
    "3.5-unit": (
        "show no_unit.dxf",
        "does not say its unit ($INSUNITS): give it, such as `units: mm`",
    ),
    "3.5-colour": ("show lines.dxf --color 5", "1 #ff0000"),
}


def test_refusals_are_one_clear_sentence(call, folder):
    faults = []
    for name, (line, words) in REFUSED.items():
        code, said = call(line)
        wrong = code not in (2, 3) or words not in said or not is_one_sentence(said)
        if wrong or (folder / "out").exists():
            faults.append((name, code, said))
    assert faults == []


def facts(call, line):
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
    "3.5-words": ("words.ngc", 10, (10, 0), "M117"),
    "3.5-formula": ("formula.ngc", 20, (20, 0), ""),
    "3.5-cycle": ("cycle.ngc", 3 + 3, (10, 0), ""),
    "3.5-colour": ("lines.dxf --color red", 100, (100, 0), ""),
}


def test_drawings_are_read_as_they_are(call):
    for name, (file, length, size, words) in READ.items():
        found = facts(call, file)
        low, high = np.array(found["extent"])[:, :2]
        np.testing.assert_allclose((high - low) * 1e3, size, atol=1e-9, err_msg=name)
        assert length is None or found["length"] == pytest.approx(length * 1e-3, abs=1e-12), name
        assert words in " ".join(found["notes"]), name


def test_1_d16_seconds_for_milliseconds_are_reported_once(call, folder):
    for interval in ("4", "2"):
        text = BRACKET.replace("command_interval: 4 ms", f"command_interval: {interval}")
        FilePath(f"slow{interval}.yaml").write_text(text)
    code, said = call(f"run slow4.yaml {RUN}")
    assert code == 2 and is_one_sentence(said) and "`command_interval: 4 ms`" in said
    code, said = call(f"run slow2.yaml {RUN}")
    (warning,) = (x for x in said.splitlines() if x.startswith("Warning: "))
    assert code == 0 and "write command_interval: 4 ms" in warning
