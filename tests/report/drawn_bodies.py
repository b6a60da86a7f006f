"""The bodies of a message frame with an arm, placed as its header describes."""

import numpy as np


class Drawing:
    """The drawn bodies, placed as the frame's header describes."""

    def __init__(self, frame):
        self.header = frame.header
        self.bodies = [
            (x, frame.arrays[x["triangles"]].reshape(-1, 3).astype(float), np.array(x["at"]))
            for x in self.header["bodies"]
        ]

    def links(self, q):
        poses = [np.eye(4)]
        for joint in self.header["joints"]:
            motion = np.eye(4)
            axis = np.array(joint["axis"])
            position = joint["factor"] * q[joint["column"]]
            if joint["type"] == "prismatic":
                motion[:3, 3] = axis * position
            else:
                motion = turn(axis, np.zeros(3), position)
            poses.append(poses[joint["parent"]] @ np.array(joint["origin"]) @ motion)
        return poses

    def corners(self, q, wanted):
        """Corners of the wanted bodies at q in the frame of the floor, (n, 3) each."""
        poses = self.links(q)
        placed = ((x, poses[x["link"]] @ at, points) for x, points, at in self.bodies if wanted(x))
        return [points @ pose[:3, :3].T + pose[:3, 3] for _, pose, points in placed]

    def named(self, name, q, kind="axis"):
        return self.corners(q, lambda x: x["name"] == name and x["colour"] == kind)


def turn(along, origin, angle):
    """Transform of a rotation about a line, by Rodrigues' formula."""
    x, y, z = np.array(along) / np.linalg.norm(along)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    made = np.eye(4)
    made[:3, :3] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    made[:3, 3] = np.array(origin) - made[:3, :3] @ np.array(origin)
    return made


def in_picture(drawing, q, program, camera):
    """Check that bodies and path are in a picture; return the largest distance from its middle.

    - `q`: posture, (dof,).
    - `camera`: projection from the frame of the floor to the picture, (16,) by columns.
    """
    bodies = drawing.corners(q, lambda x: x["colour"] != "table")
    part = drawing.header["part"]
    pose = drawing.links(q)[part["link"]] @ np.array(part["at"])
    for contour in program.contours:
        points = contour.path(np.linspace(0.0, contour.path.length, 100))
        bodies.append(points @ pose[:3, :3].T + pose[:3, 3])
    points = np.concatenate(bodies)
    projected = np.column_stack([points, np.ones(len(points))]) @ np.reshape(camera, (4, 4))
    assert (projected[:, 3] > 0).all()
    picture = np.abs(projected[:, :2] / projected[:, 3:])
    assert picture.max() <= 1.0
    return picture.max()
