"""`attempts`, plans of the whole program that are derated step by step, and their verdicts.

An attempt is executed on the nominal robot and on robots in corners of the box, which determine the
range of each joint at each time. Cells of moves in which the nominal robot, or a robot at the ends
of these ranges, exceeds a limit or the error budget are derated, and the next attempt is planned.
An attempt without excess is yielded. `verify_attempt` decides whether it is certified, so errors of
these estimates cost time, but they cannot make a certificate wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import NoReturn

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.core.progress import Step
from armcontour.core.render import number
from armcontour.core.text import digits, distinct
from armcontour.geometry import ShapedPath
from armcontour.motion import Execution, JointPath, PathLaw, SetPoints, Trajectory, largest_shares
from armcontour.planning.tracing import check_joint_range
from armcontour.program import Dwell
from armcontour.robot import Arm, Limits
from armcontour.simulation import simulate
from armcontour.studies.certification.box_errors import (
    BoxErrors,
    JointRanges,
    bound_box,
    independent_half_widths,
    same_corner_robots,
    servo_with,
    slow_motion_caps,
)
from armcontour.studies.certification.case import PROOF_RESOLUTION, Attempt, Case, Move
from armcontour.studies.certification.derating import largest_squares
from armcontour.verification import Check, check
from armcontour.verification.contour_errors import ContourExecution, split_by_contour

# A limit is exceeded by a ratio above 1 + LIMIT_TOLERANCE, to allow for rounding errors.
LIMIT_TOLERANCE = 1e-9
# Number of points per interval at which a plan is checked against its limits.
CHECK_POINTS = 5
# Share by which the executed tool speed may exceed the assigned velocity.
SPEED_SLACK = 1e-3
# Results per cycle in an execution of an attempt on the nominal robot, and on robots of the box.
RESULTS_PER_CYCLE = 16
BOX_RESULTS_PER_CYCLE = 4
# Shortest time between two results [s].
SHORTEST_RESULT_STEP = 1.25e-4
# Ratios to limits at which derating aims, so that the search ends.
GOALS = {"acceleration": 1 - 3e-6, "speed": 1 - 2e-9, "tool": 1 - 2e-9}
# Powers of a ratio by which ds² is reduced: ratios of "speed" and "tool" are ratios of ds². Errors
# of the box grow with the speed, other errors at least with its third power.
POWERS = {"speed": 1.0, "tool": 1.0, "error": 2 / 3, "box": 2.0}
# Smallest share to which ds² is reduced in one attempt.
LEAST_STEP = 0.49
# Derating in one cell changes the motion in its neighbours, so an excess may shrink by less than
# half per attempt. Therefore the excess is squared after this many attempts, cubed after twice as
# many, and so on.
POWER_TRIALS = 5
# At the same time, the excess is increased by this much, because limits of set-points spread a
# command over its neighbours, where a small excess would otherwise move from cell to cell.
EXTRA_DERATING = 1e-4
# Largest number of attempts for a move between two verdicts.
MAX_TRIALS = 25
# Largest number of verdicts in a search.
MAX_VERDICTS = 30
# After a verdict against an attempt, a goal is divided by its ratio and multiplied by this factor.
CORRECTION = 0.998
# If the servo lags, the plan affects the tool for this time [time constants].
TOOL_MEMORY = 8.0
# Ratio of ds² that is assigned to a command outside the joint range. A lower speed cannot correct
# such a command completely, but with this ratio each attempt reduces the speed in its cell.
OUTSIDE_RATIO = 1.1
# Largest share of the allowed time that a first plan for the robots of a box takes, so that the
# search can still slow it down.
FIRST_SHARE = 0.98
# Factor of ds² by which such a plan becomes faster if it takes too long.
FASTER = 1.05
# Times that differ by less than this fraction of the cycle are equal.
PHASE_TOLERANCE = 1e-9
# Largest fraction of the budget that the deviation from the previous move may use at the start of a
# contour.
ENTRY_SHARE = 0.25
# Number of significant digits of ratios in messages, which can be close to 1.
RATIO_DIGITS = 7
# Estimated ratios to limits and budget in the n cells of a move by cause, (n,) or (n, dof).
Uses = dict[str, FloatArray]
# Ratios at which the derating of a move aims, by cause. Verdicts reduce them.
Goals = dict[str, float]
# Parts of executions, one per contour.
Pieces = Sequence[Sequence[ContourExecution]]


class SearchEnded(NotRealizable):
    """Derating does not satisfy the goal; the message states what limits it, without a remedy."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttemptVerdict:
    """The verdict on an attempt, with its evidence."""

    case: Case
    attempt: Attempt
    executed: Execution  # Execution on the nominal robot
    pieces: Sequence[ContourExecution]  # Parts of this execution, one per contour
    check: Check  # Check of the plan against all limits
    robots: Sequence[BoxErrors]  # Errors on the robots of the box, one per contour; may be ()
    # ratios: largest ratios of the execution of each contour by cause of derating.
    ratios: Sequence[dict[str, float]]

    @property
    def kept(self) -> bool:
        """True if the plan and its executions satisfy all limits and the goal."""
        ratios = chain.from_iterable(each.values() for each in self.ratios)
        return all(x <= 1.0 for x in ratios)

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.attempt.trajectory.duration

    @property
    def largest_error(self) -> float:
        """Largest contour error on all executed robots [m]."""
        errors = [max(x.contour_error.max, x.coverage_error.max) for x in self.pieces]
        return max(errors + [x.largest for x in self.robots])


