"""The fastest timing of a joint path with limits of jerk, by IPOPT.

It shares nothing with `armcontour.planning`. Unknown is ds² over the path, a quadratic on every
cell with a slope that is continuous; next to a rest the jerk of s is uniform. Limits are kept at
the nodes only, on both sides of each, so that an answer may be a little too fast. Answers are local
optima.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline
from soak import Outcome
from soak.jerk import series

import armcontour as ac

# Cells of the first answer, and of the second, which starts from it.
CELLS = (250, 2000)
# Share of the cells that is even in time; the rest is even in s.
IN_TIME = 0.6
# Time of a cell next to a rest, as part of the time in which the jerk reaches the limit of
# acceleration or half of the speed.
REST = 0.5
# Time of each of the cells that follow it, as part of its time.
RAMP = 0.05
LONGEST = 0.05  # share of the path at most
SMALLEST = 1e-6  # ds² is at least this part of where the search starts
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": 2000, "max_cpu_time": 200.0}
WARM = {"mu_init": 1e-4}
# The five splines: seeds of the waypoints of six joints.
SEEDS = range(5)
# Ratios of the limits of jerk to those of acceleration with which each spline is solved [1/s].
FACTORS = (10.0, 50.0)
# Limits of the joints of the splines.
VELOCITY = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])  # rad/s
ACCELERATION = np.array([4.5, 4.5, 7.5, 7.5, 9.0, 9.0])  # rad/s²

# The paper's job.
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))  # m, vertices
CORNER_ERROR = 5e-3  # m
SPEED = 0.15  # m/s, limit of the tool
CENTRIPETAL = 0.09  # m/s², limit of the tool
PAPER_JERKS = (7.2, 36.0)  # rad/s³, limits of both joints, solved one after the other
# A curvature below this counts as this [1/m].
FLAT = 1e-9
# Where the integral of 1 / ds over a cell is taken.
GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(4)
# Bars of the splines: against the oracle, and against the plan without limits of jerk.
NEAR = 1e-3
WITHOUT = {"10": 0.03, "50": 0.007}


Squares = Callable[[np.ndarray], np.ndarray]


def _no_square(s: np.ndarray) -> np.ndarray:
    return np.full(len(s), np.inf)


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What is kept: SI units, (dof,) each, infinite where there is none."""

    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    square: Squares = field(default=_no_square)

    @classmethod
    def of(cls, limits: ac.Limits, dof: int, square: Squares = _no_square) -> Bounds:
        """The limits of the joints."""
        names = ("velocity", "acceleration", "jerk")
        bounds = {}
        for name in names:
            limit = getattr(limits, f"joint_{name}")
            bounds[name] = np.broadcast_to(np.inf if limit is None else limit, (dof,))
        return cls(**bounds, square=square)


@dataclass(frozen=True)
class Timing:
    """An answer: duration [s], and at the nodes s, the time and ds², (n + 1,) each."""

    duration: float
    s: np.ndarray
    t: np.ndarray
    square: np.ndarray


def splines() -> Iterator[tuple[str, ac.JointPath, ac.Limits]]:
    """The five splines at both factors of jerk to acceleration, each with a name."""
    for factor in FACTORS:
        for seed in SEEDS:
            way = np.random.default_rng(seed).uniform(-1.5, 1.5, (5, 6))
            yield f"spline {seed} at {factor:g}", not_a_knot(way), limits_of(factor)


def paper() -> Iterator[tuple[str, ac.Path, ac.Limits]]:
    """The paper's job with corners of continuous curvature, at both limits of jerk."""
    corners = ac.Path.polyline(POINTS)
    path = ac.round_corners(corners, tolerance=CORNER_ERROR, continuity="curvature")
    paper_limits = ac.load_arm("pmk3s").limits.replace(
        speed=SPEED, centripetal_acceleration=CENTRIPETAL
    )
    for jerk in PAPER_JERKS:
        yield f"paper at {jerk:g}", path, paper_limits.replace(joint_jerk=[jerk, jerk])


def solve_paper(path: ac.Path, limits: ac.Limits, cells: tuple[int, ...] = CELLS) -> Timing:
    """The fastest timing of the paper's job.

    Raises:
        RuntimeError: IPOPT finds none.
    """
    arm = ac.load_arm("pmk3s")
    joint_path = ac.trace(path, arm)

    def square(s: np.ndarray) -> np.ndarray:
        _, x1, x2 = series(arm, *(joint_path(s, order) for order in range(3)))[0]
        length = np.sum(x1 * x1, axis=1)
        across = x2 - (np.sum(x1 * x2, axis=1) / length)[:, None] * x1
        bend = np.maximum(np.linalg.norm(across, axis=1), FLAT)
        return np.minimum(SPEED**2 / length, CENTRIPETAL / bend)

    return solve(joint_path, Bounds.of(limits, arm.dof, square), cells)


def not_a_knot(way: np.ndarray) -> ac.JointPath:
    """SciPy's spline through joint positions at s = 0, 1, ..."""
    spline = CubicSpline(np.arange(len(way)), way)
    coefficients = np.zeros((len(way) - 1, 6, way.shape[1]))
    coefficients[:, :4] = np.moveaxis(spline.c[::-1], 0, 1)
    return ac.JointPath(breaks=np.arange(len(way), dtype=float), coefficients=coefficients)


