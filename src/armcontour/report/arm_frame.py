"""Message frame with the arm and the bodies of its cell; the page draws them in 3D."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.jobs import Job, RunResult
from armcontour.report.message_frame import MessageFrame
from armcontour.robot import Arm, Chain
from armcontour.robot.chain import floor_poses
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

# The page computes the link poses: the pose of link i in the frame of link `parent` is the `origin`
# of its joint, followed by a rotation by q[column] about `axis`, or by a translation along it.
# Link 0 is the base, or the floor, so that a positioner moves the part. The tool is fixed to the
# last link.

# Number of sides of polygons that approximate circles.
SIDES = 24
# Meshes with more triangles are drawn as convex hulls.
MAX_TRIANGLES = 4_000
# Half side length of a table, as a factor of the arm's reach.
TABLE_SIZE = 1.1
# Thickness of a table [m].
TABLE_THICKNESS = 0.02


def arm_frame(job: Job) -> MessageFrame:
    """Make the message frame with the joints of a job's arm, and the bodies of arm and cell."""
    arm = job.arm
    chain = job.arm.chain
    base = chain.base
    bodies, arrays = _bodies(arm, chain, job.scene or Scene())
    part, at = _on_floor(chain, 0, base.inverse)
    header = {
        "name": arm.name,
        "joints": list(_joints(arm)),
        "tool": matrix(chain.tip @ chain.tool),
        "tip": matrix(chain.tip),
        "base": matrix(base),
        "work": matrix(base.inverse),
        "part": {"link": part, "at": matrix(at)},
        "reach": _reach(arm),
        "bodies": bodies,
        "notes": [] if arm.knows_shapes else ["The shapes of the arm's links are unknown."],
    }
    return MessageFrame("arm", header, arrays)


def _joints(arm: Arm) -> Iterator[dict[str, Any]]:
    """List the joints from the floor: a positioner's joints up to the part, then the arm's."""
    chain = arm.chain
    lower, upper = arm.limits.joint_range(arm.dof)
    first = chain.floor_link
    part = chain.part_branch
    branches = [(chain.arm_branch, np.arange(first, arm.dof), first)]
    if part is not None:
        branches.insert(0, (part, np.arange(first)[::-1], 0))
    for branch, columns, carried in branches:
        for k, row in enumerate(branch.rows):
            column = int(columns[row.leader])
            yield {
                "name": row.name,
                "type": "prismatic" if row.slides else "revolute",
                "parent": k + carried if k else 0,
                "column": column,
                "factor": row.factor,
                "axis": row.axis,
                "origin": matrix(row.place),
                "limits": [lower[column], upper[column]],
            }


def _on_floor(chain: Chain, link: int, pose: Frame) -> tuple[int, Frame]:
    """Return a link's index among the links from the floor, and a pose in its frame."""
    first = chain.floor_link
    positioner = chain.positioner
    if positioner is None or link > first:
        # Joints that follow others have frames of their own.
        return int(chain.joint_row[link - 1]) + 1 if link else 0, pose
    if link == first:
        return 0, chain.floor.inverse @ pose
    # The links of a positioner have parallel frames with all joints at 0.
    here = chain.positions[:link].sum(axis=0)
    there = positioner.axes[first - 1 - link].origin
    return first - link, Frame(position=here - there) @ pose


def nearest_pair(result: RunResult) -> dict[str, Any] | None:
    """Return the nearest points of two bodies in the floor frame [m], and their time [s]."""
    pair = None if result.clearance is None else result.clearance.least
    if pair is None:
        return None
    t = pair.t if pair.first_time is None else pair.first_time
    chain = result.arm.chain
    q = result.trajectory(np.clip([t], 0.0, result.trajectory.duration))
    (floor,) = floor_poses(chain, q)
    return {"points": (pair.points - floor[:, 3]) @ floor[:, :3], "t": t}


