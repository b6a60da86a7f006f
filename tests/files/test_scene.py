"""Obstacles of job files, descriptions and MoveIt scenes; meshes."""

import itertools
import struct

import numpy as np
import pytest
from tests.files.tables import refusals, rows

from armcontour.core.errors import InvalidInput
from armcontour.files.job_file import cell_names, parse_job, read_cell
from armcontour.files.mesh_file import read_mesh
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere

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
TETRAHEDRON = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def job(scene="", arm="ur5e", folder=None):
    return parse_job(JOB.format(arm=arm, scene=scene), folder=folder)


SCENE = """
scene:
  obstacles:
    - {type: box, name: vise, size: [0.1, 0.2, 5 cm], at: [0.4, 0, 10 mm], rpy: [0, 0, 90 deg]}
    - {type: cylinder, name: post, radius: 20 mm, length: 0.5, margin: 1 cm, allow: [tool, forearm]}
    - {type: sphere, name: ball, radius: 3 cm, quaternion: [0, 0, 0, 1]}
    - {type: capsule, name: hose, radius: 1 cm, length: 10 cm, fixed_to: part}
    - {type: halfspace, name: table}
    - {type: halfspace, name: wall, at: [0, 1, 0], normal: [0, -2, 0]}
    - {type: mesh, name: clamp, file: clamp.obj, unit: mm}
  margins: {environment: 8 mm}
"""


def test_every_kind_of_obstacle_is_read(tmp_path):
    (tmp_path / "clamp.obj").write_text(TETRAHEDRON)
    scene = job(SCENE, folder=tmp_path).scene
    kinds = [Box, Cylinder, Sphere, Capsule, HalfSpace, HalfSpace, Mesh]
    assert [type(x.shape) for x in scene.obstacles] == kinds
    vise, post, _, hose, _, wall, clamp = scene.obstacles
    np.testing.assert_allclose(vise.shape.size, [0.1, 0.2, 0.05])
    np.testing.assert_allclose(vise.place.position, [0.4, 0, 0.01])
    np.testing.assert_allclose(vise.place.rotation[:, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(wall.place.rotation[:, 2], [0, -1, 0], atol=1e-15)
    assert post.margin == 0.01 and post.allow == ("tool", "forearm")
    assert hose.fixed_to == "part" and vise.fixed_to == "base"
    assert clamp.name == "clamp" and clamp.shape.size == pytest.approx(0.1)
    assert (scene.margins.environment, scene.margins.own) == (0.008, 0.002)


def test_obstacles_fixed_to_the_part_move_with_the_drawing(tmp_path):
    (tmp_path / "line.csv").write_text("x,y,z\n0,0,0\n0.05,0,0\n")
    sheet = "{type: box, name: sheet, size: [0.1, 0.1, 0.01], at: [0.05, 0, 0], fixed_to: part}"
    text = JOB.format(arm="ur5e", scene=f"scene: {{obstacles: [{sheet}]}}")
    points = text[text.index("  points:") : text.index("  orientation")]
    frame = "  frame: {position: [0.4, 0, 0.1], rpy: [0, 0, 90 deg]}\n"
    (tmp_path / "cell.yaml").write_text(text.replace(points, frame))
    scene = read_cell(tmp_path / "cell.yaml", tmp_path / "line.csv").scene
    (obstacle,) = scene.obstacles
    np.testing.assert_allclose(obstacle.place.position, [0.4, 0.05, 0.1], atol=1e-15)
    np.testing.assert_allclose(obstacle.place.rotation[:, 0], [0, 1, 0], atol=1e-15)


def test_links_of_an_arm_and_its_tool_get_shapes():
    arm = job(
        arm="{name: ur5e, tool: {shapes: "
        "[{type: cylinder, name: torch, radius: 1 cm, length: 20 cm, at: [0, 0, 0.1]}]}}"
    ).arm
    torch = arm.shapes.shapes[-1]
    assert torch.tool and torch.link == 6 and torch.name == "torch"
    q = np.array([[0.3, -1.0, 1.2, -0.7, 0.4, 0.9]])
    # The tool frame of the bare arm is the tip: its forward kinematics are the oracle.
    point, turned = arm.pose(q)
    pose = link_poses(arm.chain, q)[0, 6]
    middle = pose[:, :3] @ torch.place.position + pose[:, 3]
    np.testing.assert_allclose(middle, point[0] + turned[0] @ [0, 0, 0.1], atol=1e-12)
    assert len(arm.shapes.shapes) == 8
    arm = job(
        arm="{name: ur5e, shapes: [{type: sphere, name: camera, link: wrist_1_link, radius: 4 cm},"
        "{type: sphere, name: plug, link: base, radius: 2 cm},"
        "{type: sphere, name: hose, link: elbow_joint, radius: 1 cm}]}"
    ).arm
    more = {x.name: x for x in arm.shapes.shapes[-3:]}
    assert [more[x].link for x in ("camera", "plug", "hose")] == [4, 0, 3]
    assert not more["camera"].tool


BAD = """
scene => {type: box, name: a, size: [1, 0, 1]} => scene.obstacles: a ... size
scene => {type: box, name: a} => scene.obstacles: a ... box requires ... size
scene => {type: box, name: a, size: [1, 1, 1], length: 1} => scene.obstacles: a ... no key length
scene => {type: cone, name: a} => scene.obstacles ... cylinder ... cone
scene => {type: sphere, name: a, radius: 0} => scene.obstacles ... radius
scene => {type: halfspace, name: w, normal: [0, 0, 0]} => scene.obstacles: w ... must not be zero
scene => {type: mesh, name: m, file: no.stl} => scene.obstacles: m ... no.stl
scene => {type: sphere, name: a, radius: 1}, {type: halfspace, name: a} => Two obstacles ... 'a'
tool => {type: halfspace, name: a} => arm.tool.shapes: a ... half-space
arm => {type: sphere, name: a, radius: 1, link: wrist} => arm.shapes: a ... wrist_1_link ... 'w
"""


def test_an_invalid_body_is_refused_with_its_name():
    keys = {
        "scene": ("scene", "scene: {obstacles: [%s]}"),
        "tool": ("arm", "{name: ur5e, tool: {shapes: [%s]}}"),
        "arm": ("arm", "{name: ur5e, shapes: [%s]}"),
    }

    def shapes(row):
        key, text = keys[row[0]]
        return job(**{key: text % row[1]}).arm.shapes

    refusals(shapes, [((x, y), words) for x, y, words in rows(BAD)], without=". ")
    with pytest.raises(InvalidInput, match="no.srdf"):
        assert job(arm="{name: ur5e, srdf: no.srdf}").arm.shapes


def test_built_in_cells_in_space_have_a_floor(tmp_path):
    (tmp_path / "line.csv").write_text("x,y,z\n0,0,0\n0.05,0,0\n")
    for name in set(cell_names()) - {"pmk3s", "ur10e_positioner"}:
        cell = read_cell(name, tmp_path / "line.csv")
        assert cell.scene is not None and cell.arm.shapes is not None
        part, table = cell.scene.obstacles
        assert isinstance(table.shape, HalfSpace) and part.fixed_to == "part"
        # The surface of the part is where the drawing lies.
        top = part.place.position + part.place.rotation @ [0, 0, 0.005]
        assert top[2] == pytest.approx(cell.program.path(0.0)[2])
        # Nothing may touch the part; the nozzle ends above it, its tip is the tool point.
        (nozzle,) = (x for x in cell.arm.shapes.shapes if x.tool)
        assert not part.allow and nozzle.name == "nozzle"
        assert cell.arm.chain.tool.position[2] == pytest.approx(0.12)


# A box of 0.2 x 0.3 x 0.4 m, as corners and 12 triangles.
CORNERS = np.array(list(itertools.product((0, 0.2), (0, 0.3), (0, 0.4))))
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [x for a, b, c, d in FACES for x in ((a, b, c), (a, c, d))]


def binary(corners=CORNERS, header=b"made here"):
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[list(x)].ravel().tolist(), 0) for x in TRIANGLES]
    return header.ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def ascii_stl(corners=CORNERS):
    lines = ["solid box"]
    for x in TRIANGLES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"  vertex {a:.9g} {b:.9g} {c:.9g}" for a, b, c in corners[list(x)]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"])


