"""Time-optimal plans of random paths, judged by the values of the law and forward kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

import armcontour as ac
from soak import Outcome

PMK = ac.load_arm("pmk3s")
Random = np.random.Generator
LEAK = 1e-9
PLACES = 8
# Position and path speed may jump at a break by this part of their largest values.
STEP = 1e-9
# Below this speed the tool's direction and its centripetal acceleration are undefined [m/s].
SLOWEST = 1e-6
# A path nearer to the edge of the reach than this may be refused [m].
EDGE = 2e-9
# A motion that takes longer is refused [s].
LONGEST = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A path with limits; for a joint path, `arm` is as much of one as planning needs."""

    seed: int
    kind: str
    path: ac.Path | ac.JointPath
    arm: Any
    limits: ac.Limits
    options: dict[str, Any] = field(default_factory=dict)


def draw(seed: int) -> Problem:
    """Draw the problem of a seed."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(list(KINDS), p=WEIGHTS))
    path = KINDS[kind](rng)
    joint = isinstance(path, ac.JointPath)
    arm = SimpleNamespace(dof=path.dof, limits=ac.Limits()) if joint else PMK
    size = float(np.abs(np.ptp(path.coefficients[:, 0], axis=0)).max()) if joint else 1.0
    limits = _limits(rng, arm.dof, size, tool=not joint)
    options: dict[str, Any] = {"intervals": _intervals(rng)}
    for name, share in (("start_speed", 0.1), ("end_speed", 0.05)):
        if rng.random() < share:
            options[name] = _speed(rng, path, limits)
    return Problem(seed=seed, kind=kind, path=path, arm=arm, limits=limits, options=options)


def _intervals(rng: Random) -> int:
    """Draw the number of intervals: mostly coarse, because coarse grids have large margins."""
    if rng.random() < 0.03:
        return int(rng.integers(1000, 4001))
    return int(np.exp(rng.uniform(np.log(5), np.log(250))))


def _speed(rng: Random, path: ac.Path | ac.JointPath, limits: ac.Limits) -> float:
    """Draw a speed at an end, now and then higher than possible."""
    if isinstance(path, ac.JointPath):
        slope = np.abs(path(path.breaks[0], 1)).max() + 1e-300
        scale = np.sqrt(np.abs(limits.joint_acceleration).min() * path.length / slope)
    else:
        scale = 0.1 if limits.speed is None else limits.speed
    return float(scale * 10 ** rng.uniform(-3, 0.3))


def _limits(rng: Random, dof: int, size: float, *, tool: bool) -> ac.Limits:
    """Draw limits; joint limits are roughly in proportion to the size of the path."""
    spread = float(rng.choice([0.5, 1.0, 3.0], p=[0.5, 0.35, 0.15]))

    def some(scale: float, count: int | None = None) -> Any:
        return scale * 10 ** (rng.uniform(-spread, spread) + rng.uniform(-0.4, 0.4, count))

    options: dict[str, Any] = {}
    if not tool or rng.random() < 0.9:
        options["joint_acceleration"] = some(size, dof)
    if rng.random() < 0.5:
        options["joint_velocity"] = some(size, dof)
    for name, upper in options.items():
        if rng.random() < 0.3:
            options[name] = np.stack([-some(size, dof), upper], axis=1)
    if tool:
        if rng.random() < 0.7:
            options["speed"] = float(some(0.15))
        if rng.random() < 0.3 or "joint_acceleration" not in options:
            options["tool_acceleration"] = float(some(0.5))
        if rng.random() < 0.4:
            options["centripetal_acceleration"] = float(some(0.1))
    return ac.Limits.only(**options)


# Joint paths


def _knots(rng: Random) -> np.ndarray:
    count = int(rng.integers(3, 13))
    dof = int(rng.integers(2, 8))
    steps = rng.normal(size=(count, dof))
    steps *= rng.uniform(0.05, 1, (count, 1)) / np.linalg.norm(steps, axis=1, keepdims=True)
    if rng.random() < 0.2:
        steps[:, rng.integers(dof)] = 0.0  # a joint that rests
    if rng.random() < 0.2:
        steps[rng.integers(count)] *= 1e-3
    return np.cumsum(steps, axis=0)


def _spline(rng: Random) -> ac.JointPath:
    return ac.JointPath.spline(_knots(rng))


def _scaled_spline(rng: Random) -> ac.JointPath:
    """Draw tiny and huge splines, in s and in the joints, some with uneven parameters."""
    points = _knots(rng) * 10 ** rng.uniform(-6, 3)
    width = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if rng.random() < 0.3:
        width = width * 10 ** rng.uniform(-0.7, 0.7, len(width))
    s = np.concatenate([[0.0], np.cumsum(width / width.sum())])
    return ac.JointPath.spline(points, s * 10 ** rng.uniform(-6, 6))


def _stopping_spline(rng: Random) -> ac.JointPath:
    """Draw splines one after the other, with a full stop wherever the direction jumps."""
    points = _knots(rng)
    cuts = np.unique([0, *rng.integers(1, len(points) - 1, 2), len(points) - 1])
    parts = [
        ac.JointPath.spline(points[a : b + 1]) for a, b in zip(cuts[:-1], cuts[1:], strict=True)
    ]
    ends = np.concatenate([[0.0], np.cumsum([x.length for x in parts])])
    breaks = [0.0]
    for part, start in zip(parts, ends[:-1], strict=True):
        breaks += (start + part.breaks[1:]).tolist()
    stop_indices = np.cumsum([len(x.breaks) - 1 for x in parts])[:-1]
    return ac.JointPath(
        breaks=np.array(breaks),
        coefficients=np.concatenate([x.coefficients for x in parts]),
        stops=np.array(breaks)[stop_indices],
    )


# Tool paths of PMK-3s


def _within(points: np.ndarray, margin: float = 0.01) -> bool:
    """Return whether the lines through the points stay within the reach."""
    share = np.linspace(0, 1, 33)[:, None, None]
    places = (points[:-1] + share * np.diff(points, axis=0)).reshape(-1, 2)
    distance = np.hypot(places[:, 0] - PMK.base, places[:, 1])
    return bool(
        (distance > PMK.reach[0] + margin).all() and (distance < PMK.reach[1] - margin).all()
    )


def _walk(rng: Random, count: int, step: float) -> np.ndarray:
    """Draw the points of a random walk within the reach."""
    turn = rng.uniform(-1, 2)
    distance = rng.uniform(0.12, 0.4)
    points = [np.array([PMK.base + distance * np.cos(turn), distance * np.sin(turn)])]
    while len(points) < count:
        heading = rng.uniform(0, 2 * np.pi)
        length = step * 10 ** rng.uniform(-0.7, 0)
        there = points[-1] + length * np.array([np.cos(heading), np.sin(heading)])
        if _within(np.array([points[-1], there])):
            points.append(there)
    return np.array(points)


def _round(rng: Random, points: np.ndarray) -> ac.Path:
    """Round the polyline in any way, or stop at every corner."""
    if rng.random() < 0.25:
        speeds = 10 ** rng.uniform(-2, 0, len(points) - 1)
        path = ac.Path(
            segments=[
                ac.Line(start=a, end=b, segment_limits=ac.SegmentLimits(speed=float(v)))
                for a, b, v in zip(points[:-1], points[1:], speeds, strict=True)
            ]
        )
    else:
        path = ac.Path.polyline(points)
    joints = len(path) - 1
    way = rng.integers(4)
    if way == 0:
        return ac.round_corners(path, tolerance=10 ** rng.uniform(-6, -2))
    if way == 1:
        return ac.round_corners(path, speed=10 ** rng.uniform(-2.5, -0.5), acceleration=0.3)
    if way == 2:
        tolerance = 10 ** rng.uniform(-5, -2, joints) * (rng.random(joints) < 0.6)
        return ac.round_corners(path, tolerance=tolerance)
    return path if rng.random() < 0.3 else ac.round_corners(path, tolerance=0.0)


def _polyline(rng: Random) -> ac.Path:
    points = _walk(rng, int(rng.integers(2, 8)), 10 ** rng.uniform(-2.5, -0.6))
    if rng.random() < 0.2 and len(points) > 2:
        # There and back: a turn of 180 degrees.
        k = int(rng.integers(1, len(points)))
        points = np.insert(points, k, (points[k - 1] + points[k]) / 2, axis=0)
        points[[k, k + 1]] = points[[k + 1, k]]
    return _round(rng, points)


def _micro(rng: Random) -> ac.Path:
    """Draw micro-segments, alone or among longer ones."""
    points = _walk(rng, int(rng.integers(3, 9)), 0.1)
    steps = np.diff(points, axis=0)
    small = rng.random(len(steps)) < rng.choice([0.3, 0.6, 1.0])
    size = 10 ** rng.uniform(-7, -4, len(steps)) / np.linalg.norm(steps, axis=1)
    steps *= np.where(small, size, 1.0)[:, None]
    points = points[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    if not _within(points):
        return _micro(rng)
    return _round(rng, points)


def _chords(rng: Random) -> ac.Path:
    """Draw chords of a circle, rounded so that slivers stay between the arcs."""
    count = int(rng.integers(3, 25))
    radius = 10 ** rng.uniform(-3, -1.2)
    turn = rng.uniform(0, 6) + np.linspace(0, rng.uniform(0.5, 6), count + 1)
    points = np.column_stack([0.36 + radius * np.cos(turn), 0.2 + radius * np.sin(turn)])
    step = float(np.linalg.norm(points[1] - points[0]))
    half = (turn[1] - turn[0]) / 2
    # The corner error at which neighbouring arcs meet, nearly.
    meeting = step / 2 * np.tan(half / 2)
    tolerance = meeting * (1 - float(rng.choice([0.5, 1e-3, 1e-6, 1e-9, -1e-9])))
    return ac.round_corners(ac.Path.polyline(points), tolerance=tolerance)


def _turning_line(rng: Random) -> ac.Path:
    """Draw a line on which at least one joint turns round."""
    while True:
        ends = rng.uniform((-0.28, 0.02), (0.55, 0.42), size=(2, 2))
        points = ends[0] + np.linspace(0, 1, 60)[:, None] * (ends[1] - ends[0])
        if not _within(ends, 1e-3):
            continue
        steps = np.diff(PMK.joint_position(points), axis=0)
        if (np.ptp(np.sign(steps), axis=0) == 2).any():
            return ac.Path.polyline(ends)


def _near_singular(rng: Random) -> ac.Path:
    """Draw one or two lines that end 1e-6 to 1e-3 m inside the edge of the reach."""
    gap = 10 ** rng.uniform(-6, -3)
    turn = rng.uniform(0.2, 2.9)
    out = np.array([np.cos(turn), np.sin(turn)])
    along = np.array([-out[1], out[0]])
    base = np.array([PMK.base, 0.0])
    near, far = PMK.reach
    way = rng.integers(3)
    length = 10 ** rng.uniform(-2, -0.8)
    if way == 0:
        # Past the inner edge, a tangent to a circle just outside it.
        middle = base + (near + gap) * out
        share = rng.uniform(0, 1)
        points = [middle - share * length * along, middle + (1 - share) * length * along]
    elif way == 1:
        # Out to the outer edge, straight or askew.
        tip = base + (far - gap) * out
        points = [tip - length * (out + rng.uniform(-1, 1) * along), tip]
        if rng.random() < 0.3:
            points.append(tip - length * (out + rng.uniform(-1, 1) * along))
    else:
        # A chord with both ends near the outer edge.
        other = rng.uniform(0.1, 0.8)
        second = np.array([np.cos(turn + other), np.sin(turn + other)])
        points = [base + (far - gap) * out, base + (far - gap) * second]
    if rng.random() < 0.5:
        points.reverse()
    path = ac.Path.polyline(points)
    return path if len(points) == 2 else ac.round_corners(path, tolerance=1e-4)


KINDS: dict[str, Callable[[Random], ac.Path | ac.JointPath]] = {
    "spline": _spline,
    "scaled spline": _scaled_spline,
    "stopping spline": _stopping_spline,
    "polyline": _polyline,
    "micro-segments": _micro,
    "chords": _chords,
    "turning line": _turning_line,
    "near-singular": _near_singular,
}
WEIGHTS = (0.25, 0.2, 0.1, 0.15, 0.1, 0.05, 0.1, 0.05)


def run(seed: int) -> Outcome:
    """Plan and judge the problem of a seed."""
    problem = draw(seed)
    result, notes, worst = answer(problem, judge)
    return Outcome(kind=problem.kind, result=result, notes=notes, worst=worst)


def answer(problem: Any, judge: Callable[..., Any]) -> tuple[str, list[str], float]:
    """Return the planner's answer, what is wrong with it, and the largest ratio to a limit."""
    options = dict(problem.options)
    refused = ""
    # The speed at each end may be refused once; the allowed speed that the error states must work.
    for _ in range(3):
        try:
            planned = ac.plan(problem.path, problem.arm, problem.limits, ac.Optimal(**options))
        except ac.NotRealizable as error:
            refused = str(error)
            if error.limit is None and _least_duration(problem) > LONGEST:
                return "refused", [], 0.0
            name = (error.limit or "").replace(" ", "_")
            if not options.get(name) or not error.allowed < options[name]:
                return "dishonest", [refused], 0.0
            options[name] = error.allowed
            continue
        except ac.Unreachable as error:
            if _leaves_reach(problem):
                return "refused", [], 0.0
            return "dishonest", [f"{type(error).__name__}: {error}"], 0.0
        notes, worst = judge(planned, problem, options)
        return "refused" if refused else "planned", notes, worst
    return "dishonest", [f"{refused} (and what was allowed was then refused too)"], 0.0


