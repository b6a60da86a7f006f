"""Message frame with the arm and the bodies of its cell; the page draws them in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.jobs import Job
from armcontour.robot import Arm, Chain
from armcontour.robot.scene import (
    BASE,
    PART,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Mesh,
    Scene,
    Shape,
    Sphere,
)
from armcontour.studio.page_frame import PageFrame

# The page computes the link poses: the pose of link i in the frame of link i - 1 is the `origin` of
# its joint, followed by a rotation by q[i] about `axis`. Link 0 is the base. The tool is fixed to
# the last link.

# Number of sides of the polygons that approximate circles.
SIDES = 24
# Meshes with more triangles are drawn as convex hulls.
MAX_TRIANGLES = 4_000
# Half side length of a table, as a factor of the arm's reach, and its thickness [m].
TABLE_SIZE, TABLE_THICKNESS = 1.1, 0.02


def arm_frame(job: Job) -> PageFrame:
    """Message frame with the joints of a job's arm, and the bodies of arm and cell."""
    arm, chain = job.arm, job.arm.chain
    base = chain.base
    bodies, arrays = _bodies(arm, chain, job.scene or Scene())
    lower, upper = arm.limits.joint_range(arm.dof)
    header = {
        "name": arm.name,
        "planar": arm.dimension == 2,
        "joints": [
            {
                "name": name,
                "type": "revolute",
                "parent": k,
                "axis": chain.axes[k],
                "origin": matrix(Frame(position=chain.positions[k], rotation=chain.rotations[k])),
                "limits": [lower[k], upper[k]],
            }
            for k, name in enumerate(arm.joint_names)
        ],
        "tool": matrix(chain.tip @ chain.tool),
        "tip": matrix(chain.tip),
        "base": matrix(base),
        "work": matrix(base.inverse),
        "reach": _reach(chain),
        "bodies": bodies,
        "notes": [] if arm.knows_shapes else ["The shapes of the arm's links are unknown."],
    }
    return PageFrame("arm", header, arrays)


def matrix(frame: Frame) -> FloatArray:
    """Homogeneous transform of a frame, (4, 4)."""
    homogeneous = np.eye(4)
    homogeneous[:3, :3], homogeneous[:3, 3] = frame.rotation, frame.position
    return homogeneous


def _reach(chain: Chain) -> float:
    """Upper bound of the distance of the tool from the base [m]."""
    ends = [*chain.positions, (chain.tip @ chain.tool).position]
    return float(sum(np.linalg.norm(x) for x in ends))


