"""Constraints of the optimal planner: one subclass of `Constraint` for each kind of limit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray, kernel_array
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.core.pool import split_evenly
from armcontour.core.text import limit_label
from armcontour.motion import JointPath, PathLaw
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import (
    BY_SLOPE,
    BY_U,
    BY_X,
    HIGH,
    LOW,
    X_ROUNDING,
    A,
    B,
    Ceiling,
    Form,
    Friction,
    GridLimits,
    JointBounds,
    LinearRows,
    Rounds,
    Squares,
    check_form,
    combine_forms,
)
from armcontour.planning.topp.sampled_joint_path import SAMPLES_AT_ONCE, SampledJointPath
from armcontour.planning.topp.tool_curvature import speed_and_acceleration, write_chords
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States, require_orientation
from armcontour.robot.limits import LIMITS, TOOL_LIMITS, WITHOUT_CONSTRAINT

# Times of the samples of an interval as fractions of its duration, (5, 1)
INSIDE = np.linspace(0.0, 1.0, 5)[:, None]
Coefficients = Callable[[FloatArray, str], tuple[FloatArray, FloatArray, FloatArray]]
# Positions of the samples on a piece of the joint path, as fractions of its length, (9, 1)
PIECE_SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]
# Positions of the samples on an interval, as fractions of its length, (5, 1)
INTERVAL_SAMPLES = np.linspace(0.0, 1.0, 5)[:, None]
# The curvature of a piece is constant if it varies by at most this fraction.
EVEN_CURVATURE = 1e-3
# The bound of x on an interval is a tangent of `limit / curvature`. The curvature at its point of
# contact is at least this fraction of the larger of the curvatures at both ends.
TOUCH = 0.8
# Smallest divisor [1/m], so that a quotient 0 / 0 of curvatures is 0.
SMALLEST_DIVISOR = 1e-300
# A piece with at most this curvature is a straight line [1/m].
STRAIGHT_CURVATURE = 1e-3


@dataclass(frozen=True)
class IntervalEnds:
    """Motion of a plan at both ends (index 0 and 1) of all intervals, and at samples inside."""

    arm: Arm
    law: PathLaw
    grid: Grid

    @cached_property
    def path(self) -> SampledJointPath:
        """The joint path on the grid."""
        return SampledJointPath(self.grid)

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
        """Joint states at the start and the end of each interval in turn, (2 n, dof) each."""
        piece = np.repeat(self.grid.piece, 2)
        s = np.repeat(self.grid.s, 2)[1:-1]
        q, _, _ = self.grid.joint_path.motion(piece, s)
        x = self.x[..., None]
        u = self.u[..., None]
        dq_ds, d2q_ds2 = self.path.derivatives[0]
        dq = dq_ds * np.sqrt(x)
        ddq = dq_ds * u + d2q_ds2 * x
        return States(self.arm, (q, dq.reshape(q.shape), ddq.reshape(q.shape)))

    @cached_property
    def places(self) -> tuple[IntArray, FloatArray]:
        """Return the interval index and the time [s] of every sample, (5 n,) each."""
        breaks = self.law.breaks
        t = breaks[:-1] + INSIDE * np.diff(breaks)
        t[-1] = breaks[1:]
        return np.tile(np.arange(len(self.grid)), len(t)), t.ravel()

    def largest_jerk_use(self, name: str, limits: Limits) -> FloatArray:
        """Return the largest used fraction of a limit of the jerk per interval, (n, dof).

        - `name`: field of `Limits`.
        """
        # The jerk `q''' ds³ + 3 q'' ds dds + q' s'''` can be largest inside an interval, so it is
        # sampled.
        inside = States(self.arm, self.law.motion(*self.places, 3))
        use = inside.use(name, limits)
        return np.asarray(use.ratio.reshape(len(INSIDE), len(self.grid), -1).max(axis=0))


class Constraint:
    """One limit along a path; this base class limits nothing.

    A constraint reaches the planner in one of two ways: as a class in `Optimal.from_limits`, of
    which `from_limits` makes an object for each plan, or as an object in `Optimal.constraints`.
    """

    # Fields of `Limits` that the constraint keeps; only for classes in `Optimal.from_limits`
    serves: ClassVar[tuple[str, ...]] = ()
    name = ""  # Name in messages, such as "acceleration"
    limit: float | FloatArray = np.inf  # Largest value; one number, or one per joint
    joints = False  # True if each joint has its own limit; explanations then name the joint
    # True if the limit has a term in sqrt(x), viscous friction: each row then has such a term
    curved = False
    # False if a stop need not consider the constraint: a slower motion always satisfies it (limits
    # of speed), or stops have the limit as a limit of the joints
    brakes = True

    @classmethod
    def from_limits(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> Constraint | None:
        """Make the constraint of the limits that it serves; None if there are none."""
        return None

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the forms of the limit on a grid, see `topp.limit_forms`; here none.

        `path` is the joint path on the grid.
        """
        return ()

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Return limit name and joint index (None for the tool) for each column of `usage`."""
        if not self.joints:
            return [(self.name, None)]
        return [(self.name, k) for k in range(np.size(self.limit))]

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Return the used fraction of the limit on each interval, the larger of its two ends.

        The shape is (n, joints) if `joints` is true, otherwise (n, 1).
        """
        used = np.zeros((len(ends.grid), 1))
        for form in self.discretize(ends.path):
            used = np.maximum(used, _usage(form, ends.x[..., None], ends.u[..., None]).max(axis=1))
        return used if self.joints else used.max(axis=1, keepdims=True)


