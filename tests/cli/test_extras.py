"""Without an extra: the demo does all that needs none, and other commands name what they lack."""

from __future__ import annotations

import dataclasses
import json
import sys
import tomllib
from pathlib import Path as FilePath
from typing import Any

import pytest

from armcontour.cli import running
from armcontour.jobs import Job

ROOT = FilePath(__file__).parents[2]
# Extras for those who develop armcontour.
FOR_DEVELOPERS = {"browser", "test", "docs", "bench", "dev"}
JOB = """name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.10 m/s}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 20 ms
runs: {plain: {compensation: {method: none}}}
"""
CLUSTER = ("--cluster", "tcp://127.0.0.1:1")
# By extra: a library that it brings, and command lines that need it.
NEEDS = {
    "experiment": (
        "mujoco",
        [
            ["run", "bodies.yaml", "--out", "out"],
            ["certify", "job.yaml", "--servo", "1 mm", "--plant", "rigid_body"],
        ],
    ),
    "drawings": ("ezdxf", [["show", "a.dxf"], ["run", "a.dxf", "--cell", "ur5e", "--out", "out"]]),
    "ros": (
        "rosbags.typesys",
        [
            ["check", "a.mcap", "--arm", "pmk3s"],
            ["run", "job.yaml", "-o", "out", "--export", "mcap"],
        ],
    ),
    "tables": (
        "pyarrow",
        [["show", "a.parquet"], ["run", "job.yaml", "-o", "out", "--export", "parquet"]],
    ),
    "cluster": (
        "distributed",
        [
            ["batch", "plan.yaml", "-o", "out", *CLUSTER],
            ["sweep", "job.yaml", "-o", "out", "--no-certify", *CLUSTER],
            ["place", "job.yaml", "-o", "out", "--over", "x: 0 mm .. 1 mm, 2", *CLUSTER],
            ["certify", "job.yaml", "--servo", "1 mm", *CLUSTER],
        ],
    ),
    "studio": ("uvicorn", [["studio", "--no-open"]]),
}


@pytest.fixture
def folder(tmp_path: FilePath) -> FilePath:
    """A folder with the files of these command lines; those of other formats are empty."""
    (tmp_path / "job.yaml").write_text(JOB)
    (tmp_path / "bodies.yaml").write_text(f"{JOB}experiment: {{}}\n")
    (tmp_path / "plan.yaml").write_text("job: job.yaml\nover: {servo.kp: [20 1/s, 25 1/s]}\n")
    for name in ("a.dxf", "a.mcap", "a.parquet"):
        (tmp_path / name).write_bytes(b"")
    return tmp_path


def test_every_extra_of_users_is_tested() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert set(project["optional-dependencies"]) - FOR_DEVELOPERS == set(NEEDS)


@pytest.mark.parametrize(
    ("extra", "library", "line"),
    [(extra, library, line) for extra, (library, lines) in NEEDS.items() for line in lines],
    ids=lambda x: x[0] if isinstance(x, list) else x,
)
def test_a_missing_extra_is_one_sentence(
    command_in: Any,
    folder: FilePath,
    monkeypatch: pytest.MonkeyPatch,
    extra: str,
    library: str,
    line: list[str],
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    ended = command_in(folder, *line)
    assert ended.code == 2
    assert f"pip install 'armcontour[{extra}]'" in ended.errors
    assert library.partition(".")[0] in ended.errors
    errors = [x for x in ended.errors.splitlines() if x.startswith("Error: ")]
    assert len(errors) == 1 and "Traceback" not in ended.errors
    assert not (folder / "out").exists()


def test_the_demo_without_mujoco_is_the_demo_without_its_experiments(
    command_in: Any, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = running.built_in_job()
    few = [x for x in whole.runs if x.name in ("uncompensated", "inverse-dynamics", "optimal")]
    coarse = tuple(dataclasses.replace(x, period=4e-3) for x in few)
    job: Job = dataclasses.replace(whole, runs=coarse, published=None)
    monkeypatch.setattr(running, "built_in_job", lambda: job)
    found, said = {}, {}
    for name in ("with", "without"):
        with monkeypatch.context() as there:
            if name == "without":
                there.setitem(sys.modules, "mujoco", None)
            ended = command_in(tmp_path, "demo", "--out", name)
        assert ended.code == 0, ended.errors
        said[name] = " ".join(ended.out.split())
        found[name] = json.loads((tmp_path / name / "summary.json").read_text())["runs"]
        assert (tmp_path / name / "report.html").stat().st_size > 1e6
    assert "pip install" not in said["with"]
    assert said["without"].count("pip install 'armcontour[experiment]'") == 1
    assert "the run inverse-dynamics, which only these judge" in said["without"]
    # A hint for jobs of users; nobody can change this one.
    assert "give the job an experiment" not in said["without"]
    assert list(found["with"]) == ["uncompensated", "optimal", "inverse-dynamics"]
    assert list(found["without"]) == ["uncompensated", "optimal"]
    for name, run in found["without"].items():
        there = found["with"][name]
        assert there.pop("experiment")
        assert run == there
