"""Handling of signals: they end a command within a second, even while compiled code runs.

The command runs in a second thread, so that the main thread can handle signals: it waits until
finished results are moved to their folder, deletes incomplete files, and ends the program.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress

from armcontour.core import staging
from armcontour.core.progress import registered

SIGNALS = [getattr(signal, x) for x in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, x)]
# Maximum wait for results that are being moved, and for a cleanup function [s].
PATIENCE = 0.5
# Duration of each wait [s], because Windows does not handle signals during a wait.
PULSE = 0.2
# Stack size of the second thread [bytes]. It is as large as that of a main thread, because deeply
# nested documents need much stack.
STACK = 64 * 1024 * 1024

# Functions that are called before a signal ends the program; they may return a message for users.
_cleanups: list[Callable[[], str | None]] = []
# Functions that a signal calls instead of ending the program, because a moving robot must stop
# first.
_requests: list[Callable[[], None]] = []


def before_interrupt(cleanup: Callable[[], str | None]) -> AbstractContextManager[None]:
    """Context in which `cleanup` is called before a signal ends the program.

    `cleanup` may take the time PATIENCE, and may return a message for the user.
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
    threading.stack_size(STACK)
    thread = threading.Thread(target=lambda: codes.append(work()), name="work", daemon=True)
    thread.start()
    threading.stack_size(0)
    while thread.is_alive():
        thread.join(PULSE)
    # Python prints an unexpected exception of the thread.
    return codes[0] if codes else 1


def _interrupt(number: int, _: object) -> None:
    """Request the end of a motion; otherwise delete incomplete results and end the program."""
    for request in tuple(_requests):
        request()
    if _requests:
        return
    for x in SIGNALS:
        signal.signal(x, signal.SIG_IGN)
    sentences: list[str | None] = []
    for cleanup in tuple(_cleanups):
        thread = threading.Thread(target=lambda x=cleanup: sentences.append(x()), daemon=True)
        thread.start()
        thread.join(PATIENCE)
    unwritten = staging.abandon(PATIENCE)
    message = f"Interrupted ({signal.Signals(number).name})"
    message += f": nothing was written to {', '.join(unwritten)}." if unwritten else "."
    # The message is written directly to the file descriptor, because the second thread may hold the
    # locks of the streams.
    with suppress(OSError, AttributeError, ValueError):
        # This sequence clears the line of a progress bar and shows the cursor again.
        clear = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        message = " ".join([f"{clear}{message}", *filter(None, sentences)])
        os.write(2, f"{message}\n".encode(errors="backslashreplace"))
    os._exit(128 + number)
