"""`--workers` and `--cluster`: the same results whoever works."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from armcontour.cli.sharing import open_executor
from armcontour.errors import ExecutionError

JOB = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2, joint_torque: 40}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 2 ms}
certificate:
  plant: rigid_body
  servo: 0.3 mm
  samples: 50
  bodies: 3
  corners: 4
  box: {gains: 5 %, payload: [0 kg, 0.5 kg]}
experiment: {step: 1 ms}
runs:
  only: {compensation: {method: inverse_dynamics}, timing: {intervals: 100}}
"""
# By command, its further options and the file that is compared.
COMMANDS = {
    "place": (("--over", "x: -30 mm .. 30 mm, 3", "--no-refine"), "placement.csv"),
    "sweep": (("--no-certify", "--tolerances", "1 mm, 2 mm", "--speeds", "0.1 m/s"), "sweep.csv"),
    "certify": ((), "only/taught.csv"),
}


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("shared") / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address of a cluster of one worker in this process."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.parametrize("name", COMMANDS)
def test_whoever_works_the_results_are_the_same(command, job, address, tmp_path, name) -> None:
    options, file = COMMANDS[name]
    found = []
    for k, by in enumerate([("--workers", 0), ("--workers", 2), ("--cluster", address)]):
        ended = command(name, job, "--out", tmp_path / str(k), *options, *by)
        assert ended.code == 0, ended.errors
        found.append((tmp_path / str(k) / file).read_bytes())
    assert found[0] and found[0] == found[1] == found[2]


def test_the_old_name_of_workers_stays(command, job, tmp_path) -> None:
    options, file = COMMANDS["place"]
    ended = command("place", job, "--out", tmp_path / "old", *options, "--processes", 1)
    assert ended.code == 0 and (tmp_path / "old" / file).exists(), ended.errors


@pytest.mark.parametrize("name", COMMANDS)
def test_a_cluster_has_its_own_workers(command, job, tmp_path, name) -> None:
    options, _ = COMMANDS[name]
    both = ("--cluster", "tcp://127.0.0.1:1", "--workers", 2)
    ended = command(name, job, "--out", tmp_path / "out", *options, *both)
    assert ended.code == 2 and "A cluster has its own workers: leave workers" in ended.errors
    assert not (tmp_path / "out").exists()


def test_a_certificate_without_such_robots_has_no_work_for_others(command, job, tmp_path) -> None:
    ended = command("certify", job, "--plant", "servo", "--workers", 2)
    assert ended.code == 2
    assert "--workers and --cluster share robots of a box that are executed" in ended.errors


def test_a_cluster_that_is_not_there_is_one_sentence(monkeypatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("armcontour._executors.PATIENCE", "1s")
    with (
        pytest.raises(ExecutionError, match="No Dask scheduler answers at tcp://127.0.0.1:1 "),
        open_executor(None, "tcp://127.0.0.1:1"),
    ):
        pass
