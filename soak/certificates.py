"""`python -m soak.certificates`: sample drawings certified on both cells, judged independently."""

from __future__ import annotations

import sys
import time
from pathlib import Path as FilePath

import numpy as np

import armcontour as ac
from armcontour._checks import FloatArray
from armcontour.io.cell import read_cell

DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
CASES = (("gasket.dxf", "pmk3s"), ("gasket.dxf", "ur5e"))
SERVO = 1e-4
# Random times at which joints' accelerations are looked at, and places around the largest of them.
TIMES = 1_000_000
LARGEST = 300
AROUND = 1e-3  # [s]
# Joints may take this much more than their limits: rounding.
KEPT = 1e-9


def outside(drawing: str, cell: str) -> list[str]:
    """Sentences on what a certificate does not hold; none if it holds."""
    job = read_cell(cell, DRAWINGS / drawing)
    found = ac.certify(job, servo=SERVO)
    arm, limits = job.arm, found.run.limits
    executed = ac.execute(
        found.taught, ac.ServoPlant(arm, job.plant_servo, limits), resolution=1e-4
    )
    result = ac.evaluate(executed, found.path, objective=found.objective, limits=limits)
    said = [
        f"{x.name}: contour error {error.max:.3g} m"
        for x, error in zip(found.contours, result.contours, strict=True)
        if error.max > SERVO or abs(error.max - x.error.max) > 1e-6 * x.error.max
    ]
    if not (result.demand_ratio <= 1 + 1e-6).all() or result.saturated.any():
        said.append(f"demands of {result.demand_ratio.max():.9g} of the limits")
    checked = ac.check(found.trajectory, arm, limits, points=20, seed=1)
    said += [f"the plan uses {x.ratio:.9g} of {x.name}" for x in checked.violations]
    share, t = largest_acceleration(found.trajectory, *limits.acceleration_bounds(arm.dof))
    if share > 1 + KEPT:
        said.append(f"the plan uses {share:.9g} of a joint's acceleration limit at {t:.9g} s")
    return said


def largest_acceleration(
    plan: ac.Trajectory, low: FloatArray, high: FloatArray
) -> tuple[float, float]:
    """The largest share of a joint's acceleration limit found, and when [s].

    At random times, on both sides of all breaks, and near to the largest of these.

    Args:
        plan: The plan.
        low: Lowest accelerations, (dof,).
        high: Highest accelerations, (dof,).
    """

    def shares(t: FloatArray, side: str = "right") -> FloatArray:
        ddq = plan(t, 2, side=side)
        return np.asarray(np.maximum(ddq / high, ddq / low).max(axis=1))

    t = np.random.default_rng(2).uniform(0.0, plan.duration, TIMES)
    t = np.concatenate([t, plan.breaks])
    found = np.maximum(shares(t), shares(t, "left"))
    near = t[np.argsort(found)[-LARGEST:], None] + np.linspace(-AROUND, AROUND, 801)
    near = np.clip(near.ravel(), 0.0, plan.duration)
    t, found = np.concatenate([t, near]), np.concatenate([found, shares(near)])
    return float(found.max()), float(t[np.argmax(found)])


def main() -> int:
    """Run it; returns the exit code."""
    bad = 0
    for drawing, cell in CASES:
        begun = time.perf_counter()
        said = outside(drawing, cell)
        print(f"{drawing} on {cell}: {time.perf_counter() - begun:.1f} s, {len(said)} wrong")
        for x in said:
            print(f"  {x}")
        bad += len(said)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
