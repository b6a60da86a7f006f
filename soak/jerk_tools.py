"""Plans with limits of jerk and of the tool, judged by power series of the forward kinematics.

Paths are polylines with corners of continuous curvature, with the same tool orientation everywhere;
polylines with arcs for corners, at which the motion rests, and a tool that turns from each waypoint
to the next; or splines through joint positions whose parameter is the arc length of the tool.
Positions and orientations of the tool are power series in s up to the third power, of which the law
makes those in time; no Jacobian is used. Only torques are the arm's own.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import armcontour as ac
from soak.jerk_judge import LEAK, MOST_ITERATIONS, Outcome, Sampled, counted, judge

ARMS = ("ur5e", "pmk3s", "panda")
# Places at which lengths are measured, and knots of the spline over the length.
DENSE, KNOTS = 8001, 200
# Limits of the tool, and what they are of the speed of a joint or less at the path's size.
TOOL = ("speed", "tool_acceleration", "centripetal_acceleration", "tool_jerk", "path_jerk")
ANGULAR = ("angular_speed", "angular_acceleration")
CHANCE = 0.35
LEAST = 1e-6  # a tool that does less has no limit of it
# How many of the paths are polylines, and how a tool is held that looks down.
CORNERS, DOWN = 0.4, np.diag([1.0, -1.0, -1.0])
# How many of the seeds have a tool that turns, and by about which angle at a waypoint [rad].
TURNING, TURN = 0.2, 0.2
# The slowest place of the tool along a drawn curve, as a share of the fastest.
EVEN = 0.25
# Exponents of the time in the units of limits.
ORDERS = {"speed": 1, "acceleration": 2, "jerk": 3}


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What the planner is asked: a path, or a joint path with a tool path, of an arm."""

    seed: int
    kind: str
    arm: Any
    path: ac.Path | ac.JointPath
    limits: ac.Limits
    intervals: int | None


@cache
def _arm(name: str) -> Any:
    return ac.load_arm(name)


def draw(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng((18, seed))
    kind = "corners" if rng.random() < CORNERS else "spline"
    arm = _arm(str(rng.choice(ARMS[:2] if kind == "corners" else ARMS)))
    path: ac.Path | ac.JointPath
    # Other numbers than those of `rng`, so that other seeds have the problems that they had.
    turning = np.random.default_rng((19, seed))
    if turning.random() < TURNING:
        kind, arm = "turning", _arm(ARMS[0])
        path = _turning(turning, arm)
        limits = _limits(rng, arm, ac.trace(path, arm))
    elif kind == "corners":
        path = _corners(rng, arm)
        limits = _limits(rng, arm, ac.trace(path, arm))
    else:
        path, speeds = _path(rng, arm)
        limits = _limits(rng, arm, path)
        tool = ac.Path.from_segments(_lines(path, speeds * (limits.speed or 0.3)))
        breaks = np.append(path.breaks[:-1], tool.length)
        path = ac.JointPath(breaks=breaks, coefficients=path.coefficients, tool_path=tool)
    intervals = None if rng.random() < 0.3 else int(rng.choice([200, 500, 1000]))
    return Problem(seed=seed, kind=kind, arm=arm, path=path, limits=limits, intervals=intervals)


def _corners(rng: np.random.Generator, arm: Any) -> ac.Path:
    """A polyline whose corners are rounded with continuous curvature."""
    count = int(rng.integers(3, 7))
    if arm.dimension == 2:
        points = rng.uniform((0.25, 0.1), (0.42, 0.32), (count, 2))
    else:
        points = rng.uniform((0.35, -0.15, 0.1), (0.6, 0.15, 0.3), (count, 3))
    path = ac.Path.polyline(points)
    path = path if arm.dimension == 2 else path.oriented(DOWN)
    return ac.round_corners(path, tolerance=10 ** rng.uniform(-4, -2), continuity="curvature")


def _turning(rng: np.random.Generator, arm: Any) -> ac.Path:
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


def _path(rng: np.random.Generator, arm: Any) -> tuple[ac.JointPath, np.ndarray]:
    """A smooth joint path over the length of its tool's path, and shares of speed per piece."""
    low, high = arm.limits.joint_range(arm.dof)
    low, high = np.maximum(low, -2.5), np.minimum(high, 2.5)
    while True:
        way = low + (high - low) * rng.uniform(0.2, 0.8, (int(rng.integers(3, 6)), arm.dof))
        way = way[:1] + rng.uniform(0.1, 1.0) * (way - way[:1])
        curve = CubicSpline(np.arange(len(way)), way)
        t = np.linspace(0, len(way) - 1, DENSE)
        rates = series(arm, curve(t), curve(t, 1))[0]
        speed = np.linalg.norm(rates[1], axis=1)
        # No place at which the tool nearly turns back.
        if speed.min() > EVEN * speed.max():
            break
    s = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)]) * (t[1] - t[0])
    at = np.linspace(0, s[-1], KNOTS)
    spline = CubicSpline(at, curve(np.interp(at, s, t)))
    coefficients = np.zeros((KNOTS - 1, 6, arm.dof))
    for k in range(4):
        coefficients[:, k] = spline.c[3 - k] * np.diff(at)[:, None] ** k
    speeds = np.full(KNOTS - 1, np.nan)
    if rng.random() < 0.3:
        cuts = np.sort(rng.integers(1, KNOTS - 1, 3))
        speeds = np.repeat(rng.uniform(0.2, 2.0, 4), np.diff([0, *cuts, KNOTS - 1]))
    return ac.JointPath(breaks=at, coefficients=coefficients), speeds


def _lines(path: ac.JointPath, speeds: np.ndarray) -> list[ac.Line]:
    """Lines as long as the pieces of the path: of the tool path only lengths and speeds matter."""
    ends = np.zeros((len(path.breaks), 3))
    ends[:, 0] = path.breaks
    return [
        ac.Line(start=a, end=b, demand=ac.Demand(speed=None if np.isnan(v) else float(v)))
        for a, b, v in zip(ends[:-1], ends[1:], speeds, strict=True)
    ]


def _limits(rng: np.random.Generator, arm: Any, path: ac.JointPath) -> ac.Limits:
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
    """Derivatives of the tool's position, (n, 3) each, and of its rotation matrix, (n, 3, 3) each.

    Args:
        arm: The arm.
        q: Joint positions and their derivatives by any parameter, (n, dof) each.
    """
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


def run(seed: int) -> Outcome:
    """Draw, plan and judge the problem of a seed; warnings count as crashes."""
    begun = time.perf_counter()
    kind, worst = "", 0.0
    with warnings.catch_warnings(), counted() as iterations:
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Limits of jerk add")
        try:
            problem = draw(seed)
            kind = problem.kind
            iterations.clear()
            planned = ac.plan(
                problem.path, problem.arm, problem.limits, intervals=problem.intervals
            )
            notes, worst = judge_tool(planned, problem.arm, problem.limits)
            result = "wrong" if notes else "planned"
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            result, notes = "crash", [f"{type(error).__name__}: {error}"]
    most = max(iterations, default=0)
    if most >= MOST_ITERATIONS:
        result, notes = "wrong", [*notes, f"{most} iterations"]
    seconds = time.perf_counter() - begun
    return Outcome(
        seed=seed,
        kind=kind,
        result=result,
        notes=notes,
        worst=worst,
        iterations=most,
        seconds=seconds,
    )
