"""Derating of acceleration and speed limits along a path, and plans within derated limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.render import number
from armcontour.core.text import joint_label
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.constraints import Constraint, IntervalEnds, JointMotion, OnGrid
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal
from armcontour.planning.path_grid import Grid, place_grid
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.planning.tracing import check_joint_range
from armcontour.robot import Arm, Limits

# Causes of derating: acceleration of plan and command, speed of plan and command, speed of the
# executed tool, contour error of the robot, and contour error of robots of the box.
CAUSES = ("acceleration", "speed", "tool", "error", "box")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derating:
    """Derating of joint accelerations and path speed in the n cells of a path."""

    cells: FloatArray  # Arc lengths of the ends of the cells [m], (n + 1,)
    share: FloatArray  # Usable share of each joint's acceleration limit, (n, dof)
    cap: FloatArray  # Upper bound of ds² [m²/s²], infinite without derating of the speed, (n,)
    # share_by: factors of `share` by cause, (n, dof) each; `share` is their product.
    share_by: Mapping[str, FloatArray] = field(default_factory=dict)
    # cap_by: index in CAUSES of the cause of the cap, -1 without a cap, (n,).
    cap_by: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def __post_init__(self) -> None:
        if not len(self.cap_by):
            object.__setattr__(self, "cap_by", np.full(len(self.cap), -1))
        for name in ("cells", "share", "cap"):
            object.__setattr__(self, name, checks.frozen_array(getattr(self, name)))

    @classmethod
    def nothing(cls, joint_path: JointPath, intervals: int | None = None) -> Derating:
        """Derating without any reduction; cells are the intervals of the first grid of a plan."""
        cells = place_grid(joint_path, intervals).s
        n = len(cells) - 1
        return cls(cells=cells, share=np.ones((n, joint_path.dof)), cap=np.full(n, np.inf))

    def with_share(self, factor: FloatArray | float, cause: str) -> Derating:
        """Copy with the shares of acceleration limits multiplied by a factor, for a cause."""
        before = self.share_by.get(cause, np.ones_like(self.share))
        return replace(
            self, share=self.share * factor, share_by={**self.share_by, cause: before * factor}
        )

    def with_cap(self, cap: FloatArray, cause: str) -> Derating:
        """Copy with the smaller of the present and the given caps of ds² [m²/s²], (n,)."""
        lower = cap < self.cap
        return replace(
            self,
            cap=np.where(lower, cap, self.cap),
            cap_by=np.where(lower, CAUSES.index(cause), self.cap_by),
        )

    @property
    def width(self) -> FloatArray:
        """Lengths of the cells [m], (n,)."""
        return np.diff(self.cells)

    def cell_of(self, grid: Grid) -> IntArray:
        """Index of the cell that contains the middle of each interval of a grid, (intervals,)."""
        middle = (grid.s[:-1] + grid.s[1:]) / 2
        cells = np.searchsorted(self.cells, middle) - 1
        return np.asarray(np.clip(cells, 0, len(self.cap) - 1))


class DeratedAcceleration(JointMotion):
    """Constraint: joint acceleration limits, derated in every cell of the path."""

    def __init__(self, low: FloatArray, high: FloatArray, derating: Derating) -> None:
        super().__init__(acceleration=(low, high))
        self.derating = derating

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Derated lower and upper bounds of each interval [rad/s²], (intervals, dof) each."""
        share = self.derating.share[self.derating.cell_of(grid)]
        return self.low * share, self.high * share

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Rows of the joint accelerations with bounds per interval."""
        return (self.rows(path),)


class SpeedCap(Constraint):
    """Constraint: largest ds² in each cell of the path."""

    name = "derated speed"

    def __init__(self, derating: Derating) -> None:
        self.derating = derating

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Ceilings of ds² at both ends of each interval."""
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
        """Used share of the derated speed and acceleration on each interval, (n, causes)."""
        derating = next(y for x, y in self.deratings if x is ends.law.joint_path)
        bounded = DeratedAcceleration(*self.limits.acceleration_bounds(ends.arm.dof), derating)
        acceleration, cell = bounded.usage(ends).max(axis=1), derating.cell_of(ends.grid)
        speed = np.sqrt(ends.x.max(axis=1) / derating.cap[cell])
        used = [np.where(derating.cap_by[cell] == k, speed, 0.0) for k in range(len(CAUSES))]
        for cause, share in derating.share_by.items():
            derated, k = share[cell].min(axis=1) < 1 - LEAST_REDUCTION, CAUSES.index(cause)
            used[k] = np.maximum(used[k], acceleration * derated)
        return np.stack(used, axis=1)


