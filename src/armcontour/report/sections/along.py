"""Tool speeds along all contours, and the executed samples of every contour."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.jobs import RunResult
from armcontour.motion import Execution, Trajectory
from armcontour.program import Program

# A path, its motion, the start of the motion [s], and the length of all paths before it [m].
Followed = tuple[Path, Trajectory, float, float]
GAP = np.array([np.nan])


def planned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray]:
    """Arc length over all contours [m] and planned tool speed [m/s], with gaps (NaN) between."""
    s, speed = [], []
    for _, motion, _, offset in _list_followed(result):
        t = motion.breaks
        s += [offset + motion.s(t), GAP]
        speed += [motion.s(t, 1), GAP]
    return np.concatenate(s)[:-1], np.concatenate(speed)[:-1]


def assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Times, arc lengths and assigned velocity as a step curve; None if no velocity is assigned."""
    most = np.inf if result.run.limits.speed is None else result.run.limits.speed
    found = []
    for path, motion, start, offset in _list_followed(result):
        times, places = start + motion.breaks, motion.s(motion.breaks)
        middle = (places[:-1] + places[1:]) / 2
        value = np.fmin(path.speeds[path.locate(middle)], most)
        value[~np.isfinite(value)] = np.nan
        # Only changes are drawn: a contour may have 100,000 segments of one speed.
        same = np.isclose(value[1:], value[:-1], rtol=1e-12, equal_nan=True)
        edges = np.concatenate([[0], np.flatnonzero(~same) + 1, [len(value)]])
        steps = np.repeat(edges, 2)[1:-1]
        found.append((times[steps], offset + places[steps], value[edges[:-1]]))
    if not any(np.isfinite(x[2]).any() for x in found):
        return None
    t, s = (np.concatenate([y for x in found for y in (x[i], GAP)]) for i in (0, 1))
    return t, s, np.concatenate([y for x in found for y in (np.repeat(x[2], 2), GAP)])


def executed_contours(execution: Execution, program: Program) -> list[tuple[Path, int, int]]:
    """The path of every contour, and the indices of its first and after its last executed sample.

    Samples before and after the motion belong to the first and the last contour.
    """
    trajectory, last = execution.taught.trajectory, len(execution.t)
    found = []
    for x, span in zip(program.contours, trajectory.contour_spans, strict=True):
        start, end = np.searchsorted(execution.t, span.t).tolist()
        # At least two samples, also of a very short contour.
        start = 0 if span.t[0] <= 0 else min(start, last - 2)
        end = last if span.t[1] >= trajectory.duration else max(end + 1, start + 2)
        found.append((x.path, start, end))
    return found


def _list_followed(result: RunResult) -> list[Followed]:
    """All contours with a planned motion, in order."""
    spans = result.trajectory.contour_spans
    return [
        (x.path, span.trajectory, span.t[0], span.s[0])
        for x, span in zip(result.path.contours, spans, strict=True)
        if span.trajectory is not None
    ]
