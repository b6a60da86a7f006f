"""Tracing: a tool path becomes a joint path, by exact inverse kinematics at knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput, Unreachable
from armcontour.geometry import Path
from armcontour.motion import JointPath, quintic

# The first knots lie no farther apart than this part of the path's extent and this turn [rad].
FIRST_STEP = 1 / 16
FIRST_TURN = 0.5
# An interval this small that still misses the path means a singularity, not a coarse grid.
SMALLEST_INTERVAL = 1e-9

Ends = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Knots:
    """Intervals between knots: their segment, and where on it they begin and end [m]."""

    segment: IntArray
    u0: FloatArray
    u1: FloatArray

    def part(self, which: BoolArray) -> Knots:
        """Some of the intervals."""
        return Knots(self.segment[which], self.u0[which], self.u1[which])


def trace(
    path: Path, arm: Arm, *, branch: str | None = None, tolerance: float = 1e-10
) -> JointPath:
    """The joint path that carries the arm's tool along `path`.

    q, dq_ds and d2q_ds2 at the knots are exact: closed-form inverse kinematics, (28) and (27).
    Between knots a quintic; knots are added until the tool is within `tolerance` of the path.

    Args:
        path: Tool path.
        arm: The arm.
        branch: One of `arm.branches`; the first by default.
        tolerance: Largest distance between the tool and its place on the path [m].

    Raises:
        Unreachable: A place out of reach or singular, with its arc length.
        InvalidInput: A path of another dimension than the arm's.
    """
    if path.dimension != arm.dimension:
        raise InvalidInput(
            f"The path has {path.dimension} coordinates, but the tool of the arm {arm.name} "
            f"moves in {arm.dimension}."
        )
    _checks.positive("tracing tolerance", tolerance, "m")
    knots = _first_knots(path)
    begin, end = (_ends(path, arm, branch, knots.segment, u) for u in (knots.u0, knots.u1))
    settled = np.zeros(len(knots.segment), dtype=bool)
    while True:
        begin, end = _without_jumps(begin, end)
        missed = np.zeros(len(settled), dtype=bool)
        missed[~settled] = _misses(
            path, arm, tolerance, knots.part(~settled), _part(begin, ~settled), _part(end, ~settled)
        )
        if not missed.any():
            break
        _refuse_singularity(path, arm, knots.part(missed))
        middle = (knots.u0 + knots.u1)[missed] / 2
        between = _ends(path, arm, branch, knots.segment[missed], middle)
        # An interval that misses gives its place to its two halves.
        twice = np.repeat(np.arange(len(settled)), 1 + missed)
        second = np.flatnonzero(np.diff(twice, prepend=-1) == 0)
        knots = Knots(knots.segment[twice], knots.u0[twice], knots.u1[twice])
        knots.u0[second], knots.u1[second - 1] = middle, middle
        begin, end = _part(begin, twice), _part(end, twice)
        for k in range(3):
            begin[k][second], end[k][second - 1] = between[k], between[k]
        settled = (~missed)[twice]
    breaks = np.append(path.breaks[knots.segment] + knots.u0, path.length)
    return JointPath.hermite(breaks, begin, end, stops=path.stops, tool_path=path)


def _first_knots(path: Path) -> Knots:
    # The vertices of a full circle span nothing: its diameter does.
    bulge = np.minimum(path.lengths, 2 / np.where(path.curvatures > 0, path.curvatures, np.inf))
    extent = max(float(np.linalg.norm(np.ptp(path.vertices, axis=0))), float(bulge.max()))
    by_length = np.ceil(path.lengths / (FIRST_STEP * extent))
    by_turn = np.ceil(path.lengths * path.curvatures / FIRST_TURN)
    count = np.maximum(1, np.maximum(by_length, by_turn)).astype(np.intp)
    segment = np.repeat(np.arange(len(path)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = path.lengths[segment] / count[segment]
    last = number + 1 == count[segment]
    return Knots(
        segment, share * number, np.where(last, path.lengths[segment], share * (number + 1))
    )


def _ends(path: Path, arm: Arm, branch: str | None, segment: IntArray, u: FloatArray) -> Ends:
    """q, dq_ds and d2q_ds2 at distance `u` along segments."""
    try:
        q = arm.inverse(path.on_segment(segment, u), branch)
    except Unreachable as error:
        index = error.index or 0
        s = float(path.breaks[segment[index]] + u[index])
        raise Unreachable(
            f"At {s:.6g} m along the path: {error}",
            point=error.point,
            index=int(segment[index]),
            s=s,
            limit=error.limit,
            needed=error.needed,
            allowed=error.allowed,
        ) from None
    dq_ds = arm.joint_velocity(q, path.on_segment(segment, u, 1))
    return q, dq_ds, arm.joint_acceleration(q, dq_ds, path.on_segment(segment, u, 2))


def _without_jumps(begin: Ends, end: Ends) -> tuple[Ends, Ends]:
    """The same ends with whole turns taken out, so that joint positions are continuous."""
    q = np.stack([begin[0], end[0]], axis=1).reshape(-1, begin[0].shape[1])
    unwrapped = np.unwrap(q, axis=0).reshape(len(begin[0]), 2, -1)
    return (unwrapped[:, 0], *begin[1:]), (unwrapped[:, 1], *end[1:])


def _part(ends: Ends, which: BoolArray | IntArray) -> Ends:
    q, dq_ds, d2q_ds2 = ends
    return q[which], dq_ds[which], d2q_ds2[which]


def _misses(
    path: Path, arm: Arm, tolerance: float, knots: Knots, begin: Ends, end: Ends
) -> BoolArray:
    """Which intervals leave the path by more than the tolerance, seen at three places."""
    width = knots.u1 - knots.u0
    coefficients = quintic(width, begin, end)
    worst = np.zeros(len(width))
    for x in (0.25, 0.5, 0.75):
        q = np.einsum("ikj,k->ij", coefficients, x ** np.arange(6))
        miss = arm.forward(q) - path.on_segment(knots.segment, knots.u0 + x * width)
        worst = np.maximum(worst, np.linalg.norm(miss, axis=1))
    return np.asarray(worst > tolerance)


def _refuse_singularity(path: Path, arm: Arm, knots: Knots) -> None:
    small = np.flatnonzero(knots.u1 - knots.u0 < SMALLEST_INTERVAL)
    if len(small):
        s = float(path.breaks[knots.segment[small[0]]] + knots.u0[small[0]])
        point = path(s).tolist()
        raise Unreachable(
            f"At {s:.6g} m along the path, near {tuple(round(x, 6) for x in point)} m, the arm "
            f"{arm.name} is singular or jumps between configurations: move the path or the arm.",
            point=point,
            s=s,
        )
