"""Plan a square of 100 mm at 0.25 m/s with corner errors of 0.25 mm, against roboplan.

A UR5e holds its tool in one way, and starts and ends at rest on a corner. Joint velocity limits,
joint acceleration limits and start are the same for both. Our time includes rounded corners,
inverse kinematics and timing. roboplan's planner is created before it is timed. Times are processor
times, because plans are as short as the time slices of a busy machine. roboplan runs in its own
process, with this Python or, because it requires one version of pinocchio, with the Python in
ARMCONTOUR_ROBOPLAN_PYTHON:

    python -m venv roboplan && roboplan/bin/pip install roboplan
    ARMCONTOUR_ROBOPLAN_PYTHON=roboplan/bin/python python -m benchmarks

Its settings are the fastest that keep the corner error, from a sweep over `max_position_error`,
`toppra_blend_deviation`, `dt`, both modes, and corners or rounded path as waypoints. The weights of
its inverse kinematics made no difference. The corner error is measured, because a plan may keep
more than it promises; another line sets its own tolerance to 0.25 mm. Its mode Bounded slows the
whole motion down until the tool is slow enough at its fastest point. Its mode TimeOptimal does not
know the tool speed, so `velocity_scale` is bisected until the tool keeps it; this is not timed.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from benchmarks import torque, ur5e
from benchmarks.measured import Bar, Line, Missing, Pair, Taken, timed

PYTHON = "ARMCONTOUR_ROBOPLAN_PYTHON"
PROGRAM = Path(__file__).with_name("roboplan_peer.py")
VELOCITY = 3.14  # rad/s, limit of every joint
ACCELERATION = 8.0  # rad/s², limit of every joint
SPEED = 0.25  # m/s, limit of the tool
JOINTS = ac.Limits.only(joint_velocity=VELOCITY, joint_acceleration=ACCELERATION)
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

OURS = {
    "start": "start given",
    "configurations": "all configurations",
    "joints": "joint limits only, start given",
}
TORQUE = "square, the arm's torque limits"
# A plan may leave the rounded path by this much [m].
OFF = 1e-6


def lines() -> list[Line]:
    """Return the lines against roboplan, and with torque limits against toppra."""
    pairs = [
        # Rounding, inverse kinematics and the plan on 4,000 intervals take about a third each.
        ("start", "roboplan, TimeOptimal", Bar(ratio=0.9)),
        ("start", "roboplan, Bounded", Bar(ratio=1)),
        ("start", "roboplan, its own tolerance", Bar()),
        ("configurations", "roboplan, TimeOptimal", Bar()),
        ("joints", "roboplan, joint limits only", Bar()),
        ("start", "roboplan, default TimeOptimal", Bar()),
    ]
    entries = [
        Line(
            f"square/{ours}/{peer.removeprefix('roboplan, ').replace(' ', '-')}",
            f"square, {OURS[ours]}",
            peer,
            partial(_pair, ours, peer),
            bar,
        )
        for ours, peer, bar in pairs
    ]
    peer = f"toppra and RNEA, {torque.POINTS} points"
    return [
        *entries,
        Line("torque/square/start", TORQUE, peer, partial(_torque, True), Bar(ratio=0.47)),
        Line(
            "torque/square/configurations",
            f"{TORQUE}, all configurations",
            peer,
            partial(_torque, False),
            Bar(ratio=1.4),
        ),
    ]


def _pair(ours: str, peer: str) -> Pair:
    arm = ur5e.load()
    path = ur5e.square()
    limits = JOINTS if ours == "joints" else JOINTS.replace(speed=SPEED)
    start = plan(arm, path, JOINTS.replace(speed=SPEED))(0.0)
    posture = None if ours == "configurations" else start
    call = partial(plan, arm, path, limits, posture)
    ask = _roboplan()
    mode, options = _settings()[peer]
    _prepare(ask, peer, mode, options)

    def theirs(times: int) -> list[Taken]:
        return [Taken(x, x) for x in ask("time", name=peer, runs=times)]

    def notes() -> list[str]:
        trajectory = call()
        rounded = ac.round_corners(path, tolerance=ur5e.CORNER_ERROR)
        error = _off(rounded, arm.tool_position(trajectory(_places(trajectory.breaks))))
        if error > OFF:
            raise AssertionError(f"The plan leaves the rounded path by {error:.1e} m.")
        values = ", ".join(f"{k}={v:.5g}" for k, v in options.items()) or "its defaults"
        return [
            f"{_ours('armcontour', arm, path, trajectory)}; {error:.1e} m off the rounded path",
            f"{_theirs(ask, arm, path, peer, mode, options)} ({mode}, {values})",
        ]

    return Pair(timed(call), theirs, notes)


def _torque(fixed_start: bool) -> Pair:
    """Compare with toppra on our joint path, with the arm's own limits and the tool's speed."""
    arm = ur5e.load()
    path = ur5e.square()
    limits = arm.limits.replace(speed=SPEED)
    first = plan(arm, path, limits)
    start = first(0.0)
    rounded = ac.round_corners(path, tolerance=ur5e.CORNER_ERROR)
    traced = ac.trace(rounded, arm, seed=start)
    s = np.linspace(0, traced.length, torque.PLACES)
    solve = torque.toppra_planner(arm, arm.limits, s / traced.length, traced(s))

    def notes() -> list[str]:
        return [f"{first.duration:.4f} s; toppra, joint limits only: {solve():.4f} s"]

    call = partial(plan, arm, path, limits, start if fixed_start else None)
    return Pair(timed(call), timed(solve), notes)


def plan(
    arm: ac.SerialArm,
    path: ac.Path,
    limits: ac.Limits,
    start: FloatArray | None = None,
) -> ac.Trajectory:
    """Plan the square; rounding is included."""
    rounded = ac.round_corners(path, tolerance=ur5e.CORNER_ERROR)
    return ac.plan(rounded, arm, limits, ac.Optimal(seed=start))


@cache
def _settings() -> dict[str, tuple[str, dict[str, float]]]:
    """Return roboplan's modes and options by name."""
    ask = _roboplan()
    arm = ur5e.load()
    low, high = 0.05, 0.5
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        _prepare(ask, "trial", "TimeOptimal", {**TIGHT, "velocity_scale": middle})
        curve = _interpolate(_samples(ask, "trial"))
        fast = np.linalg.norm(arm.tool_velocity(curve.q, curve.dq), axis=1).max() > SLACK * SPEED
        low, high = (low, middle) if fast else (middle, high)
    return {
        "roboplan, TimeOptimal": ("TimeOptimal", {**TIGHT, "velocity_scale": low}),
        "roboplan, Bounded": ("Bounded", BOUNDED),
        "roboplan, its own tolerance": (
            "TimeOptimal",
            {**TIGHT, "max_position_error": ur5e.CORNER_ERROR, "velocity_scale": low},
        ),
        "roboplan, joint limits only": ("TimeOptimal", TIGHT),
        "roboplan, default TimeOptimal": ("TimeOptimal", {}),
    }


