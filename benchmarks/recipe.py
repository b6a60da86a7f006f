"""Plan the recipe of copp's own benchmark: paths of seven joints through 50 random points.

Every path has its own limits, near 1 rad/s, 5 rad/s² and 50 rad/s³. The peers get the same cubic
splines and limits, without the limits of jerk. Times are the means of all paths, and include making
the path and the limits, except with roboplan.

What limits us: copp-py limits the accelerations at its stations only, and exceeds them between; our
plans satisfy all limits everywhere. The margins for that would cost 1 % of the duration on 1,000
intervals, so a second plan on about 3,500 intervals follows, which is faster than copp-py's motion.
With limits of jerk, half of the time is spent in the iterations of the interior-point method. The
rows of its 1,300 cells take 5 MB, which do not fit into the fast caches.
"""

from __future__ import annotations

import tempfile
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import armcontour as ac
from benchmarks import reference, toppra_peer
from benchmarks.measured import Bar, Line, Missing, Pair, Taken, timed

# Paths, joints, and points of each path.
PATHS = 13
JOINTS = 7
POINTS = 50
# Stations of the peers, and grid points of the plan that is compared with theirs.
STATIONS = 1000
# Limits of every joint: these values times factors from 0.9 to 1.1.
VELOCITY = 1.0  # rad/s
ACCELERATION = 5.0  # rad/s²
JERK = 50.0  # rad/s³
SEED = 20260414
AT = np.linspace(0.0, 1.0, POINTS)
# Times at which a plan is compared with its limits.
PLACES = 20_000
# roboplan samples its plan once per this time [s], so that few samples are counted.
SAMPLE_TIME = 1.0
# A joint of roboplan's arm, which has no geometry.
JOINT = """
<link name="link{k}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint{k}" type="revolute"><parent link="link{before}"/><child link="link{k}"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="{velocity!r}" effort="1"/></joint>
"""


class Problem(NamedTuple):
    """Points of a path, and its limits in both directions."""

    points: np.ndarray  # rad, (POINTS, JOINTS)
    velocity: np.ndarray  # Lower and upper bounds [rad/s], (JOINTS, 2)
    acceleration: np.ndarray  # Lower and upper bounds [rad/s²], (JOINTS, 2)
    jerk: np.ndarray  # rad/s³, (JOINTS,)


def lines() -> list[Line]:
    """Return the lines against the peers, by default, and with limits of jerk."""
    title = f"{PATHS} paths of {JOINTS} joints through {POINTS} points"
    stations = f"{title}, {STATIONS} stations"
    return [
        Line("recipe/copp", stations, "copp-py", _against_copp, Bar(ratio=1.2)),
        Line("recipe/cpp", stations, "TOPP-RA C++ (Seidel)", _against_cpp),
        Line("recipe/toppra", stations, "toppra (Seidel)", _against_toppra),
        Line("recipe/roboplan", stations, "roboplan (TOPP-RA)", _against_roboplan),
        Line("recipe/default", f"{title}, default", reference.NAME, _default, Bar(seconds=6.5e-3)),
        Line("recipe/jerk", f"{title}, jerk", reference.NAME, _with_jerk, Bar(seconds=18e-3)),
    ]


def problems() -> list[Problem]:
    """Draw the problems, as the recipe does."""
    rng = np.random.default_rng(SEED)

    def bounds(value: float) -> np.ndarray:
        low = -value * rng.uniform(0.9, 1.1, JOINTS)
        return np.column_stack([low, value * rng.uniform(0.9, 1.1, JOINTS)])

    drawn = []
    for _ in range(PATHS):
        points = rng.uniform(-0.5, 0.5, (POINTS, JOINTS))
        velocity = bounds(VELOCITY)
        acceleration = bounds(ACCELERATION)
        drawn.append(Problem(points, velocity, acceleration, bounds(JERK)[:, 1]))
    return drawn


