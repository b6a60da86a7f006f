"""Collision elements of robot descriptions, and files of pairs that may touch (SRDF)."""

import re
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms.chain import link_poses
from armcontour.clearance.distances import Distances
from armcontour.clearance.pairs import pairs_of
from armcontour.clearance.touching import REASON
from armcontour.errors import InvalidInput
from armcontour.scene import Box, Capsule, Cylinder, Mesh, Scene, Sphere

WEDGE = """v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.2
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
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


def described(folder: Path, beam: str = '<box size="0.4 0.05 0.05"/>', hand: str = "") -> Path:
    file = folder / "small.urdf"
    file.write_text(URDF.format(beam=beam, hand=hand))
    return file


def loaded(file: Path, **options: object) -> ac.SerialArm:
    arm = ac.load_arm(file, tip="hand", **options)  # type: ignore[arg-type]
    assert isinstance(arm, ac.SerialArm)
    return arm


def test_every_link_has_its_shapes_where_it_is(tmp_path: Path) -> None:
    arm = loaded(described(tmp_path))
    assert arm.shapes is not None and arm.chain is not None
    found = [(x.name, x.link, type(x.shape), x.tool) for x in arm.shapes.shapes]
    assert sorted(found, key=lambda x: (x[1], x[0])) == [
        ("base", 0, Box, False),
        ("camera", 1, Sphere, False),
        ("post", 1, Cylinder, False),
        ("post", 1, Capsule, False),
        ("beam", 2, Box, False),
        ("finger", 2, Box, True),
    ]
    by_name = {x.name: x for x in arm.shapes.shapes}
    # At pan = 90 deg, tilt = 0: places written down by hand from the description.
    pose = link_poses(arm.chain, [[np.pi / 2, 0.0]])[0]
    for name, place in (
        ("camera", (-0.1, 0, 0.4)),
        ("beam", (0, 0.3, 0.5)),
        # The finger stands at the end of its range that is nearest to 0.
        ("finger", (-0.01, 0.55, 0.5)),
    ):
        x = by_name[name]
        at = pose[x.link][:, :3] @ x.place.position + pose[x.link][:, 3]
        np.testing.assert_allclose(at, place, atol=1e-12)
    # The round end of the capsule lies along x.
    assert isinstance(by_name["post"].shape, Capsule)
    np.testing.assert_allclose(by_name["post"].place.rotation[:, 2], [1, 0, 0], atol=1e-12)
    assert arm.shapes.source == "collision elements of small.urdf"


def test_links_that_the_base_does_not_carry_stand_still(tmp_path: Path) -> None:
    file = described(tmp_path)
    file.write_text(
        file.read_text().replace('name="pan" type="revolute"', 'name="pan" type="fixed"')
    )
    arm = loaded(file, base="post")
    assert arm.shapes is not None
    base = next(x for x in arm.shapes.shapes if x.name == "base")
    assert base.link == 0
    np.testing.assert_allclose(base.place.position, [0, 0, -0.1], atol=1e-15)
    assert {x.name for x in arm.shapes.shapes} >= {"base", "post", "camera", "beam", "finger"}


@pytest.mark.parametrize("name", ["meshes/wedge.obj", "package://small_robot/meshes/wedge.obj"])
def test_meshes_are_found_by_path_and_by_package(tmp_path: Path, name: str) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "package.xml").write_text("<package><name>small_robot</name></package>")
    (tmp_path / "meshes" / "wedge.obj").write_text(WEDGE)
    (tmp_path / "urdf").mkdir()
    folder = tmp_path / ("urdf" if name.startswith("package") else ".")
    arm = loaded(described(folder, MESH.format(name)))
    assert arm.shapes is not None and not any("mesh" in x for x in arm.notes)
    beam = next(x for x in arm.shapes.shapes if x.name == "beam")
    assert isinstance(beam.shape, Mesh) and beam.shape.triangles is None
    assert isinstance(beam.exact, Mesh) and beam.exact.triangles is not None
    assert beam.shape.size == 0.2


def test_packages_may_be_told(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "wedge.obj").write_text(WEDGE)
    file = described(tmp_path, MESH.format("package://other/wedge.obj"))
    assert any("package://other/wedge.obj" in x for x in loaded(file).notes)
    arm = loaded(file, packages={"other": tmp_path / "elsewhere"})
    assert arm.notes == loaded(described(tmp_path)).notes and arm.shapes is not None


def test_a_mesh_that_is_not_there_is_a_note_until_clearance_is_asked_for(tmp_path: Path) -> None:
    arm = loaded(described(tmp_path, MESH.format("no.stl")))
    assert any("meshes are not there" in x and "no.stl" in x for x in arm.notes)
    assert not arm.knows_shapes
    assert arm.forward([[0.1, 0.2]]).shape == (1, 3)
    with pytest.raises(InvalidInput, match=r"link beam .*'no\.stl', which is not there"):
        _ = arm.shapes


@pytest.mark.parametrize(
    ("beam", "words"),
    [
        ('<box size="1 1"/>', "link beam.*three numbers as its size"),
        ('<sphere radius="-1"/>', "radius of a sphere"),
        ('<cylinder radius="1"/>', "link beam.*number as length of its cylinder"),
        ("<torus/>", "link beam.*'torus'.*only boxes"),
        ("", "link beam.*one geometry"),
        (MESH.format("http://example.org/a.stl"), "http://example.org/a.stl.*not there"),
        (MESH.format("package://[/a.stl"), r"package://\[/a\.stl.*not there"),
        (MESH.format(""), "the mesh ''.*not there"),
        (MESH.format("small.dae"), r"small\.dae.*give it as \.stl or \.obj"),
        ('<mesh filename="small.obj" scale="1 x 1"/>', "three numbers as its scale"),
        ('<mesh filename="large.obj"/>', r"large\.obj would be 200 m large.* unit: mm"),
        ('<mesh filename="large.obj" scale="1 1 1"/>', r"large\.obj would be 200 m large"),
    ],
)
def test_geometry_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, beam: str, words: str
) -> None:
    (tmp_path / "large.obj").write_text(re.sub(r"0\.(\d)", r"\g<1>00", WEDGE))
    (tmp_path / "small.obj").write_text(WEDGE)
    arm = loaded(described(tmp_path, beam))
    with pytest.raises(InvalidInput, match=words):
        _ = arm.shapes


def test_scales_of_meshes_are_kept(tmp_path: Path) -> None:
    (tmp_path / "large.obj").write_text(re.sub(r"0\.(\d)", r"\g<1>00", WEDGE))
    beam = '<mesh filename="large.obj" scale="0.001 0.001 -0.002"/>'
    arm = loaded(described(tmp_path, beam))
    assert arm.shapes is not None
    exact = next(x for x in arm.shapes.shapes if x.name == "beam").exact
    assert isinstance(exact, Mesh)
    np.testing.assert_allclose(np.ptp(exact.points, axis=0), [0.1, 0.1, 0.4])
    assert exact.points[:, 2].min() == pytest.approx(-0.4)


SRDF = """<robot name="small">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <disable_collisions link1="base" link2="beam" reason="Never"/>
  <disable_collisions link1="base" link2="hand" reason="Never"/>
  <disable_collisions link1="camera" link2="finger"/>