def _least_duration(problem: Problem) -> float:
    """Return a lower bound of the duration: all joints at full velocity along the path [s]."""
    path = problem.path
    if not isinstance(path, ac.JointPath) or problem.limits.joint_velocity is None:
        return 0.0
    low, high = problem.limits.velocity_bounds(path.dof)
    way = np.diff(path(path.breaks), axis=0)
    return float(np.maximum(way / low, way / high).sum(axis=0).max())


def _leaves_reach(problem: Problem) -> bool:
    path = problem.path
    arm = problem.arm
    points = path(np.linspace(0, path.length, 100_001))
    distance = np.hypot(points[:, 0] - arm.base, points[:, 1])
    near, far = arm.reach
    return bool(distance.min() < near + EDGE or distance.max() > far - EDGE)


def judge(
    planned: ac.Trajectory, problem: Problem, options: dict[str, Any]
) -> tuple[list[str], float]:
    """Return what is wrong with a plan, and its largest ratio to a limit."""
    (law,) = planned.laws
    n = len(law.breaks) - 1
    share = np.random.default_rng(problem.seed).random((n, PLACES + 2))
    share[:, 0] = 0.0
    share[:, -1] = 1.0
    t = law.breaks[:-1, None] + share * np.diff(law.breaks)[:, None]
    t[:, -1] = law.breaks[1:]
    t = t.ravel()
    i = np.repeat(np.arange(n), PLACES + 2)
    q, dq, ddq = (law.on_interval(i, t, order) for order in (0, 1, 2))
    notes = _steps(law, q.reshape(n, -1, q.shape[1]), options)
    ratios = _ratios(planned, problem, i, q, dq, ddq)
    worst = 0.0
    for name, ratio in ratios.items():
        index = int(np.argmax(np.where(np.isnan(ratio), np.inf, ratio)))
        worst = max(worst, float(ratio[index]))
        if not ratio[index] <= 1 + LEAK:
            notes.append(
                f"{name} 1 {ratio[index] - 1:+.2e} in interval {i[index]} at t = {t[index]:.9g} s"
            )
    return notes, worst


