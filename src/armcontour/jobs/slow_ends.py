"""Warnings for contours with leads that start or end below the assigned velocity, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from armcontour.geometry.segments import REPEATED_POINT
from armcontour.jobs.job import Run
from armcontour.motion import Trajectory
from armcontour.program import Contour, Program, contour_called

# Relative difference below which two speeds are equal: margins of the timing are smaller.
SAME_SPEED = 1e-3
# An arc is the cause if the speed is at least this share of the largest speed on the arc.
ON_THE_ARC = 0.98
# Share of the contour's length by which is looked into it, for whether the tool gets faster there.
INTO = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowEnd:
    """A start or an end of a contour below the assigned velocity.

    Args:
        contour: What messages call the contour.
        word: "begins" at the start, "ends" at the end.
        speed: Speed of the tool there [m/s].
        assigned: Assigned velocity there [m/s].
        lead: Length of the lead [m].
        cause: "lead" for the arc of the lead, "contour" for an arc of the contour, "beyond" for
            what is farther on the contour, else "length".
        radius: Radius of that arc [m]; infinite without one.
    """

    contour: str
    word: str
    speed: float
    assigned: float
    lead: float
    cause: str
    radius: float


def slow_ends(program: Program, trajectory: Trajectory, this: Run) -> list[str]:
    """One warning per cause, with the slowest of the starts and ends that it slows.

    Args:
        program: The program that was planned.
        trajectory: Its plan.
        this: The run.
    """
    found = sorted(_find(program, trajectory, this), key=lambda x: x.cause)
    groups = [list(of) for _, of in groupby(found, key=lambda x: x.cause)]
    acceleration = this.limits.centripetal_acceleration
    return [_warn(of, math.inf if acceleration is None else acceleration) for of in groups]


def assigned_speed(contour: Contour, s: float, side: str, this: Run) -> float:
    """The assigned velocity of a contour at an arc length [m/s], on one side of a vertex."""
    most = np.inf if this.limits.speed is None else this.limits.speed
    return float(np.fmin(contour.path.speeds[contour.path.locate(s, side=side)], most))


def _find(program: Program, trajectory: Trajectory, this: Run) -> Iterator[SlowEnd]:
    """The starts and ends below the assigned velocity that have a lead."""
    spans = trajectory.contour_spans
    for i, (x, span) in enumerate(zip(program.contours, spans, strict=True)):
        if x.work is None or span.trajectory is None:
            continue
        start, end = x.work
        for word, s, lead, inside, inward in (
            ("begins", start, start, "right", 1),
            ("ends", end, x.path.length - end, "left", -1),
        ):
            if lead <= REPEATED_POINT:
                continue
            assigned = assigned_speed(x, s, inside, this)
            speed = float(span.trajectory.speed_at(s, side=inside))
            if not np.isfinite(assigned) or speed >= assigned * (1 - SAME_SPEED):
                continue
            # The joint with the lead is where rounding errors have put it, on either side of s.
            beside = s + inward * REPEATED_POINT * np.array([1, -1])
            bend, of_lead = x.path.curvatures[x.path.locate(beside)].tolist()
            cause, radius = _find_cause(bend, of_lead, speed, this)
            step = INTO * (end - start) * inward
            if cause == "length" and span.trajectory.speed_at(s + step) <= speed:
                cause = "beyond"
            yield SlowEnd(
                contour=contour_called(x, i),
                word=word,
                speed=speed,
                assigned=assigned,
                lead=lead,
                cause=cause,
                radius=radius,
            )


def _find_cause(contour: float, lead: float, speed: float, this: Run) -> tuple[str, float]:
    """What keeps the tool slow, and the radius of the arc [m], from curvatures [1/m]."""
    acceleration = this.limits.centripetal_acceleration
    for cause, curvature in (("contour", contour), ("lead", lead)):
        if acceleration is not None and curvature > 0:
            if speed >= ON_THE_ARC * math.sqrt(acceleration / curvature):
                return cause, 1 / curvature
    return "length", math.inf


def _warn(of: list[SlowEnd], acceleration: float) -> str:
    """The warning for places that are slow for the same cause."""
    worst = min(of, key=lambda x: x.speed / x.assigned)
    place = f"{worst.contour}: the work {worst.word} at"
    if len(of) > 1:
        place = f"at {len(of)} places the tool is slow, most at {place}"
    text = f"{place} {worst.speed * 1e3:.3g} of {worst.assigned * 1e3:.3g} mm/s"
    arc = f"the centripetal acceleration of {acceleration:.3g} m/s^2 allows no more on"
    if worst.cause == "contour":
        return (
            f"{text}, since {arc} the contour's arc with a radius of {worst.radius * 1e3:.3g} mm."
        )
    if worst.cause == "lead":
        # The radius of a lead's arc grows with the length of the lead, and the speed with its root.
        enough = worst.lead * worst.assigned**2 / (acceleration * worst.radius)
        return (
            f"{text}, since {arc} the lead's arc with a radius of {worst.radius * 1e3:.3g} mm: "
            f"with {enough * 1e3:.3g} mm in place of {worst.lead * 1e3:.3g} mm the lead's arc "
            "allows it."
        )
    if worst.cause == "beyond":
        why = (
            "brakes for what follows" if worst.word == "begins" else "comes from what is before it"
        )
        return (
            f"{text}, since it {why} on the contour: no lead makes it faster there; a lead at the "
            "contour's other end, a wider corner or more acceleration may."
        )
    return (
        f"{text}, with a lead of {worst.lead * 1e3:.3g} mm: a longer lead reaches more. A lead "
        "without a length is as long as helps much and as the arm reaches."
    )
