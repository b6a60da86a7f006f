"""Kinematics of cells for tests by products of 4 by 4 matrices, without code of the package."""

import numpy as np


def cross_matrix(a):
    """The matrix K of a vector product, K v = a × v."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def shift(position):
    """The transform of a translation [m]."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    return matrix


def turn(axis, point, angle):
    """The rotations by angles [rad], (n,), about an axis through a point [m]; (n, 4, 4)."""
    k = cross_matrix(np.array(axis, dtype=float))
    angle = np.atleast_1d(angle)[:, None, None]
    matrix = np.tile(np.eye(4), (len(angle), 1, 1))
    matrix[:, :3, :3] += np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
    return shift(point) @ matrix @ shift(-np.array(point, dtype=float))


def slide(axis, distance):
    """The translations by distances [m], (n,), along an axis; (n, 4, 4)."""
    distance = np.atleast_1d(distance)
    matrix = np.tile(np.eye(4), (len(distance), 1, 1))
    matrix[:, :3, 3] = distance[:, None] * np.array(axis, dtype=float)
    return matrix


def inverse(matrix):
    """The inverse of transforms, (n, 4, 4)."""
    turned = np.swapaxes(matrix[..., :3, :3], -1, -2)
    out = np.array(matrix)
    out[..., :3, :3] = turned
    out[..., :3, 3] = -(turned @ matrix[..., :3, 3, None])[..., 0]
    return out


def distance_from_line(points, start, end):
    """Distances of points, (n, 3), from the segment between two points [m], (n,)."""
    start = np.array(start, dtype=float)
    along = np.array(end, dtype=float) - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * along, axis=1)


def keeps_limits(trajectory, velocity, acceleration, count=4001):
    """Whether differences of joint positions keep velocity and acceleration limits, per joint.

    A first difference is a mean of velocities, and a second difference a mean of accelerations.
    """
    t = np.linspace(0.0, trajectory.duration, count)
    step = t[1]
    q = trajectory(t)
    first = np.diff(q, axis=0) / step
    second = np.diff(q, 2, axis=0) / step**2
    slow = (np.abs(first) <= np.array(velocity) * (1 + 1e-9)).all()
    return bool(slow and (np.abs(second) <= np.array(acceleration) * (1 + 1e-6) + 1e-6).all())
