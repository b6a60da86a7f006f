"""`python -m soak.shaped_oracle`: the fastest motion within a tolerance, found by IPOPT.

It shares nothing with `armcontour.timing.shaping` but the starts, which are plans of arcs and of
full stops. Of a planar arm of two links along a polyline: joint accelerations are uniform over
steps, of which every line has the same number, all equally long; how long is free for every line.

Tolerance: every node of a line's part of the motion lies within the tolerance of that line (not of
others, so no path can hop to a crossing line), and the node between two lines lies within the
tolerance of their vertex. That is as much as a matching of path and polyline whose places are
within the tolerance, but for motion that goes back along a line. All is kept at the nodes only, so
an answer may be a little too fast; with a centripetal limit, few steps make it too slow.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

import armcontour as ac

# Part of the tolerance as corner error of the arcs from which the search starts.
ARCS = (0.3, 0.7, 1.0)
STARTS = ("stops", *ARCS)
# A tool this slow [m/s] has hardly a direction: it rounds the edge of the centripetal limit.
SLOW = 1e-5
# Steps per line for all starts, and for the best of them.
FEW, MANY = 45, 180
# Durations that differ by less than this factor are of one answer.
SAME = 1 + 1e-4
# Random jobs: corners, largest turn [rad], distances from the first joint [m].
CORNERS, MOST_TURN = 5, np.radians(150)
NEAR, FAR = 0.12, 0.44
KEPT = Path(__file__).with_name("shaped_durations.json")
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-7,
    "max_iter": 1500,
    "mu_init": 1e-2,
    "mu_strategy": "adaptive",
    "max_cpu_time": 60.0,
}


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is asked: SI units, points (n, 2), `centripetal` and `velocity` may be missing."""

    points: np.ndarray
    tolerance: float
    acceleration: float = 0.72
    speed: float = 0.15
    centripetal: float | None = None
    velocity: float | None = None
    base: float = 0.135
    links: tuple[float, float] = (0.250, 0.215)

    @property
    def lines(self) -> int:
        """How many lines there are."""
        return len(self.points) - 1

    @property
    def limits(self) -> ac.Limits:
        """The same limits for the package."""
        return ac.Limits(
            joint_acceleration=[self.acceleration] * 2,
            joint_velocity=None if self.velocity is None else [self.velocity] * 2,
            speed=self.speed,
            centripetal_acceleration=self.centripetal,
        )


@dataclass(frozen=True)
class Motion:
    """A motion: its duration [s], step lengths (m,), q (m + 1, 2) and ddq (m, 2), and its start."""

    duration: float
    steps: np.ndarray
    q: np.ndarray
    ddq: np.ndarray
    start: str


def solve(job: Job, steps: int, starts=STARTS) -> Motion | None:
    """The fastest motion that was found from any of the starts; None if none was.

    Args:
        job: What is asked.
        steps: Steps per line.
        starts: Of `STARTS`, or motions to start from.
    """
    program = _Program(job, steps)
    found = [program.solve(x) for x in starts]
    return min((x for x in found if x is not None), key=lambda x: x.duration, default=None)


def _start(job, start, steps):
    """Of the nodes q (2, m + 1), dq, ddq (2, m) and durations of the lines (n,) to start from."""
    if isinstance(start, Motion):
        return _resample(job, start, steps)
    path = ac.Path.polyline(job.points)
    rounded = ac.round_corners(path, tolerance=0.0 if start == "stops" else start * job.tolerance)
    planned = ac.plan(rounded, ac.load_arm("pmk3s"), job.limits)
    fine = np.linspace(0, planned.duration, 20_001)
    passed = np.interp(rounded.place(path.breaks[1:-1]), planned.s(fine), fine)
    ends = np.concatenate([[0.0], passed, [planned.duration]])
    t = np.concatenate([np.linspace(a, b, steps + 1)[:-1] for a, b in pairwise(ends)])
    t = np.append(t, planned.duration)
    return planned(t).T, planned(t, 1).T, planned((t[1:] + t[:-1]) / 2, 2).T, np.diff(ends)


