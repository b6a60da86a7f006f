"""Which quantities can be set."""

import pytest

import armcontour as ac
from armcontour._yaml import load
from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.io.job_edits import change_data, change_text
from armcontour.io.units import parse
from armcontour.studio.edits import EditState, changes_of
from armcontour.studio.handles import handles_of
from armcontour.studio.sliders import sliders_of

TEXT = """\
name: a
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.26]]}
limits: {speed: 0.15 m/s, joint_acceleration: [0.72 rad/s^2, 41 deg/s^2]}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150}
runs:
  mac: {timing: {method: mac}, compensation: {method: none}}
  own: {limits: {speed: 20 mm/s}, corners: sharp, command_interval: 0.002}
"""
ROBOT = """\
name: a
arm: ur5e
path: {points: [[0.45, 0, 0.2], [0.5, 0, 0.2]], orientation: {axis: [0, 0, -1]}}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {own: {}}
"""


def sliders(run="own", text=TEXT):
    found = sliders_of(load(text, ""), parse_job(text), run)
    assert len({x["key"] for x in found}) == len(found)
    return {x["key"]: x for x in found}


def test_every_slider_says_its_value_its_unit_and_where_it_is_written():
    own, mac = sliders(), sliders("mac")
    speed = own["limits.speed"]
    assert (speed["value"], speed["written"], speed["from"]) == (0.02, "20 mm/s", "run")
    assert (speed["unit"], speed["factor"], speed["log"]) == ("mm/s", 1e-3, True)
    assert (mac["limits.speed"]["written"], mac["limits.speed"]["from"]) == ("0.15 m/s", "job")
    assert own["limits.joint_acceleration.1"]["unit"] == "deg/s^2"
    assert own["limits.joint_acceleration.0"]["written"] == "0.72 rad/s^2"
    assert (own["servo.kv"]["written"], own["servo.kv"]["unit"]) == ("150", "1/s")
    assert own["command_interval"]["from"] == "run" and mac["command_interval"]["from"] == "default"
    assert own["corners.tolerance"]["value"] is None and mac["corners.tolerance"]["value"] == 5e-3
    assert (own["timing.reserve"]["written"], own["timing.reserve"]["min"]) == ("0 %", 0.0)
    assert own["limits.tool_acceleration"]["value"] is None
    for x in (*own.values(), *mac.values()):
        if x.get("value") is not None and "choices" not in x:
            assert x["min"] <= x["value"] <= x["max"]
    assert own["corners.shape"]["value"] == "sharp" and mac["corners.shape"]["value"] == "arc"
    assert mac["timing.method"]["value"] == "mac" and "optimal" in mac["timing.method"]["choices"]
    with pytest.raises(InvalidInput):
        sliders("gone")


def test_limits_of_the_arm_are_those_of_its_joints():
    found = sliders(text=ROBOT)
    arm = ac.load_arm("ur5e").limits
    keys = [x for x in found if x.startswith("limits.joint_velocity")]
    different = len(set(arm.joint_velocity.tolist())) > 1
    assert len(keys) == (6 if different else 1)
    assert {found[x]["from"] for x in keys} == {"arm"}
    assert [found[x]["value"] for x in keys] == arm.joint_velocity.tolist()[: len(keys)]
    assert found["limits.joint_jerk"]["value"] is None


@pytest.mark.parametrize(("text", "run"), [(TEXT, "mac"), (TEXT, "own"), (ROBOT, "own")])
def test_every_slider_can_be_set_and_then_has_that_value(text, run):
    data, job = load(text, ""), parse_job(text)
    state = EditState(data=data, run=run, handles=handles_of(job, data))
    for key, x in sliders(run, text).items():
        wanted = x["choices"][-1] if "choices" in x else 0.8 * x["max"]
        changes = changes_of({"do": "set", "key": key, "value": wanted}, state)
        new = change_data(data, changes)
        written = change_text(text, changes)
        assert load(written, "") == new
        if key in ("compensation.method", "corners.shape", "command_interval", "servo.kp"):
            # These values go with others only.
            continue
        try:
            found = {y["key"]: y for y in sliders_of(new, parse_job(written), run)}[key]
        except InvalidInput as error:
            assert "joint_jerk" in str(error) or "jerk" in str(error)
            continue
        value = found["value"]
        assert value == (wanted if "choices" in x else pytest.approx(wanted, rel=3e-15))
        assert found["from"] in ("run", "job")
        if "choices" not in x and x["unit"] not in ("", "%") and found["written"][-1].isalpha():
            assert parse(found["written"], unit_in_si(key)) == pytest.approx(wanted)


def unit_in_si(key):
    kinds = {"speed": "m/s", "tolerance": "m", "acceleration": "m/s^2", "kv": "1/s"}
    joints = {"joint_velocity": "rad/s", "joint_acceleration": "rad/s^2", "joint_jerk": "rad/s^3"}
    name = key.split(".")[1]
    return joints.get(name) or kinds[name.rpartition("_")[2]]
