"""`Reuse`: cache of the results of planning steps by their inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
# Number of results of each step in the cache: those of a few runs that a user compares.
RESULTS = 4
# Number of sampled results in the cache: 2, or 1 above 200,000 samples.
LARGE_RESULTS, MAX_SAMPLES = 2, 200_000


class Reuse:
    """A cache of the results of steps: a step with the same inputs is not repeated."""

    def __init__(self, size: int = RESULTS) -> None:
        self.size = size
        self._known: dict[str, list[tuple[Any, Any]]] = {}

    def get(
        self,
        step: str,
        made_of: Any,
        make: Callable[[], T],
        *,
        maximum: int | None = None,
        samples: Callable[[T], int] = lambda value: 0,
    ) -> T:
        """The result of a step: that of an earlier call with the same inputs, or a new one."""
        entries = self._known.setdefault(step, [])
        for k, (before, value) in enumerate(entries):
            if before == made_of:
                entries.insert(0, entries.pop(k))
                result: T = value
                return result
        value = make()
        entries.insert(0, (made_of, value))
        del entries[self.size if maximum is None else maximum :]
        while len(entries) > 1 and sum(samples(x) for _, x in entries) > MAX_SAMPLES:
            del entries[-1]
        return value


def comparable(value: Any) -> Any:
    """A comparable form of a value whose fields are numbers and arrays."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return [comparable(getattr(value, x.name)) for x in dataclasses.fields(value)]
    if isinstance(value, Mapping):
        return {name: comparable(x) for name, x in value.items()}
    if isinstance(value, tuple):
        return [comparable(x) for x in value]
    return value
