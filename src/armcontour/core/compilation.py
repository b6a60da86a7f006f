"""Ahead-of-time compilation in several processes: of all functions, or for a usual run.

`kernels.txt` lists, one call per line, the runs that call a function and the types of its
arguments. A function is compiled after its callees, because it loads them; inner functions are
compiled with it and are not listed.
"""

from __future__ import annotations

import gc
import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path as FilePath
from threading import Condition, Thread
from typing import Any, Literal, NamedTuple, TypeAlias

from armcontour.core import kernel_cache
from armcontour.core.kernel_cache import (
    KERNELS,
    PACKAGE,
    ROOT,
    SHIPPED,
    SHIPPED_TARGET,
    is_inner,
    waiting,
)
from armcontour.core.pool import can_start, is_child, open_executor, processors, run_all
from armcontour.core.progress import COMPILING, Progress, Step, report_compiling, subprogress
from armcontour.core.quintics import solve_banded

# Kinds of runs: on planar arms, on arms in space, on both; and all functions.
RunKind: TypeAlias = Literal["plane", "space", "usual", "all"]
# Kinds of runs whose functions each kind includes.
INCLUDED: dict[RunKind, tuple[RunKind, ...]] = {
    "plane": ("plane",),
    "space": ("space",),
    "usual": ("plane", "space", "usual"),
    "all": ("plane", "space", "usual", "all"),
}
# Name of the module, and name of the function in it.
FunctionName: TypeAlias = tuple[str, str]
# A function, and the argument types of its calls as text.
FunctionCalls: TypeAlias = tuple[FunctionName, list[str]]
# File beside the compiled functions with the state in which all functions of a kind were compiled.
STAMP = "compiled-{}.txt"
LIST = FilePath(__file__).with_name("kernels.txt")
# Memory of one compiling process [bytes].
MEMORY = 0.4e9


class CompiledKernels(NamedTuple):
    """What `compile_kernels` has compiled."""

    functions: int
    compiled: int  # Number of functions that this call compiled
    folder: FilePath | None  # None if no folder can be written


def compile_kernels(kind: RunKind = "all", progress: Progress | None = None) -> CompiledKernels:
    """Compile functions that are not compiled yet, in as many processes as the memory allows."""
    listed = read_list(kind)
    compiled = 0
    folder = _find_compiled(kind)
    if folder is None and (folder := _folder()) is not None:
        schedule = CompilationSchedule(listed, progress)
        schedule.run_all()
        compiled = schedule.compiled
        stamp(folder, kind)
    return CompiledKernels(len(listed), compiled, folder)


def _kind_for(dimension: int | None) -> RunKind:
    """Return the kind of run for an arm's dimension; "usual" if it is unknown."""
    if dimension is None:
        return "usual"
    return "plane" if dimension == 2 else "space"


@contextmanager
def compile_for_run(dimension: int | None, progress: Progress) -> Iterator[None]:
    """Compile the functions of a usual run in other processes while the context is open."""
    # If the run needs a function that is not compiled, the run waits, and this function is compiled
    # next. If the other processes fail, the run compiles the function itself.
    kind = _kind_for(dimension)
    folder = _folder()
    if folder is None or _find_compiled(kind) or not can_start():
        yield
        return

    def report_step(step: Step) -> None:
        """Report the name of each function; report the progress only while the run waits."""
        if schedule.waits or not step.done:
            progress(step)
        if not step.done:
            report_compiling(step.names[-1])

    def work() -> None:
        """Compile all functions in other processes; record it if all are compiled."""
        # If the other processes fail, the run itself compiles the functions it needs.
        with suppress(Exception):
            schedule.run_all()
        if schedule.is_done:
            stamp(folder, kind)

    schedule = CompilationSchedule(read_list(kind), report_step)
    helper = Thread(target=work, name="compiling")
    helper.start()
    # Other threads wait for functions until all are compiled.
    with waiting(schedule.wait):
        try:
            yield
        except BaseException:
            schedule.give_up()
            raise
        finally:
            helper.join()


