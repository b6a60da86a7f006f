"""Certify sample drawings and random jobs, execute them, and judge the certificates."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from soak import Outcome

DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
CASES = (("gasket.dxf", "pmk3s"), ("gasket.dxf", "ur5e"))
SERVO = 1e-4
# Random times at which joints' accelerations are judged.
TIMES = 1_000_000
# A certified error may be exceeded by this [m]: rounding, and peaks between samples of the search.
ROUNDED = 1e-9
# Joints may exceed their limits by this share, due to rounding.
KEPT = 1e-9


def outside(drawing: str, cell: str) -> list[str]:
    """List the promises of a certificate that its execution breaks."""
    job = read_cell(cell, DRAWINGS / drawing)
    certificate = ac.certify(job, goal=ac.CertificateGoal(servo_error=SERVO))
    arm = job.arm
    planned = certificate.result
    limits = planned.run.limits
    executed = ac.simulate(
        certificate.set_points, ac.ServoPlant(arm, job.plant_servo, limits), resolution=1e-4
    )
    result = ac.evaluate(executed, planned.path, objective=planned.objective, limits=limits)
    messages = [
        f"{x.name}: contour error {error.max:.3g} m"
        for x, error in zip(certificate.contours, result.contours, strict=True)
        if error.max > SERVO or abs(error.max - x.error.max) > 1e-6 * x.error.max
    ]
    if not (result.demand_ratio <= 1 + 1e-6).all() or result.saturated.any():
        messages.append(f"demands of {result.demand_ratio.max():.9g} of the limits")
    checked = ac.check(certificate.trajectory, arm, limits, points=20, seed=1)
    messages += [f"the plan uses {x.ratio:.9g} of {x.name}" for x in checked.violations]
    share, t = largest_acceleration(certificate.trajectory, *limits.acceleration_bounds(arm.dof))
    if share > 1 + KEPT:
        messages.append(f"the plan uses {share:.9g} of a joint's acceleration limit at {t:.9g} s")
    return messages


def random_job(seed: int) -> ac.Job:
    """Draw a job to certify: 2 to 5 random segments on the PMK-3s, with a small budget."""
    rng = np.random.default_rng(seed)
    points = [np.array([0.35, 0.2])]
    while len(points) < rng.integers(3, 7):
        points.append(points[-1] + rng.normal(0.0, 0.05, 2))
        if not 0.25 < np.hypot(*points[-1]) < 0.5 or points[-1].min() < 0.05:
            points.pop()
    tolerance = 10 ** rng.uniform(-4, -2.7)
    return parse_job(
        f"""
name: random
arm: pmk3s
path: {{points: {np.array(points).tolist()}}}
limits: {{speed: {rng.uniform(0.08, 0.3)}, joint_acceleration: {rng.uniform(0.7, 6)}}}
corners: {{tolerance: {min(tolerance, 0.3 * _shortest(points))}}}
servo:
  kp: {rng.uniform(15, 40)}
  kv: {rng.uniform(100, 200)}
  dead_time: {rng.choice([0.0, 0.004])}
  interpolation: {rng.choice(["linear", "cubic"])}
cycle: {rng.choice([4, 8, 20])} ms
certificate: {{servo_error: {10 ** rng.uniform(-6, -4)}}}
runs:
  only: {{compensation: {{method: inverse}}}}
"""
    )


def _shortest(points: list[FloatArray]) -> float:
    """Return the length of a polyline's shortest segment [m]."""
    return float(np.hypot(*np.diff(points, axis=0).T).min())


def until_rest(seed: int) -> list[str] | None:
    """List what an execution of a random certificate exceeds; None if none was certified."""
    job = random_job(seed)
    try:
        certificate = ac.certify(job)
    except ac.NotRealizable:
        return None
    # The plant executes until all joints are at rest.
    plant = ac.ServoPlant(job.arm, job.plant_servo, certificate.result.run.limits)
    executed = ac.simulate(certificate.set_points, plant, resolution=5e-5)
    error = float(certificate.result.path.path.project(executed.tool).distance.max())
    stated = {
        "the budget": certificate.budget.executed,
        "the evaluation": certificate.result.evaluation.contour_error.max,
        "the contour": certificate.contours[0].error.max,
    }
    return [
        f"job {seed}: contour error {error:.6g} m, {name} states {x:.6g} m"
        for name, x in stated.items()
        if error > x * (1 + 1e-3) + ROUNDED
    ]


def largest_acceleration(
    plan: ac.Trajectory, low: FloatArray, high: FloatArray
) -> tuple[float, float]:
    """Return the largest share of an acceleration limit, and its time [s].

    At random times, and on both sides of all breaks.
    """

    def shares(t: FloatArray, side: str = "right") -> FloatArray:
        ddq = plan(t, 2, side=side)
        return np.asarray(np.maximum(ddq / high, ddq / low).max(axis=1))

    t = np.random.default_rng(2).uniform(0.0, plan.duration, TIMES)
    t = np.concatenate([t, plan.breaks])
    peaks = np.maximum(shares(t), shares(t, "left"))
    return float(peaks.max()), float(t[np.argmax(peaks)])


def run(seed: int) -> Outcome:
    """Certify a random job; the first ones are sample drawings."""
    if seed < len(CASES):
        return Outcome(kind="drawing", result="certified", notes=outside(*CASES[seed]))
    notes = until_rest(seed)
    result = "refused" if notes is None else "certified"
    return Outcome(kind="random", result=result, notes=notes or [])
