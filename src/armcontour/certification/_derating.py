"""What a search holds back, place by place along a path: accelerations, and the speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.motion import JointPath, Trajectory, smooth
from armcontour.timing.constraints import (
    Bounds,
    Ceiling,
    Constraint,
    JointAcceleration,
    JointDerivatives,
    Rows,
)
from armcontour.timing.grid import Grid, place_grid
from armcontour.timing.optimal import plan_optimal
from armcontour.tracing import refuse_out_of_range


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """What is left of limits in every cell of a path.

    Args:
        cells: Ends of the cells [m], (n + 1,).
        share: Of every joint's acceleration limit, (n, dof).
        cap: Largest ds² [m²/s²], infinite where nothing is held back, (n,).
    """

    cells: FloatArray
    share: FloatArray
    cap: FloatArray

    def __post_init__(self) -> None:
        for name in ("cells", "share", "cap"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    @classmethod
    def nothing(cls, joint_path: JointPath, intervals: int | None = None) -> Held:
        """Cells on the grid that a plan of the path begins with, and nothing held back."""
        cells = place_grid(joint_path, intervals).s
        n = len(cells) - 1
        return cls(cells=cells, share=np.ones((n, joint_path.dof)), cap=np.full(n, np.inf))

    @property
    def width(self) -> FloatArray:
        """Lengths of the cells [m], (n,)."""
        return np.diff(self.cells)

    def cell_of(self, grid: Grid) -> IntArray:
        """The cell that holds the middle of every interval of a grid, (len(grid),)."""
        middle = (grid.s[:-1] + grid.s[1:]) / 2
        found = np.searchsorted(self.cells, middle) - 1
        return np.asarray(np.clip(found, 0, len(self.cap) - 1))


class HeldAcceleration(JointAcceleration):
    """Joint acceleration limits, of which every cell of the path leaves a share.

    Args:
        low: Lower bounds, negative [rad/s²], (dof,).
        high: Upper bounds, positive [rad/s²], (dof,).
        held: The shares.
    """

    def __init__(self, low: FloatArray, high: FloatArray, held: Held) -> None:
        super().__init__(low, high)
        self.held = held

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """The bounds that are left: the same all along an interval, for one cell holds it."""
        full = super().rows(grid, path, bounds)
        share = self.held.share[self.held.cell_of(grid)]
        return Rows(full.a, full.b, full.low * share, full.high * share, full.margin)


class Cap(Constraint):
    """A largest ds² per cell of the path.

    Args:
        held: The caps.
    """

    name = "held back"

    def __init__(self, held: Held) -> None:
        self.held = held

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling:
        """The cap at both ends of every interval."""
        return Ceiling(np.tile(self.held.cap[self.held.cell_of(grid)], (2, 1)))


def held_plan(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    held: Held,
    windows: tuple[float, ...] = (),
    factors: Mapping[str, float] = MappingProxyType({}),
    intervals: int | None = None,
) -> tuple[Trajectory, Trajectory]:
    """The fastest motion within what is left of the limits, and the same smoothed.

    Args:
        joint_path: The path.
        arm: The arm.
        limits: With values per joint.
        held: What is held back, place by place.
        windows: Of the moving averages [s]; without, both are the same.
        factors: What is left of other limits everywhere, by their names.
        intervals: Of the grid; by default those of `plan`.

    Raises:
        NotRealizable: There is no such motion.
    """
    refuse_out_of_range(joint_path, limits)
    others = {name: getattr(limits, name) * factor for name, factor in factors.items()}
    rest = limits.replace(joint_acceleration=None, joint_deceleration=None, **others)
    constraints: list[Constraint] = [Cap(held)]
    if limits.joint_acceleration is not None:
        constraints.append(HeldAcceleration(*limits.acceleration_bounds(arm.dof), held))
    found = plan_optimal(joint_path, arm, rest, intervals=intervals, constraints=constraints)
    return found, smooth(found, *windows) if windows else found
