"""Reads files with libraries that may fail or never end: in a limited process.

Two processes are started, where the system can fork. The first one, the guard, makes a folder and
waits. The second one reads. The guard ends the reader and removes the folder when the reader has
answered, and also when the process that asked ends for any reason, which closes a pipe.
"""

from __future__ import annotations

import importlib
import os
import pickle
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, NoReturn

from armcontour.core.errors import InvalidInput
from armcontour.core.pool import ENVIRONMENT, can_start

# Exit codes of the guard, besides 0.
FAILED = 1
TOO_LONG = 3
TOO_LARGE = 4
GIGABYTE = 1024**3


@dataclass(frozen=True, slots=True, kw_only=True)
class ReaderLimits:
    """Limits of a process that reads a file.

    Args:
        library: What reads the file, for messages.
        processor_time: Largest processor time [s].
        duration: Longest time, which also counts waiting [s].
        memory: Largest memory, with the libraries, and largest size of a written file [bytes].
    """

    library: str
    processor_time: int
    duration: float
    memory: int


class ReaderFailed(Exception):
    """The process has not answered; the text completes a sentence about the file."""


def read_in_process(module: str, question: Any, limits: ReaderLimits) -> Any:
    """Return the answer of a module's function `answer(question, folder)` from a limited process.

    Args:
        module: Name of the module.
        question: What is asked.
        limits: Limits of the process. Windows only limits the duration.

    Raises:
        InvalidInput: No process can be started.
        ReaderFailed: The process exceeded a limit, or failed.
    """
    if not can_start():
        raise InvalidInput(
            "This file is read by a process of Python, which cannot be started here. Run "
            "armcontour with Python."
        )
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        env={**os.environ, **ENVIRONMENT},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # Signals of the terminal and of the group do not reach the guard.
        start_new_session=True,
    )
    assert process.stdin is not None and process.stdout is not None
    # Closing the input ends the process.
    timer = threading.Timer(limits.duration, process.stdin.close)
    try:
        with suppress(BrokenPipeError):
            process.stdin.write(pickle.dumps((module, question, limits)))
            process.stdin.flush()
        timer.start()
        content = process.stdout.read()
        code = process.wait()
        late = process.stdin.closed
    finally:
        timer.cancel()
        with suppress(BrokenPipeError):
            process.stdin.close()
        process.stdout.close()
        process.wait()
    if code == 0:
        return pickle.loads(content)
    if code == TOO_LARGE:
        raise ReaderFailed(f"needs more than {limits.memory / GIGABYTE:.1f} GB of memory to read")
    if code == TOO_LONG:
        time = limits.duration if late else limits.processor_time
        raise ReaderFailed(f"takes more than {time:g} s to read")
    raise ReaderFailed(f"cannot be read, because {limits.library} failed")


def _guard() -> NoReturn:
    """Start the reader, and end it with its answer or with the process that asked."""
    module, question, limits = pickle.load(sys.stdin.buffer)
    # Libraries write messages to the standard output, which are not the answer.
    output = os.dup(sys.stdout.fileno())
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    folder = FilePath(tempfile.mkdtemp(prefix="armcontour-"))
    if not hasattr(os, "fork"):
        threading.Thread(target=_follow, args=(folder,), daemon=True).start()
        code = _read(module, question, folder, output)
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(code)
    end, reader_end = os.pipe()
    reader = os.fork()
    if reader == 0:
        _limit(limits)
        os._exit(_read(module, question, folder, output))
    os.close(reader_end)
    os.close(output)
    ready, _, _ = select.select([sys.stdin, end], [], [])
    os.kill(reader, signal.SIGKILL)
    status = os.waitpid(reader, 0)[1]
    shutil.rmtree(folder, ignore_errors=True)
    code = FAILED
    if os.WIFEXITED(status):
        code = os.WEXITSTATUS(status)
    elif sys.stdin in ready or os.WTERMSIG(status) == signal.SIGXCPU:
        code = TOO_LONG
    os._exit(code)


def _follow(folder: FilePath) -> None:
    """End this process when the input is closed."""
    sys.stdin.buffer.read()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(TOO_LONG)


def _limit(limits: ReaderLimits) -> None:
    """Set the limits of this process."""
    import resource

    time = limits.processor_time
    for kind, limit in (
        (resource.RLIMIT_CPU, (time, time + 1)),
        (resource.RLIMIT_AS, (limits.memory, limits.memory)),
        (resource.RLIMIT_FSIZE, (limits.memory, limits.memory)),
        (resource.RLIMIT_CORE, (0, 0)),
    ):
        # Some systems do not have all of these limits.
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, limit)


def _read(module: str, question: Any, folder: FilePath, output: int) -> int:
    """Write the answer of a module to the file descriptor `output`; returns the exit code."""
    try:
        answer = importlib.import_module(module).answer(question, folder)
        with open(output, "wb") as stream:
            pickle.dump(answer, stream, protocol=pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        return TOO_LARGE
    except Exception:
        return FAILED
    return 0


if __name__ == "__main__":
    _guard()
