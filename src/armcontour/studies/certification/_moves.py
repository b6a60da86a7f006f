"""Moves of a program in the search: their plans, and what is derated for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

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
from armcontour.simulation.robustness.monte_carlo import MonteCarloResult
from armcontour.studies.certification._case import Case
from armcontour.studies.certification._derating import Derating, plan_derated
from armcontour.studies.certification._proving import KEPT, largest_uses
from armcontour.studies.certification._uses import (
    OUTSIDE,
    LimitMargins,
    peak_demand,
    response_time,
    run,
    run_on_box,
)

# Trials aim a little below each limit, so that they arrive: at this share of accelerations, and of
# what bounds the speed, where nothing but rounding is between plan and limit; and of errors.
GOALS = {
    "acceleration": 1 - 3e-6,
    "speed": 1 - 2e-9,
    "tool": 1 - 2e-9,
    "error": 0.995,
    "box": 0.995,
}
# What is derated in one cell changes the motion in its neighbours, so that an excess may shrink by
# less than half in a trial: after so many trials it is met with its square, then its cube.
PATIENCE = 5
# A tool that is too fast at its place still has what it had this many time constants before.
LASTING = 8.0
# An error of a body is caused by the plan up to this many time constants of its position loops
# before.
LAGGING = 2.0
# Limits that are derated place by place; of others a share is left everywhere.
BY_PLACE = ("joint_acceleration", "joint_velocity", "speed", "centripetal_acceleration")
# Accelerations of a rapid rise to their limits in so many cycles; the faster rapid is
# taken.
RISES = (0.0, 0.5)
# Rapids aim at this share of each limit, because set-points next to the end of a rapid have a part
# of the contour after it; they are derated by a little more, so that they arrive.
RAPID_GOAL, CLOSE = 1 - 1e-3, 1e-5
MOST_RAPIDS = 12
# The error that is left of the move before a contour may take this share of the budget at its
# start.
ENTRY = 0.25


class Steps(NamedTuple):
    """Size of the steps by which a contour is derated from one trial to the next.

    Attributes:
        power: Power of the excess by which an error is derated.
        share: Smallest share of speed and acceleration that is left after one step.
        together: Whether what all cells need for acceleration is derated at once.
    """

    power: float
    share: float
    together: bool


@dataclass(slots=True, eq=False)
class Move:
    """A contour or a rapid in the search.

    Args:
        step: The traced move.
        number: Index of the contour; None for a rapid.
        derating: Derating of a contour by place.
        plan: Its plan; times from 0 [s].
        factors: Shares that are left of other limits along the whole move, by their names.
        rise: Rise time of a rapid's accelerations in cycles.
        pause: Standstill before the move [s].

    Attributes:
        fastest, nothing: The plan with nothing derated, and the derating of it.
        best: Derating, factors and plan of the fastest plan that is within all its uses.
        done: Whether the search of this contour has ended.
        proving: Whether its first plan was outside in the whole program.
        attempt: Index of the steps that are tried.
        tries: Trials with these steps.
        trials: All trials.
        share: Share of all accelerations that is tried where saturation is allowed.
        bracket: Largest share that was within, and smallest that was outside.
        aims: Shares of what is allowed at which attempts aim first, by causes.
        tightness: The same for the next trial.
        binds: What the last trial used most, and how much of it.
        reached: Smallest contour error of any trial, over the box if there is one [m].
        outside: Smallest contour error of a robot of the box that was outside [m].
        parts: Parts of the error of the worst robot of the box, by kinds of unknowns [m].
        corners: Executions in the corners of the box.
        spread: Executions on robots drawn from the box.
    """

    step: TracedMove
    number: int | None
    derating: Derating
    plan: Trajectory
    factors: dict[str, float] = field(default_factory=dict)
    rise: float = 0.0
    pause: float = 0.0
    fastest: Trajectory = field(init=False)
    nothing: Derating = field(init=False)
    best: tuple[Derating, dict[str, float], Trajectory] | None = None
    done: bool = False
    proving: bool = False
    attempt: int = 0
    tries: int = 0
    trials: int = 1
    share: float = 1.0
    bracket: tuple[float, float] = (0.0, 1.0)
    aims: dict[str, float] = field(default_factory=GOALS.copy)
    tightness: dict[str, float] = field(default_factory=GOALS.copy)
    binds: tuple[str, float] = ("", 0.0)
    reached: float = np.inf
    outside: float = np.inf
    parts: dict[str, float] = field(default_factory=dict)
    corners: MonteCarloResult | None = None
    spread: MonteCarloResult | None = None

    def __post_init__(self) -> None:
        self.fastest, self.nothing = self.plan, self.derating

    @property
    def joint_path(self) -> JointPath:
        """The joint path."""
        assert self.step.joint_path is not None
        return self.step.joint_path

    @property
    def squares(self) -> FloatArray:
        """Largest ds² of the fastest plan in the cells of the derating [m²/s²], (n,)."""
        return squares_of(self.fastest, self.derating.cells)


def moves_of(case: Case) -> list[Move]:
    """All moves of a program: contours with nothing derated, rapids that are within their limits.

    Raises:
        NotRealizable: A contour has no plan, or no rapid is within its limits when executed.
    """
    moves: list[Move] = []
    count, stood = 0, 0.0
    for step in case.traced.steps:
        if step.joint_path is None:
            move = None if step.move is None else case.program.moves[step.move]
            stood += move.duration if isinstance(move, Dwell) else 0.0
            continue
        with step.named():
            if case.traced.is_contour(step):
                derating = Derating.nothing(step.joint_path, intervals_of(case.program))
                plan = plan_contour(case, step.joint_path, derating, {})
                settling = _settling_time(case, moves) if moves and not case.bodies else 0.0
                pause = max(settling - stood, 0.0)
                moves.append(Move(step, count, derating, plan, pause=pause))
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
    """Plan a rapid within the shares that are left of its limits."""
    left = {name: getattr(case.limits, name) * share for name, share in factors.items()}
    if rise:
        low, high = case.limits.acceleration_bounds(case.arm.dof)
        left["joint_jerk"] = np.minimum(-low, high) / (rise * case.run.cycle)
    return time_rapid(joint_path, case.arm, case.limits.replace(**left), case.program.rapid_speed)


def _fastest_rapid(case: Case, step: TracedMove) -> Move:
    """The fastest rapid from rest that keeps all joint limits on every robot of the box.

    A joint that saturates in a rapid would be late at the start of the contour. So no rapid
    saturates a joint by itself, even if contours may.

    Raises:
        NotRealizable: No rapid was found that keeps its limits.
    """
    path = step.joint_path
    assert path is not None
    # Demands are measured without saturation, because a saturated plant hides the excess.
    ideal = replace(case, goal=replace(case.goal, saturation="refuse"))
    steep = case.limits.jerk_limits or case.limits.joint_acceleration is None
    candidates = []
    for rise in (0.0,) if steep else RISES:
        factors: dict[str, float] = {}
        for _ in range(MOST_RAPIDS):
            plan = plan_rapid(case, path, factors, rise)
            set_points = case.compute_set_points(plan)
            over = lower_rapid(case, factors, plan, set_points, _runs(ideal, set_points), None)
            if over is None:
                found = Move(step, None, Derating.nothing(path, 1), plan, factors, rise)
                candidates.append(found)
                break
            factors = over
    if not candidates:
        raise NotRealizable(
            f"No rapid keeps its limits when it is executed, after {MOST_RAPIDS} plans of it: its "
            f"set-points come every {case.run.cycle * 1e3:g} ms; take a shorter command "
            "interval, or linear interpolation.",
            limit="joint_acceleration",
        )
    return min(candidates, key=lambda x: x.plan.duration)


def lower_rapid(
    case: Case,
    factors: dict[str, float],
    plan: Trajectory,
    set_points: SetPoints,
    runs: Sequence[Execution],
    span: tuple[float, float] | None,
) -> dict[str, float] | None:
    """Smaller shares of the limits that a rapid exceeds; None if it keeps all of them.

    Args:
        case: The case.
        factors: Shares that are left so far.
        plan: The plan of the rapid.
        set_points: Set-points with those of the rapid.
        runs: Their executions, without saturation.
        span: Start and end time of the rapid among them [s]; None is all of them.
    """
    free, dof = case.limits.of_joints, case.arm.dof
    uses = largest_uses(plan, case.arm, free)
    # Steps at breaks, and the path's own speeds, are no limits of a rapid.
    uses = {name: x for name, x in uses.items() if getattr(free, name, None) is not None}
    if "joint_acceleration" in uses:
        demands = (float(peak_demand(case, x, span).max()) for x in runs)
        uses["joint_acceleration"] = max(uses["joint_acceleration"], *demands)
    if "joint_velocity" in uses:
        now = set_points.q[slice(*np.searchsorted(set_points.t, span))] if span else set_points.q
        rate = np.diff(now, axis=0) / set_points.cycle
        lower, upper = case.limits.joint_range(dof)
        outside = OUTSIDE if ((now < lower) | (now > upper)).any() else 0.0
        ratio = use_of("joint_velocity", case.limits, rate).ratio
        uses["joint_velocity"] = max(uses["joint_velocity"], float(ratio.max(initial=outside)))
    goal = RAPID_GOAL if span is None else 1.0 + KEPT
    over = {name: x for name, x in uses.items() if x > goal}
    if not over:
        return None
    less = {
        name: factors.get(name, 1.0) * min(RAPID_GOAL / x, 1 - CLOSE) * (1 - CLOSE)
        for name, x in over.items()
    }
    return factors | less


def _settling_time(case: Case, moves: Sequence[Move]) -> float:
    """Time after the last moves until the tool stays near their end point [s].

    With a box, its slowest corner counts.
    """
    last = len(moves) - 1
    while last > 0 and moves[last].number is None:
        last -= 1
    laws = tuple(law for x in moves[last:] for law in x.plan.laws)
    plan = Trajectory(laws=laws, method="approach")
    set_points = case.compute_set_points(plan)
    runs = _runs(case, set_points)
    goal = case.arm.tool_position(plan(plan.duration, side="left"))
    far = [x.t[np.linalg.norm(x.tool - goal, axis=1) > ENTRY * case.budget] for x in runs]
    return max([0.0, *(float(x[-1]) - plan.duration for x in far if len(x))])


def _runs(case: Case, set_points: SetPoints) -> list[Execution]:
    """Executions on the robot and on corners of the box."""
    return [run(case, set_points), *(x for _, runs in run_on_box(case, set_points) for x in runs)]


def exceeded(case: Case, x: Move) -> bool:
    """Whether a plan exceeds a limit at any time; then trials aim lower.

    The plan is checked between its samples, and bounded there.
    """
    shares = largest_uses(x.plan, case.arm, case.limits)
    over = {name: ratio * (1 + KEPT) for name, ratio in shares.items() if ratio > 1 + KEPT}
    for name, ratio in over.items():
        if name in BY_PLACE:
            kind = "acceleration" if name.startswith("joint_") else "speed"
            x.tightness[kind] /= ratio
        elif name in UNITS:
            x.factors = x.factors | {name: x.factors.get(name, 1.0) / ratio}
    return bool(over)


def tighten(case: Case, x: Move, uses: LimitMargins, steps: Steps) -> Derating:
    """The next derating of a contour: more, wherever a limit is exceeded or nearly so.

    Args:
        case: The case.
        x: The contour.
        uses: Uses of its last plan.
        steps: Size of the steps.
    """
    derating, tight = x.derating, x.tightness
    # With which power of their excess accelerations are derated.
    power = 1 + x.tries // PATIENCE
    memory = response_time(case)
    largest = _largest_in_cells(x, uses, case.run.cycle + memory)
    speed = squares_of(x.plan, derating.cells)

    def slower(use: FloatArray, left: FloatArray, cause: str) -> Derating:
        """Derating that leaves a share of ds² in the cells with a use above 1."""
        return derating.with_cap(np.where(use > 1, speed * left, np.inf), cause)

    over = uses.joints * np.maximum(1.0, uses.peak / uses.joints.max(axis=0))
    left = np.ones_like(derating.share)
    for j in range(left.shape[1]):
        use = largest(over[:, j], 0.0) / tight["acceleration"]
        if x.tries == 0 and steps.together and not case.saturated and (use > 1).any():
            # Most of it is what the cycle adds to any acceleration: it is derated
            # everywhere at once, so that it need not be found again as the plan moves.
            common = float(np.median(use[use > 1]))
            left[:, j] /= common
            use = use / common
        left[:, j] /= np.maximum(use, 1.0) ** power
    derating = derating.with_share(left, "acceleration")
    use = largest(uses.pace, 0.0) / tight["speed"]
    derating = slower(use, 1 / np.maximum(use, 1.0), "speed")
    # A servo that nothing makes up for still has what the plan did some time before.
    lags = isinstance(case.run.compensation, NoCompensation) or power > 1
    late = LASTING * memory / 2 if lags else 0.0
    use = largest(uses.tool, late) / tight["tool"]
    derating = slower(use, np.maximum(use, 1.0) ** -power, "tool")
    if not case.saturated:
        use = np.maximum(largest(uses.error, late), uses.rms) / tight["error"]
        slow = np.clip(np.maximum(use, 1.0) ** (-steps.power * power), steps.share, 1.0)
        derating = slower(use, slow**2, "error").with_share(slow[:, None], "error")
    if case.box is not None:
        # Bodies are late by the time constant of their position loops.
        late = LAGGING / float(case.servo.kp.min()) if case.bodies else 0.0
        use = largest(uses.box, late) / tight["box"]
        slow = 1 / np.maximum(use, 1.0)
        derating = slower(use, np.maximum(slow, steps.share) ** 2, "box")
        if case.bodies:
            derating = derating.with_share(slow[:, None], "box")
    return derating


def _largest_in_cells(
    x: Move, uses: LimitMargins, around: float
) -> Callable[[FloatArray, float], FloatArray]:
    """A function that finds the largest of some values in each cell of a contour.

    Args:
        x: The contour.
        uses: Times and places of its plan.
        around: Time before and after a cell in which values belong to it, too [s].

    Returns:
        A function of values, (n,), and of the time before a value from which on cells have to do
        with it, if that is longer [s].
    """
    from scipy.ndimage import maximum_filter1d

    t, step = uses.t, float(uses.t[1] - uses.t[0])
    count = max(1, int(np.ceil(around / step)))
    inside = (t >= 0) & (t <= x.plan.duration)
    edges = np.interp(x.derating.cells, uses.s[inside], t[inside])
    begin = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)[:-1]

    def largest(values: FloatArray, before: float) -> FloatArray:
        ahead = max(count, int(np.ceil(before / step)))
        size = count + 1 + ahead
        spread_out = maximum_filter1d(values, size, mode="nearest", origin=count - size // 2)
        return np.asarray(np.maximum.reduceat(spread_out, begin))

    return largest


def squares_of(plan: Trajectory, cells: FloatArray) -> FloatArray:
    """The largest ds² of a plan in every cell [m²/s²], (n,)."""
    squares = plan.speed_at(cells) ** 2
    return np.asarray(np.maximum(squares[:-1], squares[1:]))
