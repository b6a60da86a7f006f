"""Progress on a terminal: of a search, whose end is not known, and of a job with the time left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from armcontour._text import to_line

# What steps cost beside each other, as measured on a program of 150,000 lines.
COSTS = {
    "reading": 2.0,
    "rounding": 0.5,
    "tracing": 1.0,
    "timing": 4.0,
    "compensation": 1.0,
    "execution": 1.0,
    "evaluation": 4.0,
    "experiment": 20.0,
    "writing": 4.0,
}


@contextmanager
def shown(what: str) -> Iterator[Callable[[str], None]]:
    """A line that says what is being done, on a terminal; gives the function that changes it.

    Args:
        what: What stands before it.
    """
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(what)
        yield lambda words: progress.update(task, description=to_line(f"{what}: {words}"))


class JobProgress:
    """A bar for a job: how much is done, and how long the rest will take.

    Args:
        bar: A bar of rich, and its task.
    """

    def __init__(self, bar: Any, task: Any) -> None:
        self._bar, self._task = bar, task
        self._before, self._step, self._total = 0.0, COSTS["reading"], COSTS["reading"]

    def planned(self, steps: list[tuple[str, ...]]) -> None:
        """Tell the steps of all runs, once they are known."""
        self._total = COSTS["reading"] + COSTS["writing"]
        self._total += sum(COSTS[x] for run in steps for x in run)
        self._before = COSTS["reading"]
        self._bar.update(self._task, total=self._total, completed=self._before)

    def begin(self, what: str, step: str) -> None:
        """A step begins, and the one before has ended."""
        self._before, self._step = self._before + self._step, COSTS[step]
        self._bar.update(self._task, description=to_line(what), completed=self._before)

    def share(self, done: float) -> None:
        """So much of the step is done."""
        self._bar.update(self._task, completed=self._before + done * self._step)


@contextmanager
def job_progress() -> Iterator[JobProgress]:
    """A bar with the time left, on a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("reading", total=None)
        yield JobProgress(bar, task)
