"""Built-in servos, their spread, and where a servo comes from."""

import json
from datetime import date

import numpy as np
import pytest
from soak.identification import move, multisine

import armcontour as ac
from armcontour.files.limits_and_servo_files import read_servo, servo_yaml

NAME = "ur5e-servoj"
PATH = "[[0.4, -0.05, 0.2], [0.44, -0.05, 0.2], [0.44, -0.02, 0.2]]"
JOB = f"""
name: corner
arm: ur5e
path: {{points: {PATH}, orientation: {{axis: [0, 0, -1]}}}}
corners: {{tolerance: 0.5 mm}}
limits: {{speed: 100 mm/s}}
cycle: 2 ms
servo: %s
runs: {{only: {{timing: {{reserve: 30 %%}}}}}}
"""
SAME_GAINS = "{kp: 9.72 1/s, kv: 28.8 1/s}"


def job_of(tmp_path, servo, patch=None):
    file = tmp_path / "job.yaml"
    file.write_text(JOB % servo)
    return ac.read_job(file, patch=patch)


def test_a_job_loads_a_preset_by_its_name(tmp_path):
    job = job_of(tmp_path, NAME)
    preset = ac.ServoModel.preset(NAME)
    for servo in (job.servo, job.plant_servo, read_servo(tmp_path / "job.yaml", 6)):
        np.testing.assert_array_equal(servo.kp, preset.kp)
        np.testing.assert_array_equal(servo.kv, preset.kv)
        assert (servo.kp_spread, servo.kv_spread) == (0.02, 0.05)
        assert servo.source == preset.source and NAME in servo.source
    patched = job_of(tmp_path, SAME_GAINS, {("servo",): NAME}).servo
    assert patched.source == preset.source


def test_unknown_presets_and_arms_with_other_joints_are_refused(tmp_path):
    with pytest.raises(ac.InvalidInput, match=NAME):
        ac.ServoModel.preset("ur5e")
    with pytest.raises(ac.InvalidInput, match=NAME) as refused:
        job_of(tmp_path, "ur5e")
    assert refused.value.key == ("servo",)
    with pytest.raises(ac.InvalidInput, match="6 joints, but the arm has 7") as refused:
        job_of(tmp_path, NAME, {("arm",): "fr3"})
    assert refused.value.key[0] == "servo"


@pytest.mark.parametrize("first", [NAME, "{kp: 9.72, kv: 28.8, source: identified from a.csv}"])
def test_a_servo_with_a_changed_value_is_assumed(tmp_path, first):
    servo = job_of(tmp_path, first, {("servo", "kp"): "12 1/s"}).servo
    np.testing.assert_array_equal(servo.kp, 12.0)
    np.testing.assert_array_equal(servo.kv, 28.8)
    assert servo.source == ""
    named = {("servo", "kp"): "12 1/s", ("servo", "source"): "data sheet"}
    assert job_of(tmp_path, first, named).servo.source == "data sheet"
    plant = job_of(tmp_path, first, {("plant", "kp"): "12 1/s"})
    assert plant.plant_servo.source == "" and plant.servo.source


def test_the_spread_of_a_servo_replaces_the_share_of_unknown_gains(tmp_path):
    spread = ac.run(job_of(tmp_path, NAME)).runs["only"]
    known = ac.run(job_of(tmp_path, SAME_GAINS)).runs["only"]
    assert spread.unknown_gains.shares == {"kp": 0.02, "kv": 0.05}
    assert known.unknown_gains.shares == {"kp": 0.01, "kv": 0.01}
    # The spread does not take part in the verdict.
    assert spread.evaluation.contour_error.max == known.evaluation.contour_error.max
    assert spread.kept == known.kept
    twice = job_of(tmp_path, "{kp: 9.72, kv: 28.8, kp_spread: 2 %, kv_spread: 2 %}")
    both = ac.run(twice).runs["only"]
    assert not known.unknown_gains.saturates and not both.unknown_gains.saturates
    assert known.unknown_gains.max < both.unknown_gains.max < spread.unknown_gains.max
    (row,) = (x for x in spread.to_data().rows if x.name == "unknown_gains.max")
    assert "kp 2 %" in row.label and "kv 5 %" in row.label


@pytest.mark.parametrize(
    ("servo", "source"),
    [
        (SAME_GAINS, "assumed"),
        (NAME, f"preset {NAME}"),
        ("{kp: 9.72, kv: 28.8, source: identified from a.csv}", "identified from a.csv"),
    ],
)
def test_every_output_says_where_the_servo_comes_from(command, tmp_path, servo, source):
    job = job_of(tmp_path, servo)
    folder = tmp_path / "out"
    file = tmp_path / "job.yaml"
    code, shown, errors = command("run", file, "--out", folder, "--export", "urscript")
    assert code in (0, 1), errors
    assert source in shown.splitlines()[0]
    assert source in json.loads((folder / "summary.json").read_text())["servo"]
    programs = folder / "only/export"
    assert source in (programs / "set_points.script").read_text()[:600]
    # The plan compensates no servo.
    assert source not in (programs / "reference.script").read_text()[:600]
    again = tmp_path / "again.script"
    ac.export(ac.run(job).runs["only"].set_points, again)
    code, _, errors = command("export", folder, tmp_path / "stored.script")
    assert code == 0, errors
    for program in (again, tmp_path / "stored.script"):
        assert source in program.read_text()[:600]


def test_an_identified_servo_states_the_day_and_the_logs(monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1767225600")
    t = np.arange(2000) * 4e-3
    u = 5e-3 * multisine(t, 25.0, seed=1)
    q = move(t, u, kp=20.0, kv=100.0)
    log = ac.Log(t=t, command=u[:, None], measured=q[:, None], source="A.csv")
    identification = ac.identify(log)
    day = date(2026, 1, 1).isoformat()
    file = tmp_path / "servo.yaml"
    file.write_text(servo_yaml(identification))
    for servo in (identification.servo_model(), read_servo(file, 1)):
        assert servo.source == f"identified on {day} from A.csv"
