"""Frames and vectorised rotations in space: rotation vectors, matrices, roll-pitch-yaw."""

from __future__ import annotations

import warnings
from dataclasses import field
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import declared
from armcontour.core.guesses import Explained
from armcontour.core.quantities import WHOLE_TURN

# Tolerance of `R^T R - I` for rotation matrices R, which are then made orthonormal.
ROTATION_TOLERANCE = 1e-6
# Tolerance of the length of quaternions (about four printed digits), which are then normalized.
QUATERNION_TOLERANCE = 1e-3
# A frame maps the x-y plane to itself if its z offset [m] and tilt are at most this. An arc is
# parallel to this plane if the z components of its vectors are at most this.
IN_PLANE = 1e-12
# Cosine of the pitch below which roll and yaw count as rotations about the same axis.
VERTICAL_COSINE = 1e-9
# Sine of the angle between unit vectors below which they count as parallel.
PARALLEL_SINE = 1e-12
ORIGIN = checks.frozen_array(np.zeros(3))
IDENTITY = checks.frozen_array(np.eye(3))


@declared(eq=False)
class Frame(Explained):
    """Position and orientation of a frame in another frame.

        table = Frame((0.5, 0.0, 0.1))
        flipped = Frame((0.4, 0.0, 0.3), Rotation.from_euler("x", 180, degrees=True))

    >>> table = ac.Frame(position=(0.4, 0.0, 0.1))
    >>> table.position
    array([0.4, 0. , 0.1])

    Args:
        position: Origin of the frame [m], (3,), by default 0; or the whole frame as a homogeneous
            transform, (4, 4), or a pinocchio.SE3.
        rotation: Rotation matrix with the axes of the frame as columns, (3, 3), by default the
            identity; or a quaternion (x, y, z, w) or a rotation of scipy.

    Raises:
        InvalidInput: The position does not have 3 coordinates, or the rotation is invalid.
    """

    position: FloatArray = field(default_factory=lambda: ORIGIN, kw_only=False)
    rotation: FloatArray = field(default_factory=lambda: IDENTITY, kw_only=False)

    def __post_init__(self) -> None:
        # Fast path for the most frequent frame, whose arrays are valid and read-only.
        if self.position is ORIGIN and self.rotation is IDENTITY:
            return
        position, rotation = read_poses("position of a frame", self.position)
        if position.shape != (3,):
            raise InvalidInput(
                f"The position of a frame must be 3 coordinates in m, not {position.size}."
            )
        object.__setattr__(self, "position", checks.frozen_array(position))
        if rotation is None:
            rotation = rotations("rotation of a frame", self.rotation)
        elif self.rotation is not IDENTITY:
            raise InvalidInput("Specify a frame by a transform, or by a position and a rotation.")
        if rotation.shape != (3, 3):
            raise InvalidInput("A frame must have exactly one rotation.")
        object.__setattr__(self, "rotation", checks.frozen_array(rotation))

    @classmethod
    def from_pose(cls, pose: Pose) -> Frame:
        """Convert a pose to a `Frame`; a `Frame` is returned unchanged.

        Args:
            pose: A Frame, a homogeneous transform, (4, 4), a pinocchio.SE3 or a position [m], (3,).

        Raises:
            InvalidInput: The value is none of these.
        """
        return pose if isinstance(pose, Frame) else cls(pose)  # type: ignore[arg-type]

    @classmethod
    def rpy(cls, position: npt.ArrayLike, angles: npt.ArrayLike) -> Frame:
        """Make a frame rotated by roll, pitch and yaw about fixed x, y and z axes, as in URDF.

        Args:
            position: Origin of the frame [m], (3,).
            angles: Roll, pitch and yaw [rad], (3,).

        Warns:
            UserWarning: An angle is larger than a whole turn, and probably in degrees.
        """
        rpy = checks.check_numbers("roll, pitch and yaw", angles, "rad")
        if (np.abs(rpy) > WHOLE_TURN).any():
            largest = float(rpy.flat[int(np.abs(rpy).argmax())])
            warnings.warn(
                f"Roll, pitch and yaw are in radians, and {largest:g} rad is more than a whole "
                f"turn. If they are in degrees, use np.radians({rpy.tolist()}).",
                stacklevel=3,
            )
        return cls(
            position=checks.check_numbers("position of a frame", position, "m"),
            rotation=from_rpy(rpy),
        )

    def __matmul__(self, other: Frame) -> Frame:
        """Return the frame `other`, which is given in this frame, in the reference frame."""
        return Frame(
            position=self.position + self.rotation @ other.position,
            rotation=self.rotation @ other.rotation,
        )

    @property
    def matrix(self) -> FloatArray:
        """Rotation and position side by side, (3, 4)."""
        return np.column_stack([self.rotation, self.position])

    @property
    def homogeneous(self) -> FloatArray:
        """Homogeneous transform, (4, 4)."""
        return transforms(self.matrix)

    @property
    def is_planar_transform(self) -> bool:
        """Return whether the transform is a motion within the x-y plane, without a flip."""
        lifted = max(abs(self.position[2]), float(np.abs(self.rotation[2] - [0, 0, 1]).max()))
        return bool(lifted <= IN_PLANE)

    @property
    def inverse(self) -> Frame:
        """Inverse transform: the reference frame in coordinates of this frame."""
        back = self.rotation.T
        return Frame(position=-back @ self.position, rotation=back)


