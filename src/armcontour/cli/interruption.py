"""Signals such as Ctrl-C: they end a command within a second, even while compiled code runs.

A command runs in a second thread, so that the main thread can handle signals. `_interrupt` is the
handler: it asks a moving robot to stop, or deletes incomplete results and ends the program.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress

from armcontour.core import file_access
from armcontour.core.progress import registered

# Signals that end a command; Windows lacks some of them.
SIGNALS = [getattr(signal, x) for x in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, x)]
# Maximum wait for results that are being moved, and for a cleanup function [s].
CLEANUP_TIMEOUT = 0.5
# Duration of each wait for the second thread [s], because Windows handles no signals during a wait.
WAIT_PERIOD = 0.2
# Stack size of the second thread [bytes]. It is as large as that of a main thread, because deeply
# nested documents need much stack.
STACK_SIZE = 64 * 1024 * 1024
# Exit code of a command that a signal has ended: this number plus that of the signal.
SIGNAL_EXIT_CODE = 128
# Functions that are called before a signal ends the program; they may return a message for users.
_cleanups: list[Callable[[], str | None]] = []
# Functions that a signal calls instead of ending the program, because a moving robot must stop
# first.
_requests: list[Callable[[], None]] = []


def before_interrupt(cleanup: Callable[[], str | None]) -> AbstractContextManager[None]:
    """Context in which `cleanup` is called before a signal ends the program.

    `cleanup` may take the time CLEANUP_TIMEOUT, and may return a message for the user.
    """
    return registered(_cleanups, cleanup)


def on_interrupt(request: Callable[[], None]) -> AbstractContextManager[None]:
    """Context in which a signal only calls `request`; the command must then end by itself."""
    return registered(_requests, request)


def run_interruptibly(work: Callable[[], int]) -> int:
    """Run `work` in a thread and return its exit code; a signal ends the program."""
    for number in SIGNALS:
        # Signals that are ignored, as under `nohup`, stay ignored.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    codes: list[int] = []
    threading.stack_size(STACK_SIZE)
    thread = threading.Thread(target=lambda: codes.append(work()), name="work", daemon=True)
    thread.start()
    threading.stack_size(0)
    while thread.is_alive():
        thread.join(WAIT_PERIOD)
    # Python prints an unexpected exception of the thread.
    return codes[0] if codes else 1


def _interrupt(number: int, _: object) -> None:
    """Handle a signal: request the end of a motion; otherwise clean up and end the program.

    `number`: number of the signal.
    """
    for request in tuple(_requests):
        request()
    if _requests:
        return
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)
    sentences = _clean_up()
    # Incomplete results are deleted.
    unwritten = file_access.abandon(CLEANUP_TIMEOUT)
    message = f"Interrupted ({signal.Signals(number).name})"
    message += f": nothing was written to {', '.join(unwritten)}." if unwritten else "."
    _write_message(" ".join([message, *sentences]))
    os._exit(SIGNAL_EXIT_CODE + number)


def _clean_up() -> list[str]:
    """Call the cleanup functions, each for at most CLEANUP_TIMEOUT; return their messages."""
    sentences: list[str | None] = []
    for cleanup in tuple(_cleanups):
        thread = threading.Thread(target=lambda x=cleanup: sentences.append(x()), daemon=True)
        thread.start()
        thread.join(CLEANUP_TIMEOUT)
    return [x for x in sentences if x]


def _write_message(message: str) -> None:
    """Write a message to the standard error, after the line of a progress bar is cleared."""
    # The message is written directly to the file descriptor, because the second thread may hold the
    # locks of the streams.
    with suppress(OSError, AttributeError, ValueError):
        # This sequence clears the line of a progress bar and shows the cursor again.
        clear = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        os.write(2, f"{clear}{message}\n".encode(errors="backslashreplace"))
