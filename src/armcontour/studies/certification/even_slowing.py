"""Plans that are slowed down evenly: the last attempt of a certificate, and proofs of its remedies.

Derating slows a plan down where it exceeds its goals. If this fails, the whole motion is slowed
down evenly. If that fails as well, the certificate is refused, and each remedy that the refusal
names was tried: with it, the judge accepts the motion that is slowed down evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from armcontour.control.compensation import INVERSE
from armcontour.core.errors import ArmContourError, NotRealizable
from armcontour.core.progress import Step
from armcontour.core.render import number
from armcontour.jobs.certificate_goal import Uncertainty
from armcontour.studies.certification.case import Attempt, Case, Move
from armcontour.studies.certification.derating_search import (
    AttemptVerdict,
    SearchEnded,
    fastest_moves,
    search_verdict,
    verify_attempt,
)

# Share of the allowed time that the slowest motion takes.
LONGEST_SHARE = 0.999
# Number of bisections of the factor by which the motion is slowed down.
BISECTIONS = 5
# Factors by which remedies exceed their estimates; they are tried in order until one is enough.
MARGINS = (1.05, 1.25, 1.5, 2.0)
# Largest ratio of an even motion at which derating is tried, too.
WORTH_DERATING = 2.0
# Factor of the error of the last derated motion that is tried as the allowed one.
ERROR_MARGIN = 1.02
# Powers of a cause's ratio by which the motion must become slower; ratios of "tool" are those of
# squared speeds.
SLOWING_POWERS = {"acceleration": 0.5, "speed": 1.0, "tool": 0.5, "error": 0.5, "box": 1.0}
# Factor of the duration of a derated motion that is tried as the longest one.
SHORTENING_MARGIN = 1.02
# Divisors of the cycle that are tried, and the shortest cycle that is tried [s].
CYCLE_DIVISORS = (2, 4)
SHORTEST_TRIED_CYCLE = 5e-4
# Largest number of set-points of a longer motion that is tried.
MAX_TRIED_SET_POINTS = 50_000
# Largest number of set-points of a longer motion that is derated, which takes many simulations.
MAX_DERATED_SET_POINTS = 4_000
# Number of significant digits of the values of remedies.
REMEDY_DIGITS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Remedy:
    """A change of the job that may be enough for a certificate.

    Args:
        case: The changed case, which has the moves of the case before.
        text: The change, as a phrase.
        derates: Whether derating is tried, too, where the even motion is not enough.
    """

    case: Case
    text: str
    derates: bool = False

    def duration(self, moves: Sequence[Move]) -> float | None:
        """Return the duration of a motion that is certified with it [s]; None if none is found.

        - `moves`: the fastest moves, which the change does not affect.
        """
        with suppress(ArmContourError):
            verdict = _verify(self.case, moves, _slowest_factor(self.case))
            if verdict.kept:
                return verdict.duration
            if self.derates and _largest_ratio(verdict) < WORTH_DERATING:
                return search_verdict(self.case).duration
        return None


# Yields remedies from the case, the verdict on its slowest even motion, and the refusal.
Kind: TypeAlias = Callable[[Case, AttemptVerdict, SearchEnded], Iterator[Remedy]]


def slow_down(case: Case, refusal: SearchEnded) -> AttemptVerdict:
    """Return the verdict on the fastest evenly slowed motion that is certified.

    - `refusal`: the error with which derating ended.

    Raises:
        NotRealizable: No such motion is certified; the message names remedies that were tried.
    """
    case.progress(Step(("even slowing",)))
    moves = fastest_moves(case)
    slowest = _verify(case, moves, _slowest_factor(case))
    if not slowest.kept:
        raise _with_remedies(case, moves, slowest, refusal)
    best = slowest
    slow = _slowest_factor(case)
    fast = 1.0
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(fast * slow))
        verdict = _verify(case, moves, middle)
        if verdict.kept:
            slow = middle
            best = verdict
        else:
            fast = middle
    return best


def _slowest_factor(case: Case) -> float:
    """Return the largest factor by which a motion is slowed down."""
    return max(LONGEST_SHARE * case.goal.slowest, 1.0)


def _verify(case: Case, moves: Sequence[Move], factor: float) -> AttemptVerdict:
    """Verify the motion that takes `factor` times the duration of the fastest one."""
    return verify_attempt(case, Attempt.joined(case, [x.slowed(factor) for x in moves]))


def _with_remedies(
    case: Case, moves: Sequence[Move], slowest: AttemptVerdict, refusal: SearchEnded
) -> NotRealizable:
    """Return the refusal with the remedies that are enough for an evenly slowed motion.

    - `slowest`: verdict on the slowest motion of the case.
    """
    texts = []
    kinds: list[Kind] = [_compensations, _longer_motions, _larger_errors]
    if _largest_box_ratio(slowest) == _largest_ratio(slowest):
        kinds.append(_smaller_boxes)
    else:
        kinds.append(_cycles)
    for kind in kinds:
        case.progress(Step(("remedies",)))
        for remedy in kind(case, slowest, refusal):
            duration = remedy.duration(moves)
            if duration is None:
                continue
            if kind is _longer_motions:
                remedy, duration = _shortened(case, remedy, duration)
            texts.append(f"{remedy.text} ({number(duration, 's')})")
            break
    advice = "Other cycles, longer motions and larger errors were tried, but none alone is enough"
    if texts:
        advice = f"Each of these was tried and is enough (duration): {', or '.join(texts)}"
    error = NotRealizable(f"{refusal} {advice}.")
    vars(error).update(vars(refusal))
    return error


def _compensations(case: Case, slowest: AttemptVerdict, refusal: SearchEnded) -> Iterator[Remedy]:
    """Yield the compensation and the interpolation that a servo model can invert."""
    compensation = case.run.compensation
    if not compensation.compensates or compensation.for_bodies:
        inverse = replace(INVERSE, command_limits=compensation.command_limits)
        text = "compensate the lag of the servo with the method inverse"
        yield Remedy(case=case.with_run(compensation=inverse), text=text, derates=True)
    if case.servo.interpolation == "step":
        servos = {
            name: getattr(case.job, name).replace(interpolation="linear")
            for name in ("servo", "plant_servo")
        }
        job = replace(case.job, **servos)
        text = "linear interpolation of the set-points"
        yield Remedy(case=replace(case, job=job), text=text, derates=True)


def _cycles(case: Case, slowest: AttemptVerdict, refusal: SearchEnded) -> Iterator[Remedy]:
    """Yield shorter cycles, the longest first."""
    for divisor in CYCLE_DIVISORS:
        cycle = case.run.cycle / divisor
        if cycle >= SHORTEST_TRIED_CYCLE:
            text = f"cycle: {number(cycle, 's')}"
            yield Remedy(case=case.with_run(cycle=cycle), text=text, derates=True)


def _longer_motions(case: Case, slowest: AttemptVerdict, refusal: SearchEnded) -> Iterator[Remedy]:
    """Yield larger values of `slowest`, the smallest first."""
    ratios = {x: max(y[x] for y in slowest.ratios) for x in SLOWING_POWERS}
    slower = max(ratios[x] ** power for x, power in SLOWING_POWERS.items())
    for margin in MARGINS:
        factor = _round_up(case.goal.slowest * slower * margin)
        duration = factor / case.goal.slowest * slowest.duration
        if duration < MAX_TRIED_SET_POINTS * case.run.cycle:
            yield _with_slowest(case, factor)


def _with_slowest(case: Case, slowest: float) -> Remedy:
    """Return the change of the goal's `slowest`."""
    goal = replace(case.goal, slowest=slowest)
    return Remedy(case=replace(case, goal=goal), text=f"slowest: {slowest:g}")