</robot>"""


def test_pairs_of_an_srdf_file_are_left_out_with_its_reasons(tmp_path: Path) -> None:
    (tmp_path / "small.srdf").write_text(SRDF)
    file = described(tmp_path)
    bare, arm = loaded(file), loaded(file, srdf=tmp_path / "small.srdf")
    looked_at = [
        {frozenset((x.first.name, x.second.name)) for x in pairs_of(one, Scene())[0]}
        for one in (bare, arm)
    ]
    assert looked_at[0] - looked_at[1] == {
        frozenset(("base", "beam")),
        frozenset(("camera", "finger")),
    }
    reasons = {frozenset((x.first, x.second)): x.reason for x in pairs_of(arm, Scene())[1]}
    assert reasons[frozenset(("base", "beam"))] == "small.srdf: Never"
    assert reasons[frozenset(("camera", "finger"))] == "small.srdf: no reason given"


def test_defaults_of_an_srdf_file_are_kept(tmp_path: Path) -> None:
    (tmp_path / "small.srdf").write_text(
        '<robot name="small"><disable_default_collisions link="camera"/>'
        '<enable_collisions link1="finger" link2="camera"/></robot>'
    )
    arm = loaded(described(tmp_path), srdf=tmp_path / "small.srdf")
    assert arm.shapes is not None
    found = {frozenset((x.first, x.second)) for x in arm.shapes.left_out}
    assert found == {frozenset(("camera", x)) for x in ("base", "post", "beam")}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "XML"),
        ("<mujoco/>", "SRDF.*<mujoco>"),
        ('<robot><disable_collisions link1="base"/></robot>', "two links, link1 and link2"),
        (
            '<robot><disable_collisions link1="a" link2="b"/></robot>',
            "names no link of the arm.*a, b.*base",
        ),
    ],
)
def test_a_file_that_is_no_srdf_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "small.srdf").write_text(text)
    arm = loaded(described(tmp_path), srdf=tmp_path / "small.srdf")
    with pytest.raises(InvalidInput, match=words):
        _ = arm.shapes


def test_pairs_that_always_touch_are_left_out_and_others_that_touch_at_0_are_not(
    tmp_path: Path,
) -> None:
    # A hand with a ball that reaches the post in every posture, and a finger that is in the way of
    # the camera with all joints at 0 only.
    hand = (
        '<collision><origin xyz="-0.5 0 0"/><geometry><sphere radius="0.12"/></geometry>'
        "</collision>"
    )
    file = described(tmp_path, hand=hand)
    file.write_text(file.read_text().replace('xyz="0 0.1 0.3"', 'xyz="0.55 0.01 0.4"'))
    arm = loaded(file)
    assert arm.shapes is not None and arm.chain is not None
    left = {frozenset((x.first, x.second)): x.reason for x in arm.shapes.left_out}
    assert left == {frozenset(("post", "hand")): REASON}
    pairs, _ = pairs_of(arm, Scene())
    every = np.arange(len(pairs))
    at = Distances(arm.chain, pairs).measure(np.zeros((1, 2)), 0 * every, every)
    touching = {
        frozenset((x.first.name, x.second.name)) for x, d in zip(pairs, at, strict=True) if d <= 0
    }
    assert touching == {frozenset(("camera", "finger"))}
