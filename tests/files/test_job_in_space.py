"""Job files of arms in space: tools, oriented paths, limits, experiments."""

import dataclasses
import shutil
from pathlib import Path as FilePath

import jsonschema
import numpy as np
import pytest
import yaml
from tests.files.tables import refusals, rows, values

from armcontour.core.errors import InvalidInput
from armcontour.core.frames import from_rpy
from armcontour.files import json_schema, parse_job
from armcontour.jobs import Experiment

DATA = FilePath(__file__).parent / "robots" / "data"
POINTS = [[0.4, 0.0, 0.2], [0.5, 0.0, 0.2], [0.5, "100 mm", 0.2]]
GOOD = yaml.safe_load("""
name: bracket
arm: ur5e
path:
  points: [[0.4, 0.0, 0.2], [0.5, 0.0, 0.2], [0.5, 100 mm, 0.2]]
  orientation: {rpy: [180 deg, 0, 0]}
limits: {speed: 0.25 m/s, centripetal_acceleration: 1}
corners: {tolerance: 0.25 mm, angular_tolerance: 2 deg}
servo: {kp: 25, kv: 150}
runs: {one: {}, two: {}}
""")


def job(text="{}", folder=None, **changes):
    """The good job with some of its keys changed, by text or by values."""
    changed = yaml.safe_dump({**GOOD, **yaml.safe_load(text), **changes})
    return parse_job(changed, source="job.yaml", folder=folder)


def path(**keys):
    return job(path=keys).path


def oriented(way):
    return path(points=POINTS, orientation=way).orientation


@pytest.fixture
def folder(tmp_path):
    for name in ("robot.urdf", "joint_limits.yaml"):
        shutil.copy(DATA / name, tmp_path)
    return tmp_path


