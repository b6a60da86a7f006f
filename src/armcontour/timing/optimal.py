"""The optimal planner: the fastest timing of a path that keeps every limit at every instant.

Backward and forward reachability in (s, ds²), after TOPP-RA. On each interval the path acceleration
is linear in s. Its slope is chosen beforehand so that the binding constraint binds on the whole
interval. Every constraint is kept at both ends of an interval, less a margin that bounds what can
happen between them. See docs/concepts/optimal.md for the proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn, TypeGuard

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limits import TOOL_LIMITS, or_unlimited
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.geometry import Path
from armcontour.motion import JointPath, Method, PathLaw, Trajectory
from armcontour.timing._all_limits import Rules
from armcontour.timing._block import memory_of_blocks
from armcontour.timing._bracket import bound_u, bound_x, gain_left, judge, spread
from armcontour.timing._joint_limits import FOUND, TOO_MUCH, plan_in_one_go
from armcontour.timing._reach import (
    BELOW_CEILING,
    BINDING,
    PLAY,
    pack,
    reach,
    skew_along_discs,
    skew_along_rows,
)
from armcontour.timing.all_limits import COARSER, FEWEST_COARSE, AllLimits, fixed_on
from armcontour.timing.constraints import (
    AngularAcceleration,
    AngularSpeed,
    Bounds,
    CentripetalAcceleration,
    Constraint,
    JointAcceleration,
    JointDerivatives,
    JointTorque,
    JointVelocity,
    Rows,
    ToolAcceleration,
    ToolMetric,
    ToolSpeed,
    turning_of,
)
from armcontour.timing.constraints.sampled import MARGIN
from armcontour.timing.end_speeds import END, START, Ends, refuse_speed
from armcontour.timing.grid import (
    MOST_INTERVALS,
    Grid,
    coarsen,
    cut_pieces,
    finer_at_rests,
    grid_through,
    share_out,
    split,
)
from armcontour.timing.jerk.task import MOST_ITERATIONS, JerkLimits, Task
from armcontour.timing.vanishing import reparametrize, standing

# The grid is refined while the margin for maxima inside intervals exceeds this share of a limit, at
# most MOST_REFINEMENTS times; the share grows each time, up to LARGEST_MARGIN_EVER.
LARGEST_MARGIN = 1e-2
MORE_EACH_TIME = 2.0
LARGEST_MARGIN_EVER = 0.2
MOST_REFINEMENTS = 12
# A refinement that would make the grid this many times as large at once is not tried.
MOST_GROWTH = 200
MOST_PARTS = 100
# Margins are computed for ds² this much above that of the first pass, and checked afterwards.
HEADROOM = 1.05
# A start or end speed is refused because of margins only on a grid of more intervals than this.
FINE_ENOUGH = 20_000
# Attempts on one grid, with more headroom or with fewer skewed intervals.
MOST_TRIES = 30
# An interval gets no skew that would let ds² dip between its ends by more than about this share.
LARGEST_DIP = 0.25
# Where rows stand for a curve, the first pass is repeated with tangents at its last plan. Each
# repetition squares the error of ds²; an error of the share NEAR_TANGENT is within the first
# bracket.
MOST_TANGENTS = 6
NEAR_TANGENT = 1e-2
# The first brackets around a plan have the headroom above. Where a plan leaves its bracket, the
# bracket is widened by this ratio.
WIDER = 1.5
# A plan within its brackets is made again in brackets of the ratio CLOSE around it, which cost
# about 1e-6 of the duration, until a repetition gains less than LEAST_GAIN, or can gain no more, or
# plans have left the brackets MOST_MOVES times.
CLOSE = 1.02
LEAST_GAIN = 1e-6
MOST_MOVES = 4


def plan_optimal(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    *,
    intervals: int | None = None,
    grid: FloatArray | None = None,
    start_speed: float = 0.0,
    end_speed: float = 0.0,
    constraints: Sequence[Constraint] = (),
    iterations: int = MOST_ITERATIONS,
) -> Trajectory:
    """Plan the fastest motion along a path.

    Args:
        joint_path: A traced path, or a joint path without a tool path (then without tool limits).
        arm: The arm.
        limits: The limits. All are kept except those of range; the speed of each path segment is
            kept too.
        intervals: Approximate number of grid intervals; 4000 by default.
        grid: Grid points [m], in place of `intervals`; the breaks of the joint path are added. With
            limits of jerk it is the grid of the plan without them only.
        start_speed: Path speed ds at the start [m/s].
        end_speed: Path speed ds at the end [m/s].
        constraints: Further constraints.
        iterations: With limits of jerk: largest number of iterations. A plan that was stopped early
            is slower, and keeps all limits.

    Raises:
        NotRealizable: The limits do not allow the start or end speed, or no motion at some point.
        InvalidInput: Nothing limits the acceleration, or tool limits without a tool path.
    """
    for name, speed in (("start_speed", start_speed), ("end_speed", end_speed)):
        _checks.not_negative(name, speed, "m/s")
    if grid is None and not constraints and limits.path_jerk is None:
        # All three count in s.
        joint_path = reparametrize(joint_path)
    if grid is None:
        count = share_out(joint_path, intervals)
    else:
        placed = grid_through(joint_path, _checks.numbers("grid", grid, "m"))
    active = [*constraints_of(joint_path, arm, limits), *constraints]

    rests = standing(joint_path)
    most_steps = _checks.whole("iterations", iterations, 1, MOST_ITERATIONS)
    jerk = JerkLimits.of(limits, joint_path.dof)

    def solve(start: float, end: float) -> PathLaw:
        task = _Task(tuple(active), start, end, arm, rests)
        law = solve_from_rest(joint_path, count, task) if grid is None else None
        if law is None:
            law = _solve(cut_pieces(joint_path, count) if grid is None else placed, task)
        if jerk is None:
            return law
        # Most plans have no limits of jerk.
        from armcontour.timing.jerk.limiting import limit_jerk

        return limit_jerk(law, Task(arm, tuple(active), jerk, start, end, intervals, most_steps))

    try:
        law = solve(start_speed, end_speed)
    except NotRealizable as error:
        if error.limit not in (START, END):
            raise
        raise Ends(solve, start_speed, end_speed).refuse(error) from None
    return Trajectory(laws=(law,), method=Method.OPTIMAL, path=joint_path.tool_path)


def constraints_of(joint_path: JointPath, arm: Arm, limits: Limits) -> list[Constraint]:
    """Make the constraints of the planner from the limits of an arm and a path.

    Raises:
        InvalidInput: Tool limits without a tool path, limits of angular motion for a tool without
            orientation, or torque limits for an arm without masses.
    """
    active: list[Constraint] = []
    if limits.joint_velocity is not None:
        active.append(JointVelocity(or_unlimited(limits.joint_velocity, joint_path.dof)))
    if limits.joint_acceleration is not None:
        active.append(JointAcceleration(*limits.acceleration_bounds(joint_path.dof)))
    if limits.joint_torque is not None:
        active.append(JointTorque(arm, limits.joint_torque))
    tool = [x for x in TOOL_LIMITS if x != "path_jerk" and getattr(limits, x) is not None]
    if joint_path.tool_path is None:
        if tool:
            raise InvalidInput(
                "Limits of the tool need a tool path: plan a Path or a traced one, or lift them "
                f"with limits.replace({', '.join(f'{x}=None' for x in tool)})."
            )
        return active
    return active + _tool_constraints(joint_path, joint_path.tool_path, arm, limits)


def _tool_constraints(
    joint_path: JointPath, path: Path, arm: Arm, limits: Limits
) -> list[Constraint]:
    """Make the constraints from the tool limits and from the speeds of segments."""
    active: list[Constraint] = []
    own = path.speeds
    tool = (limits.speed, limits.tool_acceleration, limits.centripetal_acceleration)
    if not np.isnan(own).all() or any(x is not None for x in tool):
        metric = ToolMetric.of(joint_path, arm)
        speed = np.fmin(own, np.inf if limits.speed is None else limits.speed)
        if len(own) > 1:
            middle = (joint_path.breaks[:-1] + joint_path.breaks[1:]) / 2
            speed = speed[path.locate(middle)]
        else:
            speed = np.repeat(speed, len(joint_path.breaks) - 1)
        if np.isfinite(speed).any():
            active.append(ToolSpeed(speed, metric))
        if limits.tool_acceleration is not None:
            active.append(ToolAcceleration(limits.tool_acceleration, metric))
        if limits.centripetal_acceleration is not None:
            active.append(CentripetalAcceleration(limits.centripetal_acceleration, metric))
    if limits.angular_speed is None and limits.angular_acceleration is None:
        return active
    turning = turning_of(arm)
    if limits.angular_speed is not None:
        active.append(AngularSpeed(limits.angular_speed, turning))
    if limits.angular_acceleration is not None:
        active.append(AngularAcceleration(limits.angular_acceleration, turning))
    return active


@dataclass(frozen=True, slots=True)
class _Task:
    """The planning problem, independent of the grid.

    Args:
        active: The constraints.
        start_speed: ds at the start [m/s].
        end_speed: ds at the end [m/s].
        arm: The arm, for messages.
        standing: Arc lengths at which dq_ds of all joints vanishes [m].
    """

    active: tuple[Constraint, ...]
    start_speed: float
    end_speed: float
    arm: Arm
    standing: FloatArray

    @property
    def curved(self) -> bool:
        """Whether any rows stand for a curve."""
        return any(x.curved for x in self.active)

    @property
    def bracketed(self) -> bool:
        """Whether x must stay within brackets."""
        return any(x.bracketed for x in self.active)

    def rests(self, grid: Grid) -> FloatArray:
        """Arc lengths at which the tool is at rest [m]."""
        start = grid.s[: 1 if self.start_speed == 0 else 0]
        end = grid.s[len(grid) + (0 if self.end_speed == 0 else 1) :]
        return np.concatenate([start, grid.joint_path.stops, end])


NOWHERE = _checks.lock_floats([])


class Problem:
    """The arrays of the compiled planner, collected from all constraints.

    Args:
        grid: The grid.
        path: Derivatives of the joint path on the grid.
        active: The constraints.
        bounds: Bounds of x and u, from which margins between the points follow; None for no
            margins.
        about: Without bounds: x on each interval [m²/s²] near which rows that stand for a curve
            are linearized, (n,).
    """

    def __init__(
        self,
        grid: Grid,
        path: JointDerivatives,
        active: Sequence[Constraint],
        bounds: Bounds | None = None,
        about: FloatArray | None = None,
    ) -> None:
        n = len(grid)
        self.grid = grid
        self.c, self.radius, self.shifts = np.empty((2, 0)), np.empty(0), np.zeros(n)
        self.lost = np.zeros(n)  # largest share of any limit that margins take
        ceilings: list[FloatArray] = []
        self.rows: list[Rows] = []
        for constraint in active:
            ceiling = constraint.ceiling(grid, path, bounds)
            if about is None:
                found = constraint.rows(grid, path, bounds)
            else:
                found = constraint.rows_about(grid, path, about)
            disc = constraint.disc(grid, path, bounds)
            if ceiling is not None:
                ceilings.append(ceiling.x)
                if ceiling.lost is not None:
                    self.lost = np.maximum(self.lost, ceiling.lost)
            if found is not None:
                self.rows.append(found.compact(n, constraint.name))
            if disc is not None:
                if len(self.radius):
                    raise InvalidInput(
                        "Only one round constraint can be planned with at a time: lift the limit "
                        f"of tool acceleration, or leave out the constraint {constraint.name}."
                    )
                disc.refuse_shape(n, constraint.name)
                self.c, self.radius = np.ascontiguousarray(disc.c), disc.r
        self.ceiling = _lowest(ceilings, n)
        if bounds is not None:
            self.shifts = bounds.skew * grid.width**2
            # Where u falls, x lies above its chord by up to |skew| width² / 4.
            self.ceiling = self.ceiling - np.maximum(-self.shifts, 0.0) / 4
            if len(self.radius):
                half_turn = np.abs(bounds.skew) * grid.width / 2
                self.lost = np.maximum(self.lost, half_turn > self.radius)
        self.at_points = self._at_points()
        self.packed = self._pack()
        if bounds is not None:
            # Slopes along all rows are those of the first pass; here they would only take memory.
            self.rows = [x.last for x in self.rows]

    def _pack(self) -> FloatArray:
        """The rows as the compiled passes take them; `lost` takes the share of their margins."""
        count = sum(x.a.shape[2] for x in self.rows)
        packed, first = memory_of_blocks(len(self.grid), 2 * count), 0
        for x in self.rows:
            bounds = x.low, x.high, x.margin
            pack(self.grid.width, self.shifts, x.a, x.b, *bounds, first, packed, self.lost)
            first += x.a.shape[2]
        return packed

    def solve(
        self, start_speed: float, end_speed: float, standing: FloatArray = NOWHERE
    ) -> FloatArray:
        """Find the largest x at every grid point [m²/s²], (n + 1,).

        Args:
            start_speed: ds at the start [m/s].
            end_speed: ds at the end [m/s].
            standing: Arc lengths at which dq_ds of all joints vanishes [m].

        Raises:
            NotRealizable: The limits do not allow the start or end speed, or no motion at a point.
        """
        grid, ceiling = self.grid, self.at_points
        start, end = start_speed**2, end_speed**2
        for name, value, place in (("start", start, 0), ("end", end, -1)):
            if value > ceiling[place] * (1 + PLAY):
                refuse_speed(name, value, float(ceiling[place]), float(grid.s[place]))
        start, end = min(start, float(ceiling[0])), min(end, float(ceiling[-1]))
        # Where dq_ds vanishes, the joints rest at any ds.
        if start == 0 and grid.s[0] in standing:
            start = np.inf
        any_end = end == 0 and grid.s[-1] in standing
        if any_end:
            end = self._largest_at_end()
        x, most, stuck = reach(
            grid.width,
            self.packed,
            ceiling,
            self.c,
            self.radius,
            self.shifts,
            start,
            end,
        )
        if stuck == 0 and np.inf > start > most[0] * (1 + PLAY):
            refuse_speed("start", start, float(most[0]), float(grid.s[0]))
        if stuck >= 0:
            _refuse_stuck(grid, stuck)
        if not any_end and x[-1] < end * (1 - PLAY):
            refuse_speed("end", end, float(x[-1]), float(grid.s[-1]))
        return np.asarray(x)

    def skews(self, x: FloatArray) -> FloatArray:
        """Slopes of dds over s, (n,), with which a binding constraint binds all along an interval.

        Args:
            x: The plan: ds² at the grid points [m²/s²], (n + 1,).
        """
        bound = (x == 0) | (x > self.at_points * BELOW_CEILING)
        most = np.where(bound[:-1] | bound[1:], np.inf, BINDING)
        skew = np.zeros(len(self.grid))
        for y in self.rows:
            skew_along_rows(self.grid.width, y.a, y.b, y.low, y.high, x, most, skew)
        if len(self.radius):
            skew_along_discs(self.grid.width, self.c, self.radius, x, most, skew)
        return skew

    def _largest_at_end(self) -> float:
        """Largest x at the last point, at which dq_ds vanishes, so that u does not matter there.

        Zero if nothing bounds x; the plan then ends at ds = 0.
        """
        lowest = float(self.at_points[-1])
        for rows in self.rows:
            b, margin = rows.b[1, -1], rows.margin[-1]
            room = np.where(b > 0, rows.high[-1, -1] - margin, margin - rows.low[-1, -1])
            moving = b != 0
            lowest = min(lowest, float((room[moving] / np.abs(b[moving])).min(initial=np.inf)))
        return max(lowest, 0.0) if np.isfinite(lowest) else 0.0

    def _at_points(self) -> FloatArray:
        """Largest x at the grid points: the lower one of both sides, and 0 where the tool stops."""
        at = np.empty(len(self.grid) + 1)
        at[0], at[-1] = self.ceiling[0, 0], self.ceiling[1, -1]
        np.minimum(self.ceiling[1, :-1], self.ceiling[0, 1:], out=at[1:-1])
        stops = self.grid.joint_path.stops
        if len(stops):
            at[np.searchsorted(self.grid.s, stops)] = 0.0
        return at


def solve_from_rest(joint_path: JointPath, count: IntArray, task: _Task) -> PathLaw | None:
    """Plan from rest to rest with the library's own limits, as nearly all contours and rapids are.

    It gives what `_solve` gives, in less time.

    Args:
        joint_path: The joint path.
        count: Number of intervals of each piece, of `share_out`.
        task: The problem.

    Returns:
        The law; None where the general way is needed.
    """
    moving = task.start_speed > 0 or task.end_speed > 0
    if moving or len(task.standing) or not task.bracketed:
        return None
    limits = AllLimits.of(task.active, joint_path.dof)
    if limits is None:
        return None
    found = limits.plan_from_rest(joint_path, count, _rules(task, LARGEST_MARGIN))
    if found is None:
        return None
    try:
        return PathLaw.of_squares(joint_path, *found)
    except InvalidInput:
        return None


def _solve(grid: Grid, task: _Task) -> PathLaw:
    """Plan on a grid, which is refined where margins are too large.

    A first pass without margins and without skew finds how large x and u get, and the slope of u on
    every interval. The second pass keeps the limits between the points for all x and u up to those.

    Raises:
        InvalidInput: Nothing limits the acceleration.
        NotRealizable: The limits do not allow the start or end speed, or no motion at a point.
    """
    rests = task.rests(grid) if task.bracketed else NOWHERE
    if len(task.standing):
        rests = np.union1d(task.standing, rests)
    grid = finer_at_rests(grid, rests)
    for round_ in range(MOST_REFINEMENTS):
        most = min(LARGEST_MARGIN * MORE_EACH_TIME**round_, LARGEST_MARGIN_EVER)
        found, lost = _solve_on_grid(grid, task, most)
        if found is not None:
            return found
        s = float(grid.s[int(np.argmax(lost))])
        parts = np.clip(np.ceil(np.sqrt(lost / LARGEST_MARGIN)), 1.0, MOST_PARTS)
        if parts.sum() > min(MOST_GROWTH * len(grid), MOST_INTERVALS):
            break
        grid = split(grid, parts)
    raise NotRealizable(
        f"At {s:.6g} m along the path the limits cannot be kept between grid points, however fine "
        "the grid: the joint path is too uneven there; smooth it or trace it more exactly.",
        s=s,
    )


def _solve_on_grid(grid: Grid, task: _Task, most: float) -> tuple[PathLaw | None, FloatArray]:
    """Plan on a grid without refining it.

    Returns:
        The law, or None where margins take more than the share `most` of a limit; and the share
        that margins take on each interval, (n,).

    Raises:
        InvalidInput: Nothing limits the acceleration.
        NotRealizable: The limits do not allow the start or end speed, or no motion at a point.
    """
    plain = _PlainLimits.of(task)
    if plain is not None:
        x, skew, lost, outcome = plain.plan(grid, task, most)
        if outcome == FOUND:
            return _law(grid, x, skew), lost
        if outcome == TOO_MUCH:
            return None, lost
    elif not len(task.standing):
        limits = AllLimits.of(task.active, grid.joint_path.dof)
        if limits is not None:
            rules = _rules(task, most)
            x, skew, lost, outcome = limits.plan(grid.joint_path, grid, *_coarse(grid), rules)
            if outcome == FOUND:
                return _law(grid, x, skew), lost
            if outcome == TOO_MUCH:
                return None, lost
    n = len(grid)
    steady, dips, left = (np.zeros(n, dtype=np.bool_) for _ in range(3))  # steady: without skew
    bracket, path = _first_pass(grid, task), JointDerivatives.on(grid)
    for _ in range(MOST_TRIES):
        skew = np.where(steady, 0.0, bracket.slope)
        bounds = _bounds(grid, path, task, bracket, skew)
        problem = None  # The arrays of the last one are freed before this one has its own.
        problem = Problem(grid, path, task.active, bounds)
        lost = problem.lost
        if lost.max() > most:
            # Retry without skew where skew is the cause, or where finer grids did not help.
            skewed = (lost > most) & (skew != 0) & ((lost >= 1) | (most > LARGEST_MARGIN))
            if not skewed.any():
                return bracket.found, lost
            steady |= skewed
            continue
        try:
            x = problem.solve(task.start_speed, task.end_speed, task.standing)
        except NotRealizable:
            # The first pass succeeded, so the margins are the cause: a finer grid has smaller ones.
            if bracket.found is None and n > FINE_ENOUGH:
                raise
            return bracket.found, np.full(n, 4 * LARGEST_MARGIN)
        within = bounds.x, bounds.least, task.bracketed
        any_dips, any_left = judge(x, skew, grid.width, *within, LARGEST_DIP, dips, left)
        if any_dips:
            steady |= dips
        elif any_left:
            if bracket.found is not None and bracket.moves == MOST_MOVES:
                return bracket.found, lost
            bracket.widen(x, left if task.bracketed else np.ones_like(left))
        else:
            law = _law(grid, x, skew)
            if not task.bracketed or not bracket.gains(law) or bracket.fits(x, law, lost):
                return bracket.better(law), lost
            bracket.close_in(x, law)
    return bracket.found, np.maximum(lost, most)


def _rules(task: _Task, most: float) -> Rules:
    """The rules of a plan with margins up to the share `most` of a limit."""
    return Rules(
        start=float(task.start_speed**2),
        end=float(task.end_speed**2),
        most=most,
        fine_margin=LARGEST_MARGIN,
        no_way=4 * LARGEST_MARGIN,
        fine_enough=FINE_ENOUGH,
        safety=MARGIN,
        headroom=HEADROOM,
        close=CLOSE,
        wider=WIDER,
        least_gain=LEAST_GAIN,
        largest_dip=LARGEST_DIP,
        near_tangent=NEAR_TANGENT,
        tries=MOST_TRIES,
        tangents=MOST_TANGENTS,
        moves=MOST_MOVES,
    )


def _is_fixed(x: Constraint) -> TypeGuard[ToolSpeed | CentripetalAcceleration]:
    """Whether a constraint is a ceiling that depends on the place only; subclasses may not be."""
    return type(x) in (ToolSpeed, CentripetalAcceleration)


@dataclass(frozen=True, slots=True)
class _PlainLimits:
    """Limits for which one compiled call makes the plan: of joints, and fixed ceilings.

    Args:
        velocity: Largest joint velocities, infinite for none [rad/s], (dof,).
        low: Smallest joint accelerations [rad/s²], (dof,).
        high: Largest joint accelerations [rad/s²], (dof,).
        fixed: Constraints that are ceilings which depend on the place only.
    """

    velocity: FloatArray
    low: FloatArray
    high: FloatArray
    fixed: tuple[ToolSpeed | CentripetalAcceleration, ...]

    @classmethod
    def of(cls, task: _Task) -> _PlainLimits | None:
        """The limits of a task; None if it has others, or joints rest at its ends at any ds."""
        # Subclasses may keep other limits.
        accelerations = [x for x in task.active if type(x) is JointAcceleration]
        velocities = [x for x in task.active if type(x) is JointVelocity]
        fixed = [x for x in task.active if _is_fixed(x)]
        known = len(fixed) + len(velocities[:1]) + 1
        if not accelerations or known < len(task.active) or len(task.standing):
            return None
        low, high = accelerations[0].low, accelerations[0].high
        most = velocities[0].limit if velocities else np.full(len(low), np.inf)
        return cls(most, np.array(low), np.array(high), tuple(fixed))

    def plan(
        self, grid: Grid, task: _Task, most: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Plan on a grid as `plan_in_one_go`, with margins up to the share `most` of a limit."""
        coarse, of = _coarse(grid)
        path = grid.joint_path
        return plan_in_one_go(
            path.coefficients,
            path.breaks,
            coarse.s,
            coarse.piece,
            *fixed_on(self.fixed, coarse),
            of,
            grid.s,
            grid.piece,
            *fixed_on(self.fixed, grid),
            self.velocity,
            self.low,
            self.high,
            task.start_speed**2,
            task.end_speed**2,
            HEADROOM,
            most,
            LARGEST_MARGIN,
            LARGEST_DIP,
            WIDER,
            MOST_TRIES,
            memory_of_blocks(len(grid), 2 * path.dof),
        )


