"""Machines with three slides and two rotary axes: a description (URDF), and their kinematics.

The kinematics are products of rotations by Rodrigues' formula and share no code with the package.
"""

import numpy as np

# Heights of the head below the slides, of the second axis below the first, and of the tool [m].
HEAD = 0.3
SECOND = 0.2
TOOL = 0.25
HALF = np.sqrt(0.5)
# First axis, second axis, largest angle of each [rad]; the tool points down at zero.
HEADS = {
    "C/A": ((0, 0, 1), (1, 0, 0), 6.4, 1.6),
    "C/B": ((0, 0, 1), (0, 1, 0), 3.3, 1.6),
    "B/A": ((0, 1, 0), (1, 0, 0), 1.6, 1.6),
    "nutating": ((0, 0, 1), (HALF, 0, HALF), 6.4, 3.2),
}
VELOCITIES = (1.0, 1.0, 0.6, 3.14, 3.14)
ACCELERATIONS = (1.0, 1.5, 1.5, 6.0, 6.0)


def description(name, slides="xyz"):
    """The URDF of a machine; `slides` is the order of its slides from the floor."""
    first, second, first_end, second_end = HEADS[name]
    axes = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    joints = [(x, "prismatic", axes[x], 0.0, 8.0) for x in slides]
    joints += [("first", "revolute", first, HEAD, first_end)]
    joints += [("second", "revolute", second, SECOND, second_end)]
    text = '<robot name="machine"><link name="floor"/>'
    before = "floor"
    for (joint, kind, axis, drop, end), velocity in zip(joints, VELOCITIES, strict=True):
        along = " ".join(f"{x:.17g}" for x in axis)
        text += (
            f'<link name="{joint}_link"/><joint name="{joint}" type="{kind}">'
            f'<origin xyz="0 0 {-drop}"/><parent link="{before}"/><child link="{joint}_link"/>'
            f'<axis xyz="{along}"/>'
            f'<limit lower="{-end}" upper="{end}" velocity="{velocity}" effort="0"/></joint>'
        )
        before = f"{joint}_link"
    return (
        f'{text}<link name="tool0"/><joint name="tip" type="fixed"><parent link="{before}"/>'
        f'<child link="tool0"/><origin xyz="0 0 {-TOOL}" rpy="{np.pi} 0 0"/></joint></robot>'
    )


def joint_limits(slides="xyz"):
    """The limits of acceleration, as a file of MoveIt."""
    names = [*slides, "first", "second"]
    rows = [
        f"  {x}: {{has_acceleration_limits: true, max_acceleration: {a}}}"
        for x, a in zip(names, ACCELERATIONS, strict=True)
    ]
    return "joint_limits:\n" + "\n".join(rows) + "\n"


def turn(axis, angle):
    """Rotation matrices about an axis, (n, 3, 3)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    a = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(a) * cross + (1 - np.cos(a)) * (cross @ cross)


def tool_of(name, q, slides="xyz"):
    """Tool points [m] and tool axes, (n, 3) each, at joint positions, (n, 5)."""
    first, second, *_ = HEADS[name]
    point = np.zeros((len(q), 3))
    for k, x in enumerate(slides):
        point[:, "xyz".index(x)] = q[:, k]
    first_turn = turn(first, q[:, 3])
    both = first_turn @ turn(second, q[:, 4])
    point += [0, 0, -HEAD] + first_turn @ [0, 0, -SECOND] + both @ [0, 0, -TOOL]
    return point, both @ [0, 0, -1.0]


def angles(first, second):
    """Angles between unit vectors [rad], (n,)."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(first - second, axis=-1) / 2, 0, 1))


def leaning(degrees, azimuth):
    """Tool axis at an angle from straight down."""
    tilt = np.radians(degrees)
    across = np.sin(tilt)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), -np.cos(tilt)])
