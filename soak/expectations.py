"""Test the identification guide's recipe: does the expected error hold for another program?

Each robot of `soak.loops` records a multisine and the lines of a program. `identify` determines its
servo, and a run of another program expects an error, which is compared with the true motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import yaml

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.limits_and_servo_files import servo_values
from soak import Outcome
from soak.loops import NOISE, Robot, distances, draw, execute, record, tool

# Duration [s] and amplitude [rad] of the multisine.
DURATION = 12.0
AMPLITUDE = 5e-3
# Lowest and highest frequency of the multisine [Hz].
BAND = (0.5, 25.0)
# Duration of the rest after the motion [s].
REST = 1.0
# The true largest error over the expected one is within these ratios, or below SMALL.
RATIOS = (0.5, 2.0)
# Largest error that is small [m].
SMALL = 2e-6
LINES = """
name: lines
arm: pmk3s
path: {points: [[0.35, 0.10], [0.41, 0.15], [0.35, 0.20], [0.30, 0.26]]}
corners: {tolerance: 5 mm}
limits: {speed: 0.2 m/s, centripetal_acceleration: 0.3 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {plain: {cycle: 2 ms, compensation: {method: none}}}
"""
STAR = """
name: star
arm: pmk3s
path: {points: [[0.30, 0.14], [0.36, 0.18], [0.34, 0.25], [0.27, 0.24], [0.25, 0.17], [0.30, 0.14]]}
corners: {tolerance: 0.1 mm}
limits: {speed: 0.12 m/s, centripetal_acceleration: 0.3 m/s²}
runs: {inverse: {compensation: {method: inverse}, timing: {reserve: 10 %}}}
"""


@dataclass(frozen=True)
class Expectation:
    """Largest contour errors of a run after identification [m]."""

    identification: ac.Identification
    expected: float | None  # as the run states
    true: float  # of the tool's true motion
    kept: bool  # as the run states
    allowed: float  # largest error that is allowed


def multisine(period: float, rng: np.random.Generator) -> np.ndarray:
    """Return the multisine of the guide [rad], (n,)."""
    t = np.arange(0.0, DURATION, period)
    f = np.fft.rfftfreq(len(t), period)
    band = (f >= BAND[0]) & (f <= BAND[1])
    lines = band * np.exp(2j * np.pi * rng.uniform(size=len(f)))
    for _ in range(50):
        u = np.fft.irfft(lines, len(t))
        clipped = np.clip(u, -1.7 * u.std(), 1.7 * u.std())
        lines = band * np.exp(1j * np.angle(np.fft.rfft(clipped)))
    u = np.fft.irfft(lines, len(t))
    rise = np.sin(np.pi / 2 * np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)) ** 2
    return AMPLITUDE * u / np.abs(u).max() * rise


@cache
def lines() -> tuple[np.ndarray, np.ndarray]:
    """Return the times [s] and set-points [rad] of the lines at full speed."""
    set_points = ac.run(parse_job(LINES), simulate=False).runs["plain"].set_points
    return set_points.t, np.asarray(set_points.q)


def logs(robot: Robot, seed: int) -> tuple[ac.Log, ac.Log]:
    """Record the logs of the multisine about the start, and of the lines."""
    t, q = lines()
    rng = np.random.default_rng([33, seed])
    waves = np.stack([multisine(robot.period, rng) for _ in robot.joints], axis=1)
    times = np.arange(t[0], t[-1], robot.period)
    program = np.stack([np.interp(times, t, x) for x in q.T], axis=1)
    return (
        record(robot, q[0] + waves, robot.period, NOISE, 2 * seed),
        record(robot, program, robot.period, NOISE, 2 * seed + 1),
    )


def expect(robot: Robot, seed: int) -> Expectation:
    """Identify a robot from its logs, and execute another program on it."""
    options = ac.ServoFit(kinematics=ac.load_arm("pmk3s"))
    identification = ac.identify(logs(robot, seed), options)
    job = yaml.safe_load(STAR)
    job["servo"] = servo_values(identification)
    job["cycle"] = f"{1e3 * robot.period:g} ms"
    result = ac.run(parse_job(yaml.safe_dump(job, allow_unicode=True)))
    run = result.runs["inverse"]
    q = np.asarray(run.set_points.q)
    held = np.concatenate([q, np.repeat(q[-1:], round(REST / robot.period), axis=0)])
    positions = execute(robot, held, robot.period)[1]
    plan = run.trajectory
    curve = tool(np.asarray(plan(np.linspace(0.0, plan.duration, 40001))))
    return Expectation(
        identification=identification,
        expected=None if run.expected is None else max(run.expected.contours),
        true=float(distances(tool(positions), curve).max()),
        kept=bool(run.verdict.kept),
        allowed=run.verdict.allowed,
    )


def run(seed: int) -> Outcome:
    """Judge the error to expect of a random robot."""
    robot = draw(seed)
    found = expect(robot, seed)
    trusted = found.identification.trusted
    notes = []
    if found.expected is None:
        result = "no expectation"
        if trusted:
            notes.append(f"{robot.kind}: no error is expected, although the servo is trusted")
    else:
        ratio = found.true / found.expected
        result = "expected"
        if not RATIOS[0] <= ratio <= RATIOS[1] and max(found.true, found.expected) > SMALL:
            notes.append(f"{robot.kind}: the true error is {ratio:.2f} of the expected error")
    if found.kept and found.true > found.allowed:
        notes.append(f"{robot.kind}: is kept with {1e3 * found.true:.4f} mm")
    return Outcome(kind=robot.kind, result=result, notes=notes)
