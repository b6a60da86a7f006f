"""`Deviations`: what the unknowns of a box do to a motion, linear around its plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.core.fields import Checked
from armcontour.drives import Drives, regular_times, respond_along
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.motion import TaughtData
from armcontour.robustness.unknowns import Unknowns
from armcontour.servo.simulation import polynomials, sample_command

# Time between two times of the model: a share of the command interval, and at most [s].
PER_INTERVAL = 8
LONGEST_STEP = 5e-4
# After the last set-point joints are followed for this many time constants of the slowest loop.
TAIL = 10.0
# A joint that is slower than this share of its largest velocity stands still: rounding.
STILL = 1e-9
# A joint at this speed rests [rad/s], a micron a second at 1 m: a plan leaves it at rest up to
# rounding errors of either sign.
RESTS = 1e-6
# Times whose bounds are computed at once, and products of times and robots, so that arrays fit in
# a cache.
BLOCK = 1024
PRODUCTS = 1e6
# Longest time between two samples of contour errors of many robots [s].
RESOLUTION = 2e-3
# Number of unknowns up to which all corners are looked at.
ALL_CORNERS = 14


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations(Checked):
    """Deviations of the joints from a plan: `nominal + each @ errors`, to first order.

    Errors of parameters are torques along the plan, to which the closed loops respond. Deviations
    of the tool are those of the joints by the Jacobian.

    Args:
        t: Regular times from the first set-point on [s], (n,).
        q: Planned joint positions [rad], (n, dof).
        nominal: Deviation of the nominal robot, from its set-points [rad], (n, dof).
        each: Deviation per error of each unknown [rad], (n, dof, k).
        unknowns: The unknowns.
        path: The tool path.
    """

    t: FloatArray
    q: FloatArray
    nominal: FloatArray
    each: FloatArray
    unknowns: Unknowns
    path: Path

    def across(self) -> Across:
        """The parts of the deviations that are contour errors: those across the path.

        At rest before and after the motion those along it are errors, too: there the path ends.
        """
        arm = self.unknowns.arm
        nearest = self.path.project(arm.tool_position(self.q))
        tangent = self.path(nearest.s, 1)
        sides = _sides(tangent / np.linalg.norm(tangent, axis=1)[:, None])
        sides[1:-1, -1] = 0.0
        moved = sides @ arm.tool_jacobian(self.q)
        return Across(
            t=self.t,
            nominal=np.einsum("ncj,nj->nc", moved, self.nominal),
            each=moved @ self.each,
            unknowns=self.unknowns,
        )

    def distances(self, errors: FloatArray) -> FloatArray:
        """Distances from the tool to the path, of another robot at every time [m], (n,).

        The path is the true one with its corners, and not its tangent.

        Args:
            errors: Errors of the unknowns, (n, k).
        """
        q = self.q + self.nominal + np.einsum("njk,nk->nj", self.each, errors)
        return self.path.project(self.unknowns.arm.tool_position(q)).distance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Across:
    """Deviations that are contour errors, as vectors across and along the path.

    The coordinate along the path, the last one, is 0 but at the first and at the last time.

    Args:
        t: Times [s], (n,).
        nominal: Of the nominal robot [m], (n, c).
        each: Per error of each unknown, (n, c, k).
        unknowns: The unknowns.
    """

    t: FloatArray
    nominal: FloatArray
    each: FloatArray
    unknowns: Unknowns

    def worst(self) -> Worst:
        """The largest contour error of all robots of the box, at every time.

        The deviations of all robots are a zonotope. Its farthest point is one of its vertices, and
        these are corners of the box.
        """
        unknowns = self.unknowns
        middle, half = (unknowns.high + unknowns.low) / 2, (unknowns.high - unknowns.low) / 2
        bound, signs = np.empty(len(self.t)), np.empty((len(self.t), len(unknowns)))
        for first in range(0, len(self.t), BLOCK):
            of = slice(first, first + BLOCK)
            center = self.nominal[of] + self.each[of] @ middle
            bound[of], signs[of] = _farthest(center, self.each[of] * half)
        for i in (0, -1):
            center = self.nominal[i] + self.each[i] @ middle
            bound[i], signs[i] = _farthest_in_space(center, self.each[i] * half)
        return Worst(bound=bound, errors=middle + signs * half, across=self)

    def largest(self, errors: FloatArray) -> FloatArray:
        """Largest contour error of robots every 2 ms, to first order [m], (m,).

        Args:
            errors: Errors of the unknowns, (m, k).
        """
        every = max(1, int(RESOLUTION / (self.t[1] - self.t[0])))
        nominal, each = self.nominal[::every], self.each[::every]
        rows = max(1, int(PRODUCTS / max(len(errors), 1)))
        found = np.zeros(len(errors))
        for first in range(0, len(nominal), rows):
            of = slice(first, first + rows)
            off = nominal[of, :, None] + each[of] @ errors.T
            found = np.maximum(found, (off**2).sum(axis=1).max(axis=0))
        return np.sqrt(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Worst:
    """The largest contour error over a box at every time.

    Args:
        bound: Of any robot of the box, to first order [m], (n,).
        errors: Errors of the unknowns of that robot, a corner of the box, (n, k).
        across: Deviations across the path.
    """

    bound: FloatArray
    errors: FloatArray
    across: Across

    @property
    def largest(self) -> float:
        """The largest bound [m]."""
        return float(self.bound.max())

    def corners(self, most: int) -> FloatArray:
        """Corners of the box, the worst by the linear model first, (m, k).

        All corners if there are at most `most`; otherwise the corners that are worst at some time,
        then the worst overall (with many unknowns: among the neighbours of the former).

        Args:
            most: Largest number of corners.
        """
        unknowns = self.across.unknowns
        own, where = np.unique(self.errors, axis=0, return_inverse=True)
        bound = np.zeros(len(own))
        np.maximum.at(bound, where.ravel(), self.bound)
        own = own[np.argsort(-bound, kind="stable")][:most]
        few = len(unknowns) <= ALL_CORNERS
        if len(own) == most and not (few and 2 ** len(unknowns) <= most):
            return np.asarray(own)
        if few:
            others = unknowns.corners()
        else:
            # The corners that differ in one unknown from those that are worst at some time.
            flipped = np.where(np.eye(len(unknowns), dtype=np.bool_), -1.0, 1.0)
            middle = (unknowns.low + unknowns.high) / 2
            others = (middle + (own - middle)[:, None] * flipped).reshape(-1, len(unknowns))
        others = others[np.argsort(-self.across.largest(others), kind="stable")]
        if few and len(others) <= most:
            return others
        both = np.concatenate([own, others])
        _, first = np.unique(both, axis=0, return_index=True)
        return np.asarray(both[np.sort(first)][:most])

    def shares(self) -> dict[str, float]:
        """Parts of the largest bound: of each kind of unknown, and of "sampling" [m].

        They add up to the bound: each is what its unknowns move the tool toward the side to which
        the worst robot is off.
        """
        across, i = self.across, int(np.argmax(self.bound))
        parts = across.each[i] * self.errors[i]
        total = across.nominal[i] + parts.sum(axis=1)
        size = float(np.linalg.norm(total))
        toward = total / size if size > 0 else np.zeros_like(total)
        found: dict[str, float] = {}
        for kind, part in zip(across.unknowns.kinds, (toward @ parts).tolist(), strict=True):
            found[kind] = found.get(kind, 0.0) + part
        return found | {"sampling": float(toward @ across.nominal[i])}


def deviations_of(
    taught: TaughtData,
    path: Path,
    unknowns: Unknowns,
    *,
    gravity_feedforward: bool = True,
) -> Deviations:
    """Find what a box does to a motion, linear around its plan.

    Args:
        taught: The set-points.
        path: The tool path.
        unknowns: The unknowns of the box.
        gravity_feedforward: Whether the controller adds the gravity torque.

    Raises:
        InvalidInput: The deviations have too many values.
    """
    servo, plan = unknowns.servo, taught.trajectory
    if servo.has_feedforward:
        raise InvalidInput(
            "The linear model of a box of rigid bodies has no feed-forward: certify without a box, "
            "or on independent joint servos."
        )
    late = float(servo.dead_time.max())
    end = taught.start_time + (len(taught.q) - 1) * taught.period + late + TAIL / servo.slowest
    t = regular_times(taught.start_time, end, min(taught.period / PER_INTERVAL, LONGEST_STEP))
    _checks.refuse_too_many(
        f"The linear model of {end - taught.start_time:.4g} s of motion",
        len(t) * len(unknowns) * unknowns.arm.dof,
        "certify contours of their own",
    )
    motion = _Motion(*plan.motion_with_rests(t))
    drives = Drives(arm=unknowns.arm, servo=servo, gravity_feedforward=gravity_feedforward)
    response = respond_along(
        lambda _, order: motion[order],
        t,
        unknowns.arm,
        servo,
        gravity_feedforward=gravity_feedforward,
    )
    pieces = polynomials(taught.q, taught.period, servo)
    command = sample_command(pieces, taught.period, servo.dead_time, t - taught.start_time)
    meant = drives.command(*motion)
    torques = np.stack(
        [(command - meant) * response.gain, *_torques(unknowns, drives, motion, meant, t)], axis=-1
    )
    # Joints rest at the first time where constant torques push them.
    still = np.linalg.solve(response.stiffness[0], torques[0])
    found = still + response.to_torque(torques - response.stiffness @ still)
    return Deviations(
        t=t, q=motion.q, nominal=found[:, :, 0], each=found[:, :, 1:], unknowns=unknowns, path=path
    )


class _Motion(NamedTuple):
    """Joint positions, velocities and accelerations of a plan with its rests, (n, dof) each."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


