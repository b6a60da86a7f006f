"""Time a batch of 64 jobs in two processes, and by Dask, against one process; short and long jobs.

Both sides call `armcontour.batch`, as its guide does, and their times are those of all processes
from start to end. The peer's time divided by ours is the efficiency: the share of the processor
time that goes into jobs, on a machine whose processors have nothing else to do.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.measured import Bar, Line, Missing, Pair, Taken, spawned

# Jobs of a batch.
JOBS = 64
# Name of the job's file.
JOB = "zigzag.yaml"
# Corners of the zigzag in jobs of about 50 ms, 0.3 s and 1 s.
CORNERS = {"short": 4, "medium": 110, "long": 400}
# Ends of the zigzag along x, and its height [m].
ZIGZAG = ((0.28, 0.34), 0.02)
# Ways in which a batch is run.
ALONE = "alone"
PROCESSES = "processes"
DASK = "dask"
# Processes that share the jobs.
WORKERS = 2
# Sizes from which the C library returns freed memory to the system, and takes it from there [B].
# Dask sets a smaller size, with which arrays are new memory each time, so jobs take 1.7 times the
# processor time.
SPAWN = "distributed.nanny.pre-spawn-environ"
DASK_MEMORY = {
    f"{SPAWN}.MALLOC_TRIM_THRESHOLD_": 1 << 25,
    f"{SPAWN}.MALLOC_MMAP_THRESHOLD_": 1 << 24,
}


def job_text(corners: int) -> str:
    """Return a job along a zigzag with so many corners."""
    (begin, end), height = ZIGZAG
    step = (end - begin) / corners
    points = [[round(begin + step * k, 6), 0.2 + height * (k % 2)] for k in range(corners + 2)]
    return f"""name: zigzag
arm: pmk3s
path: {{points: {points}}}
limits: {{speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}}
corners: {{tolerance: 0.5 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{only: {{compensation: {{method: pole_placement}}}}}}
"""


def lines() -> list[Line]:
    """Return the lines of each job length in processes, then of long jobs by Dask."""
    # A ratio of 1.18 is an efficiency of 85 %, and 1.33 of 75 %.
    return [
        _line("short", PROCESSES, Bar()),
        _line("medium", PROCESSES, Bar(), full=True),
        _line("long", PROCESSES, Bar(ratio=1.18), full=True),
        _line("short", DASK, Bar()),
        _line("medium", DASK, Bar(), full=True),
        _line("long", DASK, Bar(ratio=1.33), full=True),
    ]


def _line(length: str, way: str, bar: Bar, full: bool = False) -> Line:
    corners = CORNERS[length]
    by = f"{WORKERS} processes" if way == PROCESSES else f"Dask with {WORKERS} workers"
    what = f"a job of {JOBS} in a batch, {corners} corners, {by}"
    return Line(
        f"batch/{length}/{way}", what, "one process", partial(_pair, corners, way), bar, full
    )


def _pair(corners: int, way: str) -> Pair:
    if way == DASK and importlib.util.find_spec("distributed") is None:
        raise Missing("the package distributed is not installed")
    folder = tempfile.TemporaryDirectory()
    (Path(folder.name) / JOB).write_text(job_text(corners))
    # Functions are compiled before.
    spawned(partial(_command, folder, ALONE, 1))(1)
    taken = dict[str, list[Taken]]()

    def timer(side: str, how: str, times: int) -> list[Taken]:
        taken[side] = spawned(partial(_command, folder, how, JOBS))(times)
        return taken[side]

    def notes() -> list[str]:
        ours = min(x.processor for x in taken["ours"])
        peer = min(x.processor for x in taken["peer"])
        return [f"jobs of {peer / JOBS * 1e3:.0f} ms, efficiency {peer / ours:.0%}"]

    return Pair(
        partial(timer, "ours", way),
        partial(timer, "peer", ALONE),
        notes,
        warm=True,
        parts=(JOBS, JOBS),
    )


def _command(folder: tempfile.TemporaryDirectory[str], way: str, jobs: int) -> list[str]:
    """Return the command that runs a batch of the job in a folder."""
    file = str(Path(folder.name) / JOB)
    return [sys.executable, "-m", "benchmarks.batch", file, way, str(jobs)]


def run_batch(file: Path, way: str, jobs: int) -> None:
    """Run a job at so many speeds, as the guide does."""
    import armcontour as ac

    over = {"limits.speed": [f"{60 + 0.5 * k} mm/s" for k in range(jobs)]}
    if way == DASK:
        import dask
        from distributed import Client, LocalCluster

        with (
            dask.config.set(DASK_MEMORY),
            LocalCluster(
                n_workers=WORKERS, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            Client(cluster) as client,
        ):
            result = ac.batch(file, over, executor=client.get_executor())
    else:
        result = ac.batch(file, over, workers=0 if way == ALONE else WORKERS)
    if result.counts != {"done": jobs}:
        raise SystemExit(f"Not all jobs were done: {result.counts}.")


if __name__ == "__main__":
    run_batch(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
