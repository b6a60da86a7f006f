"""Shortest time of one joint along a path that turns back, in closed form.

Between two positions at which it turns back, the joint starts and ends at rest, so the fastest
motion is a trapezoid of velocity. The limits may differ between the directions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import armcontour as ac

Limit = tuple[float, float]  # Largest and smallest value


def draw(seed: int, *, rough: bool) -> tuple[ac.JointPath, Limit, Limit]:
    """A random Hermite path of one joint, and its limits of velocity and acceleration."""
    rng = np.random.default_rng([seed, rough])
    n = int(rng.integers(2, 9))
    q = rng.normal(size=(n + 1, 1))
    if rough:
        width = 10 ** rng.uniform(-5, 0, n)
        slope = rng.normal(size=(n + 1, 1)) * 10 ** rng.uniform(-2, 2, (n + 1, 1))
        bend = rng.normal(size=(n + 1, 1)) * 10 ** rng.uniform(-1, 3, (n + 1, 1))
        bend *= rng.random() < 0.5
    else:
        width = rng.uniform(0.3, 1.0, n)
        slope = 1.5 * rng.normal(size=(n + 1, 1))
        bend = 3.0 * rng.normal(size=(n + 1, 1))
    breaks = np.concatenate([[0.0], np.cumsum(width)])
    begin, end = ([x[part] for x in (q, slope, bend)] for part in (slice(-1), slice(1, None)))
    path = ac.JointPath.hermite(breaks, tuple(begin), tuple(end))
    up, down = 10 ** rng.uniform(-1, 1, 2)
    faster, slower = 10 ** rng.uniform(-1.5, 1, 2)
    return path, (-down, up), (-slower, faster)


def limits_of(velocity: Limit, acceleration: Limit) -> ac.Limits:
    """The limits of one joint."""
    return ac.Limits(joint_velocity=[velocity], joint_acceleration=[acceleration])


def shortest_time(path: ac.JointPath, velocity: Limit, acceleration: Limit) -> float:
    """Shortest time of the only joint along its path, from rest to rest [s]."""
    turns = find_turns(path)
    total = 0.0
    for way in np.diff(turns):
        if way > 0:
            total += _trapezoid(way, velocity[1], acceleration[1], -acceleration[0])
        elif way < 0:
            total += _trapezoid(-way, -velocity[0], -acceleration[0], acceleration[1])
    return total


def find_turns(path: ac.JointPath) -> Sequence[float]:
    """Both ends of a path of one joint, and the positions at which it turns back [rad]."""
    values = [float(path.coefficients[0, 0, 0])]
    for c in path.coefficients[:, :, 0]:
        polynomial = np.polynomial.Polynomial(c)
        roots = polynomial.deriv().roots()
        real = np.sort(roots[np.abs(roots.imag) < 1e-7].real)
        inner = real[(real > 0) & (real < 1)]
        values += [float(polynomial(x)) for x in (*inner, 1.0)]
    turns = values[:1]
    for value in values[1:]:
        goes_on = len(turns) > 1 and (value - turns[-1]) * (turns[-1] - turns[-2]) >= 0
        if goes_on:
            turns[-1] = value
        elif value != turns[-1]:
            turns.append(value)
    return turns


def _trapezoid(way: float, fastest: float, up: float, down: float) -> float:
    """Time from rest to rest with the accelerations `up` and `down` [s]."""
    peak = min(fastest, np.sqrt(2 * way * up * down / (up + down)))
    ramps = peak * peak / 2 * (1 / up + 1 / down)
    return float(peak / up + peak / down + (way - ramps) / peak)
