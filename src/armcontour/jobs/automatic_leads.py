"""Leads of automatic length, with which the tool has its full speed at the contour."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, error_context
from armcontour.jobs.job import Job, Run
from armcontour.jobs.run_notes import SAME_SPEED
from armcontour.jobs.run_result import RunResult
from armcontour.planning import Optimal
from armcontour.program import Contour, Leads, Process, Program, arrange_contours, prepare
from armcontour.robot import PlanarTwoLink

# Lead length that is tried first, minimum and maximum lead length [m].
FIRST_LEAD, SHORTEST_LEAD, LONGEST_LEAD = 32e-3, 1e-3, 16.0
# Relative increase of the speed below which a lead is not doubled again. With jerk limits, the
# speed increases only slowly with the length of the lead.
LEAST_GAIN = 0.05
# Ratios of a lead to the part of a longer lead on which the tool accelerates, in order of trial.
LONGER = 1.02, 1.1, 1.2, 1.5
# Number of points along a lead with known speed.
PLACES = 401
# Keys of the process that are ignored while automatic leads are determined.
UNLED = ("lead_in", "lead_out", "pierce", "kerf")

PlanOne = Callable[..., RunResult]


def automatic_leads(job: Job, run: Run, plan: PlanOne) -> list[Leads]:
    """Leads with which each contour has full speed where the process switches on and off.

    Full speed is the assigned velocity, or the largest speed of the tried leads within the reach of
    the arm. Lengths of leads that are not automatic are 0.
    """
    # Corners of shape free are replaced by arcs here, because several leads are tried and shaping
    # takes long.
    rounding = None if run.rounding is None else run.rounding.with_arcs
    assert isinstance(run.timing, Optimal)
    timing = dataclasses.replace(run.timing, duration=None)
    run = dataclasses.replace(run, rounding=rounding, timing=timing)
    process = job.process
    unled: dict[str, Any] = dict.fromkeys(UNLED)
    plain = dataclasses.replace(
        process,
        **unled,
        approach=0.0,
        retract=0.0,
        order="drawn",
        by_layer={x: {**given, **unled} for x, given in process.by_layer.items()},
        by_contour={x: {**given, **unled} for x, given in process.by_contour.items()},
    )
    gain = LEAST_GAIN if run.limits.limits_jerk else SAME_SPEED
    leads = []
    contours = prepare(arrange_contours(job.program, process), plain).contours
    if isinstance(job.arm, PlanarTwoLink) and job.configuration is None:
        # The branch of the inverse kinematics that is best for the first contour is used for all.
        first = plan(job, run, objective=Program(moves=contours[:1]))
        job = dataclasses.replace(
            job, configuration=job.arm.configuration_of(first.trajectory(0.0))
        )
    for contour in contours:
        bare = dataclasses.replace(contour, events=(), work=None)
        contour_process = process.of_contour(contour)
        lengths = []
        for lead, s, side, name in (
            (contour_process.lead_in, 0.0, "right", "before"),
            (contour_process.lead_out, contour.path.length, "left", "after"),
        ):
            if lead is None or lead.length is not None:
                lengths.append(0.0)
                continue
            across = lead.shape == "arc" and run.limits.centripetal_acceleration
            speeds = partial(_lead_speeds, plan, job, run, bare, name)
            with error_context("leads"):
                assigned = float(contour.path.assigned_speeds(run.limits.speed, s, side=side))
                lengths.append(_lead_length(speeds, assigned, gain, across or np.inf))
        leads.append(Leads(before=lengths[0], after=lengths[1]))
    return leads


def _lead_speeds(
    plan: PlanOne, job: Job, run: Run, contour: Contour, name: str, length: float
) -> FloatArray | None:
    """Speeds along the lead `name` ("before", "after") of a contour planned alone [m/s], (PLACES,).

    They are at evenly spaced points from the end at which the tool rests to the contour. None if
    the arm does not reach this end, but may reach the end of a shorter lead.
    """
    process = job.process.of_contour(contour)
    used = "lead_in" if name == "before" else "lead_out"
    ends = Process(begin="drawn", up=process.up, **{used: getattr(process, used)})
    leads = dataclasses.replace(Leads(before=0.0, after=0.0), **{name: length})
    try:
        alone = prepare(Program(moves=(contour,)), ends, [leads])
        planned = plan(job, run, objective=alone)
    except ArmContourError:
        if length <= SHORTEST_LEAD:
            raise
        return None
    (only,) = planned.path.contours
    assert only.work is not None
    still, work = (0.0, only.work[0]) if name == "before" else (only.path.length, only.work[1])
    return np.asarray(planned.trajectory.speed_at(np.linspace(still, work, PLACES)))


def _lead_length(
    speeds: Callable[[float], FloatArray | None], assigned: float, gain: float, across: float
) -> float:
    """Length on which the tool reaches the assigned velocity, or else its largest speed [m].

    `across`: largest centripetal acceleration on the lead [m/s²], infinite for a line.
    """
    length, planned, enough = FIRST_LEAD, speeds(FIRST_LEAD), assigned * (1 - SAME_SPEED / 2)
    while planned is None:
        length /= 2
        planned = speeds(length)
    while length >= FIRST_LEAD and planned[-1] < enough and length < LONGEST_LEAD:
        longer = speeds(2 * length)
        if longer is None or longer[-1] < min(enough, planned[-1] * (1 + gain)):
            break
        length, planned = 2 * length, longer
    # A lead that is as long as the part on which the tool accelerates is at other positions of the
    # arm, so that it may be a little too short.
    enough = min(enough, float(planned[-1]) * (1 - SAME_SPEED / 2))
    part = float(np.argmax(planned >= enough)) / (PLACES - 1) * length
    # A shorter quarter of a circle is too tight for the speed.
    part = max(part, math.pi / 2 * enough**2 / across)
    for factor in LONGER:
        tried = speeds(factor * part) if factor * part < length else None
        if tried is not None and tried[-1] >= enough:
            return factor * part
    return length
