"""The base class of constraints.

A constraint writes its limit on a grid once, in the forms of `armcontour.planning.topp.limits`.
Each form comes with bounds of its rise between the ends of an interval, so that what holds at both
ends holds between them too (docs/concepts/optimal.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion import PathLaw
from armcontour.planning.grid import Grid
from armcontour.planning.topp.limits import (
    HIGH,
    LOW,
    A,
    B,
    Ceiling,
    Form,
    Rounds,
    Rows,
    Squares,
    checked,
    collect,
)
from armcontour.planning.topp.limits import Limits as LimitsOnGrid
from armcontour.planning.topp.on_grid import OnGrid
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States, use_of
from armcontour.robot.limits import JERK_LIMITS

# Shares of the time of an interval at which what is not known from its ends is looked at.
INSIDE = np.linspace(0.0, 1.0, 5)[:, None]


@dataclass(frozen=True)
class IntervalEnds:
    """A plan at the starts (index 0) and ends (1) of all intervals, and inside them.

    Args:
        arm: The arm.
        law: The plan.
        grid: The grid of the plan.
    """

    arm: Arm
    law: PathLaw
    grid: Grid

    @cached_property
    def on(self) -> OnGrid:
        """The joint path on the grid."""
        return OnGrid(self.grid)

    @cached_property
    def x(self) -> FloatArray:
        """Square of the path speed, ds² [m²/s²], (n, 2)."""
        square = self.law.speeds**2
        return np.stack([square[:-1], square[1:]], axis=1)

    @cached_property
    def u(self) -> FloatArray:
        """Path acceleration dds [m/s²], (n, 2)."""
        rates = self.law.rates
        return np.stack([rates.dds, rates.dds + rates.slope * self.grid.width], axis=1)

    @cached_property
    def states(self) -> States:
        """Joint states at the start and the end of every interval in turn, (2 n, dof)."""
        piece, s = np.repeat(self.grid.piece, 2), np.repeat(self.grid.s, 2)[1:-1]
        q = self.grid.joint_path.on_interval(piece, s)
        x, u = self.x[..., None], self.u[..., None]
        first, second = self.on.derivatives[0]
        dq, ddq = first * np.sqrt(x), first * u + second * x
        return States(self.arm, (q, dq.reshape(q.shape), ddq.reshape(q.shape)))

    @cached_property
    def places(self) -> tuple[IntArray, FloatArray]:
        """The interval and time [s] of places in every interval, its ends too, (places n,) each."""
        breaks = self.law.breaks
        t = breaks[:-1] + INSIDE * np.diff(breaks)
        t[-1] = breaks[1:]
        return np.tile(np.arange(len(self.grid)), len(t)), t.ravel()

    @cached_property
    def inside(self) -> States:
        """Joint states with their jerks at all `places`."""
        return States(self.arm, self.law.motion(*self.places, 3))

    def largest_use(self, name: str, limits: Limits) -> FloatArray:
        """Largest used share of a limit on every interval, (n, joints or 1).

        Jerk is `q''' ds³ + 3 q'' ds dds + q' s'''`, which may be largest between the ends.
        """
        n = len(self.grid)
        if name not in JERK_LIMITS:
            ratio = self.states.use(name, limits).ratio.reshape(n, 2, -1)
            return np.asarray(ratio.max(axis=1))
        use = (
            use_of(name, limits, self.law.path_position(*self.places, 3))
            if name == "path_jerk"
            else self.inside.use(name, limits)
        )
        return np.asarray(use.ratio.reshape(len(INSIDE), n, -1).max(axis=0))


class Constraint:
    """One limit along a path; this base class limits nothing.

    Attributes:
        name: Name in messages, such as "acceleration".
        limit_name: The field of `Limits` that the constraint keeps, for messages.
        limit: Largest value; one number, or one per joint.
        joints: Whether there is one limit per joint, which explanations then name.
        curved: Whether it has viscous friction, which rows bound for a range of x only.
    """

    name = ""
    limit_name = ""
    limit: float | FloatArray = np.inf
    joints = False
    curved = False

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The limit on a grid.

        Args:
            path: The joint path on the grid.
        """
        return ()

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Name and index of the joint, from 0 or None, of each column of `usage`."""
        if not self.joints:
            return [(self.name, None)]
        return [(self.name, k) for k in range(np.size(self.limit))]

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Used share of the limit on every interval, the larger one of both ends.

        Args:
            ends: The plan.

        Returns:
            (n, 1), or (n, joints) where `joints` is true.
        """
        used = np.zeros((len(ends.grid), 1))
        for form in self.on(ends.on):
            used = np.maximum(used, _usage(form, ends.x[..., None], ends.u[..., None]).max(axis=1))
        return used if self.joints else used.max(axis=1, keepdims=True)


def _usage(form: Form, x: FloatArray, u: FloatArray) -> FloatArray:
    """Used share of a form at the starts and ends of all intervals, (n, 2, rows)."""
    match form:
        case Rows():
            value = form.ends[..., A] * u + form.ends[..., B] * x
            return np.maximum(value / form.ends[..., HIGH], value / form.ends[..., LOW])
        case Squares():
            return np.sqrt(form.ends * x)
        case Rounds():
            value = form.ends[..., A, :] * u[..., None] + form.ends[..., B, :] * x[..., None]
            return np.asarray(np.linalg.norm(value, axis=-1) / form.radius[:, None])
        case Ceiling():
            return np.sqrt(x / form.x[..., None])
    return np.zeros_like(x)


def limits_on(path: OnGrid, active: Sequence[Constraint]) -> LimitsOnGrid:
    """All limits on a grid.

    Args:
        path: The joint path on the grid.
        active: The constraints.

    Raises:
        InvalidInput: A form has arrays of another shape than it should.
    """
    n = len(path)
    return collect([checked(form, n, x.name) for x in active for form in x.on(path)], n)
