"""Random joint paths with limits of jerk, each drawn from one integer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import armcontour as ac

Random = np.random.Generator
# Exponents of the distances between waypoints by which their parameters grow.
WAYS = {"uniform": 0.0, "centripetal": 0.5, "chordal": 1.0}
INTERVALS = (60, 200, 1000, 4000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What the planner is asked.

    Args:
        seed: Where it was drawn from.
        kind: What is special about it.
        path: A joint path.
        limits: The limits.
        options: Of `plan`.
    """

    seed: int
    kind: str
    path: ac.JointPath
    limits: ac.Limits
    options: dict[str, Any] = field(default_factory=dict)

    def scaled(self, q: float = 1.0, s: float = 1.0, t: float = 1.0) -> Problem:
        """The same problem in other units, in which the numbers are so many times as large."""
        path = ac.JointPath(
            breaks=s * self.path.breaks,
            coefficients=q * self.path.coefficients,
            stops=s * self.path.stops,
        )
        orders = {"velocity": 1, "acceleration": 2, "deceleration": 2, "jerk": 3}
        units = {f"joint_{name}": q / t**order for name, order in orders.items()}
        units["path_jerk"] = s / t**3
        changed = {
            name: unit * value
            for name, unit in units.items()
            if (value := getattr(self.limits, name)) is not None
        }
        options = {
            name: value * s / t if name.endswith("speed") else value
            for name, value in self.options.items()
        }
        return replace(self, path=path, limits=ac.Limits(**changed), options=options)


def draw(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng((16, seed))
    kind = str(rng.choice(list(KINDS), p=WEIGHTS))
    points = KINDS[kind](rng)
    width = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = WAYS[str(rng.choice(list(WAYS)))]
    s = np.concatenate([[0.0], np.cumsum((width / width.max()) ** way)])
    path = ac.JointPath.spline(points, s, ends="clamped" if rng.random() < 0.1 else "natural")
    limits = _limits(rng, path)
    options: dict[str, Any] = {"intervals": int(rng.choice(INTERVALS, p=[0.4, 0.35, 0.15, 0.1]))}
    problem = Problem(seed=seed, kind=kind, path=path, limits=limits, options=options)
    for name in ("start_speed", "end_speed"):
        if rng.random() < 0.06:
            options[name] = _speed(rng, path, limits)
    if rng.random() < 0.4:
        q, s_unit = 10 ** rng.uniform(-3, 3, 2)
        return problem.scaled(q, s_unit, 10 ** rng.uniform(-1, 1))
    return problem


def _points(rng: Random) -> np.ndarray:
    """Waypoints of 1 to 7 joints."""
    count, dof = int(rng.integers(4, 13)), int(rng.integers(1, 8))
    return rng.uniform(-1.5, 1.5, (count, dof))


def _near(rng: Random) -> np.ndarray:
    """Some waypoints nearly the same as those before them."""
    points = _points(rng)
    at = rng.choice(len(points) - 1, int(rng.integers(1, 3)), replace=False) + 1
    step = rng.normal(size=(len(at), points.shape[1])) * 10 ** rng.uniform(-6, -2)
    return np.insert(points, at, points[at - 1] + step, axis=0)


def _frozen(rng: Random) -> np.ndarray:
    """A joint that stands still."""
    points = _points(rng)
    points = np.column_stack([points, points[:, 0]]) if points.shape[1] == 1 else points
    points[:, rng.integers(points.shape[1])] = rng.uniform(-1.5, 1.5)
    return points


def _line(rng: Random) -> np.ndarray:
    """Points of a straight line, some of them evenly spaced."""
    ends = rng.uniform(-1.5, 1.5, (2, int(rng.integers(1, 8))))
    inner = np.sort(rng.uniform(0, 1, int(rng.integers(0, 6))))
    share = np.concatenate([[0.0], inner, [1.0]])
    if rng.random() < 0.5:
        share = np.linspace(0, 1, len(share))
    return ends[0] + share[:, None] * (ends[1] - ends[0])


def _smooth(rng: Random) -> np.ndarray:
    """Many waypoints of a smooth curve."""
    t = np.linspace(0, 2 * np.pi, int(rng.integers(20, 60)))[:, None]
    waves = rng.integers(1, 4, (2, int(rng.integers(2, 8))))
    return np.sin(waves[0] * t + waves[1]) + 0.1 * t


def _limits(rng: Random, path: ac.JointPath) -> ac.Limits:
    """Random limits: those of jerk are 2 to 300 times those of acceleration."""
    dof = path.dof
    acceleration = 10 ** (rng.uniform(0, 1) + rng.uniform(-0.4, 0.4, dof))
    wanted: dict[str, Any] = {"joint_acceleration": acceleration}
    if rng.random() < 0.15:
        wanted["joint_deceleration"] = acceleration * 10 ** rng.uniform(-0.5, 0.5, dof)
    if rng.random() < 0.7:
        wanted["joint_velocity"] = 10 ** (rng.uniform(-0.5, 0.7) + rng.uniform(-0.3, 0.3, dof))
    factor = 10 ** rng.uniform(np.log10(2), np.log10(300))
    jerk = factor * acceleration * 10 ** rng.uniform(-0.2, 0.2, dof)
    slope = np.abs(path(np.linspace(path.breaks[0], path.breaks[-1], 200), 1)).max(axis=0)
    least = float((jerk[slope > 0] / slope[slope > 0]).min())
    some = rng.random()
    if some < 0.15:
        wanted["path_jerk"] = least * 10 ** rng.uniform(-0.5, 1.0)
    if some < 0.04:
        return ac.Limits(**wanted)
    if rng.random() < 0.15:
        jerk[rng.random(dof) < 0.5] = np.inf
        if not np.isfinite(jerk).any():
            jerk[0] = factor * acceleration[0]
    return ac.Limits(**wanted, joint_jerk=jerk)


def _speed(rng: Random, path: ac.JointPath, limits: ac.Limits) -> float:
    """A speed at an end, now and then higher than can be had."""
    slope = float(np.abs(path(path.breaks, 1)).max())
    scale = np.sqrt(float(np.min(limits.joint_acceleration)) * path.length / slope)
    return float(scale * 10 ** rng.uniform(-3, 0.0))


KINDS: dict[str, Callable[[Random], np.ndarray]] = {
    "points": _points,
    "near-duplicates": _near,
    "frozen joint": _frozen,
    "line": _line,
    "smooth": _smooth,
}
WEIGHTS = (0.4, 0.25, 0.15, 0.1, 0.1)
