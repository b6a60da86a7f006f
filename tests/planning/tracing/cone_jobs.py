"""Random jobs with a cone, and the tool of a UR10e by its DH parameters."""

import numpy as np
from tests.oracle.head_machine import angles
from tests.oracle.ur_inverse import link

import armcontour as ac

# Length of the tool [m].
TOOL = 0.15
SPEED = 1.0


def load_arm():
    """A UR10e with a straight tool, and a speed that the joints and not the process limit."""
    arm = ac.load_arm("ur10e").with_tool(ac.Frame(position=(0, 0, TOOL)))
    return arm.with_limits(arm.limits.replace(speed=SPEED))


def random_path(seed):
    """A rounded polyline in front of the arm, along which the tool axis turns by up to 60 deg."""
    rng = np.random.default_rng(seed)
    count = rng.integers(4, 8)
    points = np.stack(
        [
            0.6 + rng.uniform(-0.06, 0.06, count),
            np.linspace(-0.3, 0.3, count) + rng.uniform(-0.03, 0.03, count),
            0.25 + rng.uniform(-0.04, 0.04, count),
        ],
        axis=1,
    )
    across = rng.uniform(-0.55, 0.55, (count, 2))
    path = ac.Path.polyline(points).pointing(np.column_stack([across, -np.ones(count)]))
    return ac.round_corners(path, tolerance=4e-3, angular_tolerance=np.radians(3))


def tool_at(q):
    """Tool points [m] and tool axes at joint positions, (n, 3) each."""
    poses = []
    for row in q:
        pose = np.eye(4)
        for k, angle in enumerate(row):
            pose = pose @ link("ur10e", k, angle)
        poses.append(pose)
    poses = np.array(poses)
    axes = poses[:, :3, 2]
    return poses[:, :3, 3] + TOOL * axes, axes


def judge(path, joint_path, count=2001):
    """Largest distance from the path [m], and angle from the required axis [rad]."""
    s = np.linspace(0, path.length, count)
    points, axes = tool_at(joint_path(s))
    distance = np.linalg.norm(points - path(s), axis=1).max()
    return distance, angles(axes, path.orientation(s)[:, :, 2]).max()


def compare(path, arm, cone):
    """Durations without and with a cone [s], and the largest angle [rad]."""
    exact = ac.plan(path, arm).duration
    planned = ac.plan(path.with_cone(cone), arm)
    (law,) = planned.laws
    distance, angle = judge(path, law.joint_path)
    assert distance < 1e-9
    return exact, planned.duration, angle
