"""The search for the fastest plan that holds what a certificate asks for.

A trial is planned within what is left of the limits, compensated, executed and looked at;
where something is used beyond its limit, more is derated there, and the next trial is made. What
is derated stays derated, so a search ends. See docs/concepts/certificate.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.arms.limits import UNITS
from armcontour.certification._approach import Approach
from armcontour.certification._bodies import (
    LinearFigures,
    execute_bodies,
    figures,
    torque_ratio,
    uses_on_bodies,
)
from armcontour.certification._derating import Derating, plan_derated
from armcontour.certification._proving import KEPT, bound_uses
from armcontour.certification._uses import (
    SPEED_SLACK,
    Judged,
    Setting,
    Uses,
    run,
    uses_of,
)
from armcontour.compensation import NoCompensation
from armcontour.errors import NotRealizable
from armcontour.evaluation import Check, check
from armcontour.execution import execute
from armcontour.jobs.goal import Goal
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.robustness.monte_carlo import Spread

# A search takes at most this many trials.
MOST_TRIALS = 25
# What is derated in one cell changes the motion in its neighbours, so that an excess may shrink by
# less than half in a trial: after so many trials it is met with its square, then its cube.
PATIENCE = 5
# Trials aim a little below each limit, so that they arrive: at this share of accelerations, and of
# what bounds the speed, where nothing but rounding is between plan and limit.
ACCELERATION_GOAL = 1 - 3e-6
SPEED_GOAL = 1 - 2e-9
# Errors are aimed at this share of the budget.
ERROR_GOAL = 0.995
# Robots drawn from the box may be worse than its corners: a search is made again, and aims lower,
# so often at most. Each of them aims at least by a ratio of ERROR_GOAL lower.
MOST_DRAWS = 10


class Steps(NamedTuple):
    """How much a trial is derated after the last one.

    Args:
        power: Power of the excess by which an error is derated.
        share: What is left of speed and acceleration after one step, at least.
        together: Whether what all cells need for acceleration is derated at once.
    """

    power: float
    share: float
    together: bool


# Errors go at least with the third power of speed and acceleration. Which steps lead to the fastest
# plan is not known: each search takes all of these, and its best plan.
STEPS = (Steps(1 / 3, 0.7, True), Steps(1 / 3, 0.85, True), Steps(1 / 4, 0.85, False))
# A tool that is too fast for its place still has what it had this many time constants before.
LASTING = 8.0
# A body that is off has what its plan did this many time constants of its position loops before.
LAGGING = 2.0
# Where saturation is allowed an error has its cause anywhere before it, so accelerations are
# derated everywhere alike, to this share of what was left of them at a time; the share that does is
# then found to this ratio.
COARSE_SHARE = 0.85
SHARE_PRECISION = 1.005
# On rigid bodies so many corners of the box judge each plan that the linear model takes, and all
# corners the best one.
FIRST_CORNERS = 8
# Certified plans that take this share longer than the optimum are searched again.
GAIN = 1e-4
# After a drive saturated, torque limits are lowered by this ratio at least.
SPARE = 1.01
# Places per interval at which the plan is checked against its limits between all samples.
POINTS = 5
# Limits that a search derates place by place; of others it takes a share everywhere.
BY_PLACE = (
    "joint_acceleration",
    "joint_velocity",
    "speed",
    "centripetal_acceleration",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """One plan, executed.

    Args:
        derating: What was derated.
        factors: What was left of other limits.
        trajectory: The plan.
        taught: Its taught data, after that of what leads to it.
        uses: Of all limits over time.
    """

    derating: Derating
    factors: Mapping[str, float]
    trajectory: Trajectory
    taught: TaughtData
    uses: Uses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """A trial that holds everything, and what it was judged by.

    Args:
        trial: The trial.
        execution: On the robot, as often as errors are looked at; None once it is not needed.
        judged: What the tool does in it.
        check: Of the plan against all of its limits.
        spread: Robots drawn from the box, if there is one and the plan is the best.
        corners: The corners of the box, if there is one.
        linear: Figures of the linear model of rigid bodies, if the plan is the best.
    """

    trial: Trial
    execution: Execution | None
    judged: Judged
    check: Check
    spread: Spread | None = None
    corners: Spread | None = None
    linear: LinearFigures | None = None

    @property
    def worst(self) -> float:
        """Largest contour error of the nominal robot and of those of the box [m]."""
        judged = [x for x in (self.spread, self.corners) if x is not None]
        return max([self.judged.largest, *(float(x.max.max()) for x in judged)])


@dataclass(slots=True)
class Search:
    """Finds the fastest plan for one contour.

    Args:
        setting: What is fixed.
        joint_path: The path.
        approach: What the joints do before.
        goal: What is to be kept.
        progress: Called with a step before each trial.
        executor: What executes robots of a box as rigid bodies; None is processes of this machine.
        intervals: Of the path's grid; by default those of `plan`.
        margin: At which share of what trials else aim at they aim.

    Attributes:
        optimum: Duration of the plan with nothing derated [s]; set by the first trial.
        squares: Largest ds² of that plan in every cell of the derating [m²/s²], (n,).
        trials: How many were made.
        reached: Smallest contour error of any trial that was fast enough, over the box if there is
            one [m].
        outside: Smallest contour error of a robot of the box that was executed, and outside [m].
        binds: What the last trial used most, and how much of it.
        in_time: Whether the last trial was faster than the best so far, and than the slowest.
        best: The fastest plan so far that holds everything.
        box_goal: At which share of the budget trials aim over the box.
        torque_goal: Which share of torque limits trials use, for what the box adds.
        shares: Parts of the contour error of the worst robot of the box in the last trial, by kinds
            of unknowns [m]; None of servos.
        known_derating: What the box needs derated on rigid bodies, if it is known.
        steps: Those of STEPS that are taken.
        tightness: What trials aim at, as shares of what is allowed.
    """

    setting: Setting
    joint_path: JointPath
    approach: Approach
    goal: Goal
    progress: Progress
    executor: Executor | None = None
    intervals: int | None = None
    margin: float = 1.0
    optimum: float = np.nan
    squares: FloatArray = field(default_factory=lambda: np.zeros(0))
    trials: int = 0
    reached: float = np.inf
    outside: float = np.inf
    binds: tuple[str, float] = ("", 0.0)
    in_time: bool = True
    best: Kept | None = None
    box_goal: float = ERROR_GOAL
    torque_goal: float = 1.0
    shares: dict[str, float] | None = None
    known_derating: Derating | None = None
    steps: Steps = STEPS[0]
    tightness: dict[str, float] = field(default_factory=dict)

    def fastest(self) -> Kept | None:
        """The fastest plan that holds the goal; None if there is none.

        Corners of the box need not be the worst of it where robots saturate, so robots drawn from
        it judge the best plan. If one is outside, the search is made again and aims lower.
        """
        for _ in range(MOST_DRAWS):
            best = self._best_of_steps()
            if best is None or (self.setting.box is None and not self.setting.bodies):
                return best
            best = self._draw_bodies(best) if self.setting.bodies else self._draw(best)
            saturated = [
                x for x in (best.corners, best.spread) if x is not None and x.saturated.any()
            ]
            if self.setting.bodies and saturated:
                ratio = max(float(x.demand_ratio.max()) for x in saturated)
                left = self._spare_torque(best.trial.factors, ratio)
                if left is None:
                    return None
                self.torque_goal, self.best = left["joint_torque"], None
                continue
            if self.setting.bodies:
                # What was derated stays derated.
                self.known_derating = best.trial.derating
            if best.worst <= self.setting.budget:
                return best
            self.binds = ("box", best.worst / self.setting.budget)
            self.box_goal = self._closer_box(best.trial, best.worst, self.box_goal)
            self.best = None
        return None

    def _draw(self, best: Kept) -> Kept:
        """The best plan with robots drawn from the box."""
        self.progress(Step((f"{self.goal.samples} robots of the box",)))
        drawn = self.setting.execute_drawn(best.trial.taught, self.goal.samples, self.goal.seed)
        return replace(best, spread=drawn)

    def _draw_bodies(self, best: Kept) -> Kept:
        """The best plan with corners of the box and robots drawn from it, as rigid bodies."""
        goal, linear = self.goal, best.trial.uses.linear
        assert linear is not None
        best = replace(best, linear=figures(linear, goal.samples, goal.seed))
        if self.setting.box is None:
            return best
        best = replace(best, corners=self._execute_bodies(best.trial, linear.corners(goal.corners)))
        if best.worst > self.setting.budget:
            return best
        drawn = linear.across.unknowns.draw(goal.bodies, goal.seed)
        return replace(best, spread=self._execute_bodies(best.trial, drawn, goal.seed))

    def _execute_bodies(self, trial: Trial, errors: FloatArray, seed: int | None = None) -> Spread:
        """Execute a trial on robots of the box as rigid bodies."""
        linear = trial.uses.linear
        assert linear is not None
        return execute_bodies(
            self.setting,
            trial.taught,
            linear,
            errors,
            executor=self.executor,
            progress=self.progress,
            seed=seed,
        )

    def _best_of_steps(self) -> Kept | None:
        """The fastest plan that holds the goal on the corners of the box, of all steps."""
        if self.setting.saturated:
            self.best = self._evenly()
            return self.best
        for self.steps in STEPS:
            if self.best is None or self.best_time > self.optimum * (1 + GAIN):
                self.best = self._settle() or self.best
        return self.best

    @property
    def best_time(self) -> float:
        """Duration of the fastest plan so far [s]."""
        return np.inf if self.best is None else self.best.trial.trajectory.duration

    def _evenly(self) -> Kept | None:
        """The fastest plan that leaves one share of all accelerations."""
        low = high = 1.0
        found = self._settle(low)
        while found is None and self.binds[0] == "error" and self.in_time:
            low, high = low * COARSE_SHARE, low
            found = self._settle(low)
        while found is not None and high > low * SHARE_PRECISION:
            middle = float(np.sqrt(low * high))
            better = self._settle(middle)
            low, high = (low, middle) if better is None else (middle, high)
            found = better or found
        return found

    def _settle(self, share: float = 1.0) -> Kept | None:
        """The first trial that holds everything.

        Args:
            share: What is left of accelerations from the beginning.
        """
        nothing = self.known_derating or Derating.nothing(self.joint_path, self.intervals)
        derating = nothing if share == 1.0 else nothing.with_share(share, "error")
        factors: Mapping[str, float] = (
            {} if self.torque_goal == 1.0 else {"joint_torque": self.torque_goal}
        )
        goals = {"acceleration": ACCELERATION_GOAL, "speed": SPEED_GOAL, "error": ERROR_GOAL}
        goals["box"] = self.box_goal
        self.tightness = {name: x * self.margin for name, x in goals.items()}
        for number in range(MOST_TRIALS):
            try:
                trial = self._trial(derating, factors)
            except NotRealizable:
                if number == 0:
                    raise
                # What was derated leaves no plan.
                return None
            if np.isnan(self.optimum):
                self.optimum = trial.trajectory.duration
                self.squares = _squares(trial.trajectory, derating.cells)
            slowest = min(self.best_time, self.goal.slowest * self.optimum)
            self.in_time = trial.trajectory.duration < slowest
            if not self.in_time:
                return None
            worst = trial.uses.worst()
            self._remember(trial, worst)
            if self.setting.saturated and worst["error"] > 1.0:
                return None
            if max(worst.values()) <= 1.0:
                found = self._judge(trial)
                if not isinstance(found, Trial):
                    return found
                trial, factors = found, found.factors
            first = number == 0 and not self.setting.saturated and self.steps.together
            derating = self._tighten(trial, first=first, power=1 + number // PATIENCE)
        return None

    def _trial(self, derating: Derating, factors: Mapping[str, float]) -> Trial:
        self.trials += 1
        self.progress(Step((f"trial {self.trials}",)))
        setting = self.setting
        trajectory = plan_derated(
            self.joint_path, setting.arm, setting.limits, derating, factors, self.intervals
        )
        taught = self.approach.teach(trajectory, setting)
        return Trial(
            derating=derating,
            factors=factors,
            trajectory=trajectory,
            taught=taught,
            uses=uses_on_bodies(setting, taught)
            if setting.bodies
            else uses_of(setting, taught, run(setting, taught)),
        )

    def _judge(self, trial: Trial) -> Kept | Trial | None:
        """The trial as one that is kept, or with what judging adds to its uses and its factors.

        None is that it needs another share of all accelerations. A plan is checked between samples,
        and bounded there; it is executed at more times, or by MuJoCo where the search has a linear
        model; the corners of the box judge it independently of what the search took for the worst
        of them. What is exceeded at some time is derated there, as any other use is.
        """
        setting = self.setting
        found = check(trial.trajectory, setting.arm, setting.limits, points=POINTS)
        shares = bound_uses(trial.trajectory, setting.arm, setting.limits)
        for x in found.uses:
            shares[x.name] = max(shares.get(x.name, 0.0), x.ratio)
        over = {name: ratio for name, ratio in shares.items() if ratio > 1 + KEPT}
        if over:
            return replace(trial, factors=self._reduce_factors(trial.factors, over))
        executed = execute(trial.taught, setting.plant(), resolution=setting.resolution)
        if setting.bodies and executed.saturated_time.any():
            return self._with_spare_torque(trial, torque_ratio(setting, executed))
        judged = setting.judge(executed)
        rms = judged.error.rms / (setting.rms or np.inf)
        error = max(judged.largest / setting.budget, rms)
        tool = (judged.speed / (1 + SPEED_SLACK)) ** 2
        if error <= 1.0 and tool.max() <= 1.0:
            kept = Kept(trial=trial, execution=executed, judged=judged, check=found)
            return kept if setting.box is None else self._judge_corners(kept)
        self.binds = max(("error", error), ("tool", float(tool.max())), key=lambda x: x[1])
        if setting.saturated and error > 1.0:
            return None
        if rms > 1.0:
            self.tightness["error"] *= ERROR_GOAL / rms
        which, *_ = setting.judged(executed)
        over_time = judged.over_time / setting.budget
        uses = trial.uses.raised(executed.t[which], tool=tool * (1 + KEPT), error=over_time)
        return replace(trial, uses=uses)

    def _judge_corners(self, kept: Kept) -> Kept | Trial | None:
        """A trial that keeps its goals, executed on corners of the box; returns as `_judge`."""
        setting, trial = self.setting, kept.trial
        if trial.uses.linear is None:
            corners = setting.execute_corners(trial.taught)
        else:
            few = min(FIRST_CORNERS, self.goal.corners)
            corners = self._execute_bodies(trial, trial.uses.linear.corners(few))
        if setting.bodies and corners.saturated.any():
            return self._with_spare_torque(trial, float(corners.demand_ratio.max()))
        worst = float(corners.max.max())
        if worst <= setting.budget:
            return replace(kept, corners=corners)
        self.tightness["box"] = self._closer_box(trial, worst, self.tightness["box"])
        return trial

    def _closer_box(self, trial: Trial, worst: float, goal: float) -> float:
        """At which share of the budget the next trials aim over the box.

        Args:
            trial: A trial with a robot that is outside.
            worst: Largest contour error of that robot [m].
            goal: At which share that trial aimed.
        """
        self.outside = min(self.outside, worst)
        if self.setting.bodies:
            # A trial may be nearer to its limits than it aimed at.
            goal = min(goal, trial.uses.worst()["box"])
        return goal * ERROR_GOAL * self.setting.budget / worst

    def _with_spare_torque(self, trial: Trial, ratio: float) -> Trial | None:
        """A trial in which a drive saturated, with less left of torque limits; see below."""
        left = self._spare_torque(trial.factors, ratio)
        return None if left is None else replace(trial, factors=left)

    def _spare_torque(self, factors: Mapping[str, float], ratio: float) -> dict[str, float] | None:
        """What is to be left of torque limits after a drive saturated; None without such limits.

        Args:
            factors: Shares of limits of the last trial, by the limits' names.
            ratio: Largest torque over its limit.
        """
        self.binds = ("torque", max(ratio, 1.0))
        if self.setting.limits.joint_torque is None:
            return None
        left = factors.get("joint_torque", 1.0) / max(ratio, SPARE)
        return {**factors, "joint_torque": left}

    def _reduce_factors(
        self, factors: Mapping[str, float], over: Mapping[str, float]
    ) -> dict[str, float]:
        """Shares of limits for the next trial; limits derated by place get a closer goal instead.

        Args:
            factors: Shares of limits of the last trial, by the limits' names.
            over: Uses above 1 of the limits that the last trial exceeded.
        """
        found = dict(factors)
        for name, ratio in over.items():
            if name in BY_PLACE:
                kind = "acceleration" if name.startswith("joint_") else "speed"
                self.tightness[kind] /= ratio * (1 + KEPT)
            elif name in UNITS:
                found[name] = found.get(name, 1.0) / (ratio * (1 + KEPT))
        return found

    def _remember(self, trial: Trial, worst: dict[str, float]) -> None:
        kind = max(worst, key=lambda x: worst[x])
        if self.setting.saturated and worst["error"] > 1.0:
            kind = "error"
        self.binds = (kind, worst[kind])
        error = trial.uses.largest
        if trial.uses.box is not None:
            error = max(error, float(trial.uses.box.max()) * self.setting.budget)
        self.reached = min(self.reached, error)
        if trial.uses.linear is not None:
            self.shares = trial.uses.linear.shares()

    def _tighten(self, trial: Trial, *, first: bool, power: int) -> Derating:
        """What to derate next: more, wherever a limit is exceeded or nearly so.

        Args:
            trial: The last trial.
            first: Whether it was the first.
            power: With which power of their excess accelerations are derated; speeds, because of
                errors, with a power of it (`Steps`).
        """
        derating, uses, tight = trial.derating, trial.uses, self.tightness
        moment = _Moments(trial, trial.taught.period + self._memory())
        speed = _squares(trial.trajectory, derating.cells)

        def slower(use: FloatArray, left: FloatArray, cause: str) -> Derating:
            """Derating that leaves a share of ds² in the cells with a use above 1."""
            return derating.with_cap(np.where(use > 1, speed * left, np.inf), cause)

        over = uses.joints * np.maximum(1.0, uses.peak / uses.joints.max(axis=0))
        left = np.ones_like(derating.share)
        for j in range(left.shape[1]):
            use = moment.largest(over[:, j]) / tight["acceleration"]
            if first and (use > 1).any():
                # Most of it is what the command interval adds to any acceleration: it is derated
                # everywhere at once, so that it need not be found again as the plan moves.
                common = float(np.median(use[use > 1]))
                left[:, j] /= common
                use = use / common
            left[:, j] /= np.maximum(use, 1.0) ** power
        derating = derating.with_share(left, "acceleration")
        use = moment.largest(uses.pace) / tight["speed"]
        derating = slower(use, 1 / np.maximum(use, 1.0), "speed")
        # A servo that nothing makes up for still has what the plan did some time before.
        lags = isinstance(self.setting.run.compensation, NoCompensation) or power > 1
        late = LASTING * self._memory() / 2 if lags else 0.0
        use = moment.largest(uses.tool, before=late) / tight["speed"]
        derating = slower(use, np.maximum(use, 1.0) ** -power, "tool")
        if not self.setting.saturated:
            use = np.maximum(moment.largest(uses.error, before=late), uses.rms) / tight["error"]
            slow = np.clip(
                np.maximum(use, 1.0) ** (-self.steps.power * power), self.steps.share, 1.0
            )
            derating = slower(use, slow**2, "error").with_share(slow[:, None], "error")
        if uses.box is not None:
            # Bodies are late by the time constant of their position loops.
            late = LAGGING / float(self.setting.servo.kp.min()) if self.setting.bodies else 0.0
            use = moment.largest(uses.box, before=late) / tight["box"]
            slow = 1 / np.maximum(use, 1.0)
            derating = slower(use, np.maximum(slow, self.steps.share) ** 2, "box")
            if self.setting.bodies:
                derating = derating.with_share(slow[:, None], "box")
        return derating

    def _memory(self) -> float:
        """Time for which a command is felt in a joint's demand [s]."""
        servo = self.setting.servo
        return 2.0 / float((servo.kp if servo.kv is None else servo.kv).min())


