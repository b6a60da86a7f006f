"""Plans with limits of jerk, judged by formulas of their own, by IPOPT and by Ruckig.

`run` judges plans of random joint paths, `run_tool` those with limits of the tool, whose motion is
a power series of the forward kinematics up to the third power, without a Jacobian. `run_oracle`
compares plans with the fastest timing that IPOPT finds, `run_move` straight moves with Ruckig.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from math import comb
from typing import Any
from unittest import mock

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.timing.jerk import limiting
from soak import Outcome

Random = np.random.Generator
# Exponents of the distances between waypoints by which their parameters grow.
WAYS = {"uniform": 0.0, "centripetal": 0.5, "chordal": 1.0}
INTERVALS = (60, 200, 1000, 4000)
LEAK = 1e-9
# Places in every interval of a law, its ends among them.
PLACES = 11
# What may jump where intervals meet, as a share of the largest value.
STEP = 1e-9
# A bend q'' jumps where its jump is this share of its largest value there.
BEND = 1e-6
# Means of the jerk over samples; those that rounding spoils by more than NOISE are not judged.
RATES, SLACK, NOISE = (1000.0, 8000.0), 5e-3, 2e-3
MOST_SAMPLES = 40_000
# One problem in so many is planned again with searches that end after some iterations.
AGAIN, EARLY = 10, (1, 3, 8, 20)
ORDERS = ("velocity", "acceleration", "jerk")
GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A path, or a joint path with or without a tool path, and its limits."""

    kind: str
    path: ac.Path | ac.JointPath
    limits: ac.Limits
    arm: Any = None
    options: dict[str, Any] = field(default_factory=dict)


def draw(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng((16, seed))
    kind = str(rng.choice(list(KINDS), p=SHARES))
    points = KINDS[kind](rng)
    width = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = WAYS[str(rng.choice(list(WAYS)))]
    s = np.concatenate([[0.0], np.cumsum((width / width.max()) ** way)])
    path = ac.JointPath.spline(points, s, ends="clamped" if rng.random() < 0.1 else "natural")
    limits = _limits(rng, path)
    options: dict[str, Any] = {"intervals": int(rng.choice(INTERVALS, p=[0.4, 0.35, 0.15, 0.1]))}
    for name in ("start_speed", "end_speed"):
        if rng.random() < 0.06:
            options[name] = _speed(rng, path, limits)
    return Problem(kind=kind, path=path, limits=limits, options=options)


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
}
SHARES = (0.5, 0.3, 0.2)


def run(seed: int) -> Outcome:
    """Plan and judge the problem of a seed."""
    problem = draw(seed)
    result, notes, worst = _answer(problem)
    if seed % AGAIN == 0:
        notes += early(seed)
    return Outcome(kind=problem.kind, result=result, notes=notes, worst=worst)


def _answer(problem: Problem) -> tuple[str, list[str], float]:
    options, refused = dict(problem.options), False
    # Each end's speed may be refused once, and what is then said to be allowed can be had.
    for _ in range(3):
        try:
            planned = ac.plan(problem.path, limits=problem.limits, **options)
        except ac.NotRealizable as error:
            name = (error.limit or "").replace(" ", "_")
            if not options.get(name) or not error.allowed < options[name]:
                return "wrong", [f"refused: {error}"], 0.0
            options[name], refused = error.allowed, True
            continue
        ends = options.get("start_speed", 0.0), options.get("end_speed", 0.0)
        notes, worst = judge(planned, problem.limits, ends)
        return "wrong" if notes else "refused" if refused else "planned", notes, worst
    return "wrong", ["what was said to be allowed was refused too"], 0.0


def judge(
    planned: ac.Trajectory, limits: ac.Limits, ends: tuple[float, float] = (0.0, 0.0)
) -> tuple[list[str], float]:
    """What is wrong with a plan of one law along a joint path, and its largest ratio to a limit."""
    (law,) = planned.laws
    sampled = Sampled(law)
    notes = sampled.joins(limits, ends)
    worst = 0.0
    for name, (ratio, unit) in ratios(sampled, limits).items():
        k = np.unravel_index(int(np.argmax(np.nan_to_num(ratio, nan=np.inf))), ratio.shape)
        worst = max(worst, float(ratio[k]))
        if not ratio[k] <= 1 + LEAK:
            notes.append(
                f"{name}{unit[k]} 1 {ratio[k] - 1:+.2e} in interval {k[0]} of {len(ratio)}"
            )
    return notes + differences(planned, limits), worst


