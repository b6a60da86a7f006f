"""The command line: runs, options, help, signals, cells, and errors with their exit codes."""

import json
import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml
from tests.cli.helpers import summary
from tests.dynamics_extra import mark_all_but
from typer.testing import CliRunner

import armcontour as ac
from armcontour.cli.commands import program_for
from armcontour.cli.inputs import read_option
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import Speed, Time
from armcontour.files.job_file import cell_names

JOB = {
    "name": "bracket",
    "arm": "pmk3s",
    "path": {"points": [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]},
    "limits": {"speed": "0.10 m/s", "centripetal_acceleration": "0.09 m/s^2"},
    "corners": {"tolerance": "2 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "planned": {"timing": {"method": "paper"}, "compensation": {"method": "none"}},
        "compensated": {
            "timing": {"method": "paper"},
            "compensation": {"method": "pole_placement"},
        },
    },
}
ROBOT = {
    **{"name": "line", "arm": "panda", "limits": {"speed": 0.25}, "servo": JOB["servo"]},
    "path": {"points": [[0.4, 0, 0.3], [0.45, 0, 0.3]], "orientation": {"rpy": ["180 deg", 0, 0]}},
    **{"experiment": {"step": "20 ms"}, "runs": {"one": {}}},
}


@pytest.fixture
def run(tmp_path, command, monkeypatch):
    """Run a job in a folder: the output, and the summary."""
    monkeypatch.chdir(tmp_path)

    def call(job, *options, code=0):
        FilePath("job.yaml").write_text(yaml.safe_dump(job))
        ended = command("run", "job.yaml", "--out", "out", *options)
        assert ended.code == code, ended
        return ended.out, summary(tmp_path / "out")

    return call


def test_run_writes_a_report_and_the_listed_files(tmp_path, run, refused):
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    # Only this run starts a separate process.
    command = [sys.executable, "-m", "armcontour", "run", "job.yaml", "--out", "out"]
    outcome = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stderr
    assert "Report: file://" in outcome.stdout
    result = summary(tmp_path / "out")
    assert set(result["runs"]) == {"planned", "compensated"}
    for name in result["files"]:
        assert (tmp_path / "out" / name).is_file()
    planned = result["runs"]["planned"]
    compensated = result["runs"]["compensated"]
    assert compensated["contour_error"]["rms"] < planned["contour_error"]["rms"]
    assert compensated["corners"][0]["error"] == pytest.approx(2e-3)
    header, *rows = (tmp_path / "out" / "compensated" / "set_points.csv").read_text().splitlines()
    assert header == "t [s],q 1 [rad],q 2 [rad]"
    table = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(np.diff(table[:, 0]), 4e-3, atol=1e-12)
    assert table[-1, 0] >= compensated["duration"]
    assert refused(tmp_path, [("run job.yaml --out out", ["--force"])], codes=(2,)) == []
    run(JOB, "--no-simulation", "--force")


def test_an_option_sets_any_key_of_the_job(tmp_path, run, refused):
    sets = ("corners.tolerance=1 mm", "runs.compensated.timing={method: optimal}", "title=A, B")
    _, result = run(JOB, "--no-simulation", *(x for text in sets for x in ("--set", text)))
    assert result["title"] == "A, B"
    assert result["runs"]["compensated"]["timing"] == "optimal"
    assert result["runs"]["planned"]["corners"][0]["error"] == pytest.approx(1e-3)
    for options, words in (
        (
            ("--set", "limits.sped=1"),
            ["--set: job.yaml: unknown key limits.sped: did you mean spe"],
        ),
        (("--set", "units=mm"), ["--set: job.yaml: unknown key units: did you mean path.units?"]),
        (("--set", "limits.speed=1 mm"), ["--set: job.yaml: limits.speed: must be", "m/s"]),
        (("--tolerance", "1 s"), ["--tolerance: job.yaml: corners.tolerance: must be"]),
        (("--set", "limits.speed=1", "--speed", "1 m/s"), ["--speed and --set limits.speed"]),
        (("--set", "limits.speed"), ["--set: 'limits.speed' sets no key. Write KEY=VALUE"]),
        (("--set", "runs.plan.end_time=1"), ["--set: job.yaml: runs.plan.end_time names no run"]),
        # The tolerance is not what is wrong.
        (
            ("--set", "path.points=[[1, 2]]", "--tolerance", "1 mm"),
            ["--set: job.yaml: path.points"],
        ),
    ):
        begin = ("run", "job.yaml", "--out", "no")
        assert refused(tmp_path, [(options, words)], codes=(2,), begin=begin) == []


