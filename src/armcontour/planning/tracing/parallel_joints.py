"""Orientations of paths for arms whose tool turns about one direction only, or not at all.

Their tool follows the position of the path, and the rotation about this direction (task dimension
4) or no rotation (3).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, NoReturn

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import Unreachable
from armcontour.core.fields import declared
from armcontour.core.quantities import LARGEST_CONE, Axes, Quantity
from armcontour.core.text import capitalise
from armcontour.geometry import Orientation, Path
from armcontour.robot import SerialArm
from armcontour.robot.preferred_chain import list_held
from armcontour.robot.tool_turning import REACHED_ANGLE, ToolTurning

# Fractions of a piece of an orientation at which it is compared with the tool's rotations
COMPARED = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
# An orientation is replaced by the nearest one that the tool can have if they differ by more than
# this angle [rad].
ROUNDING = 1e-13
UNIT = Quantity("", within=(-1.0 - 1e-9, 1.0 + 1e-9))


@declared(eq=False)
class TurnedOrientation(Orientation):
    """The orientation nearest to another one that turns about one direction only.

    The fields of `Orientation` are those of the other one.

    Args:
        axis: Direction about which the tool turns, a unit vector, (3,).
        rotation: Rotation of the tool with the joints at 0, (3, 3).
        of_axis: Only the tool axis of the other orientation is prescribed.
    """

    axis: Annotated[FloatArray, UNIT, Axes(3)] = None  # type: ignore[assignment]
    rotation: Annotated[FloatArray, UNIT, Axes(3, 3)] = None  # type: ignore[assignment]
    of_axis: bool = False

    @property
    def _turning(self) -> ToolTurning:
        return ToolTurning(axis=self.axis, rotation=self.rotation)

    def on_piece(self, i: IntArray, u: FloatArray) -> FloatArray:
        """Return rotation matrices at distance `u` after the start of piece `i`.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        return self._turning.nearest(Orientation.on_piece(self, i, u), axis_only=self.of_axis)

    def rates_on_piece(self, i: IntArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the angular rate [rad/m] and its derivative [rad/m²] on piece `i`, (n, 3) each.

        With the components a and b of `ToolTurning`, the angle is `atan2(a, b)`. Its derivative is
        `(a' b - a b') / (a² + b²)`.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        turned = Orientation.on_piece(self, i, u)
        rate, change = Orientation.rates_on_piece(self, i, u)
        spin = _cross_matrices(rate)
        first = spin @ turned
        second = _cross_matrices(change) @ turned + spin @ first
        a, b = self._turning.components(turned, axis_only=self.of_axis)
        da, db = self._turning.components(first, axis_only=self.of_axis)
        dda, ddb = self._turning.components(second, axis_only=self.of_axis)
        square = a**2 + b**2
        d_angle = (da * b - a * db) / square
        dd_angle = (dda * b - a * ddb - 2 * d_angle * (a * da + b * db)) / square
        return d_angle[:, None] * self.axis, dd_angle[:, None] * self.axis


def task_of_parallel_joints(path: Path, arm: SerialArm, turning: ToolTurning) -> int:
    """Return the task dimension of an arm whose tool turns about one direction, or not at all.

    Args:
        path: The path.
        arm: The arm.
        turning: The rotations of its tool.

    Raises:
        Unreachable: The path requires an orientation that the tool cannot have.
    """
    orientation = path.orientation
    if orientation is None:
        return 3
    axis_only = orientation.axis_only
    _check_reached(path, arm, orientation, turning)
    if turning.turns and not (axis_only and turning.keeps_axis):
        return 4
    return 3


def check_held(path: Path, arm: SerialArm, moving: SerialArm) -> None:
    """Raise Unreachable if only held joints keep the tool from the orientations of a path.

    Args:
        path: The path.
        arm: The arm with its held joints.
        moving: The arm without them.
    """
    orientation = path.orientation
    turning = moving.tool_turning
    if orientation is None or turning is None or not arm.chain.held:
        return
    held = tuple(sorted(arm.chain.held))
    alone = [k for k in held if _can_turn(path, arm, (k,))]
    if not alone and not _can_turn(path, arm, held):
        return
    released = alone or list(held)
    names = [arm.joint_names[k] for k in released]
    words = f"do not hold {(' or ' if alone else ' and ').join(names)}"
    cause = _Held(arm=arm, joint=released[0], remedy=words)
    _check_reached(path, moving, orientation, turning, cause)


def _can_turn(path: Path, arm: SerialArm, released: tuple[int, ...]) -> bool:
    """Return whether the tool has the orientations of a path if some held joints are released."""
    freed = arm.without_held(released)
    turning = freed.tool_turning
    assert path.orientation is not None
    task = 5 if path.orientation.axis_only else 6
    if turning is not None:
        try:
            task = task_of_parallel_joints(path, freed, turning)
        except Unreachable:
            return False
    return task <= freed.dof


def turn_as_tool(path: Path, arm: SerialArm) -> Path:
    """Return the path with the nearest orientation that the tool can have.

    For arms whose tool turns about several directions, and if the orientation is equal, it is the
    same path.

    Args:
        path: The path, whose orientation the tool reaches.
        arm: The arm.
    """
    orientation = path.orientation
    turning = arm.tool_turning
    if orientation is None or turning is None:
        return path
    axis_only = orientation.axis_only
    if axis_only and turning.keeps_axis:
        # The rotation is free, and the position alone is followed.
        return path
    _, rotations = _samples(orientation)
    if turning.missed(rotations, axis_only=False).max() <= ROUNDING:
        return path if not axis_only else replace(path, orientation=_whole(orientation))
    if orientation.fixed:
        starts = turning.nearest(orientation.starts, axis_only=axis_only)
        return replace(path, orientation=replace(_whole(orientation), starts=starts))
    names = [x.name for x in fields(Orientation) if x.init]
    values = {name: getattr(orientation, name) for name in names}
    values |= {"axis_only": False, "cone": 0.0}
    turned = TurnedOrientation(
        **values, axis=turning.axis, rotation=turning.rotation, of_axis=axis_only
    )
    return replace(path, orientation=turned)


def _whole(orientation: Orientation) -> Orientation:
    """Return an orientation whose rotation about the tool axis is also prescribed."""
    return replace(orientation, axis_only=False, cone=0.0)


def _samples(orientation: Orientation) -> tuple[FloatArray, FloatArray]:
    """Return arc lengths on all pieces of an orientation [m], (n,), and rotations, (n, 3, 3)."""
    pieces = np.repeat(np.arange(len(orientation)), len(COMPARED))
    along = (np.diff(orientation.breaks)[:, None] * COMPARED).ravel()
    return orientation.breaks[pieces] + along, orientation.on_piece(pieces, along)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Held:
    """Held joints without which the tool has the orientations of a path."""

    arm: SerialArm  # The arm with its held joints
    joint: int  # Index of the first of these joints
    remedy: str  # Which joints must be released, as a clause


def _check_reached(
    path: Path,
    arm: SerialArm,
    orientation: Orientation,
    turning: ToolTurning,
    held: _Held | None = None,
) -> None:
    """Raise Unreachable where the path requires an orientation that the tool cannot have."""
    s, rotations = _samples(orientation)
    missed = turning.missed(rotations, axis_only=orientation.axis_only)
    allowed = max(REACHED_ANGLE, orientation.cone)
    if missed.max() <= allowed:
        return
    k = int(np.argmax(missed))
    axis_missed = turning.missed(rotations[k : k + 1], axis_only=True)[0]
    only_rotation = axis_missed <= REACHED_ANGLE
    if not turning.turns:
        joints = f"the joints of the arm {arm.name} do not turn its tool"
    else:
        joints = (
            f"the tool of the arm {arm.name} turns only about {_direction(turning.axis)}, the "
            f"direction of its {'' if held is None else 'other '}revolute joints"
        )
    if held is not None:
        joints = f"while preferences hold {list_held(held.arm.chain)}, {joints}"
    joints = capitalise(joints)
    if only_rotation:
        remedy = "leave it free with axis_only"
        if held is not None:
            remedy = f"{held.remedy}, or {remedy}"
        _refuse(path, float(s[k]), float(missed[k]), joints, remedy, held)
    nearest = turning.nearest(rotations[k : k + 1], axis_only=True)[0, :, 2]
    if turning.turns and not turning.keeps_axis:
        tool = float(np.degrees(np.arccos(np.clip(turning.axis @ nearest, -1.0, 1.0))))
        joints += f", to which its tool axis has the angle {tool:.4g} deg"
    else:
        joints += f", so its tool axis is always {_direction(nearest)}"
    required = rotations[k, :, 2]
    cone = ""
    if orientation.axis_only and axis_missed < LARGEST_CONE:
        cone = f", allow a cone of {np.ceil(100 * np.degrees(axis_missed)) / 100:g} deg"
    remedy = f"specify the tool axis {_direction(nearest)}{cone}, "
    if held is None:
        remedy += "turn the part or the tool, or use an arm with more joints"
    else:
        remedy = f"{held.remedy}, {remedy}or turn the part or the tool"
    _refuse(path, float(s[k]), float(axis_missed), joints, remedy, held, required)


def _refuse(
    path: Path,
    s: float,
    angle: float,
    joints: str,
    remedy: str,
    held: _Held | None,
    required: FloatArray | None = None,
) -> NoReturn:
    """Raise Unreachable for an orientation that the tool misses by an angle [rad].

    - `s`: arc length at which the tool misses the orientation [m].
    - `joints`: how the joints turn the tool.
    - `remedy`: what can be done, as a clause.
    - `held`: held joints that are the cause, if any.
    - `required`: the tool axis that the path requires, (3,); None if only the rotation about it is
      missed.
    """
    if required is None:
        what = "the path requires another rotation about the tool axis"
    else:
        what = f"the path requires the tool axis {_direction(required)}"
    raise Unreachable(
        f"{joints}, but at {s:.6g} m along the path {what}, {np.degrees(angle):.4g} deg away. "
        f"{capitalise(remedy)}.",
        s=s,
        point=path(s).tolist(),
        joint=None if held is None else held.joint,
        limit="orientation",
        needed=angle,
        allowed=REACHED_ANGLE,
    )


def _direction(vector: FloatArray) -> str:
    """Write a unit vector with four digits."""
    rounded = (round(float(x), 4) + 0.0 for x in vector)
    return f"({', '.join(f'{x:g}' for x in rounded)})"


def _cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return the matrices by which a vector product multiplies, (n, 3, 3), for (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[:, j, i] = vectors[:, k]
        matrices[:, i, j] = -vectors[:, k]
    return matrices