def _usage(form: Form, x: FloatArray, u: FloatArray) -> FloatArray:
    """Return the used fraction of a form at the starts and ends of all intervals, (n, 2, rows).

    - `x`, `u`: squared path speed [m²/s²] and path acceleration [m/s²] there, (n, 2, 1) each.
    """
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


def limits_on(path: SampledJointPath, active: Sequence[Constraint]) -> GridLimits:
    """Discretize the active constraints on a grid, and combine their limits."""
    n = len(path)
    forms = []
    # Viscous friction belongs to the first rows.
    for constraint in sorted(active, key=lambda x: not x.curved):
        for form in constraint.discretize(path):
            forms.append(check_form(form, n, constraint.name))
    return combine_forms(forms, n)


class SecondOrder(Constraint):
    """`low <= a(s) u + b(s) x + c(s) <= high` with u = dds and x = ds², one row per quantity."""

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
        # `coefficients`: function of arc lengths (n,) and of the side, "right" or "left", from
        # which vertices between segments are evaluated. It returns a, b and c, (n, rows) each,
        # which must be smooth between grid points.
        self.name = name
        self.coefficients = coefficients
        bounds = (checks.shaped(f"bounds of {name}", x, (None,)) for x in (low, high))
        self.low, self.high = map(checks.frozen_array, bounds)
        if self.low.shape != self.high.shape or not (self.low <= self.high).all():
            raise InvalidInput(
                f"The lower and upper bounds of {name} must have equal shapes, and no lower bound "
                "may exceed its upper bound."
            )
        self.joints = joints

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Name of the constraint, with the index of each joint if rows belong to joints."""
        return [(self.name, k) for k in range(len(self.low))] if self.joints else super().names

    def _coefficients_at(self, s: FloatArray, side: str) -> FloatArray:
        """Return the checked coefficients a, b and c at arc lengths [m], (3, n, rows)."""
        name = f"coefficients of {self.name}"
        shape = (3, len(s), len(self.low))
        return checks.shaped(name, checks.check_numbers(name, self.coefficients(s, side)), shape)

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the linear rows of the constraint on a grid."""
        last = 2 * len(path)
        path = SampledJointPath(path.grid, jumps=True)
        _, s = path.places
        parts = [self._coefficients_at(s[:last], "right"), self._coefficients_at(s[last:], "left")]
        a, b, c = np.concatenate(parts, axis=1)
        check_rest(path.grid, self, path.at_ends(c), (self.low, self.high))
        return (path.rows((a, b, c), kernel_array(self.low), kernel_array(self.high)),)


