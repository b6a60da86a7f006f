"""The keys `scene`, `arm.shapes`, `arm.tool.shapes` of a job file."""

from pathlib import Path

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms.chain import link_poses
from armcontour.errors import InvalidInput
from armcontour.io.cell import cell_names, read_cell
from armcontour.io.job_file import parse_job
from armcontour.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere

JOB = """
name: square
arm: {arm}
path:
  points: [[0.45, 0.0, 0.2], [0.5, 0.0, 0.2], [0.5, 0.05, 0.2]]
  orientation: {{axis: [0, 0, -1]}}
limits: {{speed: 100 mm/s}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{plain: {{}}}}
{scene}
"""
TETRAHEDRON = """v 0 0 0
v 100 0 0
v 0 100 0
v 0 0 100
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def job(scene: str = "", arm: str = "ur5e", folder: Path | None = None) -> ac.Job:
    return parse_job(JOB.format(arm=arm, scene=scene), folder=folder)


def test_every_kind_of_obstacle_is_read(tmp_path: Path) -> None:
    (tmp_path / "clamp.obj").write_text(TETRAHEDRON)
    found = job(
        """
scene:
  boxes: [{name: vise, size: [100 mm, 0.2, 5 cm], at: [0.4, 0, 10 mm], rpy: [0, 0, 90 deg]}]
  cylinders: [{name: post, radius: 20 mm, length: 0.5, margin: 1 cm, allow: [tool, wrist_3_link]}]
  spheres: [{name: ball, radius: 3 cm, quaternion: [0, 0, 0, 1]}]
  capsules: [{name: hose, radius: 1 cm, length: 10 cm, fixed_to: part}]
  halfspaces: [{name: table}, {name: wall, at: [0, 1, 0], normal: [0, -2, 0]}]
  meshes: [{name: clamp, file: clamp.obj, unit: mm}]
  margins: {environment: 8 mm}
