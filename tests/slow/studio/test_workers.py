"""The process of the task worker: cancelled, killed, and orphaned."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.studio.session_pages import figure
from tests.studio.test_workers import Heard

from armcontour.studio.tasks.dispatch import WARMUP_JOB
from armcontour.studio.workers import TaskWorker

# A zigzag with the shape free takes far longer than any of these tests.
POINTS = [[0.3 + 0.0002 * k, 0.2 + 0.002 * (k % 2)] for k in range(400)]
LONG = {
    "text": WARMUP_JOB.replace("[[0.35, 0.1], [0.4, 0.15], [0.35, 0.2]]", str(POINTS)).replace(
        "{tolerance: 1 mm}", "{tolerance: 1 mm, shape: free}"
    )
}


@pytest.fixture(scope="module")
def heard():
    return Heard()


@pytest.fixture(scope="module")
def slow(heard):
    lane = TaskWorker(heard)
    yield lane
    lane.close()


def test_a_process_that_dies_is_reported_and_replaced(slow, heard):
    slow.submit("g", "figures", LONG)
    heard.wait("g", "progress")
    os.kill(slow._process._process.pid, signal.SIGKILL)
    assert (
        "ended before its work was done (exit code -9)"
        in (heard.wait("g", "failed").header["sentence"])
    )
    slow.submit("h", "figures", {"text": WARMUP_JOB})
    assert figure(heard.wait("h", "figures").header, "duration") > 0


CODE = """
import time
from armcontour.studio.workers import TaskWorker
from tests.slow.studio.test_workers import LONG
lane = TaskWorker(lambda frame: print(lane._process._process.pid, flush=True))
lane.submit('a', 'figures', LONG)
time.sleep(60)
"""


def test_a_worker_ends_with_the_process_that_started_it():
    root = Path(__file__).parents[3]
    first = subprocess.Popen(
        [sys.executable, "-c", CODE], stdout=subprocess.PIPE, cwd=root, text=True
    )
    other = int(first.stdout.readline())
    first.kill()
    first.wait()
    first.stdout.close()
    end = time.monotonic() + 20
    while is_running(other):
        assert time.monotonic() < end
        time.sleep(0.05)


def is_running(process):
    """Whether there is a process that has not ended."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"
