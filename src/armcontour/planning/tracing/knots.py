"""Knots along a path, at which tracing computes exact joint positions, and tool poses at knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.geometry import Orientation, Path, RoundedPath
from armcontour.geometry.rounding.rounded_path import OUT_OF_PLANE
from armcontour.planning.tracing.parallel_joints import task_of_parallel_joints
from armcontour.robot import SerialArm

# Largest distance between the first knots, divided by the extent of the path.
FIRST_STEP = 1 / 16
# Lower limit of this distance, divided by the span of the arm, because joint paths are nearly
# straight along short distances
SHORTEST_FIRST_STEP = 1 / 512
# Largest angle by which the tangent or the tool turns between the first knots [rad].
FIRST_TURN = 0.5
# Fractions of an interval at which the distance of the tool from the path is computed.
PLACES = checks.frozen_array([0.25, 0.5, 0.75])
# Index of the middle of the interval in PLACES.
MIDDLE = 1
# Jumps of the orientation below this are rounding errors [rad].
NO_JUMP = 1e-8
# Distance of the tool from which a pose is out of reach [m].
OUT_OF_REACH = 1e-7
# Rotation rate of the tool above which an error names this rate instead of a singularity [rad/m]
TOO_FAST = 1e5

# Factor of the number of first knots of a redundant arm, because null-space motion is interpolated
# between these knots
FINER = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Knots:
    """The n intervals between knots."""

    segment: IntArray  # Index of the path segment of each interval, (n,)
    # Index of the piece of the path's orientation of each interval, (n,); 0 for a path without
    # orientation
    piece: IntArray
    u0: FloatArray  # Distance along the segment at the start of each interval [m], (n,)
    u1: FloatArray  # Distance along the segment at the end of each interval [m], (n,)
    s0: FloatArray  # Arc length at the start of each interval [m], (n,)

    def __len__(self) -> int:
        """Number of intervals."""
        return len(self.segment)

    def part(self, selection: BoolArray | IntArray | slice) -> Knots:
        """Select intervals by a mask, by indices or by a slice."""
        return Knots(**{name: getattr(self, name)[selection] for name in Knots.__slots__})

    def halve(self, mask: BoolArray, u: FloatArray) -> tuple[Knots, IntArray, IntArray]:
        """Split the selected intervals in two.

        Returns the new intervals; the index of the old interval of each; and the indices of the
        second halves among the new intervals.

        - `mask`: mask of the intervals to split, (n,).
        - `u`: distance along the segment at which each selected interval is split [m].
        """
        parent = np.repeat(np.arange(len(self)), 1 + mask)
        second = np.flatnonzero(np.diff(parent, prepend=-1) == 0)
        u0 = self.u0[parent]
        u1 = self.u1[parent]
        s0 = self.s0[parent]
        s0[second] = self.part(mask).arc_lengths(u)
        u0[second] = u
        u1[second - 1] = u
        segment = self.segment[parent]
        piece = self.piece[parent]
        return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s0), parent, second

    def cut(self, count: IntArray) -> tuple[Knots, IntArray]:
        """Divide each interval into `count`, (n,), equal parts.

        Returns the parts, and the indices of the given knots among the starts of the parts and the
        end of the last part, (n + 1,).
        """
        ends = np.append(0, np.cumsum(count))
        parent = np.repeat(np.arange(len(self)), count)
        number = np.arange(ends[-1]) - ends[parent]
        share = ((self.u1 - self.u0) / count)[parent]
        last = number + 1 == count[parent]
        return Knots(
            segment=self.segment[parent],
            piece=self.piece[parent],
            u0=self.u0[parent] + share * number,
            u1=np.where(last, self.u1[parent], self.u0[parent] + share * (number + 1)),
            s0=self.s0[parent] + share * number,
        ), ends

    def places(self) -> tuple[Knots, FloatArray]:
        """Repeat the intervals for each fraction in `PLACES`, and compute these points.

        Returns the intervals, all at the first fraction before all at the second, and the distances
        of the points along their segments [m], (len(PLACES) n,).
        """
        columns = {x: [getattr(self, x)] * len(PLACES) for x in Knots.__slots__}
        repeated = Knots(**{name: np.concatenate(x) for name, x in columns.items()})
        u = self.u0 + PLACES[:, None] * (self.u1 - self.u0)
        return repeated, u.ravel()

    def arc_lengths(self, u: FloatArray) -> FloatArray:
        """Return the arc lengths at distances `u` along the segments [m], (n,)."""
        return np.asarray(self.s0 + (u - self.u0))


def first_knots(path: Path, span: float, finer: int = 1) -> Knots:
    """Make the first knot intervals for refinement, with a knot at every break of the path.

    - `span`: span of the arm [m].
    - `finer`: factor by which the intervals are shorter than required.
    """
    cells = _cells(path)
    # All vertices of a full circle are one point, so the extent includes the diameters of arcs.
    diameter = np.minimum(path.lengths, 2 / np.where(path.curvatures > 0, path.curvatures, np.inf))
    extent = max(float(np.linalg.norm(np.ptp(path.vertices, axis=0))), float(diameter.max()))
    turning = path.curvatures[cells.segment]
    if path.orientation is not None and not path.orientation.fixed:
        i = cells.piece
        middle = cells.arc_lengths((cells.u0 + cells.u1) / 2) - path.orientation.breaks[i]
        rate, _ = path.orientation.rates_on_piece(i, middle)
        turning = np.maximum(turning, 1.5 * np.linalg.norm(rate, axis=1))
    step = max(FIRST_STEP * extent, SHORTEST_FIRST_STEP * span)
    count = np.ceil(finer * (cells.u1 - cells.u0) * np.maximum(1 / step, turning / FIRST_TURN))
    return cells.cut(np.maximum(1, count).astype(np.intp))[0]


def _cells(path: Path) -> Knots:
    """Return one knot interval per piece of the path, divided where the orientation has breaks."""
    n = len(path)
    orientation = path.orientation
    whole = orientation is None or (len(orientation) == 1 and orientation.breaks[1] == path.length)
    if orientation is None or whole or np.array_equal(orientation.breaks, path.breaks):
        return Knots(
            segment=np.arange(n),
            piece=np.zeros(n, dtype=np.intp) if whole else np.arange(n),
            u0=np.zeros(n),
            u1=path.lengths,
            s0=path.breaks[:-1],
        )
    s = np.union1d(path.breaks, orientation.breaks)
    middle = (s[:-1] + s[1:]) / 2
    segment = path.locate(middle)
    piece = orientation.locate(middle)
    u0 = s[:-1] - path.breaks[segment]
    ends = s[1:] == path.breaks[segment + 1]
    u1 = np.where(ends, path.lengths[segment], s[1:] - path.breaks[segment])
    return Knots(segment=segment, piece=piece, u0=u0, u1=u1, s0=s[:-1])


def task_dimension(path: Path, arm: SerialArm) -> int:
    """Return how many of the tool's 6 degrees of freedom the path prescribes."""
    # The task dimension is 6 (position and orientation), 5 (position and tool axis), 4 (position
    # and rotation about the direction of parallel joints) or 3 (position).
    if path.dimension != 3:
        raise ArmMismatch(
            f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} has "
            f"{arm.dimension}. Use a path with {arm.dimension} coordinates."
        )
    if arm.dof < 3:
        raise ArmMismatch(
            f"The arm {arm.name} has {arm.dof} joints, but a path in space needs at least 3. "
            "Describe an arm that moves in a plane by an arm file of the kind planar_two_link."
        )
    orientation = path.orientation
    turning = arm.tool_turning
    if orientation is None:
        if arm.dof > 3 and (turning is None or not turning.keeps_axis):
            raise InvalidInput(
                f"The path has no tool orientation, but the arm {arm.name} requires one. Specify "
                "an orientation (in a job, path.orientation; in Python, path.oriented(rotation), "
                "or path.pointing(direction) if only the tool axis matters)."
            )
        return 3
    if turning is not None:
        task = task_of_parallel_joints(path, arm, turning)
    else:
        task = 5 if orientation.axis_only else 6
    if task > arm.dof:
        remedy = f"Use an arm with at least {task} joints"
        if arm.dof == 5:
            remedy = "Leave the rotation about the tool axis free with axis_only"
        elif arm.dof == 3:
            remedy = (
                f"Remove the orientation of the path, or use an arm with at least {task} joints"
            )
        raise ArmMismatch(
            f"The arm {arm.name} has {arm.dof} joints, but a tool "
            f"{'axis' if task == 5 else 'orientation'} in space needs {task}. "
            f"{remedy}."
        )
    if not orientation.constant and (orientation.jumps > NO_JUMP).any():
        _refuse_jump(path, orientation)
    return task