@contextmanager
def interrupted(iterations: int) -> Iterator[None]:
    """Every search for the fastest motion ends after so many iterations."""
    limit_jerk = limiting.limit_jerk

    def short(law, task):  # noqa: ANN001, ANN202
        return limit_jerk(law, replace(task, iterations=iterations))

    with mock.patch.object(limiting, "limit_jerk", short):
        yield


def early(seed: int) -> list[str]:
    """What is wrong with the plans of a seed's problem when searches end early."""
    problem, notes = draw(seed), []
    for iterations in EARLY:
        with interrupted(iterations):
            planned = ac.plan(problem.path, limits=problem.limits)
        notes += [f"{iterations} iterations: {x}" for x in judge(planned, problem.limits)[0]]
    return notes


class Sampled:
    """A law at places of every interval: `s` and its derivatives, (n, k), and those of q."""

    def __init__(self, law: ac.PathLaw, places: int = PLACES) -> None:
        self.law, self.path = law, law.joint_path
        self.width, self.times = np.diff(law.s), np.diff(law.breaks)
        ds, dds, slope, jerk = (x[:, None] for x in law.rates)
        share = np.linspace(0, 1, places)
        # With dds linear in s, ds² is a quadratic in s.
        x = share * self.width[:, None]
        square = ds**2 + x * (2 * dds + slope * x)
        self.lowest = np.where(jerk[:, 0] == 0, square.min(axis=1), 0.0)
        speed = np.sqrt(np.maximum(square, 0.0))
        along = (x, speed, dds + slope * x, slope * speed)
        # With uniform jerk, s is a cubic in time.
        u = share * self.times[:, None]
        over = (
            u * (ds + u * (dds / 2 + u * jerk / 6)),
            ds + u * (dds + u * jerk / 2),
            dds + u * jerk,
            jerk + 0 * u,
        )
        even = jerk != 0
        self.x, *self.motion = (np.where(even, b, a) for a, b in zip(along, over, strict=True))
        middle = (law.s[1:] + law.s[:-1]) / 2
        self.piece = np.searchsorted(self.path.breaks, middle, side="right") - 1
        self.piece = np.clip(self.piece, 0, len(self.path.breaks) - 2)

    def slopes(self) -> list[np.ndarray]:
        """Q and its first three derivatives by s, (n, k, dof) each."""
        start = self.law.s[:-1] - self.path.breaks[self.piece]
        wide = np.diff(self.path.breaks)[self.piece][:, None]
        share = (start[:, None] + self.x) / wide
        c = self.path.coefficients[self.piece][:, :, None]
        found = []
        for order in range(4):
            factors = [np.prod(np.arange(k - order + 1.0, k + 1.0)) for k in range(6)]
            powers = sum(
                factors[k] * share[..., None] ** (k - order) * c[:, k] for k in range(order, 6)
            )
            found.append(powers / wide[..., None] ** order)
        return found

    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity, acceleration and jerk of the joints, (n, k, dof) each."""
        _, q1, q2, q3 = self.slopes()
        ds, dds, ddds = (x[..., None] for x in self.motion)
        return q1 * ds, q2 * ds**2 + q1 * dds, q3 * ds**3 + 3 * q2 * ds * dds + q1 * ddds

    def joins(self, limits: ac.Limits, ends: tuple[float, float]) -> list[str]:
        """What is wrong where intervals meet, and at both ends."""
        law, notes = self.law, []
        if not np.isin(self.path.breaks, law.s).all():
            notes.append("a break of the path is no break of the law")
        if law.s[0] != self.path.breaks[0] or law.s[-1] != self.path.breaks[-1]:
            notes.append("s does not run from start to end")
        if not (self.width > 0).all() or not (self.times > 0).all():
            notes.append("runs back")
        ds, dds, _ = self.motion
        if (self.lowest < -STEP * (ds**2).max()).any() or (ds < -STEP * ds.max()).any():
            notes.append("ds is below zero")
        for name, x, allowed in (("ds", ds, STEP), ("dds", dds, STEP)):
            jump = np.abs(x[1:, 0] - x[:-1, -1])
            if jump.max(initial=0.0) > allowed * np.abs(x).max():
                k = int(np.argmax(jump)) + 1
                share = jump.max() / np.abs(x).max()
                notes.append(f"{name} jumps by {share:.1e} of its largest at break {k}")
        joints = self.joints()
        for name, at, asked in (("start", (0, 0), ends[0]), ("end", (-1, -1), ends[1])):
            if asked:
                if abs(ds[at] - asked) > STEP * ds.max():
                    notes.append(f"the {name} speed is {ds[at]:.6g}, not {asked:.6g}")
                continue
            for what, values in zip(ORDERS[:2], joints, strict=False):
                share = np.abs(values[at]).max() / np.abs(values).max()
                if share > STEP:
                    notes.append(f"{what} at the {name} is {share:.1e} of its largest, not 0")
        notes += self._durations()
        return notes + self._bends(limits, joints[1])

    def _durations(self) -> list[str]:
        """Intervals that take another time than the integral of 1 / ds, or miss their ends."""
        law = self.law
        ds, dds, slope, jerk = law.rates
        x = (GAUSS + 1) / 2 * self.width[:, None]
        square = ds[:, None] ** 2 + x * (2 * dds[:, None] + slope[:, None] * x)
        with np.errstate(invalid="ignore", divide="ignore"):
            taken = self.width * (WEIGHTS / 2 / np.sqrt(square)).sum(axis=1)
        notes = []
        off = np.abs(taken - self.times) / law.breaks[-1]
        off[jerk != 0] = np.abs(self.x[:, -1] - self.width)[jerk != 0] / self.path.length
        # A quadrature is exact enough where ds does not change much.
        smooth = (self.motion[0].max(axis=1) < 2 * self.motion[0].min(axis=1)) | (jerk != 0)
        k = int(np.argmax(np.where(smooth, off, 0.0)))
        if not off[k] <= 1e-11:
            notes.append(f"interval {k} takes a wrong time or way: {off[k]:.1e} of the whole")
        return notes

    def _bends(self, limits: ac.Limits, acceleration: np.ndarray) -> list[str]:
        """Places at which the acceleration jumps: it has to stop where the path bends."""
        jump = np.abs(acceleration[1:, 0] - acceleration[:-1, -1])
        scale = np.abs(acceleration).max(axis=(0, 1))
        if limits.joint_acceleration is not None:
            scale = np.maximum(scale, np.broadcast_to(limits.joint_acceleration, scale.shape))
        share = jump / np.where(scale > 0, scale, 1.0)
        if limits.joint_jerk is not None:
            share = share[:, np.isfinite(np.broadcast_to(limits.joint_jerk, scale.shape))]
        if not share.size or share.max() <= BEND:
            return []
        k, j = np.unravel_index(int(np.argmax(share)), share.shape)
        return [f"acceleration {j + 1} jumps by {share[k, j]:.1e} of its largest at break {k + 1}"]


def ratios(sampled: Sampled, limits: ac.Limits) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ratios to limits of the joints and of the path's jerk, (n, k), and the joints they are of."""
    found = {}
    for name, values in zip(ORDERS, sampled.joints(), strict=True):
        most = getattr(limits, f"joint_{name}")
        if most is None:
            continue
        ratio = np.abs(values) / most
        if name == "acceleration":
            low, high = limits.acceleration_bounds(values.shape[-1])
            ratio = np.maximum(values / low, values / high)
        found[name] = ratio.max(axis=-1), ratio.argmax(axis=-1) + 1
    if limits.path_jerk is not None:
        ratio = np.abs(sampled.motion[2]) / limits.path_jerk
        found["path jerk"] = ratio, np.zeros(ratio.shape, dtype=int)
    return found


