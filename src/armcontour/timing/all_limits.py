"""The library's own limits, all of which the compiled planner knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from armcontour._checks import FloatArray, IntArray, for_kernel
from armcontour.motion import JointPath
from armcontour.timing._all_limits import Joints, Places, Rules, plan_in_brackets, plan_roughly
from armcontour.timing._block import ENDS, B
from armcontour.timing._grid import grids_from_rest
from armcontour.timing._joint_limits import FOUND, LEFT
from armcontour.timing.constraints import (
    CentripetalAcceleration,
    Constraint,
    JointAcceleration,
    JointTorque,
    JointVelocity,
    ToolAcceleration,
    ToolSpeed,
)
from armcontour.timing.constraints._torque import terms_on_grid
from armcontour.timing.constraints.tool import Discs
from armcontour.timing.grid import PARTS_AT_REST, SHARE_AT_RESTS, Grid

# Constraints whose rows come first stand first.
ROWS = (JointAcceleration, JointTorque)
CEILINGS = (JointVelocity, ToolSpeed, CentripetalAcceleration)
# The first pass takes every COARSER-th point, unless fewer intervals than FEWEST_COARSE remain.
COARSER = 2
FEWEST_COARSE = 200
NONE, NOWHERE = np.empty(0), np.empty(0, dtype=np.intp)
NO_LINKS, NO_CEILING = np.empty((0, 24)), np.empty((2, 0))
NO_DISCS = Discs(NO_CEILING, NONE, NONE, np.empty(0, dtype=np.bool_))


@dataclass(frozen=True, slots=True)
class AllLimits:
    """Limits of which the compiled planner knows all.

    Args:
        joints: The arm and the limits of its joints.
        fixed: Constraints that are ceilings which depend on the place only.
        disc: The limit of tool acceleration; None for none.
    """

    joints: Joints
    fixed: tuple[ToolSpeed | CentripetalAcceleration, ...]
    disc: ToolAcceleration | None

    @classmethod
    def of(cls, active: Sequence[Constraint], dof: int) -> AllLimits | None:
        """Limits of constraints; None if the compiled kernel does not support this set.

        Args:
            active: The constraints.
            dof: Number of joints.
        """
        # Subclasses may keep other limits.
        found = {type(x): x for x in active}
        order = [type(x) for x in active if type(x) in ROWS]
        known = set(found) <= {*ROWS, *CEILINGS, ToolAcceleration}
        if not known or len(found) < len(active) or order != [x for x in ROWS if x in found]:
            return None
        if not order and ToolAcceleration not in found:
            return None
        velocity, disc = found.get(JointVelocity), found.get(ToolAcceleration)
        acceleration, torque = found.get(JointAcceleration), found.get(JointTorque)
        bounds, own = (NONE, NONE), (NONE, NONE, NONE, NO_LINKS, np.empty(3))
        if isinstance(acceleration, JointAcceleration):
            bounds = acceleration.low, acceleration.high
        if isinstance(torque, JointTorque):
            links, gravity = torque.dynamics.numbers
            own = torque.limit, torque.viscous, torque.coulomb, links, gravity
        most = velocity.limit if isinstance(velocity, JointVelocity) else np.full(dof, np.inf)
        return cls(
            # Kernels are compiled for arrays that may be written.
            joints=Joints(*(for_kernel(x) for x in (most, *bounds, *own))),
            fixed=tuple(
                x for x in found.values() if isinstance(x, ToolSpeed | CentripetalAcceleration)
            ),
            disc=disc if isinstance(disc, ToolAcceleration) else None,
        )

    def plan(
        self, path: JointPath, grid: Grid, coarse: Grid, of: IntArray, rules: Rules
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Plan on a coarse grid, and then with margins on the grid itself.

        Args:
            path: The joint path.
            grid: The grid.
            coarse: The grid of the first pass.
            of: The coarse interval of each interval, (n,).
            rules: The rules.

        Returns:
            What `plan_in_brackets` returns; LEFT without a plan on the coarse grid.
        """
        return self._plan(path, self._on(grid), self._on(coarse), of, rules)

    def plan_from_rest(
        self, path: JointPath, count: IntArray, rules: Rules
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Plan from rest to rest on a grid that is made for it, finer at both ends.

        It gives what `plan` gives on that grid, in less time.

        Args:
            path: The joint path, without stops.
            count: Number of intervals of each piece, of `share_out`.
            rules: The rules.

        Returns:
            Points of the grid [m], (n + 1,), ds² there, (n + 1,), and slopes of dds, (n,); None
            where another grid is needed, or there is no plan.
        """
        ceiling = NONE
        if self.fixed:
            found = [x.on_pieces for x in self.fixed]
            known = [x for x in found if x is not None]
            if len(known) < len(found):
                return None
            ceiling = np.asarray(reduce(np.minimum, known))
        if self.disc is not None or len(path.stops):
            return None
        s, piece, fixed, coarse, coarse_piece, coarse_fixed, of = grids_from_rest(
            np.array(path.breaks),
            count,
            np.array(ceiling),
            SHARE_AT_RESTS,
            PARTS_AT_REST,
            COARSER,
            COARSER * FEWEST_COARSE,
        )
        # Nobody else has these arrays: kernels are compiled for those of grids, which are locked.
        s.setflags(write=False)
        coarse.setflags(write=False)
        places = Places(s, piece, NOWHERE, fixed, *NO_DISCS)
        roughly = Places(coarse, coarse_piece, NOWHERE, coarse_fixed, *NO_DISCS)
        x, skew, _, outcome = self._plan(path, places, roughly, of, rules)
        return (s, x, skew) if outcome == FOUND else None

    def _plan(
        self, path: JointPath, on: Places, roughly: Places, of: IntArray, rules: Rules
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """What `plan` gives, of the limits on both grids."""
        n, joints, own = len(on.piece), self.joints, (path.breaks, path.coefficients)
        lines = len(joints.torque)
        rows = len(joints.low) + (2 if joints.viscous.any() else 1) * lines
        # One piece of memory: several would be given back to the system, which clears each anew.
        blocks = -(-n // B)
        memory = np.empty(n * 9 * lines + blocks * 2 * rows * ENDS)
        terms = memory[: 6 * n * lines].reshape(3, 2, n if lines else 0, lines)
        middles = memory[6 * n * lines : 9 * n * lines].reshape(3, n if lines else 0, lines)
        packed = memory[9 * n * lines :].reshape(blocks, 2 * rows, ENDS)
        if lines:
            terms_on_grid(joints.links, joints.gravity, *own, on.piece, on.s, terms, middles)
        # Both passes in one call would take twice as long to compile.
        x, slope, sound = plan_roughly(*own, roughly, of, joints, rules, terms)
        if not sound:
            return x, slope, slope, LEFT
        return plan_in_brackets(*own, on, of, joints, rules, x, slope, terms, middles, packed)

    def _on(self, grid: Grid) -> Places:
        """A grid with the limits of the tool on it."""
        fixed, stops = fixed_on(self.fixed, grid)
        discs = NO_DISCS if self.disc is None else self.disc.on(grid)
        return Places(grid.s, grid.piece, stops, fixed, *discs)


def fixed_on(
    fixed: Sequence[ToolSpeed | CentripetalAcceleration], grid: Grid
) -> tuple[FloatArray, IntArray]:
    """The lowest of fixed ceilings at the ends of intervals, and the points of stops.

    Args:
        fixed: The constraints that are such ceilings.
        grid: The grid.

    Returns:
        The ceilings of x, (2, n), or (2, 0) for none; and the indices of the points.
    """
    found = [x.fixed_ceiling(grid) for x in fixed]
    stops = grid.joint_path.stops
    at = np.searchsorted(grid.s, stops) if len(stops) else NOWHERE
    if len(found) < 2:
        return np.ascontiguousarray(found[0]) if found else NO_CEILING, at
    return np.min(found, axis=0), at
