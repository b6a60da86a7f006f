"""Random objectives, limits and tolerances for shaped paths, each drawn from one integer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import armcontour as ac
from armcontour.geometry.fit import draw_with_arcs
from soak.shape_matching import Pieces, cut

PMK = ac.load_arm("pmk3s")
# A tool that looks down, and an axis of one that is tilted.
DOWN, AXIS = np.diag([1.0, -1.0, -1.0]), np.array([0.2, 0.1, -1.0])
# Where paths lie [m]: distances from the first joint of the arm in the plane, and a box in space.
NEAR, FAR = 0.09, 0.455
BOX = np.array([(0.35, -0.25, 0.1), (0.65, 0.25, 0.4)])
# Vertices between two stretches of which a tolerance is at most half [rad].
SHARP = np.radians(30)
Random = np.random.Generator


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What is asked.

    Args:
        seed: Where it was drawn from.
        kind: What sort of objective.
        objective: The path.
        arm: The arm.
        limits: The limits.
        options: Of `plan`: tolerance, and line_tolerance with zone.
        hold: How the tool is held in space: "held" or "axis" for DOWN or its axis alone, "pointing"
            for AXIS; empty in the plane.
    """

    seed: int
    kind: str
    objective: ac.Path
    arm: Any
    limits: ac.Limits
    options: dict[str, Any] = field(default_factory=dict)
    hold: str = ""


def hold_tool(path: ac.Path, hold: str) -> ac.Path:
    """The path with the tool held in one way."""
    if hold == "pointing":
        return path.pointing(AXIS)
    return path.oriented(DOWN, axis_only=hold == "axis") if hold else path


def pieces_of(problem: Problem) -> Pieces:
    """The objective in pieces, each with its tolerance."""
    path, options = problem.objective, problem.options
    most = options["tolerance"]
    corners = path.breaks[1:-1][path.turns > 1e-9]
    zone = options.get("zone")
    edges = np.empty(0) if zone is None else np.concatenate([corners - zone, corners + zone])

    def own(s: np.ndarray, side: str) -> np.ndarray:
        given = path.tolerances[path.locate(s, side=side)]
        return np.fmin(np.where(np.isnan(given), np.inf, given), most)

    def bands(s: np.ndarray) -> np.ndarray:
        found = own(s, "left")
        if zone is not None:
            away = np.abs(s[:, None] - corners).min(axis=1, initial=np.inf) > zone
            found = np.where(away, np.minimum(found, options["line_tolerance"]), found)
        return found

    def joints(s: np.ndarray) -> np.ndarray:
        at_vertex = np.isin(s, path.breaks)
        least = np.minimum(own(s, "left"), own(s, "right"))
        return np.where(at_vertex, least, np.maximum(own(s, "left"), own(s, "right")))

    return cut(path, edges, bands, joints)


@cache
def _ur5e() -> ac.Arm:
    return ac.load_arm("ur5e")