def _shortened(case: Case, longer: Remedy, duration: float) -> tuple[Remedy, float]:
    """Return a smaller value of `slowest` that is enough with derating, and the duration [s].

    - `longer`: a value that is enough for an even motion.
    - `duration`: duration of this motion [s].
    """
    if duration > MAX_DERATED_SET_POINTS * case.run.cycle:
        return longer, duration
    with suppress(ArmContourError):
        contours = search_verdict(longer.case).attempt.contours
        ratio = max(x.plan.duration / x.fastest.duration for x in contours)
        shorter = _with_slowest(case, _round_up(SHORTENING_MARGIN * ratio))
        if shorter.case.goal.slowest < longer.case.goal.slowest:
            return shorter, search_verdict(shorter.case).duration
    return longer, duration


def _smaller_boxes(case: Case, slowest: AttemptVerdict, refusal: SearchEnded) -> Iterator[Remedy]:
    """Yield smaller boxes; the error is about proportional to their size."""
    box = case.goal.box
    if box is None:
        return
    for margin in MARGINS:
        percent = np.floor(100 / (_largest_ratio(slowest) * margin))
        if percent < 1:
            return
        smaller = Uncertainty(
            gains=np.asarray(box.gains) * percent / 100,
            dead_time=np.asarray(box.dead_time) * percent / 100,
            dead_time_shared=box.dead_time_shared,
        )
        goal = replace(case.goal, box=smaller)
        yield Remedy(case=replace(case, goal=goal), text=f"a box of {percent:g} % of its size")


def _larger_errors(case: Case, slowest: AttemptVerdict, refusal: SearchEnded) -> Iterator[Remedy]:
    """Yield the errors of the last derated motion and of the slowest motion as the allowed ones.

    A tolerance that is shared with corners would change the path, so it is not tried.
    """
    goal = case.goal
    errors = []
    if refusal.limit == "contour error" and refusal.needed is not None:
        errors.append((ERROR_MARGIN * refusal.needed, True))
    errors.append((max(max(x["error"], x["box"]) for x in slowest.ratios) * case.budget, False))
    for error, derates in errors:
        needed = _round_up(error + case.model_error)
        if goal.tolerance is None:
            larger = replace(goal, servo_error=needed)
            text = f"servo_error: {number(needed, 'm')}"
        elif case.servo_allowed == goal.tolerance:
            larger = replace(goal, tolerance=needed)
            text = f"tolerance: {number(needed, 'm')}"
        else:
            return
        changed = replace(case, goal=larger, servo_allowed=needed)
        yield Remedy(case=changed, text=text, derates=derates)


def _largest_ratio(verdict: AttemptVerdict) -> float:
    """Return a verdict's largest ratio to limits and goals."""
    return max(max(x.values()) for x in verdict.ratios)


def _largest_box_ratio(verdict: AttemptVerdict) -> float:
    """Return a verdict's largest ratio of the error of robots of the box to the budget."""
    return max(x["box"] for x in verdict.ratios)


def _round_up(value: float) -> float:
    """Round up to REMEDY_DIGITS significant digits, so that the written value is enough."""
    unit = 10.0 ** (np.floor(np.log10(value)) + 1 - REMEDY_DIGITS)
    return float(f"{np.ceil(value / unit) * unit:.{REMEDY_DIGITS}g}")
