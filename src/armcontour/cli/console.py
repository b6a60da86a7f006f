"""The terminal: lines, tables, progress and interrupts.

`to_line` makes all text printable, because names come from files of users. A command runs in a
second thread, so that the main thread can handle signals, which end a command within a second, even
while compiled code runs.
"""

from __future__ import annotations

import io
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from typing import TYPE_CHECKING, Any

import typer

from armcontour.core import file_access
from armcontour.core.progress import COMPILING, Step, registered
from armcontour.core.text import to_line

if TYPE_CHECKING:
    from armcontour.core.result import Data

# Width of tables that do not go to a terminal [characters].
WIDTH = 120
# Maximum length of names that are not wrapped in a table [characters].
USUAL_NAME = 24
# Minimum time between progress lines, and before the first line, without a terminal [s].
EVERY = 10.0
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


def print_lines(*texts: str, err: bool = False) -> None:
    """Print lines to the standard output or error; the terminal wraps them."""
    for text in texts:
        typer.echo(to_line(text), err=err)


def data_lines(data: Data) -> list[str]:
    """Return the values, tables and notes of a result as lines."""
    from armcontour.core.render import text

    return [*text(data).splitlines(), *data.notes]


def table_lines(
    rows: Sequence[Sequence[str]], title: str | None = None, names: int = 1
) -> list[str]:
    """Lay a table out as lines, whose first lines are the title and the header.

    Args:
        rows: Texts of the cells; the first row is the header.
        title: Title; None for no title.
        names: Number of first columns with names, which wrap only above USUAL_NAME characters.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title and Text(to_line(title)), title_justify="left")
    for k, column in enumerate(zip(*rows, strict=True)):
        is_usual = k < names and max(map(len, column[1:]), default=0) <= USUAL_NAME
        heading = Text(to_line(column[0]))
        table.add_column(heading, overflow="fold", no_wrap=is_usual)
        table.columns[k].justify = "right" if k else "left"
    for row in rows[1:]:
        table.add_row(*(Text(to_line(x)) for x in row))
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDTH
    printed = io.StringIO()
    Console(file=printed, width=width).print(table)
    return printed.getvalue().splitlines()


class ProgressDisplay:
    """Display of the current step and its completed fraction, from the first step on.

    Call it with each step, and `hide` at the end.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._last = time.monotonic()
        self._bar: Any = None
        # Steps can come from the thread that compiles.
        self._lock = threading.Lock()
        self._noted = False

    def __call__(self, step: Step) -> None:
        """Show a step."""
        text = to_line(f"{self._title}: {step}")
        now = time.monotonic()
        if sys.stderr.isatty():
            with self._lock:
                bar = self._bar = self._bar or _start_bar()
            total = None if step.done is None else 1.0
            bar.update(bar.task_ids[0], description=text, completed=step.done or 0.0, total=total)
        elif now >= self._last + EVERY:
            self._last = now
            print_lines(text if step.done is None else f"{text}, {step.done:.0%}", err=True)

    def note_compilation(self, name: str) -> None:
        """Show the compilation of a function, and print one line before the first."""
        if not self._noted:
            self._noted = True
            # `name` can be the number of functions in a run, some of which may be compiled already.
            subject = f"up to {name}" if name[:1].isdigit() else "functions"
            print_lines(
                f"Compiling {subject}, because no earlier command has used them. This happens only "
                "once. `armcontour compile` compiles all functions in advance.",
                err=True,
            )
        self(Step((COMPILING, name)))

    def hide(self) -> None:
        """Remove the bar until the next step, for a question on the terminal."""
        with self._lock:
            if self._bar is not None:
                self._bar.stop()
            self._bar = None


def _start_bar() -> Any:
    """Return the bar of `rich` on the standard error."""
    from rich import progress
    from rich.console import Console

    bar = progress.Progress(
        progress.SpinnerColumn(),
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    bar.add_task("", total=None)
    bar.start()
    return bar


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
    unwritten = file_access.abandon(PATIENCE)
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
