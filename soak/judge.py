"""Plans one problem and judges the answer by the law's own values and forward kinematics."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

import armcontour as ac
from soak.problems import Problem, draw

LEAK = 1e-9
PLACES = 8
# Position and path speed may jump at a break by this part of their largest values.
STEP = 1e-9
# A tool this slow [m/s] has no direction, so no centripetal acceleration either.
SLOWEST = 1e-6
# Nearer than this to the edge of the reach [m] a path may be refused.
EDGE = 2e-9
# A motion that takes longer is refused [s].
LONGEST = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a seed.

    Args:
        seed: The seed.
        kind: What sort of path; empty if even that could not be drawn.
        result: "planned", "refused", "violation", "dishonest" (a refusal), or "crash".
        note: What is wrong.
        worst: Largest ratio to any limit.
        seconds: Time it took.
    """

    seed: int
    kind: str
    result: str
    note: str = ""
    worst: float = 0.0
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether this must not happen."""
        return self.result not in ("planned", "refused")


def run(seed: int) -> Outcome:
    """Draw, plan and judge the problem of a seed; warnings count as crashes."""
    begun = time.perf_counter()
    kind, worst = "", 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            problem = draw(seed)
            kind = problem.kind
            result, note, worst = _answer(problem)
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            result, note = "crash", f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - begun
    return Outcome(seed=seed, kind=kind, result=result, note=note, worst=worst, seconds=seconds)


def _answer(problem: Problem) -> tuple[str, str, float]:
    options = dict(problem.options)
    refused = ""
    # Each end's speed may be refused once, and what is then said to be allowed can be had.
    for _ in range(3):
        try:
            planned = ac.plan(problem.path, problem.arm, problem.limits, **options)
        except ac.NotRealizable as error:
            refused = str(error)
            if error.limit is None and _least_duration(problem) > LONGEST:
                return "refused", refused, 0.0
            name = (error.limit or "").replace(" ", "_")
            if not options.get(name) or not error.allowed < options[name]:
                return "dishonest", refused, 0.0
            options[name] = error.allowed
            continue
        except ac.Unreachable as error:
            result = "refused" if _leaves_reach(problem) else "dishonest"
            return result, f"{type(error).__name__}: {error}", 0.0
        notes, worst = judge(planned, problem)
        if notes:
            return "violation", notes, worst
        return "refused" if refused else "planned", refused, worst
    return "dishonest", f"{refused} (and what was allowed was then refused too)", 0.0


def _least_duration(problem: Problem) -> float:
    """A time that the joints need for their ways along a joint path at full velocity [s]."""
    path, velocity = problem.path, problem.limits.joint_velocity
    if not isinstance(path, ac.JointPath) or velocity is None:
        return 0.0
    way = np.abs(np.diff(path(path.breaks), axis=0)).sum(axis=0)
    return float((way / velocity).max())


def _leaves_reach(problem: Problem) -> bool:
    path, arm = problem.path, problem.arm
    points = path(np.linspace(0, path.length, 100_001))
    distance = np.hypot(points[:, 0] - arm.base, points[:, 1])
    near, far = arm.reach
    return bool(distance.min() < near + EDGE or distance.max() > far - EDGE)


def judge(planned: ac.Trajectory, problem: Problem) -> tuple[str, float]:
    """What is wrong with a plan, in words, and its largest ratio to a limit."""
    (law,) = planned.laws
    n = len(law.breaks) - 1
    share = np.random.default_rng(problem.seed).random((n, PLACES + 2))
    share[:, 0], share[:, -1] = 0.0, 1.0
    t = law.breaks[:-1, None] + share * np.diff(law.breaks)[:, None]
    t[:, -1] = law.breaks[1:]
    t, i = t.ravel(), np.repeat(np.arange(n), PLACES + 2)
    q, dq, ddq = (law.on_interval(i, t, order) for order in (0, 1, 2))
    notes = _steps(law, q.reshape(n, -1, q.shape[1]), problem)
    found = _ratios(planned, problem, i, q, dq, ddq)
    worst = 0.0
    for name, ratio in found.items():
        at = int(np.argmax(np.where(np.isnan(ratio), np.inf, ratio)))
        worst = max(worst, float(ratio[at]))
        if not ratio[at] <= 1 + LEAK:
            notes.append(f"{name} 1 {ratio[at] - 1:+.2e} in interval {i[at]} at t = {t[at]:.9g} s")
    return "; ".join(notes), worst


def _steps(law: Any, q: np.ndarray, problem: Problem) -> list[str]:
    """Jumps at breaks, ends that are not the path's, and ways back."""
    notes = []
    path = law.joint_path
    i = np.arange(len(q))
    ends = law.path_position(i, law.breaks[1:])
    speeds = law.path_position(i, law.breaks[1:], 1)
    length, fastest = path.length, float(law.rates.ds.max())
    if law.s[0] != path.breaks[0] or law.s[-1] != path.breaks[-1] or (np.diff(law.s) <= 0).any():
        notes.append("s does not run from start to end")
    size = 1.0 + float(np.abs(q).max())
    if (np.abs(q[1:, 0] - q[:-1, -1]) > STEP * size).any():
        notes.append("joint positions jump")
    if np.abs(ends - law.s[1:]).max() > STEP * length:
        notes.append(f"intervals miss their ends by {np.abs(ends - law.s[1:]).max() / length:.1e}")
    after = np.append(law.rates.ds[1:], problem.options.get("end_speed", 0.0))
    if np.abs(speeds[:-1] - after[:-1]).max(initial=0.0) > 1e-6 * fastest:
        notes.append("path speed jumps")
    if (law.rates.ds[1:] < 0).any() or speeds.min() < -1e-6 * fastest:
        notes.append("runs back")
    if len(path.stops):
        at = np.searchsorted(law.s, path.stops)
        if (law.rates.ds[at[at < len(law.rates.ds)]] != 0).any():
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
    limits, arm = problem.limits, problem.arm
    found: dict[str, np.ndarray] = {}
    if limits.joint_velocity is not None:
        found["joint_velocity"] = (np.abs(dq) / limits.joint_velocity).max(axis=1)
    if limits.joint_acceleration is not None:
        low, high = limits.acceleration_bounds(q.shape[1])
        found["joint_acceleration"] = np.maximum(ddq / low, ddq / high).max(axis=1)
    if planned.path is None:
        return found
    velocity = arm.tool_velocity(q, dq)
    speed = np.linalg.norm(velocity, axis=1)
    s = planned.s(planned.breaks)
    middle = (s[:-1] + s[1:]) / 2
    own = planned.path.speeds[planned.path.locate(middle)][i]
    found["speed"] = speed / np.fmin(own, np.inf if limits.speed is None else limits.speed)
    if limits.tool_acceleration is None and limits.centripetal_acceleration is None:
        return found
    acceleration = arm.tool_acceleration(q, dq, ddq)
    if limits.tool_acceleration is not None:
        found["tool_acceleration"] = np.linalg.norm(acceleration, axis=1) / limits.tool_acceleration
    if limits.centripetal_acceleration is not None:
        moving = speed > SLOWEST
        normal = np.zeros(len(speed))
        cross = velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]
        normal[moving] = np.abs(cross[moving]) / speed[moving]
        found["centripetal_acceleration"] = normal / limits.centripetal_acceleration
    return found
