"""Message frame with the arm and the bodies of its cell; the page draws them in 3D."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.jobs import Job, RunResult
from armcontour.report.drawn_cell import Body, DrawnCell, DrawnJoint
from armcontour.report.external_bodies import (
    Surroundings,
    positioner_bodies,
    slide_bodies,
    stand_bodies,
    stroke,
)
from armcontour.report.message_frame import MessageFrame
from armcontour.report.sticks import link_sticks, tool_cone
from armcontour.report.triangles import triangles_of
from armcontour.report.view import drawn_points
from armcontour.robot import Arm, Chain
from armcontour.robot.chain import floor_poses
from armcontour.robot.scene import BASE, PART, Box, HalfSpace, Scene

# The page computes the link poses: the pose of link i in the frame of link `parent` is the `origin`
# of its joint, followed by a rotation by q[column] about `axis`, or by a translation along it.
# Link 0 is the base, or the floor, so that a positioner moves the part. The tool is fixed to the
# last link.

# Half side length of a table, as a factor of the arm's reach.
TABLE_SIZE = 1.1
# Thickness of a table [m].
TABLE_THICKNESS = 0.02
# Coordinates of the path's box are multiples of this length [m].
PATH_DIGIT = 5e-3
# Smallest cosine of the angle between the vertical and the normal of a floor.
LEVEL = 0.999
# Smallest size of an arm [m], as for an arm of one joint, and as a share of its longest stroke.
SMALLEST_ARM = 0.05
SHARE_OF_STROKE = 0.15


def arm_frame(job: Job) -> MessageFrame:
    """Make the message frame with the joints of a job's arm, and the bodies of arm and cell."""
    arm = job.arm
    chain = job.arm.chain
    base = chain.base
    part, at = _on_floor(chain, 0, base.inverse)
    scene = job.scene or Scene()
    cell = DrawnCell.of(arm)
    size = _size(cell, chain)
    bodies = [*_shaped_bodies(arm), *_obstacle_bodies(arm, scene)]
    notes = []
    if not any(x.kind == "link" for x in bodies):
        notes.append("The shapes of the arm's links are unknown: the links are drawn as sticks.")
        bodies += link_sticks(cell, chain.tip, size)
    if not any(x.kind == "tool" for x in bodies):
        bodies += tool_cone(cell, chain.tip, chain.tip @ chain.tool, size)
    if (points := path_points(job)) is None:
        on_part = _corners(cell, [x for x in bodies if x.kind == "part"])
    else:
        floor_to_work = cell.frames[part] @ at
        on_part = floor_to_work.position + points @ floor_to_work.rotation.T
    axes, ground = _external_axes(cell, arm, scene, bodies, on_part, size)
    drawn = {x.name for x in axes}
    if names := [x.name for x in cell.joints if x.name in drawn]:
        notes.append(
            f"The bodies of {', '.join(names)} are drawn with assumed sizes, because their shapes "
            "are unknown. No distance to them is checked."
        )
    bodies += axes
    shown, arrays = _write_bodies(bodies)
    header = {
        "name": arm.name,
        "joints": [_write_joint(x) for x in cell.joints],
        "tool": matrix(chain.tip @ chain.tool),
        "base": matrix(base),
        "work": matrix(base.inverse),
        "part": {"link": part, "at": matrix(at)},
        "reach": _reach(arm),
        "size": size,
        "ground": ground,
        "bodies": shown,
        "notes": notes,
    }
    return MessageFrame("arm", header, arrays)


def path_points(job: Job) -> FloatArray | None:
    """Return the corners of the box around the path of a job [m], (8, 3), for its positioner.

    A positioner without bodies on the part is drawn below and beside the path. None for other
    cells. The coordinates are rounded, so that few changes of the path change the positioner.
    """
    scene = job.scene or Scene()
    has_bodies = any(x.fixed_to == PART for x in scene.obstacles)
    if job.arm.chain.positioner is None or has_bodies or not job.program.contours:
        return None
    points, _ = drawn_points([x.path for x in job.program.contours], np.inf)
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    ends = np.round(ends / PATH_DIGIT) * PATH_DIGIT
    return np.array(list(product(*ends.T)))


def _external_axes(
    cell: DrawnCell,
    arm: Arm,
    scene: Scene,
    bodies: Sequence[Body],
    on_part: FloatArray,
    size: float,
) -> tuple[list[Body], float]:
    """Make the bodies of external axes without shapes; also return the height of the ground [m]."""
    floor = _floor_height(scene)
    shaped = {x.link for x in bodies if x.kind == "link" and arm.knows_shapes}
    carried = cell.positioner + cell.sliding
    chain = arm.chain
    end = cell.frames[-1] @ chain.tip @ chain.tool
    around = Surroundings(
        size=size,
        base=_corners(cell, [x for x in bodies if x.link == carried and carried in shaped]),
        arm=np.array([*(x.position for x in cell.frames[carried + 1 :]), end.position]),
        part=on_part,
        floor=floor,
    )
    made: list[Body] = []
    stands = []
    carriers = {0, *range(cell.positioner + 1, carried)}
    if cell.sliding and not carriers & shaped:
        of_slides, on_floor = slide_bodies(cell, around)
        made += of_slides
        stands += on_floor
    if cell.positioner and not shaped.intersection(range(1, cell.positioner + 1)):
        of_positioner, on_floor = positioner_bodies(cell, around)
        made += of_positioner
        stands += on_floor
    # Without a floor in the scene, a structure below the arm's base stands on the ground.
    lowest = min([0.0, *(float(x.top[2]) for x in stands)])
    ground = lowest if floor is None else floor
    return [*made, *stand_bodies(cell, stands, ground)], ground


