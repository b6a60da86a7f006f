"""Compiled functions, and the list of their argument types."""

import ast
import errno
import importlib.util
import inspect
import os
import re
import sys
import textwrap
from functools import cache
from importlib import import_module
from inspect import signature
from itertools import count
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile
from tools.kernels import to_text

import armcontour
import armcontour as ac
from armcontour.core import kernel_cache as cached
from armcontour.core.compilation import from_text, read_list
from armcontour.core.kernel_cache import KERNELS, compiled


@compiled(inner=True)
def add(a: float, b: float) -> float:
    return a + b


@compiled()
def total(values: np.ndarray) -> float:
    result = 0.0
    for x in values:
        result = add(result, x)
    return result


def test_a_call_from_python_is_an_error_before_and_after_it_is_compiled():
    for _ in range(2):
        with pytest.raises(TypeError, match="add is compiled to be called by compiled functions"):
            add(1.0, 2.0)
        assert total(np.arange(4.0)) == 6.0
    assert KERNELS[__name__, "add"] is add and KERNELS[__name__, "total"] is total


MAKES_ARRAYS = re.compile(
    r"np\.(empty|zeros|ones|full|arange|array|concatenate|copy|linspace|argsort|sort|stack|append"
    r"|diff|cumsum)\(|\.copy\("
)


def test_compiled_inner_functions_with_arrays_count_references():
    # Without references counted, arrays that they make would never be freed, and those that they
    # return freed too early.
    for file in Path(ac.__file__).parent.rglob("*.py"):
        if "@compiled(" in file.read_text(encoding="utf-8"):
            place = file.relative_to(Path(ac.__file__).parents[1]).with_suffix("")
            importlib.import_module(".".join(place.parts))
    judged = 0
    for (module, name), kernel in KERNELS.items():
        options = kernel.targetoptions
        function = kernel.py_func
        if not module.startswith("armcontour.") or options.get("_nrt", True):
            continue
        judged += 1
        (text,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        body = "\n".join(ast.unparse(x) for x in text.body)
        callees = [function.__globals__.get(x) for x in function.__code__.co_names]
        python_functions = [x.py_func for x in callees if hasattr(x, "py_func")]
        assert not MAKES_ARRAYS.search(body), f"{module}.{name} makes arrays"
        # What a function calls is compiled as the function itself is, unless it was before.
        makers = [x.py_func.__name__ for x in callees if _says_that_it_makes_arrays(x)]
        assert not makers, f"{module}.{name} calls {', '.join(makers)}"
        for x in (function, *python_functions):
            assert "Array" not in x.__annotations__["return"], f"{module}.{name}: {x.__name__}"
    assert judged > 100


def _says_that_it_makes_arrays(callee):
    return hasattr(callee, "py_func") and cached.is_inner(callee) and callee.targetoptions["_nrt"]


PACKAGE = Path(armcontour.__file__).parent


@pytest.fixture(scope="module")
def kernels():
    """All compiled functions of the package, by module and name."""
    for file in PACKAGE.rglob("*.py"):
        if "@compiled(" in file.read_text(encoding="utf-8"):
            place = file.relative_to(PACKAGE.parent).with_suffix("")
            import_module(".".join(place.parts))
    return {key: x for key, x in KERNELS.items() if key[0].startswith("armcontour.")}


def test_listed_calls_are_valid_and_all_functions_called_by_python_listed(kernels):
    listed = read_list("all")
    for key, arguments in listed.items():
        for text in arguments:
            kinds = from_text(text)
            assert to_text(kinds) == text
            assert len(kinds) == len(signature(kernels[key].py_func).parameters), key
    called = {key for key, x in kernels.items() if not cached.is_inner(x)}
    assert called <= listed.keys()


def test_a_function_whose_files_are_incomplete_is_compiled_anew():
    def last(values: np.ndarray) -> float:
        return values[-1]

    def compile_or_load():
        """Whether a function comes from its files."""
        kernel = compiled()(last)
        assert kernel(np.arange(4.0)) == 3.0
        return kernel, bool(sum(kernel.stats.cache_hits.values()))

    kernel, _ = compile_or_load()
    for ending in ("nbi", "nbc"):
        assert compile_or_load()[1]
        (file,) = Path(kernel.stats.cache_path).glob(
            f"{kernel._cache._impl.filename_base}*.{ending}"
        )
        file.write_bytes(file.read_bytes()[:30])
        assert not compile_or_load()[1]


MODULE = """
from armcontour.core.kernel_cache import compiled

@compiled()
def one():
    return {value}
"""


@pytest.fixture
def load(tmp_path):
    """Load a module with a compiled function `one` from a file; call it."""
    numbers = count()

    def load():
        name = f"loaded{next(numbers)}"
        spec = importlib.util.spec_from_file_location(name, tmp_path / "module.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.one(), sum(module.one.stats.cache_hits.values())

    return load


def test_a_changed_source_is_compiled_and_a_touched_one_is_not(tmp_path, load):
    file = tmp_path / "module.py"
    file.write_text(MODULE.format(value=1))
    assert load() == (1, 0)
    os.utime(file, (0, 0))
    assert load() == (1, 1)
    cached.digest.cache_clear()
    file.write_text(MODULE.format(value=2))
    assert load() == (2, 0)


def test_without_a_writable_folder_functions_are_compiled(tmp_path, load, monkeypatch):
    (tmp_path / "module.py").write_text(MODULE.format(value=1))
    # Folders cannot be made in files. Permissions would not stop an administrator.
    (tmp_path / "__pycache__").write_text("")
    for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "__pycache__" / "home"))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    assert load() == load() == (1, 0)
    assert [x.name for x in tmp_path.iterdir() if x.name != "module.py"] == ["__pycache__"]


