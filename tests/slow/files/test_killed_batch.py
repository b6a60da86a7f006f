"""A batch of 100 jobs that is killed: no result is lost."""

import json
import signal
import subprocess
import sys
import time

from tests.files.test_batch import JOB

SPEEDS = [0.02 + 0.002 * k for k in range(25)]  # m/s
TOLERANCES = ["0.5 mm", "1 mm", "2 mm", "4 mm"]
LINE = [
    *(sys.executable, "-c", "from armcontour.cli import main; main()", "batch", "job.yaml"),
    *("--over", f"limits.speed={SPEEDS}", "--over", f"corners.tolerance=[{', '.join(TOLERANCES)}]"),
    *("--out", "out", "--workers", "2"),
]


def written(folder):
    file = folder / "out" / "results.jsonl"
    return file.read_bytes().split(b"\n")[:-1] if file.exists() else []


def test_a_killed_batch_loses_no_result(tmp_path):
    (tmp_path / "job.yaml").write_text(JOB)
    batch = subprocess.Popen(LINE, cwd=tmp_path, stdout=subprocess.DEVNULL)
    while len(written(tmp_path)) < 10:
        assert batch.poll() is None
        time.sleep(0.005)
    batch.send_signal(signal.SIGKILL)
    batch.wait()
    lines = [json.loads(x) for x in written(tmp_path)]
    assert 10 <= len(lines) < 100
    assert {x["status"] for x in lines} == {"done"}
    assert len({x["job"] for x in lines}) == len(lines)
