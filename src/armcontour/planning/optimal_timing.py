"""Optimal planner: the fastest timing that satisfies the limits, also between grid points.

The method is backward and forward reachability in (s, ds²), after TOPP-RA. On each interval the
path acceleration is linear in s. Its slope is chosen in advance so that the active constraint is
active on the whole interval. Every constraint is satisfied at both ends of an interval with a
margin that bounds its rise between them; for torques and some limits of the tool the bound is
sampled. At zero-inertia points, where dq_ds of a joint vanishes, a plan can be slower than the
optimum by the grid's error. docs/concepts/time_optimal.md has the proof, and how good the plan is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from functools import lru_cache
from typing import Annotated, NoReturn

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.core.fields import declared
from armcontour.core.quantities import NO_KEY, AtLeast, Quantity
from armcontour.core.render import number
from armcontour.core.text import show
from armcontour.motion import JointPath, Method, PathLaw, Trajectory
from armcontour.motion.laws import Rates
from armcontour.planning.constraints import FROM_LIMITS, Constraint, constraints_of, limits_on
from armcontour.planning.even_parameter import replace_uneven_parameter
from armcontour.planning.law_checks import raise_too_fast
from armcontour.planning.path_grid import (
    DEFAULT_INTERVALS,
    VANISHED,
    Grid,
    count_parts,
    place_grid,
    rests_at_ends,
    round_parts,
    split,
)
from armcontour.planning.timing_options import (
    LONGEST_MOTION,
    MAX_ITERATIONS,
    IntervalCount,
    PlanOptions,
    Task,
)
from armcontour.planning.topp.grid_plan import GridPlan, plan_on_grid
from armcontour.planning.topp.limit_forms import GridLimits
from armcontour.planning.topp.plan_rules import END, FINER, FOUND, START, STUCK, Rules
from armcontour.planning.topp.sampled_joint_path import SampledJointPath
from armcontour.program import Program
from armcontour.robot import Arm, Limits
from armcontour.robot.limits import or_unlimited

# Largest share of a limit that margins may take, on the first grid and after all refinements. The
# time that they cost is part of the estimated loss of time.
MAX_MARGIN = 0.2
# The same share on the first grid if the loss of time is not estimated. The grid is then finer
# where the joints turn fast, which also gives the search with limits of jerk better cells.
MARGIN_WITHOUT_ESTIMATE = 2e-2
# A grid that fails is refined where the margin for maxima inside intervals exceeds this share of a
# limit.
LARGEST_MARGIN = 3e-3
# After such a refinement, the share of a limit that margins may take is twice that. It grows by
# this factor with each further one, because a finer grid is expensive with thousands of corners.
MARGIN_GROWTH = 2.0
# Largest number of refinements of the grid.
MAX_REFINEMENTS = 20
# The default grid is also refined while the estimated loss of time exceeds this share of the
# duration. Shaping needs this accuracy, because it compares candidates by their durations. The
# median of the estimate is twice the loss, on 200 to 20,000 intervals.
LARGEST_LOSS = 3e-5
# The same share for a grid of a requested number of intervals, multiplied by this number. TOPP-RA
# loses more on as many intervals.
LARGEST_LOSS_OF_ONE_INTERVAL = 1.0
# Largest number of intervals of the plan from which the search with limits of jerk starts, unless
# this many for each piece of the joint path are more.
INTERVALS_BEFORE_JERK = 1000
INTERVALS_OF_PIECE_BEFORE_JERK = 4
# A refinement aims at this fraction of the largest loss, so that it is not repeated for a loss that
# is slightly too large: the loss of a refined grid is at most 1.4 times the one expected.
LOSS_TARGET = 0.7
# Largest number of intervals of a refined grid (about 1 GB), unless twice the number of the first
# grid is larger.
MAX_REFINED = 300_000
# The same number for refinement for margins with only velocities and accelerations of the joints,
# which take less memory.
MAX_REFINED_OF_JOINTS = 3_000_000
# With more than half of MAX_REFINED intervals, a refinement for loss must increase the number of
# intervals by at least this factor.
LEAST_GROWTH = 1.1
# Options that apply to a single path only, because a program rests between its paths.
SINGLE_PATH_OPTIONS = ("start_speed", "end_speed")
# Default total number of grid intervals of a program of many contours. Each contour has fewer
# intervals than a single path, because it is shorter.
MAX_TOTAL_INTERVALS = 40_000
# Smallest default number of grid intervals per contour of such a program.
FEWEST_INTERVALS = 500
MotionTime = Annotated[
    float, Quantity("s", "6.5 s", within=(checks.SMALLEST_NUMBER, LONGEST_MOTION))
]
PathSpeed = Annotated[float, Quantity("m/s", "0.15 m/s", "not negative")]


@declared(eq=False)
class Optimal(PlanOptions):
    """Options of the method "optimal", in addition to those of `PlanOptions`.

    The method computes the fastest timing that satisfies every limit.

    >>> slow = ac.plan(path, arm, limits, ac.Optimal(duration=2.0))
    >>> round(slow.duration, 6)
    2.0

    Args:
        duration: Required duration [s]. All contours are slowed down by one factor; rapids and
            dwells are not. By default the motion is the fastest.
        intervals: Approximate number of grid intervals of each contour; by default 4000, fewer for
            a program of many contours.
        iterations: Largest number of iterations with limits of jerk. A plan that was stopped early
            is slower, and satisfies all limits.
        start_speed: Path speed at the start of a single path [m/s]; 0 with limits of jerk.
        end_speed: Path speed at the end of a single path [m/s]; 0 with limits of jerk.
        from_limits: Kinds of constraints: subclasses of `Constraint` that serve fields of `Limits`.
            For each plan, the planner makes a constraint of each kind from the limits. Replace a
            kind to plan its limits with a formula of your own. A limit that no kind serves is
            refused; to plan without it, remove it from the limits.
        constraints: Constraints of your own, in addition to the limits: objects that are ready,
            such as `SecondOrder(...)`. `explain` needs them again, because a plan does not contain
            them.

    Raises:
        InvalidInput: A value of the wrong type or out of range, or a motion of a given duration
            that starts or ends at a speed.
    """

    method = Method.OPTIMAL
    automatic_leads = True
    duration: Annotated[MotionTime | None, NO_KEY] = None
    intervals: Annotated[IntervalCount | None, NO_KEY] = None
    iterations: Annotated[int, AtLeast(1, MAX_ITERATIONS), NO_KEY] = MAX_ITERATIONS
    start_speed: Annotated[PathSpeed, NO_KEY] = 0.0
    end_speed: Annotated[PathSpeed, NO_KEY] = 0.0
    from_limits: Annotated[tuple[type[Constraint], ...], NO_KEY] = field(
        default=FROM_LIMITS, repr=False
    )
    constraints: Annotated[tuple[Constraint, ...], NO_KEY] = ()

    def _check_together(self) -> None:
        """Check the kinds of constraints, and that a given duration has no speeds at the ends."""
        for kind in self.from_limits if self.from_limits is not FROM_LIMITS else ():
            if not (isinstance(kind, type) and issubclass(kind, Constraint) and kind.serves):
                raise InvalidInput(
                    "from_limits must contain subclasses of Constraint whose `serves` names fields "
                    f"of Limits, but it contains {show(kind)}. Pass a constraint that is "
                    "ready in constraints."
                )
        for name in ("start_speed", "end_speed"):
            if self.duration is not None and getattr(self, name):
                raise InvalidInput(
                    f"A motion with a given duration starts and ends at rest, but {name} is "
                    f"{number(getattr(self, name), 'm/s')}. Remove {name} or duration."
                )

    def time(self, joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
        """Plan the fastest motion along a contour."""
        return plan_optimal(joint_path, arm, limits, self)

    def check_jerk(self, limits: Limits) -> None:
        """Accept limits of jerk, because the method keeps them."""

    def without_duration(self) -> Optimal:
        """Return the options without the required duration."""
        return replace(self, duration=None)

    def for_program(self, program: Program) -> Optimal:
        """Return the options with fewer grid intervals if the program has many contours."""
        for name in SINGLE_PATH_OPTIONS if program.single_path is None else ():
            if getattr(self, name):
                raise InvalidInput(
                    f"{name} applies to a single path only, because a program rests between its "
                    f"moves. Remove {name}."
                )
        fewer = intervals_of(program)
        return self if self.intervals or fewer is None else replace(self, intervals=fewer)


def intervals_of(program: Program) -> int | None:
    """Return the grid intervals for each contour of a program; None for a path's default."""
    count = len(program.contours)
    if count <= MAX_TOTAL_INTERVALS // DEFAULT_INTERVALS:
        return None
    return max(FEWEST_INTERVALS, MAX_TOTAL_INTERVALS // count)


FASTEST = Optimal()


def plan_optimal(
    joint_path: JointPath, arm: Arm, limits: Limits, options: Optimal = FASTEST
) -> Trajectory:
    """Plan the fastest motion along a path, without a given duration.

    - `joint_path`: a traced path, or a joint path without a tool path (then without limits of the
      tool).
    - `limits`: joint ranges are ignored; the speed of each path segment also applies.
    - `options`: number of intervals, speeds at the ends, and constraints.
    """
    intervals = options.intervals
    loss = LARGEST_LOSS if intervals is None else LARGEST_LOSS_OF_ONE_INTERVAL / intervals
    if limits.limits_jerk:
        # This plan is only where the search with limits of jerk starts.
        pieces = len(joint_path.breaks) - 1
        fewest = max(INTERVALS_BEFORE_JERK, INTERVALS_OF_PIECE_BEFORE_JERK * pieces)
        intervals = min(fewest, intervals or fewest)
        loss = math.inf
    grid = place_grid(joint_path, intervals)
    # Speeds at the ends and constraints of the caller refer to the given parameter.
    if not (options.start_speed or options.end_speed or options.constraints):
        even = replace_uneven_parameter(grid)
        if even is not None:
            joint_path = even
            grid = place_grid(joint_path, intervals)
    made = constraints_of(joint_path, arm, limits, options.from_limits)
    active = [*made, *options.constraints]
    ends = options.start_speed, options.end_speed
    if any(ends) and limits.limits_jerk:
        raise InvalidInput(
            "start_speed and end_speed are not supported with limits of jerk, with which a motion "
            "starts and ends at rest. Remove them, or remove joint_jerk."
        )
    law = time_optimal(grid, active, arm, *ends, loss)
    if limits.limits_jerk:
        # Imported on demand, because most plans have no limits of jerk.
        from armcontour.planning.jerk.limiter import limit_jerk

        jerk = np.broadcast_to(or_unlimited(limits.joint_jerk, joint_path.dof), (joint_path.dof,))
        law = limit_jerk(law, Task(tuple(active), jerk, options.intervals, options.iterations))
    return Trajectory(laws=(law,), method=Method.OPTIMAL, path=joint_path.tool_path)


def time_optimal(
    grid: Grid,
    active: Sequence[Constraint],
    arm: Arm,
    start_speed: float,  # ds at the start [m/s]
    end_speed: float,  # ds at the end [m/s]
    largest_loss: float,  # Fraction of the duration that the grid may lose
) -> PathLaw:
    """Plan on a grid and refine it where margins or the estimated loss of time are too large."""
    # At an end at which dq_ds vanishes, the joints rest at any ds.
    rests = rests_at_ends(grid.joint_path.coefficients, VANISHED)
    start = math.inf if start_speed == 0 and rests[0] else start_speed**2
    end = math.inf if end_speed == 0 and rests[1] else end_speed**2
    estimates = largest_loss < math.inf
    max_margin = MAX_MARGIN if estimates else MARGIN_WITHOUT_ESTIMATE
    rules = Rules(start, end, max_margin, estimates_loss=estimates)
    s = 0.0
    best: tuple[Grid, GridPlan] | None = None
    shortest = math.inf
    first = len(grid)
    for k in range(MAX_REFINEMENTS):
        grid_plan, affordable = _plan_with(grid, active, rules)
        if grid_plan.outcome == FOUND and grid_plan.resting < 0:
            duration = grid_plan.duration
            gained = shortest - duration
            if duration < shortest:
                best = (grid, grid_plan)
                shortest = duration
            max_loss = largest_loss * duration
            if grid_plan.lost_time <= max_loss or gained < max_loss / 4:
                break
            most = max(MAX_REFINED, len(grid))
            parts = count_parts(grid_plan.loss, LOSS_TARGET * max_loss, most)
            if parts.sum() < LEAST_GROWTH * len(grid) and len(grid) > MAX_REFINED / 2:
                break
            grid = split(grid, parts, grid_plan.point)
            continue
        if grid_plan.outcome != FINER and best is not None:
            break
        if grid_plan.outcome == FOUND:
            _refuse_stuck(grid, grid_plan.resting)
        s = float(grid.s[grid_plan.interval])
        if grid_plan.outcome != FINER:
            _refuse(grid, grid_plan, arm, rules)
        most = max(affordable, 2 * first)
        parts = round_parts(np.sqrt(grid_plan.lost / LARGEST_MARGIN), most)
        if parts.sum() == len(grid) and max_margin == MAX_MARGIN:
            break
        grid = split(grid, parts)
        max_margin = min(MARGIN_GROWTH ** (k + 1) * LARGEST_MARGIN, MAX_MARGIN)
        rules = rules._replace(max_margin=max_margin, steady=0.0)
    if best is not None:
        return _make_law(*best)
    raise NotRealizable(
        f"{_place(grid.joint_path, s)} the limits are not satisfied between the points of a grid "
        f"of {len(grid)} intervals, because the joint path is too uneven there. Smooth it or trace "
        "it more accurately.",
        s=s,
    )


def _plan_with(grid: Grid, active: Sequence[Constraint], rules: Rules) -> tuple[GridPlan, int]:
    """Plan on a grid; also return how many intervals of a finer grid are affordable.

    The tables of the limits take most of the memory of a plan. They are released before the limits
    of a finer grid are computed.
    """
    path = SampledJointPath(grid)
    limits = _add_stops(limits_on(path, active), grid)
    return plan_on_grid(path.intervals, limits, rules), _affordable_intervals(limits)


def _place(joint_path: JointPath, s: float) -> str:
    """Describe the place of an arc length, or of a parameter if the path has no tool path."""
    if joint_path.tool_path is None:
        return f"At s = {s:.6g}"
    return f"At {s:.6g} m along the path"


def _affordable_intervals(limits: GridLimits) -> int:
    """Return the largest number of intervals of a grid with these limits that takes about 1 GB."""
    tables = limits.rows.rise, limits.squares.rise, limits.rounds.rise, limits.friction.within
    if any(x.shape[1] for x in tables):
        return MAX_REFINED
    return MAX_REFINED_OF_JOINTS


def _add_stops(limits: GridLimits, grid: Grid) -> GridLimits:
    """Add the bound x = 0 at the stops of the joint path."""
    stops = grid.joint_path.stops
    if not len(stops):
        return limits
    indices = np.searchsorted(grid.s, stops)
    ceiling = limits.ceiling.copy()
    ceiling[indices, 0] = ceiling[indices - 1, 1] = 0.0
    return limits._replace(ceiling=ceiling)


def _make_law(grid: Grid, plan: GridPlan) -> PathLaw:
    """Make the time law of a grid plan, with path acceleration linear in s on every interval."""
    rates = Rates(ds=plan.ds, dds=plan.dds, slope=plan.k, jerk=_zeros(len(plan.k)))
    return PathLaw.from_plan(grid.joint_path, plan.breaks, grid.s, rates)


def _zeros(count: int) -> FloatArray:
    """Return read-only zeros, which the laws of a long program share to save memory."""
    return _shared_zeros(1 << count.bit_length())[:count]


@lru_cache(maxsize=8)
def _shared_zeros(count: int) -> FloatArray:
    """Return a read-only array of zeros, the same for each call."""
    zeros = np.zeros(count)
    zeros.setflags(write=False)
    return zeros


def _refuse(grid: Grid, grid_plan: GridPlan, arm: Arm, rules: Rules) -> NoReturn:
    """Raise the error that explains why a plan on a grid was not found."""
    i = grid_plan.interval
    path = grid.joint_path.tool_path
    orientation = None if path is None else path.orientation
    free_rotation = orientation is not None and orientation.axis_only
    ends = {START: ("start", rules.start, grid.s[0]), END: ("end", rules.end, grid.s[-1])}
    if grid_plan.outcome in ends:
        name, x, s = ends[grid_plan.outcome]
        raise_too_fast(name, x, grid_plan.allowed, float(s), free_rotation=free_rotation)
    if grid_plan.outcome == STUCK:
        _refuse_stuck(grid, i)
    if not SampledJointPath(grid).derivatives[0][0, i].any():
        raise InvalidInput(
            f"No joint moves from s = {grid.s[i]:.6g} to {grid.s[i + 1]:.6g}, so no limit "
            "restricts dds there. Remove this piece of the joint path."
        )
    hint = arm.limits_hint
    raise InvalidInput(
        "Nothing limits the acceleration along the path. Specify joint_acceleration, "
        f"joint_torque or tool_acceleration{f'; {hint}' if hint else ''}."
    )


def _refuse_stuck(grid: Grid, i: int) -> NoReturn:
    """Raise NotRealizable for interval i of a grid, on which the limits allow no motion."""
    s = float(grid.s[i])
    raise NotRealizable(
        f"{_place(grid.joint_path, s)} the limits allow no motion. Raise the limits, or move the "
        "path away from singularities of the arm.",
        s=s,
    )