def _directions(motion: _Motion, command: FloatArray, slope: FloatArray) -> FloatArray:
    """Coulomb friction of each joint over its largest, against which it moves, (n, dof).

    A joint that stops to turn back sticks: its friction goes over to the other side as the loop's
    torque on the stuck joint does, with the command. After the motion it stays as it was.

    Args:
        motion: The planned motion.
        command: The command that makes it [rad], (n, dof).
        slope: Torque of the loop per command, over the largest friction [1/rad], infinite without
            friction, (dof,).
    """
    found = np.zeros_like(command)
    fast = np.abs(motion.dq) > np.maximum(STILL * np.abs(motion.dq).max(axis=0), RESTS)
    for j in range(command.shape[1]):
        moves = np.flatnonzero(fast[:, j])
        if not len(moves) or np.isinf(slope[j]):
            continue
        ways = np.sign(motion.dq[moves, j])
        turns = moves[np.append(True, ways[1:] != ways[:-1])]
        friction = 0.0
        for begin, end in zip(turns, [*turns[1:], len(command)], strict=True):
            way = float(np.sign(motion.dq[begin, j]))
            pushed = slope[j] * np.maximum.accumulate(
                way * (command[begin:end, j] - command[begin, j])
            )
            found[begin:end, j] = way * np.minimum(way * friction + pushed, 1.0)
            friction = float(found[end - 1, j])
    return found