def _ours(who: str, arm: ac.SerialArm, path: ac.Path, planned: ac.Trajectory) -> str:
    law = planned.laws[0]
    i = np.repeat(np.arange(len(law.breaks) - 1), PLACES)
    t = _places(law.breaks)
    q, dq, ddq = (law.on_interval(i, t, order) for order in range(3))
    used = _used(dq, ddq)
    return _judged(who, arm, path, planned.duration, q, dq, used, used)


def _theirs(
    ask: Ask, arm: ac.SerialArm, path: ac.Path, who: str, mode: str, options: dict[str, float]
) -> str:
    _prepare(ask, "fine", mode, {**options, "dt": FINE})
    law = _samples(ask, "fine")
    _prepare(ask, who, mode, options)
    samples = _samples(ask, who)
    curve = _interpolate(samples)
    duration = float(samples.t[-1])
    used = _used(law.dq, law.ddq)
    executed = _used(curve.dq, curve.ddq)
    return _judged(who, arm, path, duration, curve.q, curve.dq, used, executed)


def _judged(
    who: str,
    arm: ac.SerialArm,
    path: ac.Path,
    duration: float,
    q: FloatArray,
    dq: FloatArray,
    law: float,
    executed: float,
) -> str:
    """Describe a plan in words, with the largest shares of the joints' limits.

    `law` is that of the law itself, `executed` that of the cubics through its samples; ours is
    executed as it is.
    """
    tool = arm.tool_position(q)
    corner = max(np.linalg.norm(tool - x, axis=1).min() for x in ur5e.corners()[1:-1])
    speed = np.linalg.norm(arm.tool_velocity(q, dq), axis=1).max()
    lengths = f"corner error {corner * 1e3:.3f} mm, off the square {_off(path, tool) * 1e3:.3f} mm"
    shares = f"joint limits used {law:.3f}, through its samples {executed:.3f}"
    return f"{who}: {duration:.4f} s, {lengths}, {speed:.4f} m/s, {shares}"


