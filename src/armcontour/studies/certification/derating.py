"""Derating of acceleration and speed limits along a path, and plans within derated limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.render import number
from armcontour.core.text import joint_label
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.constraints import Constraint, IntervalEnds, JointMotion
from armcontour.planning.optimal_timing import Optimal, plan_optimal
from armcontour.planning.path_grid import Grid, place_grid
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.planning.topp.sampled_joint_path import SampledJointPath
from armcontour.robot import Arm, Limits

# Causes of derating: acceleration of plan and command, speed of plan and command, speed of the
# executed tool, contour error of the robot, contour error of robots of the box, and even slowing
# where derating single cells is not enough.
CAUSES = ("acceleration", "speed", "tool", "error", "box", "even")
# A cell whose limit is reduced by at most this share counts as not derated, because searches aim
# slightly below limits.
LEAST_REDUCTION = 1e-5
# A derated limit is reported if its largest reduction exceeds this share.
REPORTED_SHARE = 1e-3
# Derating along more than this fraction of a contour is described as along the whole contour.
WHOLE_SHARE = 0.995
# Reasons of derating by cause, as phrases after "because of".
REASONS = {
    "acceleration": "the acceleration limits of the joints",
    "speed": "the limits of tool and joint velocities in plan and command",
    "tool": "the speed of the executed tool, which exceeded the assigned velocity",
    "error": "the contour error",
    "box": "the contour error of robots of the box",
    "even": "the even slowing of the whole motion",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Derating:
    """Derating of joint accelerations and path speed in the n cells of a path, by cause."""

    cells: FloatArray  # Arc lengths of the ends of the cells [m], (n + 1,)
    # share_by: factors of `share`, (n, dof) each. cap_by: upper bounds of ds² [m²/s²], infinite
    # without derating of the speed, (n,) each.
    share_by: Mapping[str, FloatArray]
    cap_by: Mapping[str, FloatArray]

    @classmethod
    def nothing(cls, joint_path: JointPath, intervals: int | None = None) -> Derating:
        """Return a derating that reduces nothing; cells are the intervals of a first grid."""
        cells = place_grid(joint_path, intervals).s
        ones = np.ones((len(cells) - 1, joint_path.dof))
        caps = dict.fromkeys(CAUSES, np.full(len(ones), np.inf))
        return cls(cells=cells, share_by={"acceleration": ones}, cap_by=caps)

    def with_share(self, factor: FloatArray, cause: str) -> Derating:
        """Copy with the shares of acceleration limits multiplied, for a cause.

        - `factor`: (n, dof) or (n, 1).
        """
        share = self.share_by.get(cause, np.ones_like(self.share)) * factor
        return replace(self, share_by={**self.share_by, cause: share})

    def with_cap(self, cap: FloatArray, cause: str) -> Derating:
        """Copy with the smaller of the present and the given caps of ds² [m²/s²], (n,)."""
        return replace(self, cap_by={**self.cap_by, cause: np.minimum(self.cap_by[cause], cap)})

    @cached_property
    def share(self) -> FloatArray:
        """Usable fraction of each joint's acceleration limit, (n, dof)."""
        return np.asarray(np.prod(list(self.share_by.values()), axis=0))

    @cached_property
    def cap(self) -> FloatArray:
        """Upper bound of ds² [m²/s²], infinite without derating of the speed, (n,)."""
        return np.asarray(np.min(list(self.cap_by.values()), axis=0))

    @property
    def width(self) -> FloatArray:
        """Lengths of the cells [m], (n,)."""
        return np.diff(self.cells)

    def cell_of(self, grid: Grid) -> IntArray:
        """Return the cell in which the middle of each grid interval lies, (intervals,)."""
        middle = (grid.s[:-1] + grid.s[1:]) / 2
        cells = np.searchsorted(self.cells, middle) - 1
        return np.asarray(np.clip(cells, 0, len(self.cap) - 1))


class DeratedAcceleration(JointMotion):
    """Constraint: joint acceleration limits, derated in every cell of the path."""

    def __init__(self, low: FloatArray, high: FloatArray, derating: Derating) -> None:
        super().__init__(acceleration=(low, high))
        self.derating = derating

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return the derated bounds of each interval [rad/s²], (intervals, dof) each."""
        share = self.derating.share[self.derating.cell_of(grid)]
        return self.low * share, self.high * share

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the joint accelerations, with bounds per interval."""
        return (self.rows(path),)


