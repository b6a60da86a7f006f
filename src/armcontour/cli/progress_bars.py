"""Progress on the terminal: the current step, or a bar with the completed fraction.

If the output is not a terminal, a line is written every EVERY seconds instead.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from armcontour.core.progress import COMPILING, Progress, Step, listen_to_compilation
from armcontour.core.text import to_line

# Minimum time between progress lines, and before the first line, without a terminal [s].
EVERY = 10.0
# Minimum time between updates of a step [s]. A program can have thousands of contours, and an
# update takes as long as a contour.
REFRESH = 0.05


@contextmanager
def search_progress(title: str) -> Iterator[Progress]:
    """Context that shows a line with the current step; yields the function that updates it."""
    with _progress_line() as bar:
        task = bar.add_task(title)
        lines = Lines(bar.disable)
        shown: tuple[tuple[str, ...], float] = (), 0.0

        def show(step: Step) -> None:
            nonlocal shown
            now = time.monotonic()
            if step.names == shown[0] and now - shown[1] < REFRESH:
                return
            shown = step.names, now
            words = to_line(f"{title}: {step}")
            bar.update(task, description=words)
            lines.write(words, None if step.done is None else f"{step.done:.0%}")

        with listen_to_compilation(lambda name: show(Step((COMPILING, name)))):
            yield show


@contextmanager
def share_progress() -> Iterator[Progress]:
    """Context that shows a bar with the completed fraction; yields its update function."""
    from rich.progress import BarColumn, TaskProgressColumn

    with _progress_line(BarColumn(), TaskProgressColumn()) as bar:
        task = bar.add_task("", total=1.0)
        lines = Lines(bar.disable, at_once=True)

        def show(step: Step) -> None:
            words = to_line(str(step))
            bar.update(task, description=words, completed=step.done or 0.0)
            lines.write(words, f"{step.done:.0%}" if step.done else None)

        yield show


@contextmanager
def compiling_notice() -> Iterator[None]:
    """Context that writes one line before the first function is compiled."""
    is_written = False

    def say(name: str) -> None:
        nonlocal is_written
        if not is_written:
            is_written = True
            # `name` can be the number of functions of a run, of which some may be compiled already.
            subject = f"up to {name}" if name[:1].isdigit() else "functions"
            sys.stderr.write(
                f"Compiling {subject}, because no earlier command has used them. This happens only "
                "once. `armcontour compile` compiles all functions in advance.\n"
            )
            sys.stderr.flush()

    with listen_to_compilation(say):
        yield


class Lines:
    """Writer of progress lines to the standard error, for output that is not a terminal."""

    def __init__(
        self,
        active: bool,
        clock: Callable[[], float] = time.monotonic,
        *,
        at_once: bool = False,
    ) -> None:
        self._wanted, self._clock = active, clock
        self._last = clock() - (EVERY if at_once else 0.0)

    def write(self, words: str, detail: str | None = None) -> None:
        """Write a line if the last line was written at least EVERY seconds ago."""
        now = self._clock()
        if not self._wanted or now - self._last < EVERY:
            return
        self._last = now
        sys.stderr.write(f"{words if detail is None else f'{words}, {detail}'}\n")
        sys.stderr.flush()


@contextmanager
def _progress_line(*extra: Any) -> Iterator[Any]:
    """Context with a progress line of `rich` that is removed at the end; `extra`: more columns."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    words = TextColumn("{task.description}", markup=False)
    columns = (SpinnerColumn(), words, TimeElapsedColumn(), *extra)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        yield bar
