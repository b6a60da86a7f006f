"""Warnings of runs: capped values, slow contours, full stops, saturation, poor compensation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from armcontour._checks import FloatArray
from armcontour._text import list_some
from armcontour.arms import Limits
from armcontour.evaluation import Evaluation
from armcontour.geometry import Path, count_full_stops
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.jobs.job import TANGENT, Run
from armcontour.motion import Execution, Method, TaughtData, Trajectory
from armcontour.motion.trajectory import Span
from armcontour.program import Contour, Program, contour_called
from armcontour.servo import ServoModel
from armcontour.timing import Tracing, find_jerk_stops

# So many contours or segments are named in one sentence.
MOST_NAMES = 4
# Values that differ by less than this share are the same.
SAME = 1e-9
# A joint that is asked for this multiple of its acceleration limit is far above it.
FAR_ABOVE = 1.5
# Number of times at which a plan is compared with the motion of logs, and its breaks.
LOOKS = 1000
# Errors of joints below this are not said [rad].
UNFELT = 1e-6
# The compensation whose set-points are the plan's.
NONE = "none"
# The reason of full stops that limits of jerk force.
CURVATURE_JUMPS = "curvature jumps"
# A contour is slow if it takes this multiple of the time of a straight line of its length, with the
# largest mean acceleration that its ends show beyond this share of its length.
SLOW, ENDS = 2.0, 1e-3
# Relative difference below which two speeds are equal: margins of the timing are smaller.
SAME_SPEED = 1e-3
# An arc is the cause if the speed is at least this share of the largest speed on the arc.
ON_THE_ARC = 0.98
# Share of the contour's length by which is looked into it, for whether the tool gets faster there.
INTO = 1e-3
# Samples of the planned path per wave.
SAMPLES = 64
# Relative difference from what was asked above which there is a warning.
ALLOWED = 0.02
# A limit is reached from this share of it on.
REACHED = 0.95


def capped(program: Program, this: Run) -> list[str]:
    """Warnings for speeds and corner tolerances of the path that the run allows less of.

    Args:
        program: The program with sharp corners.
        this: The run.
    """
    tolerance = None if this.rounding is None else this.rounding.tolerance
    # With the shape free the tolerance holds along lines, too.
    free = this.rounding is not None and this.rounding.free
    return [
        *_capped(
            program, lambda x: x.speeds, this.limits.speed, "speed", "limits.speed", (1e3, "mm/s")
        ),
        *_capped(
            program,
            (lambda x: x.tolerances) if free else _at_corners,
            tolerance,
            "corner tolerance",
            "corners.tolerance",
            (1e3, "mm"),
        ),
    ]


def _at_corners(path: Path) -> FloatArray:
    """What the segments of a path allow its corners [m], (n,); NaN where they have no corner."""
    own = path.tolerances
    if len(own) == 1:
        return np.array([np.nan])
    bent = path.turns > TANGENT_TOLERANCE
    at = np.where(bent, np.fmin(own[:-1], own[1:]), np.nan)
    beside = np.fmax(np.append(np.nan, at), np.append(at, np.nan))
    return np.where(np.isnan(own), np.nan, beside)


def _capped(
    program: Program,
    own: Callable[[Path], FloatArray],
    cap: float | None,
    what: str,
    key: str,
    unit: tuple[float, str],
) -> list[str]:
    """One sentence on all values above a cap, or none."""
    if cap is None:
        return []
    above = [own(x.path) > cap * (1 + SAME) for x in program.contours]
    if not any(x.any() for x in above):
        return []
    asked = max(
        float(own(x.path)[y].max()) for x, y in zip(program.contours, above, strict=True) if y.any()
    )
    if program.single_path is not None:
        names = [f"segment {k + 1}" for k in np.flatnonzero(above[0])]
    else:
        names = [
            contour_called(x, i)
            for i, (x, y) in enumerate(zip(program.contours, above, strict=True))
            if y.any()
        ]
    scale, symbol = unit
    return [
        f"the {what} of up to {asked * scale:.6g} {symbol} of {list_some(names, MOST_NAMES)} is "
        f"capped at {cap * scale:.6g} {symbol} by {key}: raise {key} to have it."
    ]


def overloaded(executed: Execution, evaluation: Evaluation, this: Run) -> list[str]:
    """A warning for the joint whose demanded acceleration is farthest above its limit.

    Not for the method "conventional", which does not look at limits of joints.

    Args:
        executed: The executed motion.
        evaluation: Its evaluation.
        this: The run.
    """
    joint = int(evaluation.demand_ratio.argmax())
    ratio = float(evaluation.demand_ratio[joint])
    if ratio <= FAR_ABOVE or this.timing == Method.CONVENTIONAL:
        return []
    t = float(executed.t[int(np.abs(executed.demand[:, joint]).argmax())])
    reserve = (
        "a larger reserve" if this.reserve > 0 else "a reserve, such as timing: {reserve: 10 %}"
    )
    name = executed.arm.joint_names[joint]
    called = name if name.startswith("joint") else f"joint {name}"
    return [
        f"{called} is asked for {ratio:.3g} times its acceleration limit at {t:.4g} s and "
        f"saturates, and the tool is up to {evaluation.contour_error.max * 1e3:.3g} mm off its "
        f"path: give the plan {reserve}, a start near which the path needs less, slower poles, or "
        "limits and gains that are those of the plant."
    ]


def cut_off(taught: TaughtData) -> list[str]:
    """A warning for taught data whose transient after the motion is cut off."""
    if taught.cut_off is None or taught.cut_off.max() < UNFELT:
        return []
    j = int(np.argmax(taught.cut_off))
    return [
        "the servo's velocity feed-forward needs set-points long after the motion, which are cut "
        f"off: this adds up to {taught.cut_off[j] * 1e3:.3g} mrad to the error of joint {j + 1} "
        "after the end of the plan; a servo model with a larger kp or a "
        "velocity_feedforward nearer to 1 needs less."
    ]


def limited_commands(taught: TaughtData) -> list[str]:
    """A warning for set-points that limits of commands change, with the error that this causes."""
    if taught.limit_cost is None or taught.limit_cost.deviation.max() < UNFELT:
        return []
    return [
        f"command_limits change the set-points by {taught.limit_cost}; a plan with a larger "
        "timing.reserve, or with limits of jerk, needs smaller changes."
    ]


def oscillating(servo: ServoModel) -> list[str]:
    """A warning for the joint of order second with the least damping, if kv is below kp.

    The damping ratio is sqrt(kv / kp) / 2, from the characteristic polynomial of (6).
    """
    if servo.kv is None:
        return []
    kp, kv = (np.atleast_1d(x) for x in np.broadcast_arrays(servo.kp, servo.kv))
    ratio = np.where(np.isfinite(kv), kv, np.inf) / np.where(np.isfinite(kp), kp, 1.0)
    j = int(np.argmin(ratio))
    if ratio[j] >= 1:
        return []
    damping = math.sqrt(ratio[j]) / 2
    overshoot = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    return [
        f"servo gain kv of {kv[j]:g} 1/s is below kp of {kp[j]:g} 1/s{_of_joint(j, kp)}, so the "
        f"servo oscillates: its damping ratio is {damping:.2f}, and a step overshoots by "
        f"{overshoot:.0%}; from kv = 4 kp on, {4 * kp[j]:g} 1/s, a servo does not overshoot."
    ]


def _of_joint(j: int, gains: FloatArray) -> str:
    """Name of the joint j, counted from 0, if joints have different gains."""
    return f" at joint {j + 1}" if len(gains) > 1 and np.ptp(gains) > 0 else ""


def unsettled(executed: Execution) -> list[str]:
    """A warning for an execution that ends before the joints are at rest."""
    if executed.unsettled is None:
        return []
    j = int(np.argmax(executed.unsettled))
    waited = executed.t[-1] - executed.taught.t[-1]
    return [
        f"joint {j + 1} is not at rest {waited:.3g} s after its last set-point, but "
        f"{executed.unsettled[j] * 1e3:.3g} mrad from it: raise its servo gains or limits, or take "
        "the compensation inverse."
    ]


def missed_speeds(program: Program, trajectory: Trajectory, this: Run) -> list[str]:
    """A warning for the contours that are far slower than assigned, or none.

    Contours that are too short for the assigned velocity, and stops of the path, do not count.

    Args:
        program: The program that was planned.
        trajectory: Its plan.
        this: The run.
    """
    found = []
    spans = trajectory.contour_spans
    for i, (x, span) in enumerate(zip(program.contours, spans, strict=True)):
        if this.timing != Method.CONVENTIONAL and span.trajectory is not None:
            slow = _missed_speed(x.path, span.trajectory, this)
            found += [] if slow is None else [(*slow, contour_called(x, i))]
    if not found:
        return []
    mean, most, assigned, name = min(found, key=lambda x: x[0] / x[2])
    what = f"{name} moves"
    if len(found) > 1:
        what = (
            f"{len(found)} contours are far slower than assigned, most of all {name}, which moves"
        )
    return [
        f"{what} at {mean * 1e3:.3g} mm/s on average and {most * 1e3:.3g} mm/s at most in place of "
        f"{assigned * 1e3:.3g} mm/s: reduce the assigned velocity, or raise the limit that the "
        "report shows as active."
    ]


def _missed_speed(path: Path, motion: Trajectory, this: Run) -> tuple[float, float, float] | None:
    """Mean, largest and assigned speed [m/s] of a contour that is far slower than assigned."""
    most = np.inf if this.limits.speed is None else this.limits.speed
    speeds = np.fmin(path.speeds, most)
    ideal = float(np.sum(path.lengths / speeds))
    if not np.isfinite(ideal) or not np.isfinite(speeds).all() or motion.duration <= SLOW * ideal:
        return None
    t = motion.breaks
    s, v = motion.s(t), motion.s(t, 1)
    gone = np.minimum(s, path.length - s)
    inside = gone > ENDS * path.length
    acceleration = float((v[inside] ** 2 / (2 * gone[inside])).max(initial=0.0))
    assigned = float(speeds.max())
    stops = 1 + sum(count_full_stops(path).values())
    if acceleration * (motion.duration / SLOW - ideal) <= assigned * stops:
        return None
    return path.length / motion.duration, float(v.max()), assigned


def not_judged(on_servo: Evaluation) -> str:
    """A warning for a run whose set-points are for the arm's bodies, without an experiment.

    Args:
        on_servo: Evaluation on the servo model.
    """
    return (
        "its set-points are for the arm's bodies, so the servo model, which has none, does not "
        f"judge it (there the tool is up to {on_servo.contour_error.max * 1e3:.3g} mm off): give "
        "the job an experiment, such as experiment: {}."
    )


def worse_than_none(
    on_bodies: Evaluation, uncompensated: Evaluation | None, this: Run
) -> list[str]:
    """A warning for a compensation that increases the contour error on the arm's bodies, or none.

    Args:
        on_bodies: Evaluation of the experiment.
        uncompensated: Evaluation of the same plan without compensation; None if it is not known.
        this: The run.
    """
    if uncompensated is None:
        return []
    with_it, without = on_bodies.contour_error, uncompensated.contour_error
    if with_it.rms <= without.rms and with_it.max <= without.max:
        return []
    if this.for_bodies:
        why = (
            "the simulated robot has other gains, dead time, masses or gravity feed-forward than "
            "the compensation knows, or its drives saturate"
        )
    else:
        why = "it is for the servo model, not for bodies: compensation: {method: inverse_dynamics}"
    if this.experiment is not None and this.experiment.unknown:
        why += f"; nor does it know what the robot has: {this.experiment.unknown}"
    return [
        f"on rigid bodies the contour error is {with_it.rms * 1e3:.4g} mm RMS, "
        f"{with_it.max * 1e3:.4g} mm at most; without compensation {without.rms * 1e3:.4g} and "
        f"{without.max * 1e3:.4g} mm. The compensation {this.compensation} makes it worse, as "
        f"{why}."
    ]


def beyond_logs(servo: ServoModel, trajectory: Trajectory) -> str:
    """A warning for motion beyond that of the logs of the servo's identification, or empty.

    Args:
        servo: The servo.
        trajectory: The plan.
    """
    if servo.unexplained is None or servo.logged_velocity is None:
        return ""
    t = np.union1d(trajectory.breaks, np.linspace(0.0, trajectory.duration, LOOKS))
    return servo.describe_excess(trajectory(t, 1), trajectory(t, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class JerkStop:
    """A full stop inside a contour, at a place where the curvature jumps.

    Args:
        contour: What messages call the contour; empty for a single path.
        s: Arc length from the start of the contour [m].
        point: The place [m], 2 or 3 coordinates.
    """

    contour: str
    s: float
    point: tuple[float, ...]


def jerk_stops(
    program: Program, traced: Tracing | None, trajectory: Trajectory, this: Run
) -> list[JerkStop]:
    """The full stops inside contours that limits of jerk force, in order.

    Args:
        program: The program that was planned.
        traced: Its joint paths, if they are known.
        trajectory: Its plan.
        this: The run.
    """
    if traced is None or not this.limits.jerk_limits:
        return []
    return list(_find(program, traced, trajectory))


def _find(program: Program, traced: Tracing, trajectory: Trajectory) -> Iterator[JerkStop]:
    """The places where the plan rests, though the tool would not have to without these limits."""
    paths = {x.move: x.joint_path for x in traced.steps}
    spans = trajectory.contour_spans
    for i, (contour, span) in enumerate(zip(program.contours, spans, strict=True)):
        joint_path = paths.get(span.move)
        if joint_path is None or span.trajectory is None:
            continue
        for s in find_jerk_stops(joint_path, span.trajectory).tolist():
            called = "" if program.single_path is not None else contour_called(contour, i)
            yield JerkStop(contour=called, s=s, point=tuple(contour.path(s).tolist()))


def stopping(stops: Sequence[JerkStop], this: Run) -> list[str]:
    """One warning for all full stops that limits of jerk force, or none.

    Args:
        stops: The stops.
        this: The run.
    """
    if not stops:
        return []
    first, count = stops[0], len(stops)
    point = ", ".join(f"{1e3 * x:.4g}" for x in first.point)
    place = f"s = {first.s:.4g} m ({point} mm)"
    if first.contour:
        place = f"{place} of {first.contour}"
    called = (
        f"1 full stop at {place}" if count == 1 else f"{count} full stops, the first at {place}"
    )
    why = "where the curvature of the path jumps and limits of jerk allow no speed"
    return [f"{called}, {why}: {_mend(this)}."]


def _mend(this: Run) -> str:
    """What spares the tool such stops."""
    if this.continuity is None:
        return (
            "corners, such as corners: {tolerance: 0.1 mm}, join lines and arcs without such jumps"
        )
    if this.continuity == TANGENT:
        return "corners: {continuity: curvature} has no such jumps"
    return (
        f"a larger corners.transition_tolerance than {this.transition_tolerance * 1e6:.3g} um, "
        "longer lines and arcs, or a tool orientation that does not turn leaves fewer"
    )


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
    found = sorted(_find_slow_ends(program, trajectory, this), key=lambda x: x.cause)
    groups = [list(of) for _, of in groupby(found, key=lambda x: x.cause)]
    acceleration = this.limits.centripetal_acceleration
    return [_warn(of, math.inf if acceleration is None else acceleration) for of in groups]


def assigned_speed(contour: Contour, s: float, side: str, this: Run) -> float:
    """The assigned velocity of a contour at an arc length [m/s], on one side of a vertex."""
    most = np.inf if this.limits.speed is None else this.limits.speed
    return float(np.fmin(contour.path.speeds[contour.path.locate(s, side=side)], most))


def _find_slow_ends(program: Program, trajectory: Trajectory, this: Run) -> Iterator[SlowEnd]:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Weaving:
    """What the plan makes of the weave of a contour, where the weave has its full width.

    Args:
        contour: What messages call the contour.
        width: Smallest and largest distance between neighbouring crests, across the seam [m].
        frequency: Smallest and largest number of waves per second [1/s].
        asked: Width [m] and frequency [1/s] that were asked for; the frequency is NaN without an
            assigned velocity.
        left_out: Length of the seam that is not woven, in parts shorter than half a pitch [m].
        slowed_by: The limit that the plan reaches, in words.
    """

    contour: str
    width: tuple[float, float]
    frequency: tuple[float, float]
    asked: tuple[float, float]
    left_out: float
    slowed_by: str

    @property
    def sentence(self) -> str:
        """The widths and the frequencies."""
        width = _range(self.width, 1e3)
        frequency = _range(self.frequency, 1.0)
        return f"{self.contour} weaves {width} mm wide at {frequency} Hz."

    @property
    def warnings(self) -> list[str]:
        """Sentences on what differs from what was asked for."""
        found = []
        if max(abs(x - self.asked[0]) for x in self.width) > ALLOWED * self.asked[0]:
            found.append(
                f"{self.contour} weaves {_range(self.width, 1e3)} mm wide in place of "
                f"{self.asked[0] * 1e3:.4g} mm, because the corners of the weave are rounded: "
                "give a smaller corner tolerance, or the shape sine."
            )
        if self.frequency[0] < (1 - ALLOWED) * self.asked[1]:
            found.append(
                f"{self.contour} weaves at {_range(self.frequency, 1.0)} Hz in place of "
                f"{self.asked[1]:.4g} Hz, because {self.slowed_by} slows the tool down: give a "
                "lower velocity or frequency, a smaller width, or a higher limit."
            )
        if self.left_out:
            found.append(
                f"{self.contour} is not woven along {self.left_out * 1e3:.4g} mm of its seam, in "
                "parts between corners that are shorter than half a pitch."
            )
        return found


def weavings(program: Program, trajectory: Trajectory, limits: Limits) -> list[Weaving]:
    """What the plan makes of each weave.

    Args:
        program: The program that was planned.
        trajectory: Its plan.
        limits: Its limits.
    """
    pairs = zip(program.contours, trajectory.contour_spans, strict=True)
    found = (_weaving(i, x, span, limits) for i, (x, span) in enumerate(pairs))
    return [x for x in found if x is not None]


def _weaving(number: int, contour: Contour, span: Span, limits: Limits) -> Weaving | None:
    """What the plan makes of the weave of a contour; None without waves of full width."""
    woven, plan = contour.woven, span.trajectory
    if woven is None or plan is None or len(woven.crests) < 3:
        return None
    begin, end = (0.0, plan.duration) if span.work is None else span.work
    offset = 0.0 if span.work is None else span.t[0]
    count = int(SAMPLES * woven.seam.length / woven.pitch) + 2
    t = np.linspace(begin - offset, end - offset, count).clip(0.0, plan.duration)
    near = woven.seam.project(contour.path(plan.s(t).clip(0.0, contour.path.length)))
    # The tool may stop or turn, but along the seam it only goes on.
    s = np.maximum.accumulate(near.s)
    at = np.interp(woven.crests, s, t)
    heights = _heights(s, near.distance, woven.crests, woven.pitch / 4)
    widths, times = heights[:-1] + heights[1:], at[2:] - at[:-2]
    # Crests of two parts of the seam belong to no common wave.
    same = np.diff(woven.crests) < 0.75 * woven.pitch
    widths, times = widths[same], times[same[:-1] & same[1:]]
    if not len(times):
        return None
    return Weaving(
        contour=contour_called(contour, number),
        width=(float(widths.min()), float(widths.max())),
        frequency=(float(1 / times.max()), float(1 / times.min())),
        asked=(woven.width, woven.frequency),
        left_out=woven.left_out,
        slowed_by=_slowed_by(contour.path, plan, limits),
    )


def _slowed_by(path: Path, plan: Trajectory, limits: Limits) -> str:
    """The limit that slows a weave: of the centripetal acceleration if it is reached."""
    limit = limits.centripetal_acceleration
    s = (path.breaks[:-1] + path.breaks[1:]) / 2
    reached = float((np.abs(path.curvatures) * plan.speed_at(s) ** 2).max())
    if limit is None or reached < REACHED * limit:
        return "a limit of the joints or of the tool"
    return f"limits.centripetal_acceleration of {limit:.4g} m/s²"


def _heights(s: FloatArray, off: FloatArray, crests: FloatArray, reach: float) -> FloatArray:
    """Largest distances from the seam near crests [m], (n,)."""
    first, last = np.searchsorted(s, crests - reach), np.searchsorted(s, crests + reach)
    return np.array([off[i:j].max(initial=0.0) for i, j in zip(first, last, strict=True)])


def _range(pair: tuple[float, float], scale: float) -> str:
    """Two numbers as text, or one if they are printed alike."""
    low, high = (f"{scale * x:.3g}" for x in pair)
    return low if low == high else f"{low} to {high}"
