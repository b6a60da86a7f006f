"""How functions are compiled: as numba does it, without the work that nothing here needs.

Functions that only compiled functions call (`inner`) become no machine code, which nobody would
run; and options of functions are not compared one by one in each statement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core import compiler
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.environment import lookup_environment
from numba.core.typed_passes import NativeLowering

# Called with a function before its code is looked for on disk: others may be compiling it.
_waiting: list[Callable[[Any], None]] = []
# How numba names what a compiled function needs to raise errors.
ENVIRONMENT = "_ZN08NumbaEnv"


class _Flags(compiler.Flags):
    """Options of a function; copies of the same options are one object.

    Numba looks up what an operator is for the options of its function, and compares all of them
    in each statement.
    """

    __slots__ = ("_hash",)
    _hash: int
    _known: dict[str, _Flags] = {}

    def copy(self) -> _Flags:
        """The copy that stands for these options while a function is compiled."""
        made: Any = type(self)(self)
        # Whether Python calls it makes no difference for what a function calls.
        made.no_cpython_wrapper = made.no_cfunc_wrapper = True
        made._hash = super(_Flags, made).__hash__()
        return self._known.setdefault(made.summary(), made)

    def __hash__(self) -> int:
        return int(self._hash)

    __eq__ = compiler.Flags.__eq__


class Compiler(compiler.CompilerBase):
    """Compiles one function."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.state.flags = _Flags(self.state.flags)

    def define_pipelines(self) -> list[PassManager]:
        """The passes of numba, the last one changed."""
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        lowering = _Inner if self.state.flags.no_cpython_wrapper else _Outer
        passes.passes = [
            (lowering, text) if step is NativeLowering else (step, text)
            for step, text in passes.passes
        ]
        passes.finalize()
        return [passes]


@register_pass(mutates_CFG=True, analysis_only=False)
class _Outer(NativeLowering):
    """Makes machine code of a function that Python calls."""

    def run_pass(self, state: Any) -> bool:
        """Make machine code; functions that were linked into it find what they need."""
        done: bool = super().run_pass(state)
        library = state.library
        for x in library._final_module.global_variables:
            found = lookup_environment(x.name) if x.name.startswith(ENVIRONMENT) else None
            if found is not None:
                library.codegen.set_env(x.name, found)
        return done


@register_pass(mutates_CFG=True, analysis_only=False)
class _Inner(NativeLowering):
    """Makes code to be linked into that of callers."""

    def run_pass(self, state: Any) -> bool:
        """Make code, and register it for callers under a key that stands for its address."""
        target = state.targetctx
        state.library = _Linked(target.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        done: bool = super().run_pass(state)
        made = state["cr"]._replace(cfunc=object())
        target.insert_user_function(made.cfunc, made.fndesc, [state.library])
        state.reload_init.extend(state.library._reload_init)
        state["cr"] = made
        return done


class _Linked(JITCodeLibrary):
    """Code that callers link: it never becomes machine code by itself."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @classmethod
    def read(cls, codegen: Any, name: str, code: bytes) -> _Linked:
        """Code that `serialize_using_bitcode` wrote."""
        made = cls(codegen, name)
        made._final_module = llvm.parse_bitcode(code)
        made._finalize_final_module()
        return made


@contextmanager
def waiting(wait: Callable[[Any], None]) -> Iterator[None]:
    """Call something with each function that has to be loaded or compiled meanwhile, before it."""
    _waiting.append(wait)
    try:
        yield
    finally:
        _waiting.remove(wait)


class Files(FunctionCache):
    """Compiled functions on disk."""

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function that is kept, as soon as nobody is compiling it; else None."""
        for wait in tuple(_waiting):
            wait(self._py_func)
        return super().load_overload(signature, target)


class _LinkedFiles(CompileResultCacheImpl):
    """Files of inner functions."""

    def get_filename_base(self, fullname: str, flags: str) -> str:
        """The beginning of a file's name: others than those of machine code."""
        return f"inner-{super().get_filename_base(fullname, flags)}"

    def reduce(self, made: Any) -> tuple[Any, ...]:
        """What is kept."""
        made.fndesc.typemap = made.fndesc.calltypes = None
        name, _, code = made.library.serialize_using_bitcode()
        environments = made._find_referenced_environments()
        return name, code, made.fndesc, made.environment, made.signature, environments

    def rebuild(self, target: Any, kept: tuple[Any, ...]) -> Any:
        """The compiled function that was kept."""
        name, code, descriptor, environment, signature, environments = kept
        return compiler.compile_result(
            target_context=target,
            typing_context=target.typing_context,
            library=_Linked.read(target.codegen(), name, code),
            environment=environment,
            entry_point=object(),
            fndesc=descriptor,
            type_annotation="",
            signature=signature,
            objectmode=False,
            lifted=(),
            referenced_envs=environments,
        )


class InnerFiles(Files):
    """Compiled inner functions on disk."""

    _impl_class = _LinkedFiles  # type: ignore[assignment]