def check_rest(
    grid: Grid,
    constraint: Constraint,
    value: FloatArray,  # The quantity at the starts and ends of all intervals, (n, 2, rows)
    bounds: tuple[FloatArray, FloatArray],  # Lower and upper bounds, (rows,) each
    *,
    when: str = "even at rest",  # Part of the message that describes the motion with this value
    cannot: str = "hold itself",  # Part of the message that names the impossible action of the arm
) -> None:
    """Raise NotRealizable if a quantity exceeds its bounds at rest or in very slow motion.

    The error is for the value that exceeds its bound by most.
    """
    low, high = bounds
    if ((value >= low) & (value <= high)).all():
        return
    excess = np.maximum(value - high, low - value)
    i, end, row = np.unravel_index(int(np.argmax(excess)), excess.shape)
    needed = float(value[i, end, row])
    s = float(grid.s[i + end])
    allowed = float(high[row] if needed > high[row] else low[row])
    joint = int(row) if constraint.joints else None
    quantity = limit_label(constraint.name, joint)
    unit = "".join(f" {LIMITS[x].unit}" for x in constraint.serves)
    raise NotRealizable(
        f"At {s:.6g} m along the path the {quantity} is {needed:.4g}{unit} {when}, but its limit "
        f"in this plan, less any reserve, is {allowed:.4g}{unit}. The arm cannot {cannot} there. "
        "Raise the limit, reduce the payload or the reserve, or change the path.",
        s=s,
        joint=joint,
        limit=constraint.name,
        needed=needed,
        allowed=allowed,
    )


class _SlopeBounds(NamedTuple):
    """Slopes q' = dq_ds at the ends of all intervals, and their bounds inside, (n, dof) each."""

    at_ends: FloatArray  # Slopes at the starts and ends, (n, 2, dof)
    largest: FloatArray  # Upper bounds of |q'|
    deviation: FloatArray  # Upper bounds of the distance of q' from its chord
    sign: FloatArray  # Sign of q' on the whole interval; 0 if the joint may reverse or is at rest


def _bound_slopes(path: SampledJointPath) -> _SlopeBounds:
    """Bound the slopes q' = dq_ds of all joints inside the intervals of a grid.

    On an interval of width w, q' deviates from its chord by at most `w² / 8` times the largest
    |q'''|.
    """
    (slopes, _), (third, _) = path.derivatives
    deviation = path.grid.width[:, None] ** 2 / 8 * third
    sizes = np.abs(slopes)
    keeps_sign = (slopes[:, 0] * slopes[:, 1] > 0) & (sizes.min(axis=1) > deviation)
    sign = np.where(keeps_sign, np.sign(slopes[:, 0]), 0.0)
    return _SlopeBounds(slopes, sizes.max(axis=1) + deviation, deviation, sign)


