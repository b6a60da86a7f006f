"""Collision elements of robot descriptions, and excluded pairs of SRDF files."""

import re

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.files.tables import refusals, rows

import armcontour as ac
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import Box, Capsule, Cylinder, Scene, Sphere
from armcontour.verification.clearance.body_pairs import REASON, Distances, pairs_of

WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
# A pan and a tilt joint, a fixed camera on the second link, a mesh on the third, and a gripper
# whose finger slides.
URDF = """<robot name="small">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="post">
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.03" length="0.3"/></geometry>
    </collision>
    <collision><origin xyz="0 0 0.35" rpy="0 1.5707963267948966 0"/>
      <geometry><capsule radius="0.02" length="0.1"/></geometry></collision>
  </link>
  <link name="camera"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <link name="beam"><collision><origin xyz="0.3 0 0"/><geometry>{beam}</geometry></collision></link>
  <link name="hand">{hand}</link>
  <link name="finger">
    <collision><geometry><box size="0.01 0.01 0.05"/></geometry></collision></link>
  <joint name="pan" type="revolute"><parent link="base"/><child link="post"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="post"/><child link="camera"/>
    <origin xyz="0 0.1 0.3" rpy="0 0 1.5707963267948966"/></joint>
  <joint name="tilt" type="revolute"><parent link="post"/><child link="beam"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1"/></joint>
  <joint name="wrist" type="fixed"><parent link="beam"/><child link="hand"/>
    <origin xyz="0.5 0 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/>
    <origin xyz="0.05 0 0"/><axis xyz="0 1 0"/><limit lower="0.01" upper="0.04"/></joint>
</robot>"""
MESH = '<mesh filename="{}"/>'


def described(folder, beam='<box size="0.4 0.05 0.05"/>', hand=""):
    file = folder / "small.urdf"
    file.write_text(URDF.format(beam=beam, hand=hand))
    return file


def loaded(file, **options):
    arm = ac.load_arm(file, tip="hand", **options)
    assert isinstance(arm, ac.SerialArm)
    return arm


def test_collision_shapes_are_at_the_poses_of_their_links(tmp_path):
    arm = loaded(described(tmp_path))
    shapes = [(x.link, x.name, x.tool, type(x.shape)) for x in arm.shapes.shapes]
    capsules = [(1, "post", False, Cylinder), (1, "post", False, Capsule)]
    assert sorted(shapes, key=lambda x: x[:2]) == [
        (0, "base", False, Box), (1, "camera", False, Sphere), *capsules, (2, "beam", False, Box),
        (2, "finger", True, Box),
    ]  # fmt: skip
    by_name = {x.name: x for x in arm.shapes.shapes}
    # At pan = 90 deg, tilt = 0: places written down by hand from the description.
    pose = link_poses(arm.chain, [[np.pi / 2, 0.0]])[0]
    # The finger is at the end of its range that is nearest to 0.
    places = {"camera": (-0.1, 0, 0.4), "beam": (0, 0.3, 0.5), "finger": (-0.01, 0.55, 0.5)}
    for name, place in places.items():
        x = by_name[name]
        center = pose[x.link][:, :3] @ x.place.position + pose[x.link][:, 3]
        np.testing.assert_allclose(center, place, atol=1e-12)
    # The round end of the capsule lies along x.
    assert isinstance(by_name["post"].shape, Capsule)
    np.testing.assert_allclose(by_name["post"].place.rotation[:, 2], [1, 0, 0], atol=1e-12)
    assert arm.shapes.source == "collision elements of small.urdf"
    # Links that are not below the base do not move.
    file = described(tmp_path)
    fixed = file.read_text().replace('name="pan" type="revolute"', 'name="pan" type="fixed"')
    file.write_text(fixed)
    shapes = {x.name: x for x in loaded(file, base="post").shapes.shapes}
    assert shapes["base"].link == 0 and set(shapes) >= {"post", "camera", "beam", "finger"}
    np.testing.assert_allclose(shapes["base"].place.position, [0, 0, -0.1], atol=1e-15)


def test_meshes_are_found_by_path_and_by_package(tmp_path):
    package = tmp_path / "small_robot"
    (package / "meshes").mkdir(parents=True)
    (package / "meshes" / "wedge.obj").write_text(WEDGE)
    for folder in (package / "urdf", tmp_path / "other_robot" / "urdf"):
        folder.mkdir(parents=True)
    name = "package://small_robot/"
    places = ((package, ""), (package / "urdf", name), (tmp_path / "other_robot" / "urdf", name))
    for folder, start in places:
        arm = loaded(described(folder, MESH.format(f"{start}meshes/wedge.obj")))
        beam = next(x for x in arm.shapes.shapes if x.name == "beam")
        assert not any("mesh" in x for x in arm.notes) and beam.shape.size == 0.2
        assert beam.shape.triangles is None and beam.exact.triangles is not None
    # The folder of a repository has another name than the package; its manifest names the package.
    (package / "package.xml").write_text('<package format="2"><name> maker_small </name></package>')
    arm = loaded(described(package / "urdf", MESH.format("package://maker_small/meshes/wedge.obj")))
    assert not any("mesh" in x for x in arm.notes)
    file = described(tmp_path, MESH.format("package://other/wedge.obj"))
    assert any("package://other/wedge.obj" in x for x in loaded(file).notes)
    # A missing mesh is only a note until the shapes are required.
    arm = loaded(described(tmp_path, MESH.format("no.stl")))
    assert any("meshes are missing" in x and "no.stl" in x for x in arm.notes)
    assert not arm.knows_shapes and arm.tool_position([[0.1, 0.2]]).shape == (1, 3)
    refusals(lambda x: x.shapes, [(arm, "link beam  ... 'no.stl', which does not exist")])


