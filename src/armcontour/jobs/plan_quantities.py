"""Quantities computed from a run's plan: full stops, weaves, torques, angular speeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import angle_between
from armcontour.core.render import number, number_range
from armcontour.geometry import count_full_stops
from armcontour.geometry.rounding.rounded_path import NO_TOLERANCE
from armcontour.jobs.job import Run
from armcontour.motion import Execution, Trajectory
from armcontour.planning import Tracing, find_jerk_stops
from armcontour.planning.tracing.leaning import may_lean
from armcontour.planning.tracing.positioner_tilt import angles_to_gravity
from armcontour.program import Program, contour_called
from armcontour.program.preparation import PIERCE
from armcontour.robot import Arm, SerialArm

# Reason for which the list of full stops counts stops due to jerk limits.
CURVATURE_JUMPS = "curvature jumps"
# Reason of the stop between the line down from the pierce height and the contour.
AFTER_PIERCE = "after the pierce"
# Samples of the planned path per wave.
PER_WAVE = 64
# Crests farther apart than this fraction of the pitch belong to different parts of the seam.
# Adjacent crests are half a pitch apart.
MAX_CREST_DISTANCE = 0.75
# Largest distance of the middle of a weave from the path without a warning, as a fraction of the
# weave's width. A seam of waypoints on a curve has such distances.
SEAM_TOLERANCE = 0.05
# Maximum relative difference between the planned and the requested weave.
WEAVE_TOLERANCE = 0.02
# Torques are computed at this number of times, and at the breaks of the plan.
QUANTITY_SAMPLES = 4000
# Number of times at which torques are computed together, to limit the memory.
TIMES_AT_ONCE = 50_000


class JerkStop(NamedTuple):
    """A full stop inside a contour that jerk limits require, because the curvature jumps.

    Args:
        contour: Name of the contour in messages; empty for a single path.
        s: Arc length from the start of the contour [m].
        point: Position [m], 2 or 3 coordinates.
        origin: Place in the file, such as "line 12 (N120)"; empty if unknown.
    """

    contour: str
    s: float
    point: tuple[float, ...]
    origin: str


def jerk_stops(
    program: Program, traced: Tracing | None, trajectory: Trajectory, run: Run
) -> tuple[JerkStop, ...]:
    """Find the full stops inside contours that jerk limits require, in path order."""
    if traced is None or not run.limits.limits_jerk:
        return ()
    stops = []
    for i, (contour, span) in enumerate(
        zip(program.contours, trajectory.contour_spans, strict=True)
    ):
        if span.trajectory is not None:
            name = "" if program.single_path is not None else contour_called(contour, i)
            stops += [
                JerkStop(name, s, tuple(contour.path(s).tolist()), contour.origin_at(s))
                for s in find_jerk_stops(span.trajectory).tolist()
            ]
    return tuple(stops)


def stops_of_path(program: Program) -> dict[str, int]:
    """Count the full stops that a program requires regardless of limits, by reason."""
    stops: Counter[str] = Counter()
    for contour in program.contours:
        counts = Counter(count_full_stops(contour.path))
        if contour.path.tags[0] == PIERCE and counts[NO_TOLERANCE]:
            counts.update({NO_TOLERANCE: -1, AFTER_PIERCE: 1})
        stops.update(+counts)
    return dict(sorted(stops.items()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Weaving:
    """Planned weave of a contour, measured where the weave has its full width.

    Args:
        contour: Name of the contour in messages.
        width: Smallest and largest distance between adjacent crests, perpendicular to the seam [m].
        frequency: Smallest and largest number of waves per second [1/s].
        requested: Requested width [m] and frequency [1/s]; the frequency is NaN without an assigned
            velocity.
        left_out: Length of seam parts that are too short to be woven [m].
        deviation: Largest distance of the middle of the weave from the path [m].
    """

    contour: str
    width: tuple[float, float]
    frequency: tuple[float, float]
    requested: tuple[float, float]
    left_out: float
    deviation: float

    @property
    def differs(self) -> bool:
        """True if the planned and the requested weave differ by more than `WEAVE_TOLERANCE`."""
        width, frequency = self.requested
        narrow = max(abs(x - width) for x in self.width) > WEAVE_TOLERANCE * width
        return narrow or self.frequency[0] < (1 - WEAVE_TOLERANCE) * frequency or self.left_out > 0

    @property
    def sentence(self) -> str:
        """Sentence with planned widths and frequencies, and requested values if they differ."""
        width, frequency = self.requested
        text = f"{self.contour} weaves {number_range(self.width, 'm')} wide at "
        text += number_range(self.frequency, "Hz")
        if not self.differs:
            return f"{text}."
        requested = number(width, "m") + (
            "" if np.isnan(frequency) else f" at {number(frequency, 'Hz')}"
        )
        omitted = f", and omits {number(self.left_out, 'm')} of the seam" if self.left_out else ""
        return (
            f"{text} instead of {requested}{omitted}. The corner tolerance, the assigned velocity "
            "and the limits must allow the weave, and parts of the seam must be longer than half "
            "a pitch."
        )

    @property
    def leaves_seam(self) -> bool:
        """True if the middle of the weave is farther from the path than `SEAM_TOLERANCE`."""
        return self.deviation > SEAM_TOLERANCE * self.requested[0]

    @property
    def deviation_sentence(self) -> str:
        """Sentence with the distance of the middle of the weave from the path."""
        return (
            f"The middle of the weave of {self.contour} is up to {number(self.deviation, 'm')} "
            "away from the lines of the path, because vertices that turn by at most 30 deg are "
            "waypoints of a smooth seam. Where the seam must be straight, add points close to "
            "these vertices."
        )


def weavings(program: Program, trajectory: Trajectory) -> Iterator[Weaving]:
    """Yield the planned weave of each contour whose waves reach their full width."""
    for i, (contour, span) in enumerate(
        zip(program.contours, trajectory.contour_spans, strict=True)
    ):
        woven = contour.woven
        plan = span.trajectory
        if woven is None or plan is None:
            continue
        begin, end = (0.0, plan.duration) if span.work is None else span.work
        offset = 0.0 if span.work is None else span.t[0]
        count = int(PER_WAVE * woven.seam.length / woven.pitch) + 2
        t = np.linspace(begin - offset, end - offset, count).clip(0.0, plan.duration)
        on_seam = woven.seam.project(contour.path(plan.s(t).clip(0.0, contour.path.length)))
        # The projection is made monotonic, because the tool only moves forward along the seam.
        s = np.maximum.accumulate(on_seam.s)
        # A resumed contour begins after some of the crests.
        quarter = woven.pitch / 4
        is_passed = (woven.crests >= s[0] + quarter) & (woven.crests <= s[-1] - quarter)
        crests = woven.crests[is_passed]
        if len(crests) < 3:
            continue
        first, last = (np.searchsorted(s, crests + y * quarter) for y in (-1, 1))
        heights = np.array(
            [on_seam.distance[a:b].max(initial=0.0) for a, b in zip(first, last, strict=True)]
        )
        # Times at which the tool passes the crests [s].
        crest_times = np.interp(crests, s, t)
        widths = heights[:-1] + heights[1:]
        times = crest_times[2:] - crest_times[:-2]
        # Pairs of crests that belong to different parts of the seam are ignored.
        is_adjacent = np.diff(crests) < MAX_CREST_DISTANCE * woven.pitch
        widths = widths[is_adjacent]
        times = times[is_adjacent[:-1] & is_adjacent[1:]]
        if len(times):
            yield Weaving(
                contour=contour_called(contour, i),
                width=(float(widths.min()), float(widths.max())),
                frequency=(float(1 / times.max()), float(1 / times.min())),
                requested=(woven.width, woven.frequency),
                left_out=woven.left_out,
                deviation=woven.deviation,
            )


def peak_torques(arm: Arm, plan: Trajectory) -> FloatArray | None:
    """Return the largest absolute torque of each joint in a plan [N m], (dof,).

    The torques are computed at regular times, and on both sides of every break, where they may
    jump. None if the arm's masses are unknown.
    """
    if not arm.has_bodies:
        return None
    breaks = plan.breaks
    regular = np.linspace(0, plan.duration, QUANTITY_SAMPLES)
    # The first time has no torques from the left, and the last time none from the right.
    sides = (("right", breaks[:-1]), ("left", breaks[1:]), ("right", regular))
    peak = np.zeros(arm.dof)
    for side, times in sides:
        for first in range(0, len(times), TIMES_AT_ONCE):
            part = times[first : first + TIMES_AT_ONCE]
            torques = arm.torque(*plan.motion(part, side=side))
            peak = np.maximum(peak, np.abs(torques).max(axis=0))
    return peak


def angular_speed(execution: Execution) -> FloatArray | None:
    """Return the tool's angular speed [rad/s], (n,); None for a planar arm."""
    if not isinstance(execution.arm, SerialArm):
        return None
    twist = execution.arm.tool_twist(execution.q, execution.dq)
    return np.asarray(np.linalg.norm(twist[:, 3:], axis=1))