class Transform(Protocol):
    """An object with a homogeneous transform, such as `pinocchio.SE3`."""

    @property
    def homogeneous(self) -> FloatArray:
        """The transform, (4, 4)."""


Pose: TypeAlias = Frame | Transform | npt.ArrayLike


def transforms(matrices: FloatArray) -> FloatArray:
    """Return homogeneous transforms, (..., 4, 4), from rotations and positions, (..., 3, 4)."""
    homogeneous = np.zeros((*matrices.shape[:-2], 4, 4))
    homogeneous[..., :3, :] = matrices
    homogeneous[..., 3, 3] = 1.0
    return homogeneous


def read_poses(name: str, poses: Pose) -> tuple[FloatArray, FloatArray | None]:
    """Return the positions [m], (..., 3) or (..., 2), and rotations of poses, (..., 3, 3) or None.

    A pose is a `Frame`, a `pinocchio.SE3` or another object with `homogeneous` or `as_matrix`, a
    homogeneous transform, (..., 4, 4), or a position alone, which has no rotation.
    """
    for attribute in ("homogeneous", "as_matrix"):
        if hasattr(poses, attribute):
            pose = getattr(poses, attribute)
            poses = pose() if callable(pose) else pose
    array = checks.check_numbers(name, poses, "m")  # type: ignore[arg-type]
    if array.shape[-2:] == (4, 4) and array.size:
        if not (array[..., 3, :] == (0.0, 0.0, 0.0, 1.0)).all():
            raise InvalidInput(
                f"{name}: the last row of a homogeneous transform must be 0, 0, 0, 1."
            )
        rotation = rotations(f"rotation of {name}", array[..., :3, :3].reshape(-1, 3, 3))
        return array[..., :3, 3], rotation.reshape(*array.shape[:-2], 3, 3)
    if array.shape[-1:] not in ((2,), (3,)) or not array.size:
        raise InvalidInput(
            f"{name} must be a Frame, a 4 by 4 transform, a pinocchio.SE3 or a position in m, but "
            f"has the shape {array.shape}."
        )
    return array, None


def rotations(name: str, values: Any) -> FloatArray:
    """Return rotation matrices, (3, 3) or (n, 3, 3).

    `values` are rotation matrices, quaternions (x, y, z, w), or a rotation of scipy.

    Raises:
        InvalidInput: A matrix is not a rotation within `ROTATION_TOLERANCE`, or a quaternion does
            not have the length 1 within `QUATERNION_TOLERANCE`.
    """
    if hasattr(values, "as_matrix"):
        values = values.as_matrix()
    array = checks.check_numbers(name, values)
    if _is_transform(array):
        raise InvalidInput(f"{name} is a 4 by 4 transform. Use Frame, or its 3 by 3 rotation.")
    if array.ndim in (1, 2) and array.shape[-1] == 4:
        size = np.linalg.norm(array, axis=-1, keepdims=True)
        deviation = np.abs(size - 1)
        if (deviation > QUATERNION_TOLERANCE).any():
            raise InvalidInput(
                f"{name}: a quaternion (x, y, z, w) must have the length 1 within "
                f"{QUATERNION_TOLERANCE:g}, but has {size.flat[int(np.argmax(deviation))]:.6g}."
            )
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_quat(array).as_matrix())
    if array.ndim not in (2, 3) or array.shape[-2:] != (3, 3):
        raise InvalidInput(
            f"{name} must be rotation matrices (3 by 3) or quaternions (x, y, z, w), but has the "
            f"shape {array.shape}."
        )
    if not _are_rotations(array):
        raise InvalidInput(
            f"{name} has a matrix that is not a rotation. The axes of a rotation are orthogonal, "
            "of length 1 and right-handed."
        )
    u, _, v = np.linalg.svd(array)
    return np.asarray(u @ v)


def from_rpy(angles: npt.ArrayLike) -> FloatArray:
    """Return rotation matrices R = R_z(yaw) R_y(pitch) R_x(roll), (..., 3, 3).

    `angles` are roll, pitch and yaw about the fixed x, y and z axes [rad], (..., 3).
    """
    rpy = checks.check_numbers("roll, pitch and yaw", angles, "rad")
    if rpy.shape[-1:] != (3,):
        raise InvalidInput("Roll, pitch and yaw must be three angles.")
    x, y, z = (rpy[..., k, None] * IDENTITY[k] for k in range(3))
    return np.asarray(exp(z) @ exp(y) @ exp(x))


