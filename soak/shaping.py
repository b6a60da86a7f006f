"""Shaped motions, judged by joint positions alone and compared with other shapes.

A monotone matching of the motion with the objective path decides which pieces of the path belong to
a point (after Alt and Godau, "Computing the Fréchet distance between two polygonal curves").
`tests.oracle.shaped_optimum` has the fastest motion by IPOPT.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from scipy.optimize import minimize_scalar

import armcontour as ac
from armcontour.geometry import round_path
from soak import Outcome
from soak.corners import Piece
from soak.kerf import shape
from soak.timing import limit_ratios

LEAK = 1e-9
# Tracing error by which the tool may be off in addition to its share of the tolerance [m].
TRACED = 1.5e-10
# Tracing error by which the tool may be turned [rad].
TURNED = 2e-9
# Places nearer to each other than this count as one [m].
SAME_PLACE = 1e-9
# Places per segment of the path at which a motion is judged.
PLACES = 96
# Random times per interval of the law at which it is judged.
RANDOM = 4
# Points of the tool are at most this part of the tolerance apart, unless they would be too many.
STEP = 0.25
# Maximum number of these points.
MOST_POINTS = 30_000
# Number of steps per motion for position differences.
STEPS = 20_000
# Share of the centripetal limit by which differences may be off, beside rounding errors.
CURVED = 5e-3
# Below this speed the tool's direction is undefined, also from differences [m/s].
SLOW = 2e-3
PMK = ac.load_arm("pmk3s")
# Orientation of a tool that points downwards, as a rotation matrix.
DOWN = np.diag([1.0, -1.0, -1.0])
# Axis of a tilted tool, of any length.
AXIS = np.array([0.2, 0.1, -1.0])
# Smallest and largest distance of paths from the first joint of the arm in the plane [m].
NEAR = 0.09
FAR = 0.455
# Lowest and highest corner of the box in which paths in space lie [m].
BOX = np.array([(0.35, -0.25, 0.1), (0.65, 0.25, 0.4)])
# Vertices between two stretches of which a tolerance is at most half [rad].
SHARP = np.radians(30)
Random = np.random.Generator
# An arc shorter than this angle is assumed to meet a disc in at most one stretch [rad].
QUARTER = np.pi / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An objective path, an arm, limits, and options of `plan`.

    `hold` says how the tool is held in space: "held" or "axis" for DOWN or its axis alone,
    "pointing" for AXIS.
    """

    seed: int
    kind: str
    objective: ac.Path
    arm: Any
    limits: ac.Limits
    options: dict[str, Any] = field(default_factory=dict)
    hold: str = ""


def hold_tool(path: ac.Path, hold: str) -> ac.Path:
    """Return the path with the tool held in one way."""
    if hold == "pointing":
        return path.pointing(AXIS)
    return path.oriented(DOWN, axis_only=hold == "axis") if hold else path


def pieces_of(problem: Problem) -> Pieces:
    """Cut the objective into pieces, each with its tolerance."""
    path = problem.objective
    tolerance = problem.options["tolerance"]

    def own_tolerance(s: np.ndarray, side: str) -> np.ndarray:
        segment_tolerance = path.tolerances[path.locate(s, side=side)]
        return np.fmin(np.where(np.isnan(segment_tolerance), np.inf, segment_tolerance), tolerance)

    def bands(s: np.ndarray) -> np.ndarray:
        return own_tolerance(s, "left")

    def joints(s: np.ndarray) -> np.ndarray:
        at_vertex = np.isin(s, path.breaks)
        smaller = np.minimum(own_tolerance(s, "left"), own_tolerance(s, "right"))
        return np.where(
            at_vertex, smaller, np.maximum(own_tolerance(s, "left"), own_tolerance(s, "right"))
        )

    return cut(path, np.empty(0), bands, joints)


@cache
def _ur5e() -> ac.Arm:
    return ac.load_arm("ur5e")


