"""The decorator of every compiled function: cached, and without the interpreter's lock.

While a compiled function runs, other threads go on. The command line needs that: its main thread
answers signals while the work is done in another.
"""

from __future__ import annotations

import functools
import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from numba import njit, types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

from armcontour.core import progress

# For `fastmath`: products may be added without rounding in between, which is faster and no less
# exact.
FUSED = {"contract"}
# All compiled functions of modules that are imported, by module and name.
KERNELS: dict[tuple[str, str], Any] = {}
# Called with a function before its code is looked for on disk: others may be compiling it.
_waiting: list[Callable[[Any], None]] = []
# Where nobody listens, the log tells of compiling that goes on for longer than this [s].
PATIENCE = 2.0
ROOT = Path(__file__).parents[1]
IMPORT = re.compile(r"^from (armcontour\.[\w.]+) import", re.MULTILINE)
COMPILED = re.compile(r"^@compiled\(", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])

# glibc keeps as much of the memory that is freed as twice the largest block that was freed so far,
# and gives the rest back to the system, which clears each page anew. A block of this size is freed
# here, untouched [bytes]: otherwise it takes a fifth more time to evaluate an execution.
np.empty(16_000_000, np.uint8)


def compiled(
    *, inner: bool = False, allocates: bool = False, **options: Any
) -> Callable[[Function], Function]:
    """A decorator that compiles a function at its first call, and keeps the result on disk.

    Args:
        inner: Whether only compiled functions call the function: half of the time to compile a
            small function goes into what Python needs to call it.
        allocates: Whether an inner function makes arrays. If not, references to arrays are counted
            by those who call it, which is faster.
        options: More options of `numba.njit`, such as `inline="always"`.
    """
    # Nothing calls compiled functions by C pointers.
    options |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": inner}
    # Said of all functions, as numba takes what is not said from the function that calls.
    options["_nrt"] = allocates or not inner
    if inner and not allocates:
        # Calls with tuples of arrays put a hundred words on the stack.
        options.setdefault("forceinline", True)
    decorate = njit(error_model="numpy", nogil=True, **options)

    def keep(function: Function) -> Function:
        kernel: Function = decorate(function)
        # Typing does not see that the decorator makes an object of numba.
        made: Any = kernel
        made._cache = _Files(function)
        _take_no_literals(kernel)
        if inner:
            _refuse_calls(kernel, function.__name__)
        KERNELS[function.__module__, function.__name__] = kernel
        return kernel

    return keep


class _Files(FunctionCache):
    """Files of a compiled function, loaded without the modules that only compiling needs.

    Numba stamps the files with the state of the function's source only. Here the stamp includes
    the sources of the compiled functions that it calls.
    """

    def __init__(self, function: Function) -> None:
        super().__init__(function)
        source = Path(function.__code__.co_filename)
        files = sorted({source} | _sources(source))
        index: Any = self._cache_file
        index._source_stamp = tuple((x.name, x.stat().st_mtime, x.stat().st_size) for x in files)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function; None if its files are missing, incomplete or out of date."""
        for wait in tuple(_waiting):
            wait(self._py_func)
        # Compiled code needs this to count references. A refresh of the whole target would import
        # hundreds of modules; numba refreshes it before it compiles.
        rtsys.initialize(target)
        try:
            return self._load_overload(signature, target)
        except Exception:
            # Numba would read the index again before it writes the new files.
            with suppress(OSError):
                self.flush()
        return None


@functools.cache
def _sources(file: Path) -> frozenset[Path]:
    """A file with compiled functions and those that it imports; nothing for other files."""
    text = file.read_text(encoding="utf-8")
    if COMPILED.search(text) is None:
        return frozenset()
    names = (x.split(".")[1:] for x in IMPORT.findall(text))
    files = (ROOT.joinpath(*x).with_suffix(".py") for x in names)
    return frozenset({file}).union(*(_sources(x) for x in files if x.is_file()))


def _take_no_literals(kernel: Any) -> None:
    """Make compiled callers take the same version for `f(0)` as for `f(i)`.

    For numba each number written in a call is a type, for which it compiles the function once more.
    """
    find = kernel.get_call_template

    def find_for_numbers(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(x) for name, x in kws.items()}
        return find(tuple(types.unliteral(x) for x in args), plain)

    kernel.get_call_template = find_for_numbers


def _refuse_calls(kernel: Any, name: str) -> None:
    """Make calls from Python an error, where they would end the process."""

    def refuse(*args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError(f"{name} is compiled to be called by compiled functions only (inner=True).")

    # What numba calls if it knows no version for the arguments; and what tells it a version.
    kernel._compile_for_args = refuse
    kernel._insert = lambda *args: None


@contextmanager
def waiting(wait: Callable[[Any], None]) -> Iterator[None]:
    """Call something with each function that has to be loaded or compiled meanwhile, before it.

    Args:
        wait: Called with the function; it returns when nobody else is compiling the function.
    """
    _waiting.append(wait)
    try:
        yield
    finally:
        _waiting.remove(wait)


class _Listener(event.Listener):
    """Tells who wants to know it that a function is being compiled; else the log, once."""

    def __init__(self) -> None:
        self._begin: float | None = None
        self._logged = False

    def on_start(self, event: Any) -> None:
        """Tell the name of a function of this package."""
        function = event.data["dispatcher"].py_func
        if not function.__module__.startswith(f"{__package__}."):
            return
        name = f"{function.__module__}.{function.__name__}"
        if not (progress.tell_compiling(name) or self._logged):
            self._log()

    def on_end(self, event: Any) -> None:
        """Nothing."""

    def _log(self) -> None:
        """Log that functions are compiled, if they were before, a while ago."""
        now = time.monotonic()
        self._begin = self._begin or now
        if now > self._begin + PATIENCE:
            self._logged = True
            logging.getLogger(__package__).warning(
                "armcontour compiles the functions of this job that were not compiled yet, which "
                "may take a minute or two. `armcontour warm` compiles all, on all processors."
            )


event.register("numba:compile", _Listener())