@dataclass(slots=True)
class _Bracket:
    """The range in which x is expected on every interval.

    Args:
        most: The larger x of both interval ends [m²/s²], (n,).
        least: The smaller x of both interval ends [m²/s²], (n,).
        slope: Required slope of u over s [1/s²], (n,).
        reach: Ratio by which the bracket extends beyond `most` and `least`, (n,).
        found: A law that keeps the limits and may not be the fastest yet.
        moves: How often plans have left the bracket since `found` was made.
    """

    most: FloatArray
    least: FloatArray
    slope: FloatArray
    reach: FloatArray
    found: PathLaw | None = None
    moves: int = 0

    def widen(self, x: FloatArray, where: BoolArray) -> None:
        """Widen the bracket on some intervals so that it contains the plan x and more around it."""
        self.most[where] = np.maximum(self.most, np.maximum(x[:-1], x[1:]))[where]
        self.least[where] = np.minimum(self.least, np.minimum(x[:-1], x[1:]))[where]
        self.reach[where] *= WIDER
        self.moves += 1

    def close_in(self, x: FloatArray, law: PathLaw) -> None:
        """Replace the bracket by a narrow one around the plan x, and keep its law."""
        self.most, self.least = np.maximum(x[:-1], x[1:]), np.minimum(x[:-1], x[1:])
        self.reach, self.found, self.moves = np.full(len(law.s) - 1, CLOSE), law, 0

    def gains(self, law: PathLaw) -> bool:
        """Whether a law is so much faster than the law found before that a repetition pays."""
        return self.found is None or bool(law.breaks[-1] < self.found.breaks[-1] * (1 - LEAST_GAIN))

    def fits(self, x: FloatArray, law: PathLaw, lost: FloatArray) -> bool:
        """Whether a bracket around the plan x would not gain more time than LEAST_GAIN.

        Args:
            x: The plan [m²/s²], (n + 1,).
            law: Its law.
            lost: The share of limits that margins take in this bracket, (n,).
        """
        around = self.most, self.least, self.reach
        # Kernels are compiled for arrays that may be written.
        return bool(gain_left(np.array(law.breaks), lost, x, *around, CLOSE) <= LEAST_GAIN)

    def better(self, law: PathLaw) -> PathLaw:
        """The faster one of a law and the law found before."""
        if self.found is None or law.breaks[-1] <= self.found.breaks[-1]:
            return law
        return self.found


