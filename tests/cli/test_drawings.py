"""Drawings from the command line: results, sentences for bad input, interrupted runs."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

from armcontour.io import ResultFolder

PLAIN = "x [mm],y [mm]\n0,0\n60,0\n60,40\n"
TWO = "contour,x [mm],y [mm]\na,0,0\na,60,0\nb,0,30\nb,60,30\nb,60,60\nb,0,30\n"
GCODE = """G21 G90 F3000
S1000 M3
G0 X10 Y10
G1 X50 Y10
G1 X50 Y40
M5
G0 X60 Y60
M3
G1 X90 Y60
G1 X90 Y90
G1 X60 Y60
M2
"""
Call = Callable[..., tuple[int, str]]


@pytest.fixture
def folder(tmp_path: FilePath) -> FilePath:
    (tmp_path / "plain.csv").write_text(PLAIN)
    (tmp_path / "two.csv").write_text(TWO)
    (tmp_path / "part.ngc").write_text(GCODE)
    (tmp_path / "deep.ngc").write_text("G21 F600\nG1 X10 Y0 Z1\nG1 X20 Y10 Z0\n")
    return tmp_path


@pytest.fixture
def call(folder: FilePath, command_in: Callable[..., Any]) -> Call:
    """The command line in this process, in the folder: exit code and what is said of an error."""

    def called(*arguments: str) -> tuple[int, str]:
        done = command_in(folder, *arguments)
        return done.code, done.errors

    return called


def table(file: FilePath) -> np.ndarray:
    return np.loadtxt(file, delimiter=",", skiprows=1)


def test_runs_g_code_in_a_cell_with_exports(folder: FilePath, call: Call) -> None:
    (folder / "list.txt.j2").write_text(
        "{% for e in events %}{{ e.text }} {{ outputs.get(e.name) }}\n{% endfor %}"
    )
    code, said = call(
        *("run", "part.ngc", "--cell", "pmk3s", "--out", "out", "--export", "csv"),
        *("--template", "list.txt.j2", "--output", "spindle=3", "--speed", "80 mm/s"),
    )
    assert code == 0, said
    summary = json.loads((folder / "out" / "summary.json").read_text())
    for name in summary["files"]:
        assert (folder / "out" / name).is_file()
    exports = {x for x in summary["files"] if "/export/" in x}
    assert exports == {
        f"taught/export/{a}{b}" for a in ("taught", "reference") for b in (".csv", ".txt")
    }
    told = (folder / "out" / "taught" / "export" / "taught.txt").read_text().splitlines()
    spindle = [x for x in told if x.startswith("spindle=")]
    assert spindle == ["spindle=on 3", "spindle=off 3", "spindle=on 3", "spindle=off 3"]
    taught = table(folder / "out" / "taught" / "taught.csv")
    np.testing.assert_allclose(np.diff(taught[:, 0]), 4e-3, atol=1e-12)
    assert summary["runs"]["taught"]["contour_error"]["max"] < 1e-4
    assert not list(folder.rglob(".armcontour-*"))


def test_leaves_out_words_of_g_code_by_name(folder: FilePath, call: Call) -> None:
    text = GCODE.replace("M5\n", "T2 M6 H3\nG55\n")
    (folder / "tools.ngc").write_text(text)
    begin = ("run", "tools.ngc", "--cell", "pmk3s", "--no-simulation", "--out")
    code, said = call(*begin, "one")
    assert (code, "tools.ngc, line 8: a coordinate X in the coordinate system G55" in said) == (
        2,
        True,
    )
    code, said = call(*begin, "one", "--skip-unknown")
    assert (code, "line 8" in said) == (2, True)
    code, said = call(*begin, "one", "--skip", "G55", "--skip", "M6, T")
    assert code == 0, said
    summary = json.loads((folder / "one" / "summary.json").read_text())
    assert "M6 (1 time" in " ".join(summary["runs"]["taught"]["warnings"])
    code, said = call(*begin, "two", "--skip", "X")
    assert (code, "names 'X', which cannot be left out" in said) == (2, True)


def test_resumes_and_replaces_only_with_force(folder: FilePath, call: Call) -> None:
    begin = ("run", "plain.csv", "--cell", "pmk3s", "--no-simulation", "--out", "out")
    assert call(*begin)[0] == 0
    whole = table(folder / "out" / "taught" / "planned.csv")
    code, said = call(*begin, "--from-s", "60 mm")
    assert (code, "--force" in said) == (2, True)
    assert call(*begin, "--from-s", "60 mm", "--force")[0] == 0
    rest = table(folder / "out" / "taught" / "planned.csv")
    # What is left ends where all of it does, and begins at the corner.
    np.testing.assert_allclose(rest[-1, 1:3], whole[-1, 1:3], atol=1e-9)
    corner = np.abs(whole[:, 1:3] - rest[0, 1:3]).max(axis=1)
    assert corner.min() < 0.01 and 0 < corner.argmin() < len(whole) - 1
    assert rest[-1, 0] < whole[-1, 0]


def test_runs_a_small_dxf(folder: FilePath, call: Call) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new(units=4)
    space = drawing.modelspace()
    space.add_line((0, 0), (40, 0), dxfattribs={"layer": "cut"})
    space.add_circle((20, 30), 10, dxfattribs={"layer": "mark"})
    drawing.saveas(folder / "part.dxf")
    begin = ("run", "part.dxf", "--cell", "pmk3s", "--out")
    assert call(*begin, "out", "--layer", "mark")[0] == 0
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert "taught" in summary["runs"]
    code, said = call(*begin, "other", "--layer", "drill")
    assert code == 2 and "'drill'" in said and "'cut'" in said
    assert not (folder / "other").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("plain.csv", ("--cell", "fr3, panda, pmk3s, ur10e, ur5e")),
        ("plain.csv --cell lathe", ("'lathe'", "fr3, panda, pmk3s, ur10e, ur5e")),
        ("job.yaml --cell pmk3s", ("job.yaml", "--cell goes with a drawing")),
        ("none.csv --cell pmk3s", ("none.csv", "There is no file")),
        ("plain.txt --cell pmk3s", ("plain.txt", ".dxf")),
        ("robot.urdf", ("robot.urdf is no file that can be read as a path",)),
        ("deep.ngc --cell pmk3s", ("deep.ngc has z", "--flat")),
        ("two.csv --cell pmk3s --at 0.5m,0.3m", ("Contour b", "out of reach")),
        ("two.csv --cell pmk3s --at 0.3m", ("--at", "2 or 3", "'0.3m'")),
        ("two.csv --cell pmk3s --at 0.3m,b", ("--at", "'b'")),
        ("two.csv --cell pmk3s --at 0.3m,0.1m,0.1m", ("path.frame", "z = 0")),
        ("two.csv --cell pmk3s --at 380,-70,50", ("--at", "'380' has no unit", "'5 mm'")),
        ("two.csv --cell pmk3s --turn 0,0,90", ("--turn", "'90' has no unit", "'90 deg'")),
        ("two.csv --cell pmk3s --speed 5", ("--speed", "'5' has no unit")),
        ("two.csv --cell pmk3s --turn 90", ("--turn", "3 values", "'90'")),
        ("two.csv --cell pmk3s --turn 0,0,9kg", ("--turn", "9kg")),
        ("two.csv --cell pmk3s --scale 0", ("scale", "0")),
        ("two.csv --cell pmk3s --units kg", ("units", "'kg'")),
        ("two.csv --cell pmk3s --layer cut", ("no layer 'cut'",)),
        ("two.csv --cell pmk3s --contour c", ("no contour 'c'", "'a', 'b'")),
        ("two.csv --cell pmk3s --speed 5mm", ("--speed", "5mm")),
        ("two.csv --cell pmk3s --speed 0", ("--speed", "above zero")),
        ("two.csv --cell pmk3s --tolerance -1mm", ("--tolerance", "negative")),
        ("two.csv --cell pmk3s --from-s 2m", ("resumed at 2 m",)),
        ("two.csv --cell pmk3s --from-s x", ("--from-s", "'x'")),
        ("two.csv --cell pmk3s --export xml", ("'xml'", "parquet")),
        ("two.csv --cell pmk3s --export template", ("--template",)),
        ("two.csv --cell pmk3s --export csv --export csv", ("--export csv", "twice")),
        ("two.csv --cell pmk3s --template a.csv.j2 --export csv", ("a.csv.j2", "taught.csv")),
        ("two.csv --cell pmk3s --output tool", ("--output goes with",)),
        ("two.csv --cell pmk3s --export urscript --output tool", ("'tool'", "tool=0")),
        ("two.csv --cell ur5e --export urscript --output tool=1", ("'tool'", "switches nothing")),
        ("part.ngc --cell ur5e --export urscript --output tool=1", ("'tool'", "spindle")),
        ("part.ngc --cell ur5e --export urscript --output spindle=9", ("spindle", "0 to 7")),
    ],
)
def test_refuses_in_one_sentence_and_writes_nothing(
    arguments: str, words: tuple[str, ...], call: Call, folder: FilePath
) -> None:
    before = sorted(x.name for x in folder.iterdir())
    code, said = call("run", *arguments.split(), "--out", "out")
    assert code in (2, 3), said
    assert said.startswith("Error: ") and said.endswith(".\n") and said.count("\n") == 1
    missing = [x for x in words if x not in said]
    assert not missing, said
    assert sorted(x.name for x in folder.iterdir()) == before


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (("--template", "kuka"), ("6 joints", "2")),
        (("--export", "urscript"), ("6 joints", "2")),
        (("--template", "none.j2"), ("none.j2",)),
        (("--template", "wrong.txt.j2"), ("wrong.txt.j2", "line 2")),
    ],
)
def test_what_cannot_be_exported_is_refused_before_the_run(
    asked: tuple[str, str],
    words: tuple[str, ...],
    call: Call,
    folder: FilePath,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (folder / "wrong.txt.j2").write_text("{{ dof }}\n{{ speed }}\n")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("the job was run")

    monkeypatch.setattr("armcontour.jobs.run", never)
    code, said = call("run", "two.csv", "--cell", "pmk3s", "--out", "out", *asked)
    assert code == 2
    assert all(x in said for x in words), said
    assert not (folder / "out").exists()


def test_a_cell_of_ones_own_with_leads_and_a_switch(
    folder: FilePath, call: Call, command_in: Callable[..., Any]
) -> None:
    cell = {
        "name": "mine",
        "arm": "pmk3s",
        "path": {"frame": {"position": [0.3, 0.1, 0]}},
        "limits": {"speed": "50 mm/s", "centripetal_acceleration": "0.09 m/s^2"},
        "corners": {"tolerance": "0.5 mm"},
        "servo": {"kp": 25, "kv": 150},
        "process": {"lead_in": {}, "lead_out": {"length": "3 mm"}, "switch": {"name": "laser"}},
        "runs": {
            "taught": {"timing": {"method": "optimal"}, "compensation": {"method": "inverse"}}
        },
    }
    (folder / "mine.yaml").write_text(yaml.safe_dump(cell))
    done = command_in(folder, "run", "plain.csv", "--cell", "mine.yaml", "--out", "out")
    assert done.code == 0, done.errors
    # The lead-out is too short for the velocity, the automatic lead-in is not.
    assert "the work ends at" in done.out and "the work begins at" not in done.out
    early = {**cell, "process": {"switch": {"name": "laser", "on_lead": "1 s"}}}
    (folder / "early.yaml").write_text(yaml.safe_dump(early))
    code, said = call("run", "plain.csv", "--cell", "early.yaml", "--out", "other")
    assert code == 2 and "laser" in said and "1 s before the motion begins" in said


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM], ids=lambda x: x.name)
def test_an_interrupted_run_leaves_what_was_there_and_nothing_else(
    by: signal.Signals, folder: FilePath
) -> None:
    lines = [f"G0 X0 Y{y}\nG1 X80 Y{y}\nG1 X80 Y{y}.5" for y in range(0, 80)]
    (folder / "long.ngc").write_text("G21 F3000\n" + "\n".join(lines) + "\n")
    out = folder / "out"
    with ResultFolder(out) as results:
        results.write("old.txt", "old")
        results.write("summary.json", "{}")
    earlier = {x.name: x.read_text() for x in out.iterdir()}
    command = [sys.executable, "-m", "armcontour", "run", "long.ngc", "--cell", "ur5e"]
    process = subprocess.Popen(
        [*command, "--out", "out", "--force", "--export", "csv"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A test may run where these are ignored.
        preexec_fn=lambda: signal.signal(by, signal.SIG_DFL),
    )
    try:
        until = time.monotonic() + 60
        while not list(out.glob(".armcontour-*")):
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.02)
        time.sleep(1.0)
        assert process.poll() is None, "it was over before it was interrupted"
        process.send_signal(by)
        _, said = process.communicate(timeout=60)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        process.wait()
    assert process.returncode == 128 + by, said
    assert "Traceback" not in said
    assert {x.name: x.read_text() for x in out.iterdir()} == earlier


def test_without_simulation_what_is_asked_for_is_written(folder: FilePath, call: Call) -> None:
    command = ["run", "part.ngc", "--cell", "pmk3s", "--no-simulation"]
    code, said = call(*command, "--out", "out", "--export", "csv")
    assert code == 0, said
    found = json.loads((folder / "out" / "summary.json").read_text())
    assert found["simulated"] is False
    assert found["files"] == [
        "taught/export/reference.csv",
        "taught/export/taught.csv",
        "summary.json",
    ]
    written = {x.relative_to(folder / "out").as_posix() for x in (folder / "out").rglob("*.*")}
    assert written == {*found["files"], ".armcontour.json"}
    run = found["runs"]["taught"]
    assert run["duration"] > 0 and run["moves"] and "contour_error" not in run
    # The same set-points as with it.
    assert call("run", "part.ngc", "--cell", "pmk3s", "--out", "whole")[0] == 0
    taught = table(folder / "whole" / "taught" / "taught.csv")
    file = folder / "out" / "taught" / "export" / "taught.csv"
    exported = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2))
    np.testing.assert_array_equal(exported[:, 1:], taught[:, 1:3])
    # In exports time counts from the first set-point.
    np.testing.assert_allclose(exported[:, 0], taught[:, 0] - taught[0, 0], rtol=0, atol=2e-12)
    titles = (folder / "whole" / "taught" / "taught.csv").read_text().splitlines()[0]
    assert titles == "t [s],q 1 [rad],q 2 [rad]"
    assert file.read_text().startswith(titles)
    # Without formats it is the plain files.
    assert call(*command, "--out", "plain")[0] == 0
    assert (folder / "plain" / "taught" / "planned.csv").is_file()
    assert not (folder / "plain" / "report.html").exists()
