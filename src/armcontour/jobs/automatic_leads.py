"""Leads of automatic length: the shortest leads with full tool speed at the contour."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, error_context
from armcontour.jobs.job import Job, Run
from armcontour.jobs.planned_run import Planned
from armcontour.jobs.run_warnings import SAME_SPEED, assigned_speed
from armcontour.planning import Optimal
from armcontour.program import Contour, Leads, Process, Program, arrange_contours, prepare
from armcontour.robot import PlanarTwoLink

# Lead length that is tried first, minimum and maximum lead length [m].
FIRST_LEAD, SHORTEST_LEAD, LONGEST_LEAD = 32e-3, 2e-3, 16.0
# Relative increase of the speed below which a lead is not doubled again. With jerk limits, the
# speed increases only slowly with the radius of the arc of the lead.
LEAST_GAIN = 0.05
# SHORT_ENOUGH: the search ends when this share of the length is not sufficient. LONGER: ratio of
# the next tried length to its estimate. PLACES: number of points along a lead with known speed.
SHORT_ENOUGH, LONGER, PLACES = 0.98, 1.005, 401
# Keys of the process that are ignored while automatic leads are determined.
UNLED = ("lead_in", "lead_out", "pierce", "kerf")

PlanOne = Callable[..., Planned]


def automatic_leads(job: Job, run: Run, plan: PlanOne) -> list[Leads]:
    """Shortest leads with which each contour has full speed where the process switches on and off.

    Full speed is the assigned velocity, or the largest speed that is possible with a lead within
    the reach of the arm. Lengths of leads that are not automatic are 0.
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
        by_layer={layer: {**given, **unled} for layer, given in process.by_layer.items()},
    )
    gain = LEAST_GAIN if run.limits.jerk_limits else SAME_SPEED
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
        process_of_layer = process.of_layer(contour.layer)
        lengths = []
        for lead, s, side, name in (
            (process_of_layer.lead_in, 0.0, "right", "before"),
            (process_of_layer.lead_out, contour.path.length, "left", "after"),
        ):
            automatic = lead is not None and lead.length is None
            speeds = partial(_lead_speeds, plan, job, run, bare, name)
            with error_context("leads"):
                assigned = assigned_speed(contour, s, side, run)
                lengths.append(_shortest_lead(speeds, assigned, gain) if automatic else 0.0)
        leads.append(Leads(before=lengths[0], after=lengths[1]))
    return leads


def _lead_speeds(
    plan: PlanOne, job: Job, run: Run, contour: Contour, name: str, length: float
) -> FloatArray | None:
    """Speeds along the lead `name` ("before", "after") of a contour planned alone [m/s], (PLACES,).

    They are at evenly spaced points from the end at which the tool rests to the contour. None if
    the arm does not reach this end, but may reach the end of a shorter lead.
    """
    process = job.process.of_layer(contour.layer)
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


def _shortest_lead(
    speeds: Callable[[float], FloatArray | None], assigned: float, gain: float
) -> float:
    """Shortest lead [m] that reaches the assigned velocity, else the largest speed of any lead."""
    # The sufficient speed is reduced by half of the tolerance of `slow_ends`, so that the result
    # causes no warning.
    enough = assigned * (1 - SAME_SPEED / 2)
    long, beyond = FIRST_LEAD, LONGEST_LEAD
    while (lead_speeds := speeds(long)) is None:
        long, beyond = long / 2, long
    # The lead is lengthened until its speed is sufficient or stops increasing, or the arm does not
    # reach its end (`beyond`). `short` is the longest lead with insufficient speed.
    short, low = 0.0, enough
    while lead_speeds[-1] < enough and long < SHORT_ENOUGH * beyond:
        length = min(2 * long, (long + beyond) / 2)
        longer = speeds(length)
        if longer is None:
            beyond = length
        elif longer[-1] < min(enough, lead_speeds[-1] * (1 + gain)) and length == 2 * long:
            break
        else:
            short, low, long, lead_speeds = long, lead_speeds[-1], length, longer
    enough = min(enough, lead_speeds[-1] * (1 - SAME_SPEED / 2))
    # The lead is shortened. The next length is the larger of two estimates: the part of the long
    # lead after which the speed is sufficient, and `short` extrapolated with speeds proportional to
    # the square root of the length. If the speed grows more slowly, as at the end of an
    # acceleration with a jerk limit, the steps are doubled.
    step = 0.0
    while True:
        share = np.argmax(lead_speeds >= enough) / (PLACES - 1)
        length = LONGER * max(short * (enough / low) ** 2, share * long)
        length = max(length, min(short + step, (short + long) / 2))
        if length >= SHORT_ENOUGH * long:
            return long
        tried = speeds(length)
        if tried is not None and tried[-1] >= enough:
            long, lead_speeds, step = length, tried, 0.0
        else:
            step = 2 * (length - short) if short else 0.0
            short, low = length, enough if tried is None else tried[-1]
