"""The paper's job on drives of LinuxCNC's HAL, in NumPy: control law, kinematics, distances."""

from __future__ import annotations

import numpy as np

# Largest acceleration of a drive [rad/s²].
LIMIT = 0.72
# Gain of the position loop [1/s].
KP = 25.0
# Gain of the velocity loop [1/s].
KV = 150.0
# Cycle of the thread [s].
CYCLE = 1e-3
# Place of the arm's first joint on the x axis [m].
BASE = 0.135
# Lengths of both links [m].
FIRST = 0.250
SECOND = 0.215
# Vertices of the path [m].
POINTS = np.array([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
# Corner error [m].
TOLERANCE = 5e-3


def follow(command: np.ndarray, cycle: float = CYCLE) -> np.ndarray:
    """Return joint positions [rad], (n, dof), of joints with two `pid` and two `integ` each.

    `cycle`: cycle of the thread [s].
    """
    q = command[0].copy()
    v = np.zeros(command.shape[1])
    found = []
    for u in command:
        found.append(q.copy())
        v = v + cycle * np.clip(KV * (KP * (u - q) - v), -LIMIT, LIMIT)
        q = q + cycle * v
    return np.array(found)


def tool(q: np.ndarray) -> np.ndarray:
    """Return the positions of the tool [m], (n, 2)."""
    a = q[:, 0]
    b = q[:, 0] + q[:, 1]
    x = BASE + FIRST * np.sin(a) + SECOND * np.sin(b)
    return np.column_stack([x, FIRST * np.cos(a) + SECOND * np.cos(b)])


def distances(points: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Return distances from the path with a corner error [m], (n,); 0 for sharp corners."""
    best = np.full(len(points), np.inf)
    begin = POINTS[0]
    for a, b, c in zip(POINTS[:-2], POINTS[1:-1], POINTS[2:], strict=True):
        u = (b - a) / np.linalg.norm(b - a)
        v = (c - b) / np.linalg.norm(c - b)
        half = np.arccos(u @ v) / 2
        radius = tolerance / (1 / np.cos(half) - 1)
        start = b - u * radius * np.tan(half)
        end = b + v * radius * np.tan(half)
        inwards = (v - u) / np.linalg.norm(v - u)
        centre = b + inwards * radius / np.cos(half)
        from_centre = points - centre
        size = np.linalg.norm(from_centre, axis=1)
        within = from_centre @ -inwards >= size * np.cos(half)
        best = np.minimum(best, np.where(within, np.abs(size - radius), np.inf))
        best = np.minimum(best, _from_line(points, begin, start))
        begin = end
    return np.minimum(best, _from_line(points, begin, POINTS[-1]))


def _from_line(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[:, None]
    return np.asarray(np.linalg.norm(points - a - share * (b - a), axis=1))
