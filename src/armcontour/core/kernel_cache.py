"""Decorator of compiled functions, which are cached on disk and release the interpreter's lock.

Other threads run while a compiled function runs. The command line needs this, because its main
thread handles signals while another thread works.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import re
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numba import njit, types
from numba.core import event
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    _CacheLocator,
)
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys

from armcontour.core import progress

# For `fastmath`: fused multiply-add, which is faster and no less accurate.
FUSED = {"contract"}
# Compiled functions of imported modules, by module and name.
KERNELS: dict[tuple[str, str], Any] = {}
# Called with a function before its code is loaded, because another process may be compiling it.
_waiting: list[Callable[[Any], None]] = []
# Without listeners, compilation that lasts longer than this is logged [s].
LOGGED_AFTER = 2.0
ROOT = Path(__file__).parents[1]
PACKAGE = ROOT.name
# LLVM's names of a platform, a processor and its features.
Target: TypeAlias = tuple[str, str, str]
# Functions that the wheel contains, compiled by tools/ship.py for processors with AVX2.
# Nothing is written to this folder at run time.
SHIPPED = ROOT / "core" / "shipped"
SHIPPED_TARGET: Target = (
    "x86_64-unknown-linux-gnu",
    "x86-64-v3",
    "+avx,+avx2,+bmi,+bmi2,+cmov,+crc32,+cx16,+cx8,+f16c,+fma,+fxsr,+lzcnt,+mmx,+movbe,+popcnt,"
    "+sahf,+sse,+sse2,+sse3,+sse4.1,+sse4.2,+ssse3",
)
# Types for annotations, which compiled code does not depend on, are imported from `core.checks`.
IMPORT = re.compile(r"^from (armcontour\.(?!core\.checks )[\w.]+) import", re.MULTILINE)
COMPILED = re.compile(r"^@compiled\(", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])

# glibc retains freed memory up to twice the size of the largest freed block. It returns other
# memory to the system, which clears the pages at the next allocation. Freeing this block of 16 MB
# saves a fifth of an evaluation's time.
np.empty(16_000_000, np.uint8)


def compiled(
    *, inner: bool = False, allocates: bool = False, **options: Any
) -> Callable[[Function], Function]:
    """Compile a function at its first call and cache the result on disk.

    `inner` functions are called by compiled functions only. They become machine code as parts of
    their callers, and are cached as such (`_InnerCompiler`). If an inner function does not allocate
    arrays, its callers count references to arrays, which is faster. No code calls compiled
    functions by C pointers.
    """
    options |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": inner}
    # Set for all functions, because numba inherits missing options from the caller.
    options["_nrt"] = allocates or not inner
    if inner and not allocates:
        # Without inlining, calls with tuples of arrays put a hundred words on the stack.
        options.setdefault("forceinline", True)
    if inner:
        options["pipeline_class"] = _InnerCompiler
    decorate = njit(error_model="numpy", nogil=True, **options)

    def keep(function: Function) -> Function:
        """Decorate a function with numba, with files of its own, and register it."""
        kernel: Function = decorate(function)
        # The decorator returns an object of numba, which its annotation does not express.
        made: Any = kernel
        made._cache = NullCache() if inner else _Files(function)
        _take_no_literals(kernel)
        if inner:
            _refuse_calls(kernel, function.__name__)
        KERNELS[function.__module__, function.__name__] = kernel
        return kernel

    return keep


class _NoEnvironments:
    """Takes the place of an inner function's code generator once the function is compiled."""

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: inner functions use no Python objects, which an environment keeps."""


class _InnerLibrary(JITCodeLibrary):
    """Code of an inner function, which is optimized and translated in its callers only.

    Numba would optimize and translate each function for itself, and then, because a caller includes
    the code of its callees, once more for each direct or indirect caller.
    """

    codegen = _NoEnvironments()

    def _optimize_final_module(self) -> None:
        """Do nothing: the callers are optimized with this code."""

    def _finalize_final_module(self) -> None:
        """End the function without machine code."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, which means that there is no machine code."""
        return 0


class _InnerCompiler(Compiler):
    """Compiler of inner functions."""

    def define_pipelines(self) -> Any:
        """Give the function a library of its kind, and return numba's passes."""
        state = self.state
        state.library = _InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


class _NoFolder(_CacheLocator):
    """Fallback if no cache folder is writable: nothing is cached, so each run compiles."""

    def __init__(self, function: Function) -> None:
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Any, file: str) -> _NoFolder:
        """Construct a locator, as numba requires."""
        return cls(function)

    def get_cache_path(self) -> str:
        """Return a folder that cannot exist."""
        return os.path.join(os.devnull, PACKAGE)

    def get_source_stamp(self) -> None:
        """Return nothing; numba requires this method, but `_Files` makes the stamp."""

    def get_disambiguator(self) -> str:
        """Return the same text as the other locators, for the names of the files."""
        return str(self._line)


class _Implementation(CompileResultCacheImpl):
    _locator_classes: Any = [*CompileResultCacheImpl._locator_classes, _NoFolder]