def differences(planned: ac.Trajectory, limits: ac.Limits) -> list[str]:
    """What third differences of sampled positions say of the jerk: their means over samples."""
    if limits.joint_jerk is None:
        return []
    notes = []
    size = np.abs(planned(np.linspace(0, planned.duration, 200))).max(axis=0)
    fastest = np.abs(planned(np.linspace(0, planned.duration, 200), 1)).max(axis=0)
    for rate in RATES:
        h = max(1 / rate, planned.duration / MOST_SAMPLES)
        t = np.arange(0, planned.duration, h)
        if len(t) < 4:
            continue
        third = np.abs(np.diff(planned(t), 3, axis=0)).max(axis=0) / h**3
        rounding = 8 * np.finfo(float).eps * (size + fastest * planned.duration) / h**3
        noise = rounding / limits.joint_jerk
        ratio = third / limits.joint_jerk
        judged = noise <= NOISE
        if judged.any() and not (ratio[judged] <= 1 + SLACK).all():
            j = int(np.argmax(np.where(judged, ratio, 0.0)))
            notes.append(f"third differences of joint {j + 1} at {1 / h:g} Hz: {ratio[j]:.5f}")
    return notes


# Limits of the tool, with arms of random paths; a tool that uses less than LEAST has no limit.
ARMS = ("ur5e", "pmk3s")
# Limits of the tool, and what they are of the speed of a joint or less at the path's size.
TOOL = ("speed", "tool_acceleration", "centripetal_acceleration", "tool_jerk", "path_jerk")
ANGULAR = ("angular_speed", "angular_acceleration")
CHANCE = 0.35
LEAST = 1e-6
# How a tool is held that looks down.
DOWN = np.diag([1.0, -1.0, -1.0])
# How many of the seeds have a tool that turns, and by about which angle at a waypoint [rad].
TURNING, TURN = 0.2, 0.2


