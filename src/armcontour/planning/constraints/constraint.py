"""Base classes of constraints, and constraints with coefficients that are functions of s.

A constraint writes its limit on a grid once, in the forms of `planning.topp.limit_forms`. Each form
has bounds of its rise between the ends of an interval. A limit that holds at both ends therefore
also holds between them (docs/concepts/optimal.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.motion import PathLaw
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import (
    HIGH,
    LOW,
    A,
    B,
    Ceiling,
    Form,
    GridLimits,
    LinearRows,
    Rounds,
    Squares,
    check_form,
    collect,
)
from armcontour.planning.topp.on_grid import OnGrid
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States, use_of
from armcontour.robot.limits import JERK_LIMITS, UNITS

# Relative times of the samples inside an interval.
INSIDE = np.linspace(0.0, 1.0, 5)[:, None]


@dataclass(frozen=True)
class IntervalEnds:
    """A plan at the starts (index 0) and ends (1) of all intervals, and inside them."""

    arm: Arm
    law: PathLaw
    grid: Grid

    @cached_property
    def path(self) -> OnGrid:
        """The joint path on the grid."""
        return OnGrid(self.grid)

    @cached_property
    def x(self) -> FloatArray:
        """Squared path speed ds² [m²/s²], (n, 2)."""
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
        first, second = self.path.derivatives[0]
        dq, ddq = first * np.sqrt(x), first * u + second * x
        return States(self.arm, (q, dq.reshape(q.shape), ddq.reshape(q.shape)))

    @cached_property
    def places(self) -> tuple[IntArray, FloatArray]:
        """Interval and time [s] of samples in every interval, ends included, (samples n,) each."""
        breaks = self.law.breaks
        t = breaks[:-1] + INSIDE * np.diff(breaks)
        t[-1] = breaks[1:]
        return np.tile(np.arange(len(self.grid)), len(t)), t.ravel()

    @cached_property
    def inside(self) -> States:
        """Joint states with their jerks at all `places`."""
        return States(self.arm, self.law.motion(*self.places, 3))

    def largest_use(self, name: str, limits: Limits) -> FloatArray:
        """Largest used share of a limit on every interval, (n, joints or 1)."""
        # Jerk is `q''' ds³ + 3 q'' ds dds + q' s'''`, which may be largest between the ends.
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
    """One limit along a path; this base class limits nothing."""

    name = ""  # Name in messages, such as "acceleration"
    limit_name = ""  # The field of `Limits` of the constraint, for messages
    limit: float | FloatArray = np.inf  # Largest value; one number, or one per joint
    joints = False  # True if each joint has its own limit, which explanations then name
    curved = False  # True if the limit has viscous friction, which rows bound for a range of x only

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """The limit on a grid."""
        # `path`: the joint path on the grid.
        return ()

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Name and index of the joint, from 0 or None, of each column of `usage`."""
        if not self.joints:
            return [(self.name, None)]
        return [(self.name, k) for k in range(np.size(self.limit))]

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Used share of the limit on every interval, the larger one of both ends."""
        # Returns (n, 1), or (n, joints) if `joints` is true.
        used = np.zeros((len(ends.grid), 1))
        for form in self.discretize(ends.path):
            used = np.maximum(used, _usage(form, ends.x[..., None], ends.u[..., None]).max(axis=1))
        return used if self.joints else used.max(axis=1, keepdims=True)


def _usage(form: Form, x: FloatArray, u: FloatArray) -> FloatArray:
    """Used share of a form at the starts and ends of all intervals, (n, 2, rows)."""
    match form:
        case LinearRows():
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


def limits_on(path: OnGrid, active: Sequence[Constraint]) -> GridLimits:
    """Discretize the constraints on a grid."""
    n = len(path)
    return collect([check_form(form, n, x.name) for x in active for form in x.discretize(path)], n)


Coefficients = Callable[[FloatArray, str], tuple[FloatArray, FloatArray, FloatArray]]


class SecondOrder(Constraint):
    """`low <= a(s) u + b(s) x + c(s) <= high`, one row per quantity."""

    @checked
    def __init__(
        self,
        name: str,
        coefficients: Coefficients,
        low: npt.ArrayLike,  # Lower bounds, (rows,)
        high: npt.ArrayLike,  # Upper bounds, (rows,)
        *,
        joints: bool = False,  # True if each row belongs to a joint
    ) -> None:
        # `coefficients`: called with arc lengths (n,) and "right" or "left", the side to evaluate
        # at vertices between segments; returns a, b and c, (n, rows) each. Smooth between grid
        # points.
        self.name = name
        self.coefficients = coefficients
        bounds = (checks.shaped(f"bounds of {name}", x, (None,)) for x in (low, high))
        self.low, self.high = map(checks.frozen_array, bounds)
        if self.low.shape != self.high.shape or not (self.low <= self.high).all():
            raise InvalidInput(f"The lower bounds of {name} must be at most its upper bounds.")
        self.joints = joints

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """The name, with the joint of each row if rows belong to joints."""
        return [(self.name, k) for k in range(len(self.low))] if self.joints else super().names

    def _at(self, s: FloatArray, side: str) -> FloatArray:
        name, shape = f"coefficients of {self.name}", (3, len(s), len(self.low))
        return checks.shaped(name, checks.check_numbers(name, self.coefficients(s, side)), shape)

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """The rows on a grid."""
        path, last = OnGrid(path.grid, jumps=True), 2 * len(path)
        _, s = path.places
        a, b, c = np.concatenate([self._at(s[:last], "right"), self._at(s[last:], "left")], axis=1)
        check_rest(path.grid, self, path.at_ends(c), (self.low, self.high))
        return (path.rows((a, b, c), kernel_array(self.low), kernel_array(self.high)),)


def check_rest(
    grid: Grid,
    constraint: Constraint,
    value: FloatArray,  # The quantity at the starts and ends of all intervals, (n, 2, rows)
    bounds: tuple[FloatArray, FloatArray],  # Lower and upper bounds, (rows,) each
    *,
    when: str = "even at rest",  # Words of the error message: the motion with this value
    cannot: str = "hold itself",  # Words of the error message: the impossible action of the arm
) -> None:
    """Check a quantity against its bounds at rest or in arbitrarily slow motion."""
    low, high = bounds
    if ((value >= low) & (value <= high)).all():
        return
    over = np.maximum(value - high, low - value)
    i, end, row = np.unravel_index(int(np.argmax(over)), over.shape)
    needed, s = float(value[i, end, row]), float(grid.s[i + end])
    allowed = float(high[row] if needed > high[row] else low[row])
    joint = int(row) if constraint.joints else None
    who = constraint.name if joint is None else f"joint {joint + 1} {constraint.name}"
    unit = f" {UNITS[constraint.limit_name]}" if constraint.limit_name in UNITS else ""
    raise NotRealizable(
        f"At {s:.6g} m along the path the {who} is {needed:.4g}{unit} {when}, but its limit in "
        f"this plan, less any reserve, is {allowed:.4g}{unit}: the arm cannot {cannot} there.",
        s=s,
        joint=joint,
        limit=constraint.name,
        needed=needed,
        allowed=allowed,
    )
