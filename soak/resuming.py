"""Jobs that are resumed at random places, compared with the plan of the whole job.

The joint positions at which the work begins must be those of the whole job when its tool is at this
place. The tool can be apart by the error of a rounded corner; the joints then differ by as much as
this distance demands.

| seed modulo 8 | job |
|---|---|
| 0 | square, planar arm |
| 1 | square, UR5e, the rotation about the tool axis is free |
| 2 | drawing with holes, built-in cell of the UR5e |
| 3 | G-code, built-in cell of the UR5e |
| 4 | seam on a rail |
| 5 | pipe on a positioner, a UR10e on a rail |
| 6 | arc leads, approach, and a seed with another turn of the base |
| 7 | seam that avoids an obstacle in another configuration |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath

import numpy as np

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.files import parse_job
from armcontour.jobs import RunResult
from armcontour.robot.scene import Box, Obstacle, Scene
from soak import Outcome

DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
# Largest difference of a joint, if the tool is at the same place [rad].
SAME_JOINTS = 1e-6
# Largest joint difference per tool distance [rad/m].
JOINTS_PER_DISTANCE = 30.0
# Largest distance of the resumed tool from the place on the drawing [m].
SAME_PLACE = 1e-9
# Times at which the whole job is searched for the place of the tool.
TIMES = 40_001
# Largest difference of arc lengths by which rounded corners move a place [m].
NEAR = 10e-3

PLANAR = """
name: square
arm: pmk3s
path: {points: [[0.30, 0.16], [0.36, 0.16], [0.36, 0.22], [0.30, 0.22], [0.30, 0.16]]}
corners: {tolerance: 0.5 mm}
limits: {speed: 0.10 m/s, centripetal_acceleration: 0.3 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {timing: {reserve: 5 %}}}
"""
SPATIAL = """
name: square
arm: ur5e
path:
  points:
    - [0.4, -0.05, 0.2]
    - [0.5, -0.05, 0.2]
    - [0.5, 0.05, 0.2]
    - [0.4, 0.05, 0.2]
    - [0.4, -0.05, 0.2]
  orientation: {axis: [0, 0, -1]}
corners: {tolerance: 0.25 mm}
limits: {speed: 250 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {timing: {reserve: 5 %}}}
"""
LED = (
    SPATIAL
    + """
seed: [-3.6, -1.5, 2.4, -2.4, -1.6, 0.5]
process:
  approach: 20 mm
  retract: 20 mm
  switch: {name: laser}
  lead_in: {shape: arc, length: 20 mm, side: right}
  lead_out: {shape: line, length: 10 mm, side: right}
"""
)
RAIL = """
name: rail
arm:
  name: ur10e
  tool: {position: [0, 0, 300 mm]}
  rail: {axis: [0, 1, 0], lower: 0, upper: 3.0, velocity: 1.0, acceleration: 1.0, mass: 120 kg}
path:
  points: [[0.7, 0.25, 0], [0.7, 2.75, 0], [0.9, 2.75, 0], [0.9, 0.4, 0]]
  orientation: {axis: [0.7071, 0, -0.7071]}
