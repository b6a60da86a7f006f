"""The base class of constraints, and the forms in which constraints reach the optimal planner.

On each interval of the grid the path acceleration `u = dds` is linear in s; its slope is called
skew. With `x = ds²`, a constraint has one or more of these forms at both ends of every interval:

- a ceiling, which is an upper bound of x (maximum velocity curve);
- rows, which are linear: `low <= a u + b x <= high`;
- a disc, which is a second-order cone: `(c x)² + u² <= r²`.

A constraint defines only the forms that it has. Its bounds already include a margin, so that a
constraint which is kept at both ends is kept between them too (proof in docs/concepts/optimal.md).
The margin follows from bounds of x and u on the interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.motion import JointPath, PathLaw
from armcontour.timing.constraints._rows import derivatives
from armcontour.timing.grid import Grid
from armcontour.timing.limit_use import States, quantity


@dataclass(frozen=True, slots=True)
class JointDerivatives:
    """Derivatives of the joint path on a grid.

    Args:
        first: dq_ds at the starts (index 0) and ends (1) of all intervals, (2, n, dof).
        second: d2q_ds2 there, (2, n, dof).
        third: Bound of |d3q_ds3| on each interval, (n, dof).
        fourth: Bound of |d4q_ds4| on each interval, (n, dof).
    """

    first: FloatArray
    second: FloatArray
    third: FloatArray
    fourth: FloatArray

    @classmethod
    def on(cls, grid: Grid) -> JointDerivatives:
        """Compute the derivatives of the grid's joint path."""
        path: JointPath = grid.joint_path
        arrays = np.empty((6, len(grid), path.dof))
        parts = arrays[0:2], arrays[2:4], arrays[4], arrays[5]
        derivatives(path.coefficients, path.breaks, grid.piece, grid.s, *parts)
        return cls(*parts)


