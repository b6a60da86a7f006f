"""Evaluation of a job at a place: duration, manipulability and margins, or the refusal."""

# A place is a candidate position of the part or the base: values of the axes of the search.

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from armcontour.core.errors import ArmContourError, NotRealizable
from armcontour.core.render import Result
from armcontour.core.result import TABLE, Data, Row
from armcontour.jobs.job import Job, Run
from armcontour.jobs.placement_options import (
    CLEARANCE,
    DURATION,
    MANIPULABILITY,
    TORQUE,
    corners_of,
)
from armcontour.jobs.plan_quantities import torques_at
from armcontour.jobs.reuse import Reuse
from armcontour.jobs.run_plan import plan_one, trace_one
from armcontour.motion import Trajectory
from armcontour.planning import Optimal, Tracing, with_reserve
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.program_tracing import BOUND_SHARE
from armcontour.planning.tracing.knots import task_dimension
from armcontour.program import Contour, Dwell
from armcontour.robot import Arm, SerialArm
from armcontour.robot.limit_use import use_of
from armcontour.robot.scene import PART, Scene
from armcontour.studies.placement.placed_job import Moves, place_arm, place_bases, place_job
from armcontour.studies.placement.screen import (
    RANGE,
    REACH,
    SINGULAR_ARM,
    PlaceBounds,
    Screen,
    least_singular_value,
)
from armcontour.verification.clearance import Clearance
from armcontour.verification.evaluation import duration_row