class SpeedCap(Constraint):
    """Constraint: largest ds² in each cell of the path."""

    name = "derated speed"

    def __init__(self, derating: Derating) -> None:
        self.derating = derating

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the ceilings of ds² at both ends of each interval."""
        cap = self.derating.cap[self.derating.cell_of(path.grid)]
        return (Ceiling(np.stack([cap, cap], axis=1)),)


@dataclass(frozen=True)
class DeratedLimits(Constraint):
    """The derated limits of all contours by cause, with which a certified plan is explained."""

    deratings: Sequence[tuple[JointPath, Derating]]
    limits: Limits

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Names of the requirements by which limits are derated."""
        return [(REASONS[x].removeprefix("the "), None) for x in CAUSES]

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Return the used fractions of derated speed and acceleration, (intervals, causes)."""
        derating = next(y for x, y in self.deratings if x is ends.law.joint_path)
        bounded = DeratedAcceleration(*self.limits.acceleration_bounds(ends.arm.dof), derating)
        acceleration = bounded.usage(ends).max(axis=1)
        cell = derating.cell_of(ends.grid)
        speed = np.sqrt(ends.x.max(axis=1) / derating.cap[cell])
        cap = derating.cap[cell]
        used = [np.where(derating.cap_by[x][cell] == cap, speed, 0.0) for x in CAUSES]
        for cause, share in derating.share_by.items():
            derated = share[cell].min(axis=1) < 1 - LEAST_REDUCTION
            k = CAUSES.index(cause)
            used[k] = np.maximum(used[k], acceleration * derated)
        return np.stack(used, axis=1)


def plan_derated(
    joint_path: JointPath, arm: Arm, limits: Limits, derating: Derating, options: Optimal
) -> Trajectory:
    """Plan the fastest motion within derated limits."""
    constraints: tuple[Constraint, ...] = (*options.constraints, SpeedCap(derating))
    if limits.joint_acceleration is not None:
        constraints += (DeratedAcceleration(*limits.acceleration_bounds(arm.dof), derating),)
    others = limits.replace(joint_acceleration=math.inf)
    plan = plan_optimal(joint_path, arm, others, replace(options, constraints=constraints))
    return plan.limited(limits)


@dataclass(frozen=True, slots=True, kw_only=True)
class DeratedInterval:
    """A limit that a certified plan derates, and its cause."""

    what: str  # "speed", or "acceleration" (of joints)
    cause: str  # Key of REASONS
    # share: largest reduction, relative to the speed of the plan without derating or to the limit.
    share: float
    joint: int | None = None  # Index of the joint with the largest reduction; None if all are equal
    joint_name: str = ""  # Label of this joint
    s: float  # Arc length of the largest reduction [m]
    t: float  # Time of this reduction in the whole motion [s]
    length: float  # Derated length of the contour [m]
    contour: float  # Length of the contour [m]

    def __str__(self) -> str:
        """Write a clause with the limit, its reduction, position and cause."""
        joint = f" of joint {self.joint_name}" if self.joint_name else ""
        where = f"over {number(self.length, 'm')} of {number(self.contour, 'm')}"
        if self.length > WHOLE_SHARE * self.contour:
            where = "along the whole contour"
        return (
            f"{self.what}{joint} by up to {number(self.share, '1')} {where}, most at s = "
            f"{number(self.s, 'm')}, t = {number(self.t, 's')}, because of {REASONS[self.cause]}"
        )


def derated_intervals(
    derating: Derating, fastest: Trajectory, plan: Trajectory, start: float, names: Sequence[str]
) -> tuple[DeratedInterval, ...]:
    """Find the largest derating of a contour's plan for each limit and cause.

    The largest reduction is first.

    - `fastest`: the plan without derating.
    - `start`: start of the contour in the whole motion [s].
    - `names`: names of the joints.
    """
    squares = largest_squares(fastest, derating.cells)
    contour = float(derating.cells[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        remaining = [
            ("speed", cause, np.sqrt(np.where(cap > derating.cap, np.inf, cap) / squares)[:, None])
            for cause, cap in derating.cap_by.items()
        ]
    remaining += [("acceleration", cause, x) for cause, x in derating.share_by.items()]
    intervals = []
    for what, cause, usable in remaining:
        share = np.nan_to_num(np.maximum(1 - usable, 0.0))
        k, j = (int(x) for x in np.unravel_index(np.argmax(share), share.shape))
        if share[k, j] <= REPORTED_SHARE:
            continue
        alike = (share == share[:, :1]).all()
        derated = (share > LEAST_REDUCTION).any(axis=1)
        s = float(derating.cells[k : k + 2].mean())
        intervals.append(
            DeratedInterval(
                what=what,
                cause=cause,
                share=float(share[k, j]),
                joint=None if alike else j,
                joint_name="" if alike else joint_label(j + 1, names),
                s=s,
                t=start + float(plan.time_at([s])[0]),
                length=float(derating.width[derated].sum()),
                contour=contour,
            )
        )
    return tuple(sorted(intervals, key=lambda x: -x.share))


def largest_squares(plan: Trajectory, cells: FloatArray) -> FloatArray:
    """Return the largest ds² of a plan at the ends of each cell [m²/s²], (n,)."""
    squares = plan.speed_at(cells) ** 2
    return np.asarray(np.maximum(squares[:-1], squares[1:]))
