"""Learning on robots whose drive loops are of another kind than the job's servo.

The robots are simulated here in steps of 0.1 ms and share no code with the package. Their joints
are independent, although the arm has masses. Each robot is judged by its tool's true motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

import armcontour as ac
from soak import Outcome

# Time step of the simulation [s].
STEP = 1e-4
KINDS = (
    "P-P",
    "P-PI",
    "PID",
    "feed-forward",
    "dead time",
    "cycle",
    "friction",
    "first order",
)
# Gains of the job's servo differ from those of the robot by at most this fraction.
GAIN_ERROR = 0.15
# Times that a log begins before the first set-point and ends after the last one [s].
LEAD = 0.3
TAIL = 0.6
# Duration over which the tool is judged after the last set-point [s].
REST = 3.0
# Standard deviation of encoder noise [rad].
NOISE = 2e-6
RUNS = 5
# Link lengths of the arm pmk3s [m].
LINKS = (0.25, 0.215)
POINTS = ((0.30, 0.14), (0.36, 0.18), (0.34, 0.25), (0.27, 0.24), (0.30, 0.14))
# Learning is expected to divide the error by this factor, or to leave SMALL.
GAIN = 8.0
# Largest error that is small [m].
SMALL = 2e-6
# Encoder noise of some robots [rad].
NOISY = 2e-5
# Largest ratio of the last run's error to the best run's.
LAST_TO_BEST = 1.2


@dataclass(frozen=True)
class Joint:
    """Loops of a joint: acceleration `kv (kp e + f du - dq + I) + g ddu`, minus friction."""

    kp: float  # 1/s
    kv: float  # 1/s; 0 for a loop of first order
    ki: float  # 1/s, gain of the integral
    pid: bool  # whether the position error is integrated instead of the velocity error
    feed: float  # velocity feed-forward
    bend: float  # acceleration feed-forward
    dead_time: float  # s
    coulomb: float  # rad/s², dry friction
    viscous: float  # 1/s, viscous friction


@dataclass(frozen=True)
class Robot:
    """A robot: its kind, time between set-points [s], cycle of its drives [s], and its joints."""

    kind: str
    period: float
    cycle: float
    joints: tuple[Joint, ...]


def draw(seed: int, dof: int = 2) -> Robot:
    """Draw a random robot of the kind `seed % len(KINDS)`."""
    rng = np.random.default_rng([31, seed])
    kind = KINDS[seed % len(KINDS)]
    period = float(rng.choice([2e-3, 4e-3, 8e-3]))
    cycle = float(rng.choice([1e-3, 2e-3])) if kind == "cycle" else 1e-4
    dead_time = rng.uniform(0.02, 0.05) if kind == "dead time" else rng.uniform(0.0, 8e-3)
    joints = []
    for _ in range(dof):
        kv = min(rng.uniform(60.0, 220.0), 0.4 / cycle)
        kp = min(rng.uniform(9.0, 32.0), kv / 4)
        ki = rng.uniform(2.0, 14.0)
        feed = rng.uniform(0.5, 1.0)
        joints.append(
            Joint(
                kp=kp,
                kv=0.0 if kind == "first order" else kv,
                ki=ki if kind in ("P-PI", "PID", "friction") else 0.0,
                pid=kind == "PID",
                feed=feed if kind in ("feed-forward", "dead time") else 0.0,
                bend=0.5 * feed if kind == "feed-forward" and seed % 2 else 0.0,
                dead_time=dead_time,
                coulomb=rng.uniform(0.1, 0.5) if kind == "friction" else 0.0,
                viscous=rng.uniform(0.0, 2.0) if kind == "friction" else 0.0,
            )
        )
    return Robot(kind=kind, period=period, cycle=cycle, joints=tuple(joints))


@njit(cache=True)
def _follow(u, period, steps, every, kp, kv, ki, pid, feed, bend, dead_time, coulomb, viscous):
    """Return the positions of a joint after each STEP, from rest at the first set-point."""
    positions = np.empty(steps)
    cycle = every * STEP
    q = u[0]
    v = 0.0
    integral = 0.0
    before = u[0]
    rate_before = 0.0
    demand = 0.0
    acceleration = 0.0
    for i in range(steps):
        if i % every == 0:
            place = (i * STEP - dead_time) / period
            k = int(np.floor(place + 1e-9))
            if k < 0:
                command = u[0]
            elif k >= len(u) - 1:
                command = u[-1]
            else:
                command = u[k] + (place - k) * (u[k + 1] - u[k])
            rate = (command - before) / cycle
            bending = (rate - rate_before) / cycle
            before = command
            rate_before = rate
            demand = kp * (command - q) + feed * rate
            if kv > 0:
                error = demand - v
                acceleration = kv * (error + integral) + bend * bending
                integral += ki * cycle * (kp * (command - q) if pid else error)
        if kv == 0:
            v = demand
            q += STEP * v
        else:
            total = acceleration - viscous * v
            if coulomb > 0:
                if abs(v) < 1e-9 and abs(total) <= coulomb:
                    v = 0.0
                    total = 0.0
                else:
                    sign = 1.0 if v > 0 or (v == 0 and total > 0) else -1.0
                    after = v + STEP * (total - coulomb * sign)
                    if v != 0 and after * v < 0:
                        after = 0.0
                    total = (after - v) / STEP
            v += STEP * total
            q += STEP * v
        positions[i] = q
    return positions


def execute(robot: Robot, q: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s], (n,), and joint positions [rad], (n, dof), for set-points q."""
    steps = round((len(q) - 1) * period / STEP) + 1
    every = round(robot.cycle / STEP)
    columns = [
        _follow(
            np.ascontiguousarray(q[:, j]), period, steps, every, x.kp, x.kv, x.ki, x.pid, x.feed,
            x.bend, x.dead_time, x.coulomb, x.viscous,
        )
        for j, x in enumerate(robot.joints)
    ]  # fmt: skip
    return STEP * np.arange(1, steps + 1), np.stack(columns, axis=1)


