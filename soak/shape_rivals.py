"""Shapes that a shaped path may not be slower than: arcs, parabolas made here, and full stops."""

from __future__ import annotations

import numpy as np

import armcontour as ac
from armcontour.geometry import Segments
from soak.shape_matching import excess, match
from soak.shape_problems import Problem, hold_tool, pieces_of

# Arcs per parabola, as long as they are not shorter than this [m]: directions of tiny arcs are lost
# in the rounding errors of their ends.
ARCS, SHORTEST = 48, 2e-6
# Places per segment at which a shape is to keep its tolerance.
PLACES = 400


def time_rivals(planned: ac.Trajectory, problem: Problem) -> dict[str, float]:
    """Durations of the fastest motions along shapes within the tolerance, by their names [s]."""
    objective, tolerance = problem.objective, problem.options["tolerance"]
    shapes = {
        "arcs": ac.round_corners(objective, tolerance=tolerance),
        "parabolas": draw_parabolas(objective, tolerance, problem.hold),
        "stops": objective,
    }
    options = {} if objective.dimension == 2 else {"start": planned(0.0)}
    found = {}
    for name, path in shapes.items():
        if name != "stops" and "zone" in problem.options and not _fits(path, problem):
            continue
        try:
            found[name] = ac.plan(path, problem.arm, problem.limits, **options).duration
        except ac.ArmContourError:
            continue
    return found


def _fits(path: ac.Path, problem: Problem) -> bool:
    """Whether a path keeps the tolerances."""
    share = np.linspace(0, 1, PLACES)[:-1]
    s = np.append((path.breaks[:-1, None] + share * path.lengths[:, None]).ravel(), path.length)
    points, pieces = path(np.minimum(s, path.length)), pieces_of(problem)
    matching = match(points, pieces)
    return matching.lost < 0 and excess(points, pieces, matching).max() <= 1e-12


def draw_parabolas(objective: ac.Path, tolerance: float, hold: str = "") -> ac.Path:
    """The path with a parabola at every corner between two lines, drawn as many arcs.

    A parabola has legs of equal length, half of the shorter line at most, and its middle is nearest
    to the corner: with a leg L and half a turn h it is L sin(h) / 2 away.
    """
    own = np.fmin(np.where(np.isnan(objective.tolerances), np.inf, objective.tolerances), tolerance)
    legs = np.zeros(len(objective) + 1)
    for k, turn in enumerate(objective.turns, 1):
        beside = slice(k - 1, k + 1)
        if objective.curvatures[beside].any() or not 1e-9 < turn < np.pi - 1e-9:
            continue
        leg = 2 * own[beside].min() / np.sin(turn / 2)
        leg = min(leg, objective.lengths[beside].min() / 2)
        legs[k] = leg if leg > 4 * SHORTEST else 0.0
    rows: list[tuple] = []
    for k in range(len(objective)):
        table, demand = objective.segments, (objective.speeds[k], objective.tolerances[k])
        vector = (table.normals[k], table.curvatures[k])
        length = table.lengths[k] - legs[k] - legs[k + 1]
        start = table.starts[k] + legs[k] * table.tangents[k]
        if length > 1e-12:
            rows.append((start, table.tangents[k], *vector, length, *demand))
        if legs[k + 1]:
            corner, ahead = table.starts[k + 1], table.tangents[k + 1]
            after = (objective.speeds[k + 1], objective.tolerances[k + 1])
            rows += _parabola(corner, table.tangents[k], ahead, legs[k + 1], demand, after)
    columns = [np.array(x, dtype=float) for x in zip(*rows, strict=True)]
    names = ("starts", "tangents", "normals", "curvatures", "lengths", "speeds", "tolerances")
    segments = Segments(**dict(zip(names, columns, strict=True)))
    return hold_tool(ac.Path(segments=segments), hold)


def _parabola(corner, before, ahead, leg, demand, after):
    """Rows of arcs, two between any two points of the parabola that share its tangents."""
    count = int(np.clip(leg / SHORTEST, 4, ARCS)) // 4 * 2
    u = np.linspace(0, 1, count + 1)[:, None]
    points = corner + leg * (u**2 * ahead - (1 - u) ** 2 * before)
    tangents = (1 - u) * before + u * ahead
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    rows = []
    for k in range(count):
        chord, both = points[k + 1] - points[k], tangents[k] + tangents[k + 1]
        bend = 2 * (1 - tangents[k] @ tangents[k + 1])
        # The root that stays where the tangents are nearly the same.
        root = np.sqrt((chord @ both) ** 2 + bend * (chord @ chord))
        d = (chord @ chord) / (chord @ both + root)
        middle = (points[k] + points[k + 1] + d * (tangents[k] - tangents[k + 1])) / 2
        own = demand if k < count // 2 else after
        for start, tangent, end in (
            (points[k], tangents[k], middle),
            (middle, None, points[k + 1]),
        ):
            if tangent is None:
                tangent = _end_tangent(rows[-1])
            rows.append((*_arc(start, tangent, end), *own))
    return rows


def _arc(start, tangent, end):
    """The arc from a point along a tangent to another point: a row without demands."""
    w = end - start
    along = w @ tangent
    across = w - along * tangent
    off = np.linalg.norm(across)
    if off < 1e-15:
        return start, tangent, 0 * tangent, 0.0, along
    bend = 2 * off / (w @ w)
    return start, tangent, across / off, bend, 2 * np.arctan2(off, along) / bend


def _end_tangent(row):
    _, tangent, normal, bend, length, *_ = row
    return np.cos(bend * length) * tangent + np.sin(bend * length) * normal