@cache
def _arm(name: str) -> Any:
    return ac.load_arm(name)


def draw_tool(seed: int) -> Problem:
    """A polyline with corners of continuous curvature, or with a tool that turns, of a seed."""
    rng = np.random.default_rng((18, seed))
    if rng.random() < TURNING:
        kind, arm = "turning", _arm(ARMS[0])
        path = _turning(rng, arm)
    else:
        kind, arm = "corners", _arm(str(rng.choice(ARMS)))
        path = _corners(rng, arm)
    limits = _tool_limits(rng, arm, ac.trace(path, arm))
    intervals = None if rng.random() < 0.3 else int(rng.choice([200, 500, 1000]))
    return Problem(kind=kind, arm=arm, path=path, limits=limits, options={"intervals": intervals})


def _corners(rng: Random, arm: Any) -> ac.Path:
    """A polyline whose corners are rounded with continuous curvature."""
    count = int(rng.integers(3, 7))
    if arm.dimension == 2:
        points = rng.uniform((0.25, 0.1), (0.42, 0.32), (count, 2))
    else:
        points = rng.uniform((0.35, -0.15, 0.1), (0.6, 0.15, 0.3), (count, 3))
    path = ac.Path.polyline(points)
    path = path if arm.dimension == 2 else path.oriented(DOWN)
    return ac.round_corners(path, tolerance=10 ** rng.uniform(-4, -2), continuity="curvature")


def _turning(rng: Random, arm: Any) -> ac.Path:
    """A polyline with arcs for corners, along which the tool turns, in reach of the arm."""
    while True:
        points = rng.uniform((0.4, -0.05, 0.15), (0.5, 0.05, 0.25), (int(rng.integers(3, 5)), 3))
        turns = Rotation.from_rotvec(TURN * rng.normal(size=points.shape)).as_matrix()
        path = ac.Path.polyline(points).oriented(turns @ DOWN)
        path = ac.round_corners(path, tolerance=10 ** rng.uniform(-6, -3))
        try:
            ac.trace(path, arm)
        except ac.Unreachable:
            continue
        return path


def _tool_limits(rng: Random, arm: Any, path: ac.JointPath) -> ac.Limits:
    """Limits of joints, and some of the tool of which each binds now and then."""
    dof = arm.dof
    acceleration = 10 ** (rng.uniform(0, 1) + rng.uniform(-0.3, 0.3, dof))
    factor = 10 ** rng.uniform(np.log10(3), np.log10(100))
    wanted: dict[str, Any] = {
        "joint_velocity": 10 ** (rng.uniform(-0.3, 0.5) + rng.uniform(-0.2, 0.2, dof)),
        "joint_acceleration": acceleration,
        "joint_jerk": factor * acceleration,
    }
    plain = ac.plan(path, arm, ac.Limits(**wanted), intervals=200)
    tool = Tool(arm, Sampled(plain.laws[0], 3))
    names = TOOL + (ANGULAR if arm.dimension == 3 else ())
    for name in names:
        most = float(tool.used(name).max())
        if rng.random() < CHANCE and most > LEAST:
            wanted[name] = most * float(rng.uniform(0.2, 1.1))
    if arm.has_bodies and rng.random() < CHANCE:
        torque = np.abs(tool.torque()).max(axis=(0, 1))
        still = np.abs(tool.torque(still=True)).max(axis=(0, 1))
        # The arm can hold itself, against its friction too.
        least = 1.2 * still + 1.1 * np.broadcast_to(arm.chain.coulomb, (dof,))
        wanted["joint_torque"] = 0.1 + least + rng.uniform(0.1, 1.0, dof) * torque
    return ac.Limits(**wanted)