def record(
    robot: Robot, q: np.ndarray, period: float, noise: float, seed: int, tail: float = TAIL
) -> ac.Log:
    """Record the log of a run, with a sample per set-point."""
    held = np.concatenate(
        [
            np.repeat(q[:1], round(LEAD / period), axis=0),
            q,
            np.repeat(q[-1:], round(tail / period), axis=0),
        ]
    )
    t, positions = execute(robot, held, period)
    times = period * np.arange(len(held) - 1)
    rng = np.random.default_rng(seed)
    measured = np.stack([np.interp(times, t, x) for x in positions.T], axis=1)
    measured += rng.normal(scale=noise, size=measured.shape)
    return ac.Log(t=times, command=held[:-1], measured=measured)


def tool(q: np.ndarray) -> np.ndarray:
    """Return tool points of a two-link arm [m], (n, 2)."""
    first = q[:, 0]
    both = q.sum(axis=1)
    x = LINKS[0] * np.cos(first) + LINKS[1] * np.cos(both)
    y = LINKS[0] * np.sin(first) + LINKS[1] * np.sin(both)
    return np.stack([x, y], axis=1)


def distances(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Return the distances of points, (n, 2), to a polyline with short edges, (m, 2) [m]."""
    nearest, index = cKDTree(curve).query(points)
    for shift in (-2, -1, 0, 1):
        k = np.clip(index + shift, 0, len(curve) - 2)
        edge = curve[k + 1] - curve[k]
        length = np.maximum((edge**2).sum(axis=1), 1e-300)
        share = np.clip(((points - curve[k]) * edge).sum(axis=1) / length, 0.0, 1.0)
        offset = points - curve[k] - share[:, None] * edge
        nearest = np.minimum(nearest, np.linalg.norm(offset, axis=1))
    return nearest


@cache
def plan() -> ac.Trajectory:
    """Return the plan of the job on the arm pmk3s."""
    arm = ac.load_arm("pmk3s")
    path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=1e-3)
    limits = arm.limits.replace(speed=0.1, centripetal_acceleration=0.3)
    return ac.plan(path, arm, limits, ac.Optimal(reserve=0.2))


@dataclass(frozen=True)
class Truth:
    """True errors of the tool in a run [m]."""

    rms: float  # RMS distance from the path during the plan
    largest: float  # largest distance from the path during the plan and the rest
    creep: float  # largest distance from the path, from TAIL after the last set-point


def judge(robot: Robot, q: np.ndarray, period: float, start: float) -> Truth:
    """Return the true errors of a run with set-points q from time `start` [s], with rest."""
    trajectory = plan()
    held = np.concatenate([q, np.repeat(q[-1:], round(REST / period), axis=0)])
    t, positions = execute(robot, held, period)
    t = t + start
    points = tool(positions)
    curve = tool(np.asarray(trajectory(np.linspace(0.0, trajectory.duration, 20001))))
    errors = distances(points, curve)
    during = (t >= 0) & (t <= trajectory.duration)
    end = start + (len(q) - 1) * period
    resting = t > end + TAIL
    return Truth(
        rms=float(np.sqrt(np.mean(errors[during] ** 2))),
        largest=float(errors.max()),
        creep=float(errors[resting].max()),
    )


def servo_of(robot: Robot, seed: int) -> ac.ServoModel:
    """Return the servo of the job: gains that err by up to GAIN_ERROR, no integrator, no friction.

    The dead time of every second robot is known to a multiple of 4 ms.
    """
    rng = np.random.default_rng([32, seed])
    factor = rng.uniform(1 - GAIN_ERROR, 1 + GAIN_ERROR, (2, len(robot.joints)))
    first = robot.kind == "first order"
    dead_time = robot.joints[0].dead_time
    if (seed // len(KINDS)) % 2:
        dead_time = 4e-3 * round(dead_time / 4e-3)
    return ac.ServoModel(
        kp=factor[0] * [x.kp for x in robot.joints],
        kv=None if first else factor[1] * [x.kv for x in robot.joints],
        order="first" if first else "second",
        velocity_feedforward=[x.feed for x in robot.joints],
        dead_time=dead_time,
    )


@dataclass(frozen=True)
class Lesson:
    """Learning of one robot: results of `learn`, and the true errors of all runs."""

    results: list[ac.LearningResult]
    truths: list[Truth]


def teach(
    robot: Robot, servo: ac.ServoModel, seed: int, noise: float = NOISE, runs: int = RUNS
) -> Lesson:
    """Learn from the logs of a robot until learning ends, at most `runs` times."""
    arm = ac.load_arm("pmk3s")
    set_points = ac.compensate(plan(), servo, ac.Inverse(), cycle=robot.period)
    results = []
    truths = [judge(robot, np.asarray(set_points.q), robot.period, set_points.start_time)]
    for run in range(runs):
        log = record(robot, np.asarray(set_points.q), robot.period, noise, 100 * seed + run)
        set_points = ac.learn(set_points, log, arm=arm, servo=servo)
        results.append(set_points)
        truths.append(judge(robot, np.asarray(set_points.q), robot.period, set_points.start_time))
        if set_points.finished:
            break
    return Lesson(results=results, truths=truths)


def exact_servo(robot: Robot) -> ac.ServoModel:
    """Return the servo of the job with the gains of a P-P robot."""
    return ac.ServoModel(
        kp=[x.kp for x in robot.joints],
        kv=[x.kv for x in robot.joints],
        dead_time=robot.joints[0].dead_time,
    )


def faults(robot: Robot, lesson: Lesson) -> list[str]:
    """List the learning results that the tool's true motion contradicts."""
    notes = []
    errors = np.array([x.rms for x in lesson.truths])
    last = lesson.results[-1]
    refused = "identify the servo" in last.reason.lower()
    # No servo of `ServoModel` integrates the position error.
    if refused and robot.kind != "PID":
        notes.append(f"refuses: {last.reason}")
    if not refused and errors.min() > max(errors[0] / GAIN, SMALL):
        notes.append("improves too little")
    if errors[-1] > LAST_TO_BEST * errors.min() + SMALL:
        notes.append("the last run is worse than the best")
    for truth, result in zip(lesson.truths, lesson.results, strict=False):
        stated = result.runs[-1].contour_max
        # A joint with dry friction can stick and move after the log.
        if robot.kind != "friction" and truth.creep > stated + SMALL:
            notes.append(f"is off by {1e3 * truth.creep:.4f} mm at rest, stated {1e3 * stated:.4f}")
    shown = " ".join(f"{1e3 * x:.4f}" for x in errors)
    return [f"{robot.kind} {x}: {shown} mm" for x in notes]


def run(seed: int) -> Outcome:
    """Learn on a robot with other loops than the model; every fifth has more noise."""
    robot = draw(seed)
    noise = NOISY if seed % 5 == 4 else NOISE
    lesson = teach(robot, servo_of(robot, seed), seed, noise)
    notes = faults(robot, lesson) if noise == NOISE else []
    return Outcome(kind=robot.kind, result=lesson.results[-1].model, notes=notes)


def run_exact(seed: int) -> Outcome:
    """Learn on independent joints with exactly the servo of the job; the arm has masses."""
    robot = draw(len(KINDS) * seed)
    lesson = teach(robot, exact_servo(robot), seed, runs=1)
    return Outcome(result=lesson.results[-1].model, notes=faults(robot, lesson))
