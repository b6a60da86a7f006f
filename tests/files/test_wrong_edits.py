"""Refusals of wrong values in job files state key, line and value."""

import pickle
import re
from importlib import resources

import pytest
import yaml

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.job_patch import write_patch

FOLDER = resources.files("armcontour.jobs") / "library"
PLATE = (FOLDER / "plate.yaml").read_text(encoding="utf-8")
EDITS = """
name: 5
title: [a]
arm: 7
arm: ur6e
arm.name: ur6e
arm.name: 3
arm.nam: ur5e
arm.file: x.urdf
arm.tool.position: [0, 0]
arm.tool.position: [0, 0, 120 kg]
arm.tool.rpy: [0, 0, 90]
arm.tool.quaternion: [0, 0, 0, 0]
arm.tool.shapes: [{type: ball, name: a}]
arm.tool.shapes: [{type: sphere, name: a}]
arm.payload: {mass: -1 kg}
arm.payload: {mass: 1 kg, inertia: [1, 2]}
arm.payload: {mass: 1 kg, inertia: [1, 0, 0, -1, 0, 1]}
arm.payload: {center: [0, 0, 0]}
arm.tip: tool9
arm.joint_limits: no.yaml
arm.work: {position: 5}
arm.shapes: [{type: sphere, name: a, radius: 1 cm, link: nolink}]
seed: [0.2]
seed: {a: 1}
seed: elbow
seed: [0.2, -1.7, -2.4, -0.6, 1.6, x]
path: plates.svg
path.file: plates.svg
path.file: plates.xyz
path.fil: plate.svg
path.points: [[0, 0], [1, 1]]
path.scale: 0
path.scale: big
path.layers: cut
path.layers: {cut: {sped: 1}}
path.layers: [nolayer]
path.names: [noname]
path.frame: {position: [380 mm, -70 mm]}
path.frame: {rpy: [0, 0, 90]}
path.orientation: [0, 0, -1]
path.orientation: {axis: [0, 0, 0]}
path.orientation: {axis: [0, 0, -1], rpy: [0, 0, 0]}
path.orientation: {}
path.repeat: {columns: 0}
path.repeat: {columns: 2}
path.units: parsec
path.ignore_z: 1
process: fast
process.order: random
process.kerf: -1 mm
process.kerf: 0.4 s
process.lead_in: {length: 0}
process.lead_in: {length: -5 mm}
process.lead_in: {shape: round}
process.switch: laser
process.switch: {name: "a\\a"}
process.begin: here
process.begin: [1 mm]
process.events: [{name: a, at: x}]
process.events: [{name: a, att: 1}]
process.by_layer: {cut: {kerf: x}}
process.by_layer: {cut: {ker: 1 mm}}
process.passes: 0
process.passes: 1.5
process.tabs: {count: 2}
process.direction: up
limits: none
limits.speed: 100 mm
limits.speed: -1 m/s
limits.sped: 1 m/s
limits.joint_velocity: [1, 2]
limits.joint_velocity: [1, 2, 3, 4, 5, -6]
limits.joint_acceleration: [[1, 1], [1, 1], [1, 1], [1, 1], [1, 1], [1, 1]]
limits.joint_lower: [10, 0, 0, 0, 0, 0]
corners: round
corners: {tolerance: -1 mm}
corners: {shape: free}
corners: {}
servo: {}
servo: fast
servo: {kp: -25 1/s, kv: 150 1/s}
servo: {kp: [25, 25], kv: 150}
servo: {kp: 25, kv: 150, order: third}
servo: {kp: 25, kv: 150, dead_time: [1 ms, 2]}
servo: {kp: 25, kv: 150, dead_time: 100 s}
servo.gain: 1
plant: {dead_time: x}
plant: {kp: 1e9}
plant: {model_error: 1}
plant: {order: none}
cycle: 100 s
cycle: 4
cycle: 0
cycle: 4 mm
runs.cut: fast
runs.cut.timing: {reserve: 10}
runs.cut.timing: {reserve: 100 %}
runs.cut.timing: {method: best}
runs.cut.timing: {method: shaped}
runs.cut.timing: {knots: 10}
runs.cut.compensation: {method: full}
runs.cut.compensation: {poles: [-1, -2]}
runs.cut.compensation: {method: pole_placement, poles: [-1, -2]}
runs.cut.compensation: {method: pole_placement, poles: [1, 2, 3]}
runs.cut.limits: {speed: x}
runs.cut.limits: {joint_velocity: [1, 2]}
runs.cut.cycle: 100 s
runs.cut.duration: -1
runs.cut.end_time: 0
runs.cut.certificate: {tolerance: 1 mm}
runs.cut.corners: {tolerance: x}
runs.cut.command_limits: {joint_velocity: [1]}
certificate: {}
certificate: {tolerance: 0}
certificate: {tolerance: 1 mm, run: nope}
certificate: {tolerance: 1 mm, box: {gains: 200 %}}
certificate: {tolerance: 1 mm, box: {shared: maybe}}
scene: {obstacles: [{type: box, name: a}]}
scene: {obstacles: [{type: box, name: a, size: [1, 2]}]}
scene: {obstacles: [{type: mesh, name: a, file: no.stl}]}
scene: {margins: {own: -1}}
scene: {floor: high}
scene: {floor: 5 kg}
experiment: {seed: x}
experiment: true
export: {formats: [x]}
export: {formats: csv}
export: {formats: [csv], cycle: 0}
accuracy: x
accuracy: -1 mm
tolerance: 1 mm
ignore_jerk: true
"""


@pytest.mark.parametrize("edit", EDITS.strip().splitlines())
def test_the_refusal_of_a_wrong_edit_names_key_and_line(edit):
    key, _, value = edit.partition(": ")
    keys = tuple(key.split("."))
    text = write_patch(PLATE, {keys: yaml.safe_load(value)})
    with pytest.raises(ac.ArmContourError) as caught:
        parse_job(text, folder=FOLDER)
    error = caught.value
    assert error.key[:1] == keys[:1], error
    # The line has the innermost key of the path that is written.
    line = int(re.search(r" \(line (\d+)\)", str(error))[1])
    written = [re.search(rf"\b{x}\b", text.splitlines()[line - 1]) for x in error.key]
    assert any(written), error


def test_the_refusal_of_a_wrong_edit_quotes_the_value_as_written():
    text = write_patch(PLATE, {("servo", "kp"): "-25 1/s"})
    with pytest.raises(ac.InvalidInput) as caught:
        parse_job(text, folder=FOLDER)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert (error.key, error.value) == (("servo", "kp"), "-25 1/s")
    with pytest.raises(ac.InvalidInput) as caught:
        ac.Limits(speed=-1.0)
    assert (caught.value.key, caught.value.value) == (("speed",), -1.0)
    with pytest.raises(ac.InvalidInput) as caught:
        ac.plan("a", "b")
    assert caught.value.key == ("path",)