def _bounds(
    grid: Grid, path: JointDerivatives, task: _Task, bracket: _Bracket, skew: FloatArray
) -> Bounds:
    """Bounds of x and u on every interval for a plan that stays within its bracket.

    Raises:
        InvalidInput: Nothing limits the acceleration.
    """
    largest, least = bound_x(bracket.most, bracket.least, bracket.reach, skew, grid.width)
    allowed = _largest_u(grid, path, task, largest)
    u = bound_u(allowed, largest, least, skew, grid.width, task.bracketed)
    return Bounds(largest, u, skew, least)


def _largest_u(grid: Grid, path: JointDerivatives, task: _Task, x: FloatArray) -> FloatArray:
    """Largest |dds| on every interval, given the largest x.

    Raises:
        InvalidInput: Nothing limits the acceleration.
    """
    found = [constraint.largest_u(grid, path, x) for constraint in task.active]
    bounds = [y for y in found if y is not None]
    if bounds:
        lowest = bounds[0] if len(bounds) == 1 else np.asarray(np.min(bounds, axis=0))
        if lowest.max() < np.inf:
            return lowest
        i = int(np.argmax(np.isinf(lowest)))
        if not path.first[:, i].any():
            raise InvalidInput(
                f"No joint moves from s = {grid.s[i]:.6g} to {grid.s[i + 1]:.6g}, where nothing "
                "bounds dds: leave this piece of the joint path out."
            )
    hint = task.arm.limits_hint
    raise InvalidInput(
        "Nothing limits the acceleration along the path: give joint_acceleration, "
        f"joint_torque or tool_acceleration{f'; {hint}' if hint else ''}."
    )


