"""Leads of automatic length, with which the tool has its full speed at the contour."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from armcontour.core.errors import ArmContourError, error_context
from armcontour.jobs.job import Job, Run
from armcontour.jobs.run_result import RunResult
from armcontour.motion import Trajectory
from armcontour.planning import Optimal
from armcontour.program import Contour, Event, Leads, Process, Program, arrange_contours, prepare

# Length of a lead below which the arm reaches none [m].
SHORTEST_LEAD = 1e-3
# Ratio of a lead to the length on which the tool accelerates along the contour, because the arm
# accelerates less in other positions.
LONGER = 1.1
# Number of points along a contour with known speed.
PLACES = 401
# Keys of the process that are ignored while automatic leads are determined.
UNLED = ("lead_in", "lead_out", "pierce", "kerf")

PlanOne = Callable[..., RunResult]


def automatic_leads(job: Job, run: Run, plan: PlanOne) -> list[Leads]:
    """Leads with which each contour has full speed where the process switches on and off.

    The tool is assumed to accelerate as along the contour itself. Full speed is the assigned
    velocity; without one, the largest speed along the contour. Leads that the arm does not reach
    are halved. Lengths of leads that are not automatic are 0.
    """
    # Corners of shape free are replaced by arcs here, because shaping takes long.
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
    moves = prepare(arrange_contours(job.program, process), plain).moves
    # Events may be due before the motion without leads begins.
    still = (dataclasses.replace(x, events=()) if isinstance(x, Contour) else x for x in moves)
    program = Program(moves=tuple(x for x in still if not isinstance(x, Event)))
    planned = plan(job, run, objective=program)
    with error_context("leads"):
        return [
            _find_leads(partial(plan, job, run), run, process.of_contour(x), x, span.trajectory)
            for x, span in zip(program.contours, planned.trajectory.contour_spans, strict=True)
        ]


def _find_leads(
    plan: PlanOne, run: Run, process: Process, contour: Contour, motion: Trajectory | None
) -> Leads:
    """Lengths of the automatic leads of a contour, from its motion without leads."""
    assert motion is not None
    leads = Leads(before=0.0, after=0.0)
    contour = dataclasses.replace(contour, work=None)
    path, length_of_motion = contour.path, float(motion.s(motion.duration))
    distances = np.linspace(0.0, length_of_motion, PLACES)[1:]
    for key, name, s, side in (
        ("lead_in", "before", 0.0, "right"),
        ("lead_out", "after", path.length, "left"),
    ):
        lead = getattr(process, key)
        if lead is None or lead.length is not None:
            continue
        speeds = motion.speed_at(distances if name == "before" else length_of_motion - distances)
        speed = float(path.assigned_speeds(run.limits.speed, s, side=side))
        speed = speed if math.isfinite(speed) else float(speeds.max())
        needed = speed**2 / float((speeds**2 / distances).max())
        if lead.shape == "arc" and run.limits.centripetal_acceleration is not None:
            # A shorter quarter of a circle is too tight for the speed.
            needed = max(needed, math.pi / 2 * speed**2 / run.limits.centripetal_acceleration)
        length = needed = LONGER * needed
        ends = Process(begin="drawn", up=process.up, **{key: lead})
        while True:
            tried = dataclasses.replace(Leads(before=0.0, after=0.0), **{name: length})
            try:
                planned = plan(objective=prepare(Program(moves=(contour,)), ends, [tried]))
                break
            except ArmContourError:
                if length <= SHORTEST_LEAD:
                    raise
                length /= 2
        # Limits of the contour may not allow the full speed.
        reached = planned.trajectory.speed_at(planned.path.contours[0].at_work[name == "after"])
        length = min(length, LONGER * needed * (float(reached) / speed) ** 2)
        leads = dataclasses.replace(leads, **{name: length})
    return leads
