"""Files of obstacles: descriptions of cells, and scenes of MoveIt in both dialects."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.io.scene_files import read_scene_file, upright
from armcontour.scene import Box, Cylinder, HalfSpace, Mesh, Obstacle, Sphere

CELL = """<robot name="cell">
  <link name="world"/>
  <link name="table">
    <collision><origin xyz="0 0 -0.05"/><geometry><box size="2 1 0.1"/></geometry></collision>
    <collision><origin xyz="0.9 0 -0.5"/><geometry><cylinder radius="0.05" length="0.8"/></geometry>
    </collision>
  </link>
  <link name="door"><collision><geometry><box size="1 0.02 1"/></geometry></collision></link>
  <joint name="stand" type="fixed"><parent link="world"/><child link="table"/>
    <origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/></joint>
  <joint name="hinge" type="revolute"><parent link="table"/><child link="door"/>
    <origin xyz="1 0 0.5"/><axis xyz="0 0 1"/><limit lower="0" upper="1.5" velocity="1"/></joint>
</robot>"""
SHAPES = """box
0.1 0.2 0.3
{0}
0 0 0 0
cylinder
0.05 0.4
{0}
0 0 0 0"""
# A pose 0.5 m along x, turned by 90 deg about z.
POSE = "0.5 0 0\n0 0 0.70710678 0.70710678"
HERE = "0 0 0\n0 0 0 1"
OLD = (
    f"(noname)\n* fixture one\n2\n{SHAPES.format(POSE)}\n"
    f"* ball\n1\nsphere\n0.1\n{HERE}\n0 0 0 0\n.\n"
)
NEW = (
    f"(noname)+\n* fixture one\n{POSE}\n2\n{SHAPES.format(HERE)}\n1\ntop\n0 0 0.1\n0 0 0 1\n"
    f"* ball\n{HERE}\n1\nsphere\n0.1\n{HERE}\n1 0 0 1\n0\n.\n"
)


def read(folder: Path, text: str) -> tuple[Obstacle, ...]:
    (folder / "a.scene").write_text(text)
    return read_scene_file(folder / "a.scene")


def test_links_of_a_cell_are_obstacles_where_they_stand(tmp_path: Path) -> None:
    (tmp_path / "cell.urdf").write_text(CELL)
    found = {x.name: x for x in read_scene_file(tmp_path / "cell.urdf")}
    assert list(found) == ["table", "table 2", "door"]
    for name, place in (
        ("table", (0.5, 0, -0.05)),
        ("table 2", (0.5, 0.9, -0.5)),
        ("door", (0.5, 1, 0.5)),
    ):
        np.testing.assert_allclose(found[name].place.position, place, atol=1e-12)
    np.testing.assert_allclose(found["door"].place.rotation[:, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("text", [OLD, NEW])
def test_both_dialects_say_the_same(tmp_path: Path, text: str) -> None:
    box, cylinder, ball = read(tmp_path, text)
    assert (box.name, cylinder.name, ball.name) == ("fixture one", "fixture one 2", "ball")
    assert isinstance(box.shape, Box) and isinstance(cylinder.shape, Cylinder)
    assert isinstance(ball.shape, Sphere) and ball.shape.radius == 0.1
    np.testing.assert_allclose(box.shape.size, [0.1, 0.2, 0.3])
    assert (cylinder.shape.radius, cylinder.shape.length) == (0.05, 0.4)
    for x in (box, cylinder):
        np.testing.assert_allclose(x.place.position, [0.5, 0, 0], atol=1e-8)
        np.testing.assert_allclose(x.place.rotation[:, 0], [0, 1, 0], atol=1e-8)


def test_poses_of_an_object_and_of_its_shapes_are_joined(tmp_path: Path) -> None:
    text = f"s\n* a\n{POSE}\n1\nbox\n1 1 1\n0.1 0.2 0\n0 0 0 1\n0 0 0 0\n0\n.\n"
    (found,) = read(tmp_path, text)
    # The shape's (0.1, 0.2) is turned by 90 deg.
    np.testing.assert_allclose(found.place.position, [0.5 - 0.2, 0.1, 0], atol=1e-8)


def test_planes_are_half_spaces_and_cones_are_held(tmp_path: Path) -> None:
    text = (
        f"s\n* floor\n1\nplane\n0 0 2 0.4\n{HERE}\n0 0 0 0\n"
        f"* cone\n1\ncone\n0.1 0.4\n{HERE}\n0 0 0 0\n"
        f"* wedge\n1\nmesh\n4 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 2 1\n0 1 3\n0 3 2\n1 2 3\n{HERE}\n"
        "0 0 0 0\n.\n"
    )
    floor, cone, wedge = read(tmp_path, text)
    assert isinstance(floor.shape, HalfSpace)
    # 2 z + 0.4 = 0.
    np.testing.assert_allclose(floor.place.position, [0, 0, -0.2])
    np.testing.assert_allclose(floor.place.rotation[:, 2], [0, 0, 1])
    assert isinstance(cone.shape, Mesh) and isinstance(wedge.shape, Mesh)
    assert cone.shape.points[-1].tolist() == [0, 0, 0.2]
    # All edges of the pyramid's base are outside the circle, and its corners by 0.5 %.
    base = cone.shape.points[:-1, :2]
    middles = (base + np.roll(base, 1, axis=0)) / 2
    assert np.linalg.norm(middles, axis=1).min() == pytest.approx(0.1)
    assert np.linalg.norm(base, axis=1).max() < 0.1005
    assert wedge.shape.triangles is not None and wedge.shape.triangles.tolist()[3] == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "ends early: \\* and the name"),
        ("name\n", "ends early"),
        ("name\nbox\n", r"line 2: \* and the name .* not 'box'"),
        (NEW.replace("\n.\n", "\n"), "ends early"),
        (
            NEW.replace("box", "torus"),
            r"line 6: box, sphere, cylinder, cone, plane or mesh.* not 'torus'",
        ),
        (NEW.replace("0.1 0.2 0.3", "0.1 0.2"), r"line 7: x and y and z of a box, 3 n.*'0.1 0.2'"),
        (NEW.replace("0.1 0.2 0.3", "0.1 nan 0.3"), "line 7"),
        (NEW.replace("0.1 0.2 0.3", "0.1 -1 0.3"), "line 7.*size of a box"),
        (NEW.replace("0 0 0.70710678 0.70710678", "0 0 1 1"), "line 4.*quaternion.*length 1"),
        (NEW.replace("\n2\nbox", "\n1e9\nbox"), "number of shapes, from 0 to"),
        (f"s\n* m\n1\nmesh\n3 1\n{HERE}\n.\n", "line 5: 4 to 1,000,000 points"),
        (f"s\n* m\n1\nplane\n0 0 0 1\n{HERE}\n0 0 0 0\n.", "line 5: a plane whose normal"),
    ],
)
def test_a_scene_of_another_form_is_refused_with_its_line(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        read(tmp_path, text)
    assert "a.scene" in str(caught.value)


def test_a_description_without_collision_elements_is_no_cell(tmp_path: Path) -> None:
    (tmp_path / "cell.urdf").write_text('<robot name="cell"><link name="world"/></robot>')
    with pytest.raises(InvalidInput, match="no collision elements"):
        read_scene_file(tmp_path / "cell.urdf")
    (tmp_path / "cell.urdf").write_text(CELL.replace('radius="0.05"', 'radius="-1"'))
    with pytest.raises(InvalidInput, match=r"cell\.urdf.*radius"):
        read_scene_file(tmp_path / "cell.urdf")


UNIT = st.floats(-1, 1)


@given(UNIT, UNIT, UNIT)
def test_upright_turns_z_and_nothing_else(x: float, y: float, z: float) -> None:
    size = np.linalg.norm([x, y, z])
    if size < 1e-6:
        return
    turned = upright(np.array([x, y, z]) / size)
    np.testing.assert_allclose(turned[:, 2] * size, [x, y, z], atol=1e-9)
    np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1)