# Shares of the time of an interval at which what is not known from its ends is looked at.
INSIDE = np.linspace(0.0, 1.0, 5)[:, None]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of the path speed and acceleration on each interval that hold for every plan.

    Args:
        x: Largest ds² [m²/s²], (n,).
        u: Largest |dds| [m/s²], (n,).
        skew: Slope of dds over s [1/s²], (n,); with limits of jerk the largest size of the slope.
        least: Smallest ds² [m²/s²], (n,); a lower bound if any constraint is `bracketed`.
    """

    x: FloatArray
    u: FloatArray
    skew: FloatArray
    least: FloatArray


@dataclass(frozen=True, slots=True)
class Ceiling:
    """Upper bound of x.

    Args:
        x: Largest x at the starts and ends of all intervals [m²/s²], (2, n).
        lost: Largest share of the bound that margins have taken on each interval, (n,); None for
            no margins.
    """

    x: FloatArray
    lost: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Rows:
    """Linear constraints at the starts (index 0) and ends (1) of all intervals.

    Args:
        a: Coefficients of u, (2, n, rows).
        b: Coefficients of x, (2, n, rows).
        low: Lower bounds, (2, n, rows).
        high: Upper bounds, (2, n, rows).
        margin: Margin subtracted from both bounds on each interval, (n, rows).
    """

    a: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray
    margin: FloatArray

    @property
    def last(self) -> Rows:
        """The rows of the last interval, which hold no array of all intervals."""
        a, b, low, high = (x[:, -1:].copy() for x in (self.a, self.b, self.low, self.high))
        return Rows(a, b, low, high, self.margin[-1:].copy())

    def compact(self, n: int, name: str) -> Rows:
        """The same rows in contiguous arrays; bounds that do not differ have one entry for all.

        Lower and upper bounds have the same shape: along axes on which both were broadcast, 1.

        Args:
            n: Number of intervals.
            name: Name of the constraint, for the message.

        Raises:
            InvalidInput: The arrays have other shapes than they should.
        """
        shape = (2, n, *self.a.shape[2:3])
        alike = self.a.shape == self.b.shape == self.low.shape == self.high.shape == shape
        if not (alike and self.margin.shape == shape[1:]):
            self._refuse_shapes(shape, name)
        ends, places, _ = zip(self.low.strides, self.high.strides, strict=True)
        shared = slice(None if any(ends) else 1), slice(None if any(places) else 1)
        return Rows(
            _contiguous(self.a),
            _contiguous(self.b),
            _contiguous(self.low[shared]),
            _contiguous(self.high[shared]),
            _contiguous(self.margin),
        )

    def _refuse_shapes(self, shape: tuple[int, ...], name: str) -> NoReturn:
        """Refuse the first array that has another shape than it should."""
        expected = {"a": shape, "b": shape, "low": shape, "high": shape, "margin": shape[1:]}
        field, wanted = next((x, y) for x, y in expected.items() if getattr(self, x).shape != y)
        raise InvalidInput(
            f"The rows of the constraint {name} have {field} of shape "
            f"{getattr(self, field).shape}, where {wanted} is expected: two ends, {shape[1]} "
            "intervals and the number of rows."
        )


def _contiguous(values: FloatArray) -> FloatArray:
    """The array, or a contiguous copy that may be written: kernels are compiled for these."""
    return values if values.flags.c_contiguous and values.flags.writeable else values.copy("C")


@dataclass(frozen=True, slots=True)
class Disc:
    """A constraint `(c x)² + u² <= r²`.

    Args:
        c: Coefficients of x at the starts and ends of all intervals [1/m], (2, n).
        r: Radius [m/s²], (n,).
    """

    c: FloatArray
    r: FloatArray

    def refuse_shape(self, n: int, name: str) -> None:
        """Refuse the disc of a constraint whose arrays are not those of n intervals.

        Raises:
            InvalidInput: They have other shapes.
        """
        if np.shape(self.c) != (2, n) or np.shape(self.r) != (n,):
            raise InvalidInput(
                f"The disc of the constraint {name} has c of shape {np.shape(self.c)} and r of "
                f"shape {np.shape(self.r)}, where {(2, n)} and {(n,)} are expected."
            )


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
    def path(self) -> JointDerivatives:
        """Derivatives of the joint path on the grid."""
        return JointDerivatives.on(self.grid)

    @cached_property
    def x(self) -> FloatArray:
        """Square of the path speed, ds² [m²/s²], (2, n)."""
        square = self.law.speeds**2
        return np.stack([square[:-1], square[1:]])

    @cached_property
    def u(self) -> FloatArray:
        """Path acceleration dds [m/s²], (2, n)."""
        rates = self.law.rates
        return np.stack([rates.dds, rates.dds + rates.slope * self.grid.width])

    @cached_property
    def states(self) -> States:
        """Joint states at all starts and then at all ends, (2 n, dof)."""
        piece, s = np.tile(self.grid.piece, 2), np.append(self.grid.s[:-1], self.grid.s[1:])
        q = self.grid.joint_path.on_interval(piece, s)
        x, u = self.x[..., None], self.u[..., None]
        dq, ddq = self.path.first * np.sqrt(x), self.path.first * u + self.path.second * x
        return States(self.arm, q, dq.reshape(q.shape), ddq.reshape(q.shape))

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
        return States(self.arm, *(self.law.on_interval(*self.places, k) for k in range(4)))


class Constraint:
    """One limit along a path; this base class limits nothing.

    Attributes:
        name: Name in messages, such as "acceleration".
        limit_name: The field of `Limits` that the constraint keeps, with the values `limit`; its
            use is computed from this limit. Empty: from its rows, ceiling and disc.
        limit: Largest value; one number, or one per joint.
        joints: Whether there is one limit per joint, which explanations then name.
        curved: Whether rows are tangents of a curve in x; the first pass is then repeated with the
            tangents at its own plan.
        bracketed: Whether rows hold only while x is from `bounds.least` to `bounds.x` on every
            interval, or have much smaller margins then. The planner then keeps x within brackets,
            on a grid that is finer next to rests.
    """

    name = ""
    limit_name = ""
    limit: float | FloatArray = np.inf
    joints = False
    curved = False
    bracketed = False

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling | None:
        """Upper bound of x at the starts and ends of all intervals.

        Args:
            grid: The grid.
            path: Derivatives of the joint path on the grid.
            bounds: Bounds of x and u, from which margins follow; None for no margins, in the first
                pass.
        """
        return None

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows | None:
        """Linear constraints; arguments as in `ceiling`."""
        return None

    def rows_about(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> Rows | None:
        """Rows of the first pass for a plan near x, one x for each interval, (n,)."""
        return self.rows(grid, path, None)

    def disc(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Disc | None:
        """The disc constraint; arguments as in `ceiling`."""
        return None

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray | None:
        """Largest |dds| that the constraint allows on every interval, (n,), given the largest x."""
        return None

    def allowed(self, grid: Grid) -> FloatArray:
        """Largest value of the limited quantity, in a shape that broadcasts to (n, joints or 1)."""
        return np.asarray(self.limit)

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Used share of the limit on every interval, the larger one of both ends.

        Args:
            ends: The plan.

        Returns:
            (n, 1), or (n, joints) where `joints` is true.
        """
        grid, path, x, u = ends.grid, ends.path, ends.x, ends.u
        if self.limit_name:
            found = quantity(self.limit_name, ends.states).reshape(2, len(grid), -1)
            return np.asarray((found / self.allowed(grid)).max(axis=0))
        used = np.zeros((len(grid), 1))
        ceiling = self.ceiling(grid, path, None)
        if ceiling is not None:
            used = np.maximum(used, np.sqrt(x / ceiling.x).max(axis=0)[:, None])
        rows = self.rows(grid, path, None)
        if rows is not None:
            value = rows.a * u[..., None] + rows.b * x[..., None]
            used = np.maximum(used, np.maximum(value / rows.high, value / rows.low).max(axis=0))
        disc = self.disc(grid, path, None)
        if disc is not None:
            used = np.maximum(used, (np.hypot(disc.c * x, u) / disc.r).max(axis=0)[:, None])
        return np.asarray(used)
