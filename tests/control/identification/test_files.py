"""Log files, and the files of an identification: servo, JSON, report, table."""

import json
import math
from dataclasses import fields
from functools import partial
from itertools import product

import numpy as np
import pytest
import yaml
from soak.identification import move, multisine
from tests.files.tables import parse_log

from armcontour.cli.command_execution import execute
from armcontour.cli.commands import Identify
from armcontour.cli.identify_command import identify as identify_logs
from armcontour.control.identification import Log, identify
from armcontour.core.errors import InvalidInput
from armcontour.core.render import plain
from armcontour.files.limits_and_servo_files import read_servo, servo_yaml
from armcontour.files.log_file import log_text, read_log
from armcontour.files.result_folder import to_json
from armcontour.report.identification import render_identification

ROWS = "\n" + "\n".join(f"{i},{i * 0.1:.6f},{i * 0.1 - 0.05:.6f}" for i in range(60)) + "\n"


COMMANDS = ("u1", "u_1", "command 1", "command_1")
MEASURED = ("q1", "q_1", "measured 1", "joint 1")
HEADERS = (
    *(f"t,{u},{q}" for u, q in product(COMMANDS, MEASURED)),
    *(f"Time (s),{u} [rad],{q} [rad]" for u, q in product(COMMANDS, MEASURED)),
)
NAMED = (
    ("timestamp,target_q_0,actual_q_0,target_qd_0,actual_qd_0,actual_TCP_pose_0", "joint 0"),
    ("t,command shoulder,measured shoulder", "shoulder"),
    ("t,command elbow [rad],q elbow [rad]", "elbow"),
)


def test_columns_are_recognized_by_their_names():
    for header, joint in (*((x, "joint 1") for x in HEADERS), *NAMED):
        others = header.count(",") - 2
        log = parse_log(header + ROWS.replace("\n", ",7" * others + "\n")[2 * others :])
        assert log.joint_names == (joint,), header
        expected = np.arange(60) * 0.1
        np.testing.assert_allclose(log.command[:, 0], expected, atol=1e-9, err_msg=header)
        np.testing.assert_allclose(log.measured[:, 0], expected - 0.05, atol=1e-9, err_msg=header)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_logs_with_units_comments_and_other_columns_are_read(separator):
    rows = "\n".join(f"{i * 4},9,{90 + i},{45},{i},{i},{7}" for i in range(60))
    text = (
        "# from a controller\n# interpolation: step\n"
        "t [ms],torque1,q2 [deg],q1 [deg],u1 [deg],u2 [deg],dq1\n" + rows
    )
    log = parse_log(text.replace(",", separator), start=0.01, end=0.23)
    assert log.interpolation == "step" and log.joint_names == ("joint 1", "joint 2")
    assert log.t[0] == pytest.approx(0.012)
    np.testing.assert_allclose(log.measured[:, 0], np.pi / 4)
    np.testing.assert_allclose(np.degrees(log.measured[0, 1]), 93)


def numbers(row, count=60):
    """A log whose rows are made of their numbers."""
    return "t,u1,q1\n" + "\n".join(row(i) for i in range(count))


# Text of a log, and the words of its refusal.
WRONG = (
    ("", {}, "is empty"),
    ("u1,q1" + ROWS, {}, "column t is missing"),
    ("t,speed,torque" + ROWS, {}, "no column is a command"),
    ("t,u1,q2" + ROWS, {}, "no measured column"),
    ("t,u1,command 1" + ROWS, {}, "'u1' and 'command 1'"),
    ("t,u1 [m],q1 [deg]" + ROWS, {}, "unit 'deg', but another column"),
    ("t,u1,q1\n0,1,x\n", {}, "line 2"),
    ("t,u1,q1\n0,1,1\n", {}, "1 samples"),
    (numbers(lambda i: f"{i},1,1_0"), {}, "'1_0'"),
    (numbers(lambda i: f"{i},1,"), {}, "''"),
    (numbers(lambda i: f"{i},1,{'1' * 140_000}", 2), {}, "'1111"),
    (numbers(lambda i: "1,1,1"), {}, "times must increase"),
    (numbers(lambda i: f"{i}e-12,1,1"), {}, "at least 1 ns"),
    (numbers(lambda i: f"{i * 15e9},1,1"), {}, "within 1e+10 s"),
    (numbers(lambda i: f"{i},1,{i}e9"), {}, "10000 rad"),
    ("t,u1,q1" + ROWS, {"start": math.nan}, "first time of log.csv must be a number"),
    ("t,u1,q1" + ROWS, {"end": math.nan}, "last time of log.csv must be a number"),
    ("t,u1,q1" + ROWS, {"start": 1e308}, "no sample from 1e+308 s to inf s"),
    ("t,u1,q1" + ROWS, {"end": -5.0}, "no sample from -inf s to -5 s"),
    ("t,u1,q1" + ROWS, {"start": 3.0, "end": 2.0}, "no sample from 3 s to 2 s"),
)


def test_invalid_logs_and_options_are_refused(refuses, tmp_path):
    for text, fit_options, words in WRONG:
        refuses(partial(parse_log, text, **fit_options), InvalidInput, words)
    refuses(lambda: read_log(tmp_path / "no.csv"), InvalidInput, "no.csv")
    file = tmp_path / "l.csv"
    for options, words in (
        ({"start": "2"}, "--from requires a unit"),
        ({"end": "3"}, "--to requires a unit"),
        ({"drive_cycle": "0.5"}, "--drive-cycle requires a unit"),
        ({"start": "2 rad"}, "--from: must be a quantity in s"),
        ({"force": True}, "--out"),
    ):
        refuses(
            partial(execute, identify_logs, Identify(logs=[file], **options)),
            InvalidInput,
            words,
        )


