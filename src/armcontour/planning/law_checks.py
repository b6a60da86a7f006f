"""Time laws and limit checks that several timing methods share."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NoReturn

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.geometry import Path
from armcontour.motion import JointPath, Law, LawAlongPath, PathLaw, Rates
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States
from armcontour.robot.limits import LIMITS

# Samples per smooth piece of a law. A piece turns by half a radian at most, so the sampled peak is
# less than 1e-4 below the true peak.
PEAK_SAMPLES = 33
# Rounding error by which a law may exceed a limit, as a fraction of the limit
LIMIT_ROUNDING = 1e-6


def tool_path_of(joint_path: JointPath, method: str) -> Path:
    """Return the tool path of a joint path, which the method requires."""
    if joint_path.tool_path is None:
        raise InvalidInput(
            f"The method {method} plans along a tool path, but this joint path has none. Pass "
            "a Path to plan, or the joint path that trace returns for it."
        )
    return joint_path.tool_path


def require_speed(limits: Limits, method: str) -> float:
    """Return the assigned velocity [m/s], which the method requires."""
    if limits.speed is None:
        raise InvalidInput(
            f"The method {method} needs an assigned velocity, but no limit speed is specified. "
            "Specify the limit speed [m/s]."
        )
    return limits.speed


def path_law(joint_path: JointPath, s: FloatArray, start: FloatArray, end: FloatArray) -> PathLaw:
    """Time law with constant path acceleration on each interval.

    - `s`: arc lengths of the interval ends [m], (n + 1,).
    - `start`: tool speed at the start of each interval [m/s], (n,).
    - `end`: tool speed at the end of each interval [m/s], (n,).
    """
    lengths = np.diff(s)
    times = 2 * lengths / (start + end)
    none = np.zeros_like(lengths)
    rates = Rates(ds=start, dds=(end - start) / times, slope=none, jerk=none)
    return PathLaw(
        joint_path=joint_path, breaks=np.concatenate([[0.0], np.cumsum(times)]), s=s, rates=rates
    )


def law_peaks(laws: Sequence[Law], arm: Arm) -> dict[str, Any]:
    """Peak joint accelerations, (dof,), and peak tool speed of laws, as fields of `LawPhase`."""
    states = [law_states(x, arm) for x in laws]
    return {
        "demand": np.max([np.abs(x.ddq).max(axis=0) for x in states], axis=0),
        "speed": max(float(x.measure("speed")[0].max()) for x in states),
    }


def law_states(law: Law, arm: Arm) -> States:
    """Joint states at the samples of a law."""
    i, t = sample_times(law)
    return States(arm, law.motion(i, t))


def sample_times(law: Law) -> tuple[IntArray, FloatArray]:
    """Sample times of a law, dense enough to include its peaks."""
    # Returns the interval of each sample, (n,), and its time [s], (n,).
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
