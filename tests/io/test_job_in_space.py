"""Job files of arms in space: the arm's equipment, paths with orientation, limits, experiments."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path as FilePath
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from soak.number_cases import SPACE

from armcontour._xacro.expanding import expand_xacro
from armcontour.errors import InvalidInput
from armcontour.frames import from_rpy
from armcontour.io import json_schema, parse_job
from armcontour.jobs import Experiment, Job

DATA = FilePath(__file__).parents[1] / "io" / "robots" / "data"
POINTS = [[0.4, 0.0, 0.2], [0.5, 0.0, 0.2], [0.5, "100 mm", 0.2]]
CURVED = {"tolerance": 1e-3, "continuity": "curvature"}
GOOD = {
    "name": "bracket",
    "arm": "ur5e",
    "path": {"points": POINTS, "orientation": {"rpy": ["180 deg", 0, 0]}},
    "limits": {"speed": "0.25 m/s", "centripetal_acceleration": 1},
    "corners": {"tolerance": "0.25 mm", "angular_tolerance": "2 deg"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"one": {}, "two": {}},
}


def job(folder: FilePath | None = None, *, trust_xacro: bool = False, **changes: object) -> Job:
    """The good job with some of its keys changed."""
    text = yaml.safe_dump({**GOOD, **changes})
    return parse_job(text, source="job.yaml", folder=folder, trust_xacro=trust_xacro)


def path(**keys: object) -> dict[str, object]:
    return {"path": keys}


@pytest.fixture
def folder(tmp_path: FilePath) -> FilePath:
    for name in ("robot.urdf", "joint_limits.yaml"):
        shutil.copy(DATA / name, tmp_path)
    return tmp_path


def test_an_arm_by_name_is_the_built_in_one() -> None:
    assert job(arm={"name": "ur5e"}).arm.name == job().arm.name == "UR5e"


def test_tool_work_and_payload_reach_the_arm() -> None:
    arm = job(
        arm={
            "name": "ur5e",
            "tool": {"position": [0, 0, "120 mm"], "rpy": [0, "90 deg", 0]},
            "work": {"position": [0.1, 0, 0], "quaternion": [0, 0, 1, 0]},
            "payload": {
                "mass": "2 kg",
                "center": [0, 0, "50 mm"],
                "inertia": [0.01, 0.001, 0, 0.02, 0, "0.015 kg m^2"],
            },
        }
    ).arm
    chain = arm.chain
    assert chain is not None and chain.payload is not None
    np.testing.assert_array_equal(chain.tool.position, [0, 0, 0.12])
    np.testing.assert_allclose(chain.tool.rotation, from_rpy([0, np.pi / 2, 0]), atol=1e-15)
    np.testing.assert_allclose(chain.base.inverse.position, [0.1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(chain.base.inverse.rotation, np.diag([-1, -1, 1]), atol=1e-15)
    assert chain.payload.mass == 2
    np.testing.assert_array_equal(chain.payload.center, [0, 0, 0.05])
    np.testing.assert_array_equal(
        chain.payload.inertia, [[0.01, 0.001, 0], [0.001, 0.02, 0], [0, 0, 0.015]]
    )


def test_a_description_is_found_beside_the_job(folder: FilePath) -> None:
    arm = job(
        folder,
        arm={
            "file": "robot.urdf",
            "tip": "tcp",
            "base": "world",
            "joint_limits": "joint_limits.yaml",
            "locked": {"lift": "100 mm", "hinge": "10 deg", "left": 0.02},
        },
    ).arm
    assert arm.joint_names == ("pan", "tilt", "elbow", "roll")
    assert arm.limits.joint_velocity is not None
    assert arm.limits.joint_velocity[0] == pytest.approx(np.pi / 2)
    # The column stands where it is locked.
    assert arm.links(np.zeros(4))[1][2] == pytest.approx(0.4 + 0.1 + 0.3 + 0.2)


def test_a_sliding_joint_of_a_xacro_file_is_locked_at_a_length(folder: FilePath) -> None:
    pytest.importorskip("xacro")
    (folder / "robot.urdf").rename(folder / "robot.xacro")
    described = {"file": "robot.xacro", "tip": "tcp", "locked": {"lift": "100 mm"}}
    found = job(folder, arm=described, trust_xacro=True).arm
    assert "lift" not in found.joint_names
    with pytest.raises(InvalidInput, match="arm.locked.lift: must be a quantity in m, which '2 de"):
        job(folder, arm={**described, "locked": {"lift": "2 deg"}}, trust_xacro=True)
    with pytest.raises(InvalidInput, match="only the joints of a .urdf or .xacro file"):
        job(arm={"name": "ur5e", "locked": {"lift": 0}})


def test_a_xacro_file_is_expanded_once(folder: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xacro")
    (folder / "robot.urdf").rename(folder / "robot.xacro")
    expanded: list[FilePath] = []

    def counting(file: FilePath, **options: Any) -> str:
        expanded.append(file)
        return expand_xacro(file, **options)

    monkeypatch.setattr("armcontour.io.robots.urdf.expand_xacro", counting)
    described = {"file": "robot.xacro", "tip": "tcp", "locked": {"lift": "100 mm"}}
    job(folder, arm=described, trust_xacro=True)
    assert expanded == [folder / "robot.xacro"]


def test_packages_and_arguments_of_a_xacro_file(folder: FilePath) -> None:
    pytest.importorskip("xacro")
    (folder / "parts").mkdir()
    (folder / "robot.urdf").rename(folder / "parts" / "robot.urdf")
    (folder / "jobs").mkdir()
    (folder / "jobs" / "robot.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="$(find column)/$(arg kind).urdf"/></robot>'
    )
    described = {
        "file": "robot.xacro",
        "tip": "tcp",
        "base": "base_link",
        "packages": {"column": "../parts"},
        "arguments": {"kind": "robot"},
    }
    found = job(folder / "jobs", arm=described, trust_xacro=True).arm
    assert found.joint_names == ("pan", "tilt", "elbow", "roll")
    for key, words in (("packages", "arm.packages"), ("arguments", "arm.arguments")):
        lacking = {name: value for name, value in described.items() if name != key}
        with pytest.raises(InvalidInput, match=words):
            job(folder / "jobs", arm=lacking, trust_xacro=True)
        with pytest.raises(InvalidInput, match="go with arm.file, a description"):
            job(arm={"name": "ur5e", key: described[key]})


@pytest.mark.parametrize(
    ("arm", "words"),
    [
        ("robot.xacro", "--trust-xacro"),
        ("robot.XACRO", "--trust-xacro"),
        ({"file": "robot.xacro", "tip": "tcp"}, "--trust-xacro"),
        ({"file": "robot.xacro", "tip": "tcp", "locked": {"lift": 0}}, "--trust-xacro"),
        ({"file": "robot.xacro", "trust_xacro": True}, "unknown key arm.trust_xacro"),
        ({"file": "robot.xacro", "trust-xacro": True}, "unknown key arm.trust-xacro"),
    ],
)
def test_a_job_cannot_trust_a_xacro_file(folder: FilePath, arm: object, words: str) -> None:
    for name in ("robot.xacro", "robot.XACRO"):
        shutil.copy(folder / "robot.urdf", folder / name)
    with pytest.raises(InvalidInput, match=words):
        job(folder, arm=arm)
    with pytest.raises(InvalidInput, match="unknown key trust_xacro"):
        parse_job(yaml.safe_dump({**GOOD, "trust_xacro": True}))


def test_a_description_may_be_named_alone(folder: FilePath) -> None:
    with pytest.raises(InvalidInput, match=r"job.yaml: .*robot.urdf"):
        job(folder, arm="robot.urdf")  # it has three ends, so a tip must be chosen


@pytest.mark.parametrize(
    ("arm", "words"),
    [
        ({}, "arm takes either name, a built-in arm, or file"),
        ({"name": "ur5e", "file": "x.urdf"}, "arm takes either name"),
        ({"name": "ur5e", "tpi": "x"}, "unknown key arm.tpi"),
        ({"name": "ur5"}, "no built-in arm 'ur5'"),
        ({"file": "robot.txt"}, "arm.file must be a .yaml, .yml, .urdf, .xacro file"),
        ({"file": "none.urdf"}, "no robot description .*none.urdf"),
        ({"name": "ur5e", "tip": "tcp"}, "no other tip"),
        ({"name": "ur5e", "tip": 5}, "arm.tip: must be text, not 5"),
        (
            {"name": "ur5e", "tool": {"position": [0, 0, "1 deg"]}},
            r"arm.tool.position \(item 3\): must be a quantity in m",
        ),
        ({"name": "ur5e", "tool": {"position": [0, 0]}}, "arm.tool.position"),
        (
            {"name": "ur5e", "tool": {"rpy": [0, 0, 0], "quaternion": [0, 0, 0, 1]}},
            "arm.tool takes either rpy or quaternion, not both",
        ),
        (
            {"name": "ur5e", "tool": {"quaternion": [0, 0, 0, 2]}},
            "arm.tool.quaternion: a quaternion .* must have the length 1",
        ),
        (
            {"name": "ur5e", "tool": {"rpy": ["90", 0, 0]}},
            r"arm.tool.rpy \(item 1\): '90' has no unit",
        ),
        ({"name": "ur5e", "payload": {"mass": -1}}, "arm.payload: payload mass"),
        ({"name": "ur5e", "payload": {}}, "the key arm.payload.mass is missing"),
        (
            {"name": "ur5e", "payload": {"mass": 1, "inertia": [1, 0, 0, 1, 0, 5]}},
            "arm.payload: No body can have the inertia of the payload",
        ),
        (
            {"file": "robot.urdf", "tip": "tcp", "locked": {"lfit": 0.1}},
            "no joint 'lfit' to be locked",
        ),
        (
            {"file": "robot.urdf", "tip": "tcp", "locked": {"lift": "1 kg"}},
            "arm.locked.lift: must be a quantity in rad",
        ),
        (
            {"file": "robot.urdf", "tip": "tcp", "locked": {"lift": "10 deg"}},
            "arm.locked.lift: must be a quantity in m, which '10 deg' is not",
        ),
        (
            {"file": "robot.urdf", "tip": "tcp", "locked": {"hinge": "10 mm"}},
            "arm.locked.hinge: must be a quantity in rad, which '10 mm' is not",
        ),
    ],
)
def test_a_bad_arm_is_refused_in_one_sentence(
    folder: FilePath, arm: dict[str, object], words: str
) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        job(folder, arm=arm)
    assert str(caught.value).startswith("job.yaml: ")
    assert "\n" not in str(caught.value)


def test_arcs_through_points_and_full_circles() -> None:
    found = job(
        **path(
            start=[0.4, 0, 0.2],
            segments=[
                {"via": [0.5, 0.1, 0.2], "to": [0.6, 0, 0.2], "tag": "arch"},
                {"center": [0.6, 0, "150 mm"], "angle": "360 deg", "normal": [1, 0, 0]},
                {"to": [0.6, 0, 0.3], "speed": "20 mm/s"},
            ],
        )
    ).path
    assert found.lengths == pytest.approx([0.1 * np.pi, 0.05 * 2 * np.pi, 0.1])
    np.testing.assert_allclose(found(0.05 * np.pi), [0.5, 0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(found.vertices[2], [0.6, 0, 0.2], atol=1e-12)
    assert found.tags == ("arch", None, None)
    assert found.speeds[2] == 0.02


def test_splines() -> None:
    points = [[0.4, 0, 0.2], [0.5, 0.1, 0.25], [0.6, 0, 0.2]]
    free = job(**path(spline={"points": points, "tolerance": "0.1 mm"})).path
    exact = job(**path(spline={"points": points, "tolerance": "1e-6 mm"})).path
    assert len(free) < len(exact)
    np.testing.assert_allclose(free.vertices[-1], points[-1], atol=1e-12)
    closed = job(**path(spline={"points": [*points, points[0]], "closed": True})).path
    # Smooth where it is closed.
    end = closed(closed.length, 1, side="left")
    np.testing.assert_allclose(end, closed.tangents[0], atol=1e-9)


def test_one_orientation_for_the_whole_path() -> None:
    for way in ({"rpy": ["180 deg", 0, 0]}, {"quaternion": [1, 0, 0, 0]}):
        found = job(**path(points=POINTS, orientation=way)).path.orientation
        assert found is not None and not found.axis_only
        np.testing.assert_allclose(found(0.05), np.diag([1, -1, -1]), atol=1e-15)
    free = job(**path(points=POINTS, orientation={**way, "axis_only": True})).path.orientation
    assert free is not None and free.axis_only


def test_orientations_per_waypoint() -> None:
    ways = [{"rpy": ["180 deg", 0, 0]}, {"quaternion": [1, 0, 0, 0]}, {"rpy": ["170 deg", 0, 0]}]
    found = job(**path(points=POINTS, orientation=ways)).path.orientation
    assert found is not None
    np.testing.assert_allclose(found(0.2), from_rpy([np.radians(170), 0, 0]), atol=1e-12)
    axes = [{"axis": [0, 0, -2]}, {"axis": [0, 0, -1]}, {"axis": [1, 0, -1]}]
    found = job(**path(points=POINTS, orientation=axes)).path.orientation
    assert found is not None and found.axis_only
    np.testing.assert_allclose(found(0.2)[:, 2], [np.sqrt(0.5), 0, -np.sqrt(0.5)], atol=1e-12)


def test_tool_axis_and_tangent() -> None:
    found = job(**path(points=POINTS, orientation={"axis": [0, 0, -1]})).path.orientation
    assert found is not None and found.axis_only
    np.testing.assert_allclose(found(0.1)[:, 2], [0, 0, -1], atol=1e-15)
    way = {"follow_tangent": {"up": [0, 0, 1], "rpy": ["180 deg", 0, 0]}, "axis_only": True}
    found = job(**path(points=POINTS, orientation=way)).path.orientation
    assert found is not None and found.follows and found.axis_only
    np.testing.assert_allclose(found(0.15)[:, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"points": POINTS, "orientation": {}}, "takes one of rpy, .*, not none"),
        (
            {"points": POINTS, "orientation": {"rpy": [0, 0, 0], "axis": [0, 0, 1]}},
            "path.orientation takes one of .*, not rpy and axis",
        ),
        (
            {"points": POINTS, "orientation": {"rpy": [0, 0, "1 m"]}},
            r"orientation.rpy \(item 3\): must",
        ),
        ({"points": POINTS, "orientation": {"rpyy": [0, 0, 0]}}, "unknown key path.orientation.r"),
        ({"points": POINTS, "orientation": {"axis": [0, 0, 0]}}, "has no length"),
        (
            {"points": POINTS, "orientation": {"axis": [0, 0, 1], "axis_only": "yes"}},
            "path.orientation.axis_only: must be true or false, not 'yes'",
        ),
        ({"points": POINTS, "orientation": []}, "path.orientation is an empty list"),
        ({"points": POINTS, "orientation": [{"rpy": [0, 0, 0]}] * 2}, "has 2 values.*3 waypoints"),
        (
            {"points": POINTS, "orientation": [{"rpy": [0, 0, 0]}] * 2 + [{"axis": [0, 0, 1]}]},
            "either all waypoints or none give axis",
        ),
        (
            {"points": POINTS, "orientation": [{"follow_tangent": {"up": [0, 0, 1]}}] * 3},
            r"path.orientation \(item 1\): follow_tangent is for the whole path",
        ),
        (
            {"points": POINTS, "orientation": {"follow_tangent": {"up": [1, 0, 0]}}},
            "up lies along the first tangent",
        ),
        (
            {"points": [[0.3, 0.2], [0.4, 0.2]], "orientation": {"axis": [0, 0, 1]}},
            "three coordinates",
        ),
        (
            {"spline": {"points": POINTS}, "orientation": [{"rpy": [0, 0, 0]}] * 3},
            "a spline takes one orientation",
        ),
        ({"spline": {"points": POINTS, "closed": True}}, "closed spline must end at its first"),
        (
            {"spline": {"points": POINTS, "tolerance": 0}},
            "path.spline.tolerance: must be above zero",
        ),
        ({"spline": {"points": []}}, "points of path.spline are empty"),
        ({"spline": {"points": POINTS}, "points": POINTS}, "either points, or start and segments"),
        ({"start": POINTS[0]}, "either points, or start and segments, or spline"),
        ({"start": POINTS[0], "segments": []}, "path.segments is empty"),
        (
            {"start": POINTS[0], "segments": [{"via": [0.45, 0, 0.2], "to": [0.5, 0, 0.2]}]},
            r"path.segments \(item 1\): The points .* lie on one line",
        ),
        (
            {"start": POINTS[0], "segments": [{"via": [0.5, 0.1, 0.2]}]},
            r"path.segments \(item 1\) takes either to .*, or via and to",
        ),
        (
            {"start": POINTS[0], "segments": [{"center": [0.5, 0, 0.2], "angle": "360 deg"}]},
            "is an arc in space and needs its normal",
        ),
        (
            {
                "start": POINTS[0],
                "segments": [{"to": POINTS[1]}, {"center": POINTS[1], "angle": 1}],
            },
            "egment [12] must be an arc with a radius above zero",
        ),
    ],
)
def test_a_bad_path_is_refused_in_one_sentence(keys: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        job(**path(**keys))
    assert str(caught.value).startswith("job.yaml: ")
    assert "\n" not in str(caught.value)


def test_limits_of_joints_and_of_turning() -> None:
    limits = {
        "joint_torque": ["100 N m", "100 Nm", 80, 20, 20, 20],
        "joint_jerk": "4000 deg/s^3",
        "joint_lower": "-170 deg",
        "joint_upper": [3, 3, 3, 3, 3, "180 deg"],
        "angular_speed": "90 deg/s",
        "angular_acceleration": "720 deg/s^2",
    }
    found = job(limits=limits, corners="sharp").runs[0].limits
    np.testing.assert_allclose(found.joint_torque, [100, 100, 80, 20, 20, 20])
    np.testing.assert_allclose(found.joint_jerk, np.full(6, np.radians(4000)))
    np.testing.assert_allclose(found.joint_lower, np.full(6, np.radians(-170)))
    np.testing.assert_allclose(found.joint_upper, [3, 3, 3, 3, 3, np.pi])
    assert found.angular_speed == pytest.approx(np.pi / 2)
    assert found.angular_acceleration == pytest.approx(4 * np.pi)


def test_corners_and_start() -> None:
    start = ["10 deg", -1, 1, 0, 0, 0]
    found = job(start=start)
    assert found.runs[0].rounding is not None
    assert found.runs[0].rounding.angular_tolerance == pytest.approx(np.radians(2))
    np.testing.assert_allclose(found.start, [np.radians(10), -1, 1, 0, 0, 0])
    assert found.start is not None and not found.start.flags.writeable
    assert job().start is None
    names = found.arm.joint_names
    named = job(start=dict(reversed(list(zip(names, start, strict=True)))))
    np.testing.assert_array_equal(named.start, found.start)
    with pytest.raises(InvalidInput, match=f"start names the joints 'elbow'.*{names[1]}"):
        job(start={"elbow": 0})


def test_experiments() -> None:
    assert all(x.experiment is None for x in job().runs)
    plain = dataclasses.asdict(Experiment())
    assert all(dataclasses.asdict(x.experiment) == plain for x in job(experiment={}).runs)  # type: ignore[arg-type]
    options = {
        "step": "0.5 ms",
        "gravity_feedforward": False,
        "friction": False,
        "noise": "0.001 deg",
        "seed": 7,
    }
    first, second = job(experiment={**options, "runs": ["two"]}).runs
    assert first.experiment is None
    expected = Experiment(
        step=5e-4, gravity_feedforward=False, friction=False, noise=np.radians(1e-3), seed=7
    )
    assert second.experiment is not None
    assert dataclasses.asdict(second.experiment) == dataclasses.asdict(expected)
    unknown = {
        "payload": {"mass": "2 kg", "center": [0, 0, "50 mm"]},
        "armature": "0.1 kg m^2",
        "viscous": "8 Nm*s/rad",
        "coulomb": [6, 6, 4, "1.5 N m", 1.5, 1500e-3],
        "joint_stiffness": "20 kN*m/rad",
        "joint_damping": "2 N m s/rad",
    }
    robot = job(experiment=unknown).runs[0].experiment
    assert robot is not None and robot.payload is not None
    assert robot.payload.mass == 2 and robot.payload.center.tolist() == [0, 0, 0.05]
    assert robot.armature is not None and robot.armature.tolist() == [0.1] * 6
    assert robot.viscous is not None and robot.viscous.tolist() == [8.0] * 6
    assert robot.joint_stiffness is not None and robot.joint_stiffness.tolist() == [2e4] * 6
    assert robot.joint_damping is not None and robot.joint_damping.tolist() == [2.0] * 6
    assert robot.coulomb is not None and robot.coulomb.tolist() == [6, 6, 4, 1.5, 1.5, 1.5]


def test_corners_have_a_continuous_curvature_where_jerk_is_limited() -> None:
    runs: dict[str, object] = {
        "plain": {},
        "joints": {"limits": {"joint_jerk": 100}},
        "tool": {"limits": {"tool_jerk": 10}},
        "along": {"limits": {"path_jerk": 10}},
        "arcs": {"limits": {"joint_jerk": 100}, "corners": {**CURVED, "continuity": "tangent"}},
        "curved": {"corners": CURVED},
        "sharp": {"limits": {"joint_jerk": 100}, "corners": "sharp"},
        "free": {"limits": {"joint_jerk": 100}, "corners": {"shape": "free", "tolerance": 1e-3}},
    }
    assert {x.name: x.continuity for x in job(runs=runs).runs} == {
        "plain": "tangent",
        "joints": "curvature",
        "tool": "curvature",
        "along": "curvature",
        "arcs": "tangent",
        "curved": "curvature",
        "sharp": None,
        "free": None,
    }


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": [0, 0, 0]}, "start has 3 values, but the arm has 6 joints"),
        ({"start": ["1 m", 0, 0, 0, 0, 0]}, r"start \(item 1\): must be a quantity in rad"),
        ({"limits": {"joint_torque": "5 m"}}, "limits.joint_torque: must be a quantity in N m"),
        ({"limits": {"joint_lower": 1, "joint_upper": 0}}, "range of joint 1 is empty"),
        ({"limits": {"angular_speed": 0}}, "limits.angular_speed: must be above zero"),
        (
            {"ignore_jerk": True},
            "unknown key ignore_jerk: plans keep limits of jerk.*joint_jerk: n",
        ),
        ({"runs": {"one": {"ignore_jerk": True}}}, "unknown key runs.one.ignore_jerk: plans keep"),
        ({"limits": {"joint_jerk": "5 rad/s^2"}}, "joint_jerk: must be a quantity in rad/s\\^3"),
        ({"limits": {"tool_jerk": "-5 m/s^3"}}, "limits.tool_jerk: must be above zero"),
        ({"limits": {"path_jerk": ".nan m/s^3"}}, "is not a quantity in m/s\\^3"),
        ({"limits": {"joint_jerk": [100, 100]}}, "joint_jerk has 2 values, but the arm has 6"),
        ({"experiment": {"runs": ["three"]}}, "experiment.runs names the run three"),
        ({"experiment": {"noise": "1 m"}}, "experiment.noise: must be a quantity in rad"),
        ({"experiment": {"friction": 1}}, "experiment.friction: must be true or false, not 1"),
        ({"experiment": {"seed": 1.5}}, "experiment.seed: must be a whole number, not 1.5"),
        ({"experiment": {"steps": 1}}, "unknown key experiment.steps"),
        ({"experiment": {"payload": 2}}, "experiment.payload"),
        ({"experiment": {"coulomb": "6 N"}}, "experiment.coulomb: must be a quantity in N m"),
        ({"experiment": {"viscous": -1}}, "experiment.viscous: must not be negative"),
        ({"experiment": {"joint_stiffness": 0}}, "experiment.joint_stiffness: must be above zero"),
        ({"experiment": {"armature": [1, 2]}}, "experiment: armature has 2 values, but the arm"),
        ({"experiment": {"friction": False, "coulomb": 1}}, "experiment: The experiment has fric"),
        ({"corners": {"angular_tolerance": "1 mm"}}, "corners.angular_tolerance: must be"),
        ({"corners": {"continuity": "smooth"}}, "corners.continuity: must be tangent or curvature"),
        (
            {"corners": {"shape": "free", "tolerance": 1e-3, "continuity": "tangent"}},
            "Run one: corners.continuity is for the shape arc",
        ),
        (
            {"corners": {**CURVED, "continuity": "tangent", "transition_tolerance": "1 um"}},
            "corners.transition_tolerance is for corners with continuity: curvature",
        ),
        (
            {"corners": CURVED, "runs": {"one": {"timing": {"method": "mac"}}}},
            "corners.continuity is curvature, but the method mac has rules for lines and arcs only",
        ),
    ],
)
def test_a_bad_key_is_refused_in_one_sentence(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        job(**changes)
    assert str(caught.value).startswith("job.yaml: ")
    assert "\n" not in str(caught.value)
    assert "more problem" not in str(caught.value)


def test_the_schema_accepts_all_of_it() -> None:
    validator = jsonschema.Draft202012Validator(json_schema())
    whole = {
        **GOOD,
        "arm": {"file": "robot.urdf", "tool": {"position": [0, 0, "1 mm"], "rpy": [0, 0, 0]}},
        "path": {
            "spline": {"points": POINTS, "tolerance": "1 um"},
            "orientation": {"follow_tangent": {"up": [0, 0, 1]}, "axis_only": True},
        },
        "start": ["10 deg", 0, 0, 0, 0, 0],
        "experiment": {"noise": "0.001 deg", "runs": ["one"]},
    }
    assert list(validator.iter_errors(json.loads(json.dumps(whole)))) == []
    assert list(validator.iter_errors({**whole, "experiment": {"steps": 1}}))


@pytest.mark.parametrize(
    ("orientation", "words"),
    [
        (
            {"axis": [[0, 0, -1], [0, 0.1, -1]]},
            "path.orientation.axis: is one direction, such as [0, 0, -1]: for one per waypoint "
            "write a list in the place of the mapping, orientation: [{axis: [0, 0, -1]}, ",
        ),
        (
            {"axis": [0, 1]},
            "path.orientation.axis: must be three numbers such as [0, 0, -1], not [0, 1]",
        ),
        ({"axis": "down"}, "path.orientation.axis: must be three numbers such as [0, 0, -1], not"),
        ([0, 0, -1], "path.orientation: must be a mapping such as {axis: [0, 0, -1]} or {rpy: "),
    ],
)
def test_an_orientation_of_another_shape_is_answered_with_the_wanted_one(
    orientation: object, words: str
) -> None:
    path = {"points": POINTS, "orientation": orientation}
    with pytest.raises(InvalidInput) as caught:
        parse_job(yaml.safe_dump(SPACE | {"path": path}))
    assert str(caught.value).startswith(f"job: {words}"), caught.value
