"""Batches in processes and on a cluster, with real limits, and killed."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest

import armcontour as ac

JOB = """\
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 10 ms
runs: {only: {compensation: {method: none}}}
"""
PLACED = "placement: {over: {x: {from: -30 mm, to: 30 mm, places: 3}}, refine: false}\n"
SPEEDS = {"from": "20 mm/s", "to": "0.1 m/s", "steps": 6}
POINTS = [[[0.30, 0.20], [0.33, 0.20], [x, 0.23]] for x in (0.33, 0.93)]


@pytest.fixture
def small(tmp_path):
    (tmp_path / "bend.yaml").write_text(JOB)
    over = {"limits.speed": SPEEDS, "path.points": POINTS}
    return {"job": str(tmp_path / "bend.yaml"), "do": "compensate", "over": over, "name": "small"}


def rows(batch):
    """The rows without columns that may differ."""
    hidden = "(not reproducible)"
    return [{key: x for key, x in row.items() if hidden not in key} for row in batch.rows]


@pytest.mark.parametrize("work", ["compensate", "place"])
def test_processes_and_dask_give_the_same_rows(small, tmp_path, work):
    distributed = pytest.importorskip("distributed")
    if work == "place":
        (tmp_path / "bend.yaml").write_text(JOB + PLACED)
        axes = [{"from": a, "to": b, "places": 3} for a, b in ((-0.03, 0.03), (0.6, 0.7))]
        small |= {"do": "place", "over": {"placement.over.x": axes}}
    want = rows(ac.batch(small, tmp_path / "here", workers=0))
    assert rows(ac.batch(small, tmp_path / "pool", workers=2)) == want
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        batch = ac.batch(small, tmp_path / "dask", cluster=cluster.scheduler_address)
    assert rows(batch) == want


ENDING = """
import os
from armcontour.batches.outcomes import Work

class Ending(Work):
    def __call__(self, index):
        return os._exit(3) if index == 1 else super().__call__(index)
"""


def test_a_job_that_ends_its_process_costs_itself_only(small, tmp_path, monkeypatch):
    (tmp_path / "ending.py").write_text(ENDING)
    monkeypatch.syspath_prepend(tmp_path)
    ending = importlib.import_module("ending")
    monkeypatch.setattr("armcontour.batches.runner.Work", ending.Ending)
    one = small | {"over": {"limits.speed": SPEEDS}}
    batch = ac.batch(one, tmp_path / "out", workers=2)
    assert [x["status"] for x in batch.rows] == ["done", "failed", *["done"] * 4]
    assert batch.errors == {"ProcessEnded": 1}


def test_a_killed_batch_continues(small, tmp_path):
    """`kill -9` of the parent, as the soak does at random moments."""
    (tmp_path / "plan.yaml").write_text(json.dumps(small))
    line = [sys.executable, "-c", "from armcontour.cli import main; main()", "batch", "plan.yaml"]
    environment = {"PYTHONPATH": os.pathsep.join(x for x in sys.path if x)}
    line += ["--out", "out", "--workers", "1"]
    with subprocess.Popen(line, cwd=tmp_path, env=os.environ | environment) as process:
        while process.poll() is None and not (tmp_path / "out/results.jsonl").exists():
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    batch = ac.batch(small, tmp_path / "out", workers=0)
    assert rows(batch) == rows(ac.batch(small, tmp_path / "whole", workers=0))
