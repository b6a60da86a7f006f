"""Compiled functions on disk, as numba keeps them, loaded without what only compiling needs.

When numba loads a function, it first imports hundreds of modules that compile, and it reads the
function's bitcode, with which others are compiled. A command that compiles nothing would spend more
time on that than on many plans.
"""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from llvmlite.binding import parse_assembly, parse_bitcode
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime.nrt import rtsys

ROOT = Path(__file__).parent
IMPORT = re.compile(r"^from (armcontour\.[\w.]+) import", re.MULTILINE)


def files_of(
    function: Callable[..., Any], waiting: Sequence[Callable[[Any], None]], *, inner: bool
) -> FunctionCache:
    """Where a compiled function is kept.

    Args:
        function: The function as it is written.
        waiting: Called with the function before it is looked for: others may be compiling it.
        inner: Whether only compiled functions call the function.
    """
    files = _Files(function) if inner else _FilesOfCalled(function)
    files.waiting = waiting
    return files


class _Files(FunctionCache):
    """Where a compiled function is kept."""

    waiting: Sequence[Callable[[Any], None]] = ()

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        index: Any = self._cache_file
        index._source_stamp = _state_of(Path(function.__code__.co_filename))
        load = index._load_index

        def load_known() -> Any:
            """What is kept; nothing where types of an earlier version no longer exist."""
            try:
                return load()
            except (ImportError, AttributeError):
                return {}

        index._load_index = load_known

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function that is kept, as soon as nobody is compiling it; else None."""
        for wait in tuple(self.waiting):
            wait(self._py_func)
        # What compiled code calls to count references. All else that numba makes ready here is for
        # compiling, and is made ready there again.
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)


@functools.cache
def _state_of(file: Path) -> tuple[tuple[str, float, int], ...]:
    """State of a file and of all files with compiled functions that it imports from.

    Numba looks at the file of a function only, not at those of the functions that it calls.
    """
    known, new = {file}, [file]
    while new:
        found = _kernels_imported(new.pop()) - known
        known |= found
        new += found
    return tuple((x.name, x.stat().st_mtime, x.stat().st_size) for x in sorted(known))


@functools.cache
def _kernels_imported(file: Path) -> frozenset[Path]:
    """Files with compiled functions that a file imports from."""
    names = IMPORT.findall(file.read_text(encoding="utf-8"))
    files = (ROOT.joinpath(*x.split(".")[1:]).with_suffix(".py") for x in names)
    return frozenset(x for x in files if x.is_file() and "@compiled" in x.read_text("utf-8"))


class _Content(CompileResultCacheImpl):
    """What is kept of a function that Python calls, and what is made of it."""

    @property
    def filename_base(self) -> str:
        """The name of its files, which hold another thing than numba's own."""
        return f"{super().filename_base}-light"

    def reduce(self, result: Any) -> Any:
        """What is kept: environments by their names, as to load them imports their modules."""
        *others, environments = super().reduce(result)
        named = ((x.globals["__name__"], tuple(x.consts), x.env_name) for x in environments)
        return *others, tuple(named)

    def rebuild(self, target: Any, kept: Any) -> Any:
        """The function; its bitcode is read when another function is compiled with it."""
        (library, kind, (code, bitcode)), description, *others, named = kept
        environments = tuple(_environment(*x) for x in named)
        names = description.llvm_func_name, description.llvm_cpython_wrapper_name
        content = library, kind, (code, _bitcode_that_defines(names))
        found = super().rebuild(target, (content, description, *others, environments))
        found.library._shared_module = None
        found.library._get_module_for_linking = functools.cache(lambda: parse_bitcode(bitcode))
        return found


class _FilesOfCalled(_Files):
    """Where a compiled function is kept that Python calls."""

    _impl_class: Any = _Content


def _environment(module: str, constants: Iterable[Any], name: str) -> Environment:
    """Constants of a compiled function; it looks up no globals, so that its module can wait."""
    found: Environment | None = lookup_environment(name)
    if found is None:
        loaded = sys.modules.get(module)
        found = Environment({"__name__": module} if loaded is None else vars(loaded))
        found.consts[:] = constants
        found.env_name = name
        Environment._memo[name] = found
    return found


def _bitcode_that_defines(names: Iterable[str]) -> bytes:
    """A module with functions of these names that do nothing: numba looks the names up in it."""
    text = "\n".join(f'define void @"{name}"() {{ ret void }}' for name in names)
    module: bytes = parse_assembly(text).as_bitcode()
    return module
