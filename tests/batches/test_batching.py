"""Batches: the same results wherever they are computed, and again where they were stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour._executors import Engine, InProcess
from armcontour.batches import read_plan, working
from armcontour.errors import InvalidInput

# Names of columns that may differ from one run to the next.
UNREPRODUCIBLE = "(not reproducible)"
OVER = {
    "limits.speed": {"from": "20 mm/s", "to": "0.1 m/s", "steps": 6},
    # The last one does not fit to the lines of 30 mm: refused, as it would end beyond them.
    "path.points": [
        [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]],
        [[0.30, 0.20], [0.33, 0.20], [0.93, 0.23]],
    ],
}


def rows(found):
    """The rows without what may differ."""
    return [{key: x for key, x in row.items() if UNREPRODUCIBLE not in key} for row in found.rows()]


@pytest.fixture(scope="module")
def small(jobs):
    return {"job": str(jobs / "bend.yaml"), "do": "teach", "over": OVER, "name": "small"}


@pytest.fixture(scope="module")
def reference(small, tmp_path_factory):
    """All results, computed in this process without interruption."""
    told = []
    found = ac.batch(
        small, tmp_path_factory.mktemp("whole") / "out", workers=0, progress=told.append
    )
    return found, told


def test_a_row_is_what_the_job_gives_alone(reference, jobs):
    found, told = reference
    text = (jobs / "bend.yaml").read_text()
    got = rows(found)
    assert [x["number"] for x in got] == list(range(1, 13)) and found.complete
    for row in got:
        points = json.loads(row["path.points"])
        job = text.replace("[[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]", str(points))
        job = job.replace("0.1 m/s", f"{row['limits.speed']!r} m/s")
        try:
            alone = ac.read_job(_written(jobs, job))
            duration = ac.jobs.teach(alone)["only"].trajectory.duration
        except ac.ArmContourError as error:
            assert (row["status"], row["error"]) == ("refused", type(error).__name__)
            assert row["sentence"] == str(error) and row["duration"] is None
        else:
            assert (row["status"], row["duration"]) == ("done", duration)
            assert row["corner_error"] == pytest.approx(1e-3)
    assert found.counts == {"done": 6, "refused": 6} and found.errors == {"Unreachable": 6}
    assert told[-1].done == told[-1].total == 12 and told[-1].left == 0.0
    assert told[-1].statuses == found.counts and told[-1].errors == found.errors
    assert repr(found) == "Batch('small', 12 jobs: 6 done, 6 refused)"


def _written(folder: FilePath, text: str) -> FilePath:
    (folder / "alone.yaml").write_text(text)
    return folder / "alone.yaml"


def test_all_is_in_the_folder_at_the_end(reference):
    found, _ = reference
    names = {x.name for x in found.folder.iterdir()}
    assert names == {"plan.json", "parts", "results.parquet", "report.html", "summary.json"}
    assert not list((found.folder / "parts").iterdir())
    import pyarrow.parquet as pq

    table = pq.read_table(found.folder / "results.parquet")
    assert table.to_pylist() == list(found.rows())
    assert table.schema.field("duration").metadata == {b"unit": b"s"}
    told = json.loads((found.folder / "summary.json").read_text())
    durations = [x["duration"] for x in found.rows() if x["duration"] is not None]
    assert told["figures"]["duration"]["least"]["value"] == min(durations)
    assert told["figures"]["duration"]["largest"]["limits.speed"] == 0.02
    assert told["statuses"] == found.counts and told["count"] == 12
    page = (found.folder / "report.html").read_text()
    assert "6 jobs" not in page and "12 of 12" in page and "http-equiv" not in page
    assert found.table()["number"] == list(range(1, 13))


def test_threads_processes_shards_and_dask_give_the_same_rows(reference, small, tmp_path):
    want = rows(reference[0])
    assert rows(ac.batch(small, tmp_path / "pool", workers=2)) == want
    with ThreadPoolExecutor(1) as executor:
        found = ac.batch(small, tmp_path / "threads", executor=executor, workers=1)
    assert rows(found) == want
    for k in (3, 1, 2):
        found = ac.batch(small, tmp_path / "shards", workers=0, shard=(k, 3))
        assert found.complete == (k == 2)
    assert rows(found) == want
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        found = ac.batch(small, tmp_path / "dask", cluster=cluster.scheduler_address)
    assert rows(found) == want


PLACED = """placement: {over: {x: {from: -30 mm, to: 30 mm, places: 3}}, refine: false}
"""


@pytest.fixture(scope="module")
def placing(jobs):
    """A plan that places a job, once along x and once out of reach."""
    (jobs / "placed.yaml").write_text((jobs / "bend.yaml").read_text() + PLACED)
    xs = [(-0.03, 0.03), (0.6, 0.7)]
    return {
        "job": str(jobs / "placed.yaml"),
        "do": "place",
        "over": {
            "limits.speed": [0.05, 0.1],
            "placement.over.x": [{"from": a, "to": b, "places": 3} for a, b in xs],
        },
        "columns": ["place.x", "place.yaw", "place.duration", "own.duration", "gain", "places",
                    "planned", "refused"],
    }  # fmt: skip


def test_places_are_those_of_the_jobs_alone(placing, jobs, tmp_path):
    found = ac.batch(placing, tmp_path / "here", workers=0)
    want = rows(found)
    assert [x["status"] for x in want] == ["done", "refused"] * 2
    assert "None of 3 places is feasible (3 by reach)" in want[1]["sentence"]
    text = (jobs / "placed.yaml").read_text()
    alone = ac.place(ac.read_job(_written(jobs, text.replace("0.1 m/s", "0.05 m/s"))))
    best, own = alone.refined.verdict.duration, alone.own.duration
    got = {x: want[0][x] for x in placing["columns"]}
    assert got == {
        "place.x": alone.best.values["x"],
        "place.yaw": None,
        "place.duration": best,
        "own.duration": own,
        "gain": 1 - best / own,
        "places": 3.0,
        "planned": float(alone.planned),
        "refused": 0.0,
    }
    assert rows(ac.batch(placing, tmp_path / "pool", workers=2)) == want
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        found = ac.batch(placing, tmp_path / "dask", cluster=cluster.scheduler_address)
    assert rows(found) == want


def test_usual_figures_of_a_place_have_a_page(placing, tmp_path):
    usual = {key: x for key, x in placing.items() if key != "columns"}
    found = ac.batch(usual, tmp_path / "out", workers=0)
    row = next(found.rows())
    assert row["place.x"] is not None and row["place.z"] is None
    page = (tmp_path / "out" / "report.html").read_text()
    # Nothing is varied along z.
    assert "place.duration" in page and "gain" in page and "place.z" not in page


class Stop(Exception):
    pass


def stop_after(count):
    def progress(tally):
        if tally.done - tally.before >= count:
            raise Stop

    return progress


def test_a_stopped_batch_goes_on_where_it_was(reference, small, tmp_path):
    before = -1
    for _ in range(20):
        told = []
        try:
            with pytest.raises(Stop):
                ac.batch(small, tmp_path / "out", workers=0, progress=stop_after(3))
            assert not (tmp_path / "out/summary.json").exists()
            parts = list((tmp_path / "out/parts").iterdir())
            assert len(parts) > before
            before = len(parts)
        except BaseException as error:
            assert "DID NOT RAISE" in str(error)
            break
    found = ac.batch(small, tmp_path / "out", workers=0, progress=told.append)
    assert rows(found) == rows(reference[0]) and told == []


def test_a_longer_plan_takes_what_is_there(small, tmp_path):
    ac.batch(small, tmp_path / "out", workers=0)
    more = small | {"over": OVER | {"limits.speed": {"from": 0.02, "to": 0.1, "steps": 11}}}
    told = []
    found = ac.batch(more, tmp_path / "out", workers=0, progress=told.append)
    # Every second speed was there.
    assert len(found.plan) == 22 and told[0].before == 12
    assert [x["limits.speed"] for x in found.rows()][::2] == pytest.approx(
        [0.02 + 0.008 * k for k in range(11)]
    )


def test_without_pyarrow_results_are_json_lines(reference, small, tmp_path, monkeypatch):
    monkeypatch.setattr("armcontour.batches.folder.ending", lambda: ".jsonl")
    monkeypatch.setattr("armcontour.batches.tables.BLOCK", 5)
    with pytest.raises(Stop):
        ac.batch(small, tmp_path / "out", workers=0, progress=stop_after(3))
    found = ac.batch(small, tmp_path / "out", workers=0)
    assert rows(found) == rows(reference[0])
    lines = (tmp_path / "out/results.jsonl").read_text().splitlines()
    assert [json.loads(x) for x in lines] == list(found.rows())
    # With pyarrow again, all that is there is taken.
    monkeypatch.undo()
    told = []
    assert rows(ac.batch(small, tmp_path / "out", progress=told.append)) == rows(found)
    assert told == []


def test_bounds_of_time_and_memory_cost_a_job_only(small, tmp_path):
    quick = small | {"limits": {"time": "10 us"}, "over": {"limits.speed": [0.02, 0.1]}}
    found = ac.batch(quick, tmp_path / "time", workers=0)
    assert found.counts == {"timed out": 2}
    row = next(found.rows())
    assert row["tries (not reproducible)"] == 3 and "limits.time" in row["sentence"]
    # What was tried in vain is a result, unless it is to be tried again.
    assert ac.batch(quick, tmp_path / "time", workers=0).counts == {"timed out": 2}
    longer = quick | {"limits": {"time": "60 s"}}
    assert ac.batch(longer, tmp_path / "time", workers=0).counts == {"timed out": 2}
    assert ac.batch(longer, tmp_path / "time", workers=0, retry=True).counts == {"done": 2}
    tight = small | {"limits": {"memory": "1 MB"}, "over": {"command_interval": "10 us"}}
    assert ac.batch(tight, tmp_path / "memory", workers=1).counts == {"out of memory": 1}


def test_a_failure_of_the_program_is_a_row(small, tmp_path, monkeypatch):
    def fail(*_):
        raise KeyError("bug")

    monkeypatch.setattr("armcontour.batches.working.figures_of", fail)
    one = small | {"over": {}}
    found = ac.batch(one, tmp_path / "out", workers=0)
    (row,) = found.rows()
    assert (row["status"], row["error"], row["tries (not reproducible)"]) == (
        "failed",
        "KeyError",
        1,
    )


def test_wrong_calls_are_refused(small, tmp_path, refuses):
    def refused(*words, out="out", **more):
        refuses(lambda: ac.batch(small, tmp_path / out, **more), InvalidInput, *words)

    refused("shard 4 of 3", shard=(4, 3))
    refused("workers must be 0 or more", workers=-1)
    refused("A cluster has its own workers", workers=1, cluster="tcp://127.0.0.1:1")
    (tmp_path / "file").touch()
    refused("is a file", out="file")
    refused("not empty", "no batch", out=".")
    twice = small | {"over": {"limits.speed": ["50 mm/s", 0.05]}}
    refuses(lambda: ac.batch(twice, tmp_path / "out"), InvalidInput, "jobs 1 and 2", "the same")
    assert not (tmp_path / "out").exists()


def test_a_killed_batch_goes_on_where_it_was(reference, small, tmp_path):
    """`kill -9` of the parent, as the soak does at random moments."""
    (tmp_path / "plan.yaml").write_text(json.dumps(small))
    code = "from armcontour.cli import main; main()"
    call = [sys.executable, "-c", code, "batch", "plan.yaml", "--out", "out", "--workers", "1"]
    where = {"PYTHONPATH": os.pathsep.join(x for x in sys.path if x)}
    with subprocess.Popen(call, cwd=tmp_path, env=os.environ | where) as process:
        while process.poll() is None and not (tmp_path / "out/plan.json").exists():
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert not (tmp_path / "out/summary.json").exists()
    assert rows(ac.batch(small, tmp_path / "out", workers=0)) == rows(reference[0])


def test_the_plan_is_what_its_file_says(small, tmp_path):
    (tmp_path / "plan.yaml").write_text(json.dumps(small))
    plan = read_plan(tmp_path / "plan.yaml")
    assert plan.name == "small" and list(plan.digests()) == list(read_plan(small).digests())


def test_only_workers_of_a_cluster_are_told_to_end_at_once(small, monkeypatch):
    told = []
    monkeypatch.setattr(working, "end_at_once", lambda: told.append(1))
    plan = read_plan(small)
    for remote, count in ((False, 0), (True, 1)):
        engine = Engine(InProcess(), 1, False, remote, "a test")
        working.work_on(plan, engine, [2]).prepare()
        assert len(told) == count


@pytest.mark.parametrize("linked", [False, True])
def test_files_of_others_in_parts_are_refused_and_stay(planned, tmp_path, linked):
    out, data = tmp_path / "out", tmp_path / "data"
    data.mkdir()
    out.mkdir()
    parts = out / "parts"
    parts.symlink_to(data, target_is_directory=True) if linked else parts.mkdir()
    own = parts / "precious.jsonl"
    own.write_text('{"key": "00", "status": "done", "error": null}\n')
    with pytest.raises(ac.InvalidInput):
        ac.batch(planned({"limits.speed": ["20 mm/s"]}, do="teach"), out, workers=0)
    assert own.exists()


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("name", ["plan.json", "summary.json", "report.html", "results.parquet"])
def test_files_of_others_beside_a_plan_are_refused_and_stay(planned, tmp_path, name, linked):
    plan = planned({"limits.speed": ["20 mm/s"]}, do="teach")
    ac.batch(plan, tmp_path / "out", workers=0)
    own, elsewhere = tmp_path / "out" / name, tmp_path / "elsewhere"
    own.rename(elsewhere) if linked else own.unlink()
    own.symlink_to(elsewhere) if linked else own.write_text('{"armcontour": "my experiment"}')
    text = own.read_bytes()
    with pytest.raises(ac.InvalidInput):
        ac.batch(plan, tmp_path / "out", workers=0)
    assert own.read_bytes() == text and own.is_symlink() == linked


def test_parts_without_a_plan_are_not_taken_for_those_of_a_batch(planned, tmp_path):
    part = tmp_path / "out" / "parts" / "all-000001.jsonl"
    part.parent.mkdir(parents=True)
    part.write_text("")
    with pytest.raises(ac.InvalidInput):
        ac.batch(planned({"limits.speed": ["20 mm/s"]}, do="teach"), tmp_path / "out", workers=0)
    assert part.exists()


def test_damaged_results_are_refused_or_harmless(planned, tmp_path):
    plan = planned({"limits.speed": ["20 mm/s", "30 mm/s"]}, do="teach")
    want = rows(ac.batch(plan, tmp_path / "out", workers=0))
    (file,) = (tmp_path / "out").glob("results.*")
    whole, random = file.read_bytes(), np.random.default_rng(1)
    damaged = [whole[: random.integers(1, len(whole))] for _ in range(15)]
    for _ in range(15):
        flipped = np.frombuffer(whole, np.uint8).copy()
        flipped[random.integers(0, len(whole), 3)] ^= random.integers(1, 256, 3, np.uint8)
        damaged.append(flipped.tobytes())
    refused = 0
    for content in (*damaged, b'{"key": 5}\n', b"[]\n"):
        file.write_bytes(content)
        try:
            assert rows(ac.batch(plan, tmp_path / "out", workers=0)) == want
        except ac.InvalidInput as error:
            refused += 1
            assert str(file) in str(error)
    assert refused > 20
    file.unlink()
    assert rows(ac.batch(plan, tmp_path / "out", workers=0)) == want
