"""Derating of acceleration and speed limits along a path, as the search for a plan needs it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.render import number
from armcontour.core.text import joint_label
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.constraints import (
    Constraint,
    JointMotion,
    OnGrid,
)
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal
from armcontour.planning.path_grid import Grid, place_grid
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.planning.tracing import check_joint_range
from armcontour.robot import Arm, Limits

# What limits are derated for: the demand and the plan's own acceleration, what bounds the speed of
# plan and command, the speed of the executed tool, its contour error, and that of robots of a box.
CAUSES = ("acceleration", "speed", "tool", "error", "box")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derating:
    """Derating of limits in every cell of a path."""

    # Arc lengths of the ends of the cells [m], (n + 1,)
    cells: FloatArray
    # Share that is left of each joint's acceleration limit, (n, dof)
    share: FloatArray
    # Largest ds² [m²/s²], infinite where the speed is not derated, (n,)
    cap: FloatArray
    # Share that each cause leaves of acceleration limits, by the names in `CAUSES`, (n, dof) each;
    # `share` is their product
    share_by: Mapping[str, FloatArray] = field(default_factory=dict)
    # Cause of the cap in every cell: its index in `CAUSES`, -1 without a known one, (n,)
    cap_by: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def __post_init__(self) -> None:
        if not len(self.cap_by):
            object.__setattr__(self, "cap_by", np.full(len(self.cap), -1))
        for name in ("cells", "share", "cap"):
            object.__setattr__(self, name, checks.frozen_array(getattr(self, name)))

    @classmethod
    def nothing(cls, joint_path: JointPath, intervals: int | None = None) -> Derating:
        """Make the cells from the first grid of a plan of the path, with nothing derated."""
        cells = place_grid(joint_path, intervals).s
        n = len(cells) - 1
        return cls(
            cells=cells,
            share=np.ones((n, joint_path.dof)),
            cap=np.full(n, np.inf),
        )

    def with_share(self, left: FloatArray | float, cause: str) -> Derating:
        """The derating with a smaller share of acceleration limits."""
        before = self.share_by.get(cause, np.ones_like(self.share))
        return replace(
            self, share=self.share * left, share_by={**self.share_by, cause: before * left}
        )

    def with_cap(self, cap: FloatArray, cause: str) -> Derating:
        """The derating with caps of the speed, where they are below those that it has."""
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
        """Index of the cell that contains the middle of each interval of a grid, (len(grid),)."""
        middle = (grid.s[:-1] + grid.s[1:]) / 2
        found = np.searchsorted(self.cells, middle) - 1
        return np.asarray(np.clip(found, 0, len(self.cap) - 1))


class DeratedAcceleration(JointMotion):
    """Joint acceleration limits, derated in every cell of the path."""

    def __init__(self, low: FloatArray, high: FloatArray, derating: Derating) -> None:
        super().__init__(acceleration=(low, high))
        self.derating = derating

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """The bounds, derated as in the cell that contains the middle of every interval."""
        share = self.derating.share[self.derating.cell_of(grid)]
        return self.low * share, self.high * share

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """The accelerations with their own bounds on every interval."""
        return (self.rows(path),)


class SpeedCap(Constraint):
    """A largest ds² in every cell of the path."""

    name = "derated speed"

    def __init__(self, derating: Derating) -> None:
        self.derating = derating

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """The cap at both ends of every interval."""
        cap = self.derating.cap[self.derating.cell_of(path.grid)]
        return (Ceiling(np.stack([cap, cap], axis=1)),)


def plan_derated(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    derating: Derating,
    factors: Mapping[str, float] = MappingProxyType({}),
    intervals: int | None = None,
) -> Trajectory:
    """Plan the fastest motion within derated limits."""
    check_joint_range(joint_path, limits)
    others = {name: getattr(limits, name) * factor for name, factor in factors.items()}
    rest = limits.replace(joint_acceleration=math.inf, **others)
    constraints: tuple[Constraint, ...] = (SpeedCap(derating),)
    if limits.joint_acceleration is not None:
        constraints += (DeratedAcceleration(*limits.acceleration_bounds(arm.dof), derating),)
    options = Optimal(intervals=intervals, constraints=constraints)
    return plan_optimal(joint_path, arm, rest, options).limited(limits)


# Less than this share of a limit is not lowered: searches aim that little below their limits. What
# is nowhere lowered by more than SAID is not worth a sentence.
LEAST, SAID = 1e-5, 1e-3
# A larger share of a contour is called all of it.
NEARLY_ALL = 0.995
# Why something is lowered, after "for".
REASONS = {
    "acceleration": "the acceleration limits of the joints",
    "speed": "the limits of tool and joint velocities in plan and command",
    "tool": "the speed of the executed tool, which passed the assigned velocity",
    "error": "the contour error",
    "box": "the contour error of robots of the box",
    "limit": "what drives and plan need of it",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DeratedInterval:
    """A demand that a certified plan had to be lowered for."""

    # What is lowered: "speed", "acceleration" of a joint, or the name of another limit
    what: str
    # For what, a key of `REASONS`
    cause: str
    # Largest share that it is lowered by: of the speed of the plan with nothing derated, or of the
    # limit
    share: float
    # Index of the joint that is derated most, from 0; None for what is not of a joint
    joint: int | None
    # Its number with its name; "" without a joint
    joint_name: str
    # Arc length at which it is lowered most [m]; None for limits lowered along all of it
    s: float | None
    # Time in the whole motion at which the plan is there [s]; None without a place
    t: float | None
    # Length of the contour along which it is lowered [m]
    length: float
    # Length of the contour [m]
    contour: float

    def __str__(self) -> str:
        """What is lowered, by how much, where and for what, as a clause."""
        of = f" of joint {self.joint_name}" if self.joint_name else ""
        where = f"over {number(self.length, 'm')} of {number(self.contour, 'm')}"
        if self.length > NEARLY_ALL * self.contour:
            where = "along the whole contour"
        place = (
            ""
            if self.s is None
            else f", most at s = {number(self.s, 'm')}, t = {number(self.t, 's')}"
        )
        return (
            f"{self.what.replace('_', ' ')}{of} by up to {number(self.share, '1')} "
            f"{where}{place}, for {REASONS[self.cause]}"
        )


def find_lowered(
    derating: Derating,
    factors: Mapping[str, float],
    squares: FloatArray,
    plan: Trajectory,
    start: float,
    names: Sequence[str],
) -> tuple[DeratedInterval, ...]:
    """Find what a plan of a contour was lowered for, the largest share of each kind first."""
    places = (derating.cells[:-1] + derating.cells[1:]) / 2
    contour = float(derating.cells[-1])

    def at(k: int, off: BoolArray) -> dict[str, float]:
        s = float(places[k])
        t = start + float(plan.time_at(np.array([s]))[0])
        return {"s": s, "t": t, "length": float(derating.width[off].sum()), "contour": contour}

    def found() -> Iterator[DeratedInterval]:
        with np.errstate(divide="ignore", invalid="ignore"):
            slower = np.maximum(1 - np.sqrt(derating.cap / squares), 0.0)
        for index, cause in enumerate(CAUSES):
            share = np.where(derating.cap_by == index, np.nan_to_num(slower), 0.0)
            k = int(np.argmax(share))
            if share[k] > SAID:
                yield DeratedInterval(
                    what="speed",
                    cause=cause,
                    share=float(share[k]),
                    joint=None,
                    joint_name="",
                    **at(k, share > LEAST),
                )
        for cause, left in derating.share_by.items():
            share = 1 - left
            k, j = (int(x) for x in np.unravel_index(np.argmax(share), share.shape))
            if share[k, j] > SAID:
                alike = bool((left == left[:, :1]).all())
                yield DeratedInterval(
                    what="acceleration",
                    cause=cause,
                    share=float(share[k, j]),
                    joint=None if alike else j,
                    joint_name="" if alike else joint_label(j + 1, names),
                    **at(k, np.asarray((share > LEAST).any(axis=1))),
                )
        for name, factor in factors.items():
            if 1 - factor > SAID:
                yield DeratedInterval(
                    what=name,
                    cause="limit",
                    share=1 - factor,
                    joint=None,
                    joint_name="",
                    s=None,
                    t=None,
                    length=contour,
                    contour=contour,
                )

    return tuple(sorted(found(), key=lambda x: -x.share))
