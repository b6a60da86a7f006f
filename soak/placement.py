"""`python -m soak.placement`: best places of random grids against plans of all of their places.

    python -m soak.placement [--count 50] [--first-seed 0]
    python -m soak.placement --bars [--yaw 12] [--every]

The judge moves the path, where `place` moves the frame that it is given in, and plans every place
by itself. It asks: is the best of the grid the best of all; is no bound above a plan; is refused
just what has no plan. With --bars, 2,500 places of a square of 100 mm before a UR5e are timed, by
the clock and by the processors, and with --yaw times as many; measure on a quiet machine. With
--every all of them are planned, too, and must have the same best place.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np

import armcontour as ac
from armcontour.errors import ArmContourError, Unreachable
from armcontour.io import parse_job
from armcontour.jobs import Job
from armcontour.placement import Moves, Placement

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
runs: {{taught: {{compensation: {{method: inverse}}}}}}
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


def durations(found: Placement, job: Job) -> np.ndarray:
    """Durations of all places by brute force [s]; infinite where there is no plan."""
    (run,) = job.runs
    vertices = job.single_path.vertices
    moves = Moves(anchor=(vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    known = []
    for k in range(len(found.verdicts)):
        program = ac.Program.of(job.path).placed(moves.frame(found.place(k)))
        path = ac.round_corners(program.single_path, tolerance=run.rounding.tolerance)
        try:
            known.append(ac.plan(path, job.arm, run.limits).duration)
        except ArmContourError:
            known.append(np.inf)
    return np.array(known)


def judge(seed: int) -> tuple[str, int, int]:
    """What is wrong with a placement, or "" ; how many places it has, and how many it planned."""
    job, over = random_problem(seed)
    try:
        found = ac.place(job, over=over, processes=1)
    except Unreachable as error:
        return ("" if "is feasible" in str(error) else str(error)), 0, 0
    known = durations(found, job)
    best = found.best.verdict.duration
    bounds = found.values("bound").ravel()
    refused = np.array([bool(x.refusal) for x in found.verdicts])
    looked = ~refused & np.isinf(known)
    wrong = []
    if not best <= known.min() * (1 + SAME):
        wrong.append(f"best {best}, but {known.min()} at {found.place(int(np.argmin(known)))}")
    if (bounds > known).any():
        k = int(np.argmax(bounds - known))
        wrong.append(f"a bound of {bounds[k]} above the plan of {known[k]} at {found.place(k)}")
    if (refused & np.isfinite(known)).any():
        wrong.append(f"refused {found.place(int(np.argmax(refused & np.isfinite(known))))}")
    # A place that tracing refuses between knots may have a bound only.
    if any(found.verdicts[k].planned for k in np.flatnonzero(looked)):
        wrong.append("a plan where there is none")
    if found.refined.verdict.duration > best:
        wrong.append("refined is worse")
    return "; ".join(wrong), len(known), found.planned


def time_bars(yaw: int, every: bool) -> int:
    """Print the times of the bars; returns the exit code."""
    job = job_of("ur5e", [0.45, 0.08, 0.2], 0.1, [np.pi, 0.0, 0.0], 0.25)
    over: dict[str, tuple[float, float, int]] = {"x": (-0.5, 0.3, 50), "y": (-0.6, 0.6, 50)}
    if yaw:
        over["yaw"] = (0.0, 2 * np.pi, yaw)
    found = timed(job, over)
    if not every:
        return 0
    best = timed(job, over, every=True).best
    same = best.values == found.best.values
    print(f"best of all plans: {best}, {'the same' if same else 'not the same'}")
    return 0 if same else 1


def timed(job: Job, over: dict[str, tuple[float, float, int]], every: bool = False) -> Placement:
    """A placement, of which the times are printed."""
    begin, spent = time.perf_counter(), _processor_time()
    found = ac.place(job, over=over, every=every)
    clock, spent = time.perf_counter() - begin, _processor_time() - spent
    print(
        f"{len(found.verdicts)} places: {clock:.1f} s by the clock, {spent:.1f} s of processors; "
        f"{found!r}; own place {found.own.duration:.4f} s; {found.refusals}",
        flush=True,
    )
    return found


def _processor_time() -> float:
    """Processor time of this process and of those that have ended [s]."""
    both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(x.ru_utime + x.ru_stime for x in map(resource.getrusage, both))


def main() -> int:
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.placement", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="how many problems")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--bars", action="store_true", help="time the bars instead")
    parser.add_argument("--yaw", type=int, default=0, help="with --bars: places of yaw, such as 12")
    parser.add_argument("--every", action="store_true", help="with --bars: plan all places, too")
    given = parser.parse_args()
    if given.bars:
        return time_bars(given.yaw, given.every)
    counts: Counter[str] = Counter()
    failed = 0
    for seed in range(given.first_seed, given.first_seed + given.count):
        wrong, places, planned = judge(seed)
        counts.update(places=places, planned=planned)
        if wrong:
            failed += 1
            print(f"seed {seed}: {wrong}")
    print(f"{given.count} placements, {dict(counts)}, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
