"""Sentences on weak points of a run: what was capped, and joints that are asked for too much."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armcontour._checks import FloatArray
from armcontour._text import list_some
from armcontour.arms import Arm
from armcontour.arms.limits import UNITS
from armcontour.evaluation import Evaluation, check
from armcontour.geometry import Path
from armcontour.jobs.job import Run
from armcontour.motion import Execution, Method, Trajectory
from armcontour.program import Program, contour_called

# So many contours or segments are named in one sentence.
MOST_NAMES = 4
# Values that differ by less than this share are the same.
SAME = 1e-9
# A joint that is asked for this multiple of its acceleration limit is far above it.
FAR_ABOVE = 1.5
# Random times per interval of a smoothed plan at which its limits are looked at, beside its breaks.
LOOKS = 4


def capped(program: Program, this: Run) -> list[str]:
    """Warnings for speeds and corner tolerances of the path that the run allows less of.

    Args:
        program: The program with sharp corners.
        this: The run.
    """
    tolerance = None if this.rounding is None else this.rounding.tolerance
    return [
        *_capped(
            program, lambda x: x.speeds, this.limits.speed, "speed", "limits.speed", (1e3, "mm/s")
        ),
        *_capped(
            program,
            lambda x: x.tolerances,
            tolerance,
            "corner tolerance",
            "corners.tolerance",
            (1e3, "mm"),
        ),
    ]


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


def smoothed_beyond(trajectory: Trajectory, program: Program, arm: Arm, this: Run) -> list[str]:
    """A warning for the limit that a smoothed plan exceeds most, or none.

    Args:
        trajectory: The smoothed plan.
        program: The program that it follows.
        arm: The arm.
        this: The run.
    """
    found = check(trajectory, arm, this.limits, program, points=LOOKS).violations
    beyond = [x for x in found if x.name in UNITS]
    if not beyond:
        return []
    worst = max(beyond, key=lambda x: x.certain)
    who = "the tool" if worst.joint is None else arm.joint_names[worst.joint - 1]
    # A reserve is left of every limit at once, so the motion gets slower, too: it is enough.
    reserve = this.reserve + (1 - this.reserve) * (1 - 1 / worst.certain)
    others = [x.name for x in beyond if x is not worst]
    more = f" (and exceeds {list_some(others, MOST_NAMES)}, too)" if others else ""
    return [
        f"smoothing takes {who} to {worst.certain:.3g} times its {worst.name} of "
        f"{worst.limit:.4g} {UNITS[worst.name]} at {worst.t:.4g} s{more}, where the path bends: "
        f"take shorter windows, or a reserve, such as timing: {{reserve: "
        f"{math.ceil(reserve * 100)} %}}; armcontour certify smooths plans within the limits."
    ]
