"""`python -m soak.certificates`: sample drawings certified on both cells, judged independently."""

from __future__ import annotations

import sys
import time
from pathlib import Path as FilePath

import armcontour as ac
from armcontour.io.cell import read_cell

DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
CASES = (("gasket.dxf", "pmk3s"), ("gasket.dxf", "ur5e"))
SERVO = 1e-4


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
    checked = ac.check(found.trajectory, arm, limits, seed=1)
    said += [f"the plan uses {x.ratio:.9g} of {x.name}" for x in checked.violations]
    return said


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
