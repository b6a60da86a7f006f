"""`python -m soak.kerf`: offsets of random contours, judged by distances; exit code 1 if one fails.

`python -m soak.kerf --plates 200` cuts random plates with planned tool paths and compares the parts
with what is drawn (`soak.parts`); `python -m soak.kerf FILE ... --width 0.2` does it with drawings.

The judge shares nothing with the offset. It samples the contours, has its own distance to lines and
arcs, and asks of each offset: is every point of it at the distance d from the contour; does it
cover every point at distance d on its side that no other place of the contour is nearer to; and
does it wind around just those random points that lie at this side, farther than d away.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import armcontour as ac
from armcontour.errors import ArmContourError, InvalidInput
from soak import parts

# What is allowed between an offset and its distance [m].
ALLOWED = 1e-6
# Steps along a contour between samples, as a share of its length.
STEPS = 200
POINTS = 60


def shape(rng: np.random.Generator, scale: float) -> ac.Path:
    """A random closed contour of lines and arcs around (0, 0), within a circle of radius scale."""
    n = int(rng.integers(3, 11))
    angles = (
        np.sort(rng.uniform(0, 2 * np.pi, n))
        if rng.random() < 0.5
        else (np.arange(n) * 2 * np.pi / n)
    )
    knots = (
        scale * rng.uniform(0.1, 1, n)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    )
    if rng.random() < 0.5:
        knots = knots[::-1]
    segments: list[ac.Line | ac.Arc] = []
    for a, b in zip(knots, np.roll(knots, -1, axis=0), strict=True):
        if rng.random() < 0.5:
            segments.append(ac.Line(start=a, end=b))
        else:
            across = np.array([a[1] - b[1], b[0] - a[0]])
            middle = (a + b) / 2 + rng.choice([-1, 1]) * rng.uniform(0.02, 0.25) * across
            segments.append(ac.Arc.through(a, middle, b))
    path = ac.Path.from_segments(segments)
    if rng.random() < 0.4:
        path = ac.round_corners(path, tolerance=scale * rng.uniform(0.001, 0.05))
    return path


def distances(points: np.ndarray, path: ac.Path) -> np.ndarray:
    """Distances of points to a path, segment by segment."""
    found = np.full(len(points), np.inf)
    for i in range(len(path)):
        a, t, n = path.starts[i], path.tangents[i], path.normals[i]
        k, length = path.curvatures[i], path.lengths[i]
        v = points - a
        if k == 0:
            u = np.clip(v @ t, 0, length)
            near = np.linalg.norm(v - u[:, None] * t, axis=1)
        else:
            center = a + n / k
            w = points - center
            angle = np.arctan2(w @ t, -(w @ n)) % (2 * np.pi)
            end = center + (np.sin(k * length) * t - np.cos(k * length) * n) / k
            ends = np.minimum(np.linalg.norm(v, axis=1), np.linalg.norm(points - end, axis=1))
            on = np.abs(np.linalg.norm(w, axis=1) - 1 / k)
            near = np.where(angle <= k * length, on, ends)
        found = np.minimum(found, near)
    return found


def samples(path: ac.Path) -> tuple[np.ndarray, np.ndarray]:
    """Points along a path and the unit normals to its left there; around corners all of them."""
    places = np.union1d(np.linspace(0, path.length, STEPS), path.breaks)
    points, normals = [], []
    for side in ("left", "right"):
        tangents = path(places, 1, side=side)
        points.append(path(places))
        normals.append(np.column_stack([-tangents[:, 1], tangents[:, 0]]))
    before, after = normals
    for share in np.linspace(0.1, 0.9, 5):
        mixed = before * (1 - share) + after * share
        size = np.linalg.norm(mixed, axis=1)
        bent = size < 1 - 1e-9
        points.append(path(places[bent]))
        normals.append(mixed[bent] / size[bent, None])
    # The vertex at which a closed path begins.
    first, last = path(0.0, 1), path(path.length, 1, side="left")
    for share in np.linspace(0, 1, 7):
        t = first * (1 - share) + last * share
        points.append(path([0.0]))
        normals.append(np.array([[-t[1], t[0]]]) / np.linalg.norm(t))
    return np.concatenate(points), np.concatenate(normals)


def windings(points: np.ndarray, path: ac.Path) -> np.ndarray:
    """Winding numbers of a closed path around points, by a polygon of many sides."""
    fine = path(np.union1d(np.linspace(0, path.length, 5 * STEPS), path.breaks))
    angles = np.arctan2(fine[:, 1] - points[:, 1:], fine[:, 0] - points[:, :1])
    steps = (np.diff(angles, axis=1) + np.pi) % (2 * np.pi) - np.pi
    return np.round(steps.sum(axis=1) / (2 * np.pi)).astype(int)


def comes_back(path: ac.Path) -> bool:
    """Whether two samples are nearer than their places along a closed path let expect."""
    n = 3 * STEPS
    points = path(np.linspace(0, path.length, n, endpoint=False))
    apart = np.abs(np.arange(n)[:, None] - np.arange(n))
    apart = np.minimum(apart, n - apart)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= path.length / n
    return bool((near & (apart > 3)).any())


def judge(rng: np.random.Generator, source: ac.Path, side: str, kerf: float) -> str:
    """What an offset is, "offset", "parts", "vanished" or "crossing"; raises AssertionError."""
    d, scale = kerf / 2, float(np.abs(source.vertices).max())
    program = ac.Program(moves=(ac.Contour(path=source, name="c", keep_start=True),))
    process = ac.Process(begin="drawn", kerf=kerf, kerf_side=side)
    try:
        found = [x.path for x in ac.prepare(program, process).contours]
    except InvalidInput as error:
        if "crosses" in str(error):
            assert comes_back(source), "does not cross itself"
            return "crossing"
        assert "leaves nothing" in str(error), str(error)
        assert error.allowed is not None and error.allowed < kerf
        found = []
    sign = 1 if side == "left" else -1
    places = rng.uniform(-1.1 * scale - 1.1 * d, 1.1 * scale + 1.1 * d, (POINTS, 2))
    away = distances(places, source)
    turns = windings(places, source)
    # The direction of the contour, by its area.
    x, y = source(np.linspace(0, source.length, 5 * STEPS)).T
    about = 1 if np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0 else -1
    held = (turns != 0) == (about * sign > 0)
    # Nearer than that, the chords of the windings decide.
    sure = (np.abs(away - d) > 1e-4 * scale) & (away > 1e-3 * scale)
    expected = held & (away > d)
    around = sum((windings(places, x) for x in found), np.zeros(POINTS, dtype=int))
    inside = around != 0 if about * sign > 0 else around == 0
    if found or about * sign > 0:
        assert (inside == expected)[sure].all(), "another area"
    for x in found:
        on = x(np.linspace(0, x.length, STEPS))
        worst = np.abs(distances(on, source) - d).max()
        assert worst <= ALLOWED, f"{worst:.3g} m off"
        assert np.linalg.norm(x(0.0) - x(x.length)) <= 1e-9, "open"
    points, normals = samples(source)
    asked = points + sign * d * normals
    asked = asked[distances(asked, source) >= d - 1e-12]
    if len(asked) and found:
        missed = np.min([distances(asked, x) for x in found], axis=0).max()
        assert missed <= ALLOWED, f"{missed:.3g} m missed"
    elif len(asked):
        # Where the offset shrinks to a point, rounding may leave one.
        apart = np.linalg.norm(asked - asked[0], axis=1).max()
        assert apart <= ALLOWED, "vanished, but should not"
    return ("vanished", "offset")[len(found)] if len(found) < 2 else "parts"


def judge_nested(rng: np.random.Generator, kerf: float) -> str:
    """An outline with a hole and an island in it, by the waste side; raises AssertionError."""
    parts = [shape(rng, 0.1 * x) for x in (1, 0.25, 0.06)]
    names = ("outline", "hole", "island")
    program = ac.Program(
        moves=tuple(ac.Contour(path=x, name=n) for x, n in zip(parts, names, strict=True))
    )
    try:
        done = ac.prepare(program, ac.Process(kerf=kerf))
    except InvalidInput as error:
        return "crossing" if "crosses" in str(error) else "refused"
    places = rng.uniform(-0.12, 0.12, (POINTS, 2))
    away = np.min([distances(places, x) for x in parts], axis=0)
    material = sum((windings(places, x) != 0).astype(int) for x in parts) % 2 == 1
    left = sum((windings(places, x.path) != 0).astype(int) for x in done.contours) % 2 == 1
    sure = (np.abs(away - kerf / 2) > 1e-5) & (away > 1e-4)
    nested = all(
        (windings(parts[k](np.linspace(0, parts[k].length, 99)), parts[k - 1]) != 0).all()
        for k in (1, 2)
    )
    if not nested:
        return "crossing"
    assert (left == (material | (away < kerf / 2)))[sure].all(), "another area of the part"
    for x in done.contours:
        near = np.min(
            [distances(x.path(np.linspace(0, x.path.length, STEPS)), y) for y in parts], axis=0
        )
        assert np.abs(near - kerf / 2).max() <= ALLOWED, "another distance"
    return "nested"


def run(seed: int) -> str:
    """Judge the problem of a seed."""
    rng = np.random.default_rng(seed)
    found = "crossing"
    # Shapes that cross are drawn anew.
    while found == "crossing":
        if seed % 5 == 4:
            found = judge_nested(rng, 10 ** rng.uniform(-5, -2.5))
            continue
        scale = 10 ** rng.uniform(-2.5, -0.5)
        side = "left" if rng.random() < 0.5 else "right"
        share = rng.uniform(0.1, 0.6) if seed % 5 == 3 else 10 ** rng.uniform(-3, 0.2)
        found = judge(rng, shape(rng, scale), side, scale * share)
    return found


# Largest figures of all parts.
WORST: dict[str, float] = {}


def run_part(judged: Callable[[], tuple[str, parts.Verdict | None]], say: str = "") -> str:
    """Cut a part and judge it; with a name, say what is found of it."""
    try:
        kind, verdict = judged()
    except ArmContourError as error:
        if say:
            print(f"{say}: {error}")
        return "refused"
    if verdict is not None:
        for name in ("cut_into", "left_over", "lost", "open_error"):
            WORST[name] = max(WORST.get(name, 0.0), getattr(verdict, name))
        WORST["least reached"] = min(WORST.get("least reached", 1.0), verdict.reached)
        if say:
            print(f"{say}: {verdict}")
    return kind


def main() -> int:
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.kerf", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="how many contours")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--plates", type=int, default=0, help="how many plates, no contours then")
    parser.add_argument(
        "files", nargs="*", type=Path, help="drawings that are cut, no contours then"
    )
    parser.add_argument("--width", type=float, default=0.2, help="kerf of these drawings [mm]")
    given = parser.parse_args()
    begin, counts, failed = time.perf_counter(), Counter[str](), 0
    seeds = range(given.first_seed, given.first_seed + (given.plates or given.count))
    problems: dict[str, Callable[[], str]] = {f"seed {x}": partial(run, x) for x in seeds}
    if given.plates:
        problems = {f"seed {x}": partial(run_part, partial(parts.run, x)) for x in seeds}
    if given.files:
        cut = partial(parts.run_file, kerf=1e-3 * given.width)
        problems = {str(x): partial(run_part, partial(cut, x), say=str(x)) for x in given.files}
    for name, problem in problems.items():
        try:
            counts[problem()] += 1
        except Exception as error:
            failed += 1
            print(f"{name}: {type(error).__name__}: {error}")
    if WORST:
        print({name: f"{x:.3g}" for name, x in WORST.items()})
    print(f"{dict(counts)}, {failed} failed, in {time.perf_counter() - begin:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
