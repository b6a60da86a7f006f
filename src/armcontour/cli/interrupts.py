"""Signals that end a command within a second, also while compiled code runs.

The work runs in a second thread, so that the main thread can handle signals. On a signal the main
thread waits until results that are being moved are in place, removes incomplete files, and ends the
program.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from armcontour.core import staging

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
# Longest wait for results that are being moved [s].
PATIENCE = 0.5
# Period of the wait on Windows, which handles no signal during a wait [s].
PULSE = 0.2
# Stack of the thread [bytes], as large as that of a main thread, for deeply nested documents.
STACK = 64 * 1024 * 1024


# Called before a signal ends the program; may return a sentence for the user.
_cleanups: list[Callable[[], str | None]] = []


class _Stopped(BaseException):
    """Raised in the main thread by a signal."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def before_interrupt(cleanup: Callable[[], str | None]) -> Iterator[None]:
    """Context in which `cleanup` is called before a signal ends the program."""
    # It may take `PATIENCE`, and may return a sentence for the user.
    _cleanups.append(cleanup)
    try:
        yield
    finally:
        _cleanups.remove(cleanup)


def run_interruptibly(work: Callable[[], int]) -> int:
    """Run work, which returns the exit code, in a thread; end the program if a signal arrives."""
    # Ignored signals stay ignored, as under `nohup`.
    done = threading.Event()
    codes: list[int] = []
    errors: list[BaseException] = []

    def target() -> None:
        try:
            codes.append(work())
        except BaseException as error:
            errors.append(error)
        finally:
            done.set()

    before = _listen()
    try:
        threading.stack_size(STACK)
        threading.Thread(target=target, name="work", daemon=True).start()
        threading.stack_size(0)
        while not done.wait(PULSE if os.name == "nt" else None):
            pass
    except _Stopped as stopped:
        _end(stopped.number)
    for number, handler in before.items():
        signal.signal(number, handler)
    if errors:
        raise errors[0]
    return codes[0]


def _listen() -> dict[int, Any]:
    """Install handlers that stop the wait; returns the earlier handlers."""

    def stop(number: int, _: object) -> None:
        raise _Stopped(number)

    before = {}
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, stop)
    return before


def _end(number: int) -> NoReturn:
    """Remove incomplete results, print a message and end the program."""
    for name in SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    sentences = _clean_up()
    unwritten = staging.abandon(PATIENCE)
    message = f"Interrupted ({signal.Signals(number).name})"
    message += f": nothing was written to {', '.join(unwritten)}." if unwritten else "."
    message = " ".join([message, *sentences])
    # Written directly to the file descriptor: the thread may hold the locks of the streams.
    with suppress(OSError, AttributeError, ValueError):
        # Clears the line of a progress bar and shows the cursor again.
        clear = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        os.write(2, f"{clear}{message}\n".encode(errors="backslashreplace"))
    os._exit(128 + number)


def _clean_up() -> list[str]:
    """Call the cleanup functions, each in a thread and for at most `PATIENCE`."""
    sentences: list[str] = []

    def call(cleanup: Callable[[], str | None]) -> None:
        with suppress(Exception):
            if (sentence := cleanup()) is not None:
                sentences.append(sentence)

    for cleanup in tuple(_cleanups):
        thread = threading.Thread(target=call, args=(cleanup,), daemon=True)
        thread.start()
        thread.join(PATIENCE)
    return sentences
