"""`attempts`, plans of the whole program that are derated step by step, and their verdicts.

An attempt is executed on the nominal robot and on some robots of the box. Cells of moves in which
these executions exceed a limit or the error budget are derated, and the next attempt is planned. An
attempt without excess is yielded. `verify_attempt` decides whether it is certified, so errors of
these estimates cost time, but they cannot make a certificate wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, product
from typing import NoReturn

import numpy as np

from armcontour.control.compensation import InverseDynamics, NoCompensation
from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.core.pool import map_in_threads
from armcontour.core.progress import Step
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.geometry import ShapedPath
from armcontour.motion import Execution, JointPath, PathLaw, SetPoints, Trajectory, largest_shares
from armcontour.planning.tracing import check_joint_range
from armcontour.program import Dwell
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.simulation import simulate
from armcontour.studies.certification.case import RESOLUTION, Attempt, Case, Move
from armcontour.studies.certification.derating import largest_squares
from armcontour.verification import Check, check
from armcontour.verification.contour_errors import ContourExecution, pieces_of

# A limit is exceeded by a ratio above 1 + LIMIT_TOLERANCE, to allow for rounding errors.
LIMIT_TOLERANCE = 1e-9
# Number of points per interval at which a plan is checked against its limits.
CHECK_POINTS = 5
# Share by which the executed tool speed may exceed the assigned velocity.
SPEED_SLACK = 1e-3
# Parameters of a servo that are uncertain.
PARAMETERS = ("kp", "kv", "dead time")
# Largest number of corners of the box that are executed.
MAX_CORNERS = 256
# Number of robots that are drawn from the box at random, in addition to its corners.
DRAWN = 100
# Seed of the random robots and corners of the box.
SEED = 0
# Time between two results of an execution [s]; peaks between them are evaluated.
RESULT_STEP = 2e-3
# Largest number of parameters of the worst robot in a summary.
MAX_NAMED = 4
# Results per cycle in an execution of an attempt on the nominal robot, and on robots of the box.
RESULTS_PER_CYCLE = 16
BOX_RESULTS_PER_CYCLE = 4
# Shortest time between two results [s].
SHORTEST_STEP = 1.25e-4
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
# Times that differ by less than this fraction of the cycle are equal.
PHASE_TOLERANCE = 1e-9
# Largest fraction of the budget that the deviation from the previous move may use at the start of a
# contour.
ENTRY_SHARE = 0.25
# Estimated ratios to limits and budget in the n cells of a move by cause, (n,) or (n, dof).
Uses = dict[str, FloatArray]
# Ratios at which the derating of a move aims, by cause. Verdicts reduce them.
Goals = dict[str, float]
# Parts of executions, one per contour.
Pieces = Sequence[Sequence[ContourExecution]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxErrors(Result):
    """Contour errors of one contour on the executed robots of a box.

    Args:
        max: Largest contour error of each robot, of both directions [m], (n,).
        names: Names of the uncertain parameters.
        deviations: Errors of these parameters (relative, or in s), (n, len(names)).
        robots: Errors of all parameters of the robots, (n, 3 dof), as for `servo_with`.
        demand: Largest ratio of a commanded acceleration to its limit on each robot, (n,).
    """

    max: FloatArray
    names: tuple[str, ...]
    deviations: FloatArray
    robots: FloatArray
    demand: FloatArray

    def to_data(self) -> Data:
        """Data of the largest error, and of the parameters of the worst robot."""
        errors = self.deviations[int(np.argmax(self.max))].tolist()
        worst = dict(zip(self.names, errors, strict=True))
        largest = sorted(worst, key=lambda x: -abs(worst[x]))[:MAX_NAMED]
        robot = ", ".join(f"{x} {worst[x]:+.3g}" for x in largest)
        return Data(
            f"{len(self.max)} robots of the box",
            (
                Row("executions", len(self.max)),
                Row("max", self.max.max(), "m", "contour error, largest", robot, VERDICT),
                Row("worst", worst),
            ),
        )

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """The verdict on an attempt, with its evidence."""

    case: Case
    attempt: Attempt
    executed: Execution  # Execution on the nominal robot
    pieces: Sequence[ContourExecution]  # Parts of this execution, one per contour
    check: Check  # Check of the plan against all limits
    robots: Sequence[BoxErrors]  # Contour errors on robots of the box, one per contour; may be ()
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
        return max(errors + [float(x.max.max()) for x in self.robots])


def verify_attempt(case: Case, attempt: Attempt) -> Verdict:
    """Execute an attempt, and compare it with all limits and with the goal."""
    executed = simulate(attempt.set_points, case.plant(), resolution=RESOLUTION)
    pieces = pieces_of(executed, case.program, None, None)
    checked = check(attempt.trajectory, case.arm, case.limits, points=CHECK_POINTS)
    # Values of the whole program count for each contour.
    limits = [case.command_ratios(attempt.set_points).max(), *(x.ratio for x in checked.uses)]
    for move in attempt.moves:
        bounds = bound_ratios(move.plan, case.arm, move.limits)
        # Assigned speeds of a path do not restrict a rapid.
        names = bounds if move.number is not None else ("joint_acceleration", "joint_velocity")
        limits += [bounds[name] for name in names]
    robots = execute_box(case, attempt.set_points)
    demands = [case.demand_ratio(executed.demand_range).max(), *(x.demand.max() for x in robots)]
    whole = {"acceleration": max(demands), "speed": max(limits)}
    whole = {cause: float(ratio) / (1 + LIMIT_TOLERANCE) for cause, ratio in whole.items()}
    ratios = [
        {**whole, **_contour_ratios(case, attempt, piece, k)} for k, piece in enumerate(pieces)
    ]
    for each, errors in zip(ratios, robots, strict=False):
        each["box"] = float(errors.max.max()) / case.budget
    return Verdict(
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
    """Ratios of tool speed and contour error in the execution of a contour, by cause."""
    tool = float(piece.speed_ratios(case.limits.speed, between=True).max())
    if case.limits.speed is not None:
        executed = piece.executed
        during = slice(None)
        if case.program.single_path is None:
            during = slice(*np.searchsorted(executed.t, attempt.trajectory.contour_spans[number].t))
        moved = case.arm.tool_velocity(executed.q[during], executed.dq[during])
        tool = max(tool, float(np.linalg.norm(moved, axis=1).max()) / case.limits.speed)
    error = max(piece.contour_error.max, piece.coverage_error.max) / case.budget
    if case.goal.rms is not None:
        error = max(error, piece.contour_error.rms / case.goal.rms)
    # Ratios of "tool" are those of squared speeds.
    return {"tool": (tool / (1 + SPEED_SLACK)) ** 2, "error": error, "box": 0.0}


def execute_box(case: Case, set_points: SetPoints) -> list[BoxErrors]:
    """Execute a program on robots of the box; returns the errors of each contour, [] without a box.

    If k parameters are uncertain, all 2^k corners of the box are executed, or if these are more
    than MAX_CORNERS, corners that a search finds. DRAWN more robots are drawn from the box, because
    the worst robot need not be in a corner.
    """
    if case.goal.box is None:
        return []
    case.progress(Step(("robots of the box",)))
    half_widths = case.goal.box.half_widths(case.servo, case.arm.dof)
    varies = half_widths > 0
    shared = case.goal.box.dead_time_shared
    if shared:
        varies[2, 1:] = False

    def deviations(unit: FloatArray) -> FloatArray:
        """Errors of all parameters of robots in units of the box, (n, 3 dof)."""
        rows = np.zeros((len(unit), *half_widths.shape))
        rows[:, varies] = unit
        if shared:
            rows[:, 2] = rows[:, 2, :1]
        return (rows * half_widths).reshape(len(unit), -1)

    def errors(unit: FloatArray) -> FloatArray:
        """Largest contour errors and demand of robots in units of the box, (n, contours + 1)."""
        robots = list(deviations(unit))
        return np.array(map_in_threads(partial(_execute_robot, case, set_points), robots))

    k = int(varies.sum())
    if 2**k <= MAX_CORNERS:
        corners = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, -1.0, 1.0)
        found = errors(corners)
    else:
        corners, found = _search_corners(errors, k)
    drawn = np.random.default_rng(SEED).uniform(-1, 1, size=(DRAWN, k))
    names = np.array([[f"{x} of joint {j + 1}" for j in range(case.arm.dof)] for x in PARAMETERS])
    if shared:
        names[2] = "dead time"
    robots = deviations(np.concatenate([corners, drawn]))
    *contours, demand = np.concatenate([found, errors(drawn)]).T
    kept = robots[:, varies.ravel()]
    named = tuple(names[varies].tolist())
    return [
        BoxErrors(max=x, names=named, deviations=kept, robots=robots, demand=demand)
        for x in contours
    ]


def joint_corners(case: Case) -> list[FloatArray]:
    """Errors of robots in the corners of the box in which all joints have the same ends.

    Because joints are independent, these robots have the largest demands of each joint.
    """
    if case.goal.box is None:
        return []
    half_widths = case.goal.box.half_widths(case.servo, case.arm.dof)
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    return list(np.unique((signs[:, :, None] * half_widths).reshape(len(signs), -1), axis=0))


def servo_with(servo: ServoModel, deviations: FloatArray) -> ServoModel:
    """The servo with errors of kp, kv (relative) and dead time [s], (3, dof) or (3 dof,)."""
    kp, kv, dead_time = deviations.reshape(3, -1)
    return servo.replace(
        kp=servo.kp * (1 + kp),
        kv=None if servo.kv is None else servo.kv * (1 + kv),
        dead_time=np.maximum(servo.dead_time + dead_time, 0.0),
    )


def _execute_robot(case: Case, set_points: SetPoints, deviations: FloatArray) -> list[float]:
    """Largest error of each contour on a robot, of both directions [m], and its demand."""
    plant = case.plant(servo_with(case.servo, deviations))
    resolution = min(RESULT_STEP, set_points.cycle)
    executed = simulate(set_points, plant, resolution=resolution)
    pieces = pieces_of(executed, case.program, None, None)
    demand = float(case.demand_ratio(executed.demand_range).max())
    return [*(max(x.contour_error.max, x.coverage_error.max) for x in pieces), demand]


def _search_corners(
    errors: Callable[[FloatArray], FloatArray], k: int
) -> tuple[FloatArray, FloatArray]:
    """Signs of the corners to execute if the box has more than MAX_CORNERS, and their errors.

    First the corner with the worse sign of each single parameter, then the corners of a search from
    there that changes one sign per step while the error increases, then random corners.

    `errors` maps signs, (n, k), to errors [m] and demand, (n, contours + 1).
    """
    single = errors(np.concatenate([np.eye(k), -np.eye(k)]))[:, :-1].max(axis=1)
    best = np.where(single[:k] >= single[k:], 1.0, -1.0)
    corners = np.stack([best, -best])
    found = errors(corners)
    worst = found[0, :-1].max()
    while len(corners) + k <= MAX_CORNERS:
        neighbours = np.where(np.eye(k, dtype=np.bool_), -best, best)
        tried = errors(neighbours)
        corners = np.concatenate([corners, neighbours])
        found = np.concatenate([found, tried])
        largest = tried[:, :-1].max(axis=1)
        i = int(np.argmax(largest))
        if largest[i] <= worst:
            break
        best = neighbours[i]
        worst = largest[i]
    random = np.random.default_rng(SEED).choice([-1.0, 1.0], size=(MAX_CORNERS - len(corners), k))
    return np.concatenate([corners, random]), np.concatenate([found, errors(random)])


def bound_ratios(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Upper bounds of a plan's ratios to limits of acceleration and speed, valid at all times."""
    joints = np.stack([*limits.acceleration_bounds(arm.dof), *limits.velocity_bounds(arm.dof)])
    shares = np.zeros(6)
    for law in plan.laws:
        assert isinstance(law, PathLaw)
        speeds = _highest_speeds(law.joint_path, limits)
        shares = np.maximum(shares, largest_shares(law, joints, speeds, 1 + LIMIT_TOLERANCE))
    acceleration, velocity = shares[:4].reshape(2, 2).max(axis=1).tolist()
    speed, bent = shares[4:].tolist()
    return {
        "joint_acceleration": acceleration,
        "joint_velocity": velocity,
        "speed": speed,
        "centripetal_acceleration": bent**2,
    }


