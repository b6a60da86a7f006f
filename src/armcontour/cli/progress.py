"""Progress on a terminal: of a search, whose end is not known, and of a job with the time left."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

from armcontour._progress import Progress, Step
from armcontour._text import to_line


@contextmanager
def search_progress(what: str) -> Iterator[Progress]:
    """A line that says what is being done, on a terminal; gives the function that changes it.

    Args:
        what: What stands before it.
    """
    with _bar() as bar:
        task = bar.add_task(what)
        yield lambda step: bar.update(task, description=to_line(f"{what}: {step}"))


class JobProgress:
    """A bar for a job: what is done, and how long the rest will take, as steps are measured.

    A step takes as long as the same one of earlier runs, else as long as steps have taken so far.

    Args:
        show: Takes the description, the time that was spent, and all that is expected [s].
        clock: The time [s].
    """

    def __init__(
        self, show: Callable[[str, float, float], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._clock = show, clock
        self._start = self._since = clock()
        self._now: tuple[str, ...] = ()
        self._took: dict[str, list[float]] = {}
        self._ahead: list[str] = []

    def expect(self, steps: Sequence[str]) -> None:
        """Tell the names of all steps that are to come, once they are known."""
        self._ahead = list(steps)

    def __call__(self, step: Step) -> None:
        """A step starts, if it is another one than before, or goes on."""
        now, names = self._clock(), step.names[:2]
        if names != self._now:
            if self._now:
                self._took.setdefault(self._now[-1], []).append(now - self._since)
            self._now, self._since = names, now
            if names[-1] in self._ahead:
                self._ahead.remove(names[-1])
        spent = now - self._since
        whole = spent / step.done if step.done else max(spent, self._typical(names[-1]))
        rest = whole - spent + sum(map(self._typical, self._ahead))
        self._show(to_line(str(step)), now - self._start, now - self._start + rest)

    def _typical(self, name: str) -> float:
        """How long a step takes [s]."""
        took = self._took.get(name) or [x for times in self._took.values() for x in times]
        return sum(took) / len(took) if took else 0.0


@contextmanager
def job_progress() -> Iterator[JobProgress]:
    """A bar with the time left, on a terminal."""
    from rich.progress import BarColumn, ProgressColumn, Task
    from rich.text import Text

    class Left(ProgressColumn):
        """The time until the expected end; that of rich forgets it whenever the end moves."""

        def render(self, task: Task) -> Text:
            end = task.fields["end"]
            if end is None:
                return Text("left -:--:--")
            return Text(f"left {timedelta(seconds=max(0, round(end - time.monotonic())))}")

    with _bar(BarColumn(), Left()) as bar:
        task = bar.add_task("reading", total=None, end=None)

        def show(what: str, spent: float, whole: float) -> None:
            end = time.monotonic() + whole - spent if whole > spent else None
            bar.update(task, description=what, completed=spent, total=whole, end=end)

        yield JobProgress(show)


@contextmanager
def _bar(*more: Any) -> Iterator[Any]:
    """A line of rich that vanishes at its end, on a terminal only."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    words = TextColumn("{task.description}", markup=False)
    columns = (SpinnerColumn(), words, TimeElapsedColumn(), *more)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        yield bar