def plan_all(intervals: int | None = None, *, jerk: bool = False) -> list[ac.Trajectory]:
    """Plan all paths; making paths and limits is included in the time."""
    plans = []
    for x in problems():
        limits = ac.Limits(
            joint_velocity=x.velocity,
            joint_acceleration=x.acceleration,
            joint_jerk=x.jerk if jerk else None,
        )
        path = ac.JointPath.spline(x.points, AT)
        plans.append(ac.plan(path, limits=limits, options=ac.Optimal(intervals=intervals)))
    return plans


def _copp_all(slopes: list[np.ndarray]) -> list[float]:
    """Plan all paths with copp-py; return the durations [s].

    `slopes` are the derivatives of the splines at both ends, per point, (2, JOINTS) each.
    """
    import copp_py as copp

    s = np.linspace(0.0, 1.0, STATIONS)
    durations = []
    for k, x in enumerate(problems()):
        # The same natural spline has these slopes at its ends, per point.
        ends = slopes[k]
        config = copp.SplineConfig(order=3, start_state=ends[:1].T, end_state=ends[1:].T)
        path = copp.Path.from_waypoints_interpolating(x.points, config)
        robot = copp.Robot(JOINTS, capacity=STATIONS)
        robot.append_s(s)
        robot.set_q_from_path_2nd(path, 0, STATIONS)
        for add, (low, high) in (
            (robot.add_velocity_limits, x.velocity.T),
            (robot.add_acceleration_limits, x.acceleration.T),
        ):
            upper = np.ascontiguousarray(high)
            add(upper, np.ascontiguousarray(low), start_idx_s=0, length=STATIONS)
        problem = copp.solver.topp2_ra.Problem(
            robot.constraints, idx_s_interval=(0, STATIONS - 1), a_boundary=(0.0, 0.0)
        )
        squares = copp.solver.topp2_ra.solve(problem, copp.solver.topp2_ra.Options())
        duration, _ = copp.interpolation.s_to_t_topp2(s, squares, 0.0)
        durations.append(float(duration))
    return durations


def _toppra_problems() -> list[toppra_peer.Problem]:
    """Return the problems for TOPP-RA."""
    grid = np.linspace(0.0, 1.0, STATIONS)
    return [toppra_peer.Problem(AT, x.points, x.velocity, x.acceleration, grid) for x in problems()]


def _toppra_all() -> list[float]:
    """Plan all paths with toppra; return the durations [s]."""
    return [float(toppra_peer.solve_in_python(x).duration) for x in _toppra_problems()]


def _against_copp() -> Pair:
    if find_spec("copp_py") is None:
        raise Missing("copp-py is not installed")
    ends = [ac.JointPath.spline(x.points, AT)([0.0, 1.0], 1) for x in problems()]
    slopes = [np.ascontiguousarray(x) / (POINTS - 1) for x in ends]
    theirs = partial(_copp_all, slopes)
    ours = timed(lambda: plan_all(STATIONS - 1))
    notes = partial(_notes, "copp-py", theirs)
    return Pair(ours, timed(theirs), notes, parts=(PATHS, PATHS))


def _against_toppra() -> Pair:
    toppra_peer.require_python()
    ours = timed(lambda: plan_all(STATIONS - 1))
    notes = partial(_notes, "toppra", _toppra_all)
    return Pair(ours, timed(_toppra_all), notes, parts=(PATHS, PATHS))


def _against_cpp() -> Pair:
    """Compare with TOPP-RA's C++ library, whose runs are timed inside its process."""
    chosen = _toppra_problems()
    toppra_peer.solve_in_cpp(chosen[0], 1)

    def theirs(times: int) -> list[Taken]:
        taken = [toppra_peer.solve_in_cpp(x, times).taken for x in chosen]
        return [Taken(sum(x), sum(x)) for x in zip(*taken, strict=True)]

    def durations() -> list[float]:
        return [toppra_peer.solve_in_cpp(x, 1).duration for x in chosen]

    ours = timed(lambda: plan_all(STATIONS - 1))
    return Pair(ours, theirs, partial(_notes, "TOPP-RA C++", durations), parts=(PATHS, PATHS))


