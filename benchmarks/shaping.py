"""Shape the fastest path within a tolerance, against arcs and the optimum that IPOPT finds."""

from __future__ import annotations

from typing import Any

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from armcontour.geometry import ShapedPath
from benchmarks import reference, ur5e
from benchmarks.measured import Bar, Line, Pair, timed

CENTRIPETAL = 0.09  # m/s², limit of the tool
SPEED = 0.15  # m/s, limit of the tool
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
LONGEST = {1: 2.0, 2: 6.0}
# Numbers of corners on the two long paths whose times are compared.
LONG = 1000
SHORT = 100
# Tolerance of both [m].
LONG_TOLERANCE = 2e-3
# Smallest and largest length of their lines [m].
STEPS = (0.015, 0.040)
# Smallest and largest distance from the first joint between which they stay [m].
NEAR = 0.15
FAR = 0.42


def lines() -> list[Line]:
    """Return the lines for both jobs, the UR5e's square, and long paths."""
    entries = []
    for job, tolerance, *bars in BARS:
        name = f"{job}/{tolerance:g}mm"
        title = f"job {job}, {tolerance:g} mm"
        task = {"points": POINTS[job], "options": {"tolerance": tolerance / 1e3}}
        for cap, (bar, oracle) in zip((CENTRIPETAL, None), bars, strict=True):
            entries.append(_line(name, title, task, cap, bar, oracle, LONGEST[job]))
    longer = Bar(ratio=12, seconds=30)
    title = f"shaped: {LONG} corners, 2 mm"
    peer = f"{SHORT} corners"
    return [
        *entries,
        Line(
            "shaped/ur5e", "shaped: UR5e, square, 0.25 mm", reference.NAME, _space, Bar(seconds=5)
        ),
        Line("shaped/long", title, peer, _long, longer, full=True),
    ]


def _line(
    name: str,
    title: str,
    job: dict[str, Any],
    cap: float | None,
    bar: float,
    oracle: float | None,
    longest: float,
) -> Line:
    """Return a line for a job on the PMK-3s, with its expected duration and an oracle's."""
    if cap is not None:
        name = f"{name}/centripetal"
        title = f"{title}, centripetal limit"
    bar_text = f"bar {bar:g}{'' if oracle is None else f', oracle {oracle:.3f}'}"

    def prepare() -> Pair:
        arm = ac.load_arm("pmk3s")
        limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=cap)
        path = ac.Path.polyline(job["points"])
        return _pair(path, arm, limits, job["options"], bar_text)

    return Line(f"shaped/{name}", f"shaped: {title}", reference.NAME, prepare, Bar(seconds=longest))


def _space() -> Pair:
    limits = ac.Limits.only(joint_velocity=3.14, joint_acceleration=8.0, speed=0.25)
    return _pair(ur5e.square(), ur5e.load(), limits, {"tolerance": ur5e.CORNER_ERROR}, "no bar")


def _pair(
    path: ac.Path, arm: ac.Arm, limits: ac.Limits, options: dict[str, float], bar_text: str
) -> Pair:
    trajectories: list[ac.Trajectory] = []

    def shape() -> None:
        trajectories[:] = [ac.plan(path, arm, limits, ac.Shaped(**options))]

    def notes() -> list[str]:
        arcs = ac.plan(ac.round_corners(path, tolerance=options["tolerance"]), arm, limits)
        (shaped,) = trajectories
        assert isinstance(shaped.path, ShapedPath)
        start = shaped.path.outcome.start
        ours = f"shaped {shaped.duration:.4f} s from {start}"
        return [f"arcs {arcs.duration:.4f} s, {ours} ({bar_text})"]

    return Pair(timed(shape), timed(reference.work), notes)


def _long() -> Pair:
    """Compare the times for ten times as many corners."""
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=CENTRIPETAL)

    def shape(corners: int) -> ac.Trajectory:
        path = ac.Path.polyline(wander(corners))
        return ac.plan(path, arm, limits, ac.Shaped(tolerance=LONG_TOLERANCE))

    # Shaping many corners is warm after few.
    shape(SHORT)
    return Pair(timed(lambda: shape(LONG)), timed(lambda: shape(SHORT)), warm=True)


def wander(corners: int) -> FloatArray:
    """Draw a random walk within the reach of the PMK-3s [m], (corners + 2, 2)."""
    rng = np.random.default_rng(1)
    points = [np.array([0.30, 0.20])]
    while len(points) < corners + 2:
        heading = rng.uniform(0, 2 * np.pi)
        there = points[-1] + rng.uniform(*STEPS) * np.array([np.cos(heading), np.sin(heading)])
        middle = (points[-1] + there) / 2
        radii = np.hypot(*(np.array([middle, there]) - (0.135, 0.0)).T)
        if (radii > NEAR).all() and (radii < FAR).all() and there[1] > 0:
            points.append(there)
    return np.array(points)