def test_joints_that_rest_get_the_gains_of_an_assumed_servo(log, tmp_path):
    resting = np.full(len(log.t), 0.3)
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(log.t))
    both = Log(
        t=log.t,
        command=np.column_stack([log.command[:, 0], resting]),
        measured=np.column_stack([log.measured[:, 0], resting + noise]),
        joint_names=("a", "b"),
    )
    file = tmp_path / "l.csv"
    file.write_text(log_text(both))
    job = tmp_path / "assumed.yaml"
    job.write_text("servo: {kp: 31 1/s, kv: 131 1/s}")
    # The exit code 9 means that the servo is trusted, but judged on one program.
    for assumed, order, code in ((None, "unknown", 1), (job, "second", 9)):
        out = tmp_path / order
        assert execute(identify_logs, Identify(logs=[file], assumed=assumed, out=out)) == code
        servo = read_servo(out / "servo.yaml", 2).for_joints(2)
        orders = (servo.order,) * 2 if isinstance(servo.order, str) else servo.order
        assert orders == ("second", order)
        assert servo.kp[0] == pytest.approx(25.0, rel=0.02)
        assert servo.kp[1] == (31.0 if assumed else np.inf)


@pytest.fixture(scope="module")
def log():
    t = np.arange(2000) * 2e-3
    u = np.column_stack([5e-3 * multisine(t, 25.0, seed) for seed in (1, 2)])
    u[1000:1600, 1] += 0.2  # a step into saturation
    q = np.column_stack(
        [
            move(t, u[:, 0].copy(), kp=25.0, kv=150.0, delay=12.3e-3),
            move(t, u[:, 1].copy(), kp=40.0, kv=100.0, delay=4e-3, limit=20.0, steps=100),
        ]
    )
    y = q + 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    return Log(t=t, command=u, measured=y, joint_names=("a <b>", "elbow"), source="l.csv")


@pytest.fixture(scope="module")
def identification(log):
    return identify(log)


def test_the_servo_file_contains_the_judged_servo(identification, tmp_path):
    file = tmp_path / "servo.yaml"
    file.write_text(servo_yaml(identification))
    assert "one program only" in file.read_text()
    data = yaml.safe_load(file.read_text())
    assert list(data) == ["servo"] and data["servo"]["order"] == ["second", "second"]
    assert data["servo"]["acceleration_limit"][0] == "none"
    read = read_servo(file, 2)
    judged = identification.servo_model().for_joints(2)
    for x in fields(read):
        np.testing.assert_array_equal(getattr(read, x.name), getattr(judged, x.name), x.name)
    np.testing.assert_allclose(read.kp, [25, 40], rtol=0.01)
    np.testing.assert_allclose(read.dead_time, [12.3e-3, 4e-3], atol=3e-4)
    assert read.acceleration_limit[1] == pytest.approx(20, rel=0.01)
    assert all(
        x.model_error <= y for x, y in zip(identification.joints, read.model_error, strict=True)
    )


def test_json_and_report_contain_the_identified_parameters(identification):
    data = json.loads(to_json(plain(identification.to_data())))
    first, second = data["joints"]
    assert [x["name"] for x in first["parameters"]] == ["kp", "kv", "dead_time"]
    assert second["parameters"][-1]["value"] == pytest.approx(20, rel=0.05)
    assert first["rms"] == identification.joints[0].rms and first["written"] is True
    page = render_identification(identification)
    assert "a &lt;b&gt;" in page and "<b>" not in page.split("</style>")[0]
    assert "http-equiv" not in page and 'src="http' not in page


def _write(file, t, u, q, names):
    table = np.column_stack([t, u, q])
    np.savetxt(file, table, delimiter=",", fmt="%.7f", header=names, comments="")


def test_identify_writes_servo_report_and_summary(log, tmp_path, capsys):
    file = tmp_path / "log.csv"
    out = tmp_path / "out"
    _write(file, log.t, log.command[:, 0], log.measured[:, 0], "t,u1,q1")
    assert execute(identify_logs, Identify(logs=[file], out=out, validate=[file])) == 9
    printed = capsys.readouterr().out
    assert "Prediction of log.csv" in printed and "judged on only one program" in printed
    written = {"servo.yaml", "report.html", "summary.json"}
    assert {x.name for x in out.iterdir()} == {*written, ".armcontour.json"}
    part = Identify(
        logs=[file, file],
        as_json=True,
        validate=[file],
        start="0 s",
        end="2000 ms",
        drive_cycle="2 ms",
    )
    # The same program again is one program.
    assert execute(identify_logs, part) == 9
    data = json.loads(capsys.readouterr().out)
    assert data["samples"] == 2 * 1001 and data["drive_cycle"] == 2e-3
    (prediction,) = data["predictions"]
    assert prediction["log"] == "log.csv"
    assert prediction["rms"][0] < 0.1 * prediction["tracking_rms"][0]


def test_identify_writes_no_servo_file_without_a_model(tmp_path, capsys, refuses):
    t = np.arange(2000) * 1e-3
    u = 0.02 * t
    y = move(t, u, kp=25.0, kv=150.0) + 1e-4 * np.random.default_rng(0).normal(size=2000)
    file = tmp_path / "log.csv"
    out = tmp_path / "out"
    _write(file, t, u, y, "t,u1,q1")
    assert execute(identify_logs, Identify(logs=[file], out=out)) == 1
    assert "the velocity is uniform" in capsys.readouterr().out
    assert {x.name for x in out.iterdir()} == {"report.html", "summary.json", ".armcontour.json"}
    refuses(lambda: execute(identify_logs, Identify(logs=[file], out=out)), InvalidInput, "--force")
