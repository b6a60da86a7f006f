"""Closed-form inverse kinematics of six joints of which 2 and 3 are parallel.

Either joint 4 is parallel to them and the axes 5 and 6 meet, as in the arms of Universal Robots, or
the axes 4, 5 and 6 meet in a wrist. Axes and points are those with all joints at 0, in the frame of
the base; the formulas are products of rotations about these axes (Murray, Li and Sastry, 1994).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.frames import Frame, cross_matrix
from armcontour.robot.chain import Chain, link_poses

# Axes meet or are parallel within this [m, rad].
EXACT = 1e-9
# What is nearer than this to the end of a reach, or to a posture in which axes meet, is not decided
# here [m, 1].
NEAR = 1e-6
# Poses whose reach is computed at once: the first ones, and later ones.
FIRST, AT_ONCE = 8, 4096


class Axis(NamedTuple):
    """A joint axis, with its matrix of the vector product."""

    along: FloatArray
    cross: FloatArray

    def turn(self, angle: FloatArray, v: FloatArray) -> FloatArray:
        """Vectors (..., 3) turned about the axis by angles (...), by Rodrigues' formula."""
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        along = (v @ self.along)[..., None] * self.along
        return np.asarray(along + c * (v - along) + s * (v @ self.cross.T))

    def across(self, v: FloatArray) -> FloatArray:
        """The parts of vectors at right angles to the axis."""
        return np.asarray(v - (v @ self.along)[..., None] * self.along)

    def angle(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Angles about the axis from vectors to others [rad]."""
        return np.arctan2(_dot(a @ self.cross.T, b), _dot(self.across(a), b))

    def meet(
        self, v: FloatArray, along: FloatArray, wanted: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Angles by which vectors are turned to have a component along a direction.

        Args:
            v: The vectors, (..., 3).
            along: The direction, (3,).
            wanted: The component, (...).

        Returns:
            How much of the component is lacking, below 0 if there are two angles, (...); and the
            angles, one of them twice where it is lacking [rad], (..., 2).
        """
        fixed = (v @ self.along) * float(self.along @ along)
        a, b, needed = v @ along - fixed, (v @ self.cross.T) @ along, wanted - fixed
        size = np.hypot(a, b)
        half = np.arccos(np.clip(needed / np.where(size > 0, size, 1.0), -1.0, 1.0))
        middle = np.arctan2(b, a)
        return np.abs(needed) - size, np.stack([middle + half, middle - half], axis=-1)


class Reach(NamedTuple):
    """What upper arm and forearm have to bridge for n poses; m is 2, or 1 for a wrist.

    Args:
        turned: Rotation of the last link from its position with all joints at 0, (n, 3, 3).
        lacking: How far the plane of both links is from the center, below 0 for none [m], (n,).
        first: Angles of the first joint [rad], (n, 2).
        wanted: Axis 6 with the first joint turned back, (n, 2, 3).
        fifth: Angles of joint 5 [rad], (n, 2, m); 0 for a wrist.
        bend: Angles of the joints 2, 3 and 4 together [rad], (n, 2, m); 0 for a wrist.
        open: Whether joint 5 brings axis 6 where it is wanted, (n, 2, m).
        flat: Whether axis 6 is nearly parallel to axis 2 there, (n, 2, m).
        way: Vector in the plane from joint 2 to the end of the forearm, (n, 2, m, 3).
        gap: How far the links are from bridging it, below 0 if they do [m], (n, 2, m).
    """

    turned: FloatArray
    lacking: FloatArray
    first: FloatArray
    wanted: FloatArray
    fifth: FloatArray
    bend: FloatArray
    open: BoolArray
    flat: BoolArray
    way: FloatArray
    gap: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """The axes of an arm whose joint positions are known in closed form.

    Args:
        axes: The axes.
        points: Points on them [m], (6, 3).
        center: The point at which the axes 5 and 6 meet [m], (3,).
        end: Rotation and position of the tool in the frame of the base, (3, 4).
        wrist: Whether the axis 4 meets them there; else joint 4 is parallel to 2 and 3.
    """

    axes: tuple[Axis, ...]
    points: FloatArray
    center: FloatArray
    end: FloatArray
    wrist: bool

    @classmethod
    def of(cls, chain: Chain) -> ClosedForm | None:
        """The axes of a chain; None for a chain of another kind."""
        if len(chain) != 6:
            return None
        links = link_poses(chain.replace(base=Frame()), np.zeros((1, 6)))[0, 1:]
        points, axes = links[..., 3], np.einsum("kij,kj->ki", links[..., :3], chain.axes)
        center = _meeting(points[4:6], axes[4:6])
        if center is None or not _parallel(axes[1], axes[2]):
            return None
        fourth = _meeting(points[3:5], axes[3:5])
        wrist = fourth is not None and bool(np.abs(fourth - center).max() < EXACT)
        if not wrist and not _parallel(axes[1], axes[3]):
            return None
        last = Frame(position=points[5], rotation=links[5, :, :3])
        return cls(
            axes=tuple(map(Axis, axes, cross_matrix(axes))),
            points=points,
            center=center,
            end=(last @ chain.tip @ chain.tool).matrix,
            wrist=wrist,
        )

    def solve(self, base: FloatArray, pose: FloatArray) -> FloatArray | None:
        """All joint positions that put the tool in a pose [rad], (k, 6); None near singularities.

        Args:
            base: Rotation and position of the base in the work frame, (3, 4).
            pose: Those of the tool, (3, 4).
        """
        x = Reach(*(value[0] for value in self._reach(base[None], pose[None])))
        if x.lacking > NEAR:
            return np.empty((0, 6))
        first, normal, third, fourth, fifth, sixth = self.axes
        upper, fore = self._links
        square = _dot(x.way, x.way)
        doubtful = x.open & (x.flat | (np.abs(x.gap) <= NEAR) | (square <= NEAR))
        if x.lacking > -NEAR or doubtful.any():
            return None
        # One axis more for the two angles of the elbow, then another for those of a wrist.
        cosine = (square - upper @ upper - fore @ fore) / 2
        lacking, elbow = normal.meet(fore, upper, cosine)
        exists = (x.open & (lacking <= 0))[..., None]
        q1 = x.first[:, None, None]
        q2 = normal.angle(upper + normal.turn(elbow, fore), x.way[..., None, :])
        if self.wrist:
            together = q2 + elbow
            wanted = normal.turn(-together, x.wanted[:, None, None])
            held = first.turn(q1, normal.turn(together, fourth.along)) @ x.turned
            lacking, q5 = fifth.meet(sixth.along, fourth.along, wanted @ fourth.along)
            if (exists & (np.abs(lacking) <= NEAR)).any():
                return None
            exists = (exists & (lacking <= 0))[..., None]
            q1, q2, elbow = q1[..., None], q2[..., None], elbow[..., None]
            q4 = fourth.angle(fifth.turn(q5, sixth.along), wanted[..., None, :])
            q6 = sixth.angle(held[..., None, :], fifth.turn(-q5, fourth.along))
        else:
            q5 = x.fifth[..., None]
            q4 = (normal.along @ fourth.along) * (x.bend[..., None] - q2 - elbow)
            held = first.turn(q1, normal.along) @ x.turned
            q6 = sixth.angle(held, fifth.turn(-q5, normal.along))
        q3 = (normal.along @ third.along) * elbow
        *q, exists = np.broadcast_arrays(q1, q2, q3, q4, q5, q6, exists)
        return np.asarray(np.pi - np.mod(np.pi - np.stack(q, axis=-1)[exists], 2 * np.pi))

    def beyond(self, bases: FloatArray, poses: FloatArray, enough: float) -> FloatArray:
        """How far poses are out of reach of the arm in several places [m], (n,).

        Args:
            bases: Rotations and positions of the base in the work frame, (n, 3, 4).
            poses: Those of the tool, (m, 3, 4).
            enough: Poses are looked at up to one that is farther out of reach [m].

        Returns:
            The largest distance that was found at a pose; infinite where no orientation of the
            wrist will do.
        """
        found, at, count = np.full(len(bases), -np.inf), 0, FIRST
        while at < len(poses) and (found <= enough).any():
            left = np.flatnonzero(found <= enough)
            few = poses[at : at + max(1, count // len(left))]
            x = self._reach(
                np.repeat(bases[left], len(few), axis=0), np.tile(few, (len(left), 1, 1))
            )
            gap = np.where(x.open, np.where(x.flat, 0.0, x.gap), np.inf).min(axis=(1, 2))
            gap = np.where(x.lacking > NEAR, x.lacking, np.where(x.lacking > -NEAR, 0.0, gap))
            found[left] = np.maximum(found[left], gap.reshape(len(left), -1).max(axis=1))
            at, count = at + len(few), AT_ONCE
        return found

    @property
    def _links(self) -> tuple[FloatArray, FloatArray]:
        """The upper arm and the forearm in the plane in which they move, with all joints at 0."""
        last = self.center if self.wrist else self.points[3]
        across = self.axes[1].across
        return across(self.points[2] - self.points[1]), across(last - self.points[2])

    def _reach(self, bases: FloatArray, poses: FloatArray) -> Reach:
        """What the links have to bridge for n poses, each with a base of its own."""
        first, normal, *_, fifth, sixth = self.axes
        foot, back = self.points[0], np.swapaxes(bases[:, :, :3], 1, 2)
        turned = back @ poses[:, :, :3] @ self.end[:, :3].T
        end = np.einsum("nij,nj->ni", back, poses[:, :, 3] - bases[:, :, 3])
        way = end + turned @ (self.center - self.end[:, 3]) - foot
        # Turning the first joint back brings the centre into the plane of upper arm and forearm.
        side = (self.center - foot) @ normal.along
        lacking, angles = first.meet(way, normal.along, np.full(len(way), side))
        at = foot + first.turn(angles, way[:, None])[:, :, None]
        wanted = first.turn(angles, (turned @ sixth.along)[:, None])
        bend = q5 = np.zeros((len(way), 2, 1))
        is_open, flat = bend == 0.0, bend != 0.0
        if not self.wrist:
            missing, q5 = fifth.meet(sixth.along, normal.along, wanted @ normal.along)
            bent = fifth.turn(q5, sixth.along)
            level = normal.across(bent)
            is_open, flat = (
                np.repeat(missing[..., None] <= NEAR, 2, axis=2),
                _dot(level, level) < NEAR,
            )
            bend = normal.angle(bent, wanted[:, :, None])
            at = at + normal.turn(bend, self.points[3] - self.center)
        upper, fore = (float(np.linalg.norm(x)) for x in self._links)
        way = normal.across(at - self.points[1])
        size = np.linalg.norm(way, axis=-1)
        gap = np.maximum(size - upper - fore, abs(upper - fore) - size)
        return Reach(turned, lacking, -angles, wanted, q5, bend, is_open, flat, way, gap)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products of vectors, (...)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _parallel(first: FloatArray, second: FloatArray) -> bool:
    """Whether two directions are parallel."""
    return float(np.linalg.norm(np.cross(first, second))) < EXACT


def _meeting(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """The point at which two lines meet [m], (3,); None if they do not, or are parallel."""
    across = np.cross(axes[0], axes[1])
    size = float(across @ across)
    gap = points[1] - points[0]
    if size < EXACT or abs(float(gap @ across)) > EXACT * np.sqrt(size):
        return None
    along = float(np.cross(gap, axes[1]) @ across) / size
    return np.asarray(points[0] + along * axes[0])
