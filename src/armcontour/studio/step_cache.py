"""`StepCache`: cached results of preview steps, by their inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
# Default number of cached results per step, for a few runs that a user compares.
RESULTS = 4
# Maximum number of cached results per step if the results have samples.
LARGE_RESULTS = 2
# Maximum number of samples in a step's cached results; the newest result always stays.
MAX_SAMPLES = 200_000


class StepCache:
    """Cache of results, so that the Studio does not repeat a step with the same inputs."""

    def __init__(self) -> None:
        self._known: dict[str, list[tuple[Any, Any]]] = {}

    def get(
        self,
        step: str,
        made_of: Any,
        make: Callable[[], T],
        *,
        maximum: int = RESULTS,
        samples: Callable[[T], int] = lambda value: 0,
    ) -> T:
        """Return a step's result: the cached one for equal inputs `made_of`, or that of `make`.

        Args:
            step: Name of the step.
            made_of: Inputs of the step, which are compared.
            make: Function that computes the result.
            maximum: Number of this step's results in the cache.
            samples: Function that counts the samples in a result; None if it has none.
        """
        entries = self._known.setdefault(step, [])
        for k, (before, value) in enumerate(entries):
            if before == made_of:
                entries.insert(0, entries.pop(k))
                result: T = value
                return result
        value = make()
        entries.insert(0, (made_of, value))
        del entries[maximum:]
        while len(entries) > 1 and sum(samples(x) for _, x in entries) > MAX_SAMPLES:
            del entries[-1]
        return value
