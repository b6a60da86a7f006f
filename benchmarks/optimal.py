"""The optimal planner against TOPP-RA, in Python and in C++: time, duration, largest violation.

Six joints, limits of joint velocity and acceleration, the same grid for all. Every time includes
the spline, the constraints, the solution and the law. The peers use what is best in them: Seidel's
solver, the interpolation scheme, a path acceleration that is uniform on every interval, and a path
parameter from 0 to 1.
"""

from __future__ import annotations

import shutil
import subprocess
import sysconfig
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from types import SimpleNamespace

import numpy as np

import armcontour as ac
from benchmarks.measured import Measured, paired

JOINTS, WAYPOINTS = 6, 5
POINTS = (200, 1000, 5000)
SOURCE = Path(__file__).with_name("toppra_peer.cpp")
# The same waypoints for every grid; the limits bind on every joint somewhere.
RNG = np.random.default_rng(1)
WAY = RNG.uniform(-2, 2, (WAYPOINTS, JOINTS))
VELOCITY, ACCELERATION = RNG.uniform(1, 3, JOINTS), RNG.uniform(1, 5, JOINTS)
# Parameters from 0 to 1 on which every uniform grid above has a point.
AT = np.linspace(0, 1, WAYPOINTS)
# Places per grid interval at which a law is judged.
PLACES = 20


@dataclass(frozen=True)
class Judged:
    """One planner's answer: the duration [s] and the largest share over a limit, 0 for none."""

    points: int
    who: str
    duration: float
    violation: float


def measure() -> tuple[list[Measured], list[Judged], list[str]]:
    """Times, answers, and notes on what could not be measured."""
    measured, judged, notes = [], [], []
    peers: list[tuple[str, Callable[[int], tuple[Measured, list[Judged]]]]] = []
    try:
        import toppra  # noqa: F401

        peers.append(("toppra", _against_python))
    except ImportError:
        notes.append("toppra is not installed: python -m pip install toppra (linux-x86_64).")
    with tempfile.TemporaryDirectory() as folder:
        program, reason = _build(Path(folder))
        if program is None:
            notes.append(f"TOPP-RA's C++ library is left out: {reason}.")
        else:
            peers.append(("TOPP-RA C++", lambda n: _against_cpp(n, program)))
        for points in POINTS:
            judged.append(_judge(points, "armcontour", *_ours(points)))
            for _, against in peers:
                found, answer = against(points)
                measured.append(found)
                judged += answer
    measured.append(_scaling())
    return measured, judged, notes


def plan(points: int) -> ac.Trajectory:
    """Our plan, spline included."""
    limits = ac.Limits(joint_velocity=VELOCITY, joint_acceleration=ACCELERATION)
    arm = SimpleNamespace(dof=JOINTS, limits=limits)
    return ac.plan(ac.JointPath.spline(WAY, AT), arm, grid=np.linspace(0, 1, points))


def _against_python(points: int) -> tuple[Measured, list[Judged]]:
    ours, peer = paired(lambda: plan(points), lambda: _python(points), 31 if points < 5000 else 15)
    law = _python(points)
    t = np.linspace(0, law.duration, PLACES * points)
    used = max((abs(law(t, 1)) / VELOCITY).max(), (abs(law(t, 2)) / ACCELERATION).max())
    answer = Judged(points, "toppra", float(law.duration), max(float(used) - 1, 0.0))
    what = f"optimal plan, {points} points"
    return Measured(what, ours, "toppra (Seidel)", peer, "< 0.025" if points >= 1000 else "-"), [
        answer
    ]


def _python(points: int):  # noqa: ANN202  # toppra has no types
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        DiscretizationType,
        JointAccelerationConstraint,
        JointVelocityConstraint,
    )

    toppra.setup_logging("CRITICAL")
    path = toppra.SplineInterpolator(AT, WAY, bc_type="natural")
    velocity = JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY]))
    acceleration = JointAccelerationConstraint(
        np.column_stack([-ACCELERATION, ACCELERATION]), DiscretizationType.Interpolation
    )
    return TOPPRA(
        [velocity, acceleration],
        path,
        gridpoints=np.linspace(0, 1, points),
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    ).compute_trajectory(0, 0)


