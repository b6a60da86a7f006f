"""The optimal planner against TOPP-RA in Python and C++: time, duration, largest violation.

All plan six joints with velocity and acceleration limits on the same number of grid points. We time
public calls as in the documentation, with all checks and new arrays. Every time includes the
spline, the constraints, the solution and the law. The peers use their best options: Seidel's
solver, the interpolation scheme, a constant path acceleration in every interval, and a path
parameter from 0 to 1.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

import armcontour as ac
from benchmarks.measured import Bar, Line, Pair, Taken, timed
from benchmarks.toppra_peer import Problem, require_python, solve_in_cpp, solve_in_python

# Joints of the spline.
JOINTS = 6
# Waypoints of the spline.
WAYPOINTS = 5
# Numbers of grid points in plans that are compared with the peers' plans.
POINTS = (50, 200, 1000, 10_000)
# The same waypoints and limits for every grid, drawn in this order; the limits bind on every joint
# somewhere.
RNG = np.random.default_rng(1)
WAY = RNG.uniform(-2, 2, (WAYPOINTS, JOINTS))  # rad
VELOCITY = RNG.uniform(1, 3, JOINTS)  # rad/s
ACCELERATION = RNG.uniform(1, 5, JOINTS)  # rad/s²
# Parameters from 0 to 1 on which every uniform grid above has a point.
AT = np.linspace(0, 1, WAYPOINTS)
# Bars of the ratio, by the number of points.
CPP_BARS = {50: 4.0, 200: 0.75, 1000: 0.36, 10_000: 0.25}
PYTHON_BARS = {1000: 1 / 40}
# Grid points of the two plans whose times per grid point are compared.
SMALL = 10_000
LARGE = 1_000_000
# Grids on which memory is measured.
GRIDS = (10_000, 100_000, 1_000_000)
# The peak since exec, unlike getrusage's, is not the parent's.
MEMORY = """
from benchmarks import optimal
optimal.plan(1000)
peak = lambda: int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
before = peak()
planned = optimal.plan({points})
print((peak() - before) * 1024 / {points})
"""
# Places per grid interval at which a law is judged.
PLACES = 20


def lines() -> list[Line]:
    """Return the lines for both peers on every grid, and for a large against a small grid."""
    rows: list[tuple[str, str, Callable[[int], Pair], dict[int, float]]] = [
        ("toppra", "toppra (Seidel)", _against_python, PYTHON_BARS),
        ("cpp", "TOPP-RA C++ (Seidel)", _against_cpp, CPP_BARS),
    ]
    entries = []
    for name, peer, against, bars in rows:
        for points in POINTS:
            title = f"optimal plan, {points} points"
            bar = Bar(ratio=bars.get(points))
            entries.append(
                Line(f"plan/{name}/{points}", title, peer, partial(against, points), bar)
            )
    title = f"optimal plan, a grid point of {LARGE:,}"
    return [*entries, Line("plan/grid", title, f"one of {SMALL:,}", _scaling, Bar(ratio=1.5))]


def plan(points: int) -> ac.Trajectory:
    """Plan on a number of grid points; the spline is included in the time."""
    path = ac.JointPath.spline(WAY.copy(), AT.copy())
    limits = ac.Limits(joint_velocity=VELOCITY.copy(), joint_acceleration=ACCELERATION.copy())
    return ac.plan(path, limits=limits, options=ac.Optimal(intervals=points - 1))


def _against_python(points: int) -> Pair:
    require_python()
    problem = _problem(points)

    def notes() -> list[str]:
        law = solve_in_python(problem)
        t = np.linspace(0, law.duration, PLACES * points)
        used = max((abs(law(t, 1)) / VELOCITY).max(), (abs(law(t, 2)) / ACCELERATION).max())
        return [_answer("armcontour", _ours(points)), _said("toppra", law.duration, used)]

    return Pair(timed(lambda: plan(points)), timed(lambda: solve_in_python(problem)), notes)


def _problem(points: int) -> Problem:
    """Return the problem of the peers."""
    velocity = np.column_stack([-VELOCITY, VELOCITY])
    acceleration = np.column_stack([-ACCELERATION, ACCELERATION])
    return Problem(AT, WAY, velocity, acceleration, np.linspace(0, 1, points))


def _against_cpp(points: int) -> Pair:
    problem = _problem(points)
    solve_in_cpp(problem, 1)

    def theirs(times: int) -> list[Taken]:
        # Runs are timed inside the program's process.
        return [Taken(x, x) for x in solve_in_cpp(problem, times).taken]

    def notes() -> list[str]:
        _, duration, squares = solve_in_cpp(problem, 1)
        solution = Solution(duration, problem.grid, squares, np.zeros(points - 1))
        return [_answer("armcontour", _ours(points)), _answer("TOPP-RA C++", solution)]

    return Pair(timed(lambda: plan(points)), theirs, notes)


class Solution(NamedTuple):
    """A timing whose path acceleration is linear in s between grid points.

    Args:
        duration: Duration [s].
        grid: Path parameters s, (n,).
        squares: ds² at these, (n,).
        slope: Slopes of dds over s in the intervals, (n - 1,); 0 for constant accelerations.
    """

    duration: float
    grid: np.ndarray
    squares: np.ndarray
    slope: np.ndarray


def _ours(points: int) -> Solution:
    planned = plan(points)
    law = planned.laws[0]
    return Solution(planned.duration, law.s, law.speeds**2, law.rates.slope)


def _answer(who: str, solution: Solution) -> str:
    """State the duration and the largest violation of a solution."""
    duration, grid, squares, slope = solution
    path = ac.JointPath.spline(WAY, AT)
    width = np.diff(grid)
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
    return _said(who, duration, used)


def _said(who: str, duration: float, used: float) -> str:
    over = max(float(used) - 1, 0.0)
    return f"{who}: {duration:.6f} s, largest violation {over:.1e}"


def _scaling() -> Pair:
    """Time per grid point at a million points against that at ten thousand."""
    ours = timed(lambda: plan(LARGE))
    peer = timed(lambda: plan(SMALL))
    return Pair(ours, peer, memory, parts=(LARGE, SMALL))


def memory() -> list[str]:
    """Return the growth of peak memory per grid point, each in its own process."""
    peaks = []
    for points in GRIDS:
        code = MEMORY.format(points=points)
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        peaks.append(f"{float(run.stdout):,.0f} at {points:,}")
    return [f"peak memory, bytes a grid point: {', '.join(peaks)}"]
