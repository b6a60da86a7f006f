"""Compile functions ahead in several processes: all of them, or those of a usual run.

`kernels.txt` lists the runs that call a function, and the types of its arguments, one call a line.
A function is compiled after those that it calls, because it loads them then.
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

from armcontour.core import kernels
from armcontour.core.errors import ArmContourError
from armcontour.core.kernels import KERNELS, PACKAGE, ROOT, waiting
from armcontour.core.pool import TaskQueue, open_executor
from armcontour.core.process import can_start, is_other, processors
from armcontour.core.progress import COMPILING, Progress, Step, subprogress, tell_compiling
from armcontour.core.quintics import solve_banded

# Runs on plane arms, runs on arms in space, both, and everything.
Which: TypeAlias = Literal["plane", "space", "usual", "all"]
# The kinds whose functions a kind includes.
INCLUDED: dict[Which, tuple[Which, ...]] = {
    "plane": ("plane",),
    "space": ("space",),
    "usual": ("plane", "space", "usual"),
    "all": ("plane", "space", "usual", "all"),
}
# Names of a module and a function.
Key: TypeAlias = tuple[str, str]
# A function, and the types of its arguments for each kind of call.
Calls: TypeAlias = tuple[Key, list[str]]
LIST = FilePath(__file__).with_name("kernels.txt")
# A run goes on after these errors: it compiles what it needs.
FAILURES = (ArmContourError, RuntimeError, OSError)
# Memory of a process that compiles [bytes].
EACH = 0.4e9


class Warmed(NamedTuple):
    """Result of `warm`.

    Args:
        functions: Number of functions that are compiled now.
        compiled: Number of functions that were not compiled before.
        folder: Folder of their files.
    """

    functions: int
    compiled: int
    folder: FilePath


def warm(which: Which = "all", progress: Progress | None = None) -> Warmed:
    """Compile functions that are not compiled yet, in as many processes as the memory allows.

    Args:
        which: Which functions.
        progress: Called with the function that was compiled last, and the share that is done.

    Raises:
        ExecutionError: A process ended before its work did.
    """
    listed, compiled = read_list(which), 0
    if not _is_warm(which):
        order = Order(listed, progress)
        order.work_off()
        compiled = order.compiled
        _stamp(which)
    return Warmed(len(listed), compiled, _folder())


@contextmanager
def warm_for_run(dimension: int | None, progress: Progress) -> Iterator[None]:
    """Compile the functions of a usual run in other processes meanwhile, if they are not compiled.

    The run waits where it needs a function that is not compiled; that function comes next. If the
    other processes fail, the run compiles the function itself.

    Args:
        dimension: Dimension of the arm's work space; None for arms of both dimensions.
        progress: Called as by `warm`, while the run waits.
    """
    which: Which = "usual" if dimension is None else "plane" if dimension == 2 else "space"
    if _is_warm(which) or not can_start():
        yield
        return

    def tell(step: Step) -> None:
        if order.waits or not step.done:
            progress(step)
        if not step.done:
            tell_compiling(step.names[-1])

    def work() -> None:
        with suppress(*FAILURES):
            order.work_off()
        if order.is_done:
            _stamp(which)

    order = Order(read_list(which), tell)
    helper = Thread(target=work, name="compiling")
    helper.start()
    try:
        with waiting(order.wait):
            yield
    except BaseException:
        order.give_up()
        raise
    finally:
        helper.join()


def read_list(which: Which) -> dict[Key, list[str]]:
    """Arguments of the functions that a kind of run calls, in the order of the list."""
    listed: dict[Key, list[str]] = {}
    for line in LIST.read_text(encoding="utf-8").splitlines():
        runs, call = line.split(" ", 1)
        if which == "all" or which in runs.split(",") or (which == "usual" and runs != "-"):
            function, _, arguments = call.partition("(")
            module, _, name = function.rpartition(".")
            listed.setdefault((module, name), []).append(arguments.removesuffix(")"))
    return listed


def compile_calls(calls: Calls) -> int:
    """Compile a function, or load it if it is compiled; returns how often it was compiled."""
    from numba.core.errors import NumbaError

    if is_other():
        # Numba makes so many objects that collecting garbage takes a tenth of the time.
        gc.disable()
    key, arguments = calls
    dispatcher = _dispatcher(key)
    for text in arguments:
        # If the list is not up to date, the function is compiled at its first call.
        with suppress(NumbaError, TypeError):
            dispatcher.compile(from_text(text))
    return sum(dispatcher.stats.cache_misses.values())


def from_text(text: str) -> tuple[Any, ...]:
    """Types of arguments from text such as `float64[:, ::1], const(float64[::1]), int64`.

    The text is Python in the words of `numba.types`, and three more: `const`, for an array that is
    read-only, `named`, for a named tuple, and `Vector`, of `simd`.
    """
    # Only some of these types have annotations.
    types: Any = import_module("numba.types")
    from armcontour.core.simd import VECTOR

    def named(module: str, name: str, *parts: Any) -> Any:
        kind = getattr(import_module(module), name)
        if len(set(parts)) == 1:
            return types.NamedUniTuple(parts[0], len(parts), kind)
        return types.NamedTuple(parts, kind)

    words = {"const": lambda x: x.copy(readonly=True), "named": named, "Vector": VECTOR}
    # The text comes from this package.
    kinds: tuple[Any, ...] = eval(f"({text},)" if text else "()", vars(types) | words)
    return kinds


class Order:
    """Functions in the order in which they are compiled: the longest whose callees are done.

    Args:
        listed: Arguments of the functions.
        progress: Called at the start and after each function.
    """

    def __init__(self, listed: dict[Key, list[str]], progress: Progress | None) -> None:
        self._tell = subprogress(
            progress, COMPILING, f"{len(listed)} functions in {_processes()} processes"
        )
        self._news = Condition()
        # Functions to be compiled, and those of them that a process compiles.
        self._left = {key: x for key, x in listed.items() if _dispatcher(key) is not None}
        self._away = set[Key]()
        self._needs = {key: _callees(key) for key in self._left}
        # The length of its code stands for the time to compile a function.
        self._size = {key: len(KERNELS[key].py_func.__code__.co_code) for key in self._left}
        self._whole = sum(self._size.values())
        self._wanted = set[Key]()
        self.waits = self.compiled = self._done = 0

    @property
    def is_done(self) -> bool:
        """Whether all functions are compiled."""
        return self._done == self._whole

    def work_off(self) -> None:
        """Compile the functions in other processes.

        Raises:
            ExecutionError: A process ended before its work did.
        """
        self._tell(Step((), 0.0))
        try:
            workers = _processes() if can_start() else 0
            with open_executor(workers) as pool, TaskQueue[Calls, int](compile_calls, pool) as crew:
                while self._left or len(crew):
                    while len(crew) < crew.workers and (calls := self._take()):
                        crew.give(calls)
                    for (key, _), compiled in crew.take():
                        self._finish(key, compiled)
        finally:
            self.give_up()

    def wait(self, function: Any) -> None:
        """Wait until a function is compiled, if it is one of these; it comes next."""
        key = function.__module__, function.__name__
        with self._news:
            self._wanted |= {key, *self._needs.get(key, ())}
            self.waits += 1
            self._news.wait_for(lambda: key not in self._left)
            self.waits -= 1

    def give_up(self) -> None:
        """Compile no further functions."""
        with self._news:
            self._left.clear()
            self._news.notify_all()

    def _take(self) -> Calls | None:
        """The next function; None if all others wait for functions that are not done."""
        with self._news:
            undone = self._left.keys()
            ready = [x for x in undone - self._away if not self._needs[x] & undone]
            if not ready:
                return None
            key = max(ready, key=lambda x: (x in self._wanted, self._size[x]))
            self._away.add(key)
            return key, self._left[key]

    def _finish(self, key: Key, compiled: int) -> None:
        """Count a function that is done, and how often it was compiled."""
        with self._news:
            self._left.pop(key, None)
            self._done += self._size[key]
            self.compiled += compiled > 0
            name = ".".join(key).removeprefix(f"{PACKAGE}.")
            self._tell(Step((name,), self._done / self._whole))
            self._news.notify_all()


def _dispatcher(key: Key) -> Any:
    """The compiled function of these names; None if there is none any more."""
    with suppress(ImportError):
        import_module(key[0])
    return KERNELS.get(key)


def _callees(key: Key) -> set[Key]:
    """Other compiled functions that a compiled function calls, directly or not."""
    reached, new = {key}, [key]
    while new:
        function = KERNELS[new.pop()].py_func
        for name in function.__code__.co_names:
            made = getattr(function.__globals__.get(name), "py_func", None)
            callee = (getattr(made, "__module__", ""), getattr(made, "__name__", ""))
            if callee in KERNELS and callee not in reached:
                reached.add(callee)
                new.append(callee)
    return reached - {key}


def _folder() -> FilePath:
    """Folder of the compiled functions of the package's own modules."""
    kernel: Any = solve_banded
    return FilePath(kernel.stats.cache_path)


def _state() -> str:
    """Digest of everything that the compiled functions depend on."""
    import numba
    from llvmlite.binding import get_host_cpu_name

    versions = numba.__version__, sys.version, get_host_cpu_name()
    state = hashlib.sha256(repr(versions).encode() + LIST.read_bytes())
    for module in sorted({kernels.__name__, *(module for module, _ in read_list("all"))}):
        file = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
        state.update(file.read_bytes())
    return state.hexdigest()


def _is_warm(which: Which) -> bool:
    """Whether the functions have been compiled in this state."""
    with suppress(OSError):
        return (_folder() / f"compiled-{which}.txt").read_text(encoding="utf-8") == _state()
    return False


def _stamp(which: Which) -> None:
    """Note that the functions have been compiled in this state."""
    with suppress(OSError):
        for name in INCLUDED[which]:
            (_folder() / f"compiled-{name}.txt").write_text(_state(), encoding="utf-8")


def _processes() -> int:
    """Number of processes: one a processor, if they have enough memory."""
    if sys.platform != "linux":
        return processors()
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(processors(), int(free / EACH)))