def read_list(kind: RunKind) -> dict[FunctionName, list[str]]:
    """Read kernels.txt: argument types of the functions that a kind of run calls, in order."""
    listed: dict[FunctionName, list[str]] = {}
    for line in LIST.read_text(encoding="utf-8").splitlines():
        runs, call = line.split(" ", 1)
        if kind == "all" or kind in runs.split(",") or (kind == "usual" and runs != "-"):
            function, _, arguments = call.partition("(")
            module, _, name = function.rpartition(".")
            listed.setdefault((module, name), []).append(arguments.removesuffix(")"))
    return listed


def compile_calls(calls: FunctionCalls) -> int:
    """Compile a function or load its compiled form; return the number of compilations."""
    from numba.core.errors import NumbaError

    if is_child():
        # Numba creates so many objects that garbage collection takes a tenth of the time.
        gc.disable()
    key, arguments = calls
    dispatcher = _dispatcher(key)
    for text in arguments:
        # If the list is not up to date, the function is compiled at its first call.
        with suppress(NumbaError, TypeError):
            dispatcher.compile(from_text(text))
    return sum(dispatcher.stats.cache_misses.values())


def from_text(text: str) -> tuple[Any, ...]:
    """Read argument types from text such as `float64[:, ::1], const(float64[::1]), int64`."""
    # The text is a Python expression with the names of `numba.types` and three more: `const` for a
    # read-only array, `named` for a named tuple, and `Vector` of `simd`.
    # numba.types is only partly annotated.
    types: Any = import_module("numba.types")
    from armcontour.core.simd import VECTOR

    def named(module: str, name: str, *parts: Any) -> Any:
        """Make the type of a named tuple from its class and the types of its fields."""
        kind = getattr(import_module(module), name)
        if len(set(parts)) == 1:
            return types.NamedUniTuple(parts[0], len(parts), kind)
        return types.NamedTuple(parts, kind)

    words = {"const": lambda x: x.copy(readonly=True), "named": named, "Vector": VECTOR}
    # The text comes from this package, so that it is safe to evaluate.
    kinds: tuple[Any, ...] = eval(f"({text},)" if text else "()", vars(types) | words)
    return kinds


class CompilationSchedule:
    """Order of compilation: the longest function whose callees are compiled is next."""

    def __init__(self, listed: dict[FunctionName, list[str]], progress: Progress | None) -> None:
        self._tell = subprogress(
            progress, COMPILING, f"{len(listed)} functions in {_processes()} processes"
        )
        self._changed = Condition()
        # Functions that are not compiled yet, and functions that were given to a process.
        self._remaining = {key: x for key, x in listed.items() if _dispatcher(key) is not None}
        self._started = set[FunctionName]()
        # Compiled functions that each function calls.
        self._needs = {key: _callees(key) for key in self._remaining}
        # Length of the code with that of its inner functions, which are compiled with it [bytes],
        # as an estimate of the time to compile.
        self._size = {key: _code_size(key) for key in self._remaining}
        self._total = sum(self._size.values())
        self._requested = set[FunctionName]()
        self.waits = self.compiled = self._done = 0

    @property
    def is_done(self) -> bool:
        """True if all functions are compiled."""
        return self._done == self._total

    def run_all(self) -> None:
        """Compile the functions in other processes."""
        self._tell(Step((), 0.0))
        try:
            with open_executor(_processes()) as pool:
                for (key, _), compiled in run_all(compile_calls, self._take, pool):
                    self._finish(key, compiled)
        finally:
            self.give_up()

    def wait(self, function: Any) -> None:
        """Give a function priority, and wait until it is compiled; no wait if it is not listed."""
        key = function.__module__, function.__name__
        with self._changed:
            self._requested |= {key, *self._needs.get(key, ())}
            self.waits += 1
            self._changed.wait_for(lambda: key not in self._remaining)
            self.waits -= 1

    def give_up(self) -> None:
        """Compile no further functions."""
        with self._changed:
            self._remaining.clear()
            self._changed.notify_all()

    def _take(self) -> FunctionCalls | None:
        """Take the next function to compile; None if all others are started or wait for callees."""
        with self._changed:
            undone = self._remaining.keys()
            ready = [x for x in undone - self._started if not self._needs[x] & undone]
            if not ready:
                return None
            key = max(ready, key=lambda x: (x in self._requested, self._size[x]))
            self._started.add(key)
            return key, self._remaining[key]

    def _finish(self, key: FunctionName, compiled: int) -> None:
        """Record that a function is finished; count it if it had to be compiled."""
        with self._changed:
            self._remaining.pop(key, None)
            self._done += self._size[key]
            self.compiled += compiled > 0
            name = ".".join(key).removeprefix(f"{PACKAGE}.")
            self._tell(Step((name,), self._done / self._total))
            self._changed.notify_all()