def _refuse_jump(path: Path, orientation: Orientation) -> None:
    """Raise the error for an orientation that jumps along the path."""
    jumps = orientation.jumps
    i = int(np.argmax(jumps > NO_JUMP))
    s = float(orientation.breaks[i + 1])
    remedy = "at a sharp corner. Round the corner, with an angular tolerance"
    if _bends_out_of_plane(path, s):
        remedy = (
            "at a corner that is not rounded, because its two segments do not lie in one plane. "
            "Put the segments into one plane, or join them by an arc that touches both"
        )
    cause = (
        f", because it follows the tangent {remedy}, or use a constant orientation"
        if orientation.follows
        else ". Specify an orientation without jumps there. A woven path cannot follow the tangent "
        "around a corner (follow_tangent): specify one orientation per waypoint, or a constant one"
    )
    raise InvalidInput(
        f"At {s:.6g} m along the path the tool's orientation jumps by "
        f"{np.degrees(jumps[i]):.3g}°{cause}.",
        s=s,
        point=path(s).tolist(),
    )


def _bends_out_of_plane(path: Path, s: float) -> bool:
    """Test whether a corner at s [m] is sharp because its segments are not in one plane."""
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return False
    nearest = int(np.argmin(np.linalg.norm(path.corners.point - path(s), axis=1)))
    return bool(path.corners.reason[nearest] == OUT_OF_PLANE)