class JointTorque(Constraint):
    """`|a u + b x + c + viscous q' sqrt(x) + coulomb sign(q')| <= limit` for every joint."""

    serves = ("joint_torque",)
    name = LIMITS["joint_torque"].label
    brakes = False
    limit: FloatArray  # Largest torques [N m], (dof,)
    joints = True

    def __init__(self, arm: Arm, limit: FloatArray) -> None:
        self.dynamics = arm.dynamics
        self.limit = np.array(limit)
        chain = self.dynamics.chain
        self.viscous = np.array(chain.viscous)
        self.coulomb = np.array(chain.coulomb)
        self.curved = bool(self.viscous.any())

    @classmethod
    def from_limits(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> JointTorque | None:
        """Make the constraint of the torques; None if they are not limited."""
        return None if limits.joint_torque is None else cls(arm, limits.joint_torque)

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the rows of the torques, with dry friction, and the form of viscous friction.

        docs/concepts/time_optimal.md derives how friction enters the rows.
        """
        bounds = (-self.limit, self.limit)
        rows, gravity = path.rows_of(self.dynamics.path_terms, *bounds)
        check_rest(path.grid, self, gravity, bounds)
        if not (self.curved or self.coulomb.any()):
            return (rows,)
        slopes = _bound_slopes(path)
        lowest, highest = self._dry_friction_range(slopes)
        # In the slowest motion, the torque is gravity plus dry friction.
        creeping = gravity + np.where(gravity > 0, highest[:, None], lowest[:, None])
        when = "in the slowest motion, with friction"
        check_rest(path.grid, self, creeping, bounds, when=when, cannot="move")
        rows.ends[..., LOW] -= lowest[:, None]
        rows.ends[..., HIGH] -= highest[:, None]
        if not self.curved:
            return (rows,)
        within = [self.viscous * slopes.largest, self.viscous * slopes.deviation, slopes.sign]
        return rows, Friction(self.viscous * slopes.at_ends, np.stack(within, axis=2))

    def _dry_friction_range(self, slopes: _SlopeBounds) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and largest dry friction on each interval [N m], (n, dof) each.

        Dry friction is `coulomb sign(q')`. If a joint may reverse, both signs are possible. A joint
        that does not move along the interval has no dry friction.
        """
        friction = np.where(slopes.largest > 0, self.coulomb, 0.0)
        may_reverse = slopes.sign == 0
        lowest = np.where(may_reverse, -1.0, slopes.sign) * friction
        highest = np.where(may_reverse, 1.0, slopes.sign) * friction
        return lowest, highest


class CommandVelocity(Constraint):
    """`lower <= q' ds + lead (q' dds + q'' ds²) <= upper` for every joint with a lead.

    The inverse of a first-order servo with the gain kp has the set-points `u = q + dq / kp`, whose
    velocity is `dq + ddq / kp`. So the lead is 1 / kp, or (1 - f) / kp with the velocity
    feed-forward f. The term in ds has the form of viscous friction. docs/concepts/time_optimal.md
    has the formula.
    """

    name = "command velocity"
    joints = True
    curved = True

    @checked
    def __init__(
        self,
        lead: npt.ArrayLike,  # Time by which set-points lead the plan [s], (dof,); 0 for no bounds
        lower: npt.ArrayLike,  # Lower (negative) bounds of set-point velocities [rad/s], (dof,)
        upper: npt.ArrayLike,  # Upper bounds of set-point velocities [rad/s], (dof,)
    ) -> None:
        names = ("lead", "lower", "upper")
        given = [
            checks.shaped(x, y, (None,)) for x, y in zip(names, (lead, lower, upper), strict=True)
        ]
        self.lead, self.lower, self.upper = map(checks.frozen_array, given)
        if not self.lead.shape == self.lower.shape == self.upper.shape:
            raise InvalidInput("lead, lower and upper of a command velocity need equal shapes.")
        if not (self.lower < 0).all() or not (self.upper > 0).all():
            raise InvalidInput("Bounds of a command velocity must be below and above 0.")
        bounded = np.isfinite(self.lower) | np.isfinite(self.upper)
        self.bounded = np.flatnonzero((self.lead != 0) & bounded)

    @property
    def _values(self) -> tuple[bytes, ...]:
        return self.lead.tobytes(), self.lower.tobytes(), self.upper.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CommandVelocity) and self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    @property
    def names(self) -> list[tuple[str, int | None]]:
        """Name of the constraint, with the index of each joint that has bounds."""
        return [(self.name, int(j)) for j in self.bounded]

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the rows of the accelerations, and the velocities as viscous friction."""
        j = self.bounded
        lead = self.lead[j]

        def terms(
            q: FloatArray, first: FloatArray, second: FloatArray
        ) -> tuple[FloatArray, FloatArray, FloatArray]:
            return lead * first[:, j], lead * second[:, j], 0 * first[:, j]

        rows, _ = path.rows_of(terms, kernel_array(self.lower[j]), kernel_array(self.upper[j]))
        slopes = _bound_slopes(path)
        within = np.stack([slopes.largest, slopes.deviation, slopes.sign], axis=2)
        return rows, Friction(slopes.at_ends[:, :, j], within[:, j])

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Return the used fraction of the bounds on each interval, the larger of its two ends."""
        j = self.bounded
        _, dq, ddq = ends.states.columns
        velocity = dq[:, j] + self.lead[j] * ddq[:, j]
        used = np.maximum(velocity / self.lower[j], velocity / self.upper[j])
        return np.asarray(used.reshape(len(ends.grid), 2, -1).max(axis=1))