def verify_attempt(case: Case, attempt: Attempt) -> AttemptVerdict:
    """Execute an attempt, and compare it with all limits and with the goal."""
    executed = simulate(attempt.set_points, case.plant(), resolution=PROOF_RESOLUTION)
    pieces = split_by_contour(executed, case.program, None, None)
    checked = check(attempt.trajectory, case.arm, case.limits, points=CHECK_POINTS)
    # Values of the whole program count for each contour.
    limits = [case.command_ratios(attempt.set_points).max(), *(x.ratio for x in checked.uses)]
    for move in attempt.moves:
        bounds = bound_ratios(move.plan, case.arm, move.limits)
        # Assigned speeds of a path do not restrict a rapid.
        names = bounds if move.number is not None else ("joint_acceleration", "joint_velocity")
        limits += [bounds[name] for name in names]
    robots = bound_box(case, attempt.set_points)
    demands = [case.demand_ratio(executed.demand_range).max(), *(x.demand.max() for x in robots)]
    common_ratios = {
        "acceleration": float(max(demands)) / (1 + LIMIT_TOLERANCE),
        "speed": float(max(limits)) / (1 + LIMIT_TOLERANCE),
    }
    ratios = []
    for k, piece in enumerate(pieces):
        ratios.append({**common_ratios, **_contour_ratios(case, attempt, piece, k)})
    for contour_ratios, errors in zip(ratios, robots, strict=False):
        contour_ratios["box"] = errors.largest / case.budget
    return AttemptVerdict(
        case=case,
        attempt=attempt,
        executed=executed,
        pieces=pieces,
        check=checked,
        robots=robots,
        ratios=ratios,
    )


def _contour_ratios(
    case: Case, attempt: Attempt, piece: ContourExecution, number: int
) -> dict[str, float]:
    """Return the ratios of tool speed and contour error on a contour, by cause.

    - `number`: index of the contour in the program.
    """
    tool = float(piece.speed_ratios(case.limits.speed, between=True).max())
    if case.limits.speed is not None:
        executed = piece.executed
        during = slice(None)
        if case.program.single_path is None:
            during = slice(*np.searchsorted(executed.t, attempt.trajectory.contour_spans[number].t))
        velocity = case.arm.tool_velocity(executed.q[during], executed.dq[during])
        tool = max(tool, float(np.linalg.norm(velocity, axis=1).max()) / case.limits.speed)
    error = max(piece.contour_error.max, piece.coverage_error.max) / case.budget
    if case.goal.rms is not None:
        error = max(error, piece.contour_error.rms / case.goal.rms)
    # Ratios of "tool" are those of squared speeds.
    return {"tool": (tool / (1 + SPEED_SLACK)) ** 2, "error": error, "box": 0.0}


