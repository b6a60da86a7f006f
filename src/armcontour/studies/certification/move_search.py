"""Contours and rapids in the search of a certified plan: plans and derating."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from armcontour.control.compensation import NoCompensation
from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import Execution, JointPath, SetPoints, Trajectory
from armcontour.planning import intervals_of
from armcontour.planning.program_timing import time_rapid
from armcontour.planning.program_tracing import TracedMove
from armcontour.program import Dwell
from armcontour.robot.limit_use import use_of
from armcontour.robot.limits import UNITS
from armcontour.studies.certification.box import BoxErrors
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.derating import Derating, plan_derated
from armcontour.studies.certification.limit_margins import (
    LIMIT_TOLERANCE,
    OUTSIDE_RATIO,
    LimitMargins,
    execute_on_box,
    execute_trial,
    largest_ratios,
    peak_demand,
    response_time,
)

# Shares of limits at which trials aim, so that the search ends. For limits of acceleration and
# speed, the shares allow only for rounding errors.
GOALS = {
    "acceleration": 1 - 3e-6,
    "speed": 1 - 2e-9,
    "tool": 1 - 2e-9,
    "error": 0.995,
    "box": 0.995,
}
# Derating in one cell changes the motion in its neighbours, so an excess may shrink by less than
# half per trial. Therefore the excess is squared after this many trials, cubed after twice as many,
# and so on.
POWER_TRIALS = 5
# If the servo lags, the plan affects the tool for this time [time constants].
TOOL_MEMORY = 8.0
# Limits that are derated in single cells; other limits are derated along the whole move.
LOCAL_LIMITS = ("joint_acceleration", "joint_velocity", "speed", "centripetal_acceleration")
# Rise times of a rapid's accelerations that are tried [cycles]; the faster rapid is used.
RISES = (0.0, 0.5)
# RAPID_GOAL: share of each limit at which rapids aim, because set-points near the end of a rapid
# include a part of the next contour. RAPID_STEP: smallest reduction per plan, so that the search
# ends. MAX_RAPIDS: largest number of plans.
RAPID_GOAL, RAPID_STEP = 1 - 1e-3, 1e-5
MAX_RAPIDS = 12
# Largest share of the budget that the deviation from the previous move may use at the start of a
# contour.
ENTRY_SHARE = 0.25


# Errors grow at least with the third power of speed and acceleration. Therefore each trial
# multiplies them by (error / limit) ** -ERROR_POWER, but at least by LEAST_STEP.
ERROR_POWER, LEAST_STEP = 1 / 3, 0.7


@dataclass(slots=True, eq=False)
class MoveSearch:
    """State of the search for the plan of one contour or rapid."""

    step: TracedMove
    number: int | None  # Index of the contour; None for a rapid
    derating: Derating  # Derating of the present plan
    plan: Trajectory  # The present plan; its times start at 0 [s]
    # factors: usable shares of other limits along the whole move, by name.
    factors: dict[str, float] = field(default_factory=dict)
    rise: float = 0.0  # Rise time of a rapid's accelerations [cycles]
    pause: float = 0.0  # Standstill before the move [s]
    fastest: Trajectory = field(init=False)  # The first plan, without derating
    done: bool = False  # True if the plan of this contour is within all limits
    attempt_trials: int = 0  # Number of trials since the last proof
    trials: int = 1  # Number of all trials
    # aims, tightness: aimed shares of limits by cause, after the last proof and for the next trial.
    aims: dict[str, float] = field(default_factory=GOALS.copy)
    tightness: dict[str, float] = field(default_factory=GOALS.copy)
    # active_limit: limiting constraint of the last trial, and its ratio.
    active_limit: tuple[str, float] = ("", 0.0)
    # smallest_error: smallest contour error of a trial, for all robots of the box [m].
    smallest_error: float = np.inf
    # smallest_excess: smallest contour error of a robot of the box that exceeded the budget [m].
    smallest_excess: float = np.inf
    robots: BoxErrors | None = None  # Contour errors on robots of the box

    def __post_init__(self) -> None:
        self.fastest = self.plan

    @property
    def joint_path(self) -> JointPath:
        """The joint path of the move."""
        assert self.step.joint_path is not None
        return self.step.joint_path

    @property
    def squares(self) -> FloatArray:
        """Largest ds² of the fastest plan in the cells of the derating [m²/s²], (n,)."""
        return largest_squares(self.fastest, self.derating.cells)


def plan_moves(case: Case) -> list[MoveSearch]:
    """Moves of a program: contours without derating, and rapids whose execution is within limits.

    Raises NotRealizable if a move has no such plan.
    """
    moves: list[MoveSearch] = []
    count, stood = 0, 0.0
    for step in case.traced.steps:
        if step.joint_path is None:
            program_move = None if step.move is None else case.program.moves[step.move]
            stood += program_move.duration if isinstance(program_move, Dwell) else 0.0
            continue
        with step.named():
            if case.traced.is_contour(step):
                derating = Derating.nothing(step.joint_path, intervals_of(case.program))
                plan = plan_contour(case, step.joint_path, derating, {})
                settling = _settling_time(case, moves) if moves else 0.0
                pause = max(settling - stood, 0.0)
                moves.append(MoveSearch(step, count, derating, plan, pause=pause))
                count += 1
            else:
                moves.append(_fastest_rapid(case, step))
            stood = 0.0
    return moves


def plan_contour(
    case: Case, joint_path: JointPath, derating: Derating, factors: dict[str, float]
) -> Trajectory:
    """Plan a contour within derated limits."""
    return plan_derated(
        joint_path, case.arm, case.limits, derating, factors, intervals_of(case.program)
    )


def plan_rapid(
    case: Case, joint_path: JointPath, factors: dict[str, float], rise: float
) -> Trajectory:
    """Plan a rapid within the usable shares of its limits; `rise`: rise time [cycles]."""
    reduced = {name: getattr(case.limits, name) * share for name, share in factors.items()}
    if rise:
        low, high = case.limits.acceleration_bounds(case.arm.dof)
        reduced["joint_jerk"] = np.minimum(-low, high) / (rise * case.run.cycle)
    return time_rapid(
        joint_path, case.arm, case.limits.replace(**reduced), case.program.rapid_speed
    )


def _fastest_rapid(case: Case, step: TracedMove) -> MoveSearch:
    """Fastest rapid from rest that satisfies the joint limits on every robot of the box."""
    path = step.joint_path
    assert path is not None
    steep = case.limits.limits_jerk or case.limits.joint_acceleration is None
    candidates = []
    for rise in (0.0,) if steep else RISES:
        factors: dict[str, float] = {}
        for _ in range(MAX_RAPIDS):
            plan = plan_rapid(case, path, factors, rise)
            set_points = case.compute_set_points(plan)
            over = derate_rapid(case, factors, plan, set_points, _runs(case, set_points), None)
            if over is None:
                candidate = MoveSearch(step, None, Derating.nothing(path, 1), plan, factors, rise)
                candidates.append(candidate)
                break
            factors = over
    if not candidates:
        raise NotRealizable(
            f"The execution of a rapid must satisfy the joint limits, but none of {MAX_RAPIDS} "
            f"plans does with set-points every {case.run.cycle * 1e3:g} ms. Use a shorter cycle, "
            "or linear interpolation.",
            limit="joint_acceleration",
        )
    return min(candidates, key=lambda x: x.plan.duration)


def derate_rapid(
    case: Case,
    factors: dict[str, float],
    plan: Trajectory,
    set_points: SetPoints,
    runs: Sequence[Execution],
    span: tuple[float, float] | None,
) -> dict[str, float] | None:
    """Factors of limits with smaller values for the exceeded limits; None if none is exceeded.

    `runs`: executions of the set-points without saturation. `span`: start and end time of the rapid
    in the executions [s], by default the whole execution.
    """
    free, dof = case.limits.of_joints, case.arm.dof
    ratios = largest_ratios(plan, case.arm, free)
    # Velocity steps at breaks and assigned speeds of the path do not restrict a rapid.
    ratios = {name: x for name, x in ratios.items() if getattr(free, name, None) is not None}
    if "joint_acceleration" in ratios:
        demands = (float(peak_demand(case, x, span).max()) for x in runs)
        ratios["joint_acceleration"] = max(ratios["joint_acceleration"], *demands)
    if "joint_velocity" in ratios:
        positions = (
            set_points.q[slice(*np.searchsorted(set_points.t, span))] if span else set_points.q
        )
        rate = np.diff(positions, axis=0) / set_points.cycle
        lower, upper = case.limits.joint_range(dof)
        outside = OUTSIDE_RATIO if ((positions < lower) | (positions > upper)).any() else 0.0
        ratio = use_of("joint_velocity", case.limits, rate).ratio
        ratios["joint_velocity"] = max(ratios["joint_velocity"], float(ratio.max(initial=outside)))
    goal = RAPID_GOAL if span is None else 1.0 + LIMIT_TOLERANCE
    over = {name: x for name, x in ratios.items() if x > goal}
    if not over:
        return None
    reduced = {
        name: factors.get(name, 1.0) * min(RAPID_GOAL / x, 1 - RAPID_STEP) * (1 - RAPID_STEP)
        for name, x in over.items()
    }
    return factors | reduced


def _settling_time(case: Case, moves: Sequence[MoveSearch]) -> float:
    """Settling time of the tool after the moves since the last contour, in the worst corner [s]."""
    last = len(moves) - 1
    while last > 0 and moves[last].number is None:
        last -= 1
    laws = tuple(law for x in moves[last:] for law in x.plan.laws)
    plan = Trajectory(laws=laws, method="approach")
    set_points = case.compute_set_points(plan)
    runs = _runs(case, set_points)
    goal = case.arm.tool_position(plan(plan.duration, side="left"))
    far = [x.t[np.linalg.norm(x.tool - goal, axis=1) > ENTRY_SHARE * case.budget] for x in runs]
    return max([0.0, *(float(x[-1]) - plan.duration for x in far if len(x))])


def _runs(case: Case, set_points: SetPoints) -> list[Execution]:
    """Executions on the nominal robot and in corners of the box."""
    return [
        execute_trial(case, set_points),
        *(x for _, runs in execute_on_box(case, set_points) for x in runs),
    ]


def lower_aims(case: Case, move: MoveSearch) -> bool:
    """Aim lower if a plan exceeds a limit at any time; returns True in this case."""
    shares = largest_ratios(move.plan, case.arm, case.limits)
    over = {
        name: ratio * (1 + LIMIT_TOLERANCE)
        for name, ratio in shares.items()
        if ratio > 1 + LIMIT_TOLERANCE
    }
    for name, ratio in over.items():
        if name in LOCAL_LIMITS:
            kind = "acceleration" if name.startswith("joint_") else "speed"
            move.tightness[kind] /= ratio
        elif name in UNITS:
            move.factors = move.factors | {name: move.factors.get(name, 1.0) / ratio}
    return bool(over)


def derate_contour(case: Case, move: MoveSearch, margins: LimitMargins) -> Derating:
    """Derating of a contour, further reduced in the cells in which a limit is nearly exceeded."""
    derating, tight = move.derating, move.tightness
    power = 1 + move.attempt_trials // POWER_TRIALS
    memory = response_time(case)
    largest = _largest_in_cells(move, margins, case.run.cycle + memory)
    speed = largest_squares(move.plan, derating.cells)

    def slower(use: FloatArray, share: FloatArray, cause: str) -> Derating:
        """Derating with ds² reduced to a share in the cells with a use above 1."""
        return derating.with_cap(np.where(use > 1, speed * share, np.inf), cause)

    # A joint without a limit has margins of 0.
    sampled = np.maximum(margins.joints.max(axis=0), 1e-12)
    over = margins.joints * np.maximum(1.0, margins.peak / sampled)
    shares = np.ones_like(derating.share)
    for j in range(shares.shape[1]):
        use = largest(over[:, j], 0.0) / tight["acceleration"]
        if move.attempt_trials == 0 and (use > 1).any():
            # Most of the excess is due to the cycle and is equal in all cells. If all cells are
            # derated by it, it does not reappear in other cells when the plan changes.
            common = float(np.median(use[use > 1]))
            shares[:, j] /= common
            use = use / common
        shares[:, j] /= np.maximum(use, 1.0) ** power
    derating = derating.with_share(shares, "acceleration")
    use = largest(margins.pace, 0.0) / tight["speed"]
    derating = slower(use, 1 / np.maximum(use, 1.0), "speed")
    # Without compensation, the tool lags, so an error is due to an earlier part of the plan.
    lags = isinstance(case.run.compensation, NoCompensation) or power > 1
    delay = TOOL_MEMORY * memory / 2 if lags else 0.0
    use = largest(margins.tool, delay) / tight["tool"]
    derating = slower(use, np.maximum(use, 1.0) ** -power, "tool")
    use = np.maximum(largest(margins.error, delay), margins.rms) / tight["error"]
    slow = np.clip(np.maximum(use, 1.0) ** (-ERROR_POWER * power), LEAST_STEP, 1.0)
    derating = slower(use, slow**2, "error").with_share(slow[:, None], "error")
    if case.box is not None:
        use = largest(margins.box, 0.0) / tight["box"]
        slow = 1 / np.maximum(use, 1.0)
        derating = slower(use, np.maximum(slow, LEAST_STEP) ** 2, "box")
    return derating


def _largest_in_cells(
    move: MoveSearch, margins: LimitMargins, around: float
) -> Callable[[FloatArray, float], FloatArray]:
    """Function that returns the maximum of values over time, (n,), in each cell of a contour.

    Values up to `around` [s] before and after a cell count for the cell. The second argument of the
    function is the time after the cell if it is longer [s].
    """
    from scipy.ndimage import maximum_filter1d

    t, step = margins.t, float(margins.t[1] - margins.t[0])
    count = max(1, int(np.ceil(around / step)))
    inside = (t >= 0) & (t <= move.plan.duration)
    edges = np.interp(move.derating.cells, margins.s[inside], t[inside])
    begin = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)[:-1]

    def largest(values: FloatArray, before: float) -> FloatArray:
        ahead = max(count, int(np.ceil(before / step)))
        size = count + 1 + ahead
        spread_out = maximum_filter1d(values, size, mode="nearest", origin=count - size // 2)
        return np.asarray(np.maximum.reduceat(spread_out, begin))

    return largest


def largest_squares(plan: Trajectory, cells: FloatArray) -> FloatArray:
    """Largest ds² of a plan at the ends of each cell [m²/s²], (n,)."""
    squares = plan.speed_at(cells) ** 2
    return np.asarray(np.maximum(squares[:-1], squares[1:]))
