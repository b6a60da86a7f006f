"""A long program: G-code of 150,000 lines, read, planned, compensated and exported."""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

import armcontour as ac
from armcontour.io.cell import read_cell
from armcontour.jobs.programs import plan_run, programs_of
from benchmarks.measured import Measured

LINES = 150_000
WARM = 2_000
# Mean length of a line [mm], and the width of the noise on it.
STEP, NOISE = 0.5, 0.01


def gcode(lines: int) -> str:
    """Lines of a wavy spiral, run in and out within 120 x 120 mm."""
    rng = np.random.default_rng(1)
    radius = 35 + 24 * np.sin(np.linspace(0, lines / 2500, lines))
    angle = np.cumsum(STEP * rng.uniform(0.5, 1.5, lines) / radius)
    x = 75 + radius * np.cos(angle) + rng.normal(0, NOISE, lines)
    y = 75 + radius * np.sin(angle) + rng.normal(0, NOISE, lines)
    head = f"G21 G90 G17 G64 P0.05\nG0 X{x[0]:.3f} Y{y[0]:.3f}\nM3\nF6000\n"
    body = "".join(f"G1 X{a:.3f} Y{b:.3f}\n" for a, b in zip(x[1:], y[1:], strict=True))
    return f"{head}{body}M5\nM2\n"


def taught(file: Path, out: Path) -> tuple[ac.Job, ac.TaughtData]:
    """From the file to the exported set-points."""
    job = read_cell("pmk3s", file)
    this = job.runs[0]
    _, program = programs_of(job, this)
    plan = plan_run(job, this, program)
    found = ac.compensate(plan, job.servo, method=this.compensation, period=this.period)
    ac.export(found, out, arm=job.arm)
    return job, found


def measure() -> tuple[list[Measured], list[str]]:
    """Seconds warm, beside what numpy takes to write the set-points alone; and memory."""
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder) / "part.ngc", Path(folder) / "taught.csv"
        file.write_text(gcode(WARM))
        taught(file, out)
        file.write_text(gcode(LINES))
        begin = time.perf_counter()
        job, found = taught(file, out)
        ours = time.perf_counter() - begin
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        begin = time.perf_counter()
        np.savetxt(out, np.column_stack([found.t, found.q]), fmt="%.12f", delimiter=",")
        peer = time.perf_counter() - begin
    note = (
        f"A program of {LINES} lines: {job.path.length:.1f} m, {found.trajectory.duration:.0f} s, "
        f"{len(found.q)} set-points; at most {most:.2f} GB of memory."
    )
    what = f"G-code of {LINES} lines to taught data as CSV"
    return [Measured(what, ours, "numpy.savetxt of t and q", peer, "< 15 s, < 2 GB")], [note]


if __name__ == "__main__":
    rows, notes = measure()
    for row in rows:
        print(f"{row.what}: {row.ours:.2f} s ({row.ours / row.peer_time:.1f} x {row.peer})")
    print(*notes, sep="\n")