def matrix(frame: Frame) -> FloatArray:
    """Return a frame as a homogeneous transform, (4, 4)."""
    homogeneous = np.eye(4)
    homogeneous[:3, :3] = frame.rotation
    homogeneous[:3, 3] = frame.position
    return homogeneous


def _reach(arm: Arm) -> float:
    """Return an upper bound of the distance from the base to the tool [m]."""
    ends = [*arm.chain.positions, (arm.chain.tip @ arm.chain.tool).position]
    return float(sum(np.linalg.norm(x) for x in ends)) + arm.stroke


def _bodies(arm: Arm, chain: Chain, scene: Scene) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """List the bodies (links, tool, obstacles), and their triangles [m], (n, 3, 3), by name."""
    bodies: list[dict[str, Any]] = []
    arrays: dict[str, npt.NDArray[Any]] = {}

    def add(name: str, link: int, colour: str, pose: Frame, corners: FloatArray) -> None:
        """Add a body with its pose in its link, and its triangles [m], (n, 3, 3)."""
        array = f"body{len(bodies)}"
        link, pose = _on_floor(chain, link, pose)
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
        # `chain.base` is the pose of the base or table (link 0) in the work frame.
        on_floor = obstacle.fixed_to == BASE
        link = chain.floor_link if on_floor else 0
        pose = (chain.floor if on_floor else chain.base.inverse) @ obstacle.place
        if isinstance(obstacle.shape, HalfSpace):
            # The table is centred below the base, wherever its half-space has its origin.
            foot = -(pose.rotation.T @ pose.position) * [1, 1, 0]
            pose = pose @ Frame(position=foot + [0, 0, -TABLE_THICKNESS / 2])
            side = 2 * TABLE_SIZE * max(_reach(arm), 0.5)
            corners = triangles_of(Box(size=np.array([side, side, TABLE_THICKNESS])))
            add(obstacle.name, link, "table", pose, corners)
        else:
            colour = "part" if obstacle.fixed_to == PART else "obstacle"
            add(obstacle.name, link, colour, pose, triangles_of(obstacle.shape))
    return bodies, arrays


@lru_cache(maxsize=64)
def triangles_of(shape: Shape) -> FloatArray:
    """Return a shape's triangles with outward normals [m], (n, 3, 3); of large meshes the hull."""
    match shape:
        case Mesh() if shape.triangles is not None and len(shape.triangles) <= MAX_TRIANGLES:
            return np.asarray(shape.points[shape.triangles])
        case Mesh():
            points = shape.points
        case Box():
            points = shape.size / 2 * np.array(list(product((-1, 1), repeat=3)))
        case Cylinder():
            points = _ends(shape.length, _rings(shape.radius, np.zeros(1)))
        case Sphere() | Capsule():
            rings = _rings(shape.radius, np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1))
            points = rings if isinstance(shape, Sphere) else _ends(shape.length, rings)
        case _:
            raise TypeError(f"A {type(shape).__name__} cannot be drawn as triangles.")
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    corners = hull.points[hull.simplices]
    # The normals in `equations` point outwards, but the vertex order of the simplices is arbitrary.
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside_out = np.einsum("ij,ij->i", across, hull.equations[:, :3]) < 0
    corners[inside_out] = corners[inside_out][:, ::-1]
    return np.asarray(corners)


def _rings(radius: float, heights: FloatArray) -> FloatArray:
    """Return points on circles of latitude of a sphere about the origin [m], (n, 3)."""
    angle, height = np.meshgrid(np.arange(SIDES) * 2 * np.pi / SIDES, heights)
    flat = np.cos(height)
    parts = (flat * np.cos(angle), flat * np.sin(angle), np.sin(height))
    return radius * np.stack(parts, axis=-1).reshape(-1, 3)


def _ends(length: float, points: FloatArray) -> FloatArray:
    """Move points to both ends of a body along z."""
    half = np.array([0.0, 0.0, length / 2])
    return np.concatenate([points - half, points + half])
