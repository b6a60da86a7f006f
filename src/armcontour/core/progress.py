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
    """

    names: tuple[str, ...]
    done: float | None = None

    def __str__(self) -> str:
        """Write the names in one line, for a terminal."""
        return ": ".join(self.names)


Progress = Callable[[Step], None]


def subprogress(progress: Progress | None, *names: str) -> Progress:
    """Wrap a progress function so that names are prepended to the names of each step."""
    if progress is None:
        return lambda step: None
    return lambda step: progress(Step((*names, *step.names), step.done))


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
