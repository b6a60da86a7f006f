"""The command line: results, and errors with their exit codes."""

import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml
from tests.cli.helpers import summary

import armcontour as ac

JOB = {
    "name": "bracket",
    "arm": "pmk3s",
    "path": {"points": [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]},
    "limits": {"speed": "0.10 m/s", "centripetal_acceleration": "0.09 m/s^2"},
    "corners": {"tolerance": "2 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "planned": {"timing": {"method": "mac"}, "compensation": {"method": "none"}},
        "compensated": {"timing": {"method": "mac"}, "compensation": {"method": "pole_placement"}},
    },
}
ROBOT = {
    **{"name": "line", "arm": "panda", "limits": {"speed": 0.25}, "servo": JOB["servo"]},
    "path": {"points": [[0.4, 0, 0.3], [0.45, 0, 0.3]], "orientation": {"rpy": ["180 deg", 0, 0]}},
    **{"experiment": {"step": "20 ms"}, "runs": {"one": {}}},
}


@pytest.fixture
def run(tmp_path, done, monkeypatch):
    """Run a job in a folder: the output, and the summary."""
    monkeypatch.chdir(tmp_path)

    def call(job, *options):
        FilePath("job.yaml").write_text(yaml.safe_dump(job))
        return done("run", "job.yaml", "--out", "out", *options), summary(tmp_path / "out")

    return call