def limits_of(factor: float) -> ac.Limits:
    """Limits of the five splines; an infinite factor lifts those of jerk."""
    jerk = factor * ACCELERATION if np.isfinite(factor) else None
    return ac.Limits(joint_velocity=VELOCITY, joint_acceleration=ACCELERATION, joint_jerk=jerk)


def solve(path: ac.JointPath, bounds: Bounds, cells: tuple[int, ...] = CELLS) -> Timing:
    """The fastest timing from rest to rest, on finer and finer cells.

    Raises:
        RuntimeError: IPOPT finds none.
    """
    timing: Timing | None = None
    for count in cells:
        timing = _Program(path, bounds, _mesh(path, bounds, count, timing)).solve(timing)
    assert timing is not None
    return timing


def _mesh(path: ac.JointPath, bounds: Bounds, count: int, timing: Timing | None) -> np.ndarray:
    """Nodes that are close where time passes slowly, and at all breaks of the path."""
    low = path.breaks[0]
    high = path.breaks[-1]
    if timing is None:
        t = np.linspace(0, 1, 401)
        s = low + (high - low) * t**3 * (10 - 15 * t + 6 * t**2)
    else:
        t = timing.t
        s = timing.s
    share = IN_TIME * t / t[-1] + (1 - IN_TIME) * (s - low) / (high - low)
    inner = np.interp(np.linspace(0, 1, count + 1), share, s)
    begin = low + _ramp(bounds, path(low, 1), path.length)
    end = high - _ramp(bounds, path(high, 1), path.length)
    inner = inner[(inner > begin[-1]) & (inner < end[-1])]
    width = np.gradient(inner)
    gap = np.abs(inner[:, None] - path.breaks).min(axis=1)
    return np.unique(np.concatenate([path.breaks, inner[gap > 0.4 * width], begin, end]))


def _ramp(bounds: Bounds, slope: np.ndarray, length: float) -> np.ndarray:
    """Distances of nodes from a rest, at the jerk that the joints allow there."""
    slope = np.maximum(np.abs(slope), 1e-300)
    limits = bounds.velocity, bounds.acceleration, bounds.jerk
    speed, acceleration, jerk = (float((x / slope).min()) for x in limits)
    last = min(acceleration / jerk, np.sqrt(speed / jerk), np.cbrt(6 * LONGEST * length / jerk))
    t = last * np.arange(REST, 1.0, REST * RAMP)
    return jerk * t**3 / 6


