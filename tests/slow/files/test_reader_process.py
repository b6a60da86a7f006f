"""The process that reads files of others: its limits, and its end with the process that asked."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.slow.files import endless_reader

from armcontour.files.reader_process import ReaderFailed, ReaderLimits, read_in_process

MODULE = endless_reader.__name__
SMALL = ReaderLimits(library="It", processor_time=1, duration=60, memory=2 * 10**8)


@pytest.fixture(autouse=True)
def reader_is_found(monkeypatch):
    """The process imports the reader of these tests."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))


def left_folders(folder):
    return [str(x) for x in Path(folder).iterdir()]


def test_answers_come_back_and_nothing_stays(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    folder, what = read_in_process(MODULE, (None, "answer"), SMALL)
    assert what == "answer" and Path(folder).parent == tmp_path
    assert not left_folders(tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems limit less")
@pytest.mark.parametrize(
    ("what", "named"), [("work", "1 s"), ("grow", "0.2 GB"), ("fail", "It failed")]
)
def test_limits_end_the_process(what, named, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with pytest.raises(ReaderFailed, match=named):
        read_in_process(MODULE, (None, what), SMALL)
    assert not left_folders(tmp_path)


def test_waiting_has_a_limit(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    limits = ReaderLimits(library="It", processor_time=9, duration=0.5, memory=10**9)
    with pytest.raises(ReaderFailed, match="0.5 s"):
        read_in_process(MODULE, (None, "wait"), limits)
    assert not left_folders(tmp_path)


def is_running(pid):
    # A process that has ended may wait for its parent, without a command line.
    try:
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("what", ["wait", "work"])
def test_readers_end_with_the_process_that_asked(number, what, tmp_path):
    trace = tmp_path / "trace"
    folders = tmp_path / "folders"
    folders.mkdir()
    code = (
        "from armcontour.files.reader_process import *\n"
        "limits = ReaderLimits(library='It', processor_time=60, duration=60, memory=10**9)\n"
        f"read_in_process({MODULE!r}, ({str(trace)!r}, {what!r}), limits)"
    )
    environment = {**os.environ, "TMPDIR": str(folders)}
    command = [sys.executable, "-c", code]
    process = subprocess.Popen(
        command, env=environment, start_new_session=True, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while not (trace.exists() and trace.read_text().endswith("\n")):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    pid, folder = trace.read_text().split()
    assert is_running(pid) and left_folders(folders) == [folder]
    os.killpg(process.pid, number)
    process.wait(60)
    deadline = time.monotonic() + 20
    while is_running(pid) or left_folders(folders):
        assert time.monotonic() < deadline, f"{pid} is running, or {folders} is not empty"
        time.sleep(0.02)
