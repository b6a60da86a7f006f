"""The decorator of every compiled function: cached, and without the interpreter's lock.

While a compiled function runs, other threads go on. The command line needs that: its main thread
answers signals while the work is done in another.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

from numba import njit
from numba.core import event

from armcontour import _progress
from armcontour._compiling import Compiler, Files, InnerFiles

# For `fastmath`: products may be added without rounding in between, which is faster and no less
# exact.
FUSED = {"contract"}
# All compiled functions of modules that are imported, by module and name.
KERNELS: dict[tuple[str, str], Any] = {}

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(*, inner: bool = False, **options: Any) -> Callable[[Function], Function]:
    """A decorator that compiles a function at its first call, and keeps the result on disk.

    Args:
        inner: Whether only compiled functions call the function: half of the time to compile a
            small function goes into what Python needs to call it.
        options: More options of `numba.njit`, such as `inline="always"`.
    """
    # Nothing calls compiled functions by C pointers.
    options |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": inner}
    options |= {"error_model": "numpy", "nogil": True, "pipeline_class": Compiler}
    decorate = njit(**options)

    def keep(function: Function) -> Function:
        kernel: Function = decorate(function)
        # Typing does not see that the decorator makes an object of numba.
        made: Any = kernel
        made._cache = (InnerFiles if inner else Files)(function)
        if inner:
            _refuse_calls(kernel, function.__name__)
        KERNELS[function.__module__, function.__name__] = kernel
        return kernel

    return keep


def _refuse_calls(kernel: Any, name: str) -> None:
    """Make calls from Python an error, where they would end the process."""

    def refuse(*args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError(f"{name} is compiled to be called by compiled functions only (inner=True).")

    # What numba calls if it knows no version for the arguments; and what tells it a version.
    kernel._compile_for_args = refuse
    kernel._insert = lambda *args: None


class _Listener(event.Listener):
    """Tells who wants to know it that a function is being compiled."""

    def on_start(self, event: Any) -> None:
        """Tell the name of a function of this package."""
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith(f"{__package__}."):
            _progress.tell_compiling(f"{function.__module__}.{function.__name__}")

    def on_end(self, event: Any) -> None:
        """Nothing."""


event.register("numba:compile", _Listener())
