"""Memory of the results of pure steps, so that a changed job repeats only what has changed."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from armcontour.core.checks import comparable

Value = TypeVar("Value")


class Memory:
    """Results by their inputs, as long as they are used.

    A result is forgotten if neither this nor the previous computation uses it, so that the memory
    has at most two versions of each step.
    """

    def __init__(self) -> None:
        # Result, and number of the computation that used it last, by input.
        self._known: dict[Hashable, tuple[Any, int]] = {}
        # Number of completed computations, which is the number of the running one.
        self._number = 0

    def __len__(self) -> int:
        return len(self._known)

    def recall(self, key: Hashable) -> Any | None:
        """Return the result for an input; None if it is unknown."""
        entry = self._known.get(key)
        if entry is None:
            return None
        self._known[key] = entry[0], self._number
        return entry[0]

    def remember(self, key: Hashable, value: Any) -> None:
        """Store the result for an input."""
        self._known[key] = value, self._number

    def complete(self) -> None:
        """Complete a computation, and forget what it and the previous one did not use."""
        oldest = self._number - 1
        self._known = {key: x for key, x in self._known.items() if x[1] >= oldest}
        self._number += 1


# Memory of the computation in this thread; None without one.
_memory: ContextVar[Memory | None] = ContextVar("memory", default=None)


@contextmanager
def remembering(memory: Memory) -> Iterator[None]:
    """Let the steps in this context, a computation, use a memory.

    If the computation is interrupted by an error, nothing is forgotten.
    """
    token = _memory.set(memory)
    try:
        yield
        memory.complete()
    finally:
        _memory.reset(token)


def is_remembering() -> bool:
    """Return whether steps use a memory."""
    return _memory.get() is not None


def recall(key: Hashable) -> Any | None:
    """Return the known result for an input; None if it is unknown, or without a memory."""
    memory = _memory.get()
    return None if memory is None else memory.recall(key)


def remember(key: Hashable, value: Any) -> None:
    """Store the result for an input, if there is a memory."""
    memory = _memory.get()
    if memory is not None:
        memory.remember(key, value)


def remembered(key: Hashable, make: Callable[[], Value]) -> Value:
    """Return the known result for an input, or that of `make`, which is then stored."""
    known: Value | None = recall(key)
    if known is not None:
        return known
    value = make()
    remember(key, value)
    return value


def content_key(value: Any) -> bytes:
    """Return a key that is equal only for equal values, which may contain arrays."""
    return hashlib.sha256(pickle.dumps(comparable(value))).digest()
