"""Progress on the standard error: a bar on a terminal, otherwise a line every EVERY seconds."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

from armcontour.cli.console import print_lines
from armcontour.core.progress import COMPILING, Step
from armcontour.core.text import to_line

# Minimum time between progress lines, and before the first line, without a terminal [s].
EVERY = 10.0


class ProgressDisplay:
    """Display of the current step and its completed fraction, from the first step on.

    Call it with each step, and `hide` at the end.
    """

    def __init__(self, title: str) -> None:
        self._title, self._last = title, time.monotonic()
        self._bar: Any = None
        # Steps can come from the thread that compiles.
        self._lock = threading.Lock()
        self._noted = False

    def __call__(self, step: Step) -> None:
        """Show a step."""
        text, now = to_line(f"{self._title}: {step}"), time.monotonic()
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
            # `name` can be the number of functions of a run, of which some may be compiled already.
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
    """Bar of `rich` on the standard error."""
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
