"""Derating of acceleration and speed limits along a path, as the search for a plan needs it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.constraints import (
    Constraint,
    JointMotion,
    OnGrid,
)
from armcontour.planning.grid import Grid, place_grid
from armcontour.planning.optimal import plan_optimal
from armcontour.planning.options import Optimal
from armcontour.planning.topp.limits import Ceiling, Form
from armcontour.planning.tracing import check_joint_range
from armcontour.robot import Arm, Limits

# What limits are derated for: the demand and the plan's own acceleration, what bounds the speed of
# plan and command, the speed of the executed tool, its contour error, and that of robots of a box.
CAUSES = ("acceleration", "speed", "tool", "error", "box")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derating:
    """Derating of limits in every cell of a path.

    Args:
        cells: Arc lengths of the ends of the cells [m], (n + 1,).
        share: Share that is left of each joint's acceleration limit, (n, dof).
        cap: Largest ds² [m²/s²], infinite where the speed is not derated, (n,).
        share_by: Share that each cause leaves of acceleration limits, by the names in `CAUSES`,
            (n, dof) each; `share` is their product.
        cap_by: Cause of the cap in every cell: its index in `CAUSES`, -1 without a known one,
            (n,).
    """

    cells: FloatArray
    share: FloatArray
    cap: FloatArray
    share_by: Mapping[str, FloatArray] = field(default_factory=dict)
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
        """The derating with a smaller share of acceleration limits.

        Args:
            left: What is left of the shares, for all cells and joints alike.
            cause: What it is for, of `CAUSES`.
        """
        before = self.share_by.get(cause, np.ones_like(self.share))
        return replace(
            self, share=self.share * left, share_by={**self.share_by, cause: before * left}
        )

    def with_cap(self, cap: FloatArray, cause: str) -> Derating:
        """The derating with caps of the speed, where they are below those that it has.

        Args:
            cap: Largest ds² [m²/s²], (n,).
            cause: What it is for, of `CAUSES`.
        """
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
    """Joint acceleration limits, derated in every cell of the path.

    Args:
        low: Lower bounds, negative [rad/s²], (dof,).
        high: Upper bounds, positive [rad/s²], (dof,).
        derating: The shares that are left.
    """

    def __init__(self, low: FloatArray, high: FloatArray, derating: Derating) -> None:
        super().__init__(acceleration=(low, high))
        self.derating = derating

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """The bounds, derated as in the cell that contains the middle of every interval."""
        share = self.derating.share[self.derating.cell_of(grid)]
        return self.low * share, self.high * share

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The accelerations with their own bounds on every interval."""
        return (self.rows(path),)


class Cap(Constraint):
    """A largest ds² in every cell of the path.

    Args:
        derating: The largest ds².
    """

    name = "derated speed"

    def __init__(self, derating: Derating) -> None:
        self.derating = derating

    def on(self, path: OnGrid) -> Iterable[Form]:
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
    """Plan the fastest motion within derated limits.

    Args:
        joint_path: The path.
        arm: The arm.
        limits: The limits, with values per joint.
        derating: Derating of acceleration and speed along the path.
        factors: Shares that are left of other limits along the whole path, by the limits' names.
        intervals: Number of grid intervals; by default that of `plan`.

    Raises:
        NotRealizable: The limits allow no motion.
    """
    check_joint_range(joint_path, limits)
    others = {name: getattr(limits, name) * factor for name, factor in factors.items()}
    rest = limits.replace(joint_acceleration=math.inf, **others)
    constraints: tuple[Constraint, ...] = (Cap(derating),)
    if limits.joint_acceleration is not None:
        constraints += (DeratedAcceleration(*limits.acceleration_bounds(arm.dof), derating),)
    options = Optimal(intervals=intervals, constraints=constraints)
    return plan_optimal(joint_path, arm, rest, options).limited(limits)
