"""A square of 100 mm at 0.25 m/s with corner errors of 0.25 mm, against roboplan's plan.

A UR5e holds its tool in one way, starts and ends at rest on a corner, with the same limits of joint
velocity and acceleration and the same start for both. Ours is all of it: rounded corners, inverse
kinematics, timing. roboplan's planner is made before it is timed. Times are those of the
processor, as plans are as short as the time slices of a machine with other work. roboplan runs in a
process of its own, with this Python or, as it asks for one version of pinocchio, with that named by
ARMCONTOUR_ROBOPLAN_PYTHON:

    python -m venv roboplan && roboplan/bin/pip install roboplan
    ARMCONTOUR_ROBOPLAN_PYTHON=roboplan/bin/python python -m benchmarks

Its settings are the fastest of those that keep the corner error, of a sweep over
`max_position_error`, `toppra_blend_deviation`, `dt`, both modes, and the corners or the rounded
path as waypoints; what its inverse kinematics weighs made no difference. The error is measured, as
what it does not promise it may still keep: a tolerance of its own of 0.25 mm has a line too. Its
mode Bounded slows all of the motion until the tool is slow enough where it is fastest; its mode
TimeOptimal knows no tool speed, so `velocity_scale` is bisected until the tool keeps it, which is
not timed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import armcontour as ac
from armcontour._checks import FloatArray
from benchmarks import ur5e
from benchmarks.measured import Measured

PYTHON = "ARMCONTOUR_ROBOPLAN_PYTHON"
PROGRAM = Path(__file__).with_name("roboplan_peer.py")
VELOCITY, ACCELERATION, SPEED = 3.14, 8.0, 0.25  # rad/s, rad/s², m/s
JOINTS = ac.Limits(joint_velocity=VELOCITY, joint_acceleration=ACCELERATION)
ROUNDS, RUNS = 11, 5
# Intervals of a coarser grid than the default's, about as many as roboplan's.
COARSE = 400
# Places per interval at which a plan is judged.
PLACES = 20
# Tightened so that its tool stays within the corner error: half of the first is what its joint path
# may leave the square by, and the second rounds the corners of its joint path [m, rad].
TIGHT = {"max_position_error": 1.1429e-3, "toppra_blend_deviation": 1e-4}
# Blends this much tighter make its mode Bounded faster.
BOUNDED = {
    **TIGHT,
    "toppra_blend_deviation": 2e-5,
    "max_linear_speed": SPEED,
    # Out of the way, as ours has no such limits.
    "max_linear_acceleration": 1e3,
    "max_angular_speed": 1e2,
    "max_angular_acceleration": 1e4,
}
# Its law itself, as it is sampled: its plan once more with samples this close [s].
FINE = 2e-4
BISECTIONS = 12
# The tool may be this much too fast for roboplan.
SLACK = 1.002

Ask = Callable[..., Any]


@dataclass(frozen=True)
class Judged:
    """One plan: lengths in m, speed in m/s, and the largest shares of the joints' limits.

    `law` is the largest share of the law itself, `executed` that of the cubics through its samples;
    ours is executed as it is.
    """

    who: str
    duration: float
    corner: float
    off: float
    speed: float
    law: float
    executed: float


def measure() -> tuple[list[Measured], list[Judged], list[str]]:
    """Times, answers, and notes."""
    arm, path = ur5e.load(), ur5e.square()
    limits = JOINTS.replace(speed=SPEED)
    first = plan(arm, path, limits)
    start = first(0.0)
    free = plan(arm, path, JOINTS, start)
    coarse = plan(arm, path, limits, start, COARSE)
    judged = [
        _ours("armcontour", arm, path, first),
        _ours(f"armcontour, intervals={COARSE}", arm, path, coarse),
        _ours("armcontour, joint limits only", arm, path, free),
    ]
    rounded = ac.round_corners(path, tolerance=ur5e.CORNER_ERROR)
    off = _off(rounded, arm.forward(first(_places(first.breaks))))
    notes = [f"Square: the plan leaves the rounded path by {off:.1e} m (bar: 1e-6 m)."]
    if off > 1e-6:
        raise AssertionError(notes[-1])
    ours = {
        "start given": partial(plan, arm, path, limits, start),
        f"start given, intervals={COARSE}": partial(plan, arm, path, limits, start, COARSE),
        "all configurations": partial(plan, arm, path, limits),
        "joint limits only, start given": partial(plan, arm, path, JOINTS, start),
    }
    python = os.environ.get(PYTHON)
    if python is None and find_spec("roboplan") is not None:
        python = sys.executable
    if python is None:
        notes.append(f"roboplan is left out: install it, or set {PYTHON} to a Python that has it.")
        return [], judged, notes
    with _peer(python, arm, start) as ask:
        settings = _settings(ask, arm)
        for name, (mode, options) in settings.items():
            judged.append(_theirs(ask, arm, path, name, mode, options))
        taken = _in_turn(ours, ask, list(settings))
    notes += [
        f"{name}: mode {mode}, " + (", ".join(f"{k}={v:.5g}" for k, v in options.items()) or "-")
        for name, (mode, options) in settings.items()
    ]
    pairs = [
        ("start given", "roboplan, TimeOptimal", "< 1"),
        ("start given", "roboplan, Bounded", "< 1"),
        (f"start given, intervals={COARSE}", "roboplan, TimeOptimal", "-"),
        ("start given", "roboplan, its own tolerance", "-"),
        ("all configurations", "roboplan, TimeOptimal", "-"),
        ("joint limits only, start given", "roboplan, joint limits only", "-"),
        ("start given", "roboplan, default", "-"),
    ]
    measured = [
        Measured(f"square, {name}", taken[name], peer, taken[peer], bar)
        for name, peer, bar in pairs
    ]
    return measured, judged, notes


def plan(
    arm: ac.SerialArm,
    path: ac.Path,
    limits: ac.Limits,
    start: FloatArray | None = None,
    intervals: int | None = None,
) -> ac.Trajectory:
    """Our plan, rounding included."""
    rounded = ac.round_corners(path, tolerance=ur5e.CORNER_ERROR)
    options = {} if intervals is None else {"intervals": intervals}
    return ac.plan(rounded, arm, limits, start=start, **options)


def _settings(ask: Ask, arm: ac.SerialArm) -> dict[str, tuple[str, dict[str, float]]]:
    """Modes and options by name."""
    low, high = 0.05, 0.5
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        _prepare(ask, "trial", "TimeOptimal", {**TIGHT, "velocity_scale": middle})
        _, q, dq, _ = _through(*_samples(ask, "trial"))
        fast = np.linalg.norm(arm.tool_velocity(q, dq), axis=1).max() > SLACK * SPEED
        low, high = (low, middle) if fast else (middle, high)
    return {
        "roboplan, TimeOptimal": ("TimeOptimal", {**TIGHT, "velocity_scale": low}),
        "roboplan, Bounded": ("Bounded", BOUNDED),
        "roboplan, its own tolerance": (
            "TimeOptimal",
            {**TIGHT, "max_position_error": ur5e.CORNER_ERROR, "velocity_scale": low},
        ),
        "roboplan, joint limits only": ("TimeOptimal", TIGHT),
        "roboplan, default": ("Bounded", {}),
        "roboplan, default TimeOptimal": ("TimeOptimal", {}),
    }


def _in_turn(ours: dict[str, Callable[[], object]], ask: Ask, peers: list[str]) -> dict[str, float]:
    """Median times, every round all of them."""
    taken: dict[str, list[float]] = {name: [] for name in [*ours, *peers]}
    for _ in range(ROUNDS):
        for name, call in ours.items():
            # What ran before has taken the caches.
            call()
            for _ in range(RUNS):
                begin = time.process_time()
                call()
                taken[name].append(time.process_time() - begin)
        for name in peers:
            taken[name] += ask("time", name=name, runs=RUNS)
    return {name: median(times) for name, times in taken.items()}


def _ours(who: str, arm: ac.SerialArm, path: ac.Path, planned: ac.Trajectory) -> Judged:
    law = planned.laws[0]
    i = np.repeat(np.arange(len(law.breaks) - 1), PLACES)
    t = _places(law.breaks)
    q, dq, ddq = (law.on_interval(i, t, order) for order in range(3))
    used = _used(dq, ddq)
    return _judged(who, arm, path, planned.duration, q, dq, used, used)


def _theirs(
    ask: Ask, arm: ac.SerialArm, path: ac.Path, who: str, mode: str, options: dict[str, float]
) -> Judged:
    _prepare(ask, "fine", mode, {**options, "dt": FINE})
    _, _, dq, ddq = _samples(ask, "fine")
    _prepare(ask, who, mode, options)
    samples = _samples(ask, who)
    _, q, rates, seconds = _through(*samples)
    duration = float(samples[0][-1])
    return _judged(who, arm, path, duration, q, rates, _used(dq, ddq), _used(rates, seconds))


def _judged(
    who: str,
    arm: ac.SerialArm,
    path: ac.Path,
    duration: float,
    q: FloatArray,
    dq: FloatArray,
    law: float,
    executed: float,
) -> Judged:
    tool = arm.forward(q)
    corner = max(np.linalg.norm(tool - x, axis=1).min() for x in ur5e.corners()[1:-1])
    speed = np.linalg.norm(arm.tool_velocity(q, dq), axis=1).max()
    return Judged(who, duration, float(corner), _off(path, tool), float(speed), law, executed)


def _used(dq: FloatArray, ddq: FloatArray) -> float:
    return float(max(np.abs(dq).max() / VELOCITY, np.abs(ddq).max() / ACCELERATION))


def _off(path: ac.Path, tool: FloatArray) -> float:
    return float(path.project(tool).distance.max())


def _places(t: FloatArray) -> FloatArray:
    share = np.linspace(0, 1, PLACES)
    return np.asarray((t[:-1, None] + share * np.diff(t)[:, None]).ravel())


def _through(
    t: FloatArray, q: FloatArray, dq: FloatArray, _: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cubics through samples and their velocities, and two derivatives of theirs."""
    from scipy.interpolate import CubicHermiteSpline

    spline = CubicHermiteSpline(t, q, dq)
    at = _places(t)
    return at, spline(at), spline(at, 1), spline(at, 2)