def plan_derated(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    derating: Derating,
    factors: Mapping[str, float] = MappingProxyType({}),
    intervals: int | None = None,
) -> Trajectory:
    """Plan the fastest motion within derated limits; `factors` derate other limits by name."""
    check_joint_range(joint_path, limits)
    others = {name: getattr(limits, name) * factor for name, factor in factors.items()}
    rest = limits.replace(joint_acceleration=math.inf, **others)
    constraints: tuple[Constraint, ...] = (SpeedCap(derating),)
    if limits.joint_acceleration is not None:
        constraints += (DeratedAcceleration(*limits.acceleration_bounds(arm.dof), derating),)
    options = Optimal(intervals=intervals, constraints=constraints)
    return plan_optimal(joint_path, arm, rest, options).limited(limits)


# LEAST_REDUCTION: a cell with a smaller reduction counts as not derated, because searches aim
# slightly below limits. REPORTED_SHARE: a limit is reported if its largest reduction exceeds this
# share.
LEAST_REDUCTION, REPORTED_SHARE = 1e-5, 1e-3
# Derating along more than this share of a contour is described as along the whole contour.
WHOLE_SHARE = 0.995
# Reasons of derating by cause, as phrases after "because of".
REASONS = {
    "acceleration": "the acceleration limits of the joints",
    "speed": "the limits of tool and joint velocities in plan and command",
    "tool": "the speed of the executed tool, which exceeded the assigned velocity",
    "error": "the contour error",
    "box": "the contour error of robots of the box",
    "limit": "the requirements of drives and plan",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DeratedInterval:
    """A limit that a certified plan derates, and its cause."""

    what: str  # "speed", "acceleration" (of joints), or the name of another limit
    cause: str  # Key of REASONS
    # share: largest reduction, relative to the speed of the plan without derating or to the limit.
    share: float
    joint: int | None = None  # Index of the joint with the largest reduction; None if all are equal
    joint_name: str = ""  # Label of this joint
    s: float | None = None  # Arc length of the largest reduction [m]; None if it is constant
    t: float | None = None  # Time of this reduction in the whole motion [s]; None if it is constant
    length: float  # Derated length of the contour [m]
    contour: float  # Length of the contour [m]

    def __str__(self) -> str:
        """Clause with the limit, its reduction, position and cause."""
        joint = f" of joint {self.joint_name}" if self.joint_name else ""
        where = f"over {number(self.length, 'm')} of {number(self.contour, 'm')}"
        if self.length > WHOLE_SHARE * self.contour:
            where = "along the whole contour"
        place = (
            ""
            if self.s is None
            else f", most at s = {number(self.s, 'm')}, t = {number(self.t, 's')}"
        )
        return (
            f"{self.what.replace('_', ' ')}{joint} by up to {number(self.share, '1')} "
            f"{where}{place}, because of {REASONS[self.cause]}"
        )


def derated_intervals(
    derating: Derating,
    factors: Mapping[str, float],
    squares: FloatArray,
    plan: Trajectory,
    start: float,
    names: Sequence[str],
) -> tuple[DeratedInterval, ...]:
    """Largest derating of a contour's plan for each limit and cause, the largest share first.

    `squares`: largest ds² of the plan without derating in each cell [m²/s²], (n,). `start`: start
    of the contour in the whole motion [s]. `names`: names of the joints.
    """
    middles = (derating.cells[:-1] + derating.cells[1:]) / 2
    contour = float(derating.cells[-1])

    def location(k: int, derated: BoolArray) -> dict[str, Any]:
        s = float(middles[k])
        t = start + float(plan.time_at(np.array([s]))[0])
        return {"s": s, "t": t, "length": float(derating.width[derated].sum()), "contour": contour}

    def intervals() -> Iterator[DeratedInterval]:
        with np.errstate(divide="ignore", invalid="ignore"):
            slower = np.maximum(1 - np.sqrt(derating.cap / squares), 0.0)
        for index, cause in enumerate(CAUSES):
            share = np.where(derating.cap_by == index, np.nan_to_num(slower), 0.0)
            k = int(np.argmax(share))
            if share[k] > REPORTED_SHARE:
                yield DeratedInterval(
                    what="speed",
                    cause=cause,
                    share=float(share[k]),
                    **location(k, share > LEAST_REDUCTION),
                )
        for cause, remaining in derating.share_by.items():
            share = 1 - remaining
            k, j = (int(x) for x in np.unravel_index(np.argmax(share), share.shape))
            if share[k, j] > REPORTED_SHARE:
                alike = bool((remaining == remaining[:, :1]).all())
                yield DeratedInterval(
                    what="acceleration",
                    cause=cause,
                    share=float(share[k, j]),
                    joint=None if alike else j,
                    joint_name="" if alike else joint_label(j + 1, names),
                    **location(k, np.asarray((share > LEAST_REDUCTION).any(axis=1))),
                )
        for name, factor in factors.items():
            if 1 - factor > REPORTED_SHARE:
                yield DeratedInterval(
                    what=name, cause="limit", share=1 - factor, length=contour, contour=contour
                )

    return tuple(sorted(intervals(), key=lambda x: -x.share))