def to_rpy(rotation: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw about fixed x, y and z [rad], (3,), of a rotation matrix.

    The inverse of `from_rpy`. At a pitch of ±90°, where roll and yaw share an axis, the yaw is 0.
    """
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < VERTICAL_COSINE:
        # Roll and yaw have the same axis, so the whole rotation is assigned to roll.
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def exp(vectors: npt.ArrayLike) -> FloatArray:
    """Return the rotation matrices of rotation vectors v [rad], (..., 3) to (..., 3, 3).

    Rodrigues' formula: R = I + (sin θ / θ) K + ((1 - cos θ) / θ²) K², with the length θ of v and
    K w = v × w.

    >>> exp([0.0, 0.0, np.pi / 2]).round(3)[:, 0]
    array([0., 1., 0.])
    """
    v = np.asarray(vectors, dtype=np.float64)
    angle = np.sqrt(np.sum(v * v, axis=-1))[..., None, None]
    # `np.sinc(x)` is sin(pi x) / (pi x).
    sine_term = np.sinc(angle / np.pi)
    cosine_term = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    k = cross_matrix(v)
    return np.asarray(np.eye(3) + sine_term * k + cosine_term * (k @ k))


def quaternions(matrices: npt.ArrayLike) -> FloatArray:
    """Return unit quaternions x, y, z, w with w >= 0, (4,) or (n, 4), of rotation matrices."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_matrix(np.asarray(matrices, dtype=np.float64))
    return np.asarray(rotation.as_quat(canonical=True))


def log(matrices: npt.ArrayLike) -> FloatArray:
    """Return rotation vectors [rad], of length 0 to pi, of rotation matrices, (3, 3) or (n, 3, 3).

    The inverse of `exp`: the unit quaternion (v, w) has the angle `θ = 2 atan2(|v|, w)` about v.
    """
    q = quaternions(matrices)
    size = np.sqrt(np.sum(q[..., :3] ** 2, axis=-1))
    angle = 2 * np.arctan2(size, q[..., 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(size > 0, angle / size, 0.0)
    return np.asarray(q[..., :3] * scale[..., None])


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return the cross-product matrices K with `K w = v x w`, (..., 3) to (..., 3, 3)."""
    k = np.zeros((*v.shape, 3))
    k[..., 0, 1] = -v[..., 2]
    k[..., 0, 2] = v[..., 1]
    k[..., 1, 2] = -v[..., 0]
    return k - np.swapaxes(k, -1, -2)


def shortest(first: npt.ArrayLike, second: npt.ArrayLike) -> FloatArray:
    """Return the rotation vectors [rad], (..., 3), of the shortest rotations between unit vectors.

    Opposite vectors have no unique shortest rotation; the axis is then one of those normal to them.

    >>> shortest([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]).round(4)
    array([0.    , 0.    , 1.5708])
    """
    a = np.asarray(first, dtype=np.float64)
    b = np.asarray(second, dtype=np.float64)
    axis = np.cross(a, b)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = angle_between(a, b)[..., None]
    any_axis = perpendicular(a)
    any_axis /= np.linalg.norm(any_axis, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.where(size > PARALLEL_SINE, axis / size, any_axis)
    # Make the axis exactly normal to the first vector, because near half a turn an error of the
    # axis would count twice.
    unit = unit - np.sum(unit * a, axis=-1, keepdims=True) * a
    unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    return np.asarray(unit * angle)


def perpendicular(vectors: FloatArray) -> FloatArray:
    """Return vectors normal to given vectors, (..., 3), of at least 81 % of their length."""
    return np.cross(vectors, np.eye(3)[np.argmin(np.abs(vectors), axis=-1)])


def angle_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the angles between unit vectors a and b [rad], from 0 to pi.

    `2 atan2(|a - b|, |a + b|)` is accurate near 0 and near pi, where arccos(a · b) is not.
    """
    difference = np.linalg.norm(first - second, axis=-1)
    total = np.linalg.norm(first + second, axis=-1)
    return np.asarray(2 * np.arctan2(difference, total))


def _is_transform(array: FloatArray) -> bool:
    """Return whether an array is a homogeneous transform, not four quaternions."""
    if array.shape != (4, 4) or not np.array_equal(array[3], [0.0, 0.0, 0.0, 1.0]):
        return False
    return _are_rotations(array[:3, :3])


def _are_rotations(matrices: FloatArray) -> bool:
    """Return whether all matrices are rotations within `ROTATION_TOLERANCE`."""
    # Entries of a rotation are at most 1; much larger entries could overflow below.
    capped = np.clip(matrices, -2.0, 2.0)
    deviation = np.abs(np.swapaxes(capped, -1, -2) @ capped - np.eye(3)).max(axis=(-2, -1))
    return not ((deviation > ROTATION_TOLERANCE).any() or (np.linalg.det(capped) < 0).any())