def draw(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng((15, seed))
    kind = str(rng.choice(list(KINDS), p=WEIGHTS))
    objective = KINDS[kind](rng)
    space = objective.dimension == 3
    hold = str(rng.choice(["held", "axis", "pointing"])) if space else ""
    return Problem(
        seed=seed,
        kind=kind,
        objective=hold_tool(objective, hold),
        hold=hold,
        arm=_ur5e() if space else PMK,
        limits=_space_limits(rng) if space else _limits(rng),
        options=_options(rng, objective),
    )


def _options(rng: Random, objective: ac.Path) -> dict[str, Any]:
    """Tolerances that the objective bears."""
    sharp = np.flatnonzero(objective.turns > SHARP) + 1
    stretches = np.diff(objective.breaks[np.concatenate([[0], sharp, [len(objective)]])])
    tolerance = float(min(10 ** rng.uniform(-4, -2.3), stretches.min() / 2))
    if rng.random() < 0.03:
        tolerance = float(rng.choice([0.0, 1e-9, 1e-6, 1e-5]) * (tolerance > 1e-5))
    options = {"tolerance": tolerance}
    if rng.random() < 0.25:
        options["line_tolerance"] = tolerance * float(rng.choice([0.0, 0.02, 0.3, 1.0]))
        options["zone"] = float(rng.uniform(1, 8) * max(tolerance, 1e-4))
    return options


def _limits(rng: Random) -> ac.Limits:
    """Mostly the paper's, else others of their size."""
    spread = 0.0 if rng.random() < 0.5 else float(rng.choice([0.3, 1.0]))

    def some(scale: float, count: int | None = None) -> Any:
        return scale * 10 ** rng.uniform(-spread, spread, count)

    wanted: dict[str, Any] = {"joint_acceleration": some(0.72, 2)}
    if rng.random() < 0.1:
        wanted["joint_deceleration"] = some(0.72, 2)
    if rng.random() < 0.85:
        wanted["speed"] = float(some(0.15))
    if rng.random() < 0.5:
        wanted["centripetal_acceleration"] = float(some(0.09))
    if rng.random() < 0.25:
        wanted["joint_velocity"] = some(0.5, 2)
    if rng.random() < 0.15:
        wanted["tool_acceleration"] = float(some(0.2))
    if rng.random() < 0.05:
        wanted["joint_torque"] = some(0.05, 2)
    return ac.Limits(**wanted)


def _space_limits(rng: Random) -> ac.Limits:
    cap = float(rng.uniform(0.2, 2)) if rng.random() < 0.5 else None
    return ac.Limits(
        joint_velocity=3.14,
        joint_acceleration=float(rng.uniform(2, 10)),
        speed=float(rng.uniform(0.05, 0.5)),
        centripetal_acceleration=cap,
    )


# Objectives


def _reached(points: np.ndarray) -> bool:
    share = np.linspace(0, 1, 33)[:, None, None]
    places = (points[:-1] + share * np.diff(points, axis=0)).reshape(-1, 2)
    distance = np.hypot(places[:, 0] - PMK.base, places[:, 1])
    return bool((distance > NEAR).all() and (distance < FAR).all())


def _walk(rng: Random, lengths: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """A polyline of these lines and turns, somewhere within reach."""
    while True:
        headings = rng.uniform(0, 2 * np.pi) + np.append(0.0, np.cumsum(turns))
        legs = lengths[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
        start = rng.uniform((-0.3, 0.05), (0.55, 0.42))
        points = np.concatenate([[start], start + np.cumsum(legs, axis=0)])
        if _reached(points):
            return points
        # A walk that does not fit gets shorter.
        lengths = lengths * 0.97


def _signs(rng: Random, count: int) -> np.ndarray:
    return rng.choice([-1.0, 1.0], count)


def _with_demands(rng: Random, points: np.ndarray) -> ac.Path:
    """The polyline, now and then with speeds or tolerances of its own lines."""
    speeds, tolerances = rng.random() < 0.1, rng.random() < 0.1
    if not (speeds or tolerances):
        return ac.Path.polyline(points)
    demands = [
        ac.Demand(
            speed=float(10 ** rng.uniform(-1.7, -0.5)) if speeds else None,
            tolerance=float(10 ** rng.uniform(-4.3, -2.5)) if tolerances else None,
        )
        for _ in points[1:]
    ]
    return ac.Path.from_segments(
        ac.Line(start=a, end=b, demand=x)
        for a, b, x in zip(points[:-1], points[1:], demands, strict=True)
    )


def _any_turns(rng: Random) -> ac.Path:
    count = int(rng.integers(1, 8))
    turns = _signs(rng, count) * rng.uniform(0.02, np.radians(150), count)
    return _with_demands(rng, _walk(rng, rng.uniform(0.01, 0.07, count + 1), turns))


def _acute(rng: Random) -> ac.Path:
    count = int(rng.integers(1, 7))
    turns = _signs(rng, count) * np.radians(rng.uniform(140, 179.5, count))
    return _with_demands(rng, _walk(rng, rng.uniform(0.01, 0.07, count + 1), turns))


def _turn_back(rng: Random) -> ac.Path:
    """There and back, exactly or nearly, among other corners."""
    count = int(rng.integers(1, 5))
    turns = _signs(rng, count) * rng.uniform(0.1, 3.0, count)
    off = 0.0 if rng.random() < 0.4 else 10 ** rng.uniform(-9, -1.5)
    turns[rng.integers(count)] = np.pi - off
    return _with_demands(rng, _walk(rng, rng.uniform(0.01, 0.07, count + 1), turns))


def _micro(rng: Random) -> ac.Path:
    """Lines down to a micrometre among longer ones."""
    count = int(rng.integers(2, 9))
    turns = _signs(rng, count) * 10 ** rng.uniform(-4, 0.4, count)
    lengths = rng.uniform(0.01, 0.06, count + 1)
    small = rng.random(count + 1) < 0.4
    lengths[small] = 10 ** rng.uniform(-6, -3, small.sum())
    return _with_demands(rng, _walk(rng, lengths, turns))


def _chords(rng: Random) -> ac.Path:
    """Many short lines along a wavy curve, with sharp corners now and then."""
    count = int(rng.integers(20, 150))
    wave = np.sin(np.linspace(0, rng.uniform(1, 12), count))
    turns = np.radians(rng.uniform(1, 15)) * wave
    if rng.random() < 0.5:
        turns[rng.integers(count, size=2)] = _signs(rng, 2) * rng.uniform(0.6, 2.5, 2)
    step = 10 ** rng.uniform(-4.3, -2.5)
    return ac.Path.polyline(_walk(rng, step * rng.uniform(0.7, 1.3, count + 1), turns))


def _repeated(rng: Random) -> ac.Path:
    """Points that are given twice, or once more within a rounding error."""
    count = int(rng.integers(2, 6))
    turns = _signs(rng, count) * rng.uniform(0.05, 2.6, count)
    points = _walk(rng, rng.uniform(0.01, 0.06, count + 1), turns)
    again = np.repeat(points, rng.integers(1, 3, len(points)), axis=0)
    again[1:-1] += rng.choice([0.0, 1e-12, 1e-10], (len(again) - 2, 1))
    return ac.Path.polyline(again)


def _closed(rng: Random) -> ac.Path:
    """A polygon whose corners lie anywhere on two circles."""
    count = int(rng.integers(3, 9))
    angles = (
        rng.uniform(0, 2 * np.pi)
        + 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.8, count)) / count
    )
    while True:
        radius = rng.uniform(0.01, 0.06) * rng.uniform(0.4, 1, count)
        middle = rng.uniform((-0.2, 0.1), (0.45, 0.38))
        corners = middle + radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        points = np.concatenate([corners, corners[:1]])
        if _reached(points):
            return _with_demands(rng, points)


def _crossing(rng: Random) -> ac.Path:
    """A loop that crosses itself, or a line that comes back beside itself: a place to hop."""
    if rng.random() < 0.5:
        turns = np.radians([rng.uniform(80, 130) * s for s in (1, 1, 1)]) * _signs(rng, 1)
        return ac.Path.polyline(_walk(rng, rng.uniform(0.02, 0.06, 4), turns))
    gap = 10 ** rng.uniform(-3.3, -2)
    count = int(rng.integers(2, 5))
    lengths = np.ravel([(rng.uniform(0.02, 0.06), gap) for _ in range(count)])[:-1]
    turns = np.pi / 2 * np.repeat(np.resize([1.0, -1.0], count), 2)[: len(lengths) - 1]
    return ac.Path.polyline(_walk(rng, lengths, turns))


def _arcs(rng: Random) -> ac.Path:
    """Lines and arcs in turn, with tangential joints and with corners."""
    while True:
        count = int(rng.integers(2, 7))
        at, heading = rng.uniform((-0.25, 0.08), (0.5, 0.4)), rng.uniform(0, 2 * np.pi)
        parts: list[ac.Line | ac.Arc] = []
        points = [at]
        for _ in range(count):
            along = np.array([np.cos(heading), np.sin(heading)])
            if rng.random() < 0.5:
                there = at + rng.uniform(0.008, 0.05) * along
                parts.append(ac.Line(start=at.tolist(), end=there.tolist()))
                points.append(there)
            else:
                radius, sweep = (
                    10 ** rng.uniform(-2.7, -1.2),
                    rng.uniform(0.3, 3) * rng.choice([-1, 1]),
                )
                center = at + np.sign(sweep) * radius * np.array([-along[1], along[0]])
                parts.append(ac.Arc(start=at.tolist(), center=center.tolist(), angle=sweep))
                turn = np.linspace(0, sweep, 9)[1:, None]
                v = at - center
                points += list(center + np.cos(turn) * v + np.sin(turn) * np.array([-v[1], v[0]]))
                heading += sweep
                there = points[-1]
            at = there
            if rng.random() < 0.5:
                heading += rng.uniform(0.05, 2.7) * rng.choice([-1, 1])
        if _reached(np.array(points)):
            return ac.Path.from_segments(parts)


def _spline(rng: Random) -> ac.Path:
    count = int(rng.integers(3, 7))
    turns = _signs(rng, count) * rng.uniform(0.05, 1.5, count)
    points = _walk(rng, rng.uniform(0.015, 0.05, count + 1), turns)
    while True:
        path, _ = draw_with_arcs(ac.Path.spline(points), 10 ** rng.uniform(-6, -4))
        if _reached(path(np.linspace(0, path.length, 400))):
            return path
        middle = points.mean(axis=0)
        points = middle + 0.8 * (points - middle)


def _space(rng: Random) -> ac.Path:
    """A polyline in space, now and then in a horizontal plane."""
    count = int(rng.integers(1, 5))
    points = rng.uniform(*BOX, (1, 3)) * 1.0
    while len(points) < count + 2:
        step = rng.normal(size=3) * (1, 1, rng.choice([0, 1]))
        there = points[-1] + rng.uniform(0.02, 0.12) * step / np.linalg.norm(step)
        if (there > BOX[0]).all() and (there < BOX[1]).all():
            points = np.concatenate([points, [there]])
    return ac.Path.polyline(points)


KINDS: dict[str, Callable[[Random], ac.Path]] = {
    "any turns": _any_turns,
    "acute": _acute,
    "turn-back": _turn_back,
    "micro-segments": _micro,
    "chords": _chords,
    "repeated points": _repeated,
    "closed": _closed,
    "crossing": _crossing,
    "arcs": _arcs,
    "spline": _spline,
    "space": _space,
}
WEIGHTS = (0.2, 0.15, 0.08, 0.1, 0.07, 0.05, 0.1, 0.05, 0.1, 0.05, 0.05)
