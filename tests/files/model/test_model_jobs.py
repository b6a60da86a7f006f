"""Jobs along edges of CAD models: rules, tool axis, and the parts as obstacles."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.files.model import Bisector, EdgeRule, FaceNormal, FaceRule

pytest.importorskip("OCP")

MM = 1e-3
JOB = """
name: seam
arm: {{name: ur10e, tool: {{position: [0, 0, 300 mm]}}}}
path:
  file: {file}
  frame: {{position: [0.7, 0, 0.1]}}
  {path}
limits: {{speed: 10 mm/s}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{weld: {{}}}}
{more}
"""
SEAM = "edges: {seams: [post, plate], open: 200 mm}"


def job_of(folder, file, path, more=""):
    return parse_job(JOB.format(file=file, path=path, more=more), folder=folder)


def same(first, second, position):
    """Whether two paths have the same points and tool axes, the second one moved."""
    s = np.linspace(0, second.length, 50)
    np.testing.assert_allclose(first(s), second(s) + position, atol=1e-9)
    for path in (first, second):
        assert path.orientation is not None
    axes = [x.orientation(s)[:, :, 2] for x in (first, second)]
    np.testing.assert_allclose(*axes, atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "rule", "axis"),
    [
        (SEAM, EdgeRule(seams=("post", "plate"), open=0.2), Bisector()),
        (
            f"{SEAM}\n  orientation: {{bisector: {{travel: -10 deg, work: 5 deg, blend: 8 mm}}}}",
            EdgeRule(seams=("post", "plate"), open=0.2),
            Bisector(travel=np.radians(-10), work=np.radians(5), blend=0.008),
        ),
        (
            "edges: {face: {near: [90 mm, 0, 12 mm]}, loop: outer}\n  orientation: {face: {}}",
            EdgeRule(face=FaceRule(near=[0.09, 0, 0.012]), loop="outer"),
            FaceNormal(),
        ),
        (
            "edges: [{near: [100 mm, 0, 12 mm]}]\n  orientation: {face: {up: [1, 0, 0.5]}}",
            EdgeRule(near=[0.1, 0, 0.012]),
            FaceNormal(up=[1, 0, 0.5]),
        ),
    ],
)
def test_a_job_reads_what_python_makes(steps, keys, rule, axis):
    job = job_of(steps, "frame.step", keys)
    program = ac.read_model(steps / "frame.step").program(rule, axis=axis)
    assert len(job.program.contours) == len(program.contours) == 1
    same(job.program.contours[0].path, program.contours[0].path, [0.7, 0, 0.1])
    options = ac.ReadOptions(edges=rule, tool_axis=axis)
    read = ac.read_path(steps / "frame.step", options, frame=ac.Frame((0.7, 0, 0.1)))
    same(read.contours[0].path, program.contours[0].path, [0.7, 0, 0.1])


def test_rules_give_layers_whose_values_apply(steps):
    edges = """edges:
    - {face: {near: [50 mm, 50 mm, 20 mm]}, loop: outer, layer: TOP}
    - {kind: circle, radius: 5 mm, layer: HOLES}
  layers: {TOP: {speed: 5 mm/s}, HOLES: {speed: 2 mm/s}}"""
    job = job_of(steps, "block.step", edges)
    assert [x.layer for x in job.program.contours] == ["TOP", *["HOLES"] * 4]
    prepared = ac.prepare(job.program, job.process)
    speeds = [x.path.speeds.max() for x in prepared.contours]
    np.testing.assert_allclose(speeds, [5 * MM, *[2 * MM] * 4])
    only = job_of(
        steps,
        "block.step",
        edges.replace("layers: {TOP: {speed: 5 mm/s}, HOLES: {speed: 2 mm/s}}", "layers: [TOP]"),
    )
    assert [x.layer for x in only.program.contours] == ["TOP"]


def test_a_fixed_orientation_replaces_that_of_the_faces(steps):
    job = job_of(steps, "frame.step", f"{SEAM}\n  orientation: {{axis: [0, 0, -1]}}")
    (contour,) = job.program.contours
    assert contour.path.orientation.constant


@pytest.mark.parametrize(
    ("file", "keys", "more", "named"),
    [
        ("frame.step", "edges: {seams: [post, leg]}", "", "leg"),
        ("frame.step", "edges: [{fold: convex}, {kind: circle}]", "", "circle"),
        ("frame.step", f"{SEAM}\n  repeat: {{columns: 2}}", "", "path.repeat"),
        ("frame.step", f"{SEAM}\n  orientation: [{{bisector: {{}}}}]", "", "path.orientation"),
        ("frame.step", f"{SEAM}\n  orientation: {{bisector: {{}}, face: {{}}}}", "", "bisector"),
        ("frame.step", f"{SEAM}\n  orientation: {{face: {{}}}}", "", "up"),
        ("frame.step", f"{SEAM}\n  colors: [red]", "", "colors"),
        ("line.csv", SEAM, "", "edges"),
        ("line.csv", "orientation: {bisector: {}}", "", "path.orientation.bisector"),
        (
            "line.csv",
            "orientation: {axis: [0, 0, -1]}",
            "scene: {model: {margin: 1 mm}}",
            "scene.model",
        ),
    ],
)
def test_wrong_keys_are_refused(steps, file, keys, more, named):
    (steps / "line.csv").write_text("x [mm],y [mm],z [mm]\n0,0,0\n30,0,0\n")
    with pytest.raises(ac.InvalidInput) as error:
        job_of(steps, file, keys, more)
    assert named in str(error.value)


def test_parts_are_obstacles_in_the_frame_of_the_part(steps):
    job = job_of(steps, "frame.step", SEAM, "scene: {model: {margin: 3 mm, allow: [tool]}}")
    plate, post, arm = job.scene.obstacles
    assert (plate.name, post.name, arm.name) == ("plate", "post", "arm")
    assert plate.fixed_to == "part" and plate.margin == 3 * MM and plate.allow == ("tool",)
    np.testing.assert_allclose(plate.place.position, [0.7, 0, 0.1])
    scaled = job_of(steps, "frame.step", f"{SEAM}\n  scale: 0.5", "scene: {floor: -100 mm}")
    corners = scaled.scene.obstacles[0].shape.points
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.1, 0.1, 0.006], atol=1e-9)


def test_scene_model_none_leaves_the_parts_out(steps):
    job = job_of(steps, "frame.step", SEAM, "scene: {model: none}")
    assert job.scene.obstacles == ()


@needs_dynamics
def test_parts_are_a_scene_without_the_key_scene(steps):
    assert len(job_of(steps, "frame.step", SEAM).scene.obstacles) == 3


def test_a_model_replaces_the_fixed_orientation_of_a_cell(steps, tmp_path):
    rule = {("path", "edges"): {"seams": ["post", "plate"], "open": "200 mm"}}
    job = read_cell("ur10e_positioner", steps / "frame.step", patch=rule)
    (contour,) = job.program.contours
    assert not contour.path.orientation.constant
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        JOB.format(file="none.step", path="orientation: {bisector: {travel: -10 deg}}", more="")
    )
    job = read_cell(cell, steps / "frame.step", patch=rule)
    s = np.array([0.03, 0.09])
    path = job.program.contours[0].path
    forwards = (path.orientation(s)[:, :, 2] * path(s, 1)).sum(axis=1)
    np.testing.assert_allclose(np.degrees(np.arcsin(forwards)), -10, atol=0.15)


@needs_dynamics
def test_a_torch_too_close_to_the_part_is_refused(steps):
    keys = f"{SEAM}\n  orientation: {{bisector: {{work: 40 deg}}}}"
    torch = "{type: cylinder, name: torch, at: [0, 0, 140 mm], radius: 15 mm, length: 270 mm}"
    text = JOB.format(file="frame.step", path=keys, more="cycle: 20 ms")
    text = text.replace("[0, 0, 300 mm]", f"[0, 0, 300 mm], shapes: [{torch}]")
    with pytest.raises(ac.Collision) as error:
        ac.run(parse_job(text, folder=steps))
    assert set(error.value.bodies) & {"plate", "post", "arm"}
    assert all(x in str(error.value) for x in error.value.bodies)


def test_with_a_jerk_limit_the_tool_does_not_stop_where_lines_meet_arcs(tmp_path):
    from tests.files.model.step_parts import Named, rounded_box, write

    write(tmp_path / "plate.step", Named("plate", rounded_box((0, 0, 0), (40, 30, 5), 8.0)))
    edges = "edges: {face: {near: [20 mm, 15 mm, 5 mm]}}"
    text = JOB.format(
        file="plate.step",
        path=edges,
        more="scene: {model: none}\ncycle: 20 ms\n"
        "corners: {tolerance: 0.1 mm, continuity: curvature}",
    ).replace("{speed: 10 mm/s}", "{speed: 10 mm/s, joint_jerk: 100 rad/s^3}")
    result = ac.run(parse_job(text, folder=tmp_path)).runs["weld"]
    (contour,) = result.path.contours
    assert contour.path.smoothing > 0
    speeds = result.execution.tool_speed
    inside = (result.execution.t > 1.0) & (result.execution.t < result.trajectory.duration - 1.0)
    assert speeds[inside].min() > 0.5 * MM


def test_a_part_named_like_an_obstacle_is_renamed(steps):
    table = "scene: {obstacles: [{type: sphere, name: plate, radius: 10 mm, at: [0, 1, 0]}]}"
    names = [x.name for x in job_of(steps, "frame.step", SEAM, table).scene.obstacles]
    assert names[:4] == ["plate", "plate (part)", "post", "arm"]


def test_overlaps_and_weaves_follow_the_axis_without_a_stop(steps):
    seam = "edges: {seams: [branch, main pipe], open: 200 mm}"
    job = job_of(steps, "saddle.step", seam, "process: {overlap: 12 mm}")
    (contour,) = ac.prepare(job.program, job.process).contours
    assert contour.path.length == pytest.approx(job.program.contours[0].path.length + 12 * MM)
    assert not len(contour.path.stops)
    weave = "process: {weave: {width: 3 mm, pitch: 6 mm}}"
    woven = job_of(steps, "saddle.step", seam, weave)
    (waves,) = ac.prepare(woven.program, woven.process).contours
    source = job.program.contours[0].path
    s = np.linspace(0, 1, 40)
    axes = waves.path.orientation(s * waves.path.length)[:, :, 2]
    places = source.project(waves.path(s * waves.path.length)).s
    cosines = (axes * source.orientation(places)[:, :, 2]).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 6
