"""When a trajectory passes a place of its path."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.geometry import Path
from armcontour.motion import PathLaw, Trajectory, interval_times

# Without s(t), the way of the tool is measured over so many times between two breaks.
SAMPLES = 20
# Halvings of the time between two of them: to its last digit.
HALVINGS = 50


def time_at(trajectory: Trajectory, arm: Arm, path: Path, s: float) -> float:
    """When the motion gets to a place [s]; the first time, where it stands there.

    Args:
        trajectory: Along a path, from its start to its end.
        arm: The arm that moves.
        path: The path.
        s: The place [m].
    """
    if s <= 0:
        return 0.0
    if s >= path.length:
        return trajectory.duration
    for start, law in zip(trajectory.starts[:-1], trajectory.laws, strict=True):
        if not isinstance(law, PathLaw):
            return _measured(trajectory, arm, path, s)
        if s <= law.s[-1]:
            return float(start) + _along(law, s)
    return trajectory.duration


def _along(law: PathLaw, s: float) -> float:
    """The closed form on the interval that holds the place."""
    i = int(np.clip(np.searchsorted(law.s, s, side="left") - 1, 0, len(law.s) - 2))
    width = s - law.s[i]
    ds, dds, slope = law.rates[i]
    # ds² grows by the integral of 2 dds over s, in which dds is linear.
    end = np.sqrt(max(ds * ds + width * (2 * dds + slope * width), 0.0))
    if width <= 0 or ds + end == 0:
        return float(law.breaks[i])
    since = interval_times(*(np.array([x]) for x in (width, ds, end, slope)))[0]
    return float(min(law.breaks[i] + since, law.breaks[i + 1]))


def _measured(trajectory: Trajectory, arm: Arm, path: Path, s: float) -> float:
    """For laws that do not know s: near where the tool has gone so far, when it is at the place."""
    ends = trajectory.breaks
    share = np.arange(SAMPLES) / SAMPLES
    t = np.append((ends[:-1, None] + share * np.diff(ends)[:, None]).ravel(), ends[-1])
    speed = np.linalg.norm(arm.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1)
    gone = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))])
    i = int(np.searchsorted(gone, s * gone[-1] / path.length))
    near = t[max(i - SAMPLES, 0) : i + SAMPLES + 1]
    point, tangent = path(s), path(s, 1, side="left")

    def ahead(at: FloatArray) -> FloatArray:
        return np.asarray((arm.forward(trajectory(at)) - point) @ tangent)

    passed = np.flatnonzero((ahead(near[:-1]) < 0) & (ahead(near[1:]) >= 0))
    if not len(passed):
        # A corner where the tool stands: it comes to the place, and not by it.
        away = np.linalg.norm(arm.forward(trajectory(near)) - point, axis=1)
        return float(near[int(np.argmin(away))])
    nearest = passed[int(np.argmin(np.abs(near[passed] - t[min(i, len(t) - 1)])))]
    low, high = near[nearest], near[nearest + 1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if ahead(np.array([middle]))[0] < 0 else (low, middle)
    return float(high)