def largest_tilt(arm: Arm, plan: Trajectory) -> float | None:
    """Return the largest angle of the tool axis to gravity on contours [rad]; None if fixed."""
    if not isinstance(arm, SerialArm) or arm.chain.positioner is None:
        return None
    laws = [x.trajectory or plan for x in plan.contour_spans]
    positions = (x(np.linspace(0.0, x.duration, QUANTITY_SAMPLES)) for x in laws)
    return max(float(angles_to_gravity(arm, q).max()) for q in positions)


def largest_lean(arm: Arm, plan: Trajectory, program: Program) -> float | None:
    """Return the largest angle of the tool axis to the required one on contours [rad].

    None if the tool has the required axis or orientation: without a cone, and unless a machine with
    two rotary axes comes near the pole of its head.
    """
    if not isinstance(arm, SerialArm):
        return None
    moving = arm.without_held()
    angles = []
    for contour, span in zip(program.contours, plan.contour_spans, strict=True):
        orientation = contour.path.orientation
        if orientation is None or not orientation.axis_only or not may_lean(contour.path, moving):
            continue
        law = span.trajectory or plan
        t = np.linspace(0.0, law.duration, QUANTITY_SAMPLES)
        s = np.clip(law.s(t), 0.0, contour.path.length)
        tool_axis = arm.poses(law(t))[:, :, 2]
        angles.append(float(angle_between(tool_axis, orientation(s)[:, :, 2]).max()))
    return max(angles, default=None)