def _bodies(arm: Arm, chain: Chain, scene: Scene) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Bodies of links, tool and obstacles, and arrays of triangles [m], (n, 3, 3), by name."""
    bodies: list[dict[str, Any]] = []
    arrays: dict[str, npt.NDArray[Any]] = {}

    def add(name: str, link: int, colour: str, pose: Frame, corners: FloatArray) -> None:
        array = f"body{len(bodies)}"
        arrays[array] = np.asarray(corners, dtype=np.float32)
        look = {"name": name, "link": link, "colour": colour}
        bodies.append({**look, "triangles": array, "at": matrix(pose)})

    shapes = arm.shapes.shapes if arm.knows_shapes and arm.shapes is not None else ()
    for link_shape in shapes:
        add(
            link_shape.name,
            link_shape.link,
            "tool" if link_shape.tool else "link",
            link_shape.place,
            triangles_of(link_shape.exact or link_shape.shape),
        )
    for obstacle in scene.obstacles:
        # Obstacles are drawn in the base frame (link 0); `chain.base` is the pose of this frame in
        # the work frame.
        pose = obstacle.place
        if obstacle.fixed_to != BASE:
            pose = chain.base.inverse @ pose
        if isinstance(obstacle.shape, HalfSpace):
            # The table is centred below the base, regardless of the origin of its half-space.
            foot = -(pose.rotation.T @ pose.position) * [1, 1, 0]
            pose = pose @ Frame(position=foot + [0, 0, -TABLE_THICKNESS / 2])
            side = 2 * TABLE_SIZE * max(_reach(chain), 0.5)
            corners = triangles_of(Box(size=np.array([side, side, TABLE_THICKNESS])))
            add(obstacle.name, 0, "table", pose, corners)
        else:
            colour = "part" if obstacle.fixed_to == PART else "obstacle"
            add(obstacle.name, 0, colour, pose, triangles_of(obstacle.shape))
    return bodies, arrays


@lru_cache(maxsize=64)
def triangles_of(shape: Shape) -> FloatArray:
    """Triangles of a shape [m], (n, 3, 3), with outward normals; for a large mesh, of its hull."""
    match shape:
        case Box():
            ring = shape.size[:2] / 2 * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
            return _triangulate_rings([(ring, -shape.size[2] / 2), (ring, shape.size[2] / 2)])
        case Sphere():
            return _capsule_triangles(shape.radius, 0.0)
        case Capsule():
            return _capsule_triangles(shape.radius, shape.length)
        case Cylinder():
            ring = _ring(shape.radius)
            return _triangulate_rings([(ring, -shape.length / 2), (ring, shape.length / 2)])
        case Mesh() if shape.triangles is not None and len(shape.triangles) <= MAX_TRIANGLES:
            return np.asarray(shape.points[shape.triangles])
        case Mesh():
            return _hull(shape.points)
    raise TypeError(f"A {type(shape).__name__} cannot be drawn as triangles.")


def _ring(radius: float) -> FloatArray:
    """Points of a circle about the origin [m], (SIDES, 2)."""
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _capsule_triangles(radius: float, length: float) -> FloatArray:
    """Triangles of a capsule along z [m], (n, 3, 3); a capsule of length 0 is a sphere."""
    # The poles are separate points. A sphere has one ring at its equator, a capsule has two.
    angles = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)[1:-1]
    rings = [
        (_ring(radius * np.cos(angle)), radius * np.sin(angle) + end * length / 2)
        for end in (-1, 1)
        for angle in angles.tolist()
        if end * angle > 0 or (abs(angle) < 1e-9 and (length > 0 or end > 0))
    ]
    pole = radius + length / 2
    return _triangulate_rings(rings, (-pole, pole))


def _triangulate_rings(
    rings: Sequence[tuple[FloatArray, float]], poles: tuple[float, float] | None = None
) -> FloatArray:
    """Triangles of a body from rings: polygons (n, 2) [m] with their z [m], lowest ring first.

    `poles`: z of the lowest and highest point [m]; without poles, the ends are flat.
    """
    low, high = poles or (rings[0][1], rings[-1][1])
    points = [np.column_stack([ring, np.full(len(ring), z)]) for ring, z in rings]
    ends = [np.broadcast_to([0.0, 0.0, z], points[0].shape) for z in (low, high)]
    triangles = [_fan(points[0][::-1], ends[0]), _fan(points[-1], ends[1])]
    for below, above in pairwise(points):
        after, over = np.roll(below, -1, axis=0), np.roll(above, -1, axis=0)
        triangles += [np.stack([below, after, over], 1), np.stack([below, over, above], 1)]
    return np.concatenate(triangles)


def _fan(ring: FloatArray, middle: FloatArray) -> FloatArray:
    """Triangles between the sides of a polygon and a point, (n, 3, 3).

    `middle` contains the point n times, (n, 3).
    """
    return np.stack([ring, np.roll(ring, -1, axis=0), middle], 1)


def _hull(points: FloatArray) -> FloatArray:
    """Triangles of the convex hull of points [m], (n, 3, 3)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    corners = hull.points[hull.simplices]
    # The normals in `equations` point outwards, but the vertex order of the simplices is arbitrary.
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside_out = np.einsum("ij,ij->i", across, hull.equations[:, :3]) < 0
    corners[inside_out] = corners[inside_out][:, ::-1]
    return np.asarray(corners)
