"""Progress of long work: `Step`, and functions that receive it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TypeVar

Item = TypeVar("Item")
# Name of the step in which functions are compiled.
COMPILING = "compiling, once"
# Called with the name of each function that is compiled.
_listeners: list[Callable[[str], None]] = []


@dataclass(frozen=True, slots=True)
class Step:
    """The current step of long work.

    Args:
        names: Name of the step, after the names of the work that it belongs to, such as ("fast",
            "timing") for a run and its step.
        done: Completed fraction of the step, from 0 to 1; None if unknown.
        part: The part of the step that was completed last, such as "contour 3 of 40"; empty if the
            step has no parts.
    """

    names: tuple[str, ...]
    done: float | None = None
    part: str = ""

    def __str__(self) -> str:
        """Write the names and the part in one line, for a terminal."""
        text = ": ".join(self.names)
        return f"{text}, {self.part}" if self.part else text


Progress = Callable[[Step], None]


def contour_step(name: str, number: int, count: int) -> Step:
    """Make the step after the contour `number`, from 1, of `count` contours."""
    return Step((name,), number / count, f"contour {number} of {count}")


class TimeLeft:
    """Estimate of the time until a step ends, from the time that its first part took.

    Args:
        clock: Returns the time [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._names: tuple[str, ...] = ()
        self._begin = 0.0
        self._first = 0.0

    @property
    def spent(self) -> float:
        """Time since the first part of the step [s]."""
        return self._clock() - self._begin

    def after(self, step: Step) -> float | None:
        """Return the time until the step ends [s]; None if it is unknown.

        Each further part of the step is assumed to take as long as its parts so far.
        """
        now = self._clock()
        done = step.done or 0.0
        if step.names != self._names or done < self._first:
            self._names = step.names
            self._begin = now
            self._first = done
        if done <= self._first or done >= 1.0:
            return None
        return (now - self._begin) * (1.0 - done) / (done - self._first)


def subprogress(progress: Progress | None, *names: str) -> Progress:
    """Wrap a progress function so that names are prepended to the names of each step."""
    if progress is None:
        return lambda step: None
    return lambda step: progress(Step((*names, *step.names), step.done, step.part))


@contextmanager
def registered(items: list[Item], item: Item) -> Iterator[None]:
    """Append an item to a list while the context is open."""
    items.append(item)
    try:
        yield
    finally:
        items.remove(item)


def listen_to_compilation(listener: Callable[[str], None]) -> AbstractContextManager[None]:
    """Call `listener` with the name of each function that is compiled in this context."""
    return registered(_listeners, listener)


def report_compiling(name: str) -> bool:
    """Report the compilation of a function to all listeners; return False if there is none."""
    listeners = tuple(_listeners)
    for listener in listeners:
        listener(name)
    return bool(listeners)
