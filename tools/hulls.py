"""Compute the hulls of a built-in arm from the meshes of its manufacturer.

    python -m tools.hulls NAME DESCRIPTION

For the built-in arms, with URDF files that xacrodoc made from the manufacturers' repositories:

    python -m tools.hulls ur5e ur5e.urdf --base base_link_inertia --tip tool0
    python -m tools.hulls panda fer.urdf --tip fer_link8 --rename fer_=panda_
    python -m tools.hulls fr3 fr3.urdf --tip fr3_link8

A hull is the intersection of half-spaces that contain every corner of the mesh. Half-spaces are
added where the hull is farthest from the convex hull of the mesh (sandwich algorithm), until the
distance is at most EXCESS.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, HalfspaceIntersection

import armcontour as ac
from armcontour.files.robots import arm_loading
from armcontour.files.robots.arm_loading import HULL_UNIT
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import ArmShapes, LinkShape, Mesh

# Largest distance of a hull from the convex hull of the mesh [m].
EXCESS = 3e-4
# Largest displacement of a corner by rounding to whole steps, and offset of the half-spaces [m].
ROUNDING = HULL_UNIT
# Tolerance between link frames in the description and in the built-in arm [m].
FRAME_TOLERANCE = 1e-8
# Largest number of half-spaces added per iteration.
MAX_ADDED = 12
FOLDER = Path(arm_loading.__file__).parent / "library" / "hulls"
SOURCES = {
    "ur": (
        "Convex hulls of the collision meshes of Universal_Robots_ROS2_Description, Universal "
        "Robots A/S.",
        "BSD-3-Clause: see LICENSE-universal-robots.txt.",
    ),
    "franka": (
        "Convex hulls of the collision meshes of franka_description, Franka Robotics GmbH.",
        "Apache-2.0: see NOTICE-franka.txt.",
    ),
}
FloatArray = npt.NDArray[np.float64]


def outer_hull(points: FloatArray, excess: float) -> FloatArray:
    """Return the corners of a convex body around points, at most `excess` outside their hull."""
    hull = points[ConvexHull(points).vertices]
    inside = hull.mean(axis=0)
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    normals = grid[np.any(grid != 0, axis=1)]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    body = _Body(hull)
    while True:
        offsets = (hull @ normals.T).max(axis=0) + ROUNDING
        planes = np.column_stack([normals, -offsets])
        corners = HalfspaceIntersection(planes, inside).intersections
        corners = _rounded(corners)
        distances, nearest = body.distances(corners)
        if distances.max() <= excess:
            return corners
        worst = np.argsort(-distances)[:MAX_ADDED]
        worst = worst[distances[worst] > max(excess, 0.5 * distances.max())]
        directions = (corners - nearest)[worst]
        normals = np.vstack(
            [normals, directions / np.linalg.norm(directions, axis=1, keepdims=True)]
        )


class _Body:
    """Convex hull of points, for distances of other points from it."""

    def __init__(self, points: FloatArray) -> None:
        model = coal.BVHModelOBBRSS()
        model.beginModel(0, len(points))
        model.addVertices(np.ascontiguousarray(points))
        model.endModel()
        model.buildConvexHull(True, "Qt")
        self._hull = model.convex

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances of points to the hull, (n,), and its nearest points, (n, 3)."""
        request = coal.DistanceRequest()
        ball = coal.Sphere(1e-9)
        still = coal.Transform3s()
        distances = np.empty(len(points))
        nearest = np.empty((len(points), 3))
        for k, x in enumerate(points):
            result = coal.DistanceResult()
            pose = coal.Transform3s(np.eye(3), x)
            distances[k] = coal.distance(self._hull, still, ball, pose, request, result)
            nearest[k] = result.getNearestPoint1()
        return distances, nearest


def _rounded(points: FloatArray) -> FloatArray:
    """Round points to whole steps, and return the unique ones."""
    return np.unique(np.round(points / HULL_UNIT), axis=0) * HULL_UNIT


def hull_of(shape: LinkShape, excess: float) -> dict[str, Any]:
    """Return a link's checked entry in the file of hulls.

    Raises:
        AssertionError: A corner of the mesh is outside the hull.
    """
    assert isinstance(shape.exact, Mesh)
    mesh = shape.exact.points @ shape.place.rotation.T + shape.place.position
    corners = outer_hull(mesh, excess)
    outside = ConvexHull(corners).equations @ np.column_stack([mesh, np.ones(len(mesh))]).T
    assert outside.max() <= 1e-9, f"{shape.name}: {outside.max():.3g} m outside"
    corners = corners[ConvexHull(corners).vertices]
    excess_used = _Body(mesh[ConvexHull(mesh).vertices]).distances(corners)[0].max()
    print(f"{shape.name}: {len(mesh)} -> {len(corners)} points, {excess_used * 1e3:.3f} mm outside")
    return {
        "name": shape.name,
        "link": shape.link,
        "excess": round(float(excess_used), 6),
        "points": np.rint(corners / HULL_UNIT).astype(int).tolist(),
    }


def main(words: list[str]) -> int:
    """Make the hulls of an arm."""
    parser = argparse.ArgumentParser()
    parser.add_argument("name")
    parser.add_argument("description")
    parser.add_argument("--base")
    parser.add_argument("--tip")
    parser.add_argument("--rename", default="=")
    parser.add_argument("--excess", type=float, default=EXCESS)
    options_given = parser.parse_args(words)
    arm = ac.load_arm(options_given.description, base=options_given.base, tip=options_given.tip)
    _compare(ac.load_arm(options_given.name), arm)
    assert isinstance(arm.shapes, ArmShapes)
    old, new = options_given.rename.split("=")
    hulls = [hull_of(x, options_given.excess) for x in arm.shapes.shapes]
    for x in hulls:
        x["name"] = x["name"].replace(old, new) if old else x["name"]
    source, license_text = SOURCES["franka" if options_given.name in ("panda", "fr3") else "ur"]
    page = {
        "source": f"{source} They are up to {max(x['excess'] for x in hulls) * 1e3:.2g} mm larger.",
        "license": license_text,
        "unit": "um",
        "hulls": hulls,
    }
    _write(FOLDER / f"{options_given.name}.json", page)
    return 0


def _compare(built_in: ac.Arm, described: ac.Arm) -> None:
    """Check that the links of a description have the same frames as the built-in arm."""
    assert built_in.chain is not None and described.chain is not None
    q = np.random.default_rng(1).uniform(-3, 3, (100, built_in.dof))
    difference = np.abs(link_poses(built_in.chain, q) - link_poses(described.chain, q)).max()
    print(f"frames of links: {difference:.2g} m apart")
    assert difference <= FRAME_TOLERANCE


def _write(file: Path, page: dict[str, Any]) -> None:
    """Write a file of hulls, one hull per line."""
    hulls = ",\n".join(json.dumps(x, separators=(",", ":")) for x in page["hulls"])
    header = {key: x for key, x in page.items() if key != "hulls"}
    text = json.dumps(header, indent=1)[:-2] + ',\n "hulls": [\n' + hulls + "\n]}\n"
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    print(f"{file}: {len(text) / 1e3:.0f} kB")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