def obj(corners=CORNERS):
    vertices = [f"v {a} {b} {c}" for a, b, c in corners]
    faces = ["f " + " ".join(f"{k + 1}/1/{k + 1}" for k in x) for x in FACES]
    return "\n".join(["# a box", "o box", *vertices, "vn 0 0 1", "g sides", *faces])


def test_a_box_is_read_from_every_format(tmp_path):
    for name, content in (
        ("binary.STL", binary()),
        # Many programs begin binary files as if they were text.
        ("solid.STL", binary(header=b"solid box")),
        ("ascii.STL", ascii_stl().encode()),
        ("box.obj", obj().encode()),
    ):
        (tmp_path / name).write_bytes(content)
        mesh = read_mesh(tmp_path / name)
        assert len(mesh.points) == 8 and len(mesh.triangles) == 12
        found_corners = np.array(sorted(np.round(mesh.points, 7).tolist()))
        np.testing.assert_allclose(found_corners, np.array(sorted(CORNERS.tolist())), atol=1e-7)
        # The volume by the divergence theorem: all triangles look outwards, and none is missing.
        a, b, c = mesh.points[mesh.triangles.T]
        volume = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
        assert volume == pytest.approx(0.2 * 0.3 * 0.4, rel=1e-6)


def test_units_and_scales_of_meshes_are_read(tmp_path):
    large = tmp_path / "large.stl"
    small = tmp_path / "small.stl"
    large.write_bytes(binary(CORNERS * 1000))
    small.write_bytes(binary(CORNERS / 1000))
    assert read_mesh(large, unit="mm").size == pytest.approx(0.4)
    assert read_mesh(large, scale=1e-3).size == pytest.approx(0.4)
    assert read_mesh(large, scale=[1e-3, 1e-3, 2e-3]).size == pytest.approx(0.8)
    # A specified unit is used.
    assert read_mesh(small, unit="m").size == pytest.approx(4e-4)
    table = [
        ((large,), "400 m large ... unit: mm"),
        ((small,), "0.0004 m large ... unit: mm"),
        ((small, "s"), "must be a unit of length such as mm, but is 's'"),
    ]
    refusals(lambda x: read_mesh(x[0], **({"unit": x[1]} if x[1:] else {})), table)


BAD_MESHES = [
    ("a.stl", binary()[:-1], "a.stl has no triangles, is incomplete"),
    ("a.stl", b"<html>" * 50, "no triangles"),
    ("a.stl", binary(np.where(CORNERS == 0.3, np.nan, CORNERS)), "not finite"),
    ("a.stl", ascii_stl().rsplit("vertex", 1)[0].encode(), "no triangles"),
    ("a.obj", b"", "no triangles"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 x 0\nf 1 2 3\n", "does not have the format obj"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", "does not have the format obj"),
    ("a.dae", b"<COLLADA/>", ".stl or .obj"),
]


def test_invalid_meshes_are_refused_in_one_sentence(tmp_path):
    def read(row):
        (tmp_path / row[0]).write_bytes(row[1])
        return read_mesh(tmp_path / row[0])

    refusals(read, [((name, content), name, words) for name, content, words in BAD_MESHES])