def _against_roboplan() -> Pair:
    """Compare with roboplan, which chooses its grid and has no limits for one direction only.

    Its arms and planners are made before. Its limits are the smaller ones of both directions.
    """
    if find_spec("roboplan") is None:
        raise Missing("roboplan is not installed, which has wheels for linux-x86_64")
    calls = [_roboplan_call(x) for x in problems()]

    def theirs() -> list[float]:
        return [float(call().times[-1]) for call in calls]

    ours = timed(lambda: plan_all(STATIONS - 1))
    notes = partial(_notes, "roboplan, with smaller limits", theirs)
    return Pair(ours, timed(theirs), notes, parts=(PATHS, PATHS))


def _roboplan_call(problem: Problem) -> Any:
    """Return a call that plans a path with roboplan, along the natural cubic spline."""
    from roboplan.core import (
        JointPath,
        Scene,
        loadJointLimitsConfig,
        loadUrdfSceneDescriptionFromXml,
    )
    from roboplan.toppra import PathParameterizerTOPPRA, SplineFittingMode, TOPPRAOptions

    velocity = np.abs(problem.velocity).min(axis=1).tolist()
    acceleration = np.abs(problem.acceleration).min(axis=1).tolist()
    joints = "".join(JOINT.format(k=k + 1, before=k, velocity=velocity[k]) for k in range(JOINTS))
    robot = f'<robot name="recipe"><link name="link0"/>{joints}</robot>'
    scene = Scene("recipe", loadUrdfSceneDescriptionFromXml(robot, []))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "limits.yaml"
        rows = [
            f"  joint{k + 1}:\n    max_acceleration: [{acceleration[k]!r}]\n" for k in range(JOINTS)
        ]
        file.write_text("joint_limits:\n" + "".join(rows))
        scene.importJointLimitsFromConfig(loadJointLimitsConfig(str(file)))
    scene.addGroupFromChain("arm", "link0", f"link{JOINTS}")
    planner = PathParameterizerTOPPRA(scene, "arm")
    options = TOPPRAOptions(SAMPLE_TIME, SplineFittingMode.Cubic)
    names = [f"joint{k + 1}" for k in range(JOINTS)]

    def call() -> Any:
        path = JointPath()
        path.joint_names = names
        path.positions = list(problem.points)
        return planner.generate(path, options)

    return call


def _notes(peer: str, theirs: Any) -> list[str]:
    """State by how much our durations differ from those of a peer, and our largest violation."""
    plans = plan_all(STATIONS - 1)
    ratio = np.array([x.duration for x in plans]) / np.array(theirs()) - 1
    used = max(_largest_use(x, plan) for x, plan in zip(problems(), plans, strict=True))
    return [
        f"durations relative to {peer}: {ratio.min():+.1e} to {ratio.max():+.1e}, largest "
        f"violation {max(used - 1, 0.0):.1e}"
    ]


def _largest_use(problem: Problem, planned: ac.Trajectory) -> float:
    """Return the largest share of a limit that a plan uses, at PLACES times.

    The path is SciPy's spline, and the motion along it the plan's law.
    """
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(AT, problem.points, bc_type="natural")
    law = planned.laws[0]
    t = np.linspace(0.0, planned.duration, PLACES)
    i = np.clip(np.searchsorted(law.breaks, t, side="right") - 1, 0, len(law.breaks) - 2)
    s, speed, rate = (law.path_position(i, t, order)[:, None] for order in range(3))
    velocity = spline(s[:, 0], 1) * speed
    acceleration = spline(s[:, 0], 1) * rate + spline(s[:, 0], 2) * speed**2
    used = 0.0
    for value, limit in ((velocity, problem.velocity), (acceleration, problem.acceleration)):
        used = max(used, float((value / limit[:, 0]).max()), float((value / limit[:, 1]).max()))
    return used


def _default() -> Pair:
    return Pair(timed(plan_all), timed(reference.work), parts=(PATHS, 1))


def _with_jerk() -> Pair:
    return Pair(timed(lambda: plan_all(jerk=True)), timed(reference.work), parts=(PATHS, 1))
