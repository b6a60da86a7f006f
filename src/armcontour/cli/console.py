"""The terminal: lines, tables and progress.

`to_line` makes all text printable, because names come from files of users.
"""

from __future__ import annotations

import io
import shutil
import sys
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from armcontour.core.progress import COMPILING, Step, TimeLeft
from armcontour.core.text import to_line

if TYPE_CHECKING:
    from armcontour.core.result import Data

# Width of tables that do not go to a terminal [characters]; more if their words need it.
TABLE_WIDTH = 120
# Maximum length of names and words that are not wrapped in a table [characters].
MAX_UNWRAPPED = 24
# Minimum time between progress lines, and before the first line, without a terminal [s].
PROGRESS_PERIOD = 10.0
# Shortest time until the end of a step that is shown [s].
SHOWN_TIME_LEFT = 2.0


def print_lines(*texts: str, err: bool = False) -> None:
    """Print lines to the standard output or error; the terminal wraps them."""
    for text in texts:
        typer.echo(to_line(text), err=err)


def data_lines(data: Data) -> list[str]:
    """Return the values, tables and notes of a result as lines, and what it does not prove."""
    from armcontour.core.render import text

    return [*text(data).splitlines(), *data.notes, *filter(None, [data.not_proven])]


def table_lines(
    rows: Sequence[Sequence[str]], title: str | None = None, names: int = 1
) -> list[str]:
    """Lay a table out; the first lines are the title and the header.

    Args:
        rows: Texts of the cells; the first row is the header.
        title: Title; None for no title.
        names: Number of first columns with names, which wrap only above MAX_UNWRAPPED characters.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title and Text(to_line(title)), title_justify="left")
    words = [_longest_word(column) for column in zip(*rows, strict=True)]
    # Each column has a blank on both sides and a border on its left.
    needed = sum(words) + 3 * len(words) + 1
    width = max(TABLE_WIDTH, needed)
    if sys.stdout.isatty():
        width = shutil.get_terminal_size().columns
    for k, column in enumerate(zip(*rows, strict=True)):
        stays_unwrapped = k < names and max(map(len, column[1:]), default=0) <= MAX_UNWRAPPED
        heading = Text(to_line(column[0]))
        table.add_column(heading, overflow="fold", no_wrap=stays_unwrapped)
        table.columns[k].justify = "right" if k else "left"
        if needed <= width:
            # A number is not divided between two lines.
            table.columns[k].min_width = words[k]
    for row in rows[1:]:
        table.add_row(*(Text(to_line(x)) for x in row))
    # Where columns must wrap, rich exceeds the width by up to one character for each column with a
    # smallest width.
    for available in range(width, width - len(words), -1):
        printed = io.StringIO()
        Console(file=printed, width=2 * width).print(table, width=available)
        lines = printed.getvalue().splitlines()
        if max(map(len, lines)) <= width:
            break
    return lines


def _longest_word(column: Sequence[str]) -> int:
    """Return the length of the longest word of a column, of at most MAX_UNWRAPPED characters."""
    lengths = [len(word) for cell in column for word in to_line(cell).split()]
    return max((x for x in lengths if x <= MAX_UNWRAPPED), default=0)


class ProgressDisplay:
    """Display of the current step and its completed fraction, from the first step on.

    Call it with each step, and `hide` at the end.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._last = time.monotonic()
        self._time_left = TimeLeft(time.monotonic)
        self._bar: Any = None
        # Steps can come from the thread that compiles.
        self._lock = threading.Lock()
        # Whether the user was told that functions are compiled.
        self._compilation_noted = False

    def __call__(self, step: Step) -> None:
        """Show a step."""
        now = time.monotonic()
        left = self._time_left.after(step)
        shown_left = ""
        if left is not None and left >= SHOWN_TIME_LEFT:
            shown_left = f", about {write_time(left)} left"
        text = to_line(f"{self._title}: {step}")
        if sys.stderr.isatty():
            with self._lock:
                bar = self._bar = self._bar or _start_bar()
            total = None if step.done is None else 1.0
            bar.update(
                bar.task_ids[0],
                description=f"{text}{shown_left}",
                completed=step.done or 0.0,
                total=total,
            )
        elif now >= self._last + PROGRESS_PERIOD:
            self._last = now
            share = "" if step.done is None else f", {step.done:.0%}"
            print_lines(f"{text}{share}{shown_left}", err=True)

    def note_compilation(self, name: str) -> None:
        """Show the compilation of a function, and print one line before the first."""
        if not self._compilation_noted:
            self._compilation_noted = True
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


def write_time(seconds: float) -> str:
    """Write a time [s] in seconds or minutes, without decimals."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"


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