def bound_ratios(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Bound a plan's ratios to limits of acceleration and speed at all times, by limit."""
    joints = np.stack([*limits.acceleration_bounds(arm.dof), *limits.velocity_bounds(arm.dof)])
    # Acceleration down and up, velocity down and up, speed, and speed for centripetal acceleration.
    ratios = np.zeros(6)
    for law in plan.laws:
        assert isinstance(law, PathLaw)
        speeds = _highest_speeds(law.joint_path, limits)
        ratios = np.maximum(ratios, largest_shares(law, joints, speeds, 1 + LIMIT_TOLERANCE))
    acceleration, velocity = ratios[:4].reshape(2, 2).max(axis=1).tolist()
    speed, speed_on_curve = ratios[4:].tolist()
    return {
        "joint_acceleration": acceleration,
        "joint_velocity": velocity,
        "speed": speed,
        "centripetal_acceleration": speed_on_curve**2,
    }


def _highest_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Return speeds that limits of speed and centripetal acceleration allow [m/s], (pieces, 2).

    The second column is infinite for segments with varying curvature, which the check samples.
    """
    breaks = joint_path.breaks
    path = joint_path.tool_path
    bounds = np.full((len(breaks) - 1, 2), np.inf)
    if path is None:
        return bounds
    # Breaks of the tool path are breaks of the joint path.
    segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
    bounds[:, 0] = path.assigned_speeds(limits.speed)[segment]
    varies = path.segments.is_transition[segment] | (
        isinstance(path, ShapedPath) and path.curve is not None
    )
    if limits.centripetal_acceleration is not None:
        curvature = np.where(varies, 0.0, np.abs(path.curvatures[segment]))
        with np.errstate(divide="ignore"):
            bounds[:, 1] = np.sqrt(limits.centripetal_acceleration / curvature)
    return bounds


def search_verdict(case: Case) -> AttemptVerdict:
    """Find the fastest derated attempt that is certified; return its verdict.

    Raises SearchEnded if derating does not satisfy the goal.
    """
    if case.budget <= 0:
        raise NotRealizable(
            f"The errors across the path that the servo model does not explain must be less than "
            f"the allowed {case.servo_allowed * 1e3:.3g} mm, but can be up to "
            f"{case.model_error * 1e3:.3g} mm. Allow a larger error, or use a servo model with a "
            "smaller `model_error`.",
            limit="contour error",
            needed=case.model_error,
            allowed=case.servo_allowed,
        )
    search = attempts(case)
    attempt = next(search)
    while not (verdict := verify_attempt(case, attempt)).kept:
        attempt = search.send(verdict)
    return verdict


GOALS |= {"error": 0.995, "box": 0.995}


def attempts(case: Case) -> Generator[Attempt, AttemptVerdict, None]:
    """Yield attempts that are estimated to satisfy the goal, and receive their verdicts.

    Raises SearchEnded if no attempt satisfies the goal; the message names the move.
    """
    robots = _corner_robots(case)
    moves = fastest_moves(case)
    goals = [GOALS.copy() for _ in moves]
    for verdict_number in range(1, MAX_VERDICTS + 1):
        tries = Counter[int]()
        active = set(range(len(moves)))
        while active:
            trials = sum(x.trials for x in moves if x.number is not None)
            name = f"trial {trials} before check {verdict_number} of at most {MAX_VERDICTS}"
            case.progress(Step((name,)))
            attempt = Attempt.joined(case, moves)
            runs = execute(case, attempt.set_points, robots)
            excess = _find_excess(case, attempt, runs, goals, active)
            if not excess:
                # Derating of other moves may have changed moves that were within their limits.
                excess = _find_excess(case, attempt, runs, goals, active ^ set(range(len(moves))))
            for k, uses in excess.items():
                moves[k] = _derate(case, moves[k], uses, goals[k], tries[k])
            tries.update(list(excess))
            active = set(excess)
        verdict = yield attempt
        _correct(verdict, moves, goals)
    k = int(np.argmax([max(x.values()) for x in verdict.ratios]))
    _end_search(case, attempt.contours[k], verdict.ratios[k])


def _corner_robots(case: Case) -> FloatArray:
    """Return the errors of the robots in the box's corners, (m, 3, dof); none without a box."""
    if case.goal.box is None:
        return np.empty((0, 3, case.arm.dof))
    return same_corner_robots(independent_half_widths(case))


def execute(case: Case, set_points: SetPoints, robots: FloatArray) -> list[Execution]:
    """Execute set-points without saturation on the nominal robot, and on robots of the box."""
    cycle = set_points.cycle
    step = min(cycle, max(cycle / RESULTS_PER_CYCLE, SHORTEST_RESULT_STEP))
    runs = [simulate(set_points, case.plant(ideal=True), resolution=step)]
    step = max(cycle / BOX_RESULTS_PER_CYCLE, SHORTEST_RESULT_STEP)
    servos = [servo_with(case.servo, x) for x in robots]
    return runs + [simulate(set_points, case.plant(x, ideal=True), resolution=step) for x in servos]


def fastest_moves(case: Case) -> list[Move]:
    """Plan all moves without derating, with pauses in which the tool settles before contours."""
    robots = _corner_robots(case)
    moves: list[Move] = []
    count = 0  # Number of contours so far
    stood = 0.0  # Duration of the dwells since the previous move [s]
    settled_moves = 0  # Number of moves up to the previous contour
    for step in case.traced.steps:
        if step.joint_path is None:
            dwell = None if step.move is None else case.program.moves[step.move]
            stood += dwell.duration if isinstance(dwell, Dwell) else 0.0
            continue
        with step.named():
            check_joint_range(step.joint_path, case.limits, case.arm)
            number = count if case.traced.is_contour(step) else None
            move = Move.without_derating(case, step, number)
            if number is not None:
                move = _slowed_for_box(case, move)
                settling = _settling_time(case, moves[settled_moves:], robots) if moves else 0.0
                move = replace(move, pause=max(settling - stood, 0.0))
                count = count + 1
                settled_moves = len(moves)
            moves.append(move)
            stood = 0.0
    return moves


def _slowed_for_box(case: Case, move: Move) -> Move:
    """Slow a contour down, so that slow motion keeps the budget on all robots of the box.

    If this takes too long, the motion takes most of the allowed time.
    """
    if case.goal.box is None:
        return move
    caps = slow_motion_caps(case, move.joint_path, move.derating.cells)
    fastest = largest_squares(move.plan, move.derating.cells)
    longest = FIRST_SHARE * case.goal.slowest * move.fastest.duration
    while (caps < fastest).any():
        # No plan is faster than its caps, so most that take too long need not be planned.
        if _slow_duration(move, caps) <= longest:
            limited = np.where(caps < fastest, caps, np.inf)
            slower = move.derated(case.arm, move.derating.with_cap(limited, "box"))
            if slower.plan.duration <= longest:
                return slower
        caps = caps * FASTER
    return move


def _settling_time(case: Case, moves: Sequence[Move], robots: FloatArray) -> float:
    """Return how long the tool settles after moves, on the slowest robot [s]."""
    laws = chain.from_iterable(move.plan.laws for move in moves)
    plan = Trajectory(laws=tuple(laws), method="approach")
    runs = execute(case, case.compute_set_points(plan), robots)
    goal = case.arm.tool_position(plan(plan.duration, side="left"))
    settling = [0.0]
    for executed in runs:
        unsettled = np.linalg.norm(executed.tool - goal, axis=1) > ENTRY_SHARE * case.budget
        if unsettled.any():
            settling.append(float(executed.t[unsettled][-1]) - plan.duration)
    return max(settling)


def _find_excess(
    case: Case,
    attempt: Attempt,
    runs: Sequence[Execution],
    goals: Sequence[Goals],
    indices: set[int],
) -> dict[int, Uses]:
    """Return the uses of moves that are estimated to exceed a limit or the budget, by index.

    - `runs`: executions on the nominal robot, then on the robots of the box.
    - `goals`: goals of each move.
    - `indices`: indices of the moves to estimate.
    """
    pieces = [split_by_contour(runs[0], case.program, None, None)]
    if len(runs) > 1:
        ranges = JointRanges.over(runs[1:], _corner_robots(case))
        for _, motion in ranges.extreme_motions():
            pieces.append(split_by_contour(motion, case.program, None, None))
    uses = {k: _estimate_uses(case, attempt, runs, pieces, k) for k in sorted(indices)}
    excess = {}
    for k, ratios in uses.items():
        limits = {x: (1 + LIMIT_TOLERANCE) * goals[k][x] / GOALS[x] for x in GOALS}
        if any(ratio.max() > limits[cause] for cause, ratio in ratios.items()):
            excess[k] = ratios
    return excess


def _estimate_uses(
    case: Case, attempt: Attempt, runs: Sequence[Execution], pieces: Pieces, index: int
) -> Uses:
    """Estimate the ratios to limits and budget in the cells of a move, by cause.

    - `runs`: executions on the nominal robot, then on the robots of the box.
    - `pieces`: contours on the nominal robot, then of the extreme motions of the box.
    - `index`: index of the move.
    """
    move = attempt.moves[index]
    set_points = attempt.set_points
    spans = [x for x in attempt.trajectory.spans if x.kind != "dwell"]
    start, end = spans[index].t
    cycle = set_points.cycle
    # The move affects the cycle in which it ends, and the standstill after it.
    cycle_count = float(np.ceil((end - set_points.start_time) / cycle - PHASE_TOLERANCE))
    end = set_points.start_time + cycle_count * cycle
    end = max(end, spans[index + 1].t[0]) if index + 1 < len(spans) else np.inf
    window = (start if index else -np.inf), end
    edges = start + move.plan.time_at(move.derating.cells)
    memory = 2.0 / float((case.servo.kp if case.servo.kv is None else case.servo.kv).min())
    # Without compensation, the tool lags, so an error is due to an earlier part of the plan.
    lags = not case.run.compensation.compensates
    delay = TOOL_MEMORY * memory / 2 if lags else 0.0

    def in_cells(t: FloatArray, values: FloatArray, lag: float = 0.0) -> FloatArray:
        """Return each cell's largest value, also up to `lag` [s] later, which it may cause."""
        return _largest_in_cells(t, values, edges, window, cycle + memory, lag)

    def largest(piece: ContourExecution, values: FloatArray, lag: float = 0.0) -> FloatArray:
        """Return the largest values of a contour near each cell; `values` are at its samples."""
        all_values = np.zeros(len(piece.executed.t))
        all_values[piece.samples] = values
        return in_cells(piece.executed.t, all_values, lag)

    uses = {
        "acceleration": np.max([in_cells(x.t, _demands(case, x)) for x in runs], axis=0),
        "speed": in_cells(
            set_points.t, np.nan_to_num(case.command_ratios(set_points) ** 2, posinf=OUTSIDE_RATIO)
        ),
    }
    if move.number is not None:
        piece, *others = [x[move.number] for x in pieces]
        ratios = piece.speed_ratios(case.limits.speed, between=True)
        tool = largest(piece, ratios, delay)
        if case.limits.speed is not None:
            # On leads, only the speed limit applies.
            speed = runs[0].tool_speed / case.limits.speed
            tool = np.maximum(tool, in_cells(runs[0].t, speed, delay))
        uses["tool"] = (tool / (1 + SPEED_SLACK)) ** 2
        error = largest(piece, _contour_errors(piece), delay) / case.budget
        rms = 0.0 if case.goal.rms is None else piece.contour_error.rms / case.goal.rms
        uses["error"] = np.maximum(error, rms)
        uses["box"] = 0.0 * error
        if others:
            # All motions at the ends of the joint ranges have the same times.
            worst = np.max([_contour_errors(x) for x in others], axis=0)
            uses["box"] = largest(others[0], worst) / case.budget
    return uses


def _largest_in_cells(
    t: FloatArray,
    values: FloatArray,
    edges: FloatArray,
    window: tuple[float, float],
    around: float,
    before: float,
) -> FloatArray:
    """Return the largest values between the times of the cells' ends, (cells,) or (cells, dof).

    Only times in `window` count. Values up to `around` [s] before and after a cell count for it,
    and values up to `before` [s] after it.
    """
    from scipy.ndimage import maximum_filter1d

    low, high = np.searchsorted(t, window)
    low = min(int(low), len(t) - 1)
    t = t[low : max(high, low + 1)]
    values = values[low : max(high, low + 1)]
    step = float(edges[-1] - edges[0]) if len(t) < 2 else float(t[1] - t[0])
    count = max(1, int(np.ceil(around / step)))
    ahead = max(count, int(np.ceil(before / step)))
    size = count + 1 + ahead
    cell_starts = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)[:-1]
    spread = maximum_filter1d(values, size, axis=0, mode="nearest", origin=count - size // 2)
    return np.asarray(np.maximum.reduceat(spread, cell_starts, axis=0))


def _demands(case: Case, executed: Execution) -> FloatArray:
    """Return the ratios of commanded accelerations to their limits, (n, dof)."""
    ratios = case.demand_ratio(executed.demand)
    # The peak between results exceeds the largest result by this factor.
    peak = case.demand_ratio(executed.demand_range).max(axis=0)
    return np.asarray(ratios * np.maximum(peak / np.maximum(ratios.max(axis=0), 1e-12), 1.0))


def _contour_errors(piece: ContourExecution) -> FloatArray:
    """Return the contour error at each result, the larger of both directions [m], (n,)."""
    error = piece.contour_error
    over_time = np.maximum(piece.followed.distance, piece.followed.coverage_error)
    # A peak between two times is assigned to the nearer time.
    peak = int(np.argmin(np.abs(piece.t - error.t_max)))
    over_time[peak] = max(over_time[peak], error.max)
    return over_time


def _derate(case: Case, move: Move, uses: Uses, goals: Goals, tries: int) -> Move:
    """Plan a move that is derated where it exceeds its goals; refuse if it becomes too slow.

    - `uses`: ratios to limits and budget in the cells of the move, by cause.
    - `tries`: number of times that the move was derated since the last check.
    """
    power = 1 + tries // POWER_TRIALS
    extra = EXTRA_DERATING * (power - 1)
    ratios = dict[str, FloatArray]()
    for cause, use in uses.items():
        ratio = use / goals[cause]
        ratios[cause] = np.where(ratio > 1, ratio + extra, 1.0)
    acceleration_share = ratios.pop("acceleration") ** -power
    derating = move.derating.with_share(acceleration_share, "acceleration")
    speed = largest_squares(move.plan, derating.cells)
    for cause, ratio in ratios.items():
        slow = np.maximum(ratio ** (-POWERS[cause] * power), LEAST_STEP)
        derating = derating.with_cap(np.where(ratio > 1, speed * slow, np.inf), cause)
        if cause == "error":
            derating = derating.with_share(np.sqrt(slow)[:, None], cause)
    if tries < MAX_TRIALS:
        with suppress(NotRealizable):
            slower = move.derated(case.arm, derating)
            slowest = case.goal.slowest
            if move.number is None or slower.plan.duration < slowest * move.fastest.duration:
                return slower
    _end_search(case, move, {cause: float(use.max()) for cause, use in uses.items()}, goals)


def _correct(verdict: AttemptVerdict, moves: list[Move], goals: list[Goals]) -> None:
    """Lower goals and limits that a verdict rejects."""
    for k, move in enumerate(moves):
        # Ratios of acceleration and speed are those of the whole program.
        ratios = verdict.ratios[move.number or 0]
        for cause, ratio in ratios.items():
            if ratio > 1.0 and cause != "speed":
                goals[k][cause] *= CORRECTION / ratio
        if ratios["speed"] > 1.0:
            # This should not occur, because plans satisfy their limits. The whole move is slower.
            slower = ratios["speed"] * (1 + LIMIT_TOLERANCE)
            cap = largest_squares(move.plan, move.derating.cells) / slower**2
            moves[k] = move.derated(verdict.case.arm, move.derating.with_cap(cap, "speed"))


def _slow_duration(move: Move, caps: FloatArray) -> float:
    """Duration of a contour at the speeds of its fastest plan, within caps of ds² [s]."""
    fastest = largest_squares(move.fastest, move.derating.cells)
    moving = fastest > 0
    speeds = np.sqrt(np.minimum(caps, fastest)[moving])
    return float((move.derating.width[moving] / speeds).sum())


def _end_search(
    case: Case, move: Move, ratios: Mapping[str, float], goals: Goals | None = None
) -> NoReturn:
    """Raise SearchEnded with the limiting constraint of the last attempt.

    `goals`: the ratios that the search aimed at; by default 1. Verdicts reduce them.
    """
    aims = goals or dict.fromkeys(ratios, 1.0)
    cause = max(ratios, key=lambda x: ratios[x] / aims[x])
    ratio = ratios[cause]
    cycle = number(case.run.cycle, "s")
    held = ", which are held," if case.servo.interpolation == "step" else ""
    # Ratios of "tool" are those of squared speeds.
    tool = (1 + SPEED_SLACK) * ratio**0.5
    error = ratio * case.budget
    robot = " of the worst robot of the box" if cause == "box" else ""
    needed_error, allowed_error = distinct(error * 1e3, case.budget * 1e3)
    limit, needed, allowed, text = {
        "acceleration": (
            *("joint_acceleration", ratio, 1.0),
            f"set-points every {cycle}{held} require {digits(ratio, RATIO_DIGITS)} times the "
            "acceleration limit of a joint",
        ),
        "speed": (
            *("speed", ratio, 1.0),
            f"a limit of the plan, or of the velocity of set-points, is used "
            f"{digits(ratio, RATIO_DIGITS)} times, or a command is outside a joint range",
        ),
        "tool": (
            *("speed", tool, 1 + SPEED_SLACK),
            f"the executed tool moves at {tool:.5g} times the assigned velocity, but at most "
            f"{1 + SPEED_SLACK:g} times is allowed",
        ),
    }.get(
        cause,
        (
            *("contour error", error, case.budget),
            f"the largest contour error{robot} must be at most {allowed_error} mm, but is "
            f"{needed_error} mm in the slowest derated plan, which takes "
            f"{number(move.plan.duration, 's')}",
        ),
    )
    with move.step.named():
        raise SearchEnded(
            f"No plan within {case.goal.slowest:g} times the {move.fastest.duration:.3g} s of the "
            f"uncertified optimum is certified, because {text}.",
            limit=limit,
            needed=needed,
            allowed=allowed,
        )