def draw(seed: int) -> Problem:
    """Draw the problem of a seed."""
    rng = np.random.default_rng((15, seed))
    kind = str(rng.choice(list(KINDS), p=SHARES))
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
    """Draw tolerances that the objective allows."""
    sharp = np.flatnonzero(objective.turns > SHARP) + 1
    stretches = np.diff(objective.breaks[np.concatenate([[0], sharp, [len(objective)]])])
    tolerance = float(min(10 ** rng.uniform(-4, -2.3), stretches.min() / 2))
    if rng.random() < 0.03:
        tolerance = float(rng.choice([0.0, 1e-9, 1e-6, 1e-5]) * (tolerance > 1e-5))
    options = {"tolerance": tolerance}
    return options


def _limits(rng: Random) -> ac.Limits:
    """Draw limits: mostly the paper's, else others of their size."""
    spread = 0.0 if rng.random() < 0.5 else float(rng.choice([0.3, 1.0]))

    def some(scale: float, count: int | tuple[int, int] | None = None) -> Any:
        return scale * 10 ** rng.uniform(-spread, spread, count)

    options: dict[str, Any] = {"joint_acceleration": some(0.72, 2)}
    if rng.random() < 0.1:
        options["joint_acceleration"] = some(0.72, (2, 2)) * (-1, 1)
    if rng.random() < 0.85:
        options["speed"] = float(some(0.15))
    if rng.random() < 0.5:
        options["centripetal_acceleration"] = float(some(0.09))
    if rng.random() < 0.25:
        options["joint_velocity"] = (
            some(0.5, (2, 2)) * (-1, 1) if rng.random() < 0.3 else some(0.5, 2)
        )
    if rng.random() < 0.15:
        options["tool_acceleration"] = float(some(0.2))
    if rng.random() < 0.05:
        options["joint_torque"] = some(0.05, 2)
    return ac.Limits.only(**options)


