"""Limit checks of time laws that several timing methods share."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NoReturn

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import Law, LawAlongPath, PathLaw
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States
from armcontour.robot.limits import LIMITS

# Samples per smooth piece of a law. A piece turns by half a radian at most, so the sampled peak is
# less than 1e-4 below the true peak.
PEAK_SAMPLES = 33
# Rounding error by which a law may exceed a limit, as a fraction of the limit
LIMIT_ROUNDING = 1e-6


def law_states(law: Law, arm: Arm) -> States:
    """Return the joint states at the samples of a law, see `sample_times`."""
    i, t = sample_times(law)
    return States(arm, law.motion(i, t))


def sample_times(law: Law) -> tuple[IntArray, FloatArray]:
    """Return the interval of each sample of a law, (n,), and its time [s], (n,).

    The samples are dense enough to include the peaks of the law.
    """
    knots = law.breaks
    if isinstance(law, PathLaw):
        knots = np.unique(np.append(knots, law.passages))
    count = PEAK_SAMPLES if isinstance(law, PathLaw) else 3
    grid = np.linspace(knots[:-1], knots[1:], count)
    interval = np.searchsorted(law.breaks, (knots[:-1] + knots[1:]) / 2, side="right") - 1
    return np.broadcast_to(interval, grid.shape).ravel(), grid.ravel()


def check_limits(
    laws: Sequence[LawAlongPath],
    arm: Arm,
    limits: Limits,
    *,
    ignored: Collection[str],  # Fields of `Limits` that are not checked
    location: str,  # First words of the error message; the arc length follows
    t: float,  # Start time of the first law [s]
    remedy: str,  # Last sentence of the error message, without a period
) -> None:
    """Raise NotRealizable if a law exceeds a limit at a sample; joint ranges are not checked."""
    names = (name for name, x in LIMITS.items() if x.order and name not in ignored)
    limited = [name for name in names if getattr(limits, name) is not None]
    start = t
    for law in laws if limited else ():
        states = law_states(law, arm)
        for name in limited:
            use = states.use(name, limits)
            ratio = use.ratio
            if ratio.max() <= 1 + LIMIT_ROUNDING:
                continue
            index = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
            joint = int(index[1]) if len(index) == 2 else None
            needed = use.value[index]
            limit = np.broadcast_to(use.limit, ratio.shape)[index]
            subject = "the tool" if joint is None else f"joint {joint + 1}"
            unit = f"{LIMITS[name].unit}"
            turning = " of turning" if LIMITS[name].kind == "rotation" else ""
            intervals, times = sample_times(law)
            s = float(law.path_position(intervals[index[0]], times[index[0]]))
            raise NotRealizable(
                f"{location}, at {s:.4g} m, {subject} would need {needed:.4g} {unit}{turning}"
                f", but its limit is {limit:.4g} {unit}. "
                f"{remedy}.",
                s=s,
                t=start + float(times[index[0]]),
                joint=joint,
                limit=name,
                needed=float(needed),
                allowed=float(limit),
            )
        start += float(law.breaks[-1])


def raise_too_fast(
    name: str, x: float, allowed: float, s: float, *, free_rotation: bool = False
) -> NoReturn:
    """Raise the error for a start or end speed; `x` and `allowed` are squared speeds [m²/s²].

    `free_rotation`: true if the joint path is one of many for the path of the tool, and may be
    another one for other limits. Then the largest speed of this joint path is no general figure.
    """
    most = f"the limits allow about {np.sqrt(max(allowed, 0.0)):.6g} m/s."
    if free_rotation:
        most = (
            "the limits do not allow it with the rotation about the tool axis that was chosen. "
            "Lower it, plan with another limit speed, for which another rotation may be chosen, or "
            "specify the whole orientation."
        )
    raise NotRealizable(
        f"The {name} speed of {np.sqrt(x):.6g} m/s is too high. At {s:.6g} m along the path {most}",
        s=s,
        limit=f"{name} speed",
        needed=float(np.sqrt(x)),
        allowed=None if free_rotation else float(np.sqrt(max(allowed, 0.0))),
    )
