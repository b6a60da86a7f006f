"""Plans with jerk limits, judged by independent formulas and by Ruckig.

`run` judges plans of random joint paths. `run_tool` judges plans with tool limits; it computes the
tool's motion as a power series of the forward kinematics up to the third power, without a Jacobian.
`run_move` compares straight moves with Ruckig. `tests.oracle.jerk_optimum` has the fastest timing
by IPOPT.
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
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.planning.jerk import limiter
from soak import Outcome
from soak.timing import answer

Random = np.random.Generator
# Exponents of the distances between waypoints by which their parameters grow.
WAYS = {"uniform": 0.0, "centripetal": 0.5, "chordal": 1.0}
INTERVALS = (60, 200, 1000, 4000)
LEAK = 1e-9
# Places in every interval of a law, its ends among them.
PLACES = 11
# Allowed jump of values where intervals meet, as a share of the largest value.
STEP = 1e-9
# q'' counts as jumping if its jump is at least this share of its largest value there.
BEND = 1e-6
# Sampling rates at which third differences of the positions are compared with the jerk limit [Hz].
RATES = (1000.0, 8000.0)
# Share of the limit by which these differences may exceed it.
SLACK = 5e-3
# Differences in which rounding errors may exceed this share of the limit are not judged.
NOISE = 2e-3
# Maximum number of samples per plan; a longer plan is sampled at a lower rate.
MOST_SAMPLES = 40_000
# One problem out of this many is planned again with searches that end early.
AGAIN = 10
# Numbers of iterations after which these searches end.
EARLY = (1, 3, 8, 20)
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
    """Draw the problem of a seed."""
    rng = np.random.default_rng((16, seed))
    kind = str(rng.choice(list(KINDS), p=SHARES))
    points = KINDS[kind](rng)
    width = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = WAYS[str(rng.choice(list(WAYS)))]
    s = np.concatenate([[0.0], np.cumsum((width / width.max()) ** way)])
    path = ac.JointPath.spline(points, s, ends="clamped" if rng.random() < 0.1 else "natural")
    limits = _limits(rng, path)
    options: dict[str, Any] = {"intervals": int(rng.choice(INTERVALS, p=[0.4, 0.35, 0.15, 0.1]))}
    return Problem(kind=kind, path=path, limits=limits, options=options)


def _points(rng: Random) -> np.ndarray:
    """Draw the waypoints of 1 to 7 joints."""
    count = int(rng.integers(4, 13))
    dof = int(rng.integers(1, 8))
    return rng.uniform(-1.5, 1.5, (count, dof))


def _near(rng: Random) -> np.ndarray:
    """Draw waypoints, some of which nearly repeat the previous one."""
    points = _points(rng)
    indices = rng.choice(len(points) - 1, int(rng.integers(1, 3)), replace=False) + 1
    step = rng.normal(size=(len(indices), points.shape[1])) * 10 ** rng.uniform(-6, -2)
    return np.insert(points, indices, points[indices - 1] + step, axis=0)


def _frozen(rng: Random) -> np.ndarray:
    """Draw waypoints with a joint at rest."""
    points = _points(rng)
    points = np.column_stack([points, points[:, 0]]) if points.shape[1] == 1 else points
    points[:, rng.integers(points.shape[1])] = rng.uniform(-1.5, 1.5)
    return points


def _limits(rng: Random, path: ac.JointPath) -> ac.Limits:
    """Draw limits: those of jerk are 2 to 300 times those of acceleration."""
    dof = path.dof
    acceleration = 10 ** (rng.uniform(0, 1) + rng.uniform(-0.4, 0.4, dof))
    options: dict[str, Any] = {"joint_acceleration": acceleration}
    if rng.random() < 0.15:
        lower = -acceleration * 10 ** rng.uniform(-0.5, 0.5, dof)
        options["joint_acceleration"] = np.stack([lower, acceleration], axis=1)
    if rng.random() < 0.7:
        velocity = 10 ** (rng.uniform(-0.5, 0.7) + rng.uniform(-0.3, 0.3, (dof, 2)))
        options["joint_velocity"] = velocity * (-1, 1) if rng.random() < 0.2 else velocity[:, 0]
    factor = 10 ** rng.uniform(np.log10(2), np.log10(300))
    jerk = factor * acceleration * 10 ** rng.uniform(-0.2, 0.2, dof)
    if rng.random() < 0.15:
        jerk[rng.random(dof) < 0.5] = np.inf
        if not np.isfinite(jerk).any():
            jerk[0] = factor * acceleration[0]
    return ac.Limits.only(**options, joint_jerk=jerk)


KINDS: dict[str, Callable[[Random], np.ndarray]] = {
    "points": _points,
    "near-duplicates": _near,
    "frozen joint": _frozen,
}
SHARES = (0.5, 0.3, 0.2)


def run(seed: int) -> Outcome:
    """Plan and judge the problem of a seed."""
    problem = draw(seed)
    result, notes, worst = answer(problem, _judge)
    if seed % AGAIN == 0:
        notes += early(seed)
    return Outcome(kind=problem.kind, result=result, notes=notes, worst=worst)


def _judge(planned: ac.Trajectory, problem: Problem, options: dict[str, Any]) -> Any:
    return judge(planned, problem.limits)


def judge(planned: ac.Trajectory, limits: ac.Limits) -> tuple[list[str], float]:
    """Return the faults of a plan along a joint path, and its largest ratio to a limit."""
    (law,) = planned.laws
    sampled = Sampled(law)
    notes = sampled.joins(limits)
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
    """Return a context in which every search ends after some iterations."""
    limit_jerk = limiter.limit_jerk

    def short(law, task):  # noqa: ANN001, ANN202
        return limit_jerk(law, replace(task, iterations=iterations))

    with mock.patch.object(limiter, "limit_jerk", short):
        yield


def early(seed: int) -> list[str]:
    """List the faults of plans whose searches end early, for a seed's problem."""
    problem = draw(seed)
    notes = []
    for iterations in EARLY:
        with interrupted(iterations):
            planned = ac.plan(problem.path, limits=problem.limits)
        notes += [f"{iterations} iterations: {x}" for x in judge(planned, problem.limits)[0]]
    return notes


