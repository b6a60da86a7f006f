"""Forms in which constraints state limits on a grid, with bounds of the rise inside intervals.

On an interval the path acceleration u = dds is linear in s. A limit holds between the ends of the
interval if both ends satisfy it with a margin `rise . (U, X, K, 1)`: this bounds its excess over
the chord while |u| <= U and x = ds² <= X, with the size K of the slope of u. Therefore each limit
is written once for a grid. docs/concepts/time_optimal.md has the proofs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.core.errors import InvalidInput
from armcontour.core.kernel_cache import compiled
from armcontour.core.simd import LANES

# Last axis of `LinearRows.ends`; A and B are also the axis of the two vectors in `Rounds.ends`.
A, B, LOW, HIGH = range(4)
# Last axis of every `rise`: factors of U, X, K and 1.
BY_U, BY_X, BY_SLOPE, BY_CONSTANT = range(4)
# Offsets in a group of `JointBounds`, which has LANES joints: lower and upper bounds of
# accelerations, inverse squares of lower and upper bounds of velocities, and twice the lane index.
# ROWS is the length of a group.
LOWEST, HIGHEST, BACKWARD, FORWARD, LANE, ROWS = range(0, 6 * LANES, LANES)
# Rounding error of differences of x, as a fraction of x.
X_ROUNDING = 2e-15
# Columns of `Friction.within`: largest absolute value, deviation from the chord, sign
LARGEST, DEVIATION, SIGN = range(3)


class Intervals(NamedTuple):
    """Intervals of a grid, and the joint path that they divide."""

    s: FloatArray  # Ends of the intervals [m], (n + 1,)
    piece: IntArray  # Piece of the joint path for each interval, (n,)
    breaks: FloatArray  # Breaks of the joint path [m], (pieces + 1,)
    # Coefficients of the joint path, flat, then LANES zeros, because loads read beyond a piece
    coefficients: FloatArray
    dof: int


class JointBounds(NamedTuple):
    """Bounds of joint velocities and accelerations; the planner converts them to rows."""

    # LOWEST, HIGHEST, BACKWARD, FORWARD and LANE of each group of LANES joints, flat. Lanes without
    # a joint are unbounded.
    bounds: FloatArray

    @classmethod
    def from_limits(
        cls,
        dof: int,
        acceleration: tuple[FloatArray, FloatArray],
        velocity: tuple[FloatArray, FloatArray],
    ) -> JointBounds:
        """Make the groups of joints.

        - `dof`: number of joints.
        - `acceleration`: lower and upper bounds [rad/s²], (dof,) each; empty arrays for no limit.
        - `velocity`: lower and upper bounds [rad/s], (dof,) each; empty arrays for no limit.
        """
        table = np.empty(-(-dof // LANES) * ROWS)
        write_joint_bounds(*acceleration, *velocity, table)
        return cls(table)


@compiled()
def write_joint_bounds(
    lowest: FloatArray,
    highest: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    table: FloatArray,
) -> None:
    """Write the groups of `JointBounds`; arguments as in `JointBounds.from_limits`."""
    for joint in range(len(table) // ROWS * LANES):
        lane = joint % LANES
        at = joint // LANES * ROWS + lane
        has_acceleration = joint < len(lowest)
        has_velocity = joint < len(slowest)
        table[at + LOWEST] = lowest[joint] if has_acceleration else -math.inf
        table[at + HIGHEST] = highest[joint] if has_acceleration else math.inf
        table[at + BACKWARD] = 1 / slowest[joint] ** 2 if has_velocity else 0.0
        table[at + FORWARD] = 1 / fastest[joint] ** 2 if has_velocity else 0.0
        table[at + LANE] = 2.0 * lane


class LinearRows(NamedTuple):
    """Linear limits `low <= a u + b x <= high`."""

    # a, b, low and high at the starts (index 0) and ends (1) of the intervals, (n, 2, rows, 4)
    ends: FloatArray
    rise: FloatArray  # Rise of each row, (n, rows, 4)


class Squares(NamedTuple):
    """Speed limits `b x <= 1`, where b x is the squared ratio of speed and limit."""

    ends: FloatArray  # b at the starts and ends of the intervals, (n, 2, rows)
    largest: FloatArray  # The largest b on each interval, (n, rows)
    rise: FloatArray  # Rise of each row, (n, rows, 4)


class Rounds(NamedTuple):
    """Limits `|a u + b x| <= radius` on vector norms."""

    # Vectors a and b at the starts and ends of the intervals, (n, 2, rounds, 2, 3). Their products
    # would lose the difference of two vectors that are almost equal.
    ends: FloatArray
    radius: FloatArray  # Radii, (n, rounds)
    rise: FloatArray  # Rise of the norm of each vector, (n, rounds, 4)

    @property
    def products(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products a a, a b and b b at the starts and ends, (n, 2, rounds) each."""
        a, b = self.ends[..., A, :], self.ends[..., B, :]
        return (a * a).sum(axis=-1), (a * b).sum(axis=-1), (b * b).sum(axis=-1)


class Friction(NamedTuple):
    """Viscous friction, which adds `viscous sqrt(x)` to the first rows."""

    # Friction for x = 1 at the starts and ends of the intervals, (n, 2, joints)
    viscous: FloatArray
    # Largest absolute value on the interval, largest deviation from the chord, and sign (0 if it
    # may change), (n, joints, 3)
    within: FloatArray


