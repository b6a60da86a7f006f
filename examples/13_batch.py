"""Many jobs: `batch` returns cycle time and contour error for each speed and compensation."""

import tempfile
from pathlib import Path

import armcontour as ac

JOB = """
name: bracket
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {}}
"""
OVER = {
    "limits.speed": ["40 mm/s", "80 mm/s", "120 mm/s"],
    "runs.only.compensation.method": ["none", "pole_placement", "inverse"],
}

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    (folder / "bracket.yaml").write_text(JOB)
    plan = {
        "job": str(folder / "bracket.yaml"),
        "over": OVER,
        "columns": ["duration", "contour_error.max"],
    }
    # The command `armcontour batch` uses all processors or a cluster, and can continue an
    # interrupted batch.
    result = ac.batch(plan, folder / "out", workers=0)

print(f"{result.counts['done']} of {len(result.plan)} jobs done")
for row in result.rows:
    print(
        f"{row['limits.speed'] * 1e3:3.0f} mm/s, {row['runs.only.compensation.method']:14s} "
        f"{row['duration']:.3f} s, {row['contour_error.max'] * 1e3:.4f} mm at most"
    )