class Sampled:
    """A law at places of every interval: `s` and its derivatives, (n, k), and those of q."""

    def __init__(self, law: ac.PathLaw, places: int = PLACES) -> None:
        self.law = law
        self.path = law.joint_path
        self.width = np.diff(law.s)
        self.times = np.diff(law.breaks)
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
        """Return q and its first three derivatives by s, (n, k, dof) each."""
        start = self.law.s[:-1] - self.path.breaks[self.piece]
        wide = np.diff(self.path.breaks)[self.piece][:, None]
        share = (start[:, None] + self.x) / wide
        c = self.path.coefficients[self.piece][:, :, None]
        columns = []
        for order in range(4):
            factors = [np.prod(np.arange(k - order + 1.0, k + 1.0)) for k in range(6)]
            powers = sum(
                factors[k] * share[..., None] ** (k - order) * c[:, k] for k in range(order, 6)
            )
            columns.append(powers / wide[..., None] ** order)
        return columns

    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the velocity, acceleration and jerk of the joints, (n, k, dof) each."""
        _, q1, q2, q3 = self.slopes()
        ds, dds, ddds = (x[..., None] for x in self.motion)
        return q1 * ds, q2 * ds**2 + q1 * dds, q3 * ds**3 + 3 * q2 * ds * dds + q1 * ddds

    def joins(self, limits: ac.Limits) -> list[str]:
        """List the faults where intervals meet, and at both ends."""
        law = self.law
        notes = []
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
        for name, index in (("start", (0, 0)), ("end", (-1, -1))):
            for quantity, values in zip(ORDERS[:2], joints, strict=False):
                share = np.abs(values[index]).max() / np.abs(values).max()
                if share > STEP:
                    notes.append(f"{quantity} at the {name} is {share:.1e} of its largest, not 0")
        notes += self._durations()
        return notes + self._bends(limits, joints[1])

    def _durations(self) -> list[str]:
        """List intervals whose duration is not the integral of 1 / ds, or that miss their ends."""
        law = self.law
        ds, dds, slope, jerk = law.rates
        x = (GAUSS + 1) / 2 * self.width[:, None]
        square = ds[:, None] ** 2 + x * (2 * dds[:, None] + slope[:, None] * x)
        with np.errstate(invalid="ignore", divide="ignore"):
            taken = self.width * (WEIGHTS / 2 / np.sqrt(square)).sum(axis=1)
        notes = []
        deviation = np.abs(taken - self.times) / law.breaks[-1]
        deviation[jerk != 0] = np.abs(self.x[:, -1] - self.width)[jerk != 0] / self.path.length
        # A quadrature is exact enough where ds does not change much.
        smooth = (self.motion[0].max(axis=1) < 2 * self.motion[0].min(axis=1)) | (jerk != 0)
        k = int(np.argmax(np.where(smooth, deviation, 0.0)))
        if not deviation[k] <= 1e-11:
            notes.append(f"interval {k} takes a wrong time or way: {deviation[k]:.1e} of the whole")
        return notes

    def _bends(self, limits: ac.Limits, acceleration: np.ndarray) -> list[str]:
        """List acceleration jumps: the motion must stop where the path bends."""
        jump = np.abs(acceleration[1:, 0] - acceleration[:-1, -1])
        scale = np.abs(acceleration).max(axis=(0, 1))
        if limits.joint_acceleration is not None:
            scale = np.maximum(scale, limits.acceleration_bounds(len(scale))[1])
        share = jump / np.where(scale > 0, scale, 1.0)
        if limits.joint_jerk is not None:
            share = share[:, np.isfinite(np.broadcast_to(limits.joint_jerk, scale.shape))]
        if not share.size or share.max() <= BEND:
            return []
        k, j = np.unravel_index(int(np.argmax(share)), share.shape)
        return [f"acceleration {j + 1} jumps by {share[k, j]:.1e} of its largest at break {k + 1}"]


def ratios(sampled: Sampled, limits: ac.Limits) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the ratios to limits of the joints, (n, k), and the joints they are of."""
    peaks = {}
    for name, values in zip(ORDERS, sampled.joints(), strict=True):
        limit = getattr(limits, f"joint_{name}")
        if limit is None:
            continue
        low = -limit
        high = limit
        if name != "jerk":
            low, high = getattr(limits, f"{name}_bounds")(values.shape[-1])
        ratio = np.maximum(values / low, values / high)
        peaks[name] = ratio.max(axis=-1), ratio.argmax(axis=-1) + 1
    return peaks