def _resample(job, motion, steps):
    """The same motion on more steps, a multiple of its own."""
    times = steps * job.lines // len(motion.steps)
    h = np.repeat(motion.steps / times, times)
    ddq = np.repeat(motion.ddq, times, axis=0)
    dq = np.concatenate([np.zeros((1, 2)), np.cumsum(h[:, None] * ddq, axis=0)])
    step = h[:, None] * (dq[:-1] + dq[1:]) / 2
    q = motion.q[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return q.T, dq.T, ddq.T, motion.steps.reshape(job.lines, -1).sum(axis=1)


class _Program:
    """The nonlinear program of a job, made once for all starts."""

    def __init__(self, job: Job, steps: int) -> None:
        import casadi as ca

        self.job, self.steps = job, steps
        m = job.lines * steps
        q, v, a = ca.SX.sym("q", 2, m + 1), ca.SX.sym("v", 2, m + 1), ca.SX.sym("a", 2, m)
        time = ca.SX.sym("t", job.lines)
        h = ca.vertcat(*(time[k // steps] / steps for k in range(m))).T
        h = ca.vertcat(h, h)
        rows, low, high = [], [], []

        def demand(expression, least, most):
            rows.append(ca.vec(expression))
            low.append(np.full(rows[-1].numel(), least))
            high.append(np.full(rows[-1].numel(), most))

        demand(q[:, 1:] - q[:, :-1] - h * v[:, :-1] - h**2 / 2 * a, 0.0, 0.0)
        demand(v[:, 1:] - v[:, :-1] - h * a, 0.0, 0.0)
        tool, velocity = self._tool(ca, q), self._velocity(ca, q, v)
        demand(ca.sum1(velocity**2)[1:-1] / job.speed**2, -np.inf, 1.0)
        self._tube(ca, tool, demand)
        if job.centripetal is not None:
            for k in (slice(0, m), slice(1, m + 1)):
                self._turning(ca, q[:, k], v[:, k], a, demand)
        x = ca.vertcat(ca.vec(q), ca.vec(v), ca.vec(a), time)
        program = {"x": x, "f": ca.sum1(time), "g": ca.vertcat(*rows)}
        options = {"print_time": False, **{f"ipopt.{k}": y for k, y in IPOPT.items()}}
        self.solver = ca.nlpsol("fastest", "ipopt", program, options)
        self.low, self.high = np.concatenate(low), np.concatenate(high)

    def _tool(self, ca, q):
        (first, second), both = self.job.links, q[0, :] + q[1, :]
        x = self.job.base + first * ca.sin(q[0, :]) + second * ca.sin(both)
        return ca.vertcat(x, first * ca.cos(q[0, :]) + second * ca.cos(both))

    def _velocity(self, ca, q, v):
        (first, second), both, rate = self.job.links, q[0, :] + q[1, :], v[0, :] + v[1, :]
        x = first * ca.cos(q[0, :]) * v[0, :] + second * ca.cos(both) * rate
        return ca.vertcat(x, -first * ca.sin(q[0, :]) * v[0, :] - second * ca.sin(both) * rate)

    def _turning(self, ca, q, v, a, demand):
        """Centripetal acceleration |x' x x''| / |x'| at one end of every step."""
        (first, second), both, rate = self.job.links, q[0, :] + q[1, :], v[0, :] + v[1, :]
        velocity = self._velocity(ca, q, v)
        moved = self._velocity(ca, q, a)
        ax = -first * ca.sin(q[0, :]) * v[0, :] ** 2 - second * ca.sin(both) * rate**2
        ay = -first * ca.cos(q[0, :]) * v[0, :] ** 2 - second * ca.cos(both) * rate**2
        across = velocity[0, :] * (moved[1, :] + ay) - velocity[1, :] * (moved[0, :] + ax)
        speed = ca.sqrt(ca.sum1(velocity**2) + SLOW**2)
        demand((across - self.job.centripetal * speed) / 0.01, -np.inf, 0.0)
        demand((across + self.job.centripetal * speed) / 0.01, 0.0, np.inf)

    def _tube(self, ca, tool, demand):
        """Nodes within the tolerance of their own line, and of the vertex between two lines."""
        points, n = self.job.points, self.steps
        for k, (start, end) in enumerate(pairwise(points)):
            length = float(np.linalg.norm(end - start))
            dx, dy = (end - start) / length
            own = tool[:, k * n + 1 : (k + 1) * n]
            x, y = own[0, :] - start[0], own[1, :] - start[1]
            along, across = dx * x + dy * y, dx * y - dy * x
            beyond = ca.fmax(0, -along) + ca.fmax(0, along - length)
            demand((across**2 + beyond**2) / self.job.tolerance**2, -np.inf, 1.0)
            if k:
                off = tool[:, k * n] - ca.DM(start)
                demand(ca.sum1(off**2) / self.job.tolerance**2, -np.inf, 1.0)

    def solve(self, start) -> Motion | None:
        """The local optimum near a start; None if IPOPT finds none."""
        job, m = self.job, self.job.lines * self.steps
        q, dq, ddq, time = _start(job, start, self.steps)
        ends = ac.load_arm("pmk3s").inverse(job.points[[0, -1]])
        free = np.full((2, m + 1), np.inf)
        ends_q, ends_v = free.copy(), free.copy()
        ends_v[:] = np.inf if job.velocity is None else job.velocity
        low_q, high_q = -ends_q, ends_q.copy()
        low_q[:, [0, -1]] = high_q[:, [0, -1]] = ends.T
        low_v, high_v = -ends_v, ends_v.copy()
        low_v[:, [0, -1]] = high_v[:, [0, -1]] = 0.0
        most = np.full(2 * m, job.acceleration)
        found = self.solver(
            x0=np.concatenate([*(x.ravel(order="F") for x in (q, dq, ddq)), time]),
            lbx=np.concatenate(
                [low_q.ravel("F"), low_v.ravel("F"), -most, np.full(len(time), 1e-3)]
            ),
            ubx=np.concatenate(
                [high_q.ravel("F"), high_v.ravel("F"), most, np.full(len(time), 1e3)]
            ),
            lbg=self.low,
            ubg=self.high,
        )
        if not self.solver.stats()["success"]:
            return None
        x = np.asarray(found["x"]).ravel()
        lengths = np.repeat(x[-job.lines :] / self.steps, self.steps)
        q, ddq = x[: 2 * (m + 1)].reshape(-1, 2), x[4 * (m + 1) : -job.lines].reshape(-1, 2)
        name = start.start if isinstance(start, Motion) else str(start)
        return Motion(float(found["f"]), lengths, q, ddq, name)


def draw(seed: int) -> Job:
    """A random job of five corners; odd seeds have a limit of centripetal acceleration."""
    rng = np.random.default_rng((151, seed))
    while True:
        lengths = rng.uniform(0.015, 0.060, CORNERS + 1)
        turns = rng.uniform(-MOST_TURN, MOST_TURN, CORNERS)
        headings = rng.uniform(0, 2 * np.pi) + np.append(0.0, np.cumsum(turns))
        legs = lengths[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
        start = rng.uniform((-0.25, 0.05), (0.5, 0.4))
        points = np.concatenate([[start], start + np.cumsum(legs, axis=0)])
        distance = np.hypot(points[:, 0] - Job.base, points[:, 1])
        if distance.min() > NEAR and distance.max() < FAR:
            break
    tolerance = min(10 ** rng.uniform(-4, np.log10(5e-3)), lengths.min() / 2)
    return Job(points=points, tolerance=tolerance, centripetal=0.09 if seed % 2 else None)


def fastest(job: Job) -> Motion | None:
    """Every start on few steps, then the best two different answers on many."""
    program = _Program(job, FEW)
    coarse = [x for x in map(program.solve, STARTS) if x is not None]
    coarse.sort(key=lambda x: x.duration)
    best = coarse[:1] + [x for x in coarse[1:] if x.duration > coarse[0].duration * SAME][:1]
    return solve(job, MANY, best or STARTS)


def write(durations: dict[int, float], file: Path) -> None:
    """Write durations by seed, and how they were found."""
    source = "python -m soak.shaped_oracle"
    notes = {"source": source, "steps a line": [FEW, MANY], "starts": STARTS, "ipopt": IPOPT}
    rows = ",\n".join(f'    "{seed}": {durations[seed]}' for seed in sorted(durations))
    head = json.dumps(notes, indent=1)[:-2]
    file.write_text(f'{head},\n "durations": {{\n{rows}\n }}\n}}\n')


def main() -> int:
    """Solve the jobs, and write what they take."""
    parser = argparse.ArgumentParser(prog="python -m soak.shaped_oracle", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="how many jobs")
    parser.add_argument("--out", type=Path, default=KEPT, help="file of durations")
    given = parser.parse_args()
    durations: dict[int, float] = {}
    for seed in range(given.count):
        found = fastest(draw(seed))
        if found is None:
            print(f"seed {seed}: no answer")
            continue
        durations[seed] = round(found.duration, 6)
        print(f"seed {seed}: {found.duration:.6f} s from {found.start}", flush=True)
    write(durations, given.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
