"""Best places of random grids, against plans of all of their places.

The judge moves the path, where `place` moves the frame that it is given in, and plans every place
by itself. Is the best of the grid the best of all; is no bound above a plan; is refused just what
has no plan?
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import armcontour as ac
from armcontour.core.errors import ArmContourError, Unreachable
from armcontour.files import parse_job
from armcontour.jobs import Job
from armcontour.studies.placement import Moves, Placement
from soak import Outcome

# Plans of a path that is moved differ from those in a moved frame by this share, as rounding
# decides where grids are refined.
SAME = 1e-5
JOB = """
name: square
arm: {arm}
path:
  points: {points}
  orientation: {{rpy: {rpy}}}
limits: {{speed: {speed}}}
corners: {{tolerance: 0.25 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{compensated: {{compensation: {{method: inverse}}}}}}
"""
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]


def job_of(arm: str, corner: list[float], side: float, rpy: list[float], speed: float) -> Job:
    """A square on an arm without shapes, so that nothing but limits refuses a place."""
    points = (np.array(corner) + side * np.array(SQUARE)).tolist()
    job = parse_job(JOB.format(arm=arm, points=points, rpy=rpy, speed=speed))
    return replace(job, arm=job.arm.with_shapes(None))


def random_problem(seed: int) -> tuple[Job, dict[str, tuple[float, float, int]]]:
    """A square of a random size and pose, and a grid that reaches out of the arm's reach."""
    rng = np.random.default_rng(seed)
    arm = str(rng.choice(["ur5e", "ur10e"]))
    far = 0.75 if arm == "ur5e" else 1.1
    angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.8) * far
    corner = [distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0.0, 0.4)]
    rpy = [np.pi + rng.normal(0, 0.3), rng.normal(0, 0.3), rng.uniform(-np.pi, np.pi)]
    job = job_of(arm, corner, rng.uniform(0.02, 0.15), rpy, float(rng.choice([0.1, 0.25, 1.0])))
    names = rng.choice(["x", "y", "z", "yaw", "tilt"], size=2, replace=False)
    over = {}
    for name in names.tolist():
        low, high = sorted(rng.uniform(-0.5, 0.5, 2) * (1.0 if name in "xyz" else 3.0))
        over[name] = (float(low), float(high), int(rng.integers(3, 6)))
    return job, over


def durations(placement: Placement, job: Job) -> np.ndarray:
    """Durations of all places by brute force [s]; infinite where there is no plan."""
    (run,) = job.runs
    vertices = job.program.path.vertices
    moves = Moves(anchor=(vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    expected = []
    for k in range(len(placement.verdicts)):
        program = ac.Program.from_path(job.path).placed(moves.frame(placement.place(k)))
        path = ac.round_corners(program.single_path, tolerance=run.rounding.tolerance)
        try:
            expected.append(ac.plan(path, job.arm, run.limits).duration)
        except ArmContourError:
            expected.append(np.inf)
    return np.array(expected)


def run(seed: int) -> Outcome:
    """Find the best place of a random grid, and plan all of its places."""
    job, over = random_problem(seed)
    try:
        placement = ac.place(job, ac.PlaceSearch(over=over), processes=1)
    except Unreachable as error:
        notes = [] if "is feasible" in str(error) else [str(error)]
        return Outcome(result="none", notes=notes)
    expected = durations(placement, job)
    best = placement.best.verdict.duration
    bounds = placement.values("bound").ravel()
    refused = np.array([bool(x.refusal) for x in placement.verdicts])
    looked = ~refused & np.isinf(expected)
    wrong = []
    if not best <= expected.min() * (1 + SAME):
        wrong.append(
            f"best {best}, but {expected.min()} at {placement.place(int(np.argmin(expected)))}"
        )
    if (bounds > expected).any():
        k = int(np.argmax(bounds - expected))
        wrong.append(
            f"a bound of {bounds[k]} above the plan of {expected[k]} at {placement.place(k)}"
        )
    if (refused & np.isfinite(expected)).any():
        wrong.append(f"refused {placement.place(int(np.argmax(refused & np.isfinite(expected))))}")
    # A place that tracing refuses between knots may have a bound only.
    if any(placement.verdicts[k].planned for k in np.flatnonzero(looked)):
        wrong.append("a plan where there is none")
    if placement.refined.verdict.duration > best:
        wrong.append("refined is worse")
    return Outcome(result="placed", notes=wrong)
