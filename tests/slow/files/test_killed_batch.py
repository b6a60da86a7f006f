"""A batch of 100 jobs that is killed and continued: no job is lost, and none runs twice."""

import json
import signal
import subprocess
import sys
import time

from tests.files.test_batch import JOB

import armcontour as ac

SPEEDS, TOLERANCES = [0.02 + 0.002 * k for k in range(25)], ["0.5 mm", "1 mm", "2 mm", "4 mm"]
LINE = [
    *(sys.executable, "-c", "from armcontour.cli import main; main()", "batch", "job.yaml"),
    *("--over", f"limits.speed={SPEEDS}", "--over", f"corners.tolerance=[{', '.join(TOLERANCES)}]"),
    *("--out", "out", "--workers", "2"),
]


def written(folder):
    file = folder / "out" / "results.jsonl"
    return file.read_bytes().split(b"\n")[:-1] if file.exists() else []


def test_a_killed_batch_loses_no_job_and_runs_none_twice(tmp_path):
    (tmp_path / "job.yaml").write_text(JOB)
    for count in (10, 60):
        batch = subprocess.Popen(LINE, cwd=tmp_path, stdout=subprocess.DEVNULL)
        while len(written(tmp_path)) < count:
            assert batch.poll() is None
            time.sleep(0.005)
        batch.send_signal(signal.SIGKILL)
        batch.wait()
        assert count <= len(written(tmp_path)) < 100
    ended = subprocess.run(LINE, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0 and "100 jobs: 100 done" in ended.stdout, ended.stderr
    keys = [json.loads(x)["key"] for x in written(tmp_path)]
    assert len(keys) == len(set(keys)) == 100
    over = {"limits.speed": SPEEDS, "corners.tolerance": TOLERANCES}
    resumed = ac.batch(tmp_path / "job.yaml", over, tmp_path / "out", workers=0)
    assert len(written(tmp_path)) == 100
    assert resumed.table() == ac.batch(tmp_path / "job.yaml", over, workers=0).table()