def test_an_error_has_its_exit_code_and_writes_nothing(tmp_path, refused):
    far = {"path": {"points": [[-0.065, 0.3], [0.335, 0.3]]}, "limits": {"speed": 0.3}}
    for change, code, words in (
        ({"path": {"points": [[0.30, 0.20], [0.80, 0.20]]}}, 3, "out of reach"),
        ({"path": {"points": [[0.30, 0.20]]}}, 2, "at least two different points"),
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


def test_an_experiment_adds_columns_and_files(tmp_path, run):
    runs = {"one": {}, "two": {"compensation": {"method": "none"}}}
    shown, result = run({**JOB, "runs": runs, "experiment": {}})
    assert "experiment" in shown and "Masses: Both links are assumed" in shown
    assert {"one/set_points.csv", "one/planned.csv", "one/torque.csv"} <= set(result["files"])
    header = (tmp_path / "out" / "one" / "torque.csv").read_text().splitlines()[0]
    assert header == "t [s],torque 1 [N m],torque 2 [N m]"
    # A failed experiment leaves the other results, but the run is not kept.
    shown, result = run(ROBOT, "--force", code=1)
    assert result["runs"]["one"]["kept"] is False
    assert "experiment: Joint 2 is unstable" in shown
    one = result["runs"]["one"]
    assert one["experiment"]["failed"].startswith("experiment: Joint 2 is unstable")
    assert one["contour_error"]["rms"] > 0
    assert (tmp_path / "out" / "one" / "set_points.csv").is_file()


def test_the_exit_code_is_1_if_no_run_is_kept(tmp_path, run):
    job = {**JOB, "corners": {"tolerance": 3e-4}, "experiment": {}}
    late = {"compensation": {"method": "inverse"}}
    shown, result = run({**job, "runs": {"one": late}}, code=1)
    assert result["runs"]["one"]["kept"] is False and "NOT KEPT" in shown
    shown, result = run({**job, "runs": {"one": late, "two": {}}}, "--force")
    assert result["runs"]["two"]["kept"] is True and result["runs"]["one"]["kept"] is False
    assert "rigid bodies" in shown and "servo" in shown


def test_an_option_with_one_value_can_be_given_only_once(tmp_path, refused):
    calls = {
        "--set-points": "learn job.yaml --set-points a --set-points b --log a.csv",
        "--limits": "check a.csv --limits a.yaml --arm ur5e --limits b.yaml",
        "--out": "run job.yaml -o a --out b",
    }
    rows = [(x, [f"{y} has one value, but is specified 2 times"]) for y, x in calls.items()]
    assert refused(tmp_path, rows, codes=(2,)) == []


def test_commands_list_arms_version_and_schema(done):
    lines = done("arms").splitlines()
    for words in ("pmk3s: PMK-3s, 2 joints", "ur5e: UR5e, 6 joints", "panda: Panda, 7 joints"):
        assert any(x.startswith(words) for x in lines), words
    assert any(x.startswith("    assumed: Both links are assumed") for x in lines)
    assert done("--version").startswith("armcontour 0.")
    assert json.loads(done("schema"))["title"] == "JobModel"


def test_identify_finds_gains_in_a_log(tmp_path, command):
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    line = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)])
    planned = ac.plan(line, arm, arm.limits.replace(speed=0.1))
    t = np.arange(0.0, 10.0, 2e-3)
    waves = np.arange(0.5, 20.0, 0.5)
    shaken = np.sin(2 * np.pi * np.outer(t, waves) + waves**2).sum(axis=1)
    commands = planned(0.0) + 1e-4 * np.column_stack([shaken, -shaken])
    set_points = ac.SetPoints(cycle=2e-3, q=commands, trajectory=planned, method="none")
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo, ac.Limits()), resolution=2e-3)
    noise = 1e-6 * np.random.default_rng(1).normal(size=commands.shape)
    measured = executed.q[: len(t)] + noise
    rows = np.column_stack([t, commands[:, 0], measured[:, 0], commands[:, 1], measured[:, 1]])
    names = "t [s],command 1 [rad],measured 1 [rad],command 2 [rad],measured 2 [rad]"
    log = tmp_path / "log.csv"
    out = tmp_path / "found"
    np.savetxt(log, rows, delimiter=",", header=names, comments="", fmt="%.9f")
    # One program only.
    assert command("identify", log, "--out", out).code == 9
    fit = yaml.safe_load((out / "servo.yaml").read_text())["servo"]
    np.testing.assert_allclose(fit["kp"], 25.0, rtol=0.02)
    np.testing.assert_allclose(fit["kv"], 150.0, rtol=0.02)
    np.testing.assert_allclose(fit["dead_time"], 0.02, atol=1e-3)


def test_a_quantity_has_a_unit_unless_it_is_zero():
    assert read_option("--speed", None, Speed) is None
    assert read_option("--speed", "0e3", Time) == 0.0
    assert read_option("--speed", " 50 mm/s ", Speed) == 0.05


# A plate of 30 x 20 mm with its corner cut; millimetres, the pen down at z = 0.
DRAWING = "G21 G90 F1500\nG0 X5 Y5\nG1 X30 Y5\nG1 X30 Y20\nG1 X5 Y12\n"


def call(*arguments):
    outcome = CliRunner().invoke(program_for(), arguments)
    assert outcome.exception is None or isinstance(outcome.exception, InvalidInput | SystemExit)
    message = outcome.output if outcome.exit_code == 0 else str(outcome.exception)
    return outcome.exit_code, " ".join(message.split())


@pytest.mark.parametrize("cell", mark_all_but(cell_names(), ["pmk3s"]))
def test_a_cell_written_by_the_command_runs_a_drawing(cell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, message = call("init", cell)
    assert code == 0 and f"--cell {cell}.yaml" in message
    text = (tmp_path / f"{cell}.yaml").read_text()
    assert f": {cell.removesuffix('_positioner')}\n" in text and text.count("#") > 5
    (tmp_path / "plate.ngc").write_text(DRAWING)
    line = ("run", "plate.ngc", "--cell", f"{cell}.yaml", "--out", "out", "--no-simulation")
    assert call(*line, "--scale", "0.5")[0] == 0
    run = json.loads((tmp_path / "out" / "summary.json").read_text())["runs"]["compensated"]
    assert 0 < run["duration"] < 10