class _Moments:
    """Time interval of the plan in each cell of its path, with a margin on both sides.

    Args:
        trial: The trial.
        around: That while [s].
    """

    def __init__(self, trial: Trial, around: float) -> None:
        uses = trial.uses
        t = uses.t
        self.step = float(t[1] - t[0])
        self.count = max(1, int(np.ceil(around / self.step)))
        inside = (t >= 0) & (t <= trial.trajectory.duration)
        edges = np.interp(trial.derating.cells, uses.s[inside], t[inside])
        first = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)
        self.begin, self.last = first[:-1], len(t)

    def largest(self, values: FloatArray, before: float = 0.0) -> FloatArray:
        """The largest of some values, one per time, in each cell.

        Args:
            values: The values, (n,).
            before: How long before a value cells have to do with it, if that is longer [s].
        """
        from scipy.ndimage import maximum_filter1d

        ahead = max(self.count, int(np.ceil(before / self.step)))
        size = self.count + 1 + ahead
        shift = self.count - size // 2
        spread_out = maximum_filter1d(values, size, mode="nearest", origin=shift)
        return np.asarray(np.maximum.reduceat(spread_out, self.begin))


def _squares(plan: Trajectory, cells: FloatArray) -> FloatArray:
    """The largest ds² of a plan in every cell."""
    at = plan.speed_at(cells) ** 2
    return np.asarray(np.maximum(at[:-1], at[1:]))
