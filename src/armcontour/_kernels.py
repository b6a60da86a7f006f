"""The decorator of every compiled function: cached, and without the interpreter's lock.

While a compiled function runs, other threads go on. The command line needs that: its main thread
answers signals while the work is done in another.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

# For `fastmath`: products may be added without rounding in between, which is faster and no less
# exact.
FUSED = {"contract"}

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(**options: Any) -> Callable[[Function], Function]:
    """A decorator that compiles a function at its first call, and keeps the result on disk.

    Args:
        options: More options of `numba.njit`, such as `inline="always"`.
    """
    decorate: Callable[[Function], Function] = njit(
        cache=True, error_model="numpy", nogil=True, **options
    )
    return decorate
