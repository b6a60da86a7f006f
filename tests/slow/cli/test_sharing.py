"""The results of a command are the same with no worker, two processes and a cluster."""

import pytest

from armcontour.core.errors import ExecutionError
from armcontour.core.pool import open_executor

JOB = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}}
"""
OVER = ("--over", "x: -30 mm .. 30 mm, 3", "--no-refine")


def test_results_do_not_depend_on_the_number_of_workers(command, tmp_path):
    distributed = pytest.importorskip("distributed")
    job = tmp_path / "job.yaml"
    job.write_text(JOB, encoding="utf-8")
    tables = []
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        worker_options = [
            ("--workers", 0),
            ("--workers", 2),
            ("--cluster", cluster.scheduler_address),
        ]
        for k, by in enumerate(worker_options):
            ended = command("place", job, "--out", tmp_path / str(k), *OVER, *by)
            assert ended.code == 0, ended.errors
            tables.append((tmp_path / str(k) / "placement.csv").read_bytes())
    assert tables[0] and tables[0] == tables[1] == tables[2]


def test_a_cluster_that_does_not_answer_is_refused(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("armcontour.core.pool.PATIENCE", "1s")
    with (
        pytest.raises(ExecutionError, match="No Dask scheduler answers at tcp://127.0.0.1:1 "),
        open_executor(None, "tcp://127.0.0.1:1"),
    ):
        pass
    # Dask leaves the loop of a client running that found no scheduler.
    for _, runner in list(distributed.utils.LoopRunner._all_loops.values()):
        runner.stop()