def test_runs_a_job(tmp_path, run, refused):
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    # The only run of a file in a process of its own.
    command = [sys.executable, "-m", "armcontour", "run", "job.yaml", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Report: file://" in done.stdout
    found = summary(tmp_path / "out")
    assert set(found["runs"]) == {"planned", "compensated"}
    for name in found["files"]:
        assert (tmp_path / "out" / name).is_file()
    planned, compensated = found["runs"]["planned"], found["runs"]["compensated"]
    assert compensated["contour_error"]["rms"] < planned["contour_error"]["rms"]
    assert compensated["corners"][0]["error"] == pytest.approx(2e-3)
    header, *rows = (tmp_path / "out" / "compensated" / "taught.csv").read_text().splitlines()
    assert header == "t [s],q 1 [rad],q 2 [rad]"
    table = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(np.diff(table[:, 0]), 4e-3, atol=1e-12)
    assert table[-1, 0] >= compensated["duration"]
    assert refused(tmp_path, [("run job.yaml --out out", ["--force"])], codes=(2,)) == []
    run(JOB, "--no-simulation", "--force")


def test_shapes_of_corners_from_the_command_line(tmp_path, run, refused):
    free = ("--corner-shape", "free", "--iterations", "2")
    lines = ("--line-tolerance", "0.1 mm", "--zone", "8 mm")
    job = JOB | {"runs": JOB["runs"] | {"fast": {}}}
    shown, found = run(job, "--no-simulation", *free, *lines)
    assert re.search(r"Run fast: shaped: [\d.]+ s \(arcs [\d.]+ s, .*stops [\d.]+ s\)", shown)
    shaping = found["runs"]["fast"]["shaping"]
    assert "shaping" not in found["runs"]["planned"]
    assert shaping["wanted"]["line_tolerance"] == pytest.approx(1e-4)
    assert shaping["wanted"]["zone"] == pytest.approx(8e-3)
    others = [x for name, x in shaping["durations"].items() if name != "shaped"]
    assert shaping["gain"] == 1 - shaping["durations"]["shaped"] / min(others) >= 0
    assert sum(shaping["starts"].values()) == 1 and shaping["iterations"] <= 2
    rows = [("run job.yaml --out no --zone 8mm", ["corners.zone is for the shape free"])]
    assert refused(tmp_path, rows, codes=(2,)) == []


def test_an_error_has_its_exit_code_and_leaves_nothing(tmp_path, refused, monkeypatch):
    far = {"path": {"points": [[-0.065, 0.3], [0.335, 0.3]]}, "limits": {"speed": 0.3}}
    for change, code, words in (
        ({"path": {"points": [[0.30, 0.20], [0.80, 0.20]]}}, 3, "out of reach"),
        ({"path": {"points": [[0.30, 0.20]]}}, 2, "at least two different points"),
        ({"limits": {"speed": "0.1"}}, 2, "has no unit"),
        ({"limits": {"speed": -0.1}}, 2, "above zero"),
        ({"corners": {"tolerance": "-1 mm"}}, 2, "must not be negative"),
        ({"colour": "red"}, 2, "unknown key colour"),
        ({"servo": {"kp": [1, 2, 3], "kv": 150}}, 2, "3 values"),
        (far, 4, "joint 2"),
        ({"runs": {"a": {"timing": {"method": "magic"}}}}, 2, "runs.a.timing.method: must be"),
    ):
        (tmp_path / "job.yaml").write_text(yaml.safe_dump({**JOB, **change}))
        rows = [("run job.yaml --out out", [words])]
        assert refused(tmp_path, rows, codes=(code,)) == [], change
    # A folder that cannot be written is refused before the work.
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    rows = [("run job.yaml --out job.yaml/out", ["Cannot write to the folder"])]
    assert refused(tmp_path, rows, codes=(2,)) == []
    make = FilePath.mkdir

    def refuse(place, *arguments, **more):
        if place.name.startswith(".armcontour-"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        make(place, *arguments, **more)

    monkeypatch.setattr(FilePath, "mkdir", refuse)
    rows = [("run job.yaml --out out", ["folder out: " + os.strerror(errno.ENOSPC)])]
    assert refused(tmp_path, rows, codes=(2,)) == []


def test_an_experiment_has_its_columns_and_files(tmp_path, run):
    runs = {"one": {}, "two": {"compensation": {"method": "none"}}}
    shown, found = run({**JOB, "runs": runs, "experiment": {"runs": ["one"]}})
    assert "experiment" in shown and "Masses: Both links are assumed" in shown
    assert {"one/taught.csv", "one/planned.csv", "one/torque.csv"} <= set(found["files"])
    header = (tmp_path / "out" / "one" / "torque.csv").read_text().splitlines()[0]
    assert header == "t [s],torque 1 [N m],torque 2 [N m]"
    # A failed experiment leaves the other results.
    shown, found = run(ROBOT, "--force")
    assert "Run one: experiment: Joint 2 is unstable" in shown
    one = found["runs"]["one"]
    assert one["experiment"]["failed"].startswith("experiment: Joint 2 is unstable")
    assert one["contour_error"]["rms"] > 0
    assert (tmp_path / "out" / "one" / "taught.csv").is_file()


def test_lists_arms_version_and_schema(done):
    lines = done("arms").splitlines()
    for words in ("pmk3s: PMK-3s, 2 joints", "ur5e: UR5e, 6 joints", "panda: Panda, 7 joints"):
        assert any(x.startswith(words) for x in lines), words
    assert any(x.startswith("    assumed: Both links are assumed") for x in lines)
    assert max(len(x) for x in lines) <= 100
    assert done("--version").startswith("armcontour 0.")
    assert json.loads(done("schema"))["title"] == "JobModel"


def test_identify_finds_gains_in_a_log(tmp_path, done):
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    line = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)])
    planned = ac.plan(line, arm, arm.limits.replace(speed=0.1))
    t, waves = np.arange(0.0, 10.0, 2e-3), np.arange(0.5, 20.0, 0.5)
    shaken = np.sin(2 * np.pi * np.outer(t, waves) + waves**2).sum(axis=1)
    commands = planned(0.0) + 1e-4 * np.column_stack([shaken, -shaken])
    taught = ac.TaughtData(period=2e-3, q=commands, trajectory=planned, method="none")
    executed = ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=2e-3)
    noise = 1e-6 * np.random.default_rng(1).normal(size=commands.shape)
    measured = executed.q[: len(t)] + noise
    rows = np.column_stack([t, commands[:, 0], measured[:, 0], commands[:, 1], measured[:, 1]])
    names = "t [s],command 1 [rad],measured 1 [rad],command 2 [rad],measured 2 [rad]"
    log, out = tmp_path / "log.csv", tmp_path / "found"
    np.savetxt(log, rows, delimiter=",", header=names, comments="", fmt="%.9f")
    done("identify", log, "--out", out)
    found = yaml.safe_load((out / "servo.yaml").read_text())["servo"]
    np.testing.assert_allclose(found["kp"], 25.0, rtol=0.02)
    np.testing.assert_allclose(found["kv"], 150.0, rtol=0.02)
    np.testing.assert_allclose(found["dead_time"], 0.02, atol=1e-3)
