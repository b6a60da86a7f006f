"""Sentences on weak points of a run: what was capped, and joints that are asked for too much."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour._text import list_some
from armcontour.arms import Arm
from armcontour.arms.limits import UNITS
from armcontour.evaluation import Evaluation, LimitUse, check
from armcontour.geometry import Path
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.jobs.job import Run
from armcontour.motion import Execution, Method, Trajectory
from armcontour.program import Program, contour_called
from armcontour.timing import RESERVED

# So many contours or segments are named in one sentence.
MOST_NAMES = 4
# Values that differ by less than this share are the same.
SAME = 1e-9
# A joint that is asked for this multiple of its acceleration limit is far above it.
FAR_ABOVE = 1.5
# Limits of a smoothed plan are looked at this often [s], and once between; an excess below this
# share is not said.
LOOK = 1e-3
UNSEEN = 1e-3
# A largest error is left from before where a contour begins with this share of it. It is told if it
# is this multiple of what comes later, and so large [m]. A dwell is told in steps of this [s].
LEFT, MUCH_LARGER, LEAST_UNSETTLED = 0.3, 1.5, 1e-5
STEP_OF_DWELL = 10e-3
# Drive cycle whose delay a plan at the full limit is judged with [s]; drives have cycles of 0.25
# to 4 ms. The cost is reported if the RMS error grows by this factor.
DRIVE_CYCLE = 1e-3
COSTLY = 2.0
# The compensation whose set-points are for rigid bodies, and set-points that are the plan's.
INVERSE_DYNAMICS = "inverse_dynamics"
NONE = "none"


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


def unsettled(evaluation: Evaluation, trajectory: Trajectory, program: Program) -> list[str]:
    """A warning where the largest error is left from the move before a contour, or none.

    Args:
        evaluation: The evaluation of an execution.
        trajectory: Its plan.
        program: The program that was planned.
    """
    settling = evaluation.settled - evaluation.duration
    found: list[tuple[float, str]] = []
    later = 0.0
    spans = [x for x in trajectory.spans if x.trajectory is not None]
    contours = enumerate(zip(evaluation.contours, program.contours, strict=True))
    for k, span in enumerate(spans):
        if span.kind != "contour":
            continue
        number, (error, contour) = next(contours)
        settled = error.t > span.t[0] + settling
        later = max(later, float(error.values[settled].max(initial=0.0)))
        moved = k > 0 and span.t[0] - spans[k - 1].t[1] < settling
        if moved and not settled.all() and error.t_max <= span.t[0] + settling:
            # A tool that had settled would begin at the path.
            if error.values[0] >= LEFT * error.max:
                found.append((error.max, contour_called(contour, number)))
    ruling = [x for x in found if x[0] > max(MUCH_LARGER * later, LEAST_UNSETTLED)]
    if not ruling:
        return []
    most, name = max(ruling, key=lambda x: x[0])
    where = f"where {name} begins"
    if len(ruling) > 1:
        where = f"where {len(ruling)} contours begin, most at {name},"
    dwell = math.ceil(settling / STEP_OF_DWELL) * STEP_OF_DWELL
    return [
        f"{where} the tool has not settled from the move before: it is up to {most * 1e3:.3g} mm "
        f"off its path there, and {later * 1e3:.3g} mm at most after that: process.dwell: "
        f"{dwell * 1e3:.0f} ms lets it settle before each contour."
    ]


def sensitive_to_delay(evaluation: Evaluation, delayed: Evaluation | None) -> list[str]:
    """A warning for a plan at the full limit that one cycle of unknown delay makes inaccurate.

    Args:
        evaluation: Its evaluation on the servo model.
        delayed: The same on a servo with `DRIVE_CYCLE` of delay between its loops; None if the
            plan is not at the full limit.
    """
    if delayed is None or not delayed.saturated.any():
        return []
    before, after = evaluation.contour_error.rms, delayed.contour_error.rms
    if after <= COSTLY * before:
        return []
    return [
        "the plan uses the full joint acceleration. One drive cycle "
        f"({DRIVE_CYCLE * 1e3:g} ms) of delay that the servo model does not have raises the "
        f"contour error from {before * 1e3:.3g} to {after * 1e3:.3g} mm RMS, because the servo "
        "saturates; timing: {reserve: 2 %} leaves acceleration to correct it."
    ]


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
    if this.compensation == INVERSE_DYNAMICS:
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


@dataclass(frozen=True, slots=True)
class _Thinned:
    """A motion as a law with breaks every LOOK, and where its path bends anew.

    A smoothed plan has a hundred thousand breaks in a few seconds, but jumps there only.
    """

    motion: Trajectory
    breaks: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        motion, end = self.motion, self.motion.duration
        bends = np.zeros(0) if motion.path is None else motion.time_at(motion.path.breaks)
        t = np.unique(np.concatenate([np.arange(0.0, end, LOOK), bends]).clip(0.0, end))
        object.__setattr__(self, "breaks", np.append(t[t < end], end))

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return self.motion.duration

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Joint positions, velocities or accelerations, (n, dof)."""
        return self.motion(t, order, side=side)


def smoothed_beyond(trajectory: Trajectory, arm: Arm, this: Run) -> list[str]:
    """A warning for the limit that a smoothed plan exceeds most, or none.

    Args:
        trajectory: The smoothed plan.
        arm: The arm.
        this: The run.
    """
    beyond: dict[str, LimitUse] = {}
    for span in trajectory.spans or trajectory.contour_spans:
        if span.trajectory is None:
            continue
        on, limits = span.trajectory.path, this.limits
        if span.kind != "contour":
            on, limits = None, limits.of_joints
        for x in check(_Thinned(span.trajectory), arm, limits, on, points=1).uses:
            known = x.name in UNITS and x.certain > 1 + UNSEEN
            if known and (x.name not in beyond or x.certain > beyond[x.name].certain):
                beyond[x.name] = replace(x, t=x.t + span.t[0])
    if not beyond:
        return []
    worst = max(beyond.values(), key=lambda x: x.certain)
    who = "the tool" if worst.joint is None else arm.joint_names[worst.joint - 1]
    mend = "take shorter windows"
    if worst.name in RESERVED:
        # With a reserve the motion gets slower, too: this one is enough.
        reserve = this.reserve + (1 - this.reserve) * (1 - 1 / worst.certain)
        mend += f", or a reserve, such as timing: {{reserve: {math.ceil(reserve * 100)} %}}"
    others = [name for name, x in beyond.items() if x is not worst]
    more = f" (and exceeds {list_some(others, MOST_NAMES)}, too)" if others else ""
    return [
        f"smoothing takes {who} to {worst.certain:.4g} times its {worst.name} of "
        f"{worst.limit:.4g} {UNITS[worst.name]} at {worst.t:.4g} s{more}, where the path bends: "
        f"{mend}; armcontour certify smooths plans within the limits."
    ]
