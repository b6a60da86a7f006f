"""The command line as a user meets it: results, errors with their exit codes, start-up."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

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
        "compensated": {
            "timing": {"method": "mac"},
            "compensation": {"method": "pole_placement"},
        },
    },
}
Command = Callable[..., Any]


def test_runs_a_job(tmp_path: FilePath, command_in: Command) -> None:
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    command = [sys.executable, "-m", "armcontour", "run", "job.yaml", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "Report: file://" in done.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert set(summary["runs"]) == {"planned", "compensated"}
    for name in summary["files"]:
        assert (tmp_path / "out" / name).is_file()
    run = summary["runs"]["compensated"]
    assert run["contour_error"]["rms"] < summary["runs"]["planned"]["contour_error"]["rms"]
    assert run["corners"][0]["error"] == pytest.approx(2e-3)
    header, *rows = (tmp_path / "out" / "compensated" / "taught.csv").read_text().splitlines()
    assert header == "t [s],q 1 [rad],q 2 [rad]"
    table = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(np.diff(table[:, 0]), 4e-3, atol=1e-12)
    assert table[-1, 0] >= run["duration"]
    # Again without and with --force.
    refused = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert refused.code == 2
    assert "--force" in refused.errors
    assert (
        command_in(tmp_path, "run", "job.yaml", "--out", "out", "--no-simulation", "--force").code
        == 0
    )


def test_shapes_of_corners_from_the_command_line(tmp_path: FilePath, command_in: Command) -> None:
    runs = {**JOB["runs"], "fast": {}}  # type: ignore[dict-item]
    (tmp_path / "job.yaml").write_text(yaml.safe_dump({**JOB, "runs": runs}))
    free = ("--corner-shape", "free", "--iterations", "2")
    lines = ("--line-tolerance", "0.1 mm", "--zone", "8 mm")
    done = command_in(tmp_path, "run", "job.yaml", "--no-simulation", "--out", "out", *free, *lines)
    assert done.code == 0, done.errors
    assert re.search(r"Run fast: shaped: [\d.]+ s \(arcs [\d.]+ s, .*stops [\d.]+ s\)", done.out)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    shaping = summary["runs"]["fast"]["shaping"]
    assert "shaping" not in summary["runs"]["planned"]
    assert shaping["wanted"]["line_tolerance"] == pytest.approx(1e-4)
    assert shaping["wanted"]["zone"] == pytest.approx(8e-3)
    others = [x for name, x in shaping["durations"].items() if name != "shaped"]
    assert shaping["gain"] == 1 - shaping["durations"]["shaped"] / min(others) >= 0
    assert sum(shaping["starts"].values()) == 1 and shaping["iterations"] <= 2
    refused = command_in(tmp_path, "run", "job.yaml", "--out", "no", "--zone", "8 mm")
    assert refused.code == 2 and "corners.zone is for the shape free" in refused.errors


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"path": {"points": [[0.30, 0.20], [0.80, 0.20]]}}, 3, "out of reach"),
        ({"path": {"points": [[0.30, 0.20]]}}, 2, "at least two different points"),
        ({"limits": {"speed": "0.1"}}, 2, "has no unit"),
        ({"limits": {"speed": -0.1}}, 2, "above zero"),
        ({"corners": {"tolerance": "-1 mm"}}, 2, "must not be negative"),
        ({"colour": "red"}, 2, "unknown key colour"),
        ({"servo": {"kp": [1, 2, 3], "kv": 150}}, 2, "3 values"),
        (
            {
                "path": {"points": [[-0.065, 0.3], [0.335, 0.3]]},
                "limits": {"speed": 0.3},
            },
            4,
            "joint 2",
        ),
        ({"runs": {"a": {"timing": {"method": "magic"}}}}, 2, "runs.a.timing.method: must be"),
    ],
)
def test_an_error_is_one_sentence_with_its_code_and_leaves_nothing(
    tmp_path: FilePath, change: dict[str, object], code: int, words: str, command_in: Command
) -> None:
    (tmp_path / "job.yaml").write_text(yaml.safe_dump({**JOB, **change}))
    done = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert done.code == code
    assert words in done.errors
    assert done.errors.startswith("Error: ")
    assert len(done.errors.strip().splitlines()) == 1
    assert [x.name for x in tmp_path.iterdir()] == ["job.yaml"]


def test_an_unwritable_folder_is_refused_before_the_work(
    tmp_path: FilePath, command_in: Command
) -> None:
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    done = command_in(tmp_path, "run", "job.yaml", "--out", "job.yaml/out")
    assert done.code == 2
    assert "Cannot write to the folder" in done.errors


@pytest.mark.parametrize(
    ("number", "mend"),
    [
        (errno.EACCES, "Permission denied; name a place where you may write, or allow it."),
        (errno.ENOSPC, "No space left on device; free some space, or name another place."),
    ],
)
def test_a_refusal_of_the_system_says_what_mends_it(
    number: int, mend: str, tmp_path: FilePath, command_in: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = FilePath.mkdir

    def refuse(place: FilePath, *arguments: Any, **more: Any) -> None:
        if place.name.startswith(".armcontour-"):
            raise OSError(number, os.strerror(number))
        make(place, *arguments, **more)

    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    monkeypatch.setattr(FilePath, "mkdir", refuse)
    done = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert (done.code, done.errors) == (2, f"Error: Cannot write to the folder out: {mend}\n")


def test_an_experiment_has_its_columns_and_files(tmp_path: FilePath, command_in: Command) -> None:
    runs = {"one": {}, "two": {"compensation": {"method": "none"}}}
    job = {**JOB, "runs": runs, "experiment": {"runs": ["one"]}}
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    done = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert done.code == 0, done.errors
    assert "experiment" in done.out
    assert "Masses: Both links are assumed" in done.out
    files = json.loads((tmp_path / "out" / "summary.json").read_text())["files"]
    assert {"one/taught.csv", "one/planned.csv", "one/torque.csv"} <= set(files)
    header = (tmp_path / "out" / "one" / "torque.csv").read_text().splitlines()[0]
    assert header == "t [s],torque 1 [N m],torque 2 [N m]"


def test_a_failed_experiment_leaves_the_other_results(
    tmp_path: FilePath, command_in: Command
) -> None:
    job = {
        "name": "line",
        "arm": "panda",
        "path": {
            "points": [[0.4, 0, 0.3], [0.45, 0, 0.3]],
            "orientation": {"rpy": ["180 deg", 0, 0]},
        },
        "limits": {"speed": 0.25},
        "servo": {"kp": 25, "kv": 150},
        "experiment": {"step": "20 ms"},
        "runs": {"one": {}},
    }
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    done = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert done.code == 0, done.errors
    assert "Run one: experiment: Joint 2 is unstable" in done.out
    assert "failed" in done.out
    found = json.loads((tmp_path / "out" / "summary.json").read_text())["runs"]["one"]
    assert found["experiment"]["failed"].startswith("experiment: Joint 2 is unstable")
    assert found["contour_error"]["rms"] > 0
    assert (tmp_path / "out" / "one" / "taught.csv").is_file()


def test_tables_keep_their_units_and_coarse_set_points_are_said(
    tmp_path: FilePath, command_in: Command
) -> None:
    job = {**JOB, "title": "A [s] title", "command_interval": "0.5 s"}
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    done = command_in(tmp_path, "run", "job.yaml", "--out", "out")
    assert done.code == 0, done.errors
    for words in ("A [s] title", "motion [s]", "RMS error [mm]"):
        assert words in done.out
    warning = "the command interval of 0.5 s is more than a tenth of the motion"
    assert f"Warning: Runs compensated, planned: {warning}" in done.out
    found = json.loads((tmp_path / "out" / "summary.json").read_text())["runs"]["planned"]
    assert warning in found["warnings"][0]


def test_arms_are_listed_with_what_is_assumed(tmp_path: FilePath, command_in: Command) -> None:
    lines = command_in(tmp_path, "arms").out.splitlines()
    assert "ur5e: UR5e, 6 joints, masses known" in lines
    assert "panda: Panda, 7 joints, masses known" in lines
    assert any(x.startswith("    assumed: Both links are assumed") for x in lines)
    assert max(len(x) for x in lines) <= 100


def test_lists_arms_version_and_schema(tmp_path: FilePath, command_in: Command) -> None:
    assert "pmk3s: PMK-3s, 2 joints" in command_in(tmp_path, "arms").out
    assert command_in(tmp_path, "--version").out.startswith("armcontour 0.")
    assert json.loads(command_in(tmp_path, "schema").out)["title"] == "JobModel"


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"]])
def test_help_imports_nothing_heavy(arguments: list[str], tmp_path: FilePath) -> None:
    code = (
        "import sys\n"
        f"sys.argv = ['armcontour', *{arguments!r}]\n"
        "from armcontour.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'plotly', 'pint', 'yaml', 'jinja2'}\n"
        "sys.exit(len(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60)
    assert done.returncode == 0


def test_identify_tells_gains_from_a_log(tmp_path: FilePath, command_in: Command) -> None:
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    line = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)])
    planned = ac.plan(line, arm, arm.limits.replace(speed=0.1))
    t = np.arange(0.0, 10.0, 2e-3)
    waves = np.arange(0.5, 20.0, 0.5)
    shaken = np.sin(2 * np.pi * np.outer(t, waves) + waves**2).sum(axis=1)
    commands = planned(0.0) + 1e-4 * np.column_stack([shaken, -shaken])
    taught = ac.TaughtData(period=2e-3, q=commands, trajectory=planned, method="none")
    done = ac.execute(taught, ac.ServoPlant(arm, servo, ac.Limits()), resolution=2e-3)
    noise = 1e-6 * np.random.default_rng(1).normal(size=commands.shape)
    measured = done.q[: len(t)] + noise
    rows = np.column_stack([t, commands[:, 0], measured[:, 0], commands[:, 1], measured[:, 1]])
    names = "t [s],command 1 [rad],measured 1 [rad],command 2 [rad],measured 2 [rad]"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="", fmt="%.9f")
    result = command_in(tmp_path, "identify", "log.csv", "--out", "found")
    assert result.code == 0, result.errors
    text = (tmp_path / "found" / "servo.yaml").read_text()
    found = yaml.safe_load(text)["servo"]
    np.testing.assert_allclose(found["kp"], 25.0, rtol=0.02)
    np.testing.assert_allclose(found["kv"], 150.0, rtol=0.02)
    np.testing.assert_allclose(found["dead_time"], 0.02, atol=1e-3)
