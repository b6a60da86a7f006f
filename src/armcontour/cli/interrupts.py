"""Signals that end a command within a second, inside compiled code too.

The work is done in a thread of its own, so that the main thread can answer. On a signal the main
thread waits for results that are just being moved into place, removes what is half-written, and
ends the program.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from armcontour import _staging

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
# Moving results is a few renames; what takes longer is left for the next run to complete [s].
PATIENCE = 0.5
# Windows answers no signal while it waits, so the wait has an end [s].
PULSE = 0.2
# Threads have small stacks on some systems; deep documents need what a main thread has.
STACK = 64 * 1024 * 1024


class _Stopped(BaseException):
    """A signal came."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def run_interruptibly(work: Callable[[], int]) -> int:
    """Do work in a thread, and end the program if a signal comes.

    A signal that is ignored already stays ignored, as `nohup` wants it.

    Args:
        work: Returns an exit code.

    Returns:
        The exit code; an error that the work raises is raised.
    """
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
    """Have signals stop the wait; gives the handlers that were there."""

    def stop(number: int, _: object) -> None:
        raise _Stopped(number)

    before = {}
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, stop)
    return before


def _end(number: int) -> NoReturn:
    """Leave nothing half-written, say so, and end."""
    for name in SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    unwritten = _staging.abandon(PATIENCE)
    said = f"Interrupted ({signal.Signals(number).name})"
    said += f": nothing was written to {', '.join(unwritten)}." if unwritten else "."
    # The thread may hold the locks of the streams, so the message goes past them.
    with suppress(OSError, AttributeError, ValueError):
        # A progress bar hides the cursor, and leaves its line.
        clear = "\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else ""
        os.write(2, f"{clear}{said}\n".encode(errors="backslashreplace"))
    os._exit(128 + number)
