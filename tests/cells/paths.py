"""Paths of the integrators' cells: points [m] and tool axes, in the coordinates of the part."""

import numpy as np

DOWN = (0.0, 0.0, -1.0)


def circle(count=121):
    """Angles of a whole turn."""
    return np.linspace(0.0, 2 * np.pi, count)


def radial(angle):
    """Horizontal unit vectors at angles, shape (n, 3)."""
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def rounded_rectangle(length, width, radius, step=0.01):
    """Closed outline about the origin, counterclockwise, with its outward normals.

    It begins in the middle of the side that is right of the origin. Lines are divided into pieces
    of at most `step`.
    """
    inner = np.array([length / 2 - radius, width / 2 - radius])
    turns = np.linspace(0.0, np.pi / 2, 13)
    begin = np.array([[length / 2, 0.0]])
    points = [begin]
    normals = [np.array([[1.0, 0.0]])]
    for quarter, signs in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        normal = radial(quarter * np.pi / 2 + turns)[:, :2]
        points.append(np.array(signs) * inner + radius * normal)
        normals.append(normal)
    points.append(begin)
    normals.append(normals[0])
    return divided(np.concatenate(points), np.concatenate(normals), step)


def divided(points, normals, step):
    """Points of a polyline with lines of at most `step`, and normals between those given."""
    dense_points = [points[:1]]
    dense_normals = [normals[:1]]
    for i in range(len(points) - 1):
        count = int(np.ceil(np.linalg.norm(points[i + 1] - points[i]) / step))
        part = np.arange(1, count + 1)[:, None] / count
        dense_points.append(points[i] + part * (points[i + 1] - points[i]))
        dense_normals.append(normals[i] + part * (normals[i + 1] - normals[i]))
    found = np.concatenate(dense_normals)
    return np.concatenate(dense_points), found / np.linalg.norm(found, axis=1)[:, None]


def in_plane(points, height):
    """Points in space at a height."""
    return np.column_stack([points, np.full(len(points), height)])


def tilted(normals, angle):
    """Tool axes that point down and, by an angle [rad], against horizontal normals."""
    flat = np.column_stack([normals[:, :2], np.zeros(len(normals))])
    return -np.sin(angle) * flat + np.cos(angle) * np.array(DOWN)


def pipe_on_flange():
    """Seam between a pipe of 168 mm and a flange, with the torch at 45 degrees."""
    outward = radial(circle())
    return 0.084 * outward + [0, 0, 0.02], tilted(outward, np.pi / 4)


def tube_on_plate():
    """Seam around a tube of 100 x 60 mm along y, with the torch 20 degrees from its sides."""
    outline, normals = rounded_rectangle(0.1, 0.06, 0.01)
    points = np.column_stack([outline[:, 0], np.full(len(outline), 0.3), outline[:, 1]])
    outward = np.column_stack([normals[:, 0], np.zeros(len(normals)), normals[:, 1]])
    lean = np.radians(20)
    return points, -np.cos(lean) * outward + np.sin(lean) * np.array([0, 1, 0])


def cone():
    """Four turns up a cone, with the torch normal to it."""
    angle = np.linspace(0.0, 8 * np.pi, 481)
    part = angle / angle[-1]
    points = (0.15 - 0.09 * part)[:, None] * radial(angle)
    points[:, 2] = 0.02 + 0.15 * part
    normal = 0.15 * radial(angle) + np.array([0, 0, 0.09])
    return points, -normal / np.linalg.norm(normal, axis=1)[:, None]


def compartment():
    """Inner seam of a compartment of 1.5 x 0.8 m, with the torch at 45 degrees to its walls."""
    outline, normals = rounded_rectangle(1.5, 0.8, 0.03, step=0.05)
    return in_plane(outline + [0.75, 0.4], 0.0), tilted(-normals, np.pi / 4)


def bevelled_plate():
    """Outline of a plate: a vertical cut, and a bevel of 30 degrees on one long side."""
    outline, normals = rounded_rectangle(0.5, 0.3, 0.02, step=0.01)
    # The bevel begins and ends within 60 mm.
    ramp = np.clip((0.19 - np.abs(outline[:, 0])) / 0.06, 0, 1) * (outline[:, 1] > 0.149)
    angle = np.radians(30) * ramp
    flat = np.column_stack([normals, np.zeros(len(normals))])
    axes = -np.sin(angle)[:, None] * flat + np.cos(angle)[:, None] * np.array(DOWN)
    return in_plane(outline, 0.0), axes


def tapered_hole():
    """A round hole of 200 mm, with the jet 1.5 degrees from the vertical."""
    outward = radial(circle())
    return 0.1 * outward, tilted(outward, np.radians(1.5))


def chamfer():
    """Chamfer around a plate of 80 x 60 mm."""
    outline, normals = rounded_rectangle(0.08, 0.06, 0.01)
    return in_plane(outline, 0.04), tilted(normals, np.pi / 4)


def dome():
    """Six turns up a dome, from 20 to 75 degrees of latitude, with the tool normal to it."""
    angle = np.linspace(0.0, 12 * np.pi, 721)
    latitude = np.radians(np.linspace(20, 75, len(angle)))
    normal = np.cos(latitude)[:, None] * radial(angle)
    normal[:, 2] = np.sin(latitude)
    return 0.08 * normal + [0, 0, 0.05], -normal


def gasket():
    """Outline of a gasket of 120 x 80 mm."""
    outline, normals = rounded_rectangle(0.12, 0.08, 0.015)
    return in_plane(outline, 0.0), np.tile(DOWN, (len(normals), 1))


def vase():
    """Eight layers of a vase as one spiral."""
    angle = np.linspace(0.0, 16 * np.pi, 961)
    part = angle / angle[-1]
    points = (0.12 + 0.02 * part)[:, None] * radial(angle)
    points[:, 2] = 0.02 + 0.024 * part
    return points, np.tile(DOWN, (len(points), 1))


def tank():
    """Seam around a tank of 300 mm whose axis is y, with the torch normal to it."""
    angle = circle()
    outward = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    return 0.15 * outward, -outward


def write(file, points, axes):
    """Write points and tool axes as a table that jobs read."""
    lines = ["x [mm],y [mm],z [mm],ax,ay,az"]
    for row in np.column_stack([1e3 * points, axes]):
        lines.append(",".join(f"{x:.9f}" for x in row))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
