"""The optimal planner against toppra, on random splines with limits of joint motion.

toppra's solution on a finer grid, for some problems 10 times finer, is the reference. Its path is
scaled to the parameter range [0, 1], because its tolerances are absolute. References are kept in
`toppra_durations.json`; some are computed again here.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.oracle.toppra_kept import SAME, recorded_duration

import armcontour as ac

pytest.importorskip("toppra", reason="toppra has wheels for linux-x86_64 only")

from toppra import SplineInterpolator, setup_logging  # noqa: E402
from toppra.algorithm import TOPPRA  # noqa: E402
from toppra.constraint import DiscretizationType as Scheme  # noqa: E402
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint  # noqa: E402

setup_logging("CRITICAL")

PROBLEMS, JUDGED = 200, 2  # one in so many is judged here
FINE, TEN_TIMES_FINER = 5000, 40_000  # toppra's intervals; ours are 4000
REFERENCES = [
    *(("joint", FINE, seed) for seed in range(PROBLEMS)),
    *(("joint", TEN_TIMES_FINER, seed) for seed in range(0, PROBLEMS, 20)),
]
# toppra's durations on 5000 intervals and on 10,000 differ by less than this.
ALLOWED = 1e-4
# The interpolation scheme plans inside the limits, so that it comes down on the optimum from above,
# and toppra's absolute tolerances grow in weight with the grid: seed 180 is 6e-4 slow at 40,000
# points.
OWN_ERROR = 1e-3


def problem(seed):
    """Waypoints in 2 to 7 joints, and limits."""
    rng = np.random.default_rng(seed)
    dof = int(rng.integers(2, 8))
    points = rng.uniform(-2, 2, (int(rng.integers(3, 9)), dof))
    return points, rng.uniform(0.5, 3, dof), rng.uniform(0.5, 5, dof)


def ours(points, velocity, acceleration, **options):
    limits = ac.Limits(joint_velocity=velocity, joint_acceleration=acceleration)
    arm = SimpleNamespace(dof=points.shape[1], limits=limits)
    return ac.plan(ac.JointPath.spline(points), arm, limits, ac.Optimal(**options)), limits


def peer(points, velocity, acceleration, grid, scheme):
    """Duration by toppra on a grid of path parameters from 0 to 1."""
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    parameter = np.concatenate([[0], np.cumsum(chords)]) / chords.sum()
    path = SplineInterpolator(parameter, points, bc_type="natural")
    constraints = [
        JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        JointAccelerationConstraint(np.column_stack([-acceleration, acceleration]), scheme),
    ]
    how = {"solver_wrapper": "seidel", "parametrizer": "ParametrizeConstAccel"}
    instance = TOPPRA(constraints, path, gridpoints=grid, **how)
    return instance.compute_trajectory(0, 0).duration


def by_toppra(seed, intervals):
    return peer(*problem(seed), np.linspace(0, 1, intervals + 1), Scheme.Interpolation)


def compare(seed, intervals):
    """Our duration over toppra's, and what was planned."""
    points, velocity, acceleration = problem(seed)
    planned, limits = ours(points, velocity, acceleration)
    return planned.duration / recorded_duration("joint", intervals, seed), planned, limits


@pytest.mark.parametrize(("kind", "intervals", "seed"), REFERENCES[3:PROBLEMS:50] + REFERENCES[-1:])
def test_references_are_what_toppra_finds(kind, intervals, seed):
    assert by_toppra(seed, intervals) == pytest.approx(
        recorded_duration(kind, intervals, seed), rel=SAME
    )


@pytest.mark.parametrize("first", [0, 1])
def test_as_fast_as_a_fine_reference(first, worst_ratios):
    for seed in range(first * JUDGED, PROBLEMS, 2 * JUDGED):
        ratio, planned, limits = compare(seed, FINE)
        assert 1 - OWN_ERROR < ratio < 1 + ALLOWED, seed
        # A plan that keeps every limit everywhere is never shorter than the true optimum.
        ratios = worst_ratios(planned, limits, places=10)
        assert max(ratios.values()) <= 1 + 1e-9, seed
        assert set(ratios) == {"joint_velocity", "joint_acceleration"}


def test_as_fast_as_a_reference_ten_times_finer():
    for seed in range(0, PROBLEMS, 20):
        ratio, *_ = compare(seed, TEN_TIMES_FINER)
        assert 1 - OWN_ERROR < ratio < 1 + ALLOWED, seed


def test_against_the_collocated_optimum_of_the_same_grid():
    """The guarantee costs at most 0.01 % over it, here with toppra's on the same grid.

    toppra's collocation looks at the start of every interval only, and so is faster than the true
    optimum here and slower there, by a share that falls with the grid.
    """
    for seed in range(0, 40, 10):
        points, velocity, acceleration = problem(seed)
        planned, _ = ours(points, velocity, acceleration)
        s = planned.s(planned.breaks)
        bare = peer(points, velocity, acceleration, s / s[-1], Scheme.Collocation)
        assert planned.duration < bare * (1 + 1e-4), seed
