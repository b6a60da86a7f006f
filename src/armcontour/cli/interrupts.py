"""Handling of signals: they end a command within a second, even while compiled code runs.

The command runs in a second thread, so that the main thread can handle signals. After a signal, the
main thread waits until finished results are moved to their folder, deletes incomplete files, and
ends the program.
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
# Maximum wait for results that are being moved, and for a cleanup function [s].
PATIENCE = 0.5
# Duration of each wait on Windows [s], because Windows does not handle signals during a wait.
PULSE = 0.2
# Stack size of the second thread [bytes]. It is as large as that of a main thread, because deeply
# nested documents need much stack.
STACK = 64 * 1024 * 1024


# Functions that are called before a signal ends the program; they may return a message for users.
_cleanups: list[Callable[[], str | None]] = []
# Functions that a signal calls instead of ending the program, because a moving robot must stop
# first.
_requests: list[Callable[[], None]] = []


class _Stopped(BaseException):
    """Exception that a signal handler raises in the main thread."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def before_interrupt(cleanup: Callable[[], str | None]) -> Iterator[None]:
    """Context in which `cleanup` is called before a signal ends the program.

    `cleanup` may take the time PATIENCE, and may return a message for the user.
    """
    _cleanups.append(cleanup)
    try:
        yield
    finally:
        _cleanups.remove(cleanup)


@contextmanager
def on_interrupt(request: Callable[[], None]) -> Iterator[None]:
    """Context in which a signal only calls `request`; the command must then end by itself."""
    _requests.append(request)
    try:
        yield
    finally:
        _requests.remove(request)


def run_interruptibly(work: Callable[[], int]) -> int:
    """Run `work` in a thread and return its exit code; a signal ends the program."""
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
        while not done.is_set():
            try:
                done.wait(PULSE if os.name == "nt" else None)
            except _Stopped:
                if not _requests:
                    raise
                for request in tuple(_requests):
                    request()
    except _Stopped as stopped:
        _end(stopped.number)
    for number, handler in before.items():
        signal.signal(number, handler)
    if errors:
        raise errors[0]
    return codes[0]


def _listen() -> dict[int, Any]:
    """Install signal handlers that raise `_Stopped`; returns the earlier handlers by signal.

    Signals that are ignored, as under `nohup`, stay ignored.
    """

    def stop(number: int, _: object) -> None:
        raise _Stopped(number)

    before = {}
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, stop)
    return before


def _end(number: int) -> NoReturn:
    """Delete incomplete results, print a message and end the program."""
    for name in SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    sentences = _clean_up()
    unwritten = staging.abandon(PATIENCE)
    message = f"Interrupted ({signal.Signals(number).name})"
    message += f": nothing was written to {', '.join(unwritten)}." if unwritten else "."
    message = " ".join([message, *sentences])
    # The message is written directly to the file descriptor, because the second thread may hold the
    # locks of the streams.
    with suppress(OSError, AttributeError, ValueError):
        # This sequence clears the line of a progress bar and shows the cursor again.
        clear = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        os.write(2, f"{clear}{message}\n".encode(errors="backslashreplace"))
    os._exit(128 + number)


def _clean_up() -> list[str]:
    """Call the cleanup functions, each for at most PATIENCE; returns their messages."""
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