""",
        folder=tmp_path,
    ).scene
    assert found is not None
    by_name = {x.name: x for x in found.obstacles}
    kinds = [Box, Cylinder, Sphere, Capsule, HalfSpace, HalfSpace, Mesh]
    assert [type(x.shape) for x in found.obstacles] == kinds
    vise, wall = by_name["vise"], by_name["wall"]
    assert isinstance(vise.shape, Box)
    np.testing.assert_allclose(vise.shape.size, [0.1, 0.2, 0.05])
    np.testing.assert_allclose(vise.place.position, [0.4, 0, 0.01])
    np.testing.assert_allclose(vise.place.rotation[:, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(wall.place.rotation[:, 2], [0, -1, 0], atol=1e-15)
    assert by_name["post"].margin == 0.01
    assert by_name["post"].allow == ("tool", "wrist_3_link")
    assert by_name["hose"].fixed_to == "part" and vise.fixed_to == "base"
    clamp = by_name["clamp"].shape
    assert isinstance(clamp, Mesh) and clamp.size == pytest.approx(0.1)
    assert (found.margins.environment, found.margins.own) == (0.008, 0.002)


def test_what_is_fixed_to_the_part_moves_with_the_drawing(tmp_path: Path) -> None:
    (tmp_path / "line.csv").write_text("x,y,z\n0,0,0\n0.05,0,0\n")
    before, after = JOB.split("path:")[0], JOB.split("limits:")[1]
    sheet = "{name: sheet, size: [0.1, 0.1, 0.01], at: [0.05, 0, 0], fixed_to: part}"
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        before.format(arm="ur5e")
        + "path: {frame: {position: [0.4, 0, 0.1], rpy: [0, 0, 90 deg]}, "
        + "orientation: {axis: [0, 0, -1]}}\nlimits:"
        + after.format(scene=f"scene: {{boxes: [{sheet}]}}")
    )
    scene = read_cell(cell, tmp_path / "line.csv").scene
    assert scene is not None
    (found,) = scene.obstacles
    np.testing.assert_allclose(found.place.position, [0.4, 0.05, 0.1], atol=1e-15)
    np.testing.assert_allclose(found.place.rotation[:, 0], [0, 1, 0], atol=1e-15)


def test_shapes_of_the_tool_are_in_the_frame_of_the_tip() -> None:
    arm = job(
        arm="{name: ur5e, tool: {shapes: {cylinders: "
        "[{name: torch, radius: 1 cm, length: 20 cm, at: [0, 0, 0.1]}]}}}"
    ).arm
    assert arm.shapes is not None and isinstance(arm, ac.SerialArm)
    torch = arm.shapes.shapes[-1]
    assert torch.tool and torch.link == 6 and torch.name == "torch"
    q = np.array([[0.3, -1.0, 1.2, -0.7, 0.4, 0.9]])
    # The tool frame of the bare arm is the tip: its forward kinematics are the oracle.
    point, turned = arm.pose(q)
    pose = link_poses(arm.chain, q)[0, 6]
    middle = pose[:, :3] @ torch.place.position + pose[:, 3]
    np.testing.assert_allclose(middle, point[0] + turned[0] @ [0, 0, 0.1], atol=1e-12)
    assert len(arm.shapes.shapes) == 8


def test_links_of_an_arm_get_more_shapes() -> None:
    arm = job(
        arm="{name: ur5e, shapes: {spheres: [{name: camera, link: wrist_1_link, radius: 4 cm},"
        "{name: plug, link: base, radius: 2 cm}, {name: hose, link: elbow_joint, radius: 1 cm}]}}"
    ).arm
    assert arm.shapes is not None
    more = {x.name: x for x in arm.shapes.shapes[-3:]}
    assert [more[x].link for x in ("camera", "plug", "hose")] == [4, 0, 3]
    assert not more["camera"].tool


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"scene": "scene: {boxes: [{name: a, size: [1, 0, 1]}]}"}, ["scene.boxes: a", "size"]),
        ({"scene": "scene: {spheres: [{name: a, radius: 0}]}"}, ["scene.spheres: a", "radius"]),
        (
            {"scene": "scene: {spheres: [{name: a, radius: 1, link: base}]}"},
            ["scene.spheres: a", "link"],
        ),
        (
            {"scene": "scene: {halfspaces: [{name: w, normal: [0, 0, 0]}]}"},
            ["scene.halfspaces: w", "length 0"],
        ),
        ({"scene": "scene: {meshes: [{name: m, file: no.stl}]}"}, ["scene.meshes: m", "no.stl"]),
        ({"scene": "scene: {files: [no.urdf]}"}, ["scene.files", "no.urdf"]),
        ({"scene": "scene: {files: [a.step]}"}, ["a.step", ".urdf"]),
        (
            {"scene": "scene: {spheres: [{name: a, radius: 1}, {name: a, radius: 2}]}"},
            ["Two obstacles", "'a'"],
        ),
        (
            {"arm": "{name: ur5e, tool: {shapes: {spheres: [{name: a, radius: 1, margin: 1}]}}}"},
            ["arm.tool.shapes.spheres: a", "margin"],
        ),
        (
            {"arm": "{name: ur5e, tool: {shapes: {halfspaces: [{name: a}]}}}"},
            ["arm.tool.shapes.halfspaces: a", "half-space"],
        ),
        (
            {"arm": "{name: ur5e, shapes: {spheres: [{name: a, radius: 1, link: wrist}]}}"},
            ["arm.shapes.spheres: a", "wrist_1_link", "'wrist'"],
        ),
        ({"arm": "{name: ur5e, srdf: no.srdf}"}, ["no.srdf"]),
    ],
)
def test_a_wrong_body_is_named_in_one_sentence(keys: dict[str, str], words: list[str]) -> None:
    with pytest.raises(InvalidInput) as caught:
        assert job(**keys).arm.shapes
    text = str(caught.value)
    assert all(x in text for x in words) and text.count(". ") == 0, text


def test_built_in_cells_in_space_stand_on_a_table(tmp_path: Path) -> None:
    (tmp_path / "line.csv").write_text("x,y,z\n0,0,0\n0.05,0,0\n")
    for name in set(cell_names()) - {"pmk3s"}:
        found = read_cell(name, tmp_path / "line.csv")
        assert found.scene is not None and found.arm.shapes is not None
        part, table = found.scene.obstacles
        assert isinstance(table.shape, HalfSpace) and part.fixed_to == "part"
        # The surface of the part is where the drawing lies.
        top = part.place.position + part.place.rotation @ [0, 0, 0.005]
        assert top[2] == pytest.approx(found.single_path(0.0)[2])
        last = {x.name for x in found.arm.shapes.shapes if x.link == found.arm.dof}
        assert set(part.allow) == {"tool", *last}
