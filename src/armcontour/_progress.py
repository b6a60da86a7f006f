"""What long work tells of itself while it goes on: one form, whoever works and whoever listens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Step:
    """What is being done now.

    Args:
        names: What it is called, under what it is part of: a run of a job, then "timing".
        done: Share of it that is done, from 0 to 1; None where that is not known.
    """

    names: tuple[str, ...]
    done: float | None = None

    def __str__(self) -> str:
        """The names for a line on a terminal."""
        return ": ".join(self.names)


Progress = Callable[[Step], None]


def under(progress: Progress | None, *names: str) -> Progress:
    """A listener that passes steps on under the names of what they are part of; None hears nothing.

    Args:
        progress: Who listens.
        names: What all steps are part of.
    """
    if progress is None:
        return lambda step: None
    return lambda step: progress(Step((*names, *step.names), step.done))