def _highest_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Path speeds that the limits of speed and centripetal acceleration allow [m/s], (pieces, 2).

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
        bent = np.where(varies, 0.0, np.abs(path.curvatures[segment]))
        with np.errstate(divide="ignore"):
            bounds[:, 1] = np.sqrt(limits.centripetal_acceleration / bent)
    return bounds


GOALS |= {"error": 0.995, "box": 0.995}


def attempts(case: Case, robots: Sequence[FloatArray]) -> Generator[Attempt, Verdict, None]:
    """Yield attempts that are estimated to satisfy the goal, and receive their verdicts.

    `robots`: robots of the box to execute first, in addition to corners, as for `servo_with`.

    Raises NotRealizable if no plan satisfies the goal; the message names the move.
    """
    robots = [*joint_corners(case), *robots]
    moves = _fastest_moves(case, robots)
    goals = [GOALS.copy() for _ in moves]
    for number in range(1, MAX_VERDICTS + 1):
        tries = Counter[int]()
        active = set(range(len(moves)))
        while active:
            trials = sum(x.trials for x in moves if x.number is not None)
            name = f"trial {trials} before check {number} of at most {MAX_VERDICTS}"
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
        _correct(verdict, moves, goals, robots)
    k = int(np.argmax([max(x.values()) for x in verdict.ratios]))
    _refuse(case, attempt.contours[k], verdict.ratios[k])