def _steps(law: Any, q: np.ndarray, options: dict[str, Any]) -> list[str]:
    """List jumps at breaks, ends that are not the path's, and motion backwards."""
    notes = []
    path = law.joint_path
    i = np.arange(len(q))
    ends = law.path_position(i, law.breaks[1:])
    speeds = law.path_position(i, law.breaks[1:], 1)
    length = path.length
    fastest = float(law.rates.ds.max())
    if law.s[0] != path.breaks[0] or law.s[-1] != path.breaks[-1] or (np.diff(law.s) <= 0).any():
        notes.append("s does not run from start to end")
    size = 1.0 + float(np.abs(q).max())
    if (np.abs(q[1:, 0] - q[:-1, -1]) > STEP * size).any():
        notes.append("joint positions jump")
    if np.abs(ends - law.s[1:]).max() > STEP * length:
        notes.append(f"intervals miss their ends by {np.abs(ends - law.s[1:]).max() / length:.1e}")
    after = np.append(law.rates.ds[1:], options.get("end_speed", 0.0))
    if np.abs(speeds[:-1] - after[:-1]).max(initial=0.0) > 1e-6 * fastest:
        notes.append("path speed jumps")
    if (law.rates.ds[1:] < 0).any() or speeds.min() < -1e-6 * fastest:
        notes.append("runs back")
    if len(path.stops):
        stop_nodes = np.searchsorted(law.s, path.stops)
        if (law.rates.ds[stop_nodes[stop_nodes < len(law.rates.ds)]] != 0).any():
            notes.append("does not stop where it must")
    return notes


