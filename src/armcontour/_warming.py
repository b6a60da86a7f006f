"""Compiling ahead: all compiled functions, or those of a usual run, in several processes.

`_kernels.txt` lists what each function is called with, one call a line, and which runs call it so.
Functions that others call come first: those load them, where they would compile them again.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path as FilePath
from threading import Condition, Thread
from typing import Any, Literal, TypeAlias

from armcontour import _kernel_files, _kernels, _signatures
from armcontour._kernels import KERNELS, compiled, waiting
from armcontour._pool import Crew, open_executor
from armcontour._process import can_start, is_other, processors
from armcontour._progress import COMPILING, Progress, Step, tell_compiling, under
from armcontour.errors import ArmContourError

# Runs on plane arms, runs on arms in space, both, and everything.
Which: TypeAlias = Literal["plane", "space", "usual", "all"]
# Which others hold all functions of some runs.
HOLDERS: dict[Which, tuple[Which, ...]] = {
    "plane": ("usual", "all"),
    "space": ("usual", "all"),
    "usual": ("all",),
    "all": (),
}
# Names of a module and a function.
Key: TypeAlias = tuple[str, str]
LIST = FilePath(__file__).with_name("_kernels.txt")
# What a run goes on after: it compiles what it needs.
FAILURES = (ArmContourError, RuntimeError, OSError)
# Memory of a process that compiles [bytes].
EACH = 0.4e9


@dataclass(frozen=True)
class Kernel:
    """A compiled function, and what it is called with.

    Args:
        module: Name of its module.
        name: Name of the function.
        arguments: Types of arguments, one text for each kind of call.
    """

    module: str
    name: str
    arguments: tuple[str, ...]

    @property
    def key(self) -> Key:
        """Names of the module and of the function."""
        return self.module, self.name

    @property
    def dispatcher(self) -> Any:
        """The function itself; None if there is no such function any more."""
        with suppress(ImportError):
            import_module(self.module)
        return KERNELS.get(self.key)

    def __str__(self) -> str:
        """The name without that of the package."""
        return f"{self.module.partition('.')[2]}.{self.name}"


@dataclass(frozen=True)
class Warmed:
    """What `warm` did.

    Args:
        functions: Number of functions that are compiled now.
        compiled: How many of them were not before.
        folder: Where they are kept.
    """

    functions: int
    compiled: int
    folder: FilePath


def warm(which: Which = "all", progress: Progress | None = None) -> Warmed:
    """Compile functions that are not compiled yet, in as many processes as the machine bears.

    Args:
        which: Which functions.
        progress: Called with the function that was compiled last, and the share that is done.

    Raises:
        ExecutionError: A process ended before its work did.
    """
    listed = read_list(which)
    stamp = _Stamp(which)
    compiled = 0
    if not _is_warm(which):
        order = _order(listed, progress)
        _share(order)
        compiled = order.compiled
        stamp.set()
    return Warmed(len(listed), compiled, stamp.folder)


@contextmanager
def warm_for_run(dimension: int | None, progress: Progress) -> Iterator[None]:
    """Compile what a usual run needs, if it is not compiled yet, in other processes meanwhile.

    What is called inside waits for the functions that it needs, which are compiled first then.
    What fails here is compiled where it is called.

    Args:
        dimension: Dimension of the arm's work space; None for arms of both dimensions.
        progress: Called as by `warm`, while something is waited for.
    """
    which: Which = "usual" if dimension is None else "plane" if dimension == 2 else "space"

    def tell(step: Step) -> None:
        if step.done == 0.0:
            tell_compiling(step.names[-1])
        progress(step)

    if _is_warm(which):
        yield
        return
    if not can_start():
        # One process cannot compile and wait for it.
        with suppress(*FAILURES):
            warm(which, tell)
        yield
        return
    order = _order(read_list(which), tell, always=False)
    helpers = Thread(target=_share_quietly, args=(order,), name="compiling")
    helpers.start()
    try:
        with waiting(order.wait):
            yield
    except BaseException:
        order.give_up()
        raise
    finally:
        helpers.join()
    if order.is_done:
        _Stamp(which).set()


def read_list(which: Which) -> list[Kernel]:
    """The functions that a kind of run needs, in the order of the list."""
    found: dict[Key, list[str]] = {}
    for line in LIST.read_text(encoding="utf-8").splitlines():
        runs, call = line.split(" ", 1)
        if which == "all" or which in runs.split(",") or (which == "usual" and runs != "-"):
            function, _, arguments = call.partition("(")
            module, _, name = function.rpartition(".")
            found.setdefault((module, name), []).append(arguments.removesuffix(")"))
    return [Kernel(module, name, tuple(x)) for (module, name), x in found.items()]


def _is_warm(which: Which) -> bool:
    """Whether all functions of some runs have been compiled."""
    return any(_Stamp(x).holds() for x in (which, *HOLDERS[which]))


def _order(kernels: Sequence[Kernel], progress: Progress | None, *, always: bool = True) -> Order:
    """The order of functions, which tells what it is about at once."""
    tell = under(progress, COMPILING, f"{len(kernels)} functions in {_processes()} processes")
    tell(Step((), 0.0))
    return Order(kernels, tell, always=always)


def _share(order: Order) -> None:
    """Compile functions in other processes.

    Raises:
        ExecutionError: A process ended before its work did.
    """
    try:
        workers = _processes() if can_start() else 0
        with open_executor(workers) as pool, Crew[Kernel, int](compile_kernel, pool) as crew:
            while True:
                while len(crew) < crew.workers and (kernel := order.take()) is not None:
                    crew.give(kernel)
                if not len(crew):
                    return
                for kernel, compiled in crew.take():
                    order.finish(kernel, compiled)
    finally:
        order.give_up()


def _share_quietly(order: Order) -> None:
    """Compile functions in other processes, as far as they come."""
    with suppress(*FAILURES):
        _share(order)


def compile_kernel(kernel: Kernel) -> int:
    """Compile a function, or load it where it is compiled; returns how often it was compiled."""
    from numba.core.errors import NumbaError

    if is_other():
        # Numba makes so much that looking for garbage in it takes a tenth of the time.
        gc.disable()
    dispatcher = kernel.dispatcher
    for text in kernel.arguments:
        # A list that is not up to date: the function is compiled where it is called.
        with suppress(NumbaError, TypeError):
            dispatcher.compile(_signatures.from_text(text))
    return sum(dispatcher.stats.cache_misses.values())


class Order:
    """Which function comes next: one whose callees are done, and that most others wait for.

    Args:
        kernels: The functions.
        tell: Called after each function.
        always: Whether it is called even if nobody waits for a function.
    """

    def __init__(self, kernels: Sequence[Kernel], tell: Progress, *, always: bool = True) -> None:
        self._tell, self._always, self._news = tell, always, Condition()
        self.compiled = 0
        self._left = {x.key: x for x in kernels if x.dispatcher is not None}
        needs = {key: _callees(key) - {key} for key in self._left}
        self._needs = {key: x & self._left.keys() for key, x in needs.items()}
        # The length of its code stands for the time to compile a function, and that of all
        # functions that call it for what waits.
        self._size = {x: len(KERNELS[x].py_func.__code__.co_code) for x in self._left}
        self._rank = dict(self._size)
        for caller, callees in self._needs.items():
            for x in callees:
                self._rank[x] += self._size[caller]
        self._whole, self._done = sum(self._size.values()), 0
        self._away = set[Key]()
        # What somebody waits for, with what that calls; and how many wait.
        self._wanted = set[Key]()
        self.waits = 0

    @property
    def is_done(self) -> bool:
        """Whether all functions are done."""
        return self._done == self._whole

    def take(self) -> Kernel | None:
        """The next function; None where all others wait for functions that are not done."""
        with self._news:
            undone = self._left.keys() | self._away
            ready = [x for x in self._left if not self._needs[x] & undone]
            if not ready:
                return None
            key = max(ready, key=lambda x: (x in self._wanted, self._rank[x]))
            self._away.add(key)
            return self._left.pop(key)

    def finish(self, item: Kernel, result: int) -> None:
        """Count a function that is done, and how often it was compiled."""
        with self._news:
            self._away.discard(item.key)
            self._done += self._size[item.key]
            self.compiled += result > 0
            if self._always or self.waits:
                self._tell(Step((str(item),), self._done / self._whole))
            self._news.notify_all()

    def wait(self, function: Any) -> None:
        """Wait until a function is compiled, if it is one of these; it comes next."""
        key = function.__module__, function.__name__
        with self._news:
            self._wanted |= {key, *self._needs.get(key, ())}
            self.waits += 1
            while key in self._left or key in self._away:
                self._news.wait()
            self.waits -= 1

    def give_up(self) -> None:
        """Have no functions any more."""
        with self._news:
            self._left.clear()
            self._away.clear()
            self._news.notify_all()


class _Stamp:
    """A file beside the compiled functions that says of which state they are.

    Args:
        which: Which functions.
    """

    def __init__(self, which: Which) -> None:
        kept: Any = _kept
        self.folder = FilePath(kept.stats.cache_path)
        self._file = self.folder / f"compiled-{which}.json"
        self._kernels = read_list(which)

    def holds(self) -> bool:
        """Whether all has been compiled in this state, and is still there."""
        try:
            state, folders = json.loads(self._file.read_text(encoding="utf-8"))
            return state == self._state() and all(_count(x) >= n for x, n in folders.items())
        except (OSError, ValueError):
            return False

    def set(self) -> None:
        """Say that all has been compiled in this state."""
        there = [x.dispatcher for x in self._kernels]
        folders = {x.stats.cache_path for x in there if x is not None}
        state = [self._state(), {x: _count(x) for x in sorted(folders)}]
        with suppress(OSError):
            self._file.write_text(json.dumps(state), encoding="utf-8")

    def _state(self) -> list[str]:
        """What compiled functions depend on."""
        import numba
        from llvmlite.binding import get_host_cpu_name

        sources = hashlib.sha256(LIST.read_bytes())
        root = FilePath(__file__).parents[1]
        modules = {_kernels.__name__, _kernel_files.__name__, *(x.module for x in self._kernels)}
        for module in sorted(modules):
            sources.update(root.joinpath(*module.split(".")).with_suffix(".py").read_bytes())
        return [numba.__version__, sys.version, get_host_cpu_name(), sources.hexdigest()]


@compiled()
def _kept(x: float) -> float:
    """Nothing: numba knows where it keeps this function, and so where it keeps others."""
    return x


def _count(folder: str) -> int:
    """Number of compiled functions in a folder."""
    return len(list(FilePath(folder).glob("*.nbi")))


def _callees(key: Key) -> set[Key]:
    """Compiled functions that a compiled function calls, and those that they call."""
    found: set[Key] = set()
    new = [key]
    while new:
        function = KERNELS[new.pop()].py_func
        for name in function.__code__.co_names:
            made = getattr(function.__globals__.get(name), "py_func", None)
            x = (getattr(made, "__module__", ""), getattr(made, "__name__", ""))
            if x in KERNELS and x not in found:
                found.add(x)
                new.append(x)
    return found


def _processes() -> int:
    """Number of processes: one a processor, as far as the memory goes."""
    if sys.platform != "linux":
        return processors()
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(processors(), int(free / EACH)))