def series(arm: Any, *q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Derivatives of the tool's position, (n, 3), and of its rotation matrix, (n, 3, 3)."""
    chain, size = arm.chain, len(q[0])
    rotation, point = _fixed(chain.base, size, len(q))
    for k in range(arm.dof):
        point = [x + y @ chain.positions[k] for x, y in zip(point, rotation, strict=True)]
        turned = [x @ chain.rotations[k] for x in rotation]
        rotation = _product(turned, _turn(chain.axes[k], [x[:, k] for x in q]))
    for frame in (chain.tip, chain.tool):
        point = [x + y @ frame.position for x, y in zip(point, rotation, strict=True)]
        rotation = [x @ frame.rotation for x in rotation]
    return point, rotation


def _fixed(frame: ac.Frame, size: int, orders: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A frame that does not move."""
    rotation = [np.zeros((size, 3, 3)) for _ in range(orders)]
    point = [np.zeros((size, 3)) for _ in range(orders)]
    rotation[0][:], point[0][:] = frame.rotation, frame.position
    return rotation, point


def _product(first: list[np.ndarray], second: list[np.ndarray]) -> list[np.ndarray]:
    """Derivatives of a product of matrices, by Leibniz' rule."""
    return [
        sum(comb(n, k) * first[k] @ second[n - k] for k in range(n + 1)) for n in range(len(first))
    ]


def _turn(axis: np.ndarray, angle: list[np.ndarray]) -> list[np.ndarray]:
    """Derivatives of the rotation about an axis, by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = [np.sin(angle[0])], [np.cos(angle[0])]
    for n in range(1, len(angle)):
        # The derivative of the sine is the cosine times that of the angle.
        parts = [(comb(n - 1, k), angle[k + 1], n - 1 - k) for k in range(n)]
        one = sum(c * a * cosine[m] for c, a, m in parts)
        other = -sum(c * a * sine[m] for c, a, m in parts)
        sine.append(one)
        cosine.append(other)
    found = [
        s[:, None, None] * cross - c[:, None, None] * (cross @ cross)
        for s, c in zip(sine, cosine, strict=True)
    ]
    found[0] = found[0] + np.eye(3) + cross @ cross
    return found


class Tool:
    """The tool's motion at the places of a sampled law, (n, k, ...)."""

    def __init__(self, arm: Any, sampled: Sampled) -> None:
        self.arm, self.sampled = arm, sampled
        q = sampled.slopes()
        self.shape = q[0].shape[:2]
        self.q = q[0].reshape(-1, arm.dof)
        self.point, self.rotation = series(arm, *(x.reshape(-1, arm.dof) for x in q))
        self.ds, self.dds, self.ddds = (x.reshape(-1, 1) for x in sampled.motion)

    def used(self, name: str) -> np.ndarray:
        """What a limit of the tool bounds, (n, k)."""
        ds, dds, ddds = self.ds, self.dds, self.ddds
        _, x1, x2, x3 = self.point
        if name == "path_jerk":
            found = ddds
        elif name == "speed":
            found = x1 * ds
        elif name == "tool_acceleration":
            found = x2 * ds**2 + x1 * dds
        elif name == "tool_jerk":
            found = x3 * ds**3 + 3 * x2 * ds * dds + x1 * ddds
        elif name == "centripetal_acceleration":
            length = np.sum(x1 * x1, axis=1, keepdims=True)
            found = (x2 - np.sum(x1 * x2, axis=1, keepdims=True) / length * x1) * ds**2
        else:
            turning, change = self._turning()
            found = turning * ds
            if name == "angular_acceleration":
                found = change * ds**2 + turning * dds
        return np.linalg.norm(found, axis=1).reshape(self.shape)

    def _turning(self) -> tuple[np.ndarray, np.ndarray]:
        """The angular velocity at ds = 1, and its derivative by s, (m, 3) each."""
        back = [np.swapaxes(x, 1, 2) for x in self.rotation]
        first = self.rotation[1] @ back[0]
        second = self.rotation[2] @ back[0] + self.rotation[1] @ back[1]
        places = ([2, 0, 1], [1, 2, 0])
        return first[:, places[0], places[1]], second[:, places[0], places[1]]

    def torque(self, *, still: bool = False) -> np.ndarray:
        """Torques of the joints, (n, k, dof), or those at rest."""
        velocity, acceleration, _ = self.sampled.joints()
        moving = 0.0 if still else 1.0
        states = (moving * x.reshape(-1, self.arm.dof) for x in (velocity, acceleration))
        return self.arm.torque(self.q, *states).reshape(*self.shape, -1)


def judge_tool(planned: ac.Trajectory, arm: Any, limits: ac.Limits) -> tuple[list[str], float]:
    """What is wrong with a plan of one law, and its largest ratio to any limit."""
    notes, worst = judge(planned, limits)
    (law,) = planned.laws
    sampled = Sampled(law)
    tool = Tool(arm, sampled)
    found = {
        name: tool.used(name) / getattr(limits, name)
        for name in (*TOOL, *ANGULAR)
        if getattr(limits, name) is not None
    }
    own = planned.path.speeds[planned.path.locate((law.s[1:] + law.s[:-1]) / 2)]
    if np.isfinite(own).any():
        found["speed of a segment"] = np.nan_to_num(tool.used("speed") / own[:, None])
    if limits.joint_torque is not None:
        found["torque"] = (np.abs(tool.torque()) / limits.joint_torque).max(axis=-1)
    for name, ratio in found.items():
        k = np.unravel_index(int(np.argmax(np.nan_to_num(ratio, nan=np.inf))), ratio.shape)
        worst = max(worst, float(ratio[k]))
        if not ratio[k] <= 1 + LEAK:
            notes.append(f"{name} 1 {ratio[k] - 1:+.2e} in interval {k[0]} of {len(ratio)}")
    return notes, worst


def run_tool(seed: int) -> Outcome:
    """Plan and judge the problem of a seed that has limits of the tool."""
    problem = draw_tool(seed)
    planned = ac.plan(problem.path, problem.arm, problem.limits, **problem.options)
    notes, worst = judge_tool(planned, problem.arm, problem.limits)
    return Outcome(kind=problem.kind, result="planned", notes=notes, worst=worst)


# Of IPOPT. Unknown is ds² over the path, a quadratic on every cell with a slope that is continuous;
# next to a rest the jerk of s is uniform. Limits are kept at the nodes only, on both sides of each,
# so that an answer may be a little too fast. Answers are local optima.
# Cells of the first answer, and of the second, which starts from it.
CELLS = (250, 2000)
# Share of the cells that is even in time; the rest is even in s.
IN_TIME = 0.6
# Time of a cell next to a rest, as part of the time in which the jerk reaches the limit of
# acceleration or half of the speed. It is followed by cells that last this part of it.
REST, RAMP = 0.5, 0.05
LONGEST = 0.05  # share of the path at most
SMALLEST = 1e-6  # ds² is at least this part of where the search starts
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": 2000, "max_cpu_time": 200.0}
WARM = {"mu_init": 1e-4}
# The five splines: waypoints of six joints, and limits of every joint.
SEEDS, FACTORS = range(5), (10.0, 50.0)
VELOCITY = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])  # rad/s
ACCELERATION = np.array([4.5, 4.5, 7.5, 7.5, 9.0, 9.0])  # rad/s²