def without_held(arm: SerialArm) -> tuple[SerialArm, IntArray]:
    """Return the arm without its held joints, and the indices of the other joints."""
    held = list(arm.chain.held)
    joints = np.arange(arm.dof)
    if not held:
        return arm, joints
    return arm.without_held(), np.delete(joints, held)


def suggest_remedy(path: Path | None) -> str:
    """Return advice for users whose arm cannot follow a path, as a sentence without a period."""
    orientation = None if path is None else path.orientation
    if orientation is None or orientation.axis_only:
        return "Move the path or the arm"
    return "Move the path or the arm, or leave the rotation about the tool axis free"


def describe_fast_rotation(path: Path, s: float) -> str:
    """Return a message if the path rotates the tool too fast at the arc length s [m], or ""."""
    if path.orientation is None:
        return ""
    near = path.orientation.locate(np.array([s]))[0] + np.array([-1, 0, 1])
    near = near[(near >= 0) & (near < len(path.orientation))]
    middle = (path.orientation.breaks[near] + path.orientation.breaks[near + 1]) / 2
    rate = float(np.linalg.norm(path.orientation.rates(middle)[0], axis=1).max())
    if rate < TOO_FAST:
        return ""
    return (
        f"At {s:.6g} m along the path the tool turns by {rate * 1e-6:.3g} rad per micrometre, "
        "which no joint path can follow. Increase the distance between the points of the path "
        "there, or allow larger corner errors."
    )


def poses_at(path: Path, knots: Knots, u: FloatArray) -> FloatArray:
    """Return rotations and positions of the tool at distances `u` along segments, (n, 3, 4)."""
    poses = np.empty((len(u), 3, 4))
    orientation = path.orientation
    poses[:, :, 3] = path.on_segment(knots.segment, u)
    if orientation is None:
        poses[:, :, :3] = np.eye(3)
    elif orientation.fixed:
        poses[:, :, :3] = orientation.starts[knots.piece]
    else:
        after = knots.arc_lengths(u) - orientation.breaks[knots.piece]
        poses[:, :, :3] = orientation.on_piece(knots.piece, after)
    return poses


def motion_at(path: Path, knots: Knots, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return tool poses as `poses_at`, and their derivatives in the arc length, (n, 4, 3)."""
    poses = poses_at(path, knots, u)
    # The rows of the derivatives are the tangent, its derivative, the angular rate [rad/m] and its
    # derivative.
    rates = np.zeros((len(u), 4, 3))
    orientation = path.orientation
    rates[:, 0] = path.on_segment(knots.segment, u, 1)
    rates[:, 1] = path.on_segment(knots.segment, u, 2)
    if orientation is not None and not orientation.fixed:
        after = knots.arc_lengths(u) - orientation.breaks[knots.piece]
        rates[:, 2], rates[:, 3] = orientation.rates_on_piece(knots.piece, after)
    return poses, rates


def row_of_poses(path: Path, knots: Knots) -> FloatArray:
    """Return the poses at the start of each interval and the end of the last, (n + 1, 3, 4)."""
    every = knots.part(np.append(np.arange(len(knots)), len(knots) - 1))
    return poses_at(path, every, np.append(knots.u0, knots.u1[-1]))
