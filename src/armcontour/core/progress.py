"""Progress of long work: `Step`, and functions that take it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Step:
    """The current step of long work.

    Args:
        names: Name of the step, after the names of the work that it belongs to, such as ("fast",
            "timing") for a run and its step.
        done: Share of the step that is done, from 0 to 1; None if unknown.
    """

    names: tuple[str, ...]
    done: float | None = None

    def __str__(self) -> str:
        """The names as one line for a terminal."""
        return ": ".join(self.names)


Progress = Callable[[Step], None]


def subprogress(progress: Progress | None, *names: str) -> Progress:
    """A function that adds names before the names of steps, and passes the steps on.

    Args:
        progress: Called with the steps; None ignores them.
        names: Names of the work that all steps belong to.
    """
    if progress is None:
        return lambda step: None
    return lambda step: progress(Step((*names, *step.names), step.done))


# What a user reads while functions are compiled.
COMPILING = "compiling, once"

# Who is told that a function is being compiled.
_listeners: list[Callable[[str], None]] = []


@contextmanager
def hear_compiling(listener: Callable[[str], None]) -> Iterator[None]:
    """Call a function with the name of each function that is compiled in this process meanwhile."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def tell_compiling(name: str) -> bool:
    """Tell all who want to know it that a function is being compiled.

    Args:
        name: Name of the function, after that of its module.

    Returns:
        Whether anybody was told.
    """
    for listener in (told := tuple(_listeners)):
        listener(name)
    return bool(told)
