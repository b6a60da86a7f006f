"""Joints and links in series: joint axes, masses, inertias, friction, payload."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.frames import Frame, exp, rotations
from armcontour.core.quantities import (
    Axes,
    CoulombFrictions,
    JointArmatures,
    Name,
    Quantity,
    ViscousFrictions,
    joint_units,
    shared_unit,
)
from armcontour.robot.bodies import INERTIA, Payload, check_inertia
from armcontour.robot.external_axes import Positioner, PositionerAxis, Rail
from armcontour.robot.preferences import Prefer

# Fields with one row per joint
PER_JOINT = (
    *("rotations", "positions", "axes", "masses", "centers", "inertias"),
    *("armature", "viscous", "coulomb", "weights"),
)
# Fields of `arm_branch`, the chain from the floor to the tool
FROM_FLOOR: dict[str, Any] = {
    "held": {},
    "still": (),
    "columns": (),
    "ranges": {},
    "positioner": None,
    "floor_link": 0,
    "floor": Frame(),
    "base": Frame(),
}
# Fields that change often and have their own checks, so that `replace` need not check the links.
FRAMES = frozenset(("base", "tip", "tool", "payload"))
GRAVITY = checks.frozen_array([0.0, 0.0, -9.81])
LENGTH = Quantity("m")


@declared(eq=False)
class Follower(Checked):
    """A joint inside an arm that follows another joint, as the linkage of a palletizer.

    It has no drive and no position of its own: it turns by `factor` times the position of its
    leader. The next joint, or the tip, is in its frame.

    Args:
        after: Index of the joint after which it comes; it is in the frame of this joint's link, or
            of the previous follower of the same link.
        leader: Index of the joint that it follows.
        factor: Its position divided by that of the leader.
        place: Its frame at 0 in the frame before it.
        axis: Its axis as a unit vector in its frame, (3,).
    """

    after: int
    leader: int
    factor: Annotated[float, Quantity("")]
    place: Frame
    axis: Annotated[FloatArray, Quantity(""), Axes(3)]

    def shifted(self, by: int) -> Follower:
        """Return the follower in a chain that has more joints before it.

        Args:
            by: Number of these joints.
        """
        return replace(self, after=self.after + by, leader=self.leader + by)


class Row(NamedTuple):
    """A row of the kinematics of a chain: a joint or a follower."""

    name: str
    # Position [m], (3,), and rotation, (3, 3), at 0 in the frame of the previous row
    position: FloatArray
    rotation: FloatArray
    axis: FloatArray  # Unit vector in this frame, (3,)
    slides: bool
    leader: int  # Index of the joint whose position moves it
    factor: float  # Its position divided by that of this joint
    follows: bool  # True for a follower

    @property
    def place(self) -> Frame:
        """Frame at 0 in the frame of the previous row; its rotation is orthonormalized."""
        return Frame(position=self.position, rotation=self.rotation)


@declared(eq=False)
class Chain(Checked):
    """Joints in series, each with the link after the joint; arrays have one row per joint.

    Joint i turns by q[i] about `axes[i]`, or moves by q[i] along it if it is prismatic. The frame
    of joint i is also the frame of link i; at q = 0 it has the position `positions[i]` and the
    rotation `rotations[i]` in the frame of link i - 1. The first joint is in the frame of the base.
    For a prismatic joint, m replaces rad and N replaces N m in all units. The frames `floor`,
    `base`, `tip` and `tool` are by default the same as the frame in which they are given.

    Args:
        joints: Names of the joints.
        rotations: Rotations of the joint frames, (n, 3, 3).
        positions: Positions of the joint frames [m], (n, 3).
        axes: Joint axes as unit vectors in the joint frames, (n, 3).
        masses: Masses of the links [kg], (n,); None if they are not known.
        centers: The links' centres of mass in the link frames [m], (n, 3); required with masses.
        inertias: Inertias of the links about their centres of mass, along the axes of the link
            frames [kg m²], (n, 3, 3); required with masses.
        armature: Inertia of each drive, reflected to its joint [kg m²], (n,); 0 by default.
        viscous: Viscous friction of the joints [N m s/rad], (n,); 0 by default.
        coulomb: Coulomb friction of the joints [N m], (n,); 0 by default.
        prismatic: Whether each joint is prismatic (sliding), (n,); by default all are revolute.
        weights: Weights of the joint motions for a redundant arm, (n,); 1 by default. A joint with
            a larger weight moves less.
        held: Positions at which some joints stay [rad], by index; by default all joints move.
        followers: Joints that follow other joints, in the order from the base; by default none.
        still: Indices of joints that stay still within each contour; by default none.
        columns: Indices of revolute joints that carry the arm, as a rotating column does; they are
            external axes. By default none.
        ranges: Preferred ranges of some joints [rad], by index, inside the joints' own ranges.
        prefer: What the planner prefers if a redundant arm can follow a path in several ways; None
            weighs time against joint motion.
        positioner: The positioner whose axes are the first joints, from the part to the floor; None
            without one. With a positioner the base is the table, and its frame is that of the floor
            with these joints at 0.
        floor_link: Index of the link that stands on the floor; 0 is the base.
        floor: Frame of the floor, which is that of the arm's base or rail, in the frame of this
            link.
        base: Frame of the base in the work frame, in which tool points are given.
        tip: Flange frame (end of the chain) in the frame of the last link.
        tool: Tool frame in the frame of the tip. Its origin follows paths; its z axis is the tool
            axis.
        gravity: Gravitational acceleration in the floor frame [m/s²], (3,); by default 9.81 m/s²
            along -z.
        payload: Load at the tip; None without one.
        assumed: Assumed data and the rule by which they are assumed; empty if none are assumed.

    Raises:
        InvalidInput: Shapes of arrays do not match, a matrix is not a rotation, or no body can have
            the mass or inertia of a link.
    """

    joints: Annotated[tuple[Name, ...], Axes("joints")]
    rotations: Annotated[FloatArray, Quantity(""), Axes("joints", 3, 3)]
    positions: Annotated[FloatArray, LENGTH, Axes("joints", 3)]
    axes: Annotated[FloatArray, Quantity(""), Axes("joints", 3)]
    masses: Annotated[FloatArray, Quantity("kg"), Axes("joints")] | None = None
    centers: Annotated[FloatArray, LENGTH, Axes("joints", 3)] | None = None
    inertias: Annotated[FloatArray, INERTIA, Axes("joints", 3, 3)] | None = None
    armature: Annotated[JointArmatures, Axes("joints")] | None = None
    viscous: Annotated[ViscousFrictions, Axes("joints")] | None = None
    coulomb: Annotated[CoulombFrictions, Axes("joints")] | None = None
    prismatic: Annotated[tuple[bool, ...], Axes("joints")] | None = None
    weights: Annotated[FloatArray, Quantity("", sign="positive"), Axes("joints")] | None = None
    held: Mapping[int, float] = field(default_factory=dict)
    followers: tuple[Follower, ...] = ()
    still: tuple[int, ...] = ()
    columns: tuple[int, ...] = ()
    ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    prefer: Prefer | None = None
    positioner: Positioner | None = None
    floor_link: int = 0
    floor: Frame = field(default_factory=Frame)
    base: Frame = field(default_factory=Frame)
    tip: Frame = field(default_factory=Frame)
    tool: Frame = field(default_factory=Frame)
    gravity: Annotated[FloatArray, Quantity("m/s^2"), Axes(3)] = field(
        default_factory=lambda: GRAVITY
    )
    payload: Payload | None = None
    assumed: str = ""

    def _check_together(self) -> None:
        """Complete missing fields, and check axes, rotations, masses and inertias."""
        n = len(self.joints)
        if n == 0:
            raise InvalidInput("A chain needs at least one joint.")
        if self.masses is not None and (self.centers is None or self.inertias is None):
            raise InvalidInput("A chain with masses also requires centres of mass and inertias.")
        for name in ("armature", "viscous", "coulomb"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, checks.frozen_array(np.zeros(n)))
        if self.prismatic is None:
            object.__setattr__(self, "prismatic", (False,) * n)
        if self.weights is None:
            object.__setattr__(self, "weights", checks.frozen_array(np.ones(n)))
        # Rotations are checked, but not orthonormalized.
        rotations("rotations of a chain", self.rotations)
        if (np.abs(np.linalg.norm(self.axes, axis=1) - 1) > 1e-9).any():
            raise InvalidInput("The axes of a chain must be unit vectors.")
        if self.masses is None or self.inertias is None:
            return
        for name, mass, inertia in zip(self.joints, self.masses, self.inertias, strict=True):
            if mass < 0:
                raise InvalidInput(
                    f"The mass of the link after {name} must not be negative, but is {mass:g} kg."
                )
            check_inertia(f"the link after {name}", inertia)

    def __len__(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def slides(self) -> BoolArray:
        """Mask of the prismatic joints, (n,)."""
        return np.array(self.prismatic, dtype=np.bool_)

    @checked
    def unit(self, unit: str, joint: int | None = None) -> str:
        """Convert a unit of revolute joints, such as rad/s, to that of this chain's joints.

        >>> ac.load_arm("ur5e").chain.unit("rad/s")
        'rad/s'

        Args:
            unit: Unit that revolute joints have; prismatic joints have m instead of rad, and N
                instead of N m.
            joint: Index of a joint. By default the result is for all joints, with one unit per
                joint if they differ.

        Raises:
            InvalidInput: The joint does not exist.
        """
        chosen = self.prismatic or ()
        if joint is not None:
            checks.raise_if(not 0 <= joint < len(chosen), f"There is no joint {joint}.")
            return joint_units(unit, chosen)[joint]
        return shared_unit(unit, chosen)

    @property
    def rows(self) -> list[Row]:
        """The joints and their followers, from the base to the tip."""
        rows: list[Row] = []
        for k in range(len(self)):
            place = (self.positions[k], self.rotations[k])
            slides = bool(self.slides[k])
            rows.append(Row(self.joints[k], *place, self.axes[k], slides, k, 1.0, False))
            for x in self.followers:
                if x.after == k:
                    name = f"follower of {self.joints[x.leader]}"
                    place = (x.place.position, x.place.rotation)
                    rows.append(Row(name, *place, x.axis, False, x.leader, x.factor, True))
        return rows

    @property
    def joint_row(self) -> IntArray:
        """Index of each joint among the `rows`, (n,)."""
        after = np.array([x.after for x in self.followers], dtype=np.intp)
        return np.array([k + np.sum(after < k) for k in range(len(self))], dtype=np.intp)

    def without_followers(self, frames: FloatArray) -> FloatArray:
        """Return the frames of joints and tool, (n, joints + 1, 3, 4), from those of all rows.

        Args:
            frames: Frames of the `rows` and of the tool, (n, rows + 1, 3, 4).
        """
        return frames[:, [*self.joint_row, -1]] if self.followers else frames

    @property
    def external(self) -> tuple[int, ...]:
        """Indices of the external axes: those that carry the arm, then a positioner's.

        Prismatic joints and rotating columns carry the arm. All are in the order from the floor.
        """
        first = self.floor_link
        sliding = np.flatnonzero(self.slides[first:]) + first
        carrying = sorted({*sliding.tolist(), *self.columns})
        return (*carrying, *range(first - 1, -1, -1))

    @property
    def arm_branch(self) -> Chain:
        """The chain from the floor to the tool, without the positioner."""
        if self.positioner is None:
            return self
        rows = joint_rows(self, np.arange(self.floor_link, len(self)))
        first = Frame(position=rows["positions"][0], rotation=rows["rotations"][0])
        first = self.floor.inverse @ first
        rows["positions"][0] = first.position
        rows["rotations"][0] = first.rotation
        followers = tuple(x.shifted(-self.floor_link) for x in self.followers)
        return self.replace(**rows, **FROM_FLOOR, followers=followers)

    @property
    def part_branch(self) -> Chain | None:
        """The chain from the floor to the part, its payload; its joints have the opposite order."""
        if self.positioner is None:
            return None
        axes = self.positioner.axes
        count = self.floor_link
        origins = np.array([x.origin for x in axes])
        # Centres of bodies are in the frames of the axes.
        centers = [x.origin if x.center is None else x.center for x in axes] - origins
        return Chain(
            joints=self.joints[:count][::-1],
            rotations=np.tile(np.eye(3), (count, 1, 1)),
            positions=np.diff(origins, axis=0, prepend=0.0),
            axes=_directions(axes),
            masses=np.array([x.mass for x in axes]),
            centers=centers,
            inertias=np.array([x.inertia for x in axes]),
            **{x: getattr(self, x)[:count][::-1] for x in ("armature", "viscous", "coulomb")},
            prismatic=tuple(x.prismatic for x in axes),
            tip=Frame(position=-origins[-1]) @ self.base.inverse,
            gravity=self.gravity,
            payload=self.positioner.part,
        )

    @checked
    def on_rail(self, rail: Rail) -> Chain:
        """Return the chain with a rail as its first joint."""
        if self.positioner is not None:
            raise InvalidInput("The arm already has a positioner: add its rail first.")
        return self._with_first(
            ("rail",), [rail], rail.origin, prismatic=(True,), positions=np.zeros((1, 3))
        )

    @checked
    def on_positioner(self, positioner: Positioner) -> Chain:
        """Return the chain from the part over the positioner axes and the floor to the tool."""
        if self.positioner is not None:
            raise InvalidInput("The arm already has a positioner.")
        # The transform from the floor to the part multiplies the axes' motions. Its inverse
        # multiplies the opposite motions in the opposite order.
        axes = positioner.axes[::-1]
        origins = np.array([x.origin for x in axes])
        chain = self._with_first(
            tuple(x.name for x in axes),
            axes,
            -origins[-1],
            prismatic=tuple(x.prismatic for x in axes),
            axes=-_directions(axes),
            positions=np.diff(origins, axis=0, prepend=0.0),
            # The bodies are in the first branch.
            masses=np.zeros(len(axes)),
        )
        floor = Frame(position=-origins[-1])
        return chain.replace(positioner=positioner, floor_link=len(axes), floor=floor)

    def _with_first(
        self,
        names: tuple[str, ...],
        added: Sequence[Rail | PositionerAxis],
        offset: FloatArray,
        *,
        prismatic: tuple[bool, ...],
        **changes: FloatArray,
    ) -> Chain:
        """Return the chain with joints put before its own, which move by `offset` [m], (3,)."""
        n = len(names)
        if clash := set(names) & set(self.joints):
            raise InvalidInput(f"The arm already has a joint of the name {min(clash)}.")
        first: dict[str, FloatArray] = {
            "rotations": np.tile(np.eye(3), (n, 1, 1)), "axes": _directions(added),
            "masses": np.array([x.mass for x in added]), "centers": np.zeros((n, 3)),
            "inertias": np.zeros((n, 3, 3)), "weights": np.ones(n),
            **dict.fromkeys(("armature", "viscous", "coulomb"), np.zeros(n)),
        } | changes  # fmt: skip
        own = joint_rows(self, np.arange(len(self)))
        own["positions"][0] += offset
        return self.replace(
            **{x: np.concatenate([first[x], rows]) for x, rows in own.items() if x in PER_JOINT},
            joints=(*names, *self.joints),
            prismatic=(*prismatic, *own["prismatic"]),
            held={k + n: x for k, x in self.held.items()},
            still=tuple(k + n for k in self.still),
            columns=tuple(k + n for k in self.columns),
            ranges={k + n: x for k, x in self.ranges.items()},
            followers=tuple(x.shifted(n) for x in self.followers),
        )

    @checked
    def with_base_moved(self, moved: Frame) -> Chain:
        """Return the chain with the base of the arm, and its rail, moved in the cell.

        Args:
            moved: Displacement of the base in the work frame, with a positioner's axes at 0.
        """
        base = moved @ self.base
        if self.positioner is None:
            return self.replace(base=base)
        # The axes do not move, so their coordinates in the frame of the base change.
        seen = self.positioner.seen_from(self.base.inverse @ base)
        axes = seen.axes[::-1]
        count = self.floor_link
        origins = np.array([x.origin for x in axes])
        positions = np.array(self.positions)
        positions[:count] = np.diff(origins, axis=0, prepend=0.0)
        positions[count] += -origins[-1] - self.floor.position
        directions = np.array(self.axes)
        directions[:count] = -_directions(axes)
        gravity = base.rotation.T @ self.base.rotation @ self.gravity
        return self.replace(
            positioner=seen,
            axes=directions,
            positions=positions,
            floor=Frame(position=-origins[-1], rotation=self.floor.rotation),
            base=base,
            gravity=gravity,
        )

    def without_held(self) -> Chain:
        """Return the chain for kinematics in which the held joints are rigid."""
        frames: list[Frame] = []
        followers: list[Follower] = []
        before = Frame()
        floor = self.floor
        moving = np.setdiff1d(np.arange(len(self)), list(self.held))
        number = {k: i for i, k in enumerate(moving.tolist())}
        k = -1
        for row in self.rows:
            before = before @ row.place
            k += not row.follows
            if row.leader in self.held:
                moved = row.factor * self.held[row.leader] * row.axis
                rigid = Frame(position=moved) if row.slides else Frame(rotation=exp(moved))
                before = before @ rigid
            elif row.follows:
                follower = Follower(
                    after=len(frames) - 1,
                    leader=int(np.searchsorted(moving, row.leader)),
                    factor=row.factor,
                    place=before,
                    axis=row.axis,
                )
                followers.append(follower)
                before = Frame()
            else:
                frames.append(before)
                before = Frame()
            if k + 1 == self.floor_link and not row.follows:
                floor = before @ floor
        return self.replace(
            **joint_rows(self, moving)
            | {
                "positions": np.array([x.position for x in frames]),
                "rotations": np.array([x.rotation for x in frames]),
                **dict.fromkeys(("masses", "centers", "inertias")),
            },
            held={},
            followers=tuple(followers),
            still=tuple(number[k] for k in self.still if k in number),
            columns=tuple(number[k] for k in self.columns if k in number),
            ranges={number[k]: x for k, x in self.ranges.items() if k in number},
            floor_link=int(np.sum(moving < self.floor_link)),
            floor=floor,
            tip=before @ self.tip,
        )

    def replace(self, **changes: object) -> Chain:
        """Return the chain with some of its data changed."""
        if not FRAMES.issuperset(changes):
            return dataclasses.replace(self, **changes)  # type: ignore[arg-type]
        # The frames and the payload are already checked. A check of all links would take a
        # millisecond.
        chain = copy(self)
        for name, value in changes.items():
            object.__setattr__(chain, name, value)
        return chain


def _directions(axes: Sequence[Rail | PositionerAxis]) -> FloatArray:
    """Return the unit vectors of the axes, (n, 3)."""
    along = np.array([x.axis for x in axes], dtype=np.float64)
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def state_rows(dof: int, *states: npt.ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
    """Return the common leading shape of joint states, and the states as rows, (n, dof)."""
    # The shapes are checked because compiled code would read past the end of a short row.
    arrays = [checks.floats("states of an arm", x) for x in states]
    shape = arrays[0].shape
    if shape[-1:] != (dof,) or any(x.shape != shape for x in arrays):
        shapes = [x.shape for x in arrays]
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError:
            shape = ()
        if any(x[-1:] != (dof,) for x in (shape, *shapes)):
            raise InvalidInput(
                f"The states of {dof} joints must be arrays with {dof} columns that can be "
                f"broadcast together, but have the shapes {', '.join(map(str, shapes))}."
            )
        arrays = [np.broadcast_to(x, shape) for x in arrays]
    # Numba would compile the kernels again for read-only arrays.
    return shape[:-1], [checks.kernel_array(x.reshape(-1, dof)) for x in arrays]


def link_poses(chain: Chain, q: npt.ArrayLike) -> FloatArray:
    """Return the base and link frames of `chain` in the work frame at q, (n, dof + 1, 3, 4)."""
    from armcontour.robot.kernels import frames_of

    frames = frames_of(link_table(chain), checks.kernel_array(np.asarray(q, dtype=np.float64)))
    joints = chain.without_followers(frames)
    poses = np.empty_like(joints)
    poses[:, 0] = chain.base.matrix
    poses[:, 1:, :, :3] = joints[:, :-1, :, :3] @ np.swapaxes(joint_frames(chain), 1, 2)
    poses[:, 1:, :, 3] = joints[:, :-1, :, 3]
    return poses


def joint_rows(chain: Chain, joints: IntArray) -> dict[str, Any]:
    """Return the fields of `chain` with one value per joint, for the joint indices `joints`."""
    rows = {x: getattr(chain, x) for x in PER_JOINT}
    chosen: dict[str, Any] = {x: y[joints] for x, y in rows.items() if y is not None}
    for name in ("joints", "prismatic"):
        chosen[name] = tuple(getattr(chain, name)[k] for k in joints)
    return chosen


def floor_poses(chain: Chain, q: FloatArray) -> FloatArray:
    """Return the floor frame of `chain` in the work frame at q, (n, dof), as (n, 3, 4)."""
    link = link_poses(chain, q)[:, chain.floor_link]
    floor = chain.floor
    origin = link[..., :3] @ floor.position + link[..., 3]
    return np.concatenate([link[..., :3] @ floor.rotation, origin[..., None]], axis=2)


def link_table(chain: Chain) -> FloatArray:
    """Return the link table of `chain` for the compiled kinematics, (rows + 1, 15)."""
    # A row has the rotation (row by row) and the position of a joint frame or the tool frame,
    # relative to the previous frame; the first is relative to the work frame. z is the joint axis.
    # The last columns are 1 for a prismatic joint, otherwise 0; the index of the joint whose
    # position moves the row, and the factor of this position.
    rows = chain.rows
    table = np.empty((len(rows) + 1, 15))
    end = chain.tip @ chain.tool
    table[:, 12] = *(x.slides for x in rows), False
    table[:, 13] = *(x.leader for x in rows), -1
    table[:, 14] = *(x.factor for x in rows), 0.0
    turns = [*_frames_along(np.array([x.axis for x in rows])), np.eye(3)]
    rotations = [*(x.rotation for x in rows), end.rotation]
    positions = [*(x.position for x in rows), end.position]
    before = chain.base.rotation
    offset = chain.base.position
    for row, rotation, position, turn in zip(table, rotations, positions, turns, strict=True):
        row[:9] = (before @ rotation @ turn).ravel()
        row[9:12] = offset + before @ position
        before = turn.T
        offset = np.zeros(3)
    return checks.frozen_array(table)


def joint_frames(chain: Chain) -> FloatArray:
    """Return rotations in the link frames of `chain` that turn z to the joint axes, (n, 3, 3)."""
    return _frames_along(chain.axes)


def _frames_along(axes: FloatArray) -> FloatArray:
    """Return rotations that turn z to unit vectors, (n, 3) to (n, 3, 3)."""
    frames = np.tile(np.eye(3), (len(axes), 1, 1))
    for frame, axis in zip(frames, axes, strict=True):
        if axis[2] != 1.0:
            across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
            frame[:, 0] = across / np.linalg.norm(across)
            frame[:, 1] = np.cross(axis, frame[:, 0])
            frame[:, 2] = axis
    return frames
