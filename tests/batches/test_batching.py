"""Batches: the same results wherever they are computed, and again where they were stopped."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import armcontour as ac
from armcontour.batches import read_plan
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


def _written(folder, text):
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


def test_threads_and_shards_give_the_same_rows(reference, small, tmp_path):
    want = rows(reference[0])
    with ThreadPoolExecutor(1) as executor:
        found = ac.batch(small, tmp_path / "threads", executor=executor, workers=1)
    assert rows(found) == want
    for k in (3, 1, 2):
        found = ac.batch(small, tmp_path / "shards", workers=0, shard=(k, 3))
        assert found.complete == (k == 2)
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
    # The usual figures have a page; nothing is varied along z.
    usual = {key: x for key, x in placing.items() if key != "columns"}
    row = next(ac.batch(usual, tmp_path / "usual", workers=0).rows())
    assert row["place.x"] is not None and row["place.z"] is None
    page = (tmp_path / "usual" / "report.html").read_text()
    assert "place.duration" in page and "gain" in page and "place.z" not in page


class Stop(Exception):
    pass


def stop_after(count):
    def progress(tally):
        if tally.done - tally.before >= count:
            raise Stop

    return progress


def test_a_stopped_batch_continues(reference, small, tmp_path, monkeypatch):
    monkeypatch.setattr("armcontour.batches.conducting.MOST", 1)
    told, out = [], tmp_path / "out"
    for parts in (0, 1):
        with pytest.raises(Stop):
            ac.batch(small, out, workers=0, progress=stop_after(3))
        assert not (out / "summary.json").exists()
        assert len(list((out / "parts").iterdir())) > parts
    found = ac.batch(small, out, workers=0, progress=told.append)
    assert rows(found) == rows(reference[0]) and 6 <= told[0].before < 12


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
    assert rows(ac.batch(small, tmp_path / "out", workers=0, progress=told.append)) == rows(found)
    assert told == []


def test_a_failure_of_the_program_is_a_row(small, tmp_path, monkeypatch):
    def fail(*_):
        raise KeyError("bug")

    monkeypatch.setattr("armcontour.batches.working.figures_of", fail)
    one = small | {"over": {}}
    found = ac.batch(one, tmp_path / "out", workers=0)
    (row,) = found.rows()
    assert (row["status"], row["error"]) == ("failed", "KeyError")
    assert row["tries (not reproducible)"] == 1


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


def test_a_batch_continues_from_the_files_of_a_moment(reference, small, tmp_path, monkeypatch):
    """A process that is killed leaves the files of that moment."""
    monkeypatch.setattr("armcontour.batches.conducting.MOST", 1)
    monkeypatch.setattr("armcontour.batches.batching.EVERY", 0.0)
    killed, told = tmp_path / "killed", []

    def copy(tally):
        if tally.done >= 6 and not killed.exists():
            shutil.copytree(tmp_path / "out", killed)

    ac.batch(small, tmp_path / "out", workers=0, progress=copy)
    assert not (killed / "summary.json").exists()
    found = ac.batch(small, killed, workers=0, progress=told.append)
    assert rows(found) == rows(reference[0])
    assert 0 < told[0].before < 12


def test_a_plan_is_read_from_a_file(small, tmp_path):
    (tmp_path / "plan.yaml").write_text(json.dumps(small))
    plan = read_plan(tmp_path / "plan.yaml")
    assert plan.name == "small" and list(plan.digests()) == list(read_plan(small).digests())


@pytest.mark.parametrize("linked", [False, True])
def test_foreign_files_are_refused_and_stay(planned, tmp_path, linked):
    plan = planned({"limits.speed": ["20 mm/s"]}, do="teach")
    # In the folder of the parts, without a plan.
    data, parts = tmp_path / "data", tmp_path / "foreign" / "parts"
    data.mkdir()
    parts.parent.mkdir()
    parts.symlink_to(data, target_is_directory=True) if linked else parts.mkdir()
    for name in ("precious.jsonl", "all-000001.jsonl"):
        own = parts / name
        own.write_text('{"key": "00", "status": "done", "error": null}\n')
        with pytest.raises(ac.InvalidInput):
            ac.batch(plan, parts.parent, workers=0)
        assert own.exists()
        own.unlink()
    # Beside a plan.
    ac.batch(plan, tmp_path / "out", workers=0)
    for name in ("plan.json", "summary.json", "report.html", "results.parquet"):
        own, elsewhere = tmp_path / "out" / name, tmp_path / name
        whole = own.read_bytes()
        own.rename(elsewhere) if linked else own.unlink()
        own.symlink_to(elsewhere) if linked else own.write_text('{"armcontour": "my experiment"}')
        text = own.read_bytes()
        with pytest.raises(ac.InvalidInput):
            ac.batch(plan, tmp_path / "out", workers=0)
        assert own.read_bytes() == text and own.is_symlink() == linked, name
        own.unlink()
        own.write_bytes(whole)


def test_damaged_results_are_refused_or_harmless(planned, tmp_path):
    plan = planned({"limits.speed": ["20 mm/s", "30 mm/s"]}, do="teach")
    want = rows(ac.batch(plan, tmp_path / "out", workers=0))
    (file,) = (tmp_path / "out").glob("results.*")
    whole, random = file.read_bytes(), np.random.default_rng(1)
    damaged = [whole[: random.integers(1, len(whole))] for _ in range(8)]
    for _ in range(8):
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
    assert refused > 10
    file.unlink()
    assert rows(ac.batch(plan, tmp_path / "out", workers=0)) == want
