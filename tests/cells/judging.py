"""Figures of a planned motion from the cell's own kinematics, without code of the package."""

from dataclasses import dataclass

import numpy as np
from tests.cells.own_kinematics import Cell, between_samples, number, read_motion

# Distances of samples to lines that are computed at once, which limits the memory.
DISTANCES = 2_000_000


@dataclass(frozen=True)
class Figures:
    """Largest errors and loads of a motion, between its samples, too."""

    duration: float  # [s]
    off_path: float  # largest distance from the path to the tool point [m]
    missed: float  # largest distance from a point of the path to the motion [m]
    on_lines: float  # as `off_path`, only farther from corners than 20 mm [m]
    off_axis: float  # largest angle between the tool axis and the path's axis [rad]
    speed: float  # largest speed of the tool relative to the part [m/s]
    from_gravity: float  # largest angle between the tool axis and gravity [rad]
    range_margin: float  # smallest distance to an end of a joint's range [rad, m]
    velocity: float  # largest share of a joint's velocity limit
    acceleration: float  # largest share of a joint's acceleration limit
    travel: dict  # way of each joint [rad, m]


def nearest(line, points):
    """Distances of points to a polyline, and the index and fraction of the nearest place."""
    start = line[:-1]
    along = np.diff(line, axis=0)
    squares = np.maximum(np.sum(along**2, axis=1), 1e-300)
    distances = []
    indices = []
    fractions = []
    samples = max(1, DISTANCES // len(start))
    for first in range(0, len(points), samples):
        batch = points[first : first + samples]
        offset = batch[:, None] - start
        share = np.clip(np.einsum("nsk,sk->ns", offset, along) / squares, 0, 1)
        gap = np.linalg.norm(offset - share[..., None] * along, axis=2)
        best = np.argmin(gap, axis=1)
        rows = np.arange(len(batch))
        distances.append(gap[rows, best])
        indices.append(best)
        fractions.append(share[rows, best])
    return np.concatenate(distances), np.concatenate(indices), np.concatenate(fractions)


def angles(a, b):
    """Angles between unit vectors [rad], exact for small angles."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=1) / 2, 0, 1))


def acceleration_limit(cell, joint):
    """Limit that the job states, or that the joint reaches its largest velocity in 1 s.

    The maker of the built-in arms publishes no acceleration limits, so theirs are not judged.
    """
    keys = list(cell.job["arm"].get("positioner", {}).get("axes", ()))
    if "rail" in cell.job["arm"]:
        keys.append(cell.job["arm"]["rail"] | {"name": "rail"})
    stated = [x["acceleration"] for x in keys if x["name"] == joint.name]
    if stated:
        return number(stated[0])
    return joint.velocity if "file" in cell.job["arm"] else np.inf


def judge(job_file, table, points, axes):
    """Figures of a table of planned joint positions along a path of points with tool axes."""
    cell = Cell(job_file)
    motion = read_motion(table)
    joints = cell.joints()
    assert set(joints) == set(motion.q)
    inner = between_samples(motion)
    tool = cell.tool_in_path(inner)
    places = tool[:, :3, 3]
    off_path, index, fraction = nearest(points, places)
    wanted = axes[index] + fraction[:, None] * (axes[index + 1] - axes[index])
    wanted /= np.linalg.norm(wanted, axis=1)[:, None]
    to_corners = np.min(np.linalg.norm(places[:, None] - points, axis=2), axis=1)
    step = np.diff(motion.t)
    at_samples = cell.tool_in_path(motion.q)[:, :3, 3]
    velocity = []
    acceleration = []
    margin = []
    for name, joint in joints.items():
        velocity.append(np.max(np.abs(np.diff(motion.q[name]) / step)) / joint.velocity)
        loads = np.abs(np.diff(motion.dq[name]) / step)
        acceleration.append(np.max(loads) / acceleration_limit(cell, joint))
        margin += [np.min(inner[name]) - joint.lower, joint.upper - np.max(inner[name])]
    return Figures(
        duration=motion.t[-1],
        off_path=np.max(off_path),
        missed=np.max(nearest(places, points)[0]),
        on_lines=np.max(off_path[to_corners > 0.02], initial=0.0),
        off_axis=np.max(angles(tool[:, :3, 2], wanted)),
        speed=np.max(np.linalg.norm(np.diff(at_samples, axis=0), axis=1) / step),
        from_gravity=np.max(angles(cell.tool(inner)[:, :3, 2], np.array([[0.0, 0.0, -1.0]]))),
        range_margin=min(margin),
        velocity=max(velocity),
        acceleration=max(acceleration),
        travel={name: np.sum(np.abs(np.diff(q))) for name, q in motion.q.items()},
    )
