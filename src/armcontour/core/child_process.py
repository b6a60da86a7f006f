"""Child Python processes: start, end and communication.

A child runs a separate program that does not import the main script, so scripts need no
`if __name__ == "__main__"`. A child ends when its parent process ends for any reason, because the
input of the child is then closed.
"""

from __future__ import annotations

import atexit
import copyreg
import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from types import MappingProxyType
from typing import IO, Any, TypeAlias

from armcontour.core.errors import ExecutionError
from armcontour.core.progress import listen_to_compilation

Packed: TypeAlias = tuple[bytes, tuple[bytes, ...]]
SERVE = "from armcontour.core.child_process import serve; serve()"
# Thresholds of the garbage collector. A program of thousands of contours has millions of objects
# without cycles; with the default thresholds, collection takes as long as reading the drawing.
GARBAGE = (20_000, 20, 50)
# Environment variables that limit libraries to one thread per process; only `map_in_threads` uses
# several threads.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def frozen_mapping(mapping: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """Read-only copy of a mapping."""
    return MappingProxyType(dict(mapping))


# Pickle does not support read-only mappings, but some pickled dataclasses have such fields.
copyreg.pickle(MappingProxyType, lambda x: (frozen_mapping, (dict(x),)))


class ProcessEnded(ExecutionError):
    """A child process ended before its work was done."""


class _Serving:
    """State of this process, and of its threads, as workers for other processes."""

    # here: True in a child process, which starts no further processes.

    here = False
    # Per thread: `busy` is True while the thread works for an executor.
    threads = threading.local()
    # Stream for results to the parent process.
    answers: IO[bytes] | None = None


def processors() -> int:
    """Number of processors available to this process."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def can_start() -> bool:
    """True if child processes can be started; a frozen application has no Python interpreter."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def is_child() -> bool:
    """True if this process or thread works for another process."""
    return _Serving.here or getattr(_Serving.threads, "busy", False)


@contextmanager
def child_context() -> Iterator[None]:
    """Context in which this thread works for another process and starts no processes."""
    before = getattr(_Serving.threads, "busy", False)
    _Serving.threads.busy = True
    try:
        yield
    finally:
        _Serving.threads.busy = before


def skip_exit_collection() -> None:
    """Skip garbage collection at exit, which saves about 0.5 s."""
    atexit.register(gc.freeze)


def reduce_garbage_collection() -> None:
    """Run the garbage collector less often, because most objects are in no cycles."""
    gc.set_threshold(*GARBAGE)


def import_path(*refused: str) -> list[str]:
    """Import path without relative folders, the current folder and further excluded folders."""
    # Files in these folders could replace modules of Python and of libraries.
    package_parent = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))

    def is_kept(folder: str) -> bool:
        out = any(_is_same(folder, x) for x in (os.curdir, *refused))
        return folder == package_parent or (os.path.isabs(folder) and not out)

    return [*([] if package_parent in sys.path else [package_parent]), *filter(is_kept, sys.path)]


def _is_same(one: str, other: str) -> bool:
    """True if two paths are the same existing folder."""
    with suppress(OSError):
        return os.path.samefile(one, other)
    return False


def start() -> subprocess.Popen[bytes]:
    """Start a child process; it imports nothing from the current folder."""
    overrides = {"PYTHONPATH": os.pathsep.join(import_path())} | dict.fromkeys(THREADS, "1")
    return subprocess.Popen(
        [sys.executable, "-P", "-c", SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | overrides,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def end(child: subprocess.Popen[bytes]) -> None:
    """Kill a process and close its pipes."""
    child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        # Closing flushes data, which no process reads any more.
        with suppress(OSError):
            pipe.close()


def serve() -> None:
    """Main loop of a child process: run incoming work until the input ends."""
    _Serving.here = True
    reduce_garbage_collection()
    # The terminal interrupts all processes, but only the main process handles interrupts.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = _Serving.answers = os.fdopen(os.dup(1), "wb")
    # Text that libraries print must not mix with the results.
    os.dup2(2, 1)
    # Compilation in a child process is not reported to the user.
    with listen_to_compilation(lambda name: None), suppress(EOFError, OSError):
        while True:
            work = pickle.load(sys.stdin.buffer)
            try:
                answer = pickle.dumps((True, unpack(work)()))
            except Exception as error:
                answer = pickle.dumps((False, f"{type(error).__name__}: {error}"))
            _write(answers, answer)


def report_to_parent(value: Any) -> None:
    """Send a picklable value to the parent process, for `heard` of `submit_reporting`."""
    if _Serving.answers is not None:
        _write(_Serving.answers, pickle.dumps((None, value)))


def call(
    child: subprocess.Popen[bytes], work: Callable[[], Any], heard: Callable[[Any], None]
) -> Any:
    """Run work with read-only arrays in a child process; `heard` receives its reports."""
    assert child.stdin is not None and child.stdout is not None
    packed = pickle.dumps(pack(work))
    try:
        _write(child.stdin, packed)
        while (answer := pickle.load(child.stdout))[0] is None:
            heard(answer[1])
    except BaseException as error:
        # The process is killed, because the next call would read the remainder of this result.
        child.kill()
        child.wait()
        if not isinstance(error, EOFError | OSError | pickle.UnpicklingError):
            raise
        raise ProcessEnded(
            "Another process of this work ended before it returned a result, for example "
            "because memory ran out. Use fewer processes, or free some memory."
        ) from None
    if not answer[0]:
        raise RuntimeError(f"Another process of this work failed: {answer[1]}")
    return answer[1]


def _write(pipe: IO[bytes], data: bytes) -> None:
    """Write bytes to a pipe and flush it."""
    pipe.write(data)
    pipe.flush()


def pack(value: Any) -> Packed:
    """Pickle a value; its arrays are read-only after `unpack`, like checked arrays."""
    # Arrays are read-only because the kernels are compiled for read-only arrays.
    buffers: list[pickle.PickleBuffer] = []
    data = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    return data, tuple(bytes(x.raw()) for x in buffers)


def unpack(packed: Packed) -> Any:
    """Unpickle a packed value."""
    data, buffers = packed
    return pickle.loads(data, buffers=buffers)