def _space_limits(rng: Random) -> ac.Limits:
    cap = float(rng.uniform(0.2, 2)) if rng.random() < 0.5 else None
    return ac.Limits.only(
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
    """Make a polyline of these lines and turns, somewhere within reach."""
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
    """Give some lines of the polyline their own speeds or tolerances."""
    speeds = rng.random() < 0.1
    tolerances = rng.random() < 0.1
    if not (speeds or tolerances):
        return ac.Path.polyline(points)
    demands = [
        ac.SegmentLimits(
            speed=float(10 ** rng.uniform(-1.7, -0.5)) if speeds else None,
            tolerance=float(10 ** rng.uniform(-4.3, -2.5)) if tolerances else None,
        )
        for _ in points[1:]
    ]
    return ac.Path(
        segments=[
            ac.Line(start=a, end=b, segment_limits=x)
            for a, b, x in zip(points[:-1], points[1:], demands, strict=True)
        ]
    )


def _polyline(rng: Random) -> ac.Path:
    """Draw corners of any turn (acute, there and back), micro-segments and repeated points."""
    count = int(rng.integers(1, 8))
    turns = _signs(rng, count) * rng.uniform(0.02, np.radians(150), count)
    lengths = rng.uniform(0.01, 0.07, count + 1)
    sort = rng.random()
    if sort < 0.3:
        turns = _signs(rng, count) * np.radians(rng.uniform(140, 179.5, count))
    elif sort < 0.4:
        deviation = 0.0 if rng.random() < 0.4 else 10 ** rng.uniform(-9, -1.5)
        turns[rng.integers(count)] = np.pi - deviation
    elif sort < 0.55:
        turns = _signs(rng, count) * 10 ** rng.uniform(-4, 0.4, count)
        small = rng.random(count + 1) < 0.4
        lengths[small] = 10 ** rng.uniform(-6, -3, small.sum())
    points = _walk(rng, lengths, turns)
    if 0.55 < sort < 0.6:
        again = np.repeat(points, rng.integers(1, 3, len(points)), axis=0)
        again[1:-1] += rng.choice([0.0, 1e-12, 1e-10], (len(again) - 2, 1))
        return ac.Path.polyline(again)
    return _with_demands(rng, points)


def _crossing(rng: Random) -> ac.Path:
    """Draw a loop that crosses itself, or a line that comes back beside itself."""
    if rng.random() < 0.5:
        turns = np.radians([rng.uniform(80, 130) * s for s in (1, 1, 1)]) * _signs(rng, 1)
        return ac.Path.polyline(_walk(rng, rng.uniform(0.02, 0.06, 4), turns))
    gap = 10 ** rng.uniform(-3.3, -2)
    count = int(rng.integers(2, 5))
    lengths = np.ravel([(rng.uniform(0.02, 0.06), gap) for _ in range(count)])[:-1]
    turns = np.pi / 2 * np.repeat(np.resize([1.0, -1.0], count), 2)[: len(lengths) - 1]
    return ac.Path.polyline(_walk(rng, lengths, turns))


def _contour(rng: Random) -> ac.Path:
    """Draw a closed contour of lines and arcs, with corners."""
    while True:
        path = shape(rng, rng.uniform(0.01, 0.06), rng.uniform((-0.2, 0.1), (0.45, 0.38)))
        if _reached(path(np.linspace(0, path.length, 400))):
            return path


def _space(rng: Random) -> ac.Path:
    """Draw a polyline in space, now and then in a horizontal plane."""
    count = int(rng.integers(1, 5))
    points = rng.uniform(*BOX, (1, 3)) * 1.0
    while len(points) < count + 2:
        step = rng.normal(size=3) * (1, 1, rng.choice([0, 1]))
        there = points[-1] + rng.uniform(0.02, 0.12) * step / np.linalg.norm(step)
        if (there > BOX[0]).all() and (there < BOX[1]).all():
            points = np.concatenate([points, [there]])
    return ac.Path.polyline(points)


KINDS: dict[str, Callable[[Random], ac.Path]] = {
    "polyline": _polyline,
    "crossing": _crossing,
    "contour": _contour,
    "space": _space,
}
SHARES = (0.7, 0.05, 0.2, 0.05)


def run(seed: int) -> Outcome:
    """Plan and judge the problem of a seed."""
    problem = draw(seed)
    try:
        planned = _plan(problem)
    except ac.ArmContourError as error:
        notes = []
        try:
            ac.plan(problem.objective, problem.arm, problem.limits)
            notes = [f"refused: {error}"]
        except type(error):
            pass
        return Outcome(kind=problem.kind, result="refused", notes=notes)
    notes = judge(planned, problem)
    for name, duration in time_rivals(planned, problem).items():
        if planned.duration > duration * (1 + LEAK):
            longer = planned.duration / duration - 1
            notes.append(f"slower than {name} by 1 {longer:+.2e}: {planned.duration:.9g} s")
    return Outcome(kind=problem.kind, result="shaped", notes=notes)


def time_rivals(planned: ac.Trajectory, problem: Problem) -> dict[str, float]:
    """Return the durations of fastest motions along other shapes in the tolerance [s]."""
    objective = problem.objective
    tolerance = problem.options["tolerance"]
    shapes = {
        "arcs": ac.round_corners(objective, tolerance=tolerance),
        "parabolas": hold_tool(
            round_path(objective, tolerance=tolerance, curve="parabola"), problem.hold
        ),
        "stops": objective,
    }
    options = {} if objective.dimension == 2 else {"seed": planned(0.0)}
    plans = {}
    for name, path in shapes.items():
        try:
            plans[name] = ac.plan(path, problem.arm, problem.limits, ac.Optimal(**options)).duration
        except ac.ArmContourError:
            continue
    return plans


def _plan(problem: Problem) -> ac.Trajectory:
    return ac.plan(problem.objective, problem.arm, problem.limits, ac.Shaped(**problem.options))


def judge(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """List what is wrong with a motion, in words."""
    t = _times(planned, problem)
    states = [planned(t, order) for order in (0, 1, 2)]
    # Times just before every break are judged, too.
    left_limits = [planned(planned.breaks[1:], order, side="left") for order in (0, 1, 2)]
    both = [np.concatenate(x) for x in zip(states, left_limits, strict=True)]
    notes = _exceeded(problem, np.append(t, planned.breaks[1:]), both)
    notes += _differences(planned, problem)
    notes += _keeping(planned, problem, t, problem.arm.tool_position(states[0]))
    return notes + _ends(planned, problem) + _orientation(problem, states[0])


def _times(planned: ac.Trajectory, problem: Problem) -> np.ndarray:
    """Return dense times at which a motion is judged, in every interval, segment and length."""
    rng = np.random.default_rng(problem.seed)
    breaks = planned.breaks
    path = planned.path
    inside = breaks[:-1, None] + rng.random((len(breaks) - 1, RANDOM)) * np.diff(breaks)[:, None]
    share = np.linspace(0, 1, PLACES + 2)[:-1]
    places = (path.breaks[:-1, None] + share * path.lengths[:, None]).ravel()
    count = path.length / max(STEP * problem.options["tolerance"], path.length / MOST_POINTS)
    along = np.append(places, np.linspace(0, path.length, int(count) + 2))
    return np.unique(np.concatenate([breaks, inside.ravel(), planned.time_at(along)]))


def _exceeded(problem: Problem, t: Any, states: Any) -> list[str]:
    """List the limits that are exceeded."""
    notes = []
    for name, ratio in limit_ratios(problem.limits, problem.arm, *states).items():
        k = int(np.argmax(np.where(np.isnan(ratio), np.inf, ratio)))
        if not ratio[k] <= 1 + LEAK:
            notes.append(f"{name} 1 {ratio[k] - 1:+.2e} at t = {t[k]:.9g} s")
    return notes


def _differences(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """List limits that differences of positions exceed; means over steps are never larger."""
    limits = problem.limits
    t = np.linspace(0, planned.duration, STEPS + 1)
    h = t[1]
    q = planned(t)
    rounding = 64 * np.finfo(float).eps * max(1.0, np.abs(q).max())
    first = np.diff(q, axis=0) / h
    second = np.diff(q, 2, axis=0) / h**2
    tool = problem.arm.tool_position(q)
    velocity = np.diff(tool, axis=0) / h
    change = np.diff(tool, 2, axis=0) / h**2
    speed = np.linalg.norm(velocity, axis=1)
    low, high = limits.acceleration_bounds(q.shape[1])
    # Excess over each limit, and the errors of rounding and of the differences themselves.
    excesses = {"acceleration": (np.maximum(second - high, low - second).max(), rounding / h**2)}
    if limits.joint_velocity is not None:
        low, high = limits.velocity_bounds(q.shape[1])
        excesses["velocity"] = (np.maximum(first - high, low - first).max(), rounding / h)
    if limits.speed is not None:
        excesses["speed"] = (speed.max() - limits.speed, rounding / h)
    if limits.tool_acceleration is not None:
        bound = np.linalg.norm(change, axis=1).max()
        excesses["tool acceleration"] = (bound - limits.tool_acceleration, rounding / h**2)
    if limits.centripetal_acceleration is not None:
        middle = (velocity[1:] + velocity[:-1]) / 2
        going = np.linalg.norm(middle, axis=1)
        along = np.einsum("ij,ij->i", middle, change) / np.maximum(going, SLOW) ** 2
        normal = np.linalg.norm(change - along[:, None] * middle, axis=1)[going > SLOW]
        bound = limits.centripetal_acceleration
        above = normal.max(initial=0.0) - bound
        excesses["centripetal acceleration"] = (above, rounding / h**2 + CURVED * bound)
    return [
        f"{name} above its limit by {above:.3g} by differences of positions"
        for name, (above, allowed) in excesses.items()
        if not above <= allowed + LEAK
    ]


def _keeping(planned: Any, problem: Problem, t: np.ndarray, points: np.ndarray) -> list[str]:
    """List points too far from their objective part, and vertices too far from the path."""
    pieces = pieces_of(problem)
    notes = _promised(planned, problem, pieces, t, points)
    matching = match(points, pieces)
    if matching.lost >= 0:
        return [*notes, f"no way along the objective at t = {t[matching.lost]:.9g} s"]
    far = excess(points, pieces, matching)
    k = int(np.argmax(far))
    if far[k] > LEAK * pieces.bands.max() + TRACED:
        notes.append(f"outside the tolerance by {far[k]:.3g} m at t = {t[k]:.9g} s")
    vertices = problem.objective.vertices[1:-1]
    ends = np.cumsum(pieces.lengths)
    for i, (vertex, place) in enumerate(zip(vertices, problem.objective.breaks[1:-1], strict=True)):
        index = int(np.argmin(np.abs(ends - place)))
        matched = (matching.first <= index + 1) & (matching.last >= index)
        distance = np.where(matched, np.linalg.norm(points - vertex, axis=1), np.inf)
        j = int(np.argmin(distance))
        allowed = pieces.joints[index] * (1 + LEAK) + TRACED
        if distance[j] <= allowed:
            continue
        bounds = t[max(j - 1, 0)], t[min(j + 1, len(t) - 1)]
        gap = minimize_scalar(
            lambda x, v=vertex: np.linalg.norm(problem.arm.tool_position(planned([x]))[0] - v),
            bounds=bounds,
            method="bounded",
            options={"xatol": 1e-15},
        ).fun
        if gap > allowed:
            notes.append(f"vertex {i + 1} is {gap - pieces.joints[index]:.3g} m outside")
    return notes


def _promised(planned: Any, problem: Problem, pieces: Any, t: Any, points: Any) -> list[str]:
    """List points too far from the places that the path itself gives for them."""
    path = planned.path
    objective = problem.objective
    on_path = np.clip(planned.s(t), 0, path.length)
    place = np.clip(np.interp(on_path, path.places[:, 1], path.places[:, 0]), 0, objective.length)
    distance = np.linalg.norm(points - objective(place), axis=1)
    edges = np.cumsum(pieces.lengths)[:-1]
    # At an edge the larger tolerance holds.
    either = [pieces.bands[np.searchsorted(edges, place + x)] for x in (-SAME_PLACE, SAME_PLACE)]
    far = distance - np.maximum(*either) * (1 + LEAK) - TRACED
    k = int(np.argmax(far))
    return [f"{far[k]:.3g} m too far from its place at t = {t[k]:.9g} s"] if far[k] > 0 else []


def _ends(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """List ends at which the motion does not rest although the objective's end requires it."""
    t = np.array([0.0, planned.duration])
    gap = problem.arm.tool_position(planned(t)) - problem.objective.vertices[[0, -1]]
    notes = []
    if np.linalg.norm(gap, axis=1).max() > TRACED:
        notes.append(f"misses an end by {np.linalg.norm(gap, axis=1).max():.3g} m")
    if np.abs(planned(t, 1)).max() > 1e-7:
        notes.append("does not rest at an end")
    return notes


def _orientation(problem: Problem, q: np.ndarray) -> list[str]:
    """List tools that are not held as the objective requires, which is constant."""
    if not problem.hold:
        return []
    _, rotations = problem.arm.pose(q)
    if problem.hold == "held":
        deviation = np.abs(rotations - DOWN).max()
    else:
        axis = DOWN[:, 2] if problem.hold == "axis" else AXIS / np.linalg.norm(AXIS)
        deviation = np.linalg.norm(rotations[:, :, 2] - axis, axis=1).max()
    return [f"the tool is turned by {deviation:.3g} rad"] if deviation > TURNED else []


@dataclass(frozen=True)
class Pieces:
    """Lines and arcs in order, each with a tolerance: columns of n rows [m, 1/m].

    `joints` holds the tolerance at the end of every piece, as far as a motion must come that near.
    """

    starts: np.ndarray
    tangents: np.ndarray
    normals: np.ndarray
    bends: np.ndarray
    lengths: np.ndarray
    bands: np.ndarray
    joints: np.ndarray
    ends: np.ndarray

    def __len__(self):
        return len(self.lengths)

    @property
    def columns(self):
        """What the compiled functions take."""
        return self.starts, self.tangents, self.normals, self.bends, self.lengths, self.bands


def cut(path, cuts, bands, joints):
    """Cut a path at vertices, at `cuts` [m], and where arcs are long."""
    bounds = [path.breaks, cuts[(cuts > 0) & (cuts < path.length)]]
    for i in np.flatnonzero(path.curvatures * path.lengths > QUARTER):
        count = math.ceil(path.curvatures[i] * path.lengths[i] / QUARTER)
        bounds.append(np.linspace(path.breaks[i], path.breaks[i + 1], count + 1))
    bounds_of_pieces = np.unique(np.concatenate(bounds))
    # What a rounding error cuts off is no piece, unless it is a segment of the path.
    stays = np.isin(bounds_of_pieces, path.breaks)
    bounds_of_pieces = bounds_of_pieces[
        stays | (np.append(np.diff(bounds_of_pieces), np.inf) > 1e-12)
    ]
    i = path.locate((bounds_of_pieces[:-1] + bounds_of_pieces[1:]) / 2)
    u = bounds_of_pieces[:-1] - path.breaks[i]
    angle = (path.curvatures[i] * u)[:, None]
    tangents = np.cos(angle) * path.tangents[i] + np.sin(angle) * path.normals[i]
    normals = np.cos(angle) * path.normals[i] - np.sin(angle) * path.tangents[i]
    points = path(bounds_of_pieces)
    return Pieces(
        starts=points[:-1],
        tangents=tangents,
        normals=normals,
        bends=np.array(path.curvatures[i]),
        lengths=np.diff(bounds_of_pieces),
        bands=bands((bounds_of_pieces[:-1] + bounds_of_pieces[1:]) / 2),
        joints=joints(bounds_of_pieces[1:]),
        ends=points[1:],
    )


@dataclass(frozen=True)
class Matching:
    """Own pieces of every point: from `first` to `last`, (m,); `lost` is -1, or a lost point."""

    first: np.ndarray
    last: np.ndarray
    lost: int


def match(points, pieces):
    """Match the points of a motion, densely sampled, to the pieces of a path.

    Points are off by as much as they are apart when they are matched, for what lies between them
    may be nearer; their exact distances from their own pieces are for `excess`.
    """
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    slack = np.maximum(np.append(step, 0.0), np.append(0.0, step)) + 1e-9
    first, last, lost = _run(points, slack, *pieces.columns, pieces.ends, pieces.joints)
    if lost >= 0:
        return Matching(first, last, lost)
    back = _reverse(pieces)
    last_b, first_b, lost_b = _run(points[::-1], slack[::-1], *back.columns, back.ends, back.joints)
    n = len(pieces) - 1
    first_b = n - first_b[::-1]
    last_b = n - last_b[::-1]
    if lost_b >= 0:
        return Matching(first, last, len(points) - 1 - lost_b)
    first = np.maximum(first, first_b)
    last = np.minimum(last, last_b)
    wrong = np.flatnonzero(first > last)
    return Matching(first, last, int(wrong[0]) if len(wrong) else -1)


def _reverse(pieces):
    angle = (pieces.bends * pieces.lengths)[:, None]
    tangents = np.cos(angle) * pieces.tangents + np.sin(angle) * pieces.normals
    normals = np.cos(angle) * pieces.normals - np.sin(angle) * pieces.tangents
    return Pieces(
        starts=pieces.ends[::-1].copy(),
        tangents=-tangents[::-1],
        normals=normals[::-1].copy(),
        bends=pieces.bends[::-1].copy(),
        lengths=pieces.lengths[::-1].copy(),
        bands=pieces.bands[::-1].copy(),
        joints=np.append(pieces.joints[:-1][::-1], pieces.bands[0]),
        ends=pieces.starts[::-1].copy(),
    )


def excess(points, pieces, matching):
    """Return how much farther points are from their own pieces than allowed [m], (m,)."""
    smallest = np.full(len(points), np.inf)
    rows = zip(*pieces.columns, strict=True)
    for k, (start, tangent, normal, bend, length, band) in enumerate(rows):
        matched = (matching.first <= k) & (k <= matching.last)
        excesses = Piece(start, tangent, normal, bend, length).distance(points[matched]) - band
        smallest[matched] = np.minimum(smallest[matched], excesses)
    return smallest


@njit(cache=True)
def _free(x, start, tangent, normal, bend, length, band):
    """Return the part of a piece within `band` of x, as distances; empty if low > high."""
    w = x - start
    along = np.dot(w, tangent)
    if bend == 0.0:
        # A difference of squares would lose a small distance in a large one.
        normal_part = w - along * tangent
        room = band * band - np.dot(normal_part, normal_part)
        if room < 0:
            return 1.0, 0.0
        half = math.sqrt(room)
        return max(along - half, 0.0), min(along + half, length)
    across = np.dot(w, normal)
    out = w - along * tangent - across * normal
    radius = 1.0 / bend
    turned = math.atan2(along, radius - across)
    from_center = math.hypot(along, radius - across)
    radial = (along * along + across * across - 2 * across * radius) / (from_center + radius)
    room = band * band - np.dot(out, out) - radial * radial
    if room < 0:
        return 1.0, 0.0
    share = room / (4 * max(from_center, 1e-300) * radius)
    half = math.pi if share >= 1 else 2 * math.asin(math.sqrt(share))
    sweep = length * bend
    low, high = 1.0, 0.0
    for k in range(-1, 2):
        a = max(turned + 2 * math.pi * k - half, 0.0)
        b = min(turned + 2 * math.pi * k + half, sweep)
        if a <= b:
            low, high = (a, b) if low > high else (min(low, a), max(high, b))
    return low * radius, high * radius


@njit(cache=True)
def _run(points, slack, starts, tangents, normals, bends, lengths, bands, ends, joints):
    """Match points to pieces in order: return first and last piece of each; or one lost."""
    m = len(points)
    n = len(lengths)
    first = np.zeros(m, dtype=np.int64)
    last = np.zeros(m, dtype=np.int64)
    low = np.full(n, np.inf)
    high = np.full(n, -np.inf)
    low[0] = 0.0
    high[0] = 0.0
    begin = 0
    until = 0
    for j in range(m):
        x = points[j]
        reached = False
        found_begin = -1
        found_until = -1
        k = begin
        while k < n and (k <= until or reached):
            near = bands[k] + slack[j]
            a, b = _free(x, starts[k], tangents[k], normals[k], bends[k], lengths[k], near)
            lowest = np.inf
            if a <= b:
                if reached:
                    lowest = a
                elif max(a, low[k]) <= min(b, high[k]):
                    lowest = max(a, low[k])
            low[k] = lowest
            high[k] = b if lowest < np.inf else -np.inf
            if lowest < np.inf:
                found_begin = k if found_begin < 0 else found_begin
                found_until = k
            gap = x - ends[k]
            reached = (lowest < np.inf) and math.sqrt(np.dot(gap, gap)) <= joints[k] + slack[j]
            k += 1
        if found_begin < 0:
            return first, last, j
        for i in range(begin, found_begin):
            low[i] = np.inf
            high[i] = -np.inf
        begin = found_begin
        until = found_until
        first[j] = begin
        last[j] = until
    return first, last, -1 if until == n - 1 else m - 1
