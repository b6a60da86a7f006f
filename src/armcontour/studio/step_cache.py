"""`StepCache`: results of the steps of a preview, by their inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
# Default number of results of each step in the cache, for a few runs that a user compares.
RESULTS = 4
# Maximum number of results of a step in the cache if the results have samples.
LARGE_RESULTS = 2
# Maximum number of samples in all results of a step; the newest result always stays.
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
        """Result of a step: the cached result for equal inputs `made_of`, else that of `make`.

        `maximum`: number of results in the cache; `samples`: number of samples of a result.
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
