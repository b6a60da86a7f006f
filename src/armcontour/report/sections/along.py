"""Planned and assigned tool speeds along what is followed, contour after contour."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.jobs import RunResult
from armcontour.motion import Trajectory

# A path, its motion, when that begins [s], and the length before it [m].
Followed = tuple[Path, Trajectory, float, float]
GAP = np.array([np.nan])


def planned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Arc length of all contours and planned tool speed there, with gaps (NaN) between contours."""
    s, speed = [], []
    for _, motion, _, offset in _list_followed(result):
        t = motion.breaks
        s += [offset + motion.s(t), GAP]
        speed += [motion.s(t, 1), GAP]
    return np.concatenate(s)[:-1], np.concatenate(speed)[:-1]


def assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Times, arc lengths and assigned velocity as steps; None where none is assigned."""
    most = np.inf if result.run.limits.speed is None else result.run.limits.speed
    found = []
    for path, motion, begin, offset in _list_followed(result):
        times, places = begin + motion.breaks, motion.s(motion.breaks)
        middle = (places[:-1] + places[1:]) / 2
        value = np.fmin(path.speeds[path.locate(middle)], most)
        value[~np.isfinite(value)] = np.nan
        # Only where it changes: a contour may have a hundred thousand segments of one speed.
        same = np.isclose(value[1:], value[:-1], rtol=1e-12, equal_nan=True)
        edges = np.concatenate([[0], np.flatnonzero(~same) + 1, [len(value)]])
        steps = np.repeat(edges, 2)[1:-1]
        found.append((times[steps], offset + places[steps], value[edges[:-1]]))
    if not any(np.isfinite(x[2]).any() for x in found):
        return None
    t, s = (np.concatenate([y for x in found for y in (x[i], GAP)]) for i in (0, 1))
    return t, s, np.concatenate([y for x in found for y in (np.repeat(x[2], 2), GAP)])


def _list_followed(result: RunResult) -> list[Followed]:
    """Everything that is followed, in order."""
    plan = result.trajectory
    if isinstance(result.path, Path):
        return [(result.path, plan, 0.0, 0.0)]
    spans = plan.contour_spans
    return [
        (x.path, span.trajectory, span.t[0], span.s[0])
        for x, span in zip(result.path.contours, spans, strict=True)
        if span.trajectory is not None
    ]