class _Program:
    """The nonlinear program on given nodes."""

    def __init__(self, path: ac.JointPath, bounds: Bounds, s: np.ndarray) -> None:
        self.path = path
        self.bounds = bounds
        self.s = s
        self.width = np.diff(s)

    def solve(self, timing: Timing | None) -> Timing:
        """The local optimum near a start.

        Raises:
            RuntimeError: IPOPT finds none.
        """
        import casadi as ca

        n = len(self.width)
        x = ca.SX.sym("x", n - 1)
        y = ca.SX.sym("y", n - 2)
        h = self.width[1:-1]
        node, middle = self._start(timing)
        a = x * node  # ds² at inner nodes
        d = y * middle  # middle Bernstein coefficients of ds² on the inner cells
        # dds on both sides of the inner nodes, and its slope on the inner cells.
        right = ca.vertcat((d - a[:-1]) / h, -2 / 3 * a[-1] / self.width[-1])
        slopes = ca.vertcat(2 / 3 * a[0] / self.width[0], (a[1:] - d) / h)
        slope = (a[:-1] - 2 * d + a[1:]) / h**2
        # Of cells of uniform jerk the third derivative over ds, at their inner ends.
        ends = 2 / 9 * a[0] / self.width[0] ** 2, 2 / 9 * a[-1] / self.width[-1] ** 2
        rows = [(right - slopes) * self.width[1:] / node]
        low, high = [np.zeros(n - 1)], [np.zeros(n - 1)]
        for cells, dds, third in (
            (np.arange(n - 1), slopes, ca.vertcat(ends[0], slope)),
            (np.arange(1, n), right, ca.vertcat(slope, ends[1])),
        ):
            for row in self._rows(ca, cells, a, dds, third):
                rows.append(row)
                low.append(np.full(n - 1, -1.0))
                high.append(np.ones(n - 1))
        duration = 3 * self.width[0] / ca.sqrt(a[0]) + 3 * self.width[-1] / ca.sqrt(a[-1])
        times = 0
        for u, weight in zip((GAUSS + 1) / 2, WEIGHTS / 2, strict=True):
            square = (1 - u) ** 2 * a[:-1] + 2 * u * (1 - u) * d + u**2 * a[1:]
            times += weight * h / ca.sqrt(square)
        f = duration + ca.sum1(times)
        options = IPOPT | (WARM if timing else {})
        options = {"print_time": False, **{f"ipopt.{k}": z for k, z in options.items()}}
        program = {"x": ca.vertcat(x, y), "f": f, "g": ca.vertcat(*rows)}
        solver = ca.nlpsol("fastest", "ipopt", program, options)
        ceiling = np.concatenate([self._ceiling() / node, np.full(n - 2, np.inf)])
        answer = solver(
            x0=np.minimum(1.0, 0.99 * ceiling),
            lbx=SMALLEST,
            ubx=ceiling,
            lbg=np.concatenate(low),
            ubg=np.concatenate(high),
        )
        if not solver.stats()["success"]:
            raise RuntimeError(f"IPOPT: {solver.stats()['return_status']}")
        square = np.concatenate([[0.0], np.asarray(answer["x"]).ravel()[: n - 1] * node, [0.0]])
        each = np.asarray(ca.Function("t", [ca.vertcat(x, y)], [times])(answer["x"])).ravel()
        ramps = 3 * self.width[[0, -1]] / np.sqrt(square[[1, -2]])
        t = np.concatenate([[0.0], np.cumsum(np.concatenate([ramps[:1], each, ramps[1:]]))])
        return Timing(float(answer["f"]), self.s, t, square)

    def _start(self, timing: Timing | None) -> tuple[np.ndarray, np.ndarray]:
        """ds² at the inner nodes and in the middle of the inner cells, to start from."""
        if timing is None:
            share = (self.s - self.s[0]) / (self.s[-1] - self.s[0])
            shape = (4 * share * (1 - share)) ** (4 / 3)
            first = np.abs(self.path(self.s, 1)).max(axis=0)
            size = float(np.min(self.bounds.acceleration / first) * (self.s[-1] - self.s[0]))
            square = 0.1 * size * shape
        else:
            square = np.interp(self.s, timing.s, timing.square**0.75) ** (4 / 3)
        return square[1:-1], (square[1:-2] + square[2:-1]) / 2

    def _derivatives(self, cells: np.ndarray) -> list[np.ndarray]:
        """The first three derivatives of q at the inner nodes, as seen from cells."""
        middle = (self.s[:-1] + self.s[1:]) / 2
        piece = np.searchsorted(self.path.breaks, middle[cells]) - 1
        width = np.diff(self.path.breaks)[piece]
        share = (self.s[1:-1] - self.path.breaks[piece]) / width
        derivatives = []
        for order in (1, 2, 3):
            values = np.zeros((len(cells), self.path.dof))
            for k in range(order, 6):
                factor = np.prod(np.arange(k - order + 1, k + 1))
                power = factor * share ** (k - order) / width**order
                values += power[:, None] * self.path.coefficients[piece, k]
            derivatives.append(values)
        return derivatives

    def _rows(self, ca, cells, a, dds, third):
        """Shares of the limits of acceleration and jerk at the inner nodes, from -1 to 1."""
        bounds = self.bounds
        q1, q2, q3 = self._derivatives(cells)
        for j in range(self.path.dof):
            if np.isfinite(bounds.acceleration[j]):
                yield (q2[:, j] * a + q1[:, j] * dds) / bounds.acceleration[j]
            if np.isfinite(bounds.jerk[j]):
                jerk = q3[:, j] * a + 3 * q2[:, j] * dds + q1[:, j] * third
                yield jerk * ca.sqrt(a) / bounds.jerk[j]

    def _ceiling(self) -> np.ndarray:
        """The largest ds² at the inner nodes: speeds, and the jerk at the rests."""
        ceiling = self.bounds.square(self.s[1:-1])
        for cells in (np.arange(len(self.width) - 1), np.arange(1, len(self.width))):
            q1 = np.abs(self._derivatives(cells)[0])
            with np.errstate(divide="ignore"):
                ceiling = np.minimum(ceiling, ((self.bounds.velocity / q1) ** 2).min(axis=1))
        for node, cell, s in ((0, 0, self.s[0]), (-1, -1, self.s[-1])):
            with np.errstate(divide="ignore"):
                jerk = (self.bounds.jerk / np.abs(self.path(s, 1))).min()
            ceiling[node] = min(
                ceiling[node], (4.5 * float(jerk) * self.width[cell] ** 2) ** (2 / 3)
            )
        return ceiling


def run(seed: int) -> Outcome:
    """Compare the plan of a spline, or of the paper's job, with the oracle."""
    problems = [*splines(), *paper()]
    name, path, limits = problems[seed % len(problems)]
    notes = []
    if isinstance(path, ac.Path):
        best = solve_paper(path, limits).duration
        planned = ac.plan(path, ac.load_arm("pmk3s"), limits)
    else:
        best = solve(path, Bounds.of(limits, path.dof)).duration
        planned = ac.plan(path, limits=limits)
        plain = ac.plan(path, limits=limits.replace(joint_jerk=np.inf)).duration
        longer = planned.duration / plain - 1
        if not 0 < longer <= WITHOUT[name.split()[-1]]:
            notes.append(f"{longer:+.2%} of the plan without limits of jerk")
    above = planned.duration / best - 1
    if not -NEAR < above <= NEAR:
        notes.append(f"{name}: {above:+.1e} of the oracle")
    return Outcome(kind=name, result="compared", notes=notes)
