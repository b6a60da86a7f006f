"""The command `batch`: its output, its files and its exit codes."""

import pytest
from tests.files.test_batch import FAR, JOB, REACHED

from armcontour.files import batch as module

OPTIONS = ("--over", "limits.speed=[20 mm/s, 0.1]", "--over", f"path.points={[REACHED, FAR]}")


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    return file


def test_batch_prints_and_writes_its_rows(command_in, file):
    call = ("batch", "job.yaml", *OPTIONS, "--set", "cycle=20 ms", "--out", "out", "--workers", "0")
    ended = command_in(file.parent, *call)
    assert ended.code == 0, ended.errors
    for words in ("job.yaml: 4 jobs: 2 done, 2 refused", "limits.speed", "NOT KEPT", "Job 2: "):
        assert words in ended.out
    page = (file.parent / "out" / "report.html").read_text()
    assert "20 mm/s" in page and "NOT KEPT" in page and "refused" in page
    again = command_in(file.parent, *call)
    assert again.code == 2 and "is not empty" in again.errors


def test_a_failed_job_of_a_batch_gives_exit_code_1_and_is_named(command_in, file, monkeypatch):
    def fail(job):
        raise MemoryError

    monkeypatch.setattr(module, "run", fail)
    call = ("batch", "job.yaml", *OPTIONS, "--out", "out", "--workers", "0")
    ended = command_in(file.parent, *call)
    assert ended.code == 1 and "Job 1: MemoryError" in ended.out


def test_a_drawing_is_run_on_a_cell(command_in, tmp_path):
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n0,0\n10,0\n")
    line = ("batch", "line.csv", "--cell", "pmk3s", "--over", "limits.speed=[20 mm/s, 40 mm/s]")
    ended = command_in(tmp_path, *line, "--out", "out", "--workers", "0")
    assert ended.code == 0 and "line.csv: 2 jobs: 2 done" in ended.out, ended.errors


def test_wrong_options_are_refused(refused, file):
    rows = [
        ("--over limits.speed=0.1", ["has no list. Write 'KEY=[VALUE, VALUE]'"]),
        ("--over limits.speed", ["--over", "Write KEY=VALUE"]),
        ("--over limits.speed=[0.1] --cell ur5e", ["only allowed with a drawing"]),
    ]
    assert refused(file.parent, rows, begin=("batch", "job.yaml", "--out", "out")) == []
