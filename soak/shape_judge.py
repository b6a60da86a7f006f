"""Judges a shaped motion by its joint positions alone, and against shapes made here."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

import armcontour as ac
from soak.shape_matching import apart, excess, match
from soak.shape_problems import AXIS, DOWN, Problem, draw, pieces_of
from soak.shape_rivals import time_rivals

LEAK = 1e-9
# Beside its share of the tolerance, a tool may be off by what tracing leaves [m], [rad].
TRACED, TURNED = 1.5e-10, 2e-9
# Places this near to each other are one [m].
SAME_PLACE = 1e-9
# Places per segment of the path, and random ones per interval of the law.
PLACES, RANDOM = 96, 4
# Points of the tool are this part of the tolerance apart at most, but no more than so many.
STEP, MOST_POINTS = 0.25, 30_000
# Steps of a motion for differences, and what they may be off by beside rounding errors.
STEPS = 20_000
CURVED = 5e-3
# A tool this slow [m/s] has no direction; and none that differences would show.
SLOWEST, SLOW = 1e-6, 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a seed.

    Args:
        seed: The seed.
        kind: What sort of objective.
        result: "shaped", "refused" or "wrong".
        notes: What is wrong.
        corners: How many corners the objective has.
        durations: Of the motion as "shaped", and of the shapes made here [s].
        seconds: Time that planning took.
    """

    seed: int
    kind: str
    result: str
    notes: tuple[str, ...] = ()
    corners: int = 0
    durations: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0