def _dispatcher(key: FunctionName) -> Any:
    """Return the compiled function of a module and name; None if it does not exist."""
    with suppress(ImportError):
        import_module(key[0])
    return KERNELS.get(key)


def _callees(key: FunctionName) -> set[FunctionName]:
    """Return the compiled functions that a compiled function calls, directly or indirectly."""
    reached = {key}
    new = [key]
    while new:
        function = KERNELS[new.pop()].py_func
        for name in function.__code__.co_names:
            made = getattr(function.__globals__.get(name), "py_func", None)
            callee = (getattr(made, "__module__", ""), getattr(made, "__name__", ""))
            if callee in KERNELS and callee not in reached:
                reached.add(callee)
                new.append(callee)
    return reached - {key}


def _code_size(key: FunctionName) -> int:
    """Return the length of a function's code with that of the inner functions it calls [bytes]."""
    inner = {x for x in _callees(key) if is_inner(KERNELS[x])}
    return sum(len(KERNELS[x].py_func.__code__.co_code) for x in {key, *inner})


def _folder() -> FilePath | None:
    """Return the folder of this installation's compiled functions; None if it cannot be written."""
    kernel: Any = solve_banded
    folder = FilePath(kernel.stats.cache_path)
    return folder if folder.is_dir() else None


def _find_compiled(kind: RunKind) -> FilePath | None:
    """Return a folder in which all functions are compiled in the present `_state`."""
    candidates = [(_folder(), kernel_cache.target())]
    if kernel_cache.runs_shipped():
        candidates.append((SHIPPED, SHIPPED_TARGET))
    for folder, target in candidates:
        with suppress(OSError):
            if folder and (folder / STAMP.format(kind)).read_text("utf-8") == _state(target):
                return folder
    return None


def stamp(folder: FilePath, kind: RunKind, target: kernel_cache.Target | None = None) -> None:
    """Record that the functions in a folder have been compiled in the present state."""
    with suppress(OSError):
        state = _state(target or kernel_cache.target())
        for name in INCLUDED[kind]:
            (folder / STAMP.format(name)).write_text(state, "utf-8")


def used_sources() -> set[FilePath]:
    """Return the sources on which the listed functions depend."""
    found: set[FilePath] = set()
    for module in {module for module, _ in read_list("all")}:
        file = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
        found |= kernel_cache.sources(file)
    return found


def _state(target: kernel_cache.Target) -> str:
    """Return a digest of everything on which the compiled functions depend."""
    import numba

    # Builds of Python without the interpreter's lock differ in their flags only.
    python = sys.implementation.cache_tag, getattr(sys, "abiflags", "")
    digests = map(kernel_cache.digest, sorted(used_sources()))
    parts = numba.__version__, python, target, LIST.read_text("utf-8"), *digests
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _processes() -> int:
    """Count the processes: one per processor, if the memory suffices."""
    if sys.platform != "linux":
        return processors()
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(processors(), int(free / MEMORY)))