def execute(case: Case, set_points: SetPoints, robots: Sequence[FloatArray]) -> list[Execution]:
    """Execute set-points without saturation on the nominal robot, and on robots of the box."""
    cycle = set_points.cycle
    step = min(cycle, max(cycle / RESULTS_PER_CYCLE, SHORTEST_STEP))
    runs = [simulate(set_points, case.plant(ideal=True), resolution=step)]
    step = max(cycle / BOX_RESULTS_PER_CYCLE, SHORTEST_STEP)
    servos = [servo_with(case.servo, x) for x in robots]
    return runs + [simulate(set_points, case.plant(x, ideal=True), resolution=step) for x in servos]


def _fastest_moves(case: Case, robots: Sequence[FloatArray]) -> list[Move]:
    """Moves without derating, and pauses in which the tool settles before contours."""
    moves: list[Move] = []
    count = 0
    stood = 0.0
    since = 0
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
                settling = _settling_time(case, moves[since:], robots) if moves else 0.0
                move = replace(move, pause=max(settling - stood, 0.0))
                count = count + 1
                since = len(moves)
            moves.append(move)
            stood = 0.0
    return moves


def _settling_time(case: Case, moves: Sequence[Move], robots: Sequence[FloatArray]) -> float:
    """Settling time of the tool after moves, on the slowest robot [s]."""
    laws = chain.from_iterable(move.plan.laws for move in moves)
    plan = Trajectory(laws=tuple(laws), method="approach")
    runs = execute(case, case.compute_set_points(plan), robots)
    goal = case.arm.tool_position(plan(plan.duration, side="left"))
    far = [x.t[np.linalg.norm(x.tool - goal, axis=1) > ENTRY_SHARE * case.budget] for x in runs]
    return max([0.0, *(float(x[-1]) - plan.duration for x in far if len(x))])