# The paper's job: vertices [m], corner error [m], limits of the tool, and of jerk of both joints.
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))
CORNER_ERROR, SPEED, CENTRIPETAL = 5e-3, 0.15, 0.09
PAPER_JERKS = (7.2, 36.0)  # rad/s³
# A curvature below this counts as this [1/m].
FLAT = 1e-9
# Where the integral of 1 / ds over a cell is taken.
FOUR, FOUR_WEIGHTS = np.polynomial.legendre.leggauss(4)
# Bars of the splines: against the oracle, and against the plan without limits of jerk.
NEAR = 1e-3
WITHOUT = {"10": 0.03, "50": 0.007}
# The longest that a straight move may be, as a share of Ruckig's; it is never shorter.
BAR, ROUNDING = 1e-3, 1e-9


Squares = Callable[[np.ndarray], np.ndarray]


def _no_square(s: np.ndarray) -> np.ndarray:
    return np.full(len(s), np.inf)


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What is kept: SI units, (dof,) each, infinite where there is none."""

    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    path_jerk: float = np.inf
    square: Squares = field(default=_no_square)

    @classmethod
    def of(cls, limits: ac.Limits, dof: int, square: Squares = _no_square) -> Bounds:
        """The limits of the joints and of the path's jerk."""
        names = ("velocity", "acceleration", "jerk")
        found = {}
        for name in names:
            given = getattr(limits, f"joint_{name}")
            found[name] = np.broadcast_to(np.inf if given is None else given, (dof,))
        jerk = np.inf if limits.path_jerk is None else limits.path_jerk
        return cls(**found, path_jerk=jerk, square=square)


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
            yield f"spline {seed} at {factor:g}", not_a_knot(way), spline_limits(factor)


def paper() -> Iterator[tuple[str, ac.Path, ac.Limits]]:
    """The paper's job with corners of continuous curvature, at both limits of jerk."""
    corners = ac.Path.polyline(POINTS)
    path = ac.round_corners(corners, tolerance=CORNER_ERROR, continuity="curvature")
    most = ac.load_arm("pmk3s").limits.replace(speed=SPEED, centripetal_acceleration=CENTRIPETAL)
    for jerk in PAPER_JERKS:
        yield f"paper at {jerk:g}", path, most.replace(joint_jerk=[jerk, jerk])


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


