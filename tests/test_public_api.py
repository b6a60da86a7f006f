"""The public names: they exist, they are sorted, and importing the package costs nothing."""

import ast
import inspect
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import armcontour as ac


def test_every_public_name_exists():
    for name in ac.__all__:
        value = getattr(ac, name)
        if name == "__version__":
            assert re.fullmatch(r"\d+\.\d+\.\d+\w*", value)
        else:
            # A class or a function of the package under its own name, and no module or import.
            assert inspect.isclass(value) or inspect.isfunction(value)
            assert value.__name__ == name and value.__module__.startswith("armcontour.")
    assert ac.__all__ == sorted(ac.__all__)
    assert dir(ac) == ac.__all__
    with pytest.raises(AttributeError, match="'armcontour' has no attribute 'does_not_exist'"):
        ac.does_not_exist  # noqa: B018


def test_every_public_name_is_in_each_list_once():
    tree = ast.parse(Path(ac.__file__).read_text(encoding="utf-8"))
    assigned = [x.value for x in tree.body if isinstance(x, ast.Assign)]
    homes = next(ast.literal_eval(x) for x in assigned if isinstance(x, ast.Dict))
    loaded = Counter((f"armcontour.{home}", name) for home in homes for name in homes[home])
    assert set(loaded.values()) == {1}
    inner = [x for block in tree.body if isinstance(block, ast.If) for x in block.body]
    imports = [x for x in inner if isinstance(x, ast.ImportFrom)]
    assert loaded == Counter((x.module, alias.name) for x in imports for alias in x.names)
    assert sorted(["__version__", *(name for _, name in loaded)]) == ac.__all__


def test_importing_the_package_imports_nothing_heavy():
    code = "import armcontour, sys; print(*sorted({x.partition('.')[0] for x in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.split())
    assert "armcontour" in imported
    # The editable install may import its finder; of the dependencies there is none.
    assert not imported & {"numpy", "scipy", "numba", "pint", "pydantic", "plotly", "pinocchio"}
