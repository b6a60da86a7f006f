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
runs: {only: {timing: {reserve: 2 %}}}
"""
OVER = {
    "limits.speed": ["40 mm/s", "80 mm/s", "120 mm/s"],
    "compensation.method": ["none", "pole_placement", "inverse"],
}

with tempfile.TemporaryDirectory() as name:
    job = Path(name) / "bracket.yaml"
    job.write_text(JOB)
    result = ac.batch(job, OVER, workers=0)

print(f"{result.counts['done']} of {result.rows[-1].job} jobs done")
for row in result.rows:
    duration, error = (row.data[x].value for x in ("duration", "contour_error.max"))
    print(
        f"{row.values['limits.speed']:>8}, {row.values['compensation.method']:14s} "
        f"{duration:.3f} s, {error * 1e3:.4f} mm at most"
    )
