"""Compiled work in threads of this process: it lets other threads go on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from armcontour._process import is_other, processors

T = TypeVar("T")
R = TypeVar("R")
# Largest number of threads that share compiled work; their results are put together in one.
MOST_THREADS = 8


def map_in_threads(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Do compiled work on all items, in threads: it lets other threads of this process go on.

    Calls should take a millisecond or more: between them a thread waits for the others.

    Args:
        work: The work, nearly all of it in few calls of compiled functions.
        items: The items, in whose order the results are.
    """
    count = 1 if is_other() else min(processors(), MOST_THREADS, len(items))
    if count < 2:
        return [work(x) for x in items]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, items))


def split_evenly(count: int, parts: int) -> list[slice]:
    """Slices of so many parts, about equally long, that make up a sequence.

    Args:
        count: Length of the sequence.
        parts: Largest number of parts.
    """
    few = max(1, min(parts, count))
    return [slice(count * k // few, count * (k + 1) // few) for k in range(few)]
