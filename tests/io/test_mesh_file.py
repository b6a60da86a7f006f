"""Meshes of bodies: STL and OBJ, their units, and what is no mesh."""

import struct
from pathlib import Path

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.io import mesh_file
from armcontour.io.mesh_file import read_mesh

# A box of 0.2 x 0.3 x 0.4 m, as corners and 12 triangles.
CORNERS = np.array([[x, y, z] for x in (0, 0.2) for y in (0, 0.3) for z in (0, 0.4)])
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [x for a, b, c, d in FACES for x in ((a, b, c), (a, c, d))]


def binary(corners: np.ndarray = CORNERS, header: bytes = b"made here") -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[list(x)].ravel().tolist(), 0) for x in TRIANGLES]
    return header.ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def ascii_stl(corners: np.ndarray = CORNERS) -> str:
    lines = ["solid box"]
    for x in TRIANGLES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"  vertex {a:.9g} {b:.9g} {c:.9g}" for a, b, c in corners[list(x)]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"])


def obj(corners: np.ndarray = CORNERS) -> str:
    vertices = [f"v {a} {b} {c}" for a, b, c in corners]
    faces = ["f " + " ".join(f"{k + 1}/1/{k + 1}" for k in x) for x in FACES]
    return "\n".join(["# a box", "o box", *vertices, "vn 0 0 1", "g sides", *faces])


@pytest.fixture(params=["binary", "solid", "ascii", "obj"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    name = tmp_path / ("box.obj" if request.param == "obj" else "box.STL")
    name.write_bytes(
        {
            "binary": binary(),
            # Many programs begin binary files as if they were text.
            "solid": binary(header=b"solid box"),
            "ascii": ascii_stl().encode(),
            "obj": obj().encode(),
        }[request.param]
    )
    return name


def test_a_box_is_read_from_every_format(file: Path) -> None:
    found = read_mesh(file)
    assert found.triangles is not None and len(found.points) == 8 and len(found.triangles) == 12
    found_corners = np.array(sorted(np.round(found.points, 7).tolist()))
    np.testing.assert_allclose(found_corners, np.array(sorted(CORNERS.tolist())), atol=1e-7)
    # The volume by the divergence theorem: all triangles look outwards, and none is missing.
    a, b, c = found.points[found.triangles.T]
    volume = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
    assert volume == pytest.approx(0.2 * 0.3 * 0.4, rel=1e-6)


def test_units_and_scales(tmp_path: Path) -> None:
    file = tmp_path / "box.stl"
    file.write_bytes(binary(CORNERS * 1000))
    assert read_mesh(file, unit="mm").size == pytest.approx(0.4)
    assert read_mesh(file, scale=1e-3).size == pytest.approx(0.4)
    assert read_mesh(file, scale=[1e-3, 1e-3, 2e-3]).size == pytest.approx(0.8)
    with pytest.raises(InvalidInput, match=r"400 m large.* unit: mm .* 0\.4 m"):
        read_mesh(file)
    file.write_bytes(binary(CORNERS / 1000))
    with pytest.raises(InvalidInput, match=r"0\.0004 m large.* unit: km .* 0\.4 m"):
        read_mesh(file)
    # Whoever says the unit is believed.
    assert read_mesh(file, unit="m").size == pytest.approx(4e-4)
    with pytest.raises(InvalidInput, match="unit 's', which is no unit of length"):
        read_mesh(file, unit="s")


def test_negative_indices_and_polygons_of_obj(tmp_path: Path) -> None:
    file = tmp_path / "box.obj"
    text = obj().split("vn")[0] + "\n".join("f " + " ".join(str(k - 8) for k in x) for x in FACES)
    file.write_text(text)
    found = read_mesh(file)
    assert found.triangles is not None and len(found.triangles) == 12


def test_triangles_without_an_area_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "box.obj"
    file.write_text(obj() + "\nf 1 1 2\n")
    found = read_mesh(file)
    assert found.triangles is not None and len(found.triangles) == 12
    file.write_text(obj().split("vn")[0] + "f 1 1 2\nf 3 4 3\n")
    with pytest.raises(InvalidInput, match=r"No triangle .* has an area"):
        read_mesh(file)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.stl", b"", "ends early"),
        ("a.stl", binary()[:-1], "ends early.*12 triangles take 684 bytes, and it has 683"),
        ("a.stl", b"x" * 80 + bytes(4), "no triangles"),
        ("a.stl", b"<html>" * 50, "no STL file"),
        ("a.stl", binary(np.where(CORNERS == 0.3, np.nan, CORNERS)), "Triangle 1 .*no finite"),
        ("a.stl", ascii_stl().replace("0.400000006", "nan").replace("0.4", "nan").encode(), "line"),
        ("a.stl", ascii_stl().rsplit("vertex", 1)[0].encode(), "within a triangle.* 35 corners"),
        ("a.obj", b"", "no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 x 0\nf 1 2 3\n", "line 3.*three finite numbers.*'0 x 0'"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3.*vertex '3'.* 2 before it"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3.*at least 3"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "plane|4 points"),
        ("a.dae", b"<COLLADA/>", r"\.stl or \.obj"),
    ],
)
def test_what_is_no_mesh_is_refused_in_a_sentence(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=words) as caught:
        read_mesh(tmp_path / name)
    assert name in str(caught.value)


def test_missing_files_and_too_many_triangles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InvalidInput, match=r"no mesh .*none\.stl"):
        read_mesh(tmp_path / "none.stl")
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 11)
    for name, content in (("a.stl", binary()), ("b.stl", ascii_stl().encode())):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidInput, match="12 triangles, more than the 11"):
            read_mesh(tmp_path / name)
    (tmp_path / "a.obj").write_text(obj())
    with pytest.raises(InvalidInput, match="12 triangles, more than the 11"):
        read_mesh(tmp_path / "a.obj")
