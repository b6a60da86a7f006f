"""Planned and assigned tool speeds along what is followed, contour behind contour."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.jobs import RunResult
from armcontour.motion import PathLaw, Trajectory

# A path, its law or else None, when it begins and ends [s], and the length before it [m].
Followed = tuple[Path, PathLaw | None, tuple[float, float], float]
GAP = np.array([np.nan])


def planned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray] | None:
    """Arc length of all contours and planned tool speed there, with gaps (NaN) between contours.

    None for a plan that is not run along a joint path.
    """
    laws = [(law, offset) for _, law, _, offset in _followed(result) if law is not None]
    if not laws:
        return None
    s = [y for law, offset in laws for y in (offset + law.s, GAP)]
    speed = [y for law, _ in laws for y in (law.speeds, GAP)]
    return np.concatenate(s)[:-1], np.concatenate(speed)[:-1]


def assigned_speeds(result: RunResult) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Times, arc lengths and assigned velocity as steps, likewise; None where none is assigned."""
    most = np.inf if result.run.limits.speed is None else result.run.limits.speed
    found = []
    for path, law, (begin, end), offset in _followed(result):
        # Without a law that says when it is where, only what holds all along can be told.
        times = np.array([begin, end]) if law is None else begin + law.breaks
        places = np.array([0.0, path.length]) if law is None else law.s
        middle = (places[:-1] + places[1:]) / 2
        value = np.fmin(path.speeds[path.locate(middle)], most)
        if law is None and np.unique(path.speeds).size > 1:
            value[:] = np.nan
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


def _followed(result: RunResult) -> list[Followed]:
    """Everything that is followed, in order."""
    plan = result.trajectory
    if isinstance(result.path, Path):
        return [(result.path, _law(plan), (0.0, plan.duration), 0.0)]
    spans = plan.contour_spans
    return [
        (x.path, _law(span.trajectory), span.t, span.s[0])
        for x, span in zip(result.path.contours, spans, strict=True)
    ]


def _law(plan: Trajectory | None) -> PathLaw | None:
    first = None if plan is None else plan.laws[0]
    return first if isinstance(first, PathLaw) else None
