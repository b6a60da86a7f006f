"""Closed-form inverse kinematics of six-joint arms whose joint axes 2 and 3 are parallel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.frames import Frame, cross_matrix
from armcontour.robot.chain import Chain, link_poses

# Tolerance for axes that intersect [m] or are parallel [1].
AXIS_TOLERANCE = 1e-9
# The closed form returns no result for poses closer than this to the limit of the reach [m] or to a
# singular posture [1]; the search determines their solutions.
NEAR_SINGULARITY = 1e-6
# Number of joint positions for a tool pose, of which some may not exist.
BRANCHES = 8


# Either axis 4 is parallel to axes 2 and 3, and axes 5 and 6 intersect, as in the arms of Universal
# Robots; or axes 4, 5 and 6 intersect in one point, the wrist. Axes and points are in the frame of
# the base with all joints at 0. The formulas are products of rotations about these axes (Murray, Li
# and Sastry, 1994).
class JointAxis(NamedTuple):
    """A joint axis, about which vectors rotate.

    Args:
        along: Unit vector along the axis, (3,).
        cross: Matrix of the vector product with this unit vector, (3, 3).
    """

    along: FloatArray
    cross: FloatArray

    def turn(self, angle: FloatArray, v: FloatArray) -> FloatArray:
        """Rotate vectors `v`, (..., 3), about the axis by `angle`, (...) (Rodrigues' formula)."""
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        along = (v @ self.along)[..., None] * self.along
        return np.asarray(along + c * (v - along) + s * (v @ self.cross.T))

    def across(self, v: FloatArray) -> FloatArray:
        """Return the components of vectors `v` normal to the axis."""
        return np.asarray(v - (v @ self.along)[..., None] * self.along)

    def angle(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the angles about the axis [rad] that rotate vectors a to the directions of b."""
        return np.arctan2(_dot(a @ self.cross.T, b), _dot(self.across(a), b))

    def solve_angles(
        self, v: FloatArray, along: FloatArray, component: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Solve for the angles about the axis that give `v` a component along a direction.

        Args:
            v: The vectors, (..., 3).
            along: The direction, (3,).
            component: Required component of the rotated vectors along the direction, (...).

        Returns:
            The missing part of the component, (...), which is negative if two angles exist; and the
            angles [rad], (..., 2), which are equal if the component cannot be reached.
        """
        fixed = (v @ self.along) * float(self.along @ along)
        a = v @ along - fixed
        b = (v @ self.cross.T) @ along
        needed = component - fixed
        size = np.hypot(a, b)
        half = np.arccos(np.clip(needed / np.where(size > 0, size, 1.0), -1.0, 1.0))
        middle = np.arctan2(b, a)
        return np.abs(needed) - size, np.stack([middle + half, middle - half], axis=-1)


class Reach(NamedTuple):
    """Geometry that the links must bridge for n poses; m angles of joint 5: 2, or 1 for a wrist.

    Args:
        turned: Rotation of the last link from its position with all joints at 0, (n, 3, 3).
        lacking: Distance from the plane of both links to the center [m], (n,); negative if joint 1
            can move the center into the plane.
        first: Angles of joint 1 [rad], (n, 2).
        target_axis: Required direction of axis 6, rotated back by joint 1, (n, 2, 3).
        fifth: Angles of joint 5 [rad], (n, 2, m); 0 for a wrist.
        bend: Angle of joint 2 plus those of joints 3 and 4 [rad], (n, 2, m); 0 for a wrist.
        feasible: True if joint 5 can give axis 6 the required direction, (n, 2, m).
        flat: True if axis 6 is nearly parallel to axis 2 at the angles `fifth`, (n, 2, m).
        vector: Vector in the plane from joint 2 to the end of the forearm [m], (n, 2, m, 3).
        gap: Length that the links lack [m], (n, 2, m); negative if they are long enough.
    """

    turned: FloatArray
    lacking: FloatArray
    first: FloatArray
    target_axis: FloatArray
    fifth: FloatArray
    bend: FloatArray
    feasible: BoolArray
    flat: BoolArray
    vector: FloatArray
    gap: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """Joint axes and points of an arm with closed-form inverse kinematics.

    Args:
        axes: The six joint axes, in the base frame with all joints at 0.
        points: One point on each axis [m], (6, 3).
        center: Intersection of axes 5 and 6 [m], (3,).
        end: Rotation and position of the tool in the base frame, (3, 4).
        wrist: True if axis 4 passes through `center`; otherwise joint 4 is parallel to 2 and 3.
    """

    axes: tuple[JointAxis, ...]
    points: FloatArray
    center: FloatArray
    end: FloatArray
    wrist: bool

    @classmethod
    def from_chain(cls, chain: Chain) -> ClosedForm | None:
        """Return the closed form of a chain; None if its geometry is another one."""
        if len(chain) != 6 or chain.slides.any() or chain.followers:
            return None
        links = link_poses(chain.replace(base=Frame()), np.zeros((1, 6)))[0, 1:]
        points = links[..., 3]
        axes = np.einsum("kij,kj->ki", links[..., :3], chain.axes)
        center = _intersect_axes(points[4:6], axes[4:6])
        if center is None or not _parallel(axes[1], axes[2]):
            return None
        fourth = _intersect_axes(points[3:5], axes[3:5])
        wrist = fourth is not None and bool(np.abs(fourth - center).max() < AXIS_TOLERANCE)
        if not wrist and not _parallel(axes[1], axes[3]):
            return None
        last = Frame(position=points[5], rotation=links[5, :, :3])
        return cls(
            axes=tuple(map(JointAxis, axes, cross_matrix(axes))),
            points=points,
            center=center,
            end=(last @ chain.tip @ chain.tool).matrix,
            wrist=wrist,
        )

    def solve(self, base: FloatArray, pose: FloatArray) -> FloatArray | None:
        """Return all joint positions for a tool pose [rad], (k, 6); None near singularities.

        Args:
            base: Base frame in the work frame, (3, 4).
            pose: Tool pose in the work frame, (3, 4).
        """
        reach = self._reach(base[None], pose[None])
        if reach.lacking[0] > NEAR_SINGULARITY:
            return np.empty((0, 6))
        square = _dot(reach.vector, reach.vector)
        doubtful = reach.feasible & (
            reach.flat | (np.abs(reach.gap) <= NEAR_SINGULARITY) | (square <= NEAR_SINGULARITY)
        )
        if reach.lacking[0] > -NEAR_SINGULARITY or doubtful.any():
            return None
        q, exists, near_wrist = self._bridge(reach)
        return None if near_wrist[0] else q[exists]

    def solve_many(self, bases: FloatArray, poses: FloatArray) -> FloatArray:
        """Return joint positions for n tool poses [rad], (n, 8, 6); NaN where none exist.

        Each of the 8 columns is one branch. Near singularities some solutions may be missing.

        Args:
            bases: Base frames in the work frame, (n, 3, 4).
            poses: Tool poses in the work frame, (n, 3, 4).
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            reach = self._reach(bases, poses)
            q, exists, _ = self._bridge(reach)
        exists &= (reach.lacking <= 0).reshape(-1, *(1,) * (exists.ndim - 1))
        q[~exists] = np.nan
        return q.reshape(len(poses), BRANCHES, 6)

    def _bridge(self, reach: Reach) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Solve for the joints of n poses by the geometry that the links must bridge.

        Returns joint positions [rad], (n, 2, ..., 6); whether they exist, (n, 2, ...); and whether
        a pose is near a singularity of the wrist, (n,).
        """
        first, normal, third, fourth, fifth, sixth = self.axes
        upper, fore = self._links
        square = _dot(reach.vector, reach.vector)
        near_wrist: BoolArray = np.zeros(len(square), dtype=np.bool_)
        # The last array axis is for the two elbow angles; a wrist adds an axis for its two angles.
        cosine = (square - upper @ upper - fore @ fore) / 2
        lacking, elbow = normal.solve_angles(fore, upper, cosine)
        exists = (reach.feasible & (lacking <= 0))[..., None]
        q1 = reach.first[:, :, None, None]
        q2 = normal.angle(upper + normal.turn(elbow, fore), reach.vector[..., None, :])
        turned = reach.turned[:, None, None]
        if self.wrist:
            together = q2 + elbow
            axis = normal.turn(-together, reach.target_axis[:, :, None, None])
            rotated = first.turn(q1, normal.turn(together, fourth.along)) @ turned
            lacking, q5 = fifth.solve_angles(sixth.along, fourth.along, axis @ fourth.along)
            near = exists & (np.abs(lacking) <= NEAR_SINGULARITY)
            near_wrist = np.asarray(near.any(axis=(1, 2, 3)))
            exists = (exists & (lacking <= 0))[..., None]
            q1 = q1[..., None]
            q2 = q2[..., None]
            elbow = elbow[..., None]
            q4 = fourth.angle(fifth.turn(q5, sixth.along), axis[..., None, :])
            q6 = sixth.angle(rotated[..., None, :], fifth.turn(-q5, fourth.along))
        else:
            q5 = reach.fifth[..., None]
            q4 = (normal.along @ fourth.along) * (reach.bend[..., None] - q2 - elbow)
            rotated = first.turn(q1, normal.along) @ turned
            q6 = sixth.angle(rotated, fifth.turn(-q5, normal.along))
        q3 = (normal.along @ third.along) * elbow
        *q, exists = np.broadcast_arrays(q1, q2, q3, q4, q5, q6, exists)
        stacked = np.pi - np.mod(np.pi - np.stack(q, axis=-1), 2 * np.pi)
        return stacked, exists.copy(), near_wrist

    @property
    def _links(self) -> tuple[FloatArray, FloatArray]:
        """Upper arm and forearm as vectors in their plane with all joints at 0 [m], (3,) each."""
        last = self.center if self.wrist else self.points[3]
        across = self.axes[1].across
        return across(self.points[2] - self.points[1]), across(last - self.points[2])

    def _reach(self, bases: FloatArray, poses: FloatArray) -> Reach:
        """Compute the geometry that the links must bridge for n poses, each with its own base."""
        first, normal, *_, fifth, sixth = self.axes
        foot = self.points[0]
        back = np.swapaxes(bases[:, :, :3], 1, 2)
        turned = back @ poses[:, :, :3] @ self.end[:, :3].T
        end = np.einsum("nij,nj->ni", back, poses[:, :, 3] - bases[:, :, 3])
        center = end + turned @ (self.center - self.end[:, 3]) - foot
        # Joint 1 must rotate the centre into the plane of upper arm and forearm.
        side = (self.center - foot) @ normal.along
        lacking, angles = first.solve_angles(center, normal.along, np.full(len(center), side))
        end_point = foot + first.turn(angles, center[:, None])[:, :, None]
        target = first.turn(angles, (turned @ sixth.along)[:, None])
        angle_sum = q5 = np.zeros((len(center), 2, 1))
        is_open = angle_sum == 0.0
        flat = angle_sum != 0.0
        if not self.wrist:
            missing, q5 = fifth.solve_angles(sixth.along, normal.along, target @ normal.along)
            bent = fifth.turn(q5, sixth.along)
            level = normal.across(bent)
            is_open = np.repeat(missing[..., None] <= NEAR_SINGULARITY, 2, axis=2)
            flat = _dot(level, level) < NEAR_SINGULARITY
            angle_sum = normal.angle(bent, target[:, :, None])
            end_point = end_point + normal.turn(angle_sum, self.points[3] - self.center)
        upper, fore = (float(np.linalg.norm(x)) for x in self._links)
        center = normal.across(end_point - self.points[1])
        size = np.linalg.norm(center, axis=-1)
        gap = np.maximum(size - upper - fore, abs(upper - fore) - size)
        return Reach(turned, lacking, -angles, target, q5, angle_sum, is_open, flat, center, gap)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar products of vectors, (...)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _parallel(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two directions are parallel."""
    return float(np.linalg.norm(np.cross(first, second))) < AXIS_TOLERANCE


def _intersect_axes(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """Return the intersection of two lines [m], (3,); None if they are parallel or skew."""
    across = np.cross(axes[0], axes[1])
    size = float(across @ across)
    gap = points[1] - points[0]
    if size < AXIS_TOLERANCE or abs(float(gap @ across)) > AXIS_TOLERANCE * np.sqrt(size):
        return None
    along = float(np.cross(gap, axes[1]) @ across) / size
    return np.asarray(points[0] + along * axes[0])
