"""Shaped paths made by hand: arcs at the corners, and waves along the lines."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour.geometry import Outcome, Path, ShapedPath, round_corners
from armcontour.geometry.fit import draw_with_arcs
from armcontour.jobs import Job, Study, run
from armcontour.program import Contour, Program, put_on_path

WAVE = 0.3


def shaped_by_hand(objective: Path, tolerance: float) -> ShapedPath:
    """A path within the tolerance of an objective path that leaves its lines, too."""
    arcs = round_corners(objective, tolerance=0.6 * tolerance, angular_tolerance=0.01)
    s = np.linspace(0.0, objective.length, 150)
    at = arcs.place(s)
    along = arcs(at, 1)
    side = np.zeros_like(along)
    side[:, 0], side[:, 1] = -along[:, 1], along[:, 0]
    wave = WAVE * tolerance * np.sin(np.pi * s / objective.length * 6)
    # Shaped paths consist of arcs.
    path, _ = draw_with_arcs(Path.spline(arcs(at) + wave[:, None] * side), 1e-6)
    if objective.orientation is not None:
        path = path.oriented(objective.orientation(0.0))
    back = path.project(arcs(at) + wave[:, None] * side).s
    places = np.stack([s, np.maximum.accumulate(back)], axis=1)
    places[[0, -1], 1] = 0.0, path.length
    durations = {"arcs": 5.0, "stops": 5.1, "shaped": 4.5}
    return ShapedPath(
        segments=path.segments,
        orientation=path.orientation,
        objective=objective,
        places=places,
        tolerance=tolerance,
        outcome=Outcome(start="arcs", durations=durations, history=(4.9, 4.6, 4.5)),
    )


def study_of_shaped(job: Job, tolerance: float) -> Study:
    """The study of a job whose contours were shaped by hand."""
    shaped = [
        put_on_path(x, shaped_by_hand(x.path, tolerance)) if isinstance(x, Contour) else x
        for x in job.program.moves
    ]
    runs = tuple(dataclasses.replace(x, rounding=None, timing="optimal") for x in job.runs)
    replaced = dataclasses.replace(job, path=Program(moves=tuple(shaped)), runs=runs)
    done = run(replaced)
    return Study(
        job=job,
        runs={name: dataclasses.replace(x, objective=job.program) for name, x in done.runs.items()},
    )
