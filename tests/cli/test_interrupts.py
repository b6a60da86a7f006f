"""Signals: every command ends within a second and leaves nothing half-written."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath

import pytest

from armcontour.cli.interrupts import run_interruptibly

# Compiled code that runs for minutes, and does not look at signals itself.
ENDLESS = """
import sys
from pathlib import Path
from armcontour._kernels import compiled
from armcontour.cli.interrupts import run_interruptibly
from armcontour.io import ResultFolder

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


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_compiled_code_is_interrupted(name: str, tmp_path: FilePath) -> None:
    number = signal.Signals[name]
    (tmp_path / "endless.py").write_text(ENDLESS, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, "endless.py", "deep/out"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A test may run where these are ignored.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    with process:
        assert process.stdout is not None and process.stdout.readline() == "working\n"
        time.sleep(0.3)
        begun = time.monotonic()
        process.send_signal(number)
        try:
            _, said = process.communicate(timeout=20)
        finally:
            process.kill()
    assert time.monotonic() - begun < 5.0
    assert process.returncode == 128 + number
    assert said == f"Interrupted ({name}): nothing was written to deep/out.\n"
    assert {x.name for x in tmp_path.iterdir()} <= {"endless.py", "__pycache__"}


def test_an_ignored_signal_stays_ignored(tmp_path: FilePath) -> None:
    code = "\n".join(
        (
            "import os, signal",
            "from armcontour.cli.interrupts import run_interruptibly",
            "signal.signal(signal.SIGHUP, signal.SIG_IGN)",
            "print(run_interruptibly(lambda: os.kill(os.getpid(), signal.SIGHUP) or 7))",
        )
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "7\n", done.stderr


def test_gives_the_exit_code_and_raises_errors() -> None:
    before = signal.getsignal(signal.SIGTERM)
    assert run_interruptibly(lambda: 3) == 3

    def broken() -> int:
        raise KeyError("broken")

    with pytest.raises(KeyError, match="broken"):
        run_interruptibly(broken)
    assert signal.getsignal(signal.SIGTERM) is before


SERVER = """
import sys, threading, time
from armcontour.cli.interrupts import before_interrupt, run_interruptibly

def work():
    with before_interrupt(lambda: 1 / 0), before_interrupt(lambda: time.sleep(60)):
        with before_interrupt(lambda: "The draft is kept."):
            print("working", flush=True)
            threading.Event().wait()

run_interruptibly(work)
"""


def test_what_has_to_be_tidied_up_is_and_may_say_so() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGTERM, signal.SIG_DFL),
    )
    with process:
        assert process.stdout is not None and process.stdout.readline() == "working\n"
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 128 + signal.SIGTERM
    assert said == "Interrupted (SIGTERM). The draft is kept.\n"