def _first_pass(grid: Grid, task: _Task) -> _Bracket:
    """Estimate x and the slope of u on every interval.

    The estimate is a plan without margins and without skew, on a coarser grid; the second pass
    checks the estimate on the grid itself.

    Raises:
        NotRealizable: The limits do not allow the start or end speed, or no motion at a point.
    """
    coarse, of = _coarse(grid)
    try:
        return _pass_on(grid, coarse, of, task)
    except NotRealizable:
        # A coarse grid may refuse what the grid itself allows.
        if len(coarse) == len(grid):
            raise
        return _pass_on(grid, grid, np.arange(len(grid)), task)


def _coarse(grid: Grid) -> tuple[Grid, IntArray]:
    """The grid of the first pass, and the interval of it that each interval lies in, (n,)."""
    return coarsen(grid, COARSER if len(grid) >= COARSER * FEWEST_COARSE else 1)


def _pass_on(grid: Grid, coarse: Grid, of: IntArray, task: _Task) -> _Bracket:
    """Run the first pass on a coarser grid."""
    path = JointDerivatives.on(coarse)
    plain = Problem(coarse, path, task.active)
    x = plain.solve(task.start_speed, task.end_speed, task.standing)
    for _ in range(MOST_TANGENTS if task.curved else 0):
        about = (x[:-1] + x[1:]) / 2
        del plain  # Its arrays are freed before the next one has its own.
        plain = Problem(coarse, path, task.active, about=about)
        x = plain.solve(task.start_speed, task.end_speed, task.standing)
        if (np.abs((x[:-1] + x[1:]) / 2 - about) <= NEAR_TANGENT * about).all():
            break
    return _Bracket(*spread(x, plain.skews(x), of), np.full(len(grid), HEADROOM))


def _lowest(ceilings: list[FloatArray], n: int) -> FloatArray:
    """The lowest of several upper bounds of x at the ends of n intervals, (2, n)."""
    if not ceilings:
        return np.full((2, n), np.inf)
    return ceilings[0] if len(ceilings) == 1 else np.min(ceilings, axis=0)


def _law(grid: Grid, x: FloatArray, skew: FloatArray) -> PathLaw:
    """Make the continuous time law: the path acceleration is linear in s on every interval.

    Args:
        grid: The grid.
        x: ds² at the grid points [m²/s²], (n + 1,).
        skew: Slope of dds over s on each interval [1/s²], (n,).

    Raises:
        NotRealizable: Two neighbouring points are at rest.
    """
    try:
        return PathLaw.of_squares(grid.joint_path, grid.s, x, skew)
    except InvalidInput as error:
        if error.index is None:
            raise
        _refuse_stuck(grid, error.index)


def _refuse_stuck(grid: Grid, i: int) -> NoReturn:
    """Refuse a path on which the limits allow no motion in the interval i."""
    s = float(grid.s[i])
    raise NotRealizable(
        f"At {s:.6g} m along the path the limits allow no motion at all: check the limits, or move "
        "the path away from the singularity.",
        s=s,
    )