def _torques(
    unknowns: Unknowns, drives: Drives, motion: _Motion, command: FloatArray, t: FloatArray
) -> list[FloatArray]:
    """Torque per error of each unknown along the motion, (n, dof) each."""
    chain, box = unknowns.arm.chain, unknowns.box
    assert chain is not None
    moving = drives.moving_torque(*motion)
    coulomb = np.broadcast_to(np.asarray(box.coulomb), drives.stiffness.shape)
    most = coulomb * float(np.abs(box.friction).max())
    with np.errstate(divide="ignore"):
        against = _directions(motion, command, drives.stiffness / most)
    rate = np.gradient(command, t, axis=0)
    by_kind = {
        "friction": -(box.viscous * motion.dq + coulomb * against),
        # Loops ask for (1 + e) times as much of the position error, and of the whole torque.
        "kp": moving + drives.damping * motion.dq,
        "kv": moving,
        "armature": -np.asarray(chain.armature) * motion.ddq,
        "dead time": -rate * drives.stiffness * unknowns.late_share,
    }
    if "payload" in unknowns.kinds:
        # Torque that a payload of 1 kg more takes along the motion [N m/kg].
        arm = unknowns.arm
        loaded = arm.with_dynamics(payload=unknowns.payload(1.0)).dynamics
        weight = loaded.torque(*motion) - arm.dynamics.torque(*motion)
        if box.payload_known:
            weight -= loaded.gravity(motion.q) - arm.dynamics.gravity(motion.q)
        by_kind["payload"] = -weight
    every = np.arange(motion.q.shape[1])
    return [
        by_kind[kind] if j < 0 else np.where(every == j, by_kind[kind], 0.0)
        for kind, j in zip(unknowns.kinds, unknowns.joints, strict=True)
    ]