def differences(planned: ac.Trajectory, limits: ac.Limits) -> list[str]:
    """List jerk faults that third differences of sampled positions prove (means over samples)."""
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
# Names of the tool limits that are drawn.
TOOL = ("speed", "tool_acceleration", "centripetal_acceleration")
ANGULAR = ("angular_speed", "angular_acceleration")
CHANCE = 0.35
LEAST = 1e-6
# Orientation of a tool that points downwards.
DOWN = np.diag([1.0, -1.0, -1.0])
# Share of the seeds that have a tool that turns.
TURNING = 0.2
# Standard deviation of the tool's rotation vector at a waypoint, per component [rad].
TURN = 0.2


@cache
def _arm(name: str) -> Any:
    return ac.load_arm(name)


def draw_tool(seed: int) -> Problem:
    """Draw a polyline with curvature-continuous corners, or with a turning tool."""
    rng = np.random.default_rng((18, seed))
    if rng.random() < TURNING:
        kind = "turning"
        arm = _arm(ARMS[0])
        path = _turning(rng, arm)
    else:
        kind = "corners"
        arm = _arm(str(rng.choice(ARMS)))
        path = _corners(rng, arm)
    limits = _tool_limits(rng, arm, ac.trace(path, arm))
    intervals = None if rng.random() < 0.3 else int(rng.choice([200, 500, 1000]))
    return Problem(kind=kind, arm=arm, path=path, limits=limits, options={"intervals": intervals})


def _corners(rng: Random, arm: Any) -> ac.Path:
    """Draw a polyline whose corners are rounded with continuous curvature."""
    count = int(rng.integers(3, 7))
    if arm.dimension == 2:
        points = rng.uniform((0.25, 0.1), (0.42, 0.32), (count, 2))
    else:
        points = rng.uniform((0.35, -0.15, 0.1), (0.6, 0.15, 0.3), (count, 3))
    path = ac.Path.polyline(points)
    path = path if arm.dimension == 2 else path.oriented(DOWN)
    return ac.round_corners(path, tolerance=10 ** rng.uniform(-4, -2), continuity="curvature")


