"""Batches: the same results wherever they are computed, and again where they were stopped."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyarrow.parquet
import pytest

import armcontour as ac
from armcontour.batches import read_plan
from armcontour.batches.columns import COLUMNS, figures_of
from armcontour.core.errors import InvalidInput

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


def rows(batch):
    """The rows without what may differ."""
    return [{key: x for key, x in row.items() if UNREPRODUCIBLE not in key} for row in batch.rows]


@pytest.fixture(scope="module")
def small(jobs):
    return {"job": str(jobs / "bend.yaml"), "do": "compensate", "over": OVER, "name": "small"}


@pytest.fixture(scope="module")
def reference(small, tmp_path_factory):
    """All results, computed in this process without interruption."""
    progress_log = []
    batch = ac.batch(
        small, tmp_path_factory.mktemp("whole") / "out", workers=0, progress=progress_log.append
    )
    return batch, progress_log


def test_a_row_is_what_the_job_gives_alone(reference, jobs):
    batch, events = reference
    text = (jobs / "bend.yaml").read_text()
    got = rows(batch)
    assert [x["number"] for x in got] == list(range(1, 13))
    for row in got:
        points = json.loads(row["path.points"])
        job = text.replace("[[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]", str(points))
        job = job.replace("0.1 m/s", f"{row['limits.speed']!r} m/s")
        try:
            alone = ac.read_job(_written(jobs, job))
            duration = ac.jobs.run(alone, simulate=False).runs["only"].trajectory.duration
        except ac.ArmContourError as error:
            assert (row["status"], row["error"]) == ("refused", type(error).__name__)
            assert row["sentence"] == str(error) and row["duration"] is None
        else:
            assert (row["status"], row["duration"]) == ("done", duration)
            assert row["corner_error"] == pytest.approx(1e-3)
    assert batch.counts == {"done": 6, "refused": 6} and batch.errors == {"Unreachable": 6}
    assert events[-1].done == events[-1].total == 12 and events[-1].left == 0.0
    assert events[-1].statuses == batch.counts and events[-1].errors == batch.errors
    assert repr(batch) == "Batch('small', 12 jobs: 6 done, 6 refused)"


def _written(folder, text):
    (folder / "alone.yaml").write_text(text)
    return folder / "alone.yaml"


def test_all_is_in_the_folder_at_the_end(reference):
    batch, _ = reference
    names = {x.name for x in batch.folder.iterdir()}
    assert names == {"results.jsonl", "results.parquet", "report.html"}
    lines = (batch.folder / "results.jsonl").read_text().splitlines()
    assert [json.loads(x) for x in lines] == batch.rows
    table = pyarrow.parquet.read_table(batch.folder / "results.parquet")
    assert table.to_pylist() == batch.rows
    assert table.schema.field("duration").metadata == {b"unit": b"s"}
    page = (batch.folder / "report.html").read_text()
    assert "12 jobs" in page and "Unreachable" in page
    assert batch.table()["number"] == list(range(1, 13))


def test_threads_give_the_same_rows(reference, small, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        batch = ac.batch(small, tmp_path / "threads", executor=executor)
    assert rows(batch) == rows(reference[0])


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
        "columns": ["best.place.x", "best.place.yaw", "best.duration", "own_place.duration",
                    "gain", "places", "planned", "refused_places"],
    }  # fmt: skip


def test_places_are_those_of_the_jobs_alone(placing, jobs, tmp_path):
    batch = ac.batch(placing, tmp_path / "here", workers=0)
    want = rows(batch)
    assert [x["status"] for x in want] == ["done", "refused"] * 2
    assert "None of 3 places is feasible (refused: 3 by reach)" in want[1]["sentence"]
    text = (jobs / "placed.yaml").read_text()
    alone = ac.place(ac.read_job(_written(jobs, text.replace("0.1 m/s", "0.05 m/s"))))
    best, own_place = alone.refined.verdict.duration, alone.own.duration
    got = {x: want[0][x] for x in placing["columns"]}
    assert got == {
        "best.place.x": alone.best.values["x"],
        "best.place.yaw": None,
        "best.duration": best,
        "own_place.duration": own_place,
        "gain": 1 - best / own_place,
        "places": 3.0,
        "planned": float(alone.planned),
        "refused_places": 0.0,
    }
    # The usual figures have a page; nothing is varied along z.
    usual = {key: x for key, x in placing.items() if key != "columns"}
    row = ac.batch(usual, tmp_path / "usual", workers=0).rows[0]
    assert row["best.place.x"] is not None and row["best.place.z"] is None
    page = (tmp_path / "usual" / "report.html").read_text()
    assert "best.duration" in page and "gain" in page and "best.place.z" not in page


def results(jobs):
    """Results of each kind of work for the small job."""
    text = (jobs / "bend.yaml").read_text()
    job = ac.read_job(_written(jobs, text + PLACED + "experiment: {}\n"))
    yield "run", ac.run(job).runs["only"]
    yield "certify", ac.certify(job, goal=ac.CertificateGoal(tolerance=1.2e-3))
    yield "place", ac.place(job)


def test_columns_are_rows_of_results_with_their_units(jobs):
    # The arm is planar, and the part is moved along x only.
    unknown = {"orientation_error.max", *(f"best.place.{x}" for x in ("y", "z", "yaw", "tilt"))}
    names_in_rows = set()
    for work, result in results(jobs):
        rows = dict(result.to_data().walk())
        if work == "certify":
            rows = dict(result.result.to_data().walk()) | rows
        # The figures are those of the worse execution.
        run = result.result if work == "certify" else result
        if work in ("run", "certify") and run.judged is not run.evaluation:
            bodies = run.experiment.evaluation.to_data()
            rows |= {x.name: x for x in bodies.rows if x.value is not None}
        columns = [name for name, x in COLUMNS.items() if x.is_computed_by(work)]
        figures = dict(zip(columns, figures_of(result, columns, work), strict=True))
        for name in columns:
            if name in rows:
                names_in_rows.add(name)
                assert rows[name].unit == COLUMNS[name].unit, name
                assert figures[name] == rows[name].figure, name
    assert set(COLUMNS) - names_in_rows == unknown


class Stop(Exception):
    pass


def stop_after(count):
    def progress(tally):
        if tally.done - tally.before >= count:
            raise Stop

    return progress


def test_a_stopped_batch_continues(reference, small, tmp_path):
    events, out = [], tmp_path / "out"
    for count in (3, 6):
        with pytest.raises(Stop):
            ac.batch(small, out, workers=0, progress=stop_after(3))
        assert len((out / "results.jsonl").read_text().splitlines()) == count
        assert not (out / "report.html").exists()
        if count == 3:
            # An editor may change how lines end.
            rows_file = out / "results.jsonl"
            rows_file.write_bytes(rows_file.read_bytes().replace(b"\n", b"\r\n"))
    # A process that is killed may leave half a row.
    file = out / "results.jsonl"
    file.write_bytes(file.read_bytes()[:-20])
    batch = ac.batch(small, out, workers=0, progress=events.append)
    assert rows(batch) == rows(reference[0]) and events[0].before == 5


def test_a_longer_plan_takes_what_is_there(small, tmp_path):
    ac.batch(small, tmp_path / "out", workers=0)
    more = small | {"over": OVER | {"limits.speed": {"from": 0.02, "to": 0.1, "steps": 11}}}
    events = []
    batch = ac.batch(more, tmp_path / "out", workers=0, progress=events.append)
    # Every second speed was there.
    assert len(batch.plan) == 22 and events[0].before == 12
    assert [x["limits.speed"] for x in batch.rows][::2] == pytest.approx(
        [0.02 + 0.008 * k for k in range(11)]
    )


def test_without_pyarrow_results_are_json_lines(reference, small, tmp_path, monkeypatch):
    monkeypatch.setattr("armcontour.batches.outcomes.find_spec", lambda name: None)
    batch = ac.batch(small, tmp_path / "out", workers=0)
    assert rows(batch) == rows(reference[0])
    names = {x.name for x in batch.folder.iterdir()}
    assert names == {"results.jsonl", "report.html"}


def test_a_failure_of_the_program_is_a_row(small, tmp_path, monkeypatch):
    def fail(*_):
        raise KeyError("bug")

    one = small | {"over": {}}
    with monkeypatch.context() as patched:
        patched.setattr("armcontour.batches.outcomes.figures_of", fail)
        (row,) = ac.batch(one, tmp_path / "out", workers=0).rows
    assert (row["status"], row["error"]) == ("failed", "KeyError")
    # It has a result, unless it is to be tried again.
    assert ac.batch(one, tmp_path / "out", workers=0).counts == {"failed": 1}
    assert ac.batch(one, tmp_path / "out", workers=0, retry=True).counts == {"done": 1}


def test_wrong_calls_are_refused(small, tmp_path, refuses):
    def refused(*words, out="out", **more):
        refuses(lambda: ac.batch(small, tmp_path / out, **more), InvalidInput, *words)

    refused("workers must be 0 or more", workers=-1)
    refused("has its own workers", workers=1, cluster="tcp://127.0.0.1:1")
    (tmp_path / "file").touch()
    refused("is a file", out="file")
    refused("not empty", out=".")
    assert not (tmp_path / "out").exists()


def test_a_plan_is_read_from_a_file(small, tmp_path):
    (tmp_path / "plan.yaml").write_text(json.dumps(small))
    plan = read_plan(tmp_path / "plan.yaml")
    assert plan.name == "small" and plan.job_keys() == read_plan(small).job_keys()


def test_foreign_and_damaged_results_are_refused_and_stay(planned, tmp_path):
    plan = planned({"limits.speed": ["20 mm/s", "30 mm/s"]}, do="compensate")
    want = rows(ac.batch(plan, tmp_path / "out", workers=0))
    file = tmp_path / "out" / "results.jsonl"
    whole, random = file.read_bytes(), np.random.default_rng(1)
    damaged = [b'{"key": 5}\n', b"[]\n", b"a, b\n1, 2\n", b"\xff\xfe\n", b"\n" + whole]
    damaged.append(whole.replace(b"done", b"fine"))
    for content in damaged:
        file.write_bytes(content)
        with pytest.raises(ac.InvalidInput, match=r"results\.jsonl, line 1"):
            ac.batch(plan, tmp_path / "out", workers=0)
        assert file.read_bytes() == content
    for _ in range(8):
        # Cut off anywhere, what is left is taken.
        file.write_bytes(whole[: random.integers(1, len(whole))])
        assert rows(ac.batch(plan, tmp_path / "out", workers=0)) == want