# Further kinds of refusals, which a screen does not find.
LIMITS, OTHER = "limits", "other"
# Field of `Verdict` that each objective compares, and its unit.
COMPARED = {
    DURATION: ("duration", "s"),
    MANIPULABILITY: ("singular", "m/rad"),
    CLEARANCE: ("clearance", "m"),
    TORQUE: ("torque_margin", "1"),
}
KINDS = (REACH, RANGE, SINGULAR_ARM, CLEARANCE, LIMITS, OTHER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict(Result):
    """Feasibility and figures of merit of a candidate position; unknown values are NaN.

    With an uncertainty, the figures are the worst of the position and the corners around it.

    Args:
        bound: Lower bound of the duration [s].
        duration: Duration of the plan [s].
        singular: Smallest singular value of the Jacobian along the path, see
            `docs/guides/placement.md`; without a plan, in the configuration with the smallest
            bound.
        clearance: Smallest distance of the arm from obstacles, or from itself if there are no
            obstacles [m].
        torque_margin: Smallest unused share of the torque limits.
        refusal: Kind of the refusal, one of `KINDS`; empty for a feasible place.
        reason: Message of the refusal; empty if a bound refuses the place without a plan.
        beyond: Smallest distance of the tool from an unreachable path [m].
        below_base: A sentence about links below the base; empty if there are none.
    """

    bound: float = 0.0
    duration: float = np.nan
    singular: float = np.nan
    clearance: float = np.nan
    torque_margin: float = np.nan
    refusal: str = ""
    reason: str = ""
    beyond: float = np.nan
    below_base: str = ""

    @property
    def planned(self) -> bool:
        """True if the place has a plan."""
        return not np.isnan(self.duration)

    def score(self, objective: str) -> float:
        """Value that the search minimizes for an objective; infinite without a plan."""
        if not self.planned:
            return np.inf
        value = getattr(self, COMPARED[objective][0])
        return float(value if objective == DURATION else -value)

    def to_data(self) -> Data:
        """Data of the known figures of merit."""
        rows = (
            Row("bound", self.bound, "s"),
            duration_row(self.duration, TABLE),
            Row("singular", self.singular, "m/rad", "least singular value"),
            Row("clearance", self.clearance, "m", "clearance"),
            Row("torque_margin", self.torque_margin, "1", "torque margin"),
            Row("refusal", self.refusal, "", "refused by"),
            Row("reason", self.reason),
            Row("beyond", self.beyond, "m"),
            Row("below_base", self.below_base),
        )
        known = (replace(x, value=None) if x.unit and np.isnan(x.value) else x for x in rows)
        return Data("Place", tuple(x for x in known if x.value != ""))

    def worse(self, other: Verdict) -> Verdict:
        """Verdict on two feasible places together: the worse value of each figure of merit."""
        return Verdict(
            bound=max(self.bound, other.bound),
            duration=float(np.maximum(self.duration, other.duration)),
            singular=float(np.minimum(self.singular, other.singular)),
            clearance=float(np.minimum(self.clearance, other.clearance)),
            torque_margin=float(np.minimum(self.torque_margin, other.torque_margin)),
            below_base=self.below_base or other.below_base,
        )


@dataclass(frozen=True, slots=True)
class CutoffVerdicts:
    """Verdicts on a place for all cutoffs up to the cutoff of its evaluation."""

    # steps: lower bounds of the score, each with the verdict at that step. The evaluation for a
    # cutoff ends with the first bound above the cutoff; the last bound is infinite for a final
    # verdict.
    steps: tuple[tuple[float, Verdict], ...]

    @property
    def last(self) -> Verdict:
        """The verdict with which the evaluation ended."""
        return self.steps[-1][1]

    def for_cutoff(self, cutoff: float) -> Verdict | None:
        """The verdict for a cutoff; None if the evaluation was ended by a smaller cutoff."""
        ends = (x for bound, x in self.steps if bound > cutoff or bound == np.inf)
        return next(ends, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaceEvaluator:
    """Evaluator of the places of a job."""

    job: Job  # The job at its own place, with one run and with rounded corners
    moves: Moves  # Displacement for values of the axes
    moved: str = PART  # "part" or "base"
    objective: str = DURATION  # One of OBJECTIVES
    # uncertainty: position error of the part by axis [m, rad].
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        """The fields without cached properties, because other processes compute their own."""
        return {x.name: getattr(self, x.name) for x in dataclasses.fields(self)}

    @property
    def run(self) -> Run:
        """The only run of the job."""
        return self.job.runs[0]

    @property
    def is_bounded(self) -> bool:
        """True if lower bounds of the duration apply: the run has optimal timing."""
        return isinstance(self.run.timing, Optimal)

    @cached_property
    def screen(self) -> Screen | None:
        """Screen for bounds without plans; None if the job does not support them."""
        arm, program = self._limited_arm, self.job.program
        if not isinstance(arm, SerialArm) or not Screen.supports(program, arm):
            return None
        limits = with_reserve(self.run.limits, self.run.timing.reserve)
        every = self.objective == MANIPULABILITY
        return Screen(program, arm, limits, self.job.seed, every=every)

    @cached_property
    def _limited_arm(self) -> Arm:
        """The arm with the joint ranges of the run, as in tracing."""
        return self.job.arm.with_limits(self.run.limits)

    def bounds_of(self, places: Sequence[Mapping[str, float]]) -> list[PlaceBounds]:
        """Bounds of places, without plans and without their uncertainty."""
        if self.screen is None:
            return [PlaceBounds() for _ in places]
        assert isinstance(self._limited_arm, SerialArm)
        bases = place_bases(
            self._limited_arm.chain.base.matrix, self.moves.frames(places), self.moved
        )
        beyond = self.screen.out_of_reach(bases)
        return [
            PlaceBounds(refusal=REACH) if far else self._bounds_of_reachable(x)
            for x, far in zip(places, beyond.tolist(), strict=True)
        ]

    def _bounds_of_reachable(self, place: Mapping[str, float]) -> PlaceBounds:
        """Bounds of a place that may be within reach, without a plan."""
        assert self.screen is not None
        arm = place_arm(self._limited_arm, self.moves.frame(place), self.moved)
        assert isinstance(arm, SerialArm)
        bounds = self.screen.bounds_of(arm)
        return bounds if self.is_bounded else dataclasses.replace(bounds, duration=0.0)

    def least_score(self, bounds: PlaceBounds) -> float:
        """Lower bound of the score of a place with these bounds."""
        if self.objective == DURATION:
            return BOUND_SHARE * bounds.duration
        known = self.objective == MANIPULABILITY and not np.isnan(bounds.singular)
        return -bounds.singular if known else -np.inf

    def evaluate(self, place: Mapping[str, float], cutoff: float = np.inf) -> CutoffVerdicts:
        """Evaluate a place and the corners of its uncertainty, for a cutoff of the score.

        A place whose bound of the score exceeds the cutoff is not planned. The result also has the
        verdicts for smaller cutoffs.
        """
        around = [place]
        for corner in corners_of(self.uncertainty):
            shifted = {name: place.get(name, 0.0) + x for name, x in corner.items()}
            around.append({**place, **shifted})
        steps: list[tuple[float, Verdict]] = []
        bound = 0.0
        for point in around:
            (bounds,) = self.bounds_of([point])
            bound = max(bound, BOUND_SHARE * bounds.duration)
            verdict = Verdict(bound=bound, singular=bounds.singular, refusal=bounds.refusal)
            steps.append((np.inf if bounds.refusal else self.least_score(bounds), verdict))
            if steps[-1][0] > cutoff or bounds.refusal:
                return CutoffVerdicts(tuple(steps))
        worst: Verdict | None = None
        for point in around:
            planned = self.plan(point, cutoff)
            if self.objective == DURATION:
                steps.append((planned.bound, Verdict(bound=planned.bound)))
                if planned.bound > cutoff:
                    return CutoffVerdicts(tuple(steps))
            if not planned.planned:
                worst = planned
                break
            worst = planned if worst is None else worst.worse(planned)
        assert worst is not None
        return CutoffVerdicts((*steps, (np.inf, worst)))

    def plan(self, place: Mapping[str, float], cutoff: float = np.inf) -> Verdict:
        """Plan the job at a place, without uncertainty; no plan if a bound exceeds the cutoff."""
        job, run, bound = place_job(self.job, self.moves.frame(place), self.moved), self.run, 0.0
        try:
            reuse, program = Reuse(), job.program
            _, traced = trace_one(job, run, reuse, objective=program, first_only=True)
            bound = BOUND_SHARE * self._bound(traced) if self.is_bounded else 0.0
            if self.objective == DURATION and bound > cutoff:
                return Verdict(bound=bound)
            planned = plan_one(job, run, reuse, objective=program, first_only=True)
        except ArmContourError as error:
            return _refusal_verdict(error, bound)
        assert planned.traced is not None
        return Verdict(
            bound=bound,
            duration=planned.trajectory.duration,
            singular=_least_singular(job.arm, planned.traced),
            clearance=_least_distance(planned.clearance, job.scene),
            torque_margin=_torque_margin(job.arm, run, planned.trajectory),
            below_base=(planned.clearance and planned.clearance.below_base) or "",
        )

    def _bound(self, traced: Tracing) -> float:
        """Lower bound of the duration of a traced program [s]."""
        limits = with_reserve(self.run.limits, self.run.timing.reserve).without_jerk
        moves = traced.program.moves
        total = float(sum(x.duration for x in moves if isinstance(x, Dwell)))
        for step in traced.steps:
            if step.joint_path is not None:
                contour = step.move is not None and isinstance(moves[step.move], Contour)
                total += bound_duration(step.joint_path, limits if contour else limits.of_joints)
        return total


def _refusal_verdict(error: ArmContourError, bound: float) -> Verdict:
    """Verdict on a place whose plan has failed with an error."""
    kinds = {"reach": REACH, "singularity": SINGULAR_ARM, "clearance": CLEARANCE}
    kind = kinds.get(error.limit or "", OTHER)
    if error.limit in ("joint_lower", "joint_upper"):
        kind = RANGE
    elif kind == OTHER and isinstance(error, NotRealizable):
        kind = LIMITS
    beyond = np.nan if kind != REACH or error.needed is None else error.needed
    return Verdict(bound=bound, refusal=kind, reason=str(error), beyond=beyond)


def _least_distance(clearance: Clearance | None, scene: Scene | None) -> float:
    """Smallest distance to obstacles (to the arm itself if there are none) [m]; NaN if unknown."""
    if clearance is None:
        return np.nan
    names = set() if scene is None else {x.name for x in scene.obstacles}
    pairs = [x for x in clearance.pairs if not names or {x.first, x.second} & names]
    return min((x.low for x in pairs), default=np.inf)


def _least_singular(arm: Arm, traced: Tracing) -> float:
    """Smallest singular value at the knots of all contours and midway between them [m/rad]."""
    moves, values = traced.program.moves, []
    for step in traced.steps:
        if step.joint_path is None or step.move is None:
            continue
        move = moves[step.move]
        if isinstance(move, Contour):
            s = step.joint_path.breaks
            places = np.sort(np.concatenate([s, (s[:-1] + s[1:]) / 2]))
            task = task_dimension(move.path, arm) if isinstance(arm, SerialArm) else 2
            values.append(least_singular_value(arm, step.joint_path(places), task))
    return min(values)


def _torque_margin(arm: Arm, run: Run, plan: Trajectory) -> float:
    """Smallest unused share of the torque limits at the breaks of a plan; NaN if unknown."""
    if run.limits.joint_torque is None or not arm.has_bodies:
        return np.nan
    t = plan.breaks
    sides = ((t[1:], "left"), (t[:-1], "right"))
    torques = np.concatenate([torques_at(arm, plan, x, side=y) for x, y in sides])
    return float(1 - use_of("joint_torque", run.limits, torques).ratio.max())