def _ratios(
    planned: ac.Trajectory,
    problem: Problem,
    i: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the ratios to the limits; the limit of speed may be that of a segment."""
    limits = problem.limits
    arm = problem.arm
    if planned.path is None:
        return limit_ratios(limits, None, q, dq, ddq)
    ratios = limit_ratios(limits, arm, q, dq, ddq)
    s = planned.s(planned.breaks)
    segment_speeds = planned.path.speeds[planned.path.locate((s[:-1] + s[1:]) / 2)][i]
    speed = np.linalg.norm(arm.tool_velocity(q, dq), axis=1)
    ratios["speed of a segment"] = speed / np.where(
        np.isnan(segment_speeds), np.inf, segment_speeds
    )
    return ratios


def limit_ratios(
    limits: ac.Limits, arm: Any, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the ratios to joint and tool limits by name, (n,) each."""
    ratios: dict[str, np.ndarray] = {}
    if limits.joint_velocity is not None:
        low, high = limits.velocity_bounds(q.shape[1])
        ratios["joint velocity"] = np.maximum(dq / low, dq / high).max(axis=1)
    if limits.joint_acceleration is not None:
        low, high = limits.acceleration_bounds(q.shape[1])
        ratios["joint acceleration"] = np.maximum(ddq / low, ddq / high).max(axis=1)
    if arm is None:
        return ratios
    if limits.joint_torque is not None:
        ratios["joint torque"] = (np.abs(arm.torque(q, dq, ddq)) / limits.joint_torque).max(axis=1)
    velocity = arm.tool_velocity(q, dq)
    acceleration = arm.tool_acceleration(q, dq, ddq)
    speed = np.linalg.norm(velocity, axis=1)
    if limits.speed is not None:
        ratios["speed"] = speed / limits.speed
    if limits.tool_acceleration is not None:
        ratios["tool acceleration"] = (
            np.linalg.norm(acceleration, axis=1) / limits.tool_acceleration
        )
    if limits.centripetal_acceleration is not None:
        along = np.einsum("ij,ij->i", velocity, acceleration) / np.maximum(speed, SLOWEST) ** 2
        normal = np.linalg.norm(acceleration - along[:, None] * velocity, axis=1)
        normal[speed < SLOWEST] = 0.0
        ratios["centripetal acceleration"] = normal / limits.centripetal_acceleration
    return ratios
