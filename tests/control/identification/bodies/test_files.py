"""The command `identify --arm`: from CSV to an arm file and a servo that jobs take."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.cli.identify_command import identify_files
from armcontour.cli.options import IdentifyOptions
from armcontour.core.errors import InvalidInput
from armcontour.files.robot_file import read_servo

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


def test_what_is_written_is_what_jobs_take(folder):
    out = folder / "found"
    options = {"arm": str(folder / "arm.yaml"), "servo": folder / "job.yaml", "gravity": "loaded"}
    identify_files([folder / "run.csv"], IdentifyOptions(**options, out=out))
    names = {"robot.yaml", "servo.yaml", "report.html", "summary.json", ".armcontour.json"}
    assert {x.name for x in out.iterdir()} == names
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
    assert "coulomb" in html and 'src="http' not in html


def test_options_that_cannot_be_used(folder):
    out = folder / "other"
    for options, message in (
        ({"arm": "ur5e", "model": "second"}, "--model applies only to"),
        ({"arm": "ur5e", "drive_cycle": "1"}, "--drive-cycle requires a unit"),
        ({"arm": "ur5e", "gravity": "half"}, "gravity .*must be"),
        ({"arm": "ur5e", "servo": Path("none.yaml")}, "no servo file|There is no"),
        ({"arm": "ur5e", "package": ["a=b"], "out": Path("x")}, "cannot contain packages"),
        ({"gravity": "none"}, "--gravity requires --arm"),
        ({"arm": "ur5e", "validate": [folder / "x"]}, "--validate applies only"),
        ({"arm": "panda", "out": out}, "has 6 joints .* but the arm has 7"),
    ):
        with pytest.raises(InvalidInput, match=message):
            identify_files([folder / "run.csv"], IdentifyOptions(**options))
    assert not out.exists()
    with pytest.raises(InvalidInput, match="has no key servo"):
        read_servo(folder / "arm.yaml", 6)