class _Files(FunctionCache):
    """Cache files of a compiled function, loaded without the modules that only compiling needs."""

    # Numba stamps the files with the function's source only. Here the stamp includes the sources of
    # the compiled functions that it calls, and of their constants.
    _impl_class = _Implementation

    def __init__(self, function: Function) -> None:
        super().__init__(function)
        source = Path(function.__code__.co_filename)
        index: Any = self._cache_file
        index._source_stamp = tuple((x.name, digest(x)) for x in sorted(sources(source)))
        self._shipped: Any = None
        if source.is_relative_to(ROOT):
            folder = SHIPPED / source.parent.relative_to(ROOT)
            name = self._impl.filename_base
            self._shipped = IndexDataCacheFile(str(folder), name, index._source_stamp)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Load the compiled function; None if its files are missing, incomplete or out of date."""
        for wait in tuple(_waiting):
            wait(self._py_func)
        # Compiled code needs `rtsys` to count references. A refresh of the whole target would
        # import hundreds of modules; numba refreshes the target before it compiles.
        rtsys.initialize(context)
        try:
            if loaded := self._load_overload(signature, context):
                return loaded
        except Exception:
            # The index is emptied, because numba reads it again before it writes the new files.
            with suppress(OSError):
                self.flush()
        with suppress(Exception):
            if self._shipped and runs_shipped():
                *_, code = self._index_key(signature, context.codegen())
                if data := self._shipped.load((signature, SHIPPED_TARGET, code)):
                    return self._impl.rebuild(context, data)
        return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Save a compiled function, if its folder can be written and the disk is not full."""
        with suppress(OSError):
            super().save_overload(signature, data)


def is_inner(kernel: Any) -> bool:
    """Return whether a compiled function is called by compiled functions only."""
    return bool(kernel.targetoptions.get("no_cpython_wrapper", False))


def target() -> Target:
    """Return the target for which numba compiles in this process."""
    names: Target = cpu_target.target_context.codegen().magic_tuple()
    return names


@functools.cache
def runs_shipped() -> bool:
    """Return whether this processor executes the functions that the wheel contains."""
    platform, _, features = target()
    needs = set(SHIPPED_TARGET[2].split(","))
    return platform == SHIPPED_TARGET[0] and needs <= set(features.split(","))


@functools.cache
def digest(file: Path) -> str:
    """Return the hash of a source, at its first use in this process."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


@functools.cache
def sources(file: Path) -> frozenset[Path]:
    """Return the sources on which the compiled functions of a file depend."""
    text = file.read_text(encoding="utf-8")
    if COMPILED.search(text) is None:
        return frozenset({file})
    names = (x.split(".")[1:] for x in IMPORT.findall(text))
    files = (ROOT.joinpath(*x).with_suffix(".py") for x in names)
    return frozenset({file}).union(*(sources(x) for x in files if x.is_file()))


def _take_no_literals(kernel: Any) -> None:
    """Make compiled callers use the same compiled version for `f(0)` as for `f(i)`."""
    # Numba has a type for each literal number, and would compile the function again for it.
    find = kernel.get_call_template

    def find_for_numbers(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(x) for name, x in kws.items()}
        return find(tuple(types.unliteral(x) for x in args), plain)

    kernel.get_call_template = find_for_numbers


def _refuse_calls(kernel: Any, name: str) -> None:
    """Make calls from Python raise an error, because they would crash the process."""

    def refuse(*args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError(f"{name} is compiled to be called by compiled functions only (inner=True).")

    # Numba calls `_compile_for_args` if no version fits the arguments, and `_insert` to add a
    # version.
    kernel._compile_for_args = refuse
    kernel._insert = lambda *args: None


def waiting(wait: Callable[[Any], None]) -> AbstractContextManager[None]:
    """Call `wait` before a compiled function is loaded or compiled in this context."""
    return progress.registered(_waiting, wait)


def may_wait() -> bool:
    """Return whether calls of compiled functions may wait for other processes to compile them."""
    return bool(_waiting)


class _Listener(event.Listener):
    """Reports each compilation to the listeners of progress; without listeners, once to the log."""

    def __init__(self) -> None:
        self._begin: float | None = None
        self._logged = False

    def on_start(self, event: Any) -> None:
        """Report that a function of this package is being compiled."""
        function = event.data["dispatcher"].py_func
        if not function.__module__.startswith(f"{PACKAGE}."):
            return
        name = f"{function.__module__}.{function.__name__}"
        if not (progress.report_compiling(name) or self._logged):
            self._log()

    def on_end(self, event: Any) -> None:
        """Do nothing; numba requires this method."""

    def _log(self) -> None:
        """Log a compilation that lasts longer than `LOGGED_AFTER`."""
        now = time.monotonic()
        self._begin = self._begin or now
        if now > self._begin + LOGGED_AFTER:
            self._logged = True
            logging.getLogger(PACKAGE).warning(
                "armcontour compiles the functions of this job that were not compiled yet, which "
                "may take a minute or two. `armcontour compile` compiles all, on all processors."
            )


event.register("numba:compile", _Listener())
