"""After a signal, each command ends within a second without incomplete files."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from armcontour.files import ResultFolder

# Compiled code that runs for minutes, and does not look at signals itself.
ENDLESS = """
import sys
from pathlib import Path
from armcontour.core.kernel_cache import compiled
from armcontour.cli.interruption import run_interruptibly
from armcontour.files import ResultFolder

@compiled()
def turn(x):
    for i in range(1_000_000_000_000):
        x = (x * 1.000001 + i) % 7.0
    return x

def work():
    with ResultFolder(Path(sys.argv[1])) as folder:
        folder.write("report.html", "half")
        print("working", flush=True)
        turn(1.0)
    return 0

if __name__ == "__main__":
    sys.exit(run_interruptibly(work))
"""
LINES = "\n".join(f"G0 X0 Y{y}\nG1 X80 Y{y}\nG1 X80 Y{y}.5" for y in range(80))


@contextlib.contextmanager
def started(folder, number, *arguments):
    """A Python process in which a signal is not ignored; it is killed at the end."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A test may run where it is ignored.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_compiled_code_is_interrupted(name, tmp_path):
    number = signal.Signals[name]
    (tmp_path / "endless.py").write_text(ENDLESS, encoding="utf-8")
    with started(tmp_path, number, "endless.py", "deep/out") as process:
        assert process.stdout.readline() == "working\n"
        time.sleep(0.3)
        begun = time.monotonic()
        process.send_signal(number)
        _, errors = process.communicate(timeout=20)
    assert time.monotonic() - begun < 5.0
    assert process.returncode == 128 + number
    assert errors == f"Interrupted ({name}): nothing was written to deep/out.\n"
    assert {x.name for x in tmp_path.iterdir()} <= {"endless.py", "__pycache__"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda x: x.name)
def test_an_interrupted_run_leaves_the_earlier_result_and_nothing_else(number, tmp_path):
    (tmp_path / "long.ngc").write_text(f"G21 F3000\n{LINES}\n")
    out = tmp_path / "out"
    with ResultFolder(out) as results:
        results.write("old.txt", "old")
        results.write("summary.json", "{}")
    earlier = {x.name: x.read_text() for x in out.iterdir()}
    line = "-m armcontour run long.ngc --cell ur5e --out out --force --export csv"
    with started(tmp_path, number, *line.split()) as process:
        while not list(out.glob(".armcontour-*")):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number, errors
    assert "Traceback" not in errors
    assert {x.name: x.read_text() for x in out.iterdir()} == earlier


def test_output_that_cannot_be_written_is_refused():
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    command = [sys.executable, "-m", "armcontour", "schema"]
    with open("/dev/full", "w") as stream:
        outcome = subprocess.run(command, stdout=stream, stderr=subprocess.PIPE, text=True)
    assert outcome.returncode == 1
    assert outcome.stderr.startswith("Error: ") and outcome.stderr.count("\n") == 1


def test_a_pipe_that_ends_early_has_its_exit_code():
    command = [sys.executable, "-m", "armcontour", "schema"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as done:
        done.stdout.close()
        assert done.stderr.read() == b""
    assert done.returncode == 141