def _find_excess(
    case: Case,
    attempt: Attempt,
    runs: Sequence[Execution],
    goals: Sequence[Goals],
    indices: set[int],
) -> dict[int, Uses]:
    """Uses of the moves that are estimated to exceed a limit or the budget, by index."""
    pieces = [pieces_of(x, case.program, None, None) for x in runs]
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
    """Estimate the ratios to limits and budget in the cells of a move."""
    move = attempt.moves[index]
    set_points = attempt.set_points
    spans = [x for x in attempt.trajectory.spans if x.kind != "dwell"]
    start, end = spans[index].t
    cycle = set_points.cycle
    first = set_points.start_time
    # The move affects the cycle in which it ends, and the standstill after it.
    end = first + float(np.ceil((end - first) / cycle - PHASE_TOLERANCE)) * cycle
    end = max(end, spans[index + 1].t[0]) if index + 1 < len(spans) else np.inf
    window = (start if index else -np.inf), end
    edges = start + move.plan.time_at(move.derating.cells)
    memory = 2.0 / float((case.servo.kp if case.servo.kv is None else case.servo.kv).min())
    # Without compensation, the tool lags, so an error is due to an earlier part of the plan.
    lags = isinstance(case.run.compensation, NoCompensation)
    delay = TOOL_MEMORY * memory / 2 if lags else 0.0

    def in_cells(t: FloatArray, values: FloatArray, before: float = 0.0) -> FloatArray:
        """Largest values near each cell, and in the time `before` after it [s]."""
        return _largest_in_cells(t, values, edges, window, cycle + memory, before)

    def largest(piece: ContourExecution, values: FloatArray, before: float = 0.0) -> FloatArray:
        """Largest values of a contour near each cell."""
        whole = np.zeros(len(piece.executed.t))
        whole[piece.which] = values
        return in_cells(piece.executed.t, whole, before)

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
        errors = [largest(x, _contour_errors(x)) / case.budget for x in others]
        uses["box"] = np.max([0.0 * error, *errors], axis=0)
    return uses