corners: {tolerance: 0.5 mm}
limits: {speed: 20 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
scene: {floor: none}
runs: {only: {timing: {reserve: 10 %}}}
"""
SEAM = """
name: seam
arm: {name: ur5e, tool: {position: [0, 0, 100 mm]}}
path:
  points: [[0.45, -0.1, 0.1], [0.45, 0.1, 0.1]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {}}
"""


def read_drawing(name: str, cell: str) -> ac.Job:
    """Read the job of an example drawing in a built-in cell."""
    return ac.read_job(DRAWINGS / name, cell=cell)


def avoiding_job() -> ac.Job:
    """Read the seam with a post where the fastest configuration has its elbow."""
    job = parse_job(SEAM)
    trajectory = plan_of(job).trajectory
    elbow = job.arm.links(trajectory(0.0))[3]
    post = Obstacle(
        name="post",
        shape=Box(size=[0.06, 0.06, 0.06]),
        place=Frame(position=elbow + [0.0, 0.0, 0.03]),
    )
    return replace(job, scene=Scene(obstacles=(post,)))


JOBS: dict[str, Callable[[], ac.Job]] = {
    "planar": lambda: parse_job(PLANAR),
    "spatial": lambda: parse_job(SPATIAL),
    "drawing": lambda: read_drawing("gasket.dxf", "ur5e"),
    "G-code": lambda: read_drawing("pocket.ngc", "ur5e"),
    "rail": lambda: parse_job(RAIL),
    "positioner": lambda: read_drawing("pipe_saddle.csv", "ur10e_positioner"),
    "leads": lambda: parse_job(LED),
    "avoiding": avoiding_job,
}


def plan_of(job: ac.Job) -> RunResult:
    """Plan a job's first run."""
    one = replace(job, runs=job.runs[:1])
    (plan,) = ac.run(one, simulate=False).runs.values()
    return plan


@cache
def whole_plan(name: str) -> tuple[ac.Job, RunResult]:
    """Plan a job; return both."""
    job = JOBS[name]()
    return job, plan_of(job)


def resume(job: ac.Job, resume_at: float) -> ac.Job:
    """Resume the job from an arc length [m]."""
    return replace(job, process=replace(job.process, resume_at=resume_at))


def work_lengths(plan: RunResult) -> np.ndarray:
    """Return the working length until each contour, and of all contours [m], (contours + 1,)."""
    works = [x.at_work for x in plan.objective.contours]
    return np.cumsum([0.0, *(end - start for start, end in works)])


def start_of_work(plan: RunResult) -> np.ndarray:
    """Return the joint positions at which the work of a plan begins [rad], (dof,)."""
    span = plan.trajectory.contour_spans[0]
    return plan.trajectory(span.t[0] if span.work is None else span.work[0])


def compare(whole: RunResult, rest: RunResult, resume_at: float) -> tuple[float, float, float]:
    """Compare the start of a resumed plan with the whole plan at this place.

    Returns the largest difference of a joint [rad], the distance of both tools [m], and the
    distance of the resumed tool from the place on the drawing [m].
    """
    breaks = work_lengths(whole)
    k = int(np.searchsorted(breaks, resume_at + 1e-9, side="right")) - 1
    drawn = whole.objective.contours[k]
    s = drawn.at_work[0] + resume_at - breaks[k]
    arm = rest.arm
    q = start_of_work(rest)
    tool = arm.tool_position(q)
    off_place = float(np.linalg.norm(tool - drawn.path(s)))
    span = whole.trajectory.contour_spans[k]
    t = np.linspace(*span.t, TIMES)
    travelled = (whole.trajectory.s(t) - span.s[0]) / (span.s[1] - span.s[0])
    near = np.abs(travelled * drawn.path.length - s) < NEAR + (t[1] - t[0])
    t = t[near]
    apart = np.linalg.norm(arm.tool_position(whole.trajectory(t)) - tool, axis=1)
    i = int(apart.argmin())
    low = t[max(i - 1, 0)]
    high = t[min(i + 1, len(t) - 1)]
    # Golden-section search of the nearest time.
    for _ in range(80):
        inner = np.array([high - 0.618 * (high - low), low + 0.618 * (high - low)])
        first, second = np.linalg.norm(arm.tool_position(whole.trajectory(inner)) - tool, axis=1)
        if first < second:
            high = inner[1]
        else:
            low = inner[0]
    before = whole.trajectory((low + high) / 2)
    gap = float(np.linalg.norm(arm.tool_position(before) - tool))
    return float(np.abs(q - before).max()), gap, off_place


def judge(name: str, share: float) -> list[str]:
    """List what is wrong with a job that is resumed at a share of its length."""
    job, whole = whole_plan(name)
    resume_at = share * float(work_lengths(whole)[-1])
    rest = plan_of(resume(job, resume_at))
    joints, gap, off_place = compare(whole, rest, resume_at)
    notes = []
    if joints > SAME_JOINTS + JOINTS_PER_DISTANCE * gap:
        notes.append(f"joints differ by {joints:.3g} rad, tools by {gap:.3g} m")
    if off_place > SAME_PLACE:
        notes.append(f"{off_place:.3g} m from the place")
    if not any("configuration of the whole job" in x for x in rest.remarks):
        notes.append("no note")
    return notes


def run(seed: int) -> Outcome:
    """Judge the job of a seed, resumed at a random place."""
    name = list(JOBS)[seed % len(JOBS)]
    share = float(np.random.default_rng(seed).uniform(0.01, 0.99))
    notes = judge(name, share)
    return Outcome(result="resumed", kind=name, notes=notes)
