"""What a job is like at a place: its duration, how well the arm moves, and what refuses it."""

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
from armcontour.jobs.place_search import CLEARANCE, DURATION, MANIPULABILITY, TORQUE, corners_of
from armcontour.jobs.plan_quantities import torques_at
from armcontour.jobs.reuse import Reuse
from armcontour.jobs.run_plan import plan_one, trace_one
from armcontour.motion import Trajectory
from armcontour.planning import Optimal, Tracing, with_reserve
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.program_tracing import SURE
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

# Kinds of refusals, those of a screen first.
LIMITS, OTHER = "limits", "other"
# What is compared for each objective, with its unit.
COMPARED = {
    DURATION: ("duration", "s"),
    MANIPULABILITY: ("singular", "m/rad"),
    CLEARANCE: ("clearance", "m"),
    TORQUE: ("torque_margin", "1"),
}
KINDS = (REACH, RANGE, SINGULAR_ARM, CLEARANCE, LIMITS, OTHER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict(Result):
    """What is known of a place; with an uncertainty, of the worst place around it.

    Values are not numbers where they are not known.

    Args:
        bound: No plan is shorter than this [s].
        duration: Duration of the plan [s].
        singular: Least singular value along the path; without a plan that of the configuration with
            the least bound. `docs/guides/placement.md` says of what.
        clearance: Least distance of the arm from anything in the cell or, without obstacles, from
            itself [m].
        torque_margin: Share of the limits of torque that the plan leaves free at least.
        refusal: Kind of the refusal, one of `KINDS`; empty for a place that is not refused.
        reason: The refusal as a sentence, if it was asked for.
        beyond: How far the tool stays from the path [m], where the reach refuses with a sentence.
        below_base: A sentence on links that come below the base; empty if none does.
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
        """Whether there is a plan."""
        return not np.isnan(self.duration)

    def score(self, objective: str) -> float:
        """What the search makes small, one of `OBJECTIVES`; infinite without a plan."""
        if not self.planned:
            return np.inf
        value = getattr(self, COMPARED[objective][0])
        return float(value if objective == DURATION else -value)

    def to_data(self) -> Data:
        """The figures that are known."""
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
        """The worse values of two places that are not refused."""
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
    """Verdicts on a place for all cutoffs up to that of its evaluation."""

    # Verdicts, each with a bound on the score; the first bound that is above a score ends the
    # judgement for it
    steps: tuple[tuple[float, Verdict], ...]

    @property
    def last(self) -> Verdict:
        """The verdict for the score that the place was judged for."""
        return self.steps[-1][1]

    def at(self, cutoff: float) -> Verdict | None:
        """The verdict for a score; None if the place was judged for a smaller one, and left."""
        ends = (x for bound, x in self.steps if bound > cutoff or bound == np.inf)
        return next(ends, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaceEvaluator:
    """Judges places of a job."""

    # The job in its own place: its path is the program that the tool follows, with rounded corners,
    # so that its only run rounds none
    job: Job
    # What coordinates of a place mean
    moves: Moves
    # What they move, "part" or "base"
    what: str = PART
    # One of `OBJECTIVES`
    objective: str = DURATION
    # Position error of the part [m, rad]
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        """What it was made of; its screen is made anew."""
        return {x.name: getattr(self, x.name) for x in dataclasses.fields(self)}

    @property
    def run(self) -> Run:
        """The run."""
        return self.job.runs[0]

    @property
    def bounded(self) -> bool:
        """Whether plans keep the limits that bounds on durations assume."""
        return isinstance(self.run.timing, Optimal)

    @cached_property
    def screen(self) -> Screen | None:
        """Bounds without plans; None if there are none for this job."""
        arm, program = self._limited, self.job.program
        if not isinstance(arm, SerialArm) or not Screen.fits(program, arm):
            return None
        limits = with_reserve(self.run.limits, self.run.timing.reserve)
        of_all = self.objective == MANIPULABILITY
        return Screen(program, arm, limits, self.job.seed, of_all=of_all)

    @cached_property
    def _limited(self) -> Arm:
        """The arm with the joint ranges of the run, as tracing has it."""
        return self.job.arm.with_limits(self.run.limits)

    def look(self, place: Mapping[str, float]) -> PlaceBounds:
        """What is known of a place without a plan, and without its uncertainty."""
        return self.look_all([place])[0]

    def look_all(self, places: Sequence[Mapping[str, float]]) -> list[PlaceBounds]:
        """What is known of places without plans, and without their uncertainty."""
        if self.screen is None:
            return [PlaceBounds() for _ in places]
        assert isinstance(self._limited, SerialArm)
        bases = place_bases(self._limited.chain.base.matrix, self.moves.frames(places), self.what)
        beyond = self.screen.refuses(bases)
        return [
            PlaceBounds(refusal=REACH) if far else self._traced(x)
            for x, far in zip(places, beyond.tolist(), strict=True)
        ]

    def _traced(self, place: Mapping[str, float]) -> PlaceBounds:
        """What the screen knows of a place that may be within reach."""
        assert self.screen is not None
        arm = place_arm(self._limited, self.moves.frame(place), self.what)
        assert isinstance(arm, SerialArm)
        found = self.screen.look(arm)
        return found if self.bounded else dataclasses.replace(found, duration=0.0)

    def least_score(self, seen: PlaceBounds) -> float:
        """No place of which this is known has a smaller score."""
        if self.objective == DURATION:
            return SURE * seen.duration
        known = self.objective == MANIPULABILITY and not np.isnan(seen.singular)
        return -seen.singular if known else -np.inf

    def judge(self, place: Mapping[str, float], cutoff: float = np.inf) -> Verdict:
        """What a place is like; with an uncertainty the worst of place and corners counts."""
        return self.weigh(place, cutoff).last

    def weigh(self, place: Mapping[str, float], cutoff: float = np.inf) -> CutoffVerdicts:
        """The same as `judge`, with the verdicts for smaller scores than the cutoff."""
        corners = corners_of(self.uncertainty)
        around = [place, *({**place, **_shifted(place, x)} for x in corners)]
        steps: list[tuple[float, Verdict]] = []
        bound = 0.0
        for x in around:
            seen = self.look(x)
            bound = max(bound, SURE * seen.duration)
            verdict = Verdict(bound=bound, singular=seen.singular, refusal=seen.refusal)
            steps.append((np.inf if seen.refusal else self.least_score(seen), verdict))
            if steps[-1][0] > cutoff or seen.refusal:
                return CutoffVerdicts(tuple(steps))
        worst: Verdict | None = None
        for x in around:
            found = self.plan(x, cutoff)
            if self.objective == DURATION:
                steps.append((found.bound, Verdict(bound=found.bound)))
                if found.bound > cutoff:
                    return CutoffVerdicts(tuple(steps))
            if not found.planned:
                worst = found
                break
            worst = found if worst is None else worst.worse(found)
        assert worst is not None
        return CutoffVerdicts((*steps, (np.inf, worst)))

    def plan(self, place: Mapping[str, float], cutoff: float = np.inf) -> Verdict:
        """Plan the job at a place, without its uncertainty, unless a bound is above the cutoff."""
        here, run, bound = place_job(self.job, self.moves.frame(place), self.what), self.run, 0.0
        try:
            reuse, program = Reuse(), here.program
            _, traced = trace_one(here, run, reuse, objective=program, first_only=True)
            bound = SURE * self._bound(traced) if self.bounded else 0.0
            if self.objective == DURATION and bound > cutoff:
                return Verdict(bound=bound)
            found = plan_one(here, run, reuse, objective=program, first_only=True)
        except ArmContourError as error:
            return _refused(error, bound)
        assert found.traced is not None
        return Verdict(
            bound=bound,
            duration=found.trajectory.duration,
            singular=_singular(here.arm, found.traced),
            clearance=_least_distance(found.clearance, here.scene),
            torque_margin=_torque_margin(here.arm, run, found.trajectory),
            below_base=(found.clearance and found.clearance.below_base) or "",
        )

    def _bound(self, traced: Tracing) -> float:
        """A lower bound on the duration of a traced program [s]."""
        limits = with_reserve(self.run.limits, self.run.timing.reserve).without_jerk
        moves = traced.program.moves
        total = float(sum(x.duration for x in moves if isinstance(x, Dwell)))
        for x in traced.steps:
            if x.joint_path is not None:
                contour = x.move is not None and isinstance(moves[x.move], Contour)
                total += bound_duration(x.joint_path, limits if contour else limits.of_joints)
        return total


def _shifted(place: Mapping[str, float], by: Mapping[str, float]) -> dict[str, float]:
    """Some values of a place, shifted; what the place does not name is 0."""
    return {name: place.get(name, 0.0) + x for name, x in by.items()}


def _refused(error: ArmContourError, bound: float) -> Verdict:
    """The verdict of a place at which an error was raised."""
    kinds = {"reach": REACH, "singularity": SINGULAR_ARM, "clearance": CLEARANCE}
    kind = kinds.get(error.limit or "", OTHER)
    if error.limit in ("joint_lower", "joint_upper"):
        kind = RANGE
    elif kind == OTHER and isinstance(error, NotRealizable):
        kind = LIMITS
    beyond = np.nan if kind != REACH or error.needed is None else error.needed
    return Verdict(bound=bound, refusal=kind, reason=str(error), beyond=beyond)


def _least_distance(clearance: Clearance | None, scene: Scene | None) -> float:
    """The least distance from obstacles, or of the arm from itself [m]; nan if it is unknown."""
    if clearance is None:
        return np.nan
    names = set() if scene is None else {x.name for x in scene.obstacles}
    pairs = [x for x in clearance.pairs if not names or {x.first, x.second} & names]
    return min((x.low for x in pairs), default=np.inf)


def _singular(arm: Arm, traced: Tracing) -> float:
    """The least singular value along all contours: at knots and midway between them."""
    moves, found = traced.program.moves, []
    for x in traced.steps:
        if x.joint_path is None or x.move is None:
            continue
        move = moves[x.move]
        if isinstance(move, Contour):
            s = x.joint_path.breaks
            places = np.sort(np.concatenate([s, (s[:-1] + s[1:]) / 2]))
            task = task_dimension(move.path, arm) if isinstance(arm, SerialArm) else 2
            found.append(least_singular_value(arm, x.joint_path(places), task))
    return min(found)


def _torque_margin(arm: Arm, run: Run, found: Trajectory) -> float:
    """The share of the limits of torque that a plan leaves free at its breaks; nan without any."""
    if run.limits.joint_torque is None or not arm.has_bodies:
        return np.nan
    t = found.breaks
    sides = ((t[1:], "left"), (t[:-1], "right"))
    torques = np.concatenate([torques_at(arm, found, x, side=y) for x, y in sides])
    return float(1 - use_of("joint_torque", run.limits, torques).ratio.max())
