"""Progress on the terminal: the current step, and for a job a bar with the remaining time.

If the output is not a terminal, a line is written every EVERY seconds instead.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
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

        def show(step: Step) -> None:
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


class JobProgress:
    """Estimate of the remaining time of a job from the measured times of its steps.

    The estimate for a step is the mean time of the same step in earlier runs, else of all steps.
    """

    def __init__(
        self, show: Callable[[str, float, float], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._clock = show, clock
        self._start = self._since = clock()
        # Step names and time of the last update.
        self._shown: tuple[tuple[str, ...], float] = (), self._start
        self._now: tuple[str, ...] = ()
        self._took: dict[str, list[float]] = {}
        self._ahead: list[str] = []

    def expect(self, steps: Sequence[str]) -> None:
        """Set the names of all steps that follow."""
        self._ahead = list(steps)

    def __call__(self, step: Step) -> None:
        """Update the estimate when a step begins or its completed fraction changes."""
        now, names = self._clock(), step.names[:2]
        if names != self._now:
            if self._now:
                self._took.setdefault(self._now[-1], []).append(now - self._since)
            self._now, self._since = names, now
            if names[-1] in self._ahead:
                self._ahead.remove(names[-1])
        elif step.names == self._shown[0] and now - self._shown[1] < REFRESH:
            return
        self._shown = step.names, now
        spent = now - self._since
        whole = spent / step.done if step.done else max(spent, self._typical(names[-1]))
        remaining = whole - spent + sum(map(self._typical, self._ahead))
        self._show(to_line(str(step)), now - self._start, now - self._start + remaining)

    def _typical(self, name: str) -> float:
        """Estimated duration of a step [s]."""
        took = self._took.get(name) or [x for times in self._took.values() for x in times]
        return sum(took) / len(took) if took else 0.0


@contextmanager
def job_progress() -> Iterator[JobProgress]:
    """Context that shows a bar with the remaining time; yields the object that updates it."""
    from rich.progress import BarColumn, ProgressColumn, Task
    from rich.text import Text

    class RemainingTime(ProgressColumn):
        """Column with the remaining time.

        It replaces rich's `TimeRemainingColumn`, which resets when the expected end changes.
        """

        def render(self, task: Task) -> Text:
            end = task.fields["end"]
            if end is None:
                return Text("left -:--:--")
            return Text(f"left {timedelta(seconds=max(0, round(end - time.monotonic())))}")

    with _progress_line(BarColumn(), RemainingTime()) as bar:
        task = bar.add_task("reading", total=None, end=None)
        lines = Lines(bar.disable)

        def show(description: str, spent: float, whole: float) -> None:
            remaining = timedelta(seconds=round(max(whole - spent, 0)))
            is_known = whole > spent
            lines.write(description, f"{spent / whole:.0%}, left {remaining}" if is_known else None)
            end = time.monotonic() + whole - spent if is_known else None
            bar.update(task, description=description, completed=spent, total=whole, end=end)

        def compiling(name: str) -> None:
            words = to_line(f"{COMPILING}: {name}")
            lines.write(words)
            bar.update(task, description=words)

        with listen_to_compilation(compiling):
            yield JobProgress(show)


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
