"""The program of a run: prepared as its process asks, automatic leads as long as they need."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from armcontour.errors import ArmContourError, InvalidInput, NotRealizable
from armcontour.motion import PathLaw, Trajectory
from armcontour.program import Contour, Leads, Process, Program, prepared, round_corners
from armcontour.study.job import Job, Run
from armcontour.timing import plan

# Automatic leads: the first that is tried [m], and how many times it is made twice as long.
FIRST_LEAD = 2e-3
MOST_DOUBLINGS = 12
# A lead that is found is longer than it would have to be by this share.
SPARE = 0.05
# A speed this near to another one is the same; so little do margins take.
SAME_SPEED = 1e-3
Rounding = dict[str, Any]


def program_of(job: Job, this: Run, rounding: Rounding | None) -> tuple[Program, Program]:
    """The program of a run before and after its corners are rounded.

    Args:
        job: The job, whose path is a program.
        this: The run.
        rounding: Arguments of `round_corners`; None keeps corners sharp.

    Raises:
        ArmContourError: As preparing, and planning of automatic leads, raise it.
    """
    assert isinstance(job.path, Program)
    lengths: list[Leads] | None = None
    if job.process.automatic:
        if this.timing != "optimal":
            raise InvalidInput(
                f"Run {this.name}: leads of automatic length need the timing optimal, not "
                f"{this.timing}: give their lengths."
            )
        lengths = automatic_leads(job, this, rounding)
    objective = prepared(job.path, job.process, lengths)
    return objective, rounded(objective, rounding)


def rounded(program: Program, rounding: Rounding | None) -> Program:
    """The program with rounded corners, if they are."""
    return program if rounding is None else round_corners(program, **rounding)


def automatic_leads(job: Job, this: Run, rounding: Rounding | None) -> list[Leads]:
    """The shortest leads with which the tool is as fast where it goes on and off as it can be.

    They double until the speed does no longer grow, and are then cut to what it took.
    """
    assert isinstance(job.path, Program)
    process = job.process
    plain = dataclasses.replace(process, lead_in=None, lead_out=None, approach=0.0, retract=0.0)
    found = []
    for i, x in enumerate(prepared(job.path, plain).contours):
        contour = dataclasses.replace(x, events=(), work=None)

        def at(before: float, behind: float, contour: Contour = contour) -> Trial:
            return _tried(job, this, rounding, contour, Leads(before=before, behind=behind))

        try:
            before = _length(lambda length: at(length, 0.0).on) if process.lead_in else 0.0
            behind = _length(lambda length: at(0.0, length).off) if process.lead_out else 0.0
        except ArmContourError as error:
            error.args = (f"leads of contour {contour.name or i + 1}: {error}",)
            raise
        found.append(Leads(before=before, behind=behind))
    return found


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What leads came to: the speed at an end of the work, and the lead that it took.

    Args:
        on: Speed where the tool goes on [m/s], and length of the lead in which it was reached [m].
        off: Likewise where it goes off.
    """

    on: tuple[float, float]
    off: tuple[float, float]


def _tried(job: Job, this: Run, rounding: Rounding | None, contour: Contour, leads: Leads) -> Trial:
    """A contour by itself, planned with leads of some lengths."""
    ends = Process(
        begin="drawn",
        lead_in=job.process.lead_in if leads.before else None,
        lead_out=job.process.lead_out if leads.behind else None,
        up=job.process.up,
    )
    alone = rounded(prepared(Program(moves=(contour,)), ends, [leads]), rounding)
    trajectory = planned(job, this, alone)
    (only,) = alone.contours
    law = trajectory.laws[0]
    assert isinstance(law, PathLaw) and only.work is not None
    begin, end = only.work
    speed_on, speed_off = np.interp([begin, end], law.s, law.speeds)
    reached_on = law.s[int(np.argmax(law.speeds >= speed_on * (1 - SAME_SPEED)))]
    held = np.flatnonzero(law.speeds >= speed_off * (1 - SAME_SPEED))
    return Trial(
        on=(float(speed_on), float(min(reached_on, begin))),
        off=(float(speed_off), float(max(only.path.length - law.s[held[-1]], 0.0))),
    )


def _length(reached: Callable[[float], tuple[float, float]]) -> float:
    """The shortest lead that gives the speed which longer ones give too.

    Args:
        reached: Speed with a lead of some length, and how much of it that took.
    """
    length = FIRST_LEAD
    speed, needed = reached(length)
    for _ in range(MOST_DOUBLINGS):
        longer, took = reached(2 * length)
        if longer <= speed * (1 + SAME_SPEED) and needed < length * (1 - SPARE):
            return needed * (1 + SPARE)
        if longer <= speed * (1 + SAME_SPEED):
            return took * (1 + SPARE) if took > 0 else length
        length, speed, needed = 2 * length, longer, took
    raise NotRealizable(
        f"with {length:.3g} m the tool still gets faster, {speed:.3g} m/s now: give the lead a "
        "length, or the contour a lower speed.",
        limit="speed",
        needed=length,
    )


def planned(job: Job, this: Run, program: Program, progress: Any = None) -> Trajectory:
    """The trajectory of a program under the limits and the options of a run."""
    return plan(
        program,
        job.arm,
        this.limits,
        method=this.timing,
        branch=job.branch,
        start=job.start,
        ignore_jerk=this.ignore_jerk,
        reserve=this.reserve,
        progress=progress,
        **this.timing_options,
    )


def slow_ends(program: Program, trajectory: Trajectory, this: Run) -> list[str]:
    """Sentences on contours with leads, where the tool goes on or off below the assigned velocity.

    Args:
        program: The program that was planned.
        trajectory: Its plan.
        this: The run.
    """
    most = np.inf if this.limits.speed is None else this.limits.speed
    spans = [x for x in trajectory.spans if x.kind == "contour"]
    found = []
    for x, span in zip(program.contours, spans, strict=True):
        law = None if span.trajectory is None else span.trajectory.laws[0]
        if x.work is None or not isinstance(law, PathLaw):
            continue
        begin, end = x.work
        for word, s, lead, side in (
            ("on", begin, begin, "right"),
            ("off", end, x.path.length - end, "left"),
        ):
            assigned = float(np.fmin(x.path.speeds[x.path.locate(s, side=side)], most))
            speed = float(np.interp(s, law.s, law.speeds))
            if lead > 0 and np.isfinite(assigned) and speed < assigned * (1 - SAME_SPEED):
                found.append(
                    f"contour {x.name}: the tool goes {word} at {speed:.3g} of {assigned:.3g} m/s, "
                    f"with a lead of {lead:.3g} m."
                )
    return found