class Ceiling(NamedTuple):
    """Upper bound of x [m²/s²] at the ends of each interval; inside, their chord is the bound."""

    x: FloatArray  # Bounds at the starts and ends of the intervals, (n, 2)


class GridLimits(NamedTuple):
    """All limits on a grid; `ceiling`: lowest upper bounds of x, (n, 2); `joints`: joint bounds."""

    rows: LinearRows
    squares: Squares
    rounds: Rounds
    friction: Friction
    ceiling: FloatArray
    joints: FloatArray


class MotionBounds(NamedTuple):
    """Bounds |u| <= `u` and `x_min` <= x <= `x` for valid margins, and slopes `k`, (n,) each."""

    x: FloatArray
    x_min: FloatArray
    u: FloatArray
    k: FloatArray


Form = JointBounds | LinearRows | Squares | Rounds | Friction | Ceiling


# Axes of the arrays of a form after the intervals; None is the number of rows.
SHAPES: dict[type, dict[str, tuple[int | None, ...]]] = {
    LinearRows: {"ends": (2, None, 4), "rise": (None, 4)},
    Squares: {"ends": (2, None), "largest": (None,), "rise": (None, 4)},
    Rounds: {"ends": (2, None, 2, 3), "radius": (None,), "rise": (None, 4)},
    Friction: {"viscous": (2, None), "within": (None, 3)},
    Ceiling: {"x": (2,)},
}
TABLES = (LinearRows, Squares, Rounds, Friction)


def check_form(form: Form, n: int, name: str) -> Form:
    """Check the shapes of a form on n intervals, and prepare its arrays for kernels."""
    if isinstance(form, JointBounds):
        return form
    rows = form[-1].shape[1] if form[-1].ndim > 1 else 0
    for field, values in zip(form._fields, form, strict=True):
        shape = n, *(rows if x is None else x for x in SHAPES[type(form)][field])
        if values.shape != shape:
            raise InvalidInput(
                f"The array {field} of the {type(form).__name__} of the constraint {name} has the "
                f"shape {values.shape}, but must have the shape {shape} on a grid of {n} "
                "intervals."
            )
    return type(form)(*(kernel_array(x) for x in form))


def combine_forms(forms: Iterable[Form], n: int) -> GridLimits:
    """Combine the forms of all constraints on a grid of n intervals."""
    tables: dict[type, list[tuple[FloatArray, ...]]] = {}
    for form in forms:
        tables.setdefault(type(form), []).append(form)
    ceilings = [x[0] for x in tables.get(Ceiling, ())]
    joints = [x[0] for x in tables.get(JointBounds, ())]
    bounds = joints[0] if len(joints) == 1 else np.concatenate([*joints, np.empty(0)])
    rows, squares, rounds, friction = (_concatenate(x, tables.get(x), n) for x in TABLES)
    return GridLimits(rows, squares, rounds, friction, _lowest_ceiling(ceilings, n), bounds)


def _lowest_ceiling(ceilings: list[FloatArray], n: int) -> FloatArray:
    """Return the lowest of several upper bounds of x, (n, 2); infinite if there are none."""
    if not ceilings:
        unlimited = np.empty((n, 2))
        unlimited.fill(np.inf)
        return unlimited
    return ceilings[0] if len(ceilings) == 1 else np.min(ceilings, axis=0)


def _concatenate(kind: type, tables: list[tuple[FloatArray, ...]] | None, n: int) -> Any:
    """Join all forms of one class, on n intervals, to one form; it has no rows without forms."""
    if tables is None:
        return _empty_form(kind, n)
    if len(tables) == 1:
        return tables[0]
    joined = []
    for k, arrays in enumerate(zip(*tables, strict=True)):
        # The first array is for both ends of intervals, with an axis before the axis of rows.
        axis_of_rows = 2 if k == 0 else 1
        joined.append(np.concatenate(arrays, axis=axis_of_rows))
    return kind(*joined)


# The cache is small, because plans use few classes of forms and repeat numbers of intervals.
@lru_cache(maxsize=64)
def _empty_form(kind: type, n: int) -> Any:
    """Make a form of a class without rows, on n intervals."""
    arrays = []
    for axes in SHAPES[kind].values():
        lengths = [0 if x is None else x for x in axes]
        arrays.append(np.empty((n, *lengths)))
    return kind(*arrays)


def largest_u(limits: GridLimits) -> FloatArray:
    """Return the largest |u| at rest on every interval [m/s²], (n,).

    Friction and `JointBounds` are ignored.
    """
    ends = limits.rows.ends
    rounds = limits.rounds
    with np.errstate(divide="ignore"):
        rows = np.maximum(ends[..., HIGH], -ends[..., LOW]) / np.abs(ends[..., A])
        along = rounds.radius[:, None] / np.linalg.norm(rounds.ends[..., A, :], axis=-1)
    return np.asarray(np.concatenate([rows, along], axis=2).min(axis=(1, 2), initial=np.inf))


def margins_of(rise: FloatArray, bounds: tuple[FloatArray, ...]) -> FloatArray:
    """Return the margins of rows, (n, rows), with their rise, (n, rows, 4).

    - `bounds`: bounds x, x_min, u and k of a plan, (n,) each, as in `MotionBounds`.
    """
    x, _, u, slope = (y[:, None] for y in bounds)
    by_motion = rise[..., BY_U] * u + rise[..., BY_X] * x
    return np.asarray(by_motion + rise[..., BY_SLOPE] * np.abs(slope) + rise[..., BY_CONSTANT])