def test_a_full_disk_does_not_stop_the_command(tmp_path, load, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "full")

    (tmp_path / "module.py").write_text(MODULE.format(value=1))
    monkeypatch.setattr(IndexDataCacheFile, "save", refuse)
    assert load() == load() == (1, 0)
    monkeypatch.undo()
    assert [load(), load()] == [(1, 0), (1, 1)]


def test_a_cached_function_is_invalid_if_a_called_file_changes(kernels):
    """Directly or not: otherwise the old functions would go on after an update."""

    def callees(kernel):
        function = kernel.py_func
        candidates = (function.__globals__.get(x) for x in function.__code__.co_names)
        return [x for x in candidates if getattr(x, "py_func", None) is not None]

    @cache
    def origins(module):
        """Files of the package from which a module imports names."""
        imports = [
            x
            for x in ast.parse(inspect.getsource(module)).body
            if isinstance(x, ast.ImportFrom) and x.module.startswith("armcontour.")
        ]
        files = {x.module: Path(import_module(x.module).__file__).name for x in imports}
        return {name.name: files[x.module] for x in imports for name in x.names}

    apart = 0
    for kernel in kernels.values():
        if cached.is_inner(kernel):
            # An inner function has no files of its own.
            continue
        stamped = {x[0] for x in kernel._cache._cache_file._source_stamp}
        new = [kernel]
        visited = set()
        while new:
            for x in callees(new.pop()):
                if x not in visited:
                    visited.add(x)
                    new.append(x)
        files = {Path(x.py_func.__code__.co_filename).name for x in visited}
        assert files <= stamped, kernel
        # The files of constants, and of classes and intrinsics.
        for x in (kernel, *visited):
            module = sys.modules[x.py_func.__module__]
            used = set(x.py_func.__code__.co_names) & origins(module).keys()
            assert {origins(module)[y] for y in used} <= stamped, kernel
        apart += len(files) > 1
    # Not in vain: many functions call those of other files.
    assert apart > 5