def _build(folder: Path) -> tuple[Path | None, str]:
    """The C++ program, or why there is none."""
    compiler = shutil.which("g++")
    prefix = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix"
    eigens = [prefix / "include" / "eigen3", Path("/usr/include/eigen3")]
    eigen = next((x for x in eigens if x.is_dir()), None)
    if compiler is None:
        return None, "there is no g++"
    if not (prefix / "include" / "toppra").is_dir():
        return None, "python -m pip install cmeel-toppra brings it"
    if eigen is None:
        return None, "its headers need Eigen: python -m pip install cmeel-eigen"
    program = folder / "toppra_peer"
    built = subprocess.run(
        [
            compiler,
            "-O3",
            "-DNDEBUG",
            "-std=c++17",
            f"-I{prefix / 'include'}",
            f"-I{eigen}",
            str(SOURCE),
            "-o",
            str(program),
            f"-L{prefix / 'lib'}",
            "-ltoppra",
            f"-Wl,-rpath,{prefix / 'lib'}",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    return (program, "") if built.returncode == 0 else (None, built.stderr.splitlines()[0])


def _against_cpp(points: int, program: Path) -> tuple[Measured, list[Judged]]:
    """In turns: a few runs of ours, a few of theirs, timed inside their process."""
    grid = np.linspace(0, 1, points)
    numbers = [AT, WAY, VELOCITY, ACCELERATION, grid]
    ours, peer, duration, squares = [], [], 0.0, np.zeros(0)
    plan(points)
    for _ in range(7):
        for _ in range(7):
            start = time.perf_counter()
            plan(points)
            ours.append(time.perf_counter() - start)
        text = f"{JOINTS} {WAYPOINTS} {points} 7\n" + "\n".join(
            repr(float(x)) for values in numbers for x in np.ravel(values)
        )
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        head, *rest = done.stdout.splitlines()
        taken, length = (float(x) for x in head.split())
        peer.append(taken)
        duration, squares = length, np.array([float(x) for x in rest])
    bar = "< 0.33" if points >= 1000 else "-"
    what = f"optimal plan, {points} points"
    found = Measured(what, median(ours), "TOPP-RA C++ (Seidel)", median(peer), bar)
    return found, [_judge(points, "TOPP-RA C++", duration, grid, squares, None)]


def _ours(points: int) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    planned = plan(points)
    law = planned.laws[0]
    # The slopes between grid points only the law knows.
    return planned.duration, law.s, law.speeds**2, law.rates.slope


def _judge(
    points: int,
    who: str,
    duration: float,
    grid: np.ndarray,
    squares: np.ndarray,
    skew: np.ndarray | None,
) -> Judged:
    """Judge ds² on a grid, with a path acceleration linear in s between its points."""
    path = ac.JointPath.spline(WAY, AT)
    width, slope = np.diff(grid), np.zeros(len(grid) - 1) if skew is None else skew
    share = np.linspace(0, 1, PLACES)
    s = grid[:-1, None] + share * width[:, None]
    u = np.diff(squares) / (2 * width) - slope * width / 2
    u = u[:, None] + slope[:, None] * share * width[:, None]
    x = squares[:-1, None] + share * width[:, None] * (u[:, :1] + u)
    piece = np.repeat(path.locate((grid[:-1] + grid[1:]) / 2), PLACES)
    first, second = (path.on_interval(piece, s.ravel(), order) for order in (1, 2))
    velocity = abs(first) * np.sqrt(np.maximum(x.ravel(), 0.0))[:, None] / VELOCITY
    acceleration = abs(first * u.ravel()[:, None] + second * x.ravel()[:, None]) / ACCELERATION
    used = float(max(velocity.max(), acceleration.max()))
    return Judged(points, who, duration, max(used - 1, 0.0))


def _scaling() -> Measured:
    """Time per grid point at a million points against that at ten thousand."""
    small, large = 10_000, 1_000_000
    many, one = paired(lambda: plan(large), lambda: [plan(small) for _ in range(10)], 5)
    return Measured(
        "optimal plan, a grid point of 1,000,000",
        many / large,
        "one of 10,000",
        one / small / 10,
        "< 1.5",
    )