def _used(dq: FloatArray, ddq: FloatArray) -> float:
    return float(max(np.abs(dq).max() / VELOCITY, np.abs(ddq).max() / ACCELERATION))


def _off(path: ac.Path, tool: FloatArray) -> float:
    return float(path.project(tool).distance.max())


def _places(t: FloatArray) -> FloatArray:
    share = np.linspace(0, 1, PLACES)
    return np.asarray((t[:-1, None] + share * np.diff(t)[:, None]).ravel())


class Samples(NamedTuple):
    """Times [s], (n,), joint positions, velocities and accelerations, (n, dof) each."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


def _interpolate(samples: Samples) -> Samples:
    """Sample the cubics through positions and velocities densely, with two derivatives."""
    from scipy.interpolate import CubicHermiteSpline

    spline = CubicHermiteSpline(samples.t, samples.q, samples.dq)
    t = _places(samples.t)
    return Samples(t, spline(t), spline(t, 1), spline(t, 2))


def _prepare(ask: Ask, name: str, mode: str, options: dict[str, float]) -> None:
    poses = np.zeros((5, 4, 4))
    poses[:, :3, :3] = ur5e.DOWN
    poses[:, :3, 3] = ur5e.corners()
    poses[:, 3, 3] = 1
    ask("prepare", name=name, poses=poses.tolist(), mode=mode, options=options)


def _samples(ask: Ask, name: str) -> Samples:
    """Ask for a plan's samples; repeated times are removed."""
    columns = [np.array(x) for x in ask("answer", name=name)]
    fresh = np.append(True, np.diff(columns[0]) > 1e-9)
    return Samples(*(x[fresh] for x in columns))


@cache
def _roboplan() -> Ask:
    """Return a call that sends requests to roboplan's process, which ends with this one."""
    python = os.environ.get(PYTHON)
    if python is None and find_spec("roboplan") is not None:
        python = sys.executable
    if python is None:
        raise Missing(f"roboplan is not installed, and {PYTHON} names no Python that has it")
    arm = ur5e.load()
    start = plan(arm, ur5e.square(), JOINTS.replace(speed=SPEED))(0.0)
    resources = ExitStack()
    atexit.register(resources.close)
    folder = Path(resources.enter_context(tempfile.TemporaryDirectory()))
    urdf = folder / "arm.urdf"
    limits = folder / "limits.yaml"
    urdf.write_text(ur5e.urdf(arm, VELOCITY))
    rows = [f"  {x}:\n    max_acceleration: [{ACCELERATION}]\n" for x in arm.joint_names]
    limits.write_text("joint_limits:\n" + "".join(rows))
    pipe = subprocess.PIPE
    process = subprocess.Popen([python, PROGRAM], stdin=pipe, stdout=pipe, text=True, bufsize=1)
    # Leaving it closes its input, which ends it.
    resources.enter_context(process)

    def ask(method: str, **arguments: Any) -> Any:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(json.dumps([method, arguments]) + "\n")
        process.stdin.flush()
        answer, error = json.loads(process.stdout.readline())
        if error is not None:
            raise RuntimeError(f"roboplan: {error}")
        return answer

    files = {"urdf": str(urdf), "limits": str(limits)}
    ask("arm", **files, base=ur5e.BASE, tool=ur5e.TOOL, start=start.tolist())
    return ask
