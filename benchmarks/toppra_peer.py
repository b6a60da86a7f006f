"""Call TOPP-RA in Python and C++: cubic spline, limits of velocity and acceleration.

The peers use their best options: Seidel's solver, the interpolation scheme, and a constant path
acceleration in every interval.
"""

from __future__ import annotations

import shutil
import subprocess
import sysconfig
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measured import Missing

SOURCE = Path(__file__).with_name("toppra_peer.cpp")


class Problem(NamedTuple):
    """A natural cubic spline with limits, and the grid on which it is planned."""

    at: np.ndarray  # Parameters of the waypoints, (n,)
    way: np.ndarray  # Waypoints [rad], (n, dof)
    velocity: np.ndarray  # Lower and upper bounds [rad/s], (dof, 2)
    acceleration: np.ndarray  # Lower and upper bounds [rad/s²], (dof, 2)
    grid: np.ndarray  # Parameters of the grid points, (points,)


class CppSolution(NamedTuple):
    """Answer of the C++ library."""

    taken: list[float]  # Processor time of every run [s]
    duration: float  # Duration of the motion [s]
    squares: np.ndarray  # ds² at the grid points, (points,)


def require_python() -> None:
    """Raise `Missing` without toppra."""
    if find_spec("toppra") is None:
        raise Missing("toppra is not installed, which has wheels for linux-x86_64")


def solve_in_python(problem: Problem) -> Any:
    """Return the trajectory of toppra."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        DiscretizationType,
        JointAccelerationConstraint,
        JointVelocityConstraint,
    )

    toppra.setup_logging("CRITICAL")
    path = toppra.SplineInterpolator(problem.at, problem.way, bc_type="natural")
    velocity = JointVelocityConstraint(problem.velocity)
    acceleration = JointAccelerationConstraint(
        problem.acceleration, DiscretizationType.Interpolation
    )
    return TOPPRA(
        [velocity, acceleration],
        path,
        gridpoints=problem.grid,
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    ).compute_trajectory(0, 0)


def solve_in_cpp(problem: Problem, runs: int) -> CppSolution:
    """Solve a problem so many times in a process of the C++ library.

    Raises:
        Missing: The compiler or the library is missing.
    """
    program, _ = _program()
    waypoints, joints = problem.way.shape
    arrays = [problem.at, problem.way, *problem.velocity.T, *problem.acceleration.T, problem.grid]
    numbers = np.concatenate([np.ravel(x) for x in arrays])
    rows = "\n".join(repr(float(x)) for x in numbers)
    text = f"{joints} {waypoints} {len(problem.grid)} {runs}\n{rows}"
    outcome = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    head, *rest = outcome.stdout.splitlines()
    duration, *taken = (float(x) for x in head.split())
    return CppSolution(taken, duration, np.array([float(x) for x in rest]))


@cache
def _program() -> tuple[Path, tempfile.TemporaryDirectory[str]]:
    """Compile the C++ program; return it and its folder, which lasts as long as this process."""
    compiler = shutil.which("g++")
    prefix = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix"
    eigens = [prefix / "include" / "eigen3", Path("/usr/include/eigen3")]
    eigen = next((x for x in eigens if x.is_dir()), None)
    if compiler is None:
        raise Missing("there is no g++")
    if not (prefix / "include" / "toppra").is_dir():
        raise Missing("cmeel-toppra is not installed")
    if eigen is None:
        raise Missing("cmeel-eigen is not installed, and TOPP-RA's headers need Eigen")
    folder = tempfile.TemporaryDirectory()
    program = Path(folder.name) / "toppra_peer"
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
    if built.returncode != 0:
        raise Missing(f"TOPP-RA's C++ library was not built: {built.stderr.splitlines()[0]}")
    return program, folder