def test_tool_and_work_frame_and_payload_of_a_job_are_set():
    assert job(arm={"name": "ur5e"}).arm.name == job().arm.name == "UR5e"
    chain = job("""
arm:
  name: ur5e
  tool: {position: [0, 0, 120 mm], rpy: [0, 90 deg, 0]}
  work: {position: [0.1, 0, 0], quaternion: [0, 0, 1, 0]}
  payload: {mass: 2 kg, center: [0, 0, 50 mm], inertia: [0.01, 0.001, 0, 0.02, 0, 0.015 kg m^2]}
""").arm.chain
    np.testing.assert_array_equal(chain.tool.position, [0, 0, 0.12])
    np.testing.assert_allclose(chain.tool.rotation, from_rpy([0, np.pi / 2, 0]), atol=1e-15)
    np.testing.assert_allclose(chain.base.inverse.position, [0.1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(chain.base.inverse.rotation, np.diag([-1, -1, 1]), atol=1e-15)
    inertia = [[0.01, 0.001, 0], [0.001, 0.02, 0], [0, 0, 0.015]]
    assert chain.payload.mass == 2 and chain.payload.inertia.tolist() == inertia
    np.testing.assert_array_equal(chain.payload.center, [0, 0, 0.05])


def test_a_description_is_found_next_to_the_job(folder):
    text = """
arm:
  file: robot.urdf
  tip: tcp
  base: base_link
  joint_limits: joint_limits.yaml
"""
    arm = job(text, folder).arm
    assert arm.joint_names == ("pan", "tilt", "elbow", "roll")
    assert arm.limits.joint_velocity[0] == pytest.approx(np.pi / 2)


BAD = """
arm: {name: ur5e, file: x.urdf} => arm requires either name
arm: {file: robot.txt} => arm.file must have the extension .urdf or .yaml
arm: robot.xacro => xacrodoc
arm: {file: robot.MCAP} => Only identify, learn and check read bags of ROS 2
arm: {name: ur5e, tool: {position: [0, 0, 1 deg]}} => arm.tool.position (item 3): ... quantity in m
arm: {name: ur5e, tool: {rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]}} => has rpy and quaternion
arm: {name: ur5e, tool: {quaternion: [0, 0, 0, 2]}} => arm.tool.quaternion: ... length 1
arm: {name: ur5e, payload: {mass: 1, inertia: [1, 0, 0, 1, 0, 5]}} => arm.payload: No body can have
seed: [0, 0, 0] => seed has 3 values, but the arm has 6 joints
seed: {elbow: 0} => seed names the joints 'elbow' ... shoulder_lift_joint
ignore_jerk: true => unknown key ignore_jerk: the known keys are
experiment: {step: 1 m} => experiment.step: must be a quantity in s
{corners: {tolerance: 1mm, continuity: curvature}, runs: {a: {timing: {method: paper}}}} => .contin
"""


def test_invalid_keys_of_jobs_in_space_are_refused_in_one_sentence(folder):
    refusals(lambda x: job(x, folder), BAD, "job.yaml: ", without="more problem")


def test_arcs_through_points_and_full_circles_are_read():
    path_read = job("""
path:
  start: [0.4, 0, 0.2]
  segments:
  - {via: [0.5, 0.1, 0.2], to: [0.6, 0, 0.2]}
  - {center: [0.6, 0, 150 mm], angle: 360 deg, normal: [1, 0, 0]}
  - {to: [0.6, 0, 0.3], speed: 20 mm/s}
""").path
    assert path_read.lengths == pytest.approx([0.1 * np.pi, 0.05 * 2 * np.pi, 0.1])
    np.testing.assert_allclose(path_read(0.05 * np.pi), [0.5, 0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(path_read.vertices[2], [0.6, 0, 0.2], atol=1e-12)
    assert path_read.speeds[2] == 0.02


def test_orientations_are_read_in_all_forms():
    down = {"rpy": ["180 deg", 0, 0]}
    for way in (down, {"quaternion": [1, 0, 0, 0]}):
        orientation = oriented(way)
        assert not orientation.axis_only and oriented({**way, "axis_only": True}).axis_only
        np.testing.assert_allclose(orientation(0.05), np.diag([1, -1, -1]), atol=1e-15)
    orientation = oriented([down, {"quaternion": [1, 0, 0, 0]}, {"rpy": ["170 deg", 0, 0]}])
    np.testing.assert_allclose(orientation(0.2), from_rpy([np.radians(170), 0, 0]), atol=1e-12)
    orientation = oriented([{"axis": [0, 0, -2]}, {"axis": [0, 0, -1]}, {"axis": [1, 0, -1]}])
    assert orientation.axis_only
    np.testing.assert_allclose(orientation(0.2)[:, 2], [np.sqrt(0.5), 0, -np.sqrt(0.5)], atol=1e-12)
    orientation = oriented({"axis": [0, 0, -1]})
    assert orientation.axis_only
    np.testing.assert_allclose(orientation(0.1)[:, 2], [0, 0, -1], atol=1e-15)
    orientation = oriented({"follow_tangent": {"up": [0, 0, 1], **down}, "axis_only": True})
    assert orientation.follows and orientation.axis_only
    np.testing.assert_allclose(orientation(0.15)[:, 0], [0, 1, 0], atol=1e-12)


# P is replaced by three points.
BAD_PATHS = """
points: P, orientation: {} => requires exactly one of rpy, ... has none
points: P, orientation: {rpy: [0, 0, 0], axis: [0, 0, 1]} => path.orientation ... has rpy and axis
points: P, orientation: {rpyy: [0, 0, 0]} => unknown key path.orientation.r
points: P, orientation: [] => path.orientation is an empty list
points: P, frame: {rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]} => path.frame has rpy and quaternion
points: P, orientation: [{rpy: [0, 0, 0]}, {rpy: [0, 0, 0]}] => has 2 values ... 3 waypoints
points: P, orientation: [{rpy: [0, 0, 0]}, {rpy: [0, 0, 0]}, {axis: [0, 0, 1]}] => axis, or none
points: P, orientation: [&x {follow_tangent: {up: [0, 0, 1]}}, *x, *x] => (item 1): follow_tangent
points: P, orientation: {axis: [[0, 0, -1], [0, 0.1, -1]]} => orientation.axis: must have at least 3
points: [[0.3, 0.2], [0.4, 0.2]], orientation: {axis: [0, 0, 1]} => three coordinates
start: [0.4, 0, 0.2], segments: [{via: [0.5, 0.1, 0.2]}] => segments (item 1) requires either to
"""


def test_invalid_paths_in_space_are_refused_in_one_sentence():
    def read(keys):
        keys = keys.replace("P", "[[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 100 mm, 0.2]]")
        job(f"path: {{{keys}}}")

    refusals(read, BAD_PATHS, "job.yaml: ")
    with pytest.raises(InvalidInput) as error:
        read("points: P, frame: {quaternion: [0, 0, 0, 2]}")
    assert error.value.key == ("path", "frame")


# Angles of 90° and of 180° [rad].
HALF = np.pi / 2
TURN = np.pi
VALUES = f"""
limits: {{joint_torque: [10 N m, 10 Nm, 8, 2, 2, 2]}} => {{joint_torque: [10, 10, 8, 2, 2, 2]}}
limits: {{joint_jerk: 180 deg/s^3}} => {{joint_jerk: {[TURN] * 6}}}
limits: {{joint_lower: -90 deg}} => {{joint_lower: {[-HALF] * 6}}}
limits: {{joint_upper: [3, 3, 3, 3, 3, 180 deg]}} => {{joint_upper: {[3, 3, 3, 3, 3, TURN]}}}
limits: {{angular_speed: 90 deg/s}} => {{angular_speed: {HALF}}}
limits: {{angular_acceleration: 180 deg/s^2}} => {{angular_acceleration: {TURN}}}
"""
ROBOT = """
payload: {mass: 2 kg, center: [0, 0, 50 mm]} => {payload.mass: 2, payload.center: [0, 0, 0.05]}
{step: 0.5 ms} => {step: 0.0005}
"""


def test_limits_of_joints_and_experiments_are_read():
    values(lambda x: job("corners: sharp", **yaml.safe_load(x)).runs[0].limits, VALUES)
    values(lambda x: job(experiment=yaml.safe_load(x)).runs[0].experiment, ROBOT)
    assert all(x.experiment is None for x in job().runs)
    plain = dataclasses.asdict(Experiment())
    assert all(dataclasses.asdict(x.experiment) == plain for x in job(experiment={}).runs)


def test_corner_tolerances_and_seed_are_read():
    seed = ["10 deg", -1, 1, 0, 0, 0]
    parsed = job(seed=seed)
    assert parsed.runs[0].rounding.angular_tolerance == pytest.approx(np.radians(2))
    np.testing.assert_allclose(parsed.seed, [np.radians(10), -1, 1, 0, 0, 0])
    assert not parsed.seed.flags.writeable and job().seed is None
    named = job(seed=dict(reversed(list(zip(parsed.arm.joint_names, seed, strict=True)))))
    np.testing.assert_array_equal(named.seed, parsed.seed)


CONTINUITY = """
{} => tangent
{limits: {joint_jerk: 100}} => curvature
{limits: {joint_jerk: 100}, corners: {tolerance: 1 mm, continuity: tangent}} => tangent
{corners: {tolerance: 1 mm, continuity: curvature}} => curvature
{limits: {joint_jerk: 100}, corners: sharp} => None
{limits: {joint_jerk: 100}, corners: {shape: free, tolerance: 1 mm}} => None
"""


def test_jobs_with_jerk_limits_have_corners_of_continuous_curvature():
    for run, expected in rows(CONTINUITY):
        assert str(job(f"runs: {{one: {run}}}").runs[0].continuity) == expected, run


def test_the_schema_accepts_jobs_in_space_and_refuses_unknown_keys():
    validator = jsonschema.Draft202012Validator(json_schema())
    whole = GOOD | yaml.safe_load("""
arm: {file: robot.urdf, tool: {position: [0, 0, 1 mm], rpy: [0, 0, 0]}}
path:
  points: [[0.4, 0.0, 0.2], [0.5, 0.0, 0.2], [0.5, 100 mm, 0.2]]
  orientation: {follow_tangent: {up: [0, 0, 1]}, axis_only: true}
seed: [10 deg, 0, 0, 0, 0, 0]
experiment: {step: 1 ms}
""")
    assert list(validator.iter_errors(whole)) == []
    assert list(validator.iter_errors({**whole, "experiment": {"steps": 1}}))