def _largest_in_cells(
    t: FloatArray,
    values: FloatArray,
    edges: FloatArray,
    window: tuple[float, float],
    around: float,
    before: float,
) -> FloatArray:
    """Largest values between the times of the ends of cells, (cells,) or (cells, dof).

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
    begin = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)[:-1]
    spread = maximum_filter1d(values, size, axis=0, mode="nearest", origin=count - size // 2)
    return np.asarray(np.maximum.reduceat(spread, begin, axis=0))


def _demands(case: Case, executed: Execution) -> FloatArray:
    """Ratios of commanded accelerations to their limits, (n, dof)."""
    ratios = case.demand_ratio(executed.demand)
    # The peak between results exceeds the largest result by this factor.
    peak = case.demand_ratio(executed.demand_range).max(axis=0)
    return np.asarray(ratios * np.maximum(peak / np.maximum(ratios.max(axis=0), 1e-12), 1.0))


def _contour_errors(piece: ContourExecution) -> FloatArray:
    """Contour error at each result, the larger of both directions [m], (n,)."""
    error = piece.contour_error
    over_time = np.maximum(piece.followed.distance, piece.followed.coverage_error)
    # A peak between two times is assigned to the nearer time.
    peak = int(np.argmin(np.abs(piece.t - error.t_max)))
    over_time[peak] = max(over_time[peak], error.max)
    return over_time


def _derate(case: Case, move: Move, uses: Uses, goals: Goals, tries: int) -> Move:
    """Plan a move that is derated where it exceeds its goals; refuse if it becomes too slow."""
    power = 1 + tries // POWER_TRIALS
    ratios = {cause: np.maximum(use / goals[cause], 1.0) for cause, use in uses.items()}
    shares = ratios.pop("acceleration") ** -power
    derating = move.derating.with_share(shares, "acceleration")
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
    _refuse(case, move, {cause: float(use.max()) for cause, use in uses.items()})


def _correct(
    verdict: Verdict, moves: list[Move], goals: list[Goals], robots: list[FloatArray]
) -> None:
    """Add robots that a verdict rejects, and lower goals and limits that the verdict rejects."""
    worst = worst_robots(verdict.robots, verdict.case.budget)
    found = [x for x in worst if not any(np.array_equal(x, y) for y in robots)]
    robots += found
    kept = ("speed", "acceleration", "box") if found else ("speed",)
    for k, move in enumerate(moves):
        # Ratios of acceleration and speed are those of the whole program.
        ratios = verdict.ratios[move.number or 0]
        for cause, ratio in ratios.items():
            if ratio > 1.0 and cause not in kept:
                goals[k][cause] *= CORRECTION / ratio
        if ratios["speed"] > 1.0:
            # This should not occur, because plans satisfy their limits. The whole move is slower.
            slower = ratios["speed"] * (1 + LIMIT_TOLERANCE)
            cap = largest_squares(move.plan, move.derating.cells) / slower**2
            moves[k] = move.derated(verdict.case.arm, move.derating.with_cap(cap, "speed"))


def worst_robots(robots: Sequence[BoxErrors], budget: float) -> list[FloatArray]:
    """Errors of the robots with the largest contour error and demand, if these are too large."""
    errors = [x.robots[int(x.max.argmax())] for x in robots if x.max.max() > budget]
    demands = [x.robots[int(x.demand.argmax())] for x in robots[:1] if x.demand.max() > 1.0]
    return [*np.unique(errors, axis=0)] + demands


def _refuse(case: Case, move: Move, ratios: Mapping[str, float]) -> NoReturn:
    """Raise NotRealizable with the limiting constraint of the last attempt, and remedies."""
    cause = max(ratios, key=lambda x: ratios[x])
    ratio = ratios[cause]
    compensation = case.run.compensation
    cycle = case.run.cycle
    held = case.servo.interpolation == "step"
    finer = "linear interpolation" if held else "a shorter cycle"
    advice = f"Use {finer}"
    if cause == "box":
        advice = "Reduce the uncertainty of the robot (a smaller box), reduce the assigned velocity"
    elif isinstance(compensation, NoCompensation):
        advice = "Compensate the lag of the servo"
    elif isinstance(compensation, InverseDynamics) and cause == "acceleration":
        finer = "compensation inverse (inverse_dynamics is for rigid bodies)"
    # Ratios of "tool" are those of squared speeds.
    tool = (1 + SPEED_SLACK) * ratio**0.5
    error = ratio * case.budget
    over = " of the worst robot of the box" * (cause == "box")
    contour_error = (
        f"the largest contour error{over} must be at most {case.budget * 1e3:.3g} mm, but is at "
        f"least {error * 1e3:.3g} mm. {advice}, or allow a larger error"
    )
    limit, needed, allowed, text = {
        "acceleration": (
            *("joint_acceleration", ratio, 1.0),
            f"set-points every {cycle * 1e3:g} ms{', which are held,' * held} require {ratio:.3g} "
            f"times the acceleration limit of a joint. Use {finer}",
        ),
        "speed": (
            *("speed", ratio, 1.0),
            f"a limit of the plan, or of the velocity of set-points, is exceeded by "
            f"{ratio - 1:.2g} of its value, or a command is outside a joint range. Increase the "
            "limit, or move the path away from the ends of the joint ranges",
        ),
        "tool": (
            *("speed", tool, 1 + SPEED_SLACK),
            f"the executed tool moves at {tool:.5g} times the assigned velocity, but at most "
            f"{1 + SPEED_SLACK:g} times is allowed. {advice}, or reduce the assigned velocity in "
            "smaller steps",
        ),
    }.get(cause, ("contour error", error, case.budget, contour_error))
    with move.step.named():
        raise NotRealizable(
            f"No plan within {case.goal.slowest:g} times the {move.fastest.duration:.3g} s of the "
            f"uncertified optimum is certified, because {text}.",
            limit=limit,
            needed=needed,
            allowed=allowed,
        )
