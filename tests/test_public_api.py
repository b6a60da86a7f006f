"""The public names: they exist, they are sorted, and importing the package costs nothing."""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import armcontour as ac


def test_every_public_name_exists() -> None:
    for name in ac.__all__:
        assert getattr(ac, name) is not None
    assert ac.__all__ == sorted(ac.__all__)


def test_every_public_name_is_in_each_list_once() -> None:
    tree = ast.parse(Path(ac.__file__).read_text(encoding="utf-8"))
    homes = next(
        ast.literal_eval(statement.value)
        for statement in tree.body
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Dict)
    )
    loaded = Counter(name for names in homes.values() for name in names)
    assert set(loaded.values()) == {1}
    typed = Counter(
        alias.name
        for block in tree.body
        if isinstance(block, ast.If)
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    )
    assert loaded == typed
    assert {*loaded, "__version__"} == set(ac.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(ac, "does_not_exist")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import armcontour, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