def run(seed: int) -> Outcome:
    """Draw, plan and judge the problem of a seed; warnings count as errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem = draw(seed)
        corners = int((problem.objective.turns > 1e-9).sum())
        about = {"seed": seed, "kind": problem.kind, "corners": corners}
        begun = time.perf_counter()
        try:
            planned = _plan(problem)
        except ac.ArmContourError as error:
            note = f"{type(error).__name__}: {error}"
            try:
                ac.plan(problem.objective, problem.arm, problem.limits)
            except type(error):
                return Outcome(result="refused", notes=(note,), **about)
            return Outcome(result="wrong", notes=(f"refused: {note}",), **about)
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            note = f"crash: {type(error).__name__}: {error}"
            return Outcome(result="wrong", notes=(note,), **about)
        seconds = time.perf_counter() - begun
        notes = judge(planned, problem)
        durations = {"shaped": planned.duration, **time_rivals(planned, problem)}
        notes += slower(durations)
    result = "wrong" if notes else "shaped"
    return Outcome(result=result, notes=tuple(notes), durations=durations, seconds=seconds, **about)


def _plan(problem: Problem) -> ac.Trajectory:
    return ac.plan(
        problem.objective, problem.arm, problem.limits, method="shaped", **problem.options
    )


def slower(durations: dict[str, float]) -> list[str]:
    """Shapes made here that are faster."""
    shaped = durations["shaped"]
    return [
        f"slower than {name} by 1 {shaped / x - 1:+.2e}: {shaped:.9g} s, {x:.9g} s"
        for name, x in durations.items()
        if shaped > x * (1 + LEAK)
    ]


def judge(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """What is wrong with a motion, in words."""
    t = _times(planned, problem)
    states = [planned(t, order) for order in (0, 1, 2)]
    # Also what holds just before every break.
    left = [planned(planned.breaks[1:], order, side="left") for order in (0, 1, 2)]
    both = [np.concatenate(x) for x in zip(states, left, strict=True)]
    notes = _limits(problem, np.append(t, planned.breaks[1:]), both)
    notes += _differences(planned, problem)
    notes += _keeping(planned, problem, t, problem.arm.forward(states[0]))
    return notes + _ends(planned, problem) + _orientation(problem, states[0])


def _times(planned: ac.Trajectory, problem: Problem) -> np.ndarray:
    """Times at which a motion is judged: dense in every interval, segment and length of path."""
    rng = np.random.default_rng(problem.seed)
    breaks, path = planned.breaks, planned.path
    inside = breaks[:-1, None] + rng.random((len(breaks) - 1, RANDOM)) * np.diff(breaks)[:, None]
    share = np.linspace(0, 1, PLACES + 2)[:-1]
    places = (path.breaks[:-1, None] + share * path.lengths[:, None]).ravel()
    count = path.length / max(STEP * problem.options["tolerance"], path.length / MOST_POINTS)
    along = np.append(places, np.linspace(0, path.length, int(count) + 2))
    return np.unique(np.concatenate([breaks, inside.ravel(), planned.time_at(along)]))


def _limits(problem: Problem, t: Any, states: Any) -> list[str]:
    """Limits that are exceeded."""
    notes = []
    for name, ratio in _ratios(problem, *states).items():
        k = int(np.argmax(np.where(np.isnan(ratio), np.inf, ratio)))
        if not ratio[k] <= 1 + LEAK:
            notes.append(f"{name} 1 {ratio[k] - 1:+.2e} at t = {t[k]:.9g} s")
    return notes


def _ratios(problem: Problem, q: Any, dq: Any, ddq: Any) -> dict[str, Any]:
    limits, arm = problem.limits, problem.arm
    found: dict[str, Any] = {}
    if limits.joint_velocity is not None:
        found["joint velocity"] = (np.abs(dq) / limits.joint_velocity).max(axis=1)
    if limits.joint_acceleration is not None:
        low, high = limits.acceleration_bounds(q.shape[1])
        found["joint acceleration"] = np.maximum(ddq / low, ddq / high).max(axis=1)
    if limits.joint_torque is not None:
        found["joint torque"] = (np.abs(arm.torque(q, dq, ddq)) / limits.joint_torque).max(axis=1)
    velocity, acceleration = arm.tool_velocity(q, dq), arm.tool_acceleration(q, dq, ddq)
    speed = np.linalg.norm(velocity, axis=1)
    if limits.speed is not None:
        found["speed"] = speed / limits.speed
    if limits.tool_acceleration is not None:
        found["tool acceleration"] = np.linalg.norm(acceleration, axis=1) / limits.tool_acceleration
    if limits.centripetal_acceleration is not None:
        along = np.einsum("ij,ij->i", velocity, acceleration) / np.maximum(speed, SLOWEST) ** 2
        normal = np.linalg.norm(acceleration - along[:, None] * velocity, axis=1)
        normal[speed < SLOWEST] = 0.0
        found["centripetal acceleration"] = normal / limits.centripetal_acceleration
    return found


def _differences(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """Limits that positions alone show to be exceeded; means over steps are never larger."""
    limits = problem.limits
    t = np.linspace(0, planned.duration, STEPS + 1)
    h, q = t[1], planned(t)
    rounding = 64 * np.finfo(float).eps * max(1.0, np.abs(q).max())
    first, second = np.diff(q, axis=0) / h, np.diff(q, 2, axis=0) / h**2
    tool = problem.arm.forward(q)
    velocity, change = np.diff(tool, axis=0) / h, np.diff(tool, 2, axis=0) / h**2
    speed = np.linalg.norm(velocity, axis=1)
    low, high = limits.acceleration_bounds(q.shape[1])
    # How far each is above its limit, and what rounding and the differences themselves may add.
    found = {"acceleration": (np.maximum(second - high, low - second).max(), rounding / h**2)}
    if limits.joint_velocity is not None:
        found["velocity"] = ((np.abs(first) - limits.joint_velocity).max(), rounding / h)
    if limits.speed is not None:
        found["speed"] = (speed.max() - limits.speed, rounding / h)
    if limits.tool_acceleration is not None:
        most = np.linalg.norm(change, axis=1).max()
        found["tool acceleration"] = (most - limits.tool_acceleration, rounding / h**2)
    if limits.centripetal_acceleration is not None:
        middle = (velocity[1:] + velocity[:-1]) / 2
        going = np.linalg.norm(middle, axis=1)
        along = np.einsum("ij,ij->i", middle, change) / np.maximum(going, SLOW) ** 2
        normal = np.linalg.norm(change - along[:, None] * middle, axis=1)[going > SLOW]
        most = limits.centripetal_acceleration
        above = normal.max(initial=0.0) - most
        found["centripetal acceleration"] = (above, rounding / h**2 + CURVED * most)
    return [
        f"{name} above its limit by {above:.3g} by differences of positions"
        for name, (above, allowed) in found.items()
        if not above <= allowed + LEAK
    ]


def _keeping(planned: Any, problem: Problem, t: np.ndarray, points: np.ndarray) -> list[str]:
    """Points that are too far from their own part of the objective, and vertices from the path."""
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
    at = np.flatnonzero(np.isin(np.cumsum(pieces.lengths), problem.objective.breaks[1:-1]))
    if len(at) != len(vertices):
        ends = pieces.ends[:-1]
        at = np.array([np.argmin(np.linalg.norm(ends - x, axis=1)) for x in vertices], dtype=int)
    if not len(vertices):
        return notes
    distance, nearest = apart(points, vertices, matching.first, matching.last, at)
    allowed = pieces.joints[at] * (1 + LEAK) + TRACED
    for i in np.flatnonzero(distance > allowed):
        j = nearest[i]
        bounds = t[max(j - 1, 0)], t[min(j + 1, len(t) - 1)]
        gap = minimize_scalar(
            lambda x, v=vertices[i]: np.linalg.norm(problem.arm.forward(planned([x]))[0] - v),
            bounds=bounds,
            method="bounded",
            options={"xatol": 1e-15},
        ).fun
        if gap > allowed[i]:
            notes.append(f"vertex {i + 1} is {gap - pieces.joints[at[i]]:.3g} m outside")
    return notes


def _promised(planned: Any, problem: Problem, pieces: Any, t: Any, points: Any) -> list[str]:
    """Points that are too far from the places that the path itself gives for them."""
    path, objective = planned.path, problem.objective
    on_path = np.clip(planned.s(t), 0, path.length)
    place = np.clip(np.interp(on_path, path.places[:, 1], path.places[:, 0]), 0, objective.length)
    off = np.linalg.norm(points - objective(place), axis=1)
    edges = np.cumsum(pieces.lengths)[:-1]
    # At an edge the larger tolerance holds.
    either = [pieces.bands[np.searchsorted(edges, place + x)] for x in (-SAME_PLACE, SAME_PLACE)]
    far = off - np.maximum(*either) * (1 + LEAK) - TRACED
    k = int(np.argmax(far))
    return [f"{far[k]:.3g} m too far from its place at t = {t[k]:.9g} s"] if far[k] > 0 else []


def _ends(planned: ac.Trajectory, problem: Problem) -> list[str]:
    """Whether the motion starts and ends at rest where the objective does."""
    t = np.array([0.0, planned.duration])
    gap = problem.arm.forward(planned(t)) - problem.objective.vertices[[0, -1]]
    notes = []
    if np.linalg.norm(gap, axis=1).max() > TRACED:
        notes.append(f"misses an end by {np.linalg.norm(gap, axis=1).max():.3g} m")
    if np.abs(planned(t, 1)).max() > 1e-7:
        notes.append("does not rest at an end")
    return notes


def _orientation(problem: Problem, q: np.ndarray) -> list[str]:
    """Tools that are not held as the objective wants, which is in one way all along."""
    if not problem.hold:
        return []
    _, rotations = problem.arm.pose(q)
    if problem.hold == "held":
        off = np.abs(rotations - DOWN).max()
    else:
        axis = DOWN[:, 2] if problem.hold == "axis" else AXIS / np.linalg.norm(AXIS)
        off = np.linalg.norm(rotations[:, :, 2] - axis, axis=1).max()
    return [f"the tool is turned by {off:.3g} rad"] if off > TURNED else []
