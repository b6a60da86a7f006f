"""Logs from files, and what is written of an identification: servo file, JSON, report, table."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import yaml
from soak.identify import multisine
from soak.joint import move

from armcontour.cli.identifying import identify_files
from armcontour.cli.options import IdentifyOptions
from armcontour.errors import InvalidInput
from armcontour.identification import Log, identify
from armcontour.io.log_file import parse_log, read_log
from armcontour.io.servo_file import identification_json, servo_yaml
from armcontour.report.identification import render_identification

ROWS = "\n" + "\n".join(f"{i},{i * 0.1:.6f},{i * 0.1 - 0.05:.6f}" for i in range(60)) + "\n"


# The names in the table of docs/guides/identify.md.
COMMANDS = ("u1", "command 1", "q1_cmd", "setpoint 1", "target 1")
MEASURED = (
    *("q1", "measured 1", "q1_actual", "q1_measured", "q1_meas", "q1_feedback"),
    *("feedback 1", "actual 1", "joint 1"),
)


@pytest.mark.parametrize(
    ("header", "joint"),
    [
        ("t,u1,q1", "joint 1"),
        ("t [s],command 1 [rad],measured 1 [rad]", "joint 1"),
        ("time,q1_cmd,q1", "joint 1"),
        ("t_s,command1_rad,q1_rad", "joint 1"),
        ("Time (s), Joint 1 command, Joint 1 actual", "joint 1"),
        ("t,q_cmd_2,q_2", "joint 2"),
        # The guide's names, each with each.
        *((f"t,{u},{q}", "joint 1") for u in COMMANDS for q in MEASURED),
        *((f"t,{u} [rad],{q} [rad]", "joint 1") for u in COMMANDS for q in MEASURED),
        *((f"t [s],{u}_rad,{q}_rad", "joint 1") for u in COMMANDS[2:3] for q in MEASURED[2:6]),
        # As UR's real-time interface writes them.
        (
            "timestamp,target_q_0,actual_q_0,target_qd_0,actual_qd_0,actual_TCP_pose_0",
            "joint 0",
        ),
        ("t,shoulder command,shoulder measured", "shoulder"),
        ("t,cmd_lwr_joint_3,meas_lwr_joint_3", "lwr_joint_3"),
        ("timestamp,setpoint elbow [rad],feedback elbow [rad]", "elbow"),
        # What this package writes of joints, and what it wrote.
        ("t [s],command 1 [rad],q 1 [rad]", "joint 1"),
        ("t [s],command 1 [rad],joint 1 [rad]", "joint 1"),
    ],
)
def test_names_of_columns(header, joint):
    others = header.count(",") - 2
    log = parse_log(header + ROWS.replace("\n", ",7" * others + "\n")[2 * others :])
    assert log.joint_names == (joint,)
    np.testing.assert_allclose(log.command[:, 0], np.arange(60) * 0.1, atol=1e-9)
    np.testing.assert_allclose(log.measured[:, 0], np.arange(60) * 0.1 - 0.05, atol=1e-9)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_units_order_comments_and_columns_that_are_not_needed(separator):
    rows = "\n".join(f"{i * 4},9,{90 + i},{45},{i},{i},{7}" for i in range(60))
    text = (
        "# from a controller\n# interpolation: step\n"
        "t [ms],torque1,q2 [deg],q1_deg,u1 [deg],u2 [deg],dq1\n" + rows
    )
    log = parse_log(text.replace(",", separator), start=0.01, end=0.23)
    assert log.interpolation == "step"
    assert log.joint_names == ("joint 1", "joint 2")
    assert log.t[0] == pytest.approx(0.012)
    np.testing.assert_allclose(log.measured[:, 0], np.pi / 4)
    np.testing.assert_allclose(np.degrees(log.measured[0, 1]), 93)


def test_cells_may_be_separated_by_blanks():
    # As the recorder of a UR's RTDE writes its logs.
    log = parse_log(("t,u1,q1" + ROWS).replace(",", "  "))
    np.testing.assert_array_equal(log.command, parse_log("t,u1,q1" + ROWS).command)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is empty"]),
        ("u1,q1" + ROWS, ["column t is missing"]),
        ("t,speed,torque" + ROWS, ["no command", "t,u1,q1"]),
        ("t,u1,q2" + ROWS, ["'u1'", "no measured column", "q1"]),
        ("t,u1,command 1" + ROWS, ["'u1' and 'command 1'", "same"]),
        ("t,u1 [m],q1" + ROWS, ["unit 'm'", "not one that converts to rad"]),
        ("t,u1,q1\n0,1,x\n", ["line 2", "'x'", "finite"]),
        ("t,u1,q1\n0,1,1\n", ["1 samples"]),
    ],
)
def test_refusals(refuses, text, words):
    refuses(lambda: parse_log(text, source="a.csv"), InvalidInput, "a.csv", *words)


def test_columns_that_are_not_needed_may_hold_anything():
    rows = "\n".join(f"{i},{i * 0.1},{i * 0.1},ready,,nan" for i in range(60))
    assert len(parse_log("t,u1,q1,state,load,current\n" + rows).t) == 60


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([f"{i},1,1_0" for i in range(60)], ["line 2", "'1_0'", "'q1'"]),
        ([f"{i},1," for i in range(60)], ["line 2", "''", "'q1'"]),
        ([f"{i},1,{'1' * 140_000}" for i in range(2)], ["line 2", "'1111", "'q1'"]),
        (["1,1,1"] * 60, ["times must increase", "sample 2"]),
        ([f"{i}e-12,1,1" for i in range(60)], ["at least 1 ns", "sample 2"]),
        ([f"{i * 15e9},1,1" for i in range(60)], ["sample 2", "within 1e+10 s"]),
        ([f"{i},1,{i}e9" for i in range(60)], ["measured position of joint 1", "10000 rad"]),
    ],
)
def test_hostile_numbers(refuses, rows, words):
    text = "t,u1,q1\n" + "\n".join(rows)
    refuses(lambda: parse_log(text, source="a.csv"), InvalidInput, "a.csv", *words)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"start": math.nan}, "first time to use must be a number"),
        ({"end": math.nan}, "last time to use must be a number"),
        ({"start": 1e308}, "no sample from 1e+308 s to inf s: its times go from 0 s to 59 s"),
        ({"end": -5.0}, "no sample from -inf s to -5 s"),
        ({"start": 3.0, "end": 2.0}, "no sample from 3 s to 2 s"),
    ],
)
def test_parts_of_a_log_that_are_none(refuses, given, words):
    refuses(lambda: parse_log("t,u1,q1" + ROWS, **given), InvalidInput, words)


def test_units_of_the_documented_names():
    rows = "".join(f"{i},{i},{i + 1}\n" for i in range(60))
    log = parse_log("t [s];q1_cmd [deg];q1_actual [deg]\n".replace(";", ",") + rows)
    np.testing.assert_allclose(np.degrees(log.command[:, 0]), np.arange(60))
    np.testing.assert_allclose(np.degrees(log.measured[:, 0]), np.arange(60) + 1)
    log = parse_log("t,q1_cmd_deg,q1_actual_deg\n" + rows)
    np.testing.assert_allclose(np.degrees(log.measured[:, 0]), np.arange(60) + 1)


def test_columns_are_named_beside_the_file(refuses):
    rows = "".join(f"{4 * i},x,{i},{i + 1}\n" for i in range(60))
    log = parse_log(rows, columns="t [ms],-,u1 [deg],q1 [deg]")
    np.testing.assert_allclose(log.t, np.arange(60) * 4e-3)
    np.testing.assert_allclose(np.degrees(log.measured[:, 0]), np.arange(60) + 1)
    refuses(lambda: parse_log(rows, columns="t,u1"), InvalidInput, "line 1", "names of 2 are given")
    refuses(lambda: parse_log("1,2,3\n" * 60), InvalidInput, "name them with --columns")


def test_a_file_that_is_not_there(refuses, tmp_path):
    refuses(lambda: read_log(tmp_path / "no.csv"), InvalidInput, "There is no log", "no.csv")


@pytest.fixture(scope="module")
def log():
    t = np.arange(5000) * 1e-3
    u = np.column_stack([3e-3 * multisine(t, 25.0, seed) for seed in (1, 2)])
    u[1000:1600, 1] += 0.2  # a step into saturation
    q = np.column_stack(
        [
            move(t, u[:, 0].copy(), kp=25.0, kv=150.0, delay=12.3e-3),
            move(t, u[:, 1].copy(), kp=40.0, kv=100.0, delay=4e-3, limit=20.0, steps=100),
        ]
    )
    y = q + 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    return Log(t=t, command=u, measured=y, joint_names=("a <b>", "elbow"), source="l.csv")


@pytest.fixture(scope="module")
def found(log):
    return identify(log)


def test_the_servo_file_is_what_a_job_takes(found):
    text = servo_yaml(found)
    data = yaml.safe_load(text)
    assert data["servo"]["order"] == "second"
    assert data["servo"]["interpolation"] == "linear"
    np.testing.assert_allclose(data["servo"]["kp"], [25, 40], rtol=0.02)
    np.testing.assert_allclose(data["servo"]["dead_time"], [12.3e-3, 4e-3], atol=1e-3)
    assert "limits" not in data  # that of the first joint is not known
    assert "does not show the limit" in text


def test_json_has_no_infinities(found):
    data = json.loads(identification_json(found, files=["summary.json"]))
    first, second = data["joints"]
    assert data["determined"] is True
    assert first["parameters"][3]["value"] is None
    assert first["parameters"][3]["high"] is None
    assert second["parameters"][3]["value"] == pytest.approx(20, rel=0.05)
    assert second["parameters"][3]["determined"] is True


def test_the_report_stands_alone(found):
    page = render_identification(found)
    assert "a &lt;b&gt;" in page
    assert "<b>" not in page.split("</style>")[0]
    assert "http-equiv" not in page
    assert 'src="http' not in page
    for words in ("command, measured and simulated", "spectrum of the residuals", "95 % interval"):
        assert words in page


def _write(log, file):
    table = np.column_stack([log.t, log.command, log.measured])
    names = "t,u1,u2,q1,q2"
    np.savetxt(file, table, delimiter=",", fmt="%.7f", header=names, comments="")


def test_the_command(log, tmp_path, capsys):
    file, out = tmp_path / "log.csv", tmp_path / "out"
    _write(log, file)
    assert identify_files([file], IdentifyOptions(out=out, predict=[file], details=True))
    printed = capsys.readouterr().out
    assert "dead time" in printed and "Prediction of log.csv" in printed
    assert "joint 1, acceleration: The log does not show the limit" in printed
    written = {"servo.yaml", "report.html", "summary.json"}
    assert {x.name for x in out.iterdir()} == {*written, ".armcontour.json"}
    assert identify_files([file], IdentifyOptions(as_json=True, start="0 s", end="3000 ms"))
    assert json.loads(capsys.readouterr().out)["samples"] == 3001
    assert identify_files([file, file], IdentifyOptions(as_json=True, predict=[file]))
    data = json.loads(capsys.readouterr().out)
    assert data["samples"] == 2 * len(read_log(file).t)
    (prediction,) = data["predictions"]
    assert prediction["log"] == "log.csv" and min(prediction["explained"]) > 0.9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"start": "2"}, ["--from: '2' has no unit", "'2 s'"]),
        ({"end": "3"}, ["--to: '3' has no unit"]),
        ({"longest_dead_time": "0.5"}, ["--longest-dead-time: '0.5' has no unit"]),
        ({"longest_dead_time": "0"}, ["--longest-dead-time: must be above zero"]),
        ({"start": "2 rad"}, ["--from: must be a quantity in s"]),
    ],
)
def test_times_on_the_command_line_have_units(tmp_path, refuses, options, words):
    refuses(
        lambda: identify_files([tmp_path / "l.csv"], IdentifyOptions(**options)),
        InvalidInput,
        *words,
    )


def test_the_command_where_the_servo_is_not_determined(tmp_path, capsys, refuses):
    t = np.arange(2000) * 1e-3
    u = 0.02 * t
    y = move(t, u, kp=25.0, kv=150.0) + 1e-4 * np.random.default_rng(0).normal(size=2000)
    file, out = tmp_path / "log.csv", tmp_path / "out"
    table = np.column_stack([t, u, y])
    np.savetxt(file, table, delimiter=",", fmt="%.7f", header="t,u1,q1", comments="")
    assert not identify_files([file], IdentifyOptions(out=out))
    assert "There is no servo model: log.csv does not determine" in capsys.readouterr().out
    assert {x.name for x in out.iterdir()} == {"report.html", "summary.json", ".armcontour.json"}
    refuses(
        lambda: identify_files([file], IdentifyOptions(open_report=True)), InvalidInput, "--out"
    )
    refuses(
        lambda: identify_files([file], IdentifyOptions(out=out)),
        InvalidInput,
        "not empty",
        "--force",
    )