BAD = r"""
<box size="1 1"/> => link beam ... size must be 3 numbers
<torus/> => link beam ... must be a box ... 'torus'
=> link beam ... exactly one geometry
<mesh filename="http://example.org/a.stl"/> => http://example.org/a.stl ... does not exist
<mesh filename="package://[/a.stl"/> => package://[/a.stl ... does not exist
<mesh filename="small.dae"/> => small.dae ... Convert it to .stl or .obj
<mesh filename="small.obj" scale="1 x 1"/> => scale must be 3 numbers
<mesh filename="large.obj"/> => large.obj would be 200 m large ... unit: mm
"""


def test_invalid_geometry_is_refused_and_scales_are_read(tmp_path):
    (tmp_path / "large.obj").write_text(re.sub(r"0\.(\d)", r"\g<1>00", WEDGE))
    (tmp_path / "small.obj").write_text(WEDGE)
    refusals(lambda x: x.shapes, [(loaded(described(tmp_path, x)), y) for x, y in rows(BAD)])
    arm = loaded(described(tmp_path, '<mesh filename="large.obj" scale="0.001 0.001 -0.002"/>'))
    exact = next(x for x in arm.shapes.shapes if x.name == "beam").exact
    np.testing.assert_allclose(np.ptp(exact.points, axis=0), [0.1, 0.1, 0.4])
    assert exact.points[:, 2].min() == pytest.approx(-0.4)


SRDF = """<robot name="small">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <disable_collisions link1="base" link2="beam" reason="Never"/>
  <disable_collisions link1="base" link2="hand" reason="Never"/>
  <disable_collisions link1="camera" link2="finger"/>
</robot>"""


def names(pairs):
    return {frozenset((getattr(x, "name", x), getattr(y, "name", y))) for x, y in pairs}


def test_pairs_disabled_in_an_srdf_file_are_ignored_with_its_reasons(tmp_path):
    (tmp_path / "small.srdf").write_text(SRDF)
    file = described(tmp_path)
    bare = loaded(file)
    arm = loaded(file, srdf=tmp_path / "small.srdf")
    pairs = [names((x.first, x.second) for x in pairs_of(one, Scene())[0]) for one in (bare, arm)]
    assert pairs[0] - pairs[1] == names([("base", "beam"), ("camera", "finger")])
    reasons = {frozenset((x.first, x.second)): x.reason for x in pairs_of(arm, Scene())[1]}
    assert reasons[frozenset(("base", "beam"))] == "small.srdf: Never"
    assert reasons[frozenset(("camera", "finger"))] == "small.srdf: no reason given"


def test_links_that_an_srdf_file_misspells_are_noted(tmp_path):
    file = described(tmp_path)
    srdf = tmp_path / "small.srdf"
    srdf.write_text(SRDF)
    assert loaded(file, srdf=srdf).notes == loaded(file).notes
    srdf.write_text(SRDF.replace('link2="beam"', 'link2="beams"').replace("finger", "gripper"))
    (note,) = set(loaded(file, srdf=srdf).notes) - set(loaded(file).notes)
    assert "'beams' (did you mean beam?)" in note and "'gripper'" in note and "small.urdf" in note


NO_SRDF = """
<mujoco/> => SRDF ... <mujoco>
<robot><disable_collisions link1="base"/></robot> => two different links, link1 and link2
<robot><disable_collisions link1="a" link2="b"/></robot> => no link of the arm ... a, b ... base
"""


def test_a_file_of_another_format_is_refused_as_srdf(tmp_path):
    def read(text):
        (tmp_path / "small.srdf").write_text(text)
        return loaded(described(tmp_path), srdf=tmp_path / "small.srdf").shapes

    refusals(read, NO_SRDF)


@needs_dynamics
def test_pairs_are_ignored_only_if_they_always_touch(tmp_path):
    # A hand with a ball that reaches the post in every posture, and a finger that is in the way of
    # the camera with all joints at 0 only.
    hand = '<collision><origin xyz="-0.5 0 0"/><geometry><sphere radius="0.12"/></geometry>'
    file = described(tmp_path, hand=hand + "</collision>")
    file.write_text(file.read_text().replace('xyz="0 0.1 0.3"', 'xyz="0.55 0.01 0.4"'))
    arm = loaded(file)
    reasons = {frozenset((x.first, x.second)): x.reason for x in arm.shapes.left_out}
    assert reasons == {frozenset(("post", "hand")): REASON}
    pairs, _ = pairs_of(arm, Scene())
    every = np.arange(len(pairs))
    distances = Distances(arm.chain, pairs).measure(np.zeros((1, 2)), 0 * every, every)
    touching = names((x.first, x.second) for x, d in zip(pairs, distances, strict=True) if d <= 0)
    assert touching == names([("camera", "finger")])
