"""The command `identify --arm`: from CSV to an arm file and a servo that jobs take."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.cli.identifying import identify_files
from armcontour.cli.options import IdentifyOptions
from armcontour.errors import InvalidInput
from armcontour.io.robot_file import read_servo

from .robots import COULOMB, KP, nominal_arm, nominal_servo, record, set_points, true_arm

pytest.importorskip("mujoco")
ARM = """name: mine
kind: derived
source: a test
arm: ur5e
armature: {value: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1], unit: kg m^2, source: a guess}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log, an arm file and a job with a servo."""
    place = tmp_path_factory.mktemp("robot")
    servo = nominal_servo().replace(kp=KP)
    log = record(true_arm(nominal_arm()), servo, set_points(0, 3.0), every=8)
    names = ["t", *(f"u{j + 1}" for j in range(6)), *(f"q{j + 1}" for j in range(6))]
    table = np.column_stack([log.t, log.command, log.measured])
    np.savetxt(place / "run.csv", table, "%.9f", ",", header=",".join(names), comments="")
    (place / "arm.yaml").write_text(ARM)
    (place / "job.yaml").write_text("name: j\nservo: {kp: 25 1/s, kv: 150 1/s}\n")
    return place


def options(folder, **more):
    arm, servo = str(folder / "arm.yaml"), folder / "job.yaml"
    return IdentifyOptions(arm=arm, servo=servo, gravity="loaded", **more)


def test_what_is_written_is_what_jobs_take(folder, capsys):
    out = folder / "found"
    identify_files([folder / "run.csv"], options(folder, out=out))
    printed = capsys.readouterr().out
    assert "coulomb" in printed and "The controller holds the arm" in printed
    names = {"robot.yaml", "servo.yaml", "report.html", "summary.json", ".armcontour.json"}
    assert {x.name for x in out.iterdir()} - {"excitation.csv"} == names
    arm = ac.load_arm(out / "robot.yaml")
    assert arm.name == "mine"
    np.testing.assert_allclose(arm.chain.coulomb, COULOMB, rtol=0.1)
    assert arm.chain.payload.mass == pytest.approx(2.0, rel=0.1)
    servo = read_servo(out / "servo.yaml", 6)
    np.testing.assert_allclose(servo.kp, KP, rtol=0.05)
    assert servo.inertia is not None and (servo.inertia > 0.1).all()
    page = json.loads((out / "summary.json").read_text())
    assert page["gravity_feedforward"] == "loaded" and len(page["joints"]) == 6
    # Every number has a unit and a source, as in every arm file.
    data = yaml.safe_load((out / "robot.yaml").read_text())
    for key in ("payload_mass", "payload_center", "armature", "viscous", "coulomb"):
        assert data[key]["unit"] and "95 %" in data[key]["source"]
    html = (out / "report.html").read_text()
    assert "Coulomb friction" in html and 'src="http' not in html


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"model": "second"}, "--model is for joints without an arm"),
        ({"drive_cycle": "1"}, "--drive-cycle: '1' has no unit"),
        ({"gravity": "half"}, "gravity must be"),
        ({"servo": Path("none.yaml")}, "no servo file|There is no"),
        ({"package": ["a=b"], "out": Path("x")}, "cannot name packages"),
    ],
)
def test_options_that_cannot_be_used(folder, more, message):
    given = {"arm": "ur5e", "servo": None, "gravity": None} | more
    with pytest.raises(InvalidInput, match=message):
        identify_files([folder / "run.csv"], IdentifyOptions(**given))


def test_options_of_robots_need_an_arm(folder):
    with pytest.raises(InvalidInput, match="--gravity goes with --arm"):
        identify_files([folder / "run.csv"], IdentifyOptions(gravity="none"))
    with pytest.raises(InvalidInput, match="--predict is for joints without an arm"):
        identify_files([folder / "run.csv"], IdentifyOptions(arm="ur5e", predict=[folder / "x"]))


def test_a_servo_file_without_a_servo(folder):
    with pytest.raises(InvalidInput, match="has no key servo"):
        read_servo(folder / "arm.yaml", 6)


def test_nothing_is_written_for_a_log_of_another_arm(folder):
    out = folder / "other"
    with pytest.raises(InvalidInput, match="has 6 joints .* but the arm .* has 7"):
        identify_files([folder / "run.csv"], IdentifyOptions(arm="panda", out=out))
    assert not out.exists()
