"""Xacro files on the command line: refused without `--trust-xacro`, in every command."""

import shutil

import pytest
import yaml
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.core.errors import InvalidInput

pytest.importorskip("xacro")

# Six joints in a row, each one macro.
TURNS = (("0 0 1", "0 0 0"), ("0 1 0", "0 0 0.4"), ("0 1 0", "0 0 0.4"))
TURNS += (("1 0 0", "0.2 0 0"), ("0 1 0", "0.2 0 0"), ("1 0 0", "0.1 0 0"))
XACRO = (
    '<robot name="six" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    '<xacro:macro name="turn" params="n axis xyz"><link name="l${n}"/>'
    '<joint name="j${n}" type="revolute"><parent link="l${n - 1}"/><child link="l${n}"/>'
    '<origin xyz="${xyz}"/><axis xyz="${axis}"/>'
    '<limit lower="${-pi}" upper="${pi}" velocity="3" effort="9"/></joint></xacro:macro>'
    '<link name="l0"/>'
    + "".join(f'<xacro:turn n="{k}" axis="{a}" xyz="{p}"/>' for k, (a, p) in enumerate(TURNS, 1))
    + '<link name="tool"/><joint name="end" type="fixed"><parent link="l6"/><child link="tool"/>'
    '<origin xyz="0.1 0 0" rpy="0 ${pi / 2} 0"/></joint></robot>'
)
JOB = {
    "name": "bracket",
    "arm": "robot.xacro",
    "path": {"points": [[0.5, 0.0, 0.3], [0.6, 0.0, 0.3]], "orientation": {"axis": [0, 0, -1]}},
    "limits": {"speed": "0.1 m/s", "joint_acceleration": 5},
    "corners": {"tolerance": "1 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"one": {}},
}
LINES = {
    "check": ("check", "q.csv", "--arm", "robot.xacro"),
    "check of a job": ("check", "q.csv", "--path", "job.yaml"),
    "run": ("run", "job.yaml", "--out", "out", "--no-simulation"),
    "run in a cell": ("run", "line.csv", "--cell", "job.yaml", "--out", "out", "--no-simulation"),
    "certify": ("certify", "job.yaml"),
}
# With trust, certify comes as far as to what this job lacks.
LACKING = {"certify": "A certificate requires"}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "robot.xacro").write_text(XACRO)
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(JOB))
    (tmp_path / "line.csv").write_text("x [m],y [m],z [m]\n0.5,0,0.3\n0.6,0,0.3\n")
    rows = "".join(f"{k * 0.1:.1f},0,0,0,0,0,0\n" for k in range(5))
    (tmp_path / "q.csv").write_text(f"t,j1,j2,j3,j4,j5,j6\n{rows}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def armcontour(*arguments):
    return CliRunner().invoke(app, arguments)


def test_trust_is_given_by_the_option_alone(folder):
    for name, line in LINES.items():
        refused = armcontour(*line)
        assert isinstance(refused.exception, InvalidInput), name
        for words in ("robot.xacro", "a xacro file is a program", "--trust-xacro"):
            assert words in str(refused.exception), name
        assert not (folder / "out").exists(), name
        outcome = armcontour(*line, "--trust-xacro")
        if name in LACKING:
            assert LACKING[name] in str(outcome.exception)
        else:
            assert outcome.exit_code == 0, outcome.exception
        shutil.rmtree(folder / "out", ignore_errors=True)


def test_check_takes_packages_and_arguments(folder):
    (folder / "parts").mkdir()
    (folder / "robot.xacro").rename(folder / "parts" / "robot.xacro")
    (folder / "robot.xacro").write_text(
        '<robot name="six" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="$(find six)/$(arg kind).xacro"/></robot>'
    )
    options = ("--package", "six=parts", "--xacro-arg", "kind=robot")
    outcome = armcontour(*LINES["check"], "--trust-xacro", *options)
    assert outcome.exit_code == 0, outcome.exception
    for arguments, words in (
        (options[:2], "--xacro-arg kind=VALUE"),
        (options[2:], "--package six=FOLDER"),
        (("--package", "six"), "--package must be NAME=VALUE"),
    ):
        refused = armcontour(*LINES["check"], "--trust-xacro", *arguments)
        assert isinstance(refused.exception, InvalidInput) and words in str(refused.exception)
    (folder / "job.yaml").write_text(yaml.safe_dump({**JOB, "arm": "ur5e"}))
    of_job = armcontour(*LINES["check of a job"], "--trust-xacro", *options)
    assert "--package and --xacro-arg require --arm" in str(of_job.exception)
