"""The fastest path within a tolerance, against arcs, its bars and what IPOPT finds."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

import armcontour as ac
from armcontour._checks import FloatArray
from benchmarks import ur5e
from benchmarks.measured import Measured, paired

CENTRIPETAL, SPEED = 0.09, 0.15  # m/s², m/s
POINTS = {
    1: ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)),
    2: (
        *((0.25, 0.20), (0.35, 0.20), (0.40, 0.26), (0.33, 0.30), (0.33, 0.36), (0.24, 0.34)),
        *((0.26, 0.27), (0.18, 0.25), (0.12, 0.32), (0.07, 0.24), (0.15, 0.17), (0.22, 0.12)),
    ),
}
# Job, tolerance [mm], then bar and oracle [s] with the centripetal limit and without it. The oracle
# is soak.shaped_oracle with 300 and 100 steps a line.
BARS = (
    (1, 5.0, (4.76, 4.7247), (4.42, 4.4070)),
    (1, 1.0, (5.05, 5.0173), (4.88, 4.8696)),
    (1, 0.1, (5.15, 5.1476), (5.10, 5.0900)),
    (2, 5.0, (12.75, 12.6120), (11.50, 11.3926)),
    (2, 1.0, (14.30, 14.2093), (13.12, 13.0570)),
    (2, 0.1, (15.25, 15.1954), (14.75, None)),
)
# Line tolerance [mm] and zone [mm] of a mixed tolerance of 5 mm on job 1, and its bars.
MIXED = (0.1, 20.0), (4.90, 4.64)
LONGEST = {1: "< 2 s", 2: "< 6 s"}
# Corners of long paths, their tolerance and the lengths of their lines [m].
LONG, SHORT = 1000, 100
LONG_TOLERANCE, STEPS = 2e-3, (0.015, 0.040)
# Distances from the first joint between which long paths stay [m].
NEAR, FAR = 0.15, 0.42
RUNS = 3


@dataclass(frozen=True)
class Shaped:
    """One motion: durations of arcs and of the shaped path [s], with its bar and the oracle's."""

    what: str
    arcs: float
    shaped: float
    start: str
    bar: str
    oracle: str


def measure() -> tuple[list[Measured], list[Shaped], list[str]]:
    """Times, durations, and a note."""
    arm = ac.load_arm("pmk3s")
    measured: list[Measured] = []
    shapes: list[Shaped] = []
    for job, tolerance, *bars in BARS:
        path = ac.Path.polyline(POINTS[job])
        for cap, (bar, oracle) in zip((CENTRIPETAL, None), bars, strict=True):
            limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=cap)
            what = f"job {job}, {tolerance:g} mm{', centripetal limit' if cap else ''}"
            found = _both(what, path, arm, limits, {"tolerance": tolerance / 1e3}, LONGEST[job])
            measured.append(found[0])
            known = "-" if oracle is None else f"{oracle:.3f}"
            shapes.append(_shaped(what, *found[1:], f"{bar:g}", known))
    (line, zone), bars = MIXED
    options = {"tolerance": 5e-3, "line_tolerance": line / 1e3, "zone": zone / 1e3}
    for cap, bar in zip((CENTRIPETAL, None), bars, strict=True):
        limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=cap)
        what = f"job 1, lines {line:g} mm, corners 5 mm{', centripetal limit' if cap else ''}"
        found = _both(what, ac.Path.polyline(POINTS[1]), arm, limits, options, "< 2 s")
        measured.append(found[0])
        shapes.append(_shaped(what, *found[1:], f"{bar:g}", "-"))
    space, square = ur5e.load(), ur5e.square()
    joints = ac.Limits(joint_velocity=3.14, joint_acceleration=8.0, speed=0.25)
    options = {"tolerance": ur5e.CORNER_ERROR}
    found = _both("UR5e, square, 0.25 mm", square, space, joints, options, "< 5 s")
    measured.append(found[0])
    shapes.append(_shaped(found[0].what, *found[1:], "-", "-"))
    long, note = _long(arm)
    return [*measured, *long], shapes, [note]


def _both(
    what: str,
    path: ac.Path,
    arm: ac.Arm,
    limits: ac.Limits,
    options: dict[str, float],
    bar: str,
) -> tuple[Measured, ac.Trajectory, ac.Trajectory]:
    """Times and motions of the arcs and of the shaped path."""
    found: dict[str, ac.Trajectory] = {}

    def arcs() -> None:
        rounded = ac.round_corners(path, tolerance=options["tolerance"])
        found["arcs"] = ac.plan(rounded, arm, limits)

    def shape() -> None:
        found["shaped"] = ac.plan(path, arm, limits, method="shaped", **options)

    ours, peer = paired(shape, arcs, RUNS)
    return Measured(f"shaped: {what}", ours, "arcs", peer, bar), found["arcs"], found["shaped"]


def _shaped(what: str, arcs: ac.Trajectory, shaped: ac.Trajectory, bar: str, oracle: str) -> Shaped:
    assert isinstance(shaped.path, ac.ShapedPath)
    start = shaped.path.outcome.start
    return Shaped(what, arcs.duration, shaped.duration, start, bar, oracle)


def _long(arm: ac.Arm) -> tuple[list[Measured], str]:
    """How much longer ten times the corners take."""
    limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=CENTRIPETAL)
    taken, durations = [], []
    for corners in (SHORT, LONG):
        path = ac.Path.polyline(wander(corners))
        begin = time.perf_counter()
        planned = ac.plan(path, arm, limits, method="shaped", tolerance=LONG_TOLERANCE)
        taken.append(time.perf_counter() - begin)
        arcs = ac.plan(ac.round_corners(path, tolerance=LONG_TOLERANCE), arm, limits)
        durations.append(f"{corners} corners: arcs {arcs.duration:.2f} s")
        durations[-1] += f", shaped {planned.duration:.2f} s"
    row = Measured(
        f"shaped: {LONG} corners, 2 mm",
        taken[1],
        f"{SHORT} corners",
        taken[0],
        "<= 12, <= 30 s on 2 cores",
    )
    return [row], f"Shaped: {'; '.join(durations)}."


def wander(corners: int) -> FloatArray:
    """Points of a random walk within the reach of the PMK-3s [m], (corners + 2, 2)."""
    rng = np.random.default_rng(1)
    points = [np.array([0.30, 0.20])]
    while len(points) < corners + 2:
        heading = rng.uniform(0, 2 * np.pi)
        there = points[-1] + rng.uniform(*STEPS) * np.array([np.cos(heading), np.sin(heading)])
        middle = (points[-1] + there) / 2
        off = np.hypot(*(np.array([middle, there]) - (0.135, 0.0)).T)
        if (off > NEAR).all() and (off < FAR).all() and there[1] > 0:
            points.append(there)
    return np.array(points)


if __name__ == "__main__":
    rows, found, notes = measure()
    for row in rows:
        print(
            f"{row.what}: {row.ours:.2f} s ({row.ours / row.peer_time:.1f} x {row.peer}; {row.bar})"
        )
    for x in found:
        more = f"from {x.start}; bar {x.bar}, oracle {x.oracle}"
        print(f"{x.what}: arcs {x.arcs:.4f}, shaped {x.shaped:.4f} {more}")
    print(*notes, sep="\n")