def _prepare(ask: Ask, name: str, mode: str, options: dict[str, float]) -> None:
    poses = np.zeros((5, 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = ur5e.DOWN, ur5e.corners(), 1
    ask("prepare", name=name, poses=poses.tolist(), mode=mode, options=options)


def _samples(ask: Ask, name: str) -> list[FloatArray]:
    """Times, positions, velocities and accelerations, without repeated times."""
    found = [np.array(x) for x in ask("answer", name=name)]
    fresh = np.append(True, np.diff(found[0]) > 1e-9)
    return [x[fresh] for x in found]


@contextmanager
def _peer(python: str, arm: ac.SerialArm, start: FloatArray) -> Iterator[Ask]:
    """A call that has roboplan's process do something."""
    with tempfile.TemporaryDirectory() as folder:
        urdf, limits = Path(folder) / "arm.urdf", Path(folder) / "limits.yaml"
        urdf.write_text(ur5e.urdf(arm, VELOCITY))
        rows = [f"  {x}:\n    max_acceleration: [{ACCELERATION}]\n" for x in arm.joint_names]
        limits.write_text("joint_limits:\n" + "".join(rows))
        pipe = subprocess.PIPE
        with subprocess.Popen(
            [python, PROGRAM], stdin=pipe, stdout=pipe, text=True, bufsize=1
        ) as process:
            assert process.stdin is not None and process.stdout is not None

            def ask(what: str, **arguments: Any) -> Any:
                process.stdin.write(json.dumps([what, arguments]) + "\n")
                process.stdin.flush()
                found, error = json.loads(process.stdout.readline())
                if error is not None:
                    raise RuntimeError(f"roboplan: {error}")
                return found

            files = {"urdf": str(urdf), "limits": str(limits)}
            ask("arm", **files, base=ur5e.BASE, tool=ur5e.TOOL, start=start.tolist())
            yield ask
            process.stdin.close()