def spline_limits(factor: float) -> ac.Limits:
    """Limits of the five splines; an infinite factor lifts those of jerk."""
    jerk = factor * ACCELERATION if np.isfinite(factor) else None
    return ac.Limits(joint_velocity=VELOCITY, joint_acceleration=ACCELERATION, joint_jerk=jerk)


def solve(path: ac.JointPath, bounds: Bounds, cells: tuple[int, ...] = CELLS) -> Timing:
    """The fastest timing from rest to rest, on finer and finer cells.

    Raises:
        RuntimeError: IPOPT finds none.
    """
    found: Timing | None = None
    for count in cells:
        found = _Program(path, bounds, _mesh(path, bounds, count, found)).solve(found)
    assert found is not None
    return found


def _mesh(path: ac.JointPath, bounds: Bounds, count: int, found: Timing | None) -> np.ndarray:
    """Nodes that are close where time passes slowly, and at all breaks of the path."""
    low, high = path.breaks[0], path.breaks[-1]
    if found is None:
        t = np.linspace(0, 1, 401)
        s = low + (high - low) * t**3 * (10 - 15 * t + 6 * t**2)
    else:
        t, s = found.t, found.s
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
    jerk = min(jerk, bounds.path_jerk)
    last = min(acceleration / jerk, np.sqrt(speed / jerk), np.cbrt(6 * LONGEST * length / jerk))
    t = last * np.arange(REST, 1.0, REST * RAMP)
    return jerk * t**3 / 6


