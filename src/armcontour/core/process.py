"""Another Python process that works for this one: its start, its end, and what is said.

The processes are started as programs of their own, so that scripts need no guard against being
imported, and end when this process ends, however it does: their input ends then.
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
from armcontour.core.progress import hear_compiling

Packed: TypeAlias = tuple[bytes, tuple[bytes, ...]]
SERVE = "from armcontour.core.process import serve; serve()"
# How many more objects than are freed make Python look for garbage in cycles, and how many looks at
# young objects go before one at older ones: a program of thousands of contours has millions, none
# of them in cycles, and looking at them takes as long as reading the drawing.
GARBAGE = (20_000, 20, 50)
# Every process computes in one thread, but for `map_in_threads`.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def locked(mapping: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """A mapping that does not change."""
    return MappingProxyType(dict(mapping))


# Values have such mappings, which pickle does not know by itself.
copyreg.pickle(MappingProxyType, lambda x: (locked, (dict(x),)))


class ProcessEnded(ExecutionError):
    """Another process ended before its work did."""


class _Serving:
    """Whether this process is one of the others, which start no further ones."""

    here = False
    # The same of threads that work for an executor.
    threads = threading.local()
    # Where answers go.
    answers: IO[bytes] | None = None


def processors() -> int:
    """Number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def can_start() -> bool:
    """Whether other processes can be started: a frozen application is no Python to start."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def is_other() -> bool:
    """Whether this process, or this thread, only works for another one."""
    return _Serving.here or getattr(_Serving.threads, "busy", False)


@contextmanager
def working_for_another() -> Iterator[None]:
    """Context in which this thread works for another process, and starts no further ones."""
    before = getattr(_Serving.threads, "busy", False)
    _Serving.threads.busy = True
    try:
        yield
    finally:
        _Serving.threads.busy = before


def end_at_once() -> None:
    """Skip garbage collection at exit, which saves about 0.5 s.

    Compiled functions and their modules are many objects, and the process frees all of them.
    """
    atexit.register(gc.freeze)


def look_for_garbage_less() -> None:
    """Have Python look for garbage in cycles less often: there is little, among many objects."""
    gc.set_threshold(*GARBAGE)


def import_path(*refused: str) -> list[str]:
    """Import path without relative folders, the current folder and some more.

    Files in these folders could replace modules of Python and of libraries.

    Args:
        refused: Folders that are also left out.
    """
    own = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))

    def is_kept(folder: str) -> bool:
        out = any(_is_same(folder, x) for x in (os.curdir, *refused))
        return folder == own or (os.path.isabs(folder) and not out)

    return [*([] if own in sys.path else [own]), *filter(is_kept, sys.path)]


def _is_same(one: str, other: str) -> bool:
    """Whether two paths name the same existing folder."""
    with suppress(OSError):
        return os.path.samefile(one, other)
    return False


def start() -> subprocess.Popen[bytes]:
    """Start a process that serves; it imports nothing from the current folder."""
    own = {"PYTHONPATH": os.pathsep.join(import_path())} | dict.fromkeys(THREADS, "1")
    return subprocess.Popen(
        [sys.executable, "-P", "-c", SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | own,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def end(child: subprocess.Popen[bytes]) -> None:
    """End a process, and close its pipes."""
    child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        # What was not written has no reader any more.
        with suppress(OSError):
            pipe.close()


def serve() -> None:
    """The other process: do the work that comes in, until none comes."""
    _Serving.here = True
    look_for_garbage_less()
    # The terminal interrupts all processes; the first one decides what that means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = _Serving.answers = os.fdopen(os.dup(1), "wb")
    # What libraries print is no answer.
    os.dup2(2, 1)
    # What is compiled here is no news to the user.
    with hear_compiling(lambda name: None), suppress(EOFError, OSError):
        while True:
            work = pickle.load(sys.stdin.buffer)
            try:
                answer = pickle.dumps((True, unpack(work)()))
            except Exception as error:
                answer = pickle.dumps((False, f"{type(error).__name__}: {error}"))
            _write(answers, answer)


def tell(value: Any) -> None:
    """Report something to the process that this one works for, before the answer.

    Args:
        value: The report; it can be pickled. Work that nobody hears must not report.
    """
    if _Serving.answers is not None:
        _write(_Serving.answers, pickle.dumps((None, value)))


def call(
    child: subprocess.Popen[bytes], work: Callable[[], Any], heard: Callable[[Any], None]
) -> Any:
    """Have a process do some work, whose arrays are read-only there.

    Args:
        child: The process.
        work: The work; it can be pickled.
        heard: Called with what the process reports before its answer.

    Raises:
        ProcessEnded: The process has ended before it gave an answer.
        RuntimeError: The work failed.
    """
    assert child.stdin is not None and child.stdout is not None
    packed = pickle.dumps(pack(work))
    try:
        _write(child.stdin, packed)
        while (answer := pickle.load(child.stdout))[0] is None:
            heard(answer[1])
    except BaseException as error:
        # The rest of its answer would be read as the next one.
        child.kill()
        child.wait()
        if not isinstance(error, EOFError | OSError | pickle.UnpicklingError):
            raise
        raise ProcessEnded(
            "Another process of this work has ended before it gave an answer, as when memory "
            "runs out: take fewer processes, or free some memory."
        ) from None
    if not answer[0]:
        raise RuntimeError(f"Another process of this work failed: {answer[1]}")
    return answer[1]


def _write(pipe: IO[bytes], data: bytes) -> None:
    """Write bytes to a pipe at once."""
    pipe.write(data)
    pipe.flush()


def pack(value: Any) -> Packed:
    """A value as bytes. Arrays are read-only when they are unpacked, as checked values have them.

    Compiled functions are compiled for such arrays.
    """
    buffers: list[pickle.PickleBuffer] = []
    data = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    return data, tuple(bytes(x.raw()) for x in buffers)


def unpack(packed: Packed) -> Any:
    """The value that was packed."""
    data, buffers = packed
    return pickle.loads(data, buffers=buffers)
