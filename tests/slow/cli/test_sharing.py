"""The results of a command are the same with no worker, two processes and a cluster."""

import pytest

from armcontour.core.errors import ExecutionError
from armcontour.core.pool import open_executor

JOB = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2, joint_torque: 40}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 2 ms}
certificate:
  plant: rigid_body
  servo_error: 0.3 mm
  samples: 50
  bodies: 3
  corners: 4
  box: {gains: 5 %, payload: [0 kg, 0.5 kg]}
experiment: {step: 1 ms}
runs:
  only: {compensation: {method: inverse_dynamics}}
"""
# By command, its further options and the file that is compared.
COMMANDS = {
    "place": (("--over", "x: -30 mm .. 30 mm, 3", "--no-refine"), "placement.csv"),
    "certify": ((), "only/set_points.csv"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_results_do_not_depend_on_the_number_of_workers(command, tmp_path, name):
    distributed = pytest.importorskip("distributed")
    job = tmp_path / "job.yaml"
    job.write_text(JOB, encoding="utf-8")
    options, file = COMMANDS[name]
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
            ended = command(name, job, "--out", tmp_path / str(k), *options, *by)
            assert ended.code == 0, ended.errors
            tables.append((tmp_path / str(k) / file).read_bytes())
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