def _sides(tangent: FloatArray) -> FloatArray:
    """Unit vectors across the path and then along it, (n, dimension, dimension)."""
    if tangent.shape[1] == 2:
        return np.stack([np.stack([-tangent[:, 1], tangent[:, 0]], axis=1), tangent], axis=1)
    flat = np.abs(tangent).argmin(axis=1)
    first = np.cross(tangent, np.eye(3)[flat])
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(tangent, first), tangent], axis=1)


def _farthest(middle: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of the farthest points of plane zonotopes from 0, and their signs.

    Args:
        middle: Centres, (n, c); only the first two coordinates count.
        half: Generators, (n, c, k).

    Returns:
        Distances, (n,), and a sign for each generator, (n, k).
    """
    # A vertex is the farthest point in all directions between the normals of two edges that follow
    # each other: one direction between each two of them finds all vertices.
    angle = np.sort(np.arctan2(half[:, 1], half[:, 0]) % np.pi, axis=1)
    following = np.append(angle[:, 1:], angle[:, :1] + np.pi, axis=1)
    between = (angle + following) / 2 + np.pi / 2
    toward = np.stack([np.cos(between), np.sin(between)], axis=2)
    signs = np.where(toward @ half[:, :2] >= 0, 1.0, -1.0)
    return _best(middle, half, signs)


def _farthest_in_space(middle: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of the farthest point of one zonotope from 0, and its signs.

    Args:
        middle: Centre, (c,), with 2 or 3 coordinates.
        half: Generators, (c, k).

    Returns:
        The distance, and a sign for each generator, (k,).
    """
    if len(middle) == 2 or half.shape[1] < 2:
        found, signs = _farthest(middle[None], half[None])
        return found[0], signs[0]
    # Vertices are those of faces, which two generators span; all others push to one of its sides.
    first, second = np.triu_indices(half.shape[1], 1)
    normal = np.cross(half.T[first], half.T[second])
    signs = np.where(normal @ half >= 0, 1.0, -1.0)
    rows, corners = np.arange(len(signs)), []
    for a, b in ((1.0, 1.0), (1.0, -1.0)):
        for side in (1.0, -1.0):
            corner = side * signs
            corner[rows, first], corner[rows, second] = a, b
            corners.append(corner)
    found, chosen = _best(middle[None], half[None], np.concatenate(corners)[None])
    return found[0], chosen[0]


def _best(middle: FloatArray, half: FloatArray, signs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The farthest of some points of zonotopes from 0, or of their opposites.

    Args:
        middle: Centres, (n, c).
        half: Generators, (n, c, k).
        signs: Signs of the generators at the points, (n, m, k).

    Returns:
        Distances, (n,), and a sign for each generator, (n, k).
    """
    n, m = signs.shape[:2]
    if m == 0:
        return np.linalg.norm(middle, axis=1), np.zeros((n, half.shape[2]))
    off = signs @ np.swapaxes(half, 1, 2)
    both = np.concatenate([middle[:, None] + off, middle[:, None] - off], axis=1)
    distance = np.linalg.norm(both, axis=-1)
    best = distance.argmax(axis=1)
    rows = np.arange(n)
    opposite = np.where(best < m, 1.0, -1.0)
    return distance[rows, best], signs[rows, best % m] * opposite[:, None]