class _Program:
    """The nonlinear program on given nodes."""

    def __init__(self, path: ac.JointPath, bounds: Bounds, s: np.ndarray) -> None:
        self.path, self.bounds, self.s = path, bounds, s
        self.width = np.diff(s)

    def solve(self, found: Timing | None) -> Timing:
        """The local optimum near a start.

        Raises:
            RuntimeError: IPOPT finds none.
        """
        import casadi as ca

        n = len(self.width)
        x, y, h = ca.SX.sym("x", n - 1), ca.SX.sym("y", n - 2), self.width[1:-1]
        node, middle = self._start(found)
        a, d = x * node, y * middle  # ds² at inner nodes, and middle Bernstein coefficients
        # dds on both sides of the inner nodes, and its slope on the inner cells.
        right = ca.vertcat((d - a[:-1]) / h, -2 / 3 * a[-1] / self.width[-1])
        left = ca.vertcat(2 / 3 * a[0] / self.width[0], (a[1:] - d) / h)
        slope = (a[:-1] - 2 * d + a[1:]) / h**2
        # Of cells of uniform jerk the third derivative over ds, at their inner ends.
        ends = 2 / 9 * a[0] / self.width[0] ** 2, 2 / 9 * a[-1] / self.width[-1] ** 2
        rows = [(right - left) * self.width[1:] / node]
        low, high = [np.zeros(n - 1)], [np.zeros(n - 1)]
        for cells, dds, third in (
            (np.arange(n - 1), left, ca.vertcat(ends[0], slope)),
            (np.arange(1, n), right, ca.vertcat(slope, ends[1])),
        ):
            for row in self._rows(ca, cells, a, dds, third):
                rows.append(row)
                low.append(np.full(n - 1, -1.0))
                high.append(np.ones(n - 1))
        duration = 3 * self.width[0] / ca.sqrt(a[0]) + 3 * self.width[-1] / ca.sqrt(a[-1])
        times = 0
        for at, weight in zip((FOUR + 1) / 2, FOUR_WEIGHTS / 2, strict=True):
            square = (1 - at) ** 2 * a[:-1] + 2 * at * (1 - at) * d + at**2 * a[1:]
            times += weight * h / ca.sqrt(square)
        f = duration + ca.sum1(times)
        options = IPOPT | (WARM if found else {})
        options = {"print_time": False, **{f"ipopt.{k}": z for k, z in options.items()}}
        program = {"x": ca.vertcat(x, y), "f": f, "g": ca.vertcat(*rows)}
        solver = ca.nlpsol("fastest", "ipopt", program, options)
        most = np.concatenate([self._ceiling() / node, np.full(n - 2, np.inf)])
        answer = solver(
            x0=np.minimum(1.0, 0.99 * most),
            lbx=SMALLEST,
            ubx=most,
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

    def _start(self, found: Timing | None) -> tuple[np.ndarray, np.ndarray]:
        """ds² at the inner nodes and in the middle of the inner cells, to start from."""
        if found is None:
            share = (self.s - self.s[0]) / (self.s[-1] - self.s[0])
            shape = (4 * share * (1 - share)) ** (4 / 3)
            first = np.abs(self.path(self.s, 1)).max(axis=0)
            size = float(np.min(self.bounds.acceleration / first) * (self.s[-1] - self.s[0]))
            square = 0.1 * size * shape
        else:
            square = np.interp(self.s, found.s, found.square**0.75) ** (4 / 3)
        return square[1:-1], (square[1:-2] + square[2:-1]) / 2

    def _derivatives(self, cells: np.ndarray) -> list[np.ndarray]:
        """The first three derivatives of q at the inner nodes, as seen from cells."""
        middle = (self.s[:-1] + self.s[1:]) / 2
        piece = np.searchsorted(self.path.breaks, middle[cells]) - 1
        width = np.diff(self.path.breaks)[piece]
        share = (self.s[1:-1] - self.path.breaks[piece]) / width
        found = []
        for order in (1, 2, 3):
            values = np.zeros((len(cells), self.path.dof))
            for k in range(order, 6):
                factor = np.prod(np.arange(k - order + 1, k + 1))
                power = factor * share ** (k - order) / width**order
                values += power[:, None] * self.path.coefficients[piece, k]
            found.append(values)
        return found

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
        if np.isfinite(bounds.path_jerk):
            yield third * ca.sqrt(a) / bounds.path_jerk

    def _ceiling(self) -> np.ndarray:
        """The largest ds² at the inner nodes: speeds, and the jerk at the rests."""
        most = self.bounds.square(self.s[1:-1])
        for cells in (np.arange(len(self.width) - 1), np.arange(1, len(self.width))):
            q1 = np.abs(self._derivatives(cells)[0])
            with np.errstate(divide="ignore"):
                most = np.minimum(most, ((self.bounds.velocity / q1) ** 2).min(axis=1))
        for node, cell, s in ((0, 0, self.s[0]), (-1, -1, self.s[-1])):
            with np.errstate(divide="ignore"):
                jerk = (self.bounds.jerk / np.abs(self.path(s, 1))).min()
            jerk = min(float(jerk), self.bounds.path_jerk)
            most[node] = min(most[node], (4.5 * jerk * self.width[cell] ** 2) ** (2 / 3))
        return most


def run_oracle(seed: int) -> Outcome:
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
        plain = ac.plan(path, limits=limits.replace(joint_jerk=None)).duration
        longer = planned.duration / plain - 1
        if not 0 < longer <= WITHOUT[name.split()[-1]]:
            notes.append(f"{longer:+.2%} of the plan without limits of jerk")
    above = planned.duration / best - 1
    if not -NEAR < above <= NEAR:
        notes.append(f"{name}: {above:+.1e} of the oracle")
    return Outcome(kind=name, result="compared", notes=notes)


def draw_move(seed: int) -> tuple[np.ndarray, ac.Limits]:
    """Both ends of a move, (2, dof), and the limits of its joints."""
    rng = np.random.default_rng((17, seed))
    dof = int(rng.integers(1, 8))
    ends = rng.uniform(-3, 3, (2, dof))
    velocity, acceleration = 10 ** rng.uniform(-1, 1, dof), 10 ** rng.uniform(-0.5, 1.5, dof)
    factor = 10 ** rng.uniform(np.log10(2), np.log10(300))
    jerk = factor * acceleration * 10 ** rng.uniform(-0.3, 0.3, dof)
    return ends, ac.Limits(
        joint_velocity=velocity, joint_acceleration=acceleration, joint_jerk=jerk
    )


def ruckig_duration(ends: np.ndarray, limits: ac.Limits) -> float:
    """Duration along the line, of which every joint scales the limits [s]."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    step = np.abs(ends[1] - ends[0])
    given = InputParameter(1)
    given.current_position, given.target_position = [0.0], [1.0]
    given.max_velocity = [float((limits.joint_velocity / step).min())]
    given.max_acceleration = [float((limits.joint_acceleration / step).min())]
    given.max_jerk = [float((limits.joint_jerk / step).min())]
    found = Trajectory(1)
    result = Ruckig(1).calculate(given, found)
    assert result in (Result.Working, Result.Finished), result
    return float(found.duration)


def gap(seed: int) -> float:
    """Share of Ruckig's duration by which our plan is longer."""
    ends, limits = draw_move(seed)
    planned = ac.plan(ac.JointPath.spline(ends), limits=limits)
    return planned.duration / ruckig_duration(ends, limits) - 1


def run_move(seed: int) -> Outcome:
    """Compare a straight move with Ruckig."""
    longer = gap(seed)
    wrong = not -ROUNDING <= longer <= BAR
    return Outcome(result="compared", notes=[f"{longer:+.2e} of Ruckig's"] if wrong else [])