class JointMotion(Constraint):
    """Bounds of the velocities `q' ds` and accelerations `q' dds + q'' ds²` of every joint."""

    serves = ("joint_velocity", "joint_acceleration")
    brakes = False

    def __init__(
        self,
        velocity: tuple[FloatArray, FloatArray] | None = None,
        acceleration: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        # `velocity`: lower (negative) and upper bounds [rad/s], (dof,) each, infinite for a joint
        # without a limit; None without velocity limits. `acceleration`: the same for accelerations
        # [rad/s²].
        none = np.empty(0), np.empty(0)
        slowest, fastest = none if velocity is None else velocity
        self.velocity = kernel_array(slowest), kernel_array(fastest)
        low, high = none if acceleration is None else acceleration
        self.low = kernel_array(low)
        self.high = kernel_array(high)

    @classmethod
    def from_limits(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> JointMotion | None:
        """Make the constraint of velocities and accelerations; None if neither is limited."""
        dof = joint_path.dof
        velocity = None
        acceleration = None
        if limits.joint_velocity is not None:
            velocity = limits.velocity_bounds(dof)
        if limits.joint_acceleration is not None:
            acceleration = limits.acceleration_bounds(dof)
        return cls(velocity, acceleration) if velocity or acceleration else None

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper acceleration bounds per interval [rad/s²], (n, joints) each."""
        shape = len(grid), len(self.low)
        return np.broadcast_to(self.low, shape), np.broadcast_to(self.high, shape)

    def fastest(self, path: SampledJointPath) -> FloatArray:
        """Return the joint velocity limits in the directions of motion [rad/s], (n, dof)."""
        (slopes, _), (third, _) = path.derivatives
        # Inside an interval, a slope deviates from its chord by at most this.
        deviation = path.grid.width[:, None] ** 2 / 8 * third
        backward, forward = np.abs(self.velocity)
        # A joint that may reverse must satisfy both bounds.
        otherwise = np.minimum(backward, forward)
        not_forward = np.where(slopes.max(axis=1) < -deviation, backward, otherwise)
        return np.asarray(np.where(slopes.min(axis=1) > deviation, forward, not_forward))

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the bounds of velocities and accelerations; the planner converts them to rows."""
        return (self._form,)

    @cached_property
    def _form(self) -> JointBounds:
        """The bounds of all joints, which are the same on every grid."""
        dof = max(len(self.low), len(self.velocity[0]))
        return JointBounds.from_limits(dof, (self.low, self.high), self.velocity)

    def rows(self, path: SampledJointPath) -> LinearRows:
        """Return the rows of the acceleration g = q' u + q'' x of each joint, with their rise.

        The rise follows from g'' = 5 q''' u + q'''' x + 4 q'' k, where k = u'.
        """
        (slopes, bends), (third, fourth) = path.derivatives
        w = path.grid.width[:, None]
        n = len(path)
        ends = np.empty((n, 2, len(self.low), 4))
        rise = np.zeros((n, len(self.low), 4))
        ends[..., A] = slopes
        ends[..., B] = bends
        ends[..., LOW], ends[..., HIGH] = (x[:, None] for x in self.bounds(path.grid))
        # q1 and q2 are upper bounds of |q'| and |q''| on each interval.
        q1 = np.abs(slopes).max(axis=1) + w**2 / 8 * third
        q2 = np.abs(bends).max(axis=1) + w * third
        rise[..., BY_U] = w**2 / 8 * 5 * third
        rise[..., BY_X] = w**2 / 8 * fourth + X_ROUNDING / w * q1
        rise[..., BY_SLOPE] = w**2 / 8 * 4 * q2
        return LinearRows(ends, rise)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolMetric:
    """Tool motion at ds = 1 along a joint path: upper bounds on each piece, (pieces,)."""

    joint_path: JointPath
    arm: Arm
    speed: FloatArray  # Tool speed [-]
    curvature: FloatArray  # Tool acceleration normal to the motion [1/m]
    # True for pieces along which the curvature varies; their intervals are sampled
    uneven: BoolArray

    @classmethod
    def measure(cls, joint_path: JointPath, arm: Arm) -> ToolMetric:
        """Measure the tool motion along a joint path by forward kinematics."""
        # A bound is the largest sample of a piece plus the spread of its samples.
        breaks = joint_path.breaks
        pieces = np.arange(len(joint_path.breaks) - 1)
        s = breaks[:-1] + PIECE_SAMPLES * (breaks[1:] - breaks[:-1])
        samples = measure_tool(joint_path, arm, np.broadcast_to(pieces, s.shape), s)
        largest, smallest = samples.max(axis=1), samples.min(axis=1)
        speed, curvature = 2 * largest - smallest
        uneven = (largest[1] > STRAIGHT_CURVATURE) & (
            largest[1] - smallest[1] > EVEN_CURVATURE * largest[1]
        )
        return cls(joint_path=joint_path, arm=arm, speed=speed, curvature=curvature, uneven=uneven)

    def curvature_on(self, grid: Grid) -> FloatArray:
        """Return curvatures c at interval ends [1/m], (2, n), for which `c ds² <= limit` suffices.

        If `c ds² <= limit` holds at both ends, the centripetal acceleration is within its limit on
        the whole interval.
        """
        # x is linear in s. If the curvature k is linear too, a / k is convex for a limit a, so a
        # tangent of a / k is a lower bound of a / k. This tangent has the values a / c at the ends,
        # so `c x <= a` at both ends implies `k x <= a` on the whole interval. The tangent touches
        # in the middle, or closer to the end with the larger curvature, so that both values are
        # positive.
        chords = self._chords_on(grid)
        touch = np.maximum(chords.mean(axis=0), TOUCH * chords.max(axis=0))
        # The divisor is positive, except for a line, whose curvatures are 0.
        return np.asarray(touch * touch / np.maximum(2 * touch - chords, SMALLEST_DIVISOR))

    def _chords_on(self, grid: Grid) -> FloatArray:
        """Return curvatures at interval ends [1/m], (2, n), whose chord is an upper bound."""
        chords = np.empty((2, len(grid)))
        chords[:] = self.curvature[grid.piece]
        i = np.flatnonzero(self.uneven[grid.piece])
        if len(i):
            # The end of an interval is the start of the next one on the same piece.
            piece = grid.piece[i]
            alone = np.append((np.diff(i) != 1) | (piece[1:] != piece[:-1]), True)
            s = grid.s[i] + INTERVAL_SAMPLES[:-1] * grid.width[i]
            places = np.append(s.ravel(), grid.s[i[alone] + 1])
            pieces = np.append(np.tile(piece, len(s)), piece[alone])
            _, values = measure_tool(self.joint_path, self.arm, pieces, places)
            sampled = np.empty((2, len(i)))
            inside = values[: s.size].reshape(s.shape)
            write_chords(inside, values[s.size :], alone, STRAIGHT_CURVATURE, sampled)
            chords[:, i] = sampled
        return chords


def measure_tool(joint_path: JointPath, arm: Arm, pieces: IntArray, s: FloatArray) -> FloatArray:
    """Return tool speed [-] and normal tool acceleration [1/m] at ds = 1, (2, *s.shape)."""
    pieces = pieces.ravel()
    places = s.ravel()
    measured = np.empty((2, len(places)))
    for group in split_evenly(len(places), -(-len(places) // SAMPLES_AT_ONCE)):
        motion = joint_path.motion(pieces[group], places[group])
        measured[0, group], _, measured[1, group] = speed_and_acceleration(
            *arm.tool_motion(*motion)
        )
    return measured.reshape(2, *s.shape)


def _refuse_tool_limits(limits: Limits) -> None:
    """Raise InvalidInput if limits of the tool are given, which need a tool path."""
    tool = [x for x in TOOL_LIMITS if getattr(limits, x) is not None]
    if tool:
        raise InvalidInput(
            "Limits of the tool need a tool path, but this joint path has none. Plan a Path or a "
            "traced joint path, or remove the limits with "
            f"limits.replace({', '.join(f'{x}=math.inf' for x in tool)})."
        )


def assigned_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Return the assigned velocity on each piece of a joint path [m/s], (pieces,); inf if none."""
    path = joint_path.tool_path
    breaks = joint_path.breaks
    if path is None:
        _refuse_tool_limits(limits)
        return np.full(len(breaks) - 1, np.inf)
    if len(path) == 1:
        return np.repeat(path.assigned_speeds(limits.speed), len(breaks) - 1)
    return path.assigned_speeds(limits.speed, (breaks[:-1] + breaks[1:]) / 2)


class ToolPace(Constraint):
    """Limits of ds²: `tool speed <= assigned velocity`, and `curvature ds² <= limit`.

    The second limit is that of the centripetal acceleration, which the paper uses in corners.
    """

    serves = ("speed", "centripetal_acceleration")
    brakes = False

    def __init__(
        self, metric: ToolMetric, speed: FloatArray | None, centripetal: float | None
    ) -> None:
        # `metric`: tool motion at ds = 1; `speed`: assigned velocity on each piece of the joint
        # path [m/s], (pieces,); `centripetal`: largest centripetal acceleration [m/s²].
        self._metric = metric
        self._centripetal = centripetal
        self._ceiling = None if speed is None else (speed / metric.speed) ** 2

    @classmethod
    def from_limits(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> ToolPace | None:
        """Make the constraint of assigned velocities and centripetal acceleration, if any."""
        if joint_path.tool_path is None:
            _refuse_tool_limits(limits)
            return None
        speed = assigned_speeds(joint_path, limits)
        centripetal = limits.centripetal_acceleration
        assigned = speed if np.isfinite(speed).any() else None
        if assigned is None and centripetal is None:
            return None
        return cls(ToolMetric.measure(joint_path, arm), assigned, centripetal)

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Yield upper bounds of ds² at interval ends; ds² stays below the chord between them."""
        if self._ceiling is not None:
            ceiling = np.empty((len(path), 2))
            ceiling[:] = self._ceiling[path.grid.piece, None]
            yield Ceiling(ceiling)
        if self._centripetal is not None:
            with np.errstate(divide="ignore"):
                curved = self._centripetal / self._metric.curvature_on(path.grid)
            yield Ceiling(np.ascontiguousarray(curved.T))


class ToolConstraint(Constraint):
    """Base of constraints with one limit of the tool, which is a number."""

    limit: float

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit = limit
        self.arm = arm

    @classmethod
    def from_limits(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> Constraint | None:
        """Make the constraint of the limit; None without a limit."""
        limit = getattr(limits, cls.serves[0])
        return None if limit is None else cls(limit, arm)


class RapidSpeed(ToolConstraint):
    """Limit `tool speed <= limit` [m/s] along a joint path without a tool path."""

    name = "rapid speed"

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the upper bound of ds² on each interval, from samples of the tool speed."""
        # The speed is at most the largest sample plus the spread of the samples.
        grid = path.grid
        s = grid.s[:-1] + INTERVAL_SAMPLES * grid.width
        pieces = np.broadcast_to(grid.piece, s.shape)
        speed = measure_tool(grid.joint_path, self.arm, pieces, s)[0]
        bound = 2 * speed.max(axis=0) - speed.min(axis=0)
        with np.errstate(divide="ignore"):
            ceiling = (self.limit / bound) ** 2
        return (Ceiling(np.stack([ceiling, ceiling], axis=1)),)


class ToolAcceleration(ToolConstraint):
    """Limit `|p' dds + p'' ds²| <= limit` of the acceleration of the tool position p [m/s²]."""

    serves = ("tool_acceleration",)
    name = LIMITS["tool_acceleration"].label

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the limit with vectors in a frame that turns with the motion.

        In this frame, the vectors are constant along a circle.
        """
        speed, along, across = speed_and_acceleration(*self.arm.tool_motion(*path.motion))
        first = np.stack([speed, 0 * speed], axis=1)
        second = np.stack([along, across], axis=1)
        return (path.round(first, second, self.limit),)


class AngularSpeed(ToolConstraint):
    """Limit `|w|² ds² <= limit²`, where w is the angular velocity of the tool at ds = 1 [rad/m]."""

    serves = ("angular_speed",)
    name = LIMITS["angular_speed"].label
    brakes = False

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the squared angular speed at ds = 1, divided by the squared limit."""
        q, first, _ = path.motion
        w = require_orientation(self.arm).tool_twist(q, first)[:, 3:]
        return (path.square(np.einsum("ij,ij->i", w, w) / self.limit**2),)


class AngularAcceleration(ToolConstraint):
    """Limit `|w dds + w' ds²| <= limit`, where w is the angular velocity of the tool at ds = 1."""

    serves = ("angular_acceleration",)
    name = LIMITS["angular_acceleration"].label

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Return the limit with the angular velocity at ds = 1 and its derivative in s."""
        q, first, second = path.motion
        tool = require_orientation(self.arm)
        w = tool.tool_twist(q, first)[:, 3:]
        rate = tool.tool_twist_rate(q, first, second)[:, 3:]
        return (path.round(w, rate, self.limit),)


# Kinds of constraints that the planner makes from `Limits`. The order matters: an
# explanation prefers the first of two limits with equal fractions.
FROM_LIMITS: tuple[type[Constraint], ...] = (
    JointTorque,
    JointMotion,
    ToolPace,
    ToolAcceleration,
    AngularSpeed,
    AngularAcceleration,
)


def constraints_of(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    kinds: Sequence[type[Constraint]] = FROM_LIMITS,
) -> list[Constraint]:
    """Make the constraints that keep the limits of an arm and a path.

    - `kinds`: classes of constraints, each of which serves some of the limits.
    """
    _refuse_unserved(joint_path, limits, kinds)
    constraints = (kind.from_limits(joint_path, arm, limits) for kind in kinds)
    return [x for x in constraints if x is not None]


@lru_cache(maxsize=16)
def _unserved(kinds: tuple[type[Constraint], ...], names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the limits that no constraint of these kinds keeps."""
    served = {name for kind in kinds for name in kind.serves}
    return tuple(x for x in names if x not in served and x not in WITHOUT_CONSTRAINT)


def _refuse_unserved(
    joint_path: JointPath, limits: Limits, kinds: Sequence[type[Constraint]]
) -> None:
    """Raise InvalidInput for a limit that the plan would ignore."""
    unserved = _unserved(tuple(kinds), tuple(LIMITS))
    for name in unserved:
        if getattr(limits, name) is not None:
            raise InvalidInput(
                f"{name} is limited, but no constraint in from_limits serves it, so the plan would "
                "exceed it. Add its constraint to from_limits, or remove the limit with "
                f"limits.replace({name}=math.inf)."
            )
    if "speed" in unserved and np.isfinite(assigned_speeds(joint_path, limits)).any():
        raise InvalidInput(
            "A segment of the path has an assigned velocity, but no constraint in from_limits "
            "serves speed, so the plan would exceed it. Add ToolPace to from_limits, or plan a "
            "path whose segments have no speed."
        )