def _turning(rng: Random, arm: Any) -> ac.Path:
    """Draw a polyline with arcs for corners, along which the tool turns, in reach of the arm."""
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
    """Draw limits of joints and tool, each of which is active now and then."""
    dof = arm.dof
    acceleration = 10 ** (rng.uniform(0, 1) + rng.uniform(-0.3, 0.3, dof))
    factor = 10 ** rng.uniform(np.log10(3), np.log10(100))
    options: dict[str, Any] = {
        "joint_velocity": 10 ** (rng.uniform(-0.3, 0.5) + rng.uniform(-0.2, 0.2, dof)),
        "joint_acceleration": acceleration,
        "joint_jerk": factor * acceleration,
    }
    plain = ac.plan(path, arm, ac.Limits.only(**options), ac.Optimal(intervals=200))
    tool = Tool(arm, Sampled(plain.laws[0], 3))
    names = TOOL + (ANGULAR if arm.dimension == 3 else ())
    for name in names:
        peak = float(tool.used(name).max())
        if rng.random() < CHANCE and peak > LEAST:
            options[name] = peak * float(rng.uniform(0.2, 1.1))
    if arm.has_bodies and rng.random() < CHANCE:
        torque = np.abs(tool.torque()).max(axis=(0, 1))
        still = np.abs(tool.torque(still=True)).max(axis=(0, 1))
        # The arm can hold itself, against its friction too.
        static_torque = 1.2 * still + 1.1 * np.broadcast_to(arm.chain.coulomb, (dof,))
        options["joint_torque"] = 0.1 + static_torque + rng.uniform(0.1, 1.0, dof) * torque
    return ac.Limits.only(**options)


