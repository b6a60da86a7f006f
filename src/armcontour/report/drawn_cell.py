"""Joints and links of an arm and its cell, as a tree from the floor, and the bodies on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.report.triangles import triangles_of
from armcontour.robot import Arm
from armcontour.robot.scene import Box, Cylinder

# Lengths below this value are not drawn [m].
SHORTEST = 1e-3
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnJoint:
    """A joint from the floor to the part, or from the floor to the tool.

    Args:
        name: Name of the joint.
        prismatic: Whether it slides.
        parent: Index of the link that carries the joint; 0 is the floor, or the base without a
            positioner. Link k is after the k-th drawn joint.
        column: Index of its position in a posture of the arm.
        factor: Factor of this position; not 1 for a joint that follows another one.
        axis: Its direction in its own frame, (3,).
        origin: Its frame at 0 in the frame of the parent.
        lower, upper: Its range [rad or m]; infinite without one.
    """

    name: str
    prismatic: bool
    parent: int
    column: int
    factor: float
    axis: FloatArray
    origin: Frame
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A drawn body.

    Args:
        name: Name of the link, obstacle or external axis.
        link: Index of the link with which it moves; see `DrawnJoint`.
        kind: What it is, which determines its colour: "link", "joint", "tool", "axis" (of an
            external axis), "obstacle", "table" or "part".
        place: Its frame in the frame of the link.
        triangles: Its triangles in its own frame [m], (n, 3, 3).
    """

    name: str
    link: int
    kind: str
    place: Frame
    triangles: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnCell:
    """The links of a cell with all joints at 0, in the frame of the floor.

    Args:
        joints: Joints from the floor to the part, then from the floor to the tip.
        positioner: Number of joints of the positioner, which are the first ones.
        frames: Frames of the links in the frame of the floor, link 0 first.
    """

    joints: tuple[DrawnJoint, ...]
    positioner: int
    frames: tuple[Frame, ...] = field(repr=False)

    @classmethod
    def of(cls, arm: Arm) -> DrawnCell:
        """List the joints of an arm and its positioner, and compute the frames at 0."""
        joints = tuple(_joints(arm))
        frames = [Frame()]
        for joint in joints:
            frames.append(frames[joint.parent] @ joint.origin)
        return cls(joints=joints, positioner=arm.chain.floor_link, frames=tuple(frames))

    @property
    def sliding(self) -> int:
        """Number of prismatic joints between the floor and the arm's first revolute joint."""
        count = 0
        for joint in self.joints[self.positioner :]:
            if not joint.prismatic:
                break
            count += 1
        return count

    def direction(self, link: int) -> FloatArray:
        """Return the direction of the joint before a link in the frame of the floor, (3,)."""
        return np.asarray(self.frames[link].rotation @ self.joints[link - 1].axis)

    def place(self, body: Body) -> FloatArray:
        """Return the corners of a body with all joints at 0 in the frame of the floor, (n, 3)."""
        frame = self.frames[body.link] @ body.place
        points = body.triangles.reshape(-1, 3)
        return np.asarray(frame.position + points @ frame.rotation.T)

    def box(
        self, name: str, link: int, center: FloatArray, axes: FloatArray, size: Sequence[float]
    ) -> Body:
        """Make a box of an external axis that moves with a link.

        Args:
            name: Name of the external axis.
            link: Index of the link.
            center: Its centre in the frame of the floor [m], (3,).
            axes: Directions of its edges as columns, (3, 3).
            size: Lengths of its edges [m].
        """
        shape = Box(size=np.array(size))
        return self._axis_body(name, link, Frame(center, axes), triangles_of(shape))

    def cylinder(
        self, name: str, link: int, start: FloatArray, end: FloatArray, radius: float
    ) -> Body:
        """Make a cylinder of an external axis between two points in the frame of the floor [m]."""
        along = end - start
        shape = Cylinder(radius=radius, length=float(np.linalg.norm(along)))
        frame = Frame((start + end) / 2, frame_along(along))
        return self._axis_body(name, link, frame, triangles_of(shape))

    def _axis_body(self, name: str, link: int, frame: Frame, triangles: FloatArray) -> Body:
        place = self.frames[link].inverse @ frame
        return Body(name=name, link=link, kind="axis", place=place, triangles=triangles)


def frame_along(direction: FloatArray) -> FloatArray:
    """Return a rotation whose z axis has a direction, (3, 3)."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _joints(arm: Arm) -> Iterator[DrawnJoint]:
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
            yield DrawnJoint(
                name=row.name,
                prismatic=row.slides,
                parent=k + carried if k else 0,
                column=column,
                factor=row.factor,
                axis=row.axis,
                origin=row.place,
                lower=float(lower[column]),
                upper=float(upper[column]),
            )
