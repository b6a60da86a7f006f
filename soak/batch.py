"""Batches: the same table from all engines, and after `kill -9` at random times.

    python -m soak.batch engines [--jobs 300]             process, pool and Dask cluster
    python -m soak.batch kills [--jobs 300] [--times 20]  kill -9 of the batch, resumed

The jobs are the paper's, of corner tolerance by assigned velocity. The exit code is 1 if a table
differs from that of an uninterrupted batch.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import time
from importlib import import_module, resources
from pathlib import Path as FilePath
from typing import Any

import armcontour as ac
from armcontour.batches import Batch


def plan_of(folder: FilePath, jobs: int) -> FilePath:
    """A plan of about so many jobs in a folder: the paper's job, tolerance by speed."""
    paper = resources.files("armcontour.jobs") / "library" / "paper.yaml"
    (folder / "paper.yaml").write_bytes(paper.read_bytes())
    side = math.isqrt(jobs)
    plan = {
        "job": "paper.yaml",
        "run": "optimal",
        "over": {
            "corners.tolerance": {"from": "0.1 mm", "to": "10 mm", "steps": side, "scale": "log"},
            "limits.speed": {"from": "0.05 m/s", "to": "0.25 m/s", "steps": -(-jobs // side)},
            "runs.optimal.cycle": "4 ms",
            "experiment": None,
        },
    }
    (folder / "plan.yaml").write_text(json.dumps(plan))
    return folder / "plan.yaml"


def rows(batch: Batch) -> list[dict[str, Any]]:
    """The rows without columns that differ between runs."""
    hidden = "(not reproducible)"
    return [{key: x for key, x in row.items() if hidden not in key} for row in batch.rows]


def engines(plan: FilePath, options: argparse.Namespace) -> bool:
    """Whether this process, a pool and a Dask cluster of two workers give the same table."""
    distributed: Any = import_module("distributed")

    want = rows(ac.batch(plan, plan.parent / "here", workers=0))
    results = {"pool": rows(ac.batch(plan, plan.parent / "pool"))}
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        address = cluster.scheduler_address
        results["Dask"] = rows(ac.batch(plan, plan.parent / "dask", cluster=address))
    for name, x in results.items():
        print(f"{name}: {len(x)} rows, {'the same' if x == want else 'DIFFERENT'}", flush=True)
    return all(x == want for x in results.values())


def kills(plan: FilePath, options: argparse.Namespace) -> bool:
    """Whether a batch that is killed at random times gives the same table when it is resumed."""
    draw = random.Random(options.seed)
    want = rows(ac.batch(plan, plan.parent / "whole"))
    killed, good, number = 0, True, 0
    while killed < options.times:
        out = plan.parent / f"killed-{number}"
        number, written_counts = number + 1, []
        while killed < options.times:
            call = [sys.executable, "-m", "armcontour", "batch", str(plan), "--out", str(out)]
            process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            kill_count = _written(out) + draw.choice([0, 1, options.jobs // 10, options.jobs // 3])
            while process.poll() is None and _written(out) < kill_count:
                time.sleep(0.02)
            time.sleep(draw.uniform(0.0, 0.5))
            if process.poll() is not None:
                break
            process.kill()
            process.wait()
            killed += 1
            written_counts.append(_written(out))
        same = rows(ac.batch(plan, out)) == want
        good &= same
        print(
            f"killed after {written_counts} rows: {'the same' if same else 'DIFFERENT'} table",
            flush=True,
        )
    return good


def _written(out: FilePath) -> int:
    """Number of rows that a batch has written."""
    lines = out / "results.jsonl"
    return lines.read_bytes().count(b"\n") if lines.exists() else 0


KINDS = {"engines": engines, "kills": kills}


def main() -> None:
    """Run one kind of check, or both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("kind", nargs="?", choices=tuple(KINDS))
    parser.add_argument("--jobs", type=int, default=300)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    good = True
    for kind in [options.kind] if options.kind else KINDS:
        with tempfile.TemporaryDirectory(prefix="batch-") as name:
            good &= KINDS[kind](plan_of(FilePath(name), options.jobs), options)
    sys.exit(not good)


if __name__ == "__main__":
    main()