def series(arm: Any, *q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return derivatives of the tool's position, (n, 3), and rotation matrix, (n, 3, 3)."""
    chain = arm.chain
    size = len(q[0])
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
    """Return the series of a frame that does not move."""
    rotation = [np.zeros((size, 3, 3)) for _ in range(orders)]
    point = [np.zeros((size, 3)) for _ in range(orders)]
    rotation[0][:] = frame.rotation
    point[0][:] = frame.position
    return rotation, point


def _product(first: list[np.ndarray], second: list[np.ndarray]) -> list[np.ndarray]:
    """Differentiate a product of matrices, by Leibniz' rule."""
    return [
        sum(comb(n, k) * first[k] @ second[n - k] for k in range(n + 1)) for n in range(len(first))
    ]


def _turn(axis: np.ndarray, angle: list[np.ndarray]) -> list[np.ndarray]:
    """Differentiate the rotation about an axis, by Rodrigues' formula."""
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
    rotations = [
        s[:, None, None] * cross - c[:, None, None] * (cross @ cross)
        for s, c in zip(sine, cosine, strict=True)
    ]
    rotations[0] = rotations[0] + np.eye(3) + cross @ cross
    return rotations


class Tool:
    """The tool's motion at the places of a sampled law, (n, k, ...)."""

    def __init__(self, arm: Any, sampled: Sampled) -> None:
        self.arm = arm
        self.sampled = sampled
        q = sampled.slopes()
        self.shape = q[0].shape[:2]
        self.q = q[0].reshape(-1, arm.dof)
        self.point, self.rotation = series(arm, *(x.reshape(-1, arm.dof) for x in q))
        self.ds, self.dds, _ = (x.reshape(-1, 1) for x in sampled.motion)

    def used(self, name: str) -> np.ndarray:
        """Return the values that a limit of the tool bounds, (n, k)."""
        ds, dds = self.ds, self.dds
        _, x1, x2, _ = self.point
        if name == "speed":
            derivative = x1 * ds
        elif name == "tool_acceleration":
            derivative = x2 * ds**2 + x1 * dds
        elif name == "centripetal_acceleration":
            length = np.sum(x1 * x1, axis=1, keepdims=True)
            derivative = (x2 - np.sum(x1 * x2, axis=1, keepdims=True) / length * x1) * ds**2
        else:
            turning, change = self._turning()
            derivative = turning * ds
            if name == "angular_acceleration":
                derivative = change * ds**2 + turning * dds
        return np.linalg.norm(derivative, axis=1).reshape(self.shape)

    def _turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular velocity at ds = 1, and its derivative by s, (m, 3) each."""
        back = [np.swapaxes(x, 1, 2) for x in self.rotation]
        first = self.rotation[1] @ back[0]
        second = self.rotation[2] @ back[0] + self.rotation[1] @ back[1]
        places = ([2, 0, 1], [1, 2, 0])
        return first[:, places[0], places[1]], second[:, places[0], places[1]]

    def torque(self, *, still: bool = False) -> np.ndarray:
        """Return the torques of the joints, (n, k, dof), or those at rest."""
        velocity, acceleration, _ = self.sampled.joints()
        moving = 0.0 if still else 1.0
        states = (moving * x.reshape(-1, self.arm.dof) for x in (velocity, acceleration))
        return self.arm.torque(self.q, *states).reshape(*self.shape, -1)


def judge_tool(planned: ac.Trajectory, arm: Any, limits: ac.Limits) -> tuple[list[str], float]:
    """Return the faults of a plan with one law, and its largest ratio to any limit."""
    notes, worst = judge(planned, limits)
    (law,) = planned.laws
    sampled = Sampled(law)
    tool = Tool(arm, sampled)
    ratios = {
        name: tool.used(name) / getattr(limits, name)
        for name in (*TOOL, *ANGULAR)
        if getattr(limits, name) is not None
    }
    segment_speeds = planned.path.speeds[planned.path.locate((law.s[1:] + law.s[:-1]) / 2)]
    if np.isfinite(segment_speeds).any():
        ratios["speed of a segment"] = np.nan_to_num(tool.used("speed") / segment_speeds[:, None])
    if limits.joint_torque is not None:
        ratios["torque"] = (np.abs(tool.torque()) / limits.joint_torque).max(axis=-1)
    for name, ratio in ratios.items():
        k = np.unravel_index(int(np.argmax(np.nan_to_num(ratio, nan=np.inf))), ratio.shape)
        worst = max(worst, float(ratio[k]))
        if not ratio[k] <= 1 + LEAK:
            notes.append(f"{name} 1 {ratio[k] - 1:+.2e} in interval {k[0]} of {len(ratio)}")
    return notes, worst


def run_tool(seed: int) -> Outcome:
    """Plan and judge the problem of a seed that has limits of the tool."""
    problem = draw_tool(seed)
    planned = ac.plan(problem.path, problem.arm, problem.limits, ac.Optimal(**problem.options))
    notes, worst = judge_tool(planned, problem.arm, problem.limits)
    return Outcome(kind=problem.kind, result="planned", notes=notes, worst=worst)


# A straight move may be longer than Ruckig's by at most this share of its duration.
BAR = 1e-3
# It may be shorter, by rounding errors alone, by at most this share.
ROUNDING = 1e-9


def draw_move(seed: int) -> tuple[np.ndarray, ac.Limits]:
    """Draw both ends of a move, (2, dof), and the limits of its joints."""
    rng = np.random.default_rng((17, seed))
    dof = int(rng.integers(1, 8))
    ends = rng.uniform(-3, 3, (2, dof))
    velocity = 10 ** rng.uniform(-1, 1, dof)
    acceleration = 10 ** rng.uniform(-0.5, 1.5, dof)
    factor = 10 ** rng.uniform(np.log10(2), np.log10(300))
    jerk = factor * acceleration * 10 ** rng.uniform(-0.3, 0.3, dof)
    return ends, ac.Limits.only(
        joint_velocity=velocity, joint_acceleration=acceleration, joint_jerk=jerk
    )


def ruckig_duration(ends: np.ndarray, limits: ac.Limits) -> float:
    """Return Ruckig's duration along the line, of which every joint scales the limits [s]."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    step = np.abs(ends[1] - ends[0])
    parameters = InputParameter(1)
    parameters.current_position = [0.0]
    parameters.target_position = [1.0]
    parameters.max_velocity = [float((limits.joint_velocity / step).min())]
    parameters.max_acceleration = [float((limits.joint_acceleration / step).min())]
    parameters.max_jerk = [float((limits.joint_jerk / step).min())]
    trajectory = Trajectory(1)
    result = Ruckig(1).calculate(parameters, trajectory)
    assert result in (Result.Working, Result.Finished), result
    return float(trajectory.duration)


def gap(seed: int) -> float:
    """Return by which share of Ruckig's duration our plan is longer."""
    ends, limits = draw_move(seed)
    planned = ac.plan(ac.JointPath.spline(ends), limits=limits)
    return planned.duration / ruckig_duration(ends, limits) - 1


def run_move(seed: int) -> Outcome:
    """Compare a straight move with Ruckig."""
    longer = gap(seed)
    wrong = not -ROUNDING <= longer <= BAR
    return Outcome(result="compared", notes=[f"{longer:+.2e} of Ruckig's"] if wrong else [])