def _floor_height(scene: Scene) -> float | None:
    """Return the height of the highest level half-space on the floor [m]; None without one."""
    heights = [
        float(x.place.position[2])
        for x in scene.obstacles
        if isinstance(x.shape, HalfSpace) and x.fixed_to == BASE and x.place.rotation[2, 2] >= LEVEL
    ]
    return max(heights, default=None)


def _corners(cell: DrawnCell, bodies: Sequence[Body]) -> FloatArray:
    """Return the corners of bodies with all joints at 0 in the frame of the floor [m], (n, 3)."""
    return np.concatenate([np.empty((0, 3)), *(cell.place(x) for x in bodies)])


def _write_joint(joint: DrawnJoint) -> dict[str, Any]:
    """Return a joint as the page reads it."""
    return {
        "name": joint.name,
        "type": "prismatic" if joint.prismatic else "revolute",
        "parent": joint.parent,
        "column": joint.column,
        "factor": joint.factor,
        "axis": joint.axis,
        "origin": matrix(joint.origin),
        "limits": [joint.lower, joint.upper],
    }


def _write_bodies(
    bodies: Sequence[Body],
) -> tuple[list[dict[str, Any]], dict[str, npt.NDArray[Any]]]:
    """Return the bodies as the page reads them, and the arrays of their triangles by name."""
    shown = []
    arrays = {}
    for k, body in enumerate(bodies):
        array = f"body{k}"
        arrays[array] = np.asarray(body.triangles, dtype=np.float32)
        look = {"name": body.name, "link": body.link, "colour": body.kind}
        shown.append({**look, "triangles": array, "at": matrix(body.place)})
    return shown, arrays


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


def _size(cell: DrawnCell, chain: Chain) -> float:
    """Return the size of the arm without external axes [m]: the length of its stretched links."""
    first = cell.positioner + cell.sliding
    # The first joint's frame contains the position of the arm in the cell.
    links = [x.origin.position for x in cell.joints[first + 1 :]]
    length = float(sum(np.linalg.norm(x) for x in [*links, chain.tip.position]))
    strokes = [0.0]
    for joint in cell.joints[cell.positioner :]:
        if joint.prismatic:
            low, high = stroke(joint, 0.0)
            strokes.append(high - low)
    return max(length, SMALLEST_ARM, SHARE_OF_STROKE * max(strokes))


def _reach(arm: Arm) -> float:
    """Return an upper bound of the distance from the base to the tool [m]."""
    ends = [*arm.chain.positions, (arm.chain.tip @ arm.chain.tool).position]
    return float(sum(np.linalg.norm(x) for x in ends)) + arm.stroke


def _shaped_bodies(arm: Arm) -> Iterator[Body]:
    """Yield the links and the tool of an arm that have shapes."""
    shapes = arm.shapes.shapes if arm.knows_shapes and arm.shapes is not None else ()
    for link_shape in shapes:
        link, place = _on_floor(arm.chain, link_shape.link, link_shape.place)
        yield Body(
            name=link_shape.name,
            link=link,
            kind="tool" if link_shape.tool else "link",
            place=place,
            triangles=triangles_of(link_shape.exact or link_shape.shape),
        )


def _obstacle_bodies(arm: Arm, scene: Scene) -> Iterator[Body]:
    """Yield the obstacles; a half-space is drawn as a table."""
    chain = arm.chain
    for obstacle in scene.obstacles:
        # `chain.base` is the pose of the base or table (link 0) in the work frame.
        on_floor = obstacle.fixed_to == BASE
        link = chain.floor_link if on_floor else 0
        pose = (chain.floor if on_floor else chain.base.inverse) @ obstacle.place
        kind = "part" if obstacle.fixed_to == PART else "obstacle"
        shape = obstacle.shape
        if isinstance(shape, HalfSpace):
            # The table is centred below the base, wherever its half-space has its origin.
            foot = -(pose.rotation.T @ pose.position) * [1, 1, 0]
            pose = pose @ Frame(position=foot + [0, 0, -TABLE_THICKNESS / 2])
            side = 2 * TABLE_SIZE * max(_reach(arm), 0.5)
            shape = Box(size=np.array([side, side, TABLE_THICKNESS]))
            kind = "table"
        link, place = _on_floor(chain, link, pose)
        triangles = triangles_of(shape)
        yield Body(name=obstacle.name, link=link, kind=kind, place=place, triangles=triangles)
