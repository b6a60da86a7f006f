"""The fastest motion within a tolerance, by IPOPT, for an arm of two links along a polyline.

It shares nothing with `armcontour.planning.shaping` but the starts, which are plans of arcs and of
full stops. Joint accelerations are uniform over steps, of which every line has the same number, all
equally long; how long is free for every line. Every node of a line's part of the motion lies within
the tolerance of that line, and the node between two lines within the tolerance of their vertex. All
is kept at the nodes only, so that an answer may be a little too fast; with a centripetal limit, few
steps make it too slow.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from soak import Outcome

import armcontour as ac

# Part of the tolerance as corner error of the arcs from which the search starts.
ARCS = (0.3, 0.7, 1.0)
STARTS = ("stops", *ARCS)
# A tool this slow [m/s] has hardly a direction: it rounds the edge of the centripetal limit.
SLOW = 1e-5
# Steps per line.
STEPS_OF_LINE = 180
# Corners of a random job.
CORNERS = 5
# Largest turn at its corners, in both directions [rad].
MOST_TURN = np.radians(150)
# Smallest and largest distance of its vertices from the first joint [m].
INSIDE = 0.12
OUTSIDE = 0.44
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-7,
    "max_iter": 1500,
    "mu_init": 1e-2,
    "mu_strategy": "adaptive",
    "max_cpu_time": 60.0,
}
# A shaped motion may be longer than the oracle's by this share: nearly all of them are by less.
BAR = 0.03


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
        return ac.Limits.only(
            joint_acceleration=[self.acceleration] * 2,
            joint_velocity=None if self.velocity is None else [self.velocity] * 2,
            speed=self.speed,
            centripetal_acceleration=self.centripetal,
        )


def solve(job: Job, steps: int, starts=STARTS) -> float | None:
    """Duration of the fastest motion found from any of the starts [s]; None if none was."""
    program = _Program(job, steps)
    durations = [program.solve(x) for x in starts]
    return min((x for x in durations if x is not None), default=None)


def _start(job, start, steps):
    """Of the nodes q (2, m + 1), dq, ddq (2, m) and durations of the lines (n,) to start from."""
    path = ac.Path.polyline(job.points)
    rounded = ac.round_corners(path, tolerance=0.0 if start == "stops" else start * job.tolerance)
    planned = ac.plan(
        rounded, ac.load_arm("pmk3s"), job.limits, ac.Optimal(configuration="positive")
    )
    fine = np.linspace(0, planned.duration, 20_001)
    passed = np.interp(rounded.place(path.breaks[1:-1]), planned.s(fine), fine)
    ends = np.concatenate([[0.0], passed, [planned.duration]])
    t = np.concatenate([np.linspace(a, b, steps + 1)[:-1] for a, b in pairwise(ends)])
    t = np.append(t, planned.duration)
    return planned(t).T, planned(t, 1).T, planned((t[1:] + t[:-1]) / 2, 2).T, np.diff(ends)


class _Program:
    """The nonlinear program of a job, made once for all starts."""

    def __init__(self, job: Job, steps: int) -> None:
        import casadi as ca

        self.job = job
        self.steps = steps
        m = job.lines * steps
        q = ca.SX.sym("q", 2, m + 1)
        v = ca.SX.sym("v", 2, m + 1)
        a = ca.SX.sym("a", 2, m)
        time = ca.SX.sym("t", job.lines)
        h = ca.vertcat(*(time[k // steps] / steps for k in range(m))).T
        h = ca.vertcat(h, h)
        rows = []
        low = []
        high = []

        def demand(expression, lower, upper):
            rows.append(ca.vec(expression))
            low.append(np.full(rows[-1].numel(), lower))
            high.append(np.full(rows[-1].numel(), upper))

        demand(q[:, 1:] - q[:, :-1] - h * v[:, :-1] - h**2 / 2 * a, 0.0, 0.0)
        demand(v[:, 1:] - v[:, :-1] - h * a, 0.0, 0.0)
        tool = self._tool(ca, q)
        velocity = self._velocity(ca, q, v)
        demand(ca.sum1(velocity**2)[1:-1] / job.speed**2, -np.inf, 1.0)
        self._tube(ca, tool, demand)
        if job.centripetal is not None:
            for k in (slice(0, m), slice(1, m + 1)):
                self._turning(ca, q[:, k], v[:, k], a, demand)
        x = ca.vertcat(ca.vec(q), ca.vec(v), ca.vec(a), time)
        program = {"x": x, "f": ca.sum1(time), "g": ca.vertcat(*rows)}
        options = {"print_time": False, **{f"ipopt.{k}": y for k, y in IPOPT.items()}}
        self.solver = ca.nlpsol("fastest", "ipopt", program, options)
        self.low = np.concatenate(low)
        self.high = np.concatenate(high)

    def _tool(self, ca, q):
        first, second = self.job.links
        both = q[0, :] + q[1, :]
        x = self.job.base + first * ca.sin(q[0, :]) + second * ca.sin(both)
        return ca.vertcat(x, first * ca.cos(q[0, :]) + second * ca.cos(both))

    def _velocity(self, ca, q, v):
        first, second = self.job.links
        both = q[0, :] + q[1, :]
        rate = v[0, :] + v[1, :]
        x = first * ca.cos(q[0, :]) * v[0, :] + second * ca.cos(both) * rate
        return ca.vertcat(x, -first * ca.sin(q[0, :]) * v[0, :] - second * ca.sin(both) * rate)

    def _turning(self, ca, q, v, a, demand):
        """Centripetal acceleration |x' x x''| / |x'| at one end of every step."""
        first, second = self.job.links
        both = q[0, :] + q[1, :]
        rate = v[0, :] + v[1, :]
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
        points = self.job.points
        n = self.steps
        for k, (start, end) in enumerate(pairwise(points)):
            length = float(np.linalg.norm(end - start))
            dx, dy = (end - start) / length
            span_points = tool[:, k * n + 1 : (k + 1) * n]
            x = span_points[0, :] - start[0]
            y = span_points[1, :] - start[1]
            along = dx * x + dy * y
            across = dx * y - dy * x
            beyond = ca.fmax(0, -along) + ca.fmax(0, along - length)
            demand((across**2 + beyond**2) / self.job.tolerance**2, -np.inf, 1.0)
            if k:
                offset = tool[:, k * n] - ca.DM(start)
                demand(ca.sum1(offset**2) / self.job.tolerance**2, -np.inf, 1.0)

    def solve(self, start) -> float | None:
        """Duration of the local optimum near a start; None if IPOPT finds none."""
        job = self.job
        m = self.job.lines * self.steps
        q, dq, ddq, time = _start(job, start, self.steps)
        high_q = np.full((2, m + 1), np.inf)
        high_v = np.full((2, m + 1), np.inf)
        if job.velocity is not None:
            high_v[:] = job.velocity
        low_q = -high_q
        low_v = -high_v
        ends = ac.load_arm("pmk3s").joint_position(job.points[[0, -1]]).T
        low_q[:, [0, -1]] = ends
        high_q[:, [0, -1]] = ends
        low_v[:, [0, -1]] = 0.0
        high_v[:, [0, -1]] = 0.0
        bound = np.full(2 * m, job.acceleration)
        times = np.ones(len(time))
        solution = self.solver(
            x0=np.concatenate([*(x.ravel("F") for x in (q, dq, ddq)), time]),
            lbx=np.concatenate([low_q.ravel("F"), low_v.ravel("F"), -bound, 1e-3 * times]),
            ubx=np.concatenate([high_q.ravel("F"), high_v.ravel("F"), bound, 1e3 * times]),
            lbg=self.low,
            ubg=self.high,
        )
        return float(solution["f"]) if self.solver.stats()["success"] else None


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
        if distance.min() > INSIDE and distance.max() < OUTSIDE:
            break
    tolerance = min(10 ** rng.uniform(-4, np.log10(5e-3)), lengths.min() / 2)
    return Job(points=points, tolerance=tolerance, centripetal=0.09 if seed % 2 else None)


def gap(seed: int, duration: float) -> float:
    """Share of a duration by which the shaped motion of the oracle's job is longer."""
    job = draw(seed)
    path = ac.Path.polyline(job.points)
    arm = ac.load_arm("pmk3s")
    planned = ac.plan(
        path, arm, job.limits, ac.Shaped(tolerance=job.tolerance, configuration="positive")
    )
    return planned.duration / duration - 1


def run(seed: int) -> Outcome:
    """Compare a shaped motion with the fastest one that IPOPT finds."""
    best = solve(draw(seed), STEPS_OF_LINE)
    if best is None:
        return Outcome(result="no answer")
    longer = gap(seed, best)
    notes = [f"{longer:+.2%} of the oracle's {best:.6f} s"] if longer > BAR else []
    return Outcome(result="compared", notes=notes)
