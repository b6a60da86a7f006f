"""The inverse kinematics of Universal Robots' arms in closed form, from their DH parameters.

After the three parallel axes: the first joint from the wrist's centre, the fifth and sixth from the
direction of those axes seen by the tool, the second to fourth from the triangle in their plane.
"""

import itertools

import numpy as np

# a [m], d [m]: support article 45257 of Universal Robots, classic convention; alpha below.
PARAMETERS = {
    "ur5e": ([0, -0.425, -0.3922, 0, 0, 0], [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]),
    "ur10e": ([0, -0.6127, -0.57155, 0, 0, 0], [0.1807, 0, 0, 0.17415, 0.11985, 0.11655]),
}
ALPHA = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]


def link(name, k, angle):
    """The transform of one link."""
    a, d = (x[k] for x in PARAMETERS[name])
    c = np.cos(angle)
    s = np.sin(angle)
    ca = np.cos(ALPHA[k])
    sa = np.sin(ALPHA[k])
    first = [c, -s * ca, s * sa, a * c]
    second = [s, c * ca, -c * sa, a * s]
    return np.array([first, second, [0, sa, ca, d], [0, 0, 0, 1]])


def solutions(name, point, rotation):
    """All joint positions of a pose, (k, 6), and how far from where two of them meet, (k,).

    That distance is the least of the sines and cosines that vanish there.
    """
    (_, a2, a3, *_), (_, _, _, d4, _, d6) = PARAMETERS[name]
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = point
    x, y = (point - d6 * rotation[:, 2])[:2]
    joint_angles = []
    apart = []
    lean = d4 / np.hypot(x, y)
    if abs(lean) > 1:
        return np.zeros((0, 6)), np.zeros(0)
    for shoulder, wrist in itertools.product((1, -1), (1, -1)):
        q1 = np.arctan2(y, x) + shoulder * np.arccos(lean) + np.pi / 2
        axis_in_tool = rotation.T @ [np.sin(q1), -np.cos(q1), 0]
        s5 = wrist * np.hypot(axis_in_tool[0], axis_in_tool[1])
        q5 = np.arctan2(s5, axis_in_tool[2])
        q6 = np.arctan2(-axis_in_tool[1] / s5, axis_in_tool[0] / s5)
        rest = np.linalg.inv(link(name, 0, q1)) @ pose
        rest = rest @ np.linalg.inv(link(name, 4, q5) @ link(name, 5, q6))
        reach = rest[0, 3] ** 2 + rest[1, 3] ** 2
        c3 = (reach - a2**2 - a3**2) / (2 * a2 * a3)
        if abs(c3) > 1:
            continue
        for elbow in (1, -1):
            q3 = elbow * np.arccos(c3)
            q2 = np.arctan2(rest[1, 3], rest[0, 3]) - np.angle(a2 + a3 * np.exp(1j * q3))
            q4 = np.arctan2(rest[1, 0], rest[0, 0]) - q2 - q3
            joint_angles.append([q1, q2, q3, q4, q5, q6])
            apart.append(min(np.sqrt(1 - lean**2), abs(s5), abs(np.sin(q3))))
    return np.array(joint_angles).reshape(-1, 6), np.array(apart)
