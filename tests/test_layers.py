"""The engine names no module of an upper package, not even in a string."""

import ast
from pathlib import Path

import armcontour as ac

ENGINE = "core geometry robot motion program planning verification control simulation jobs studies"
UPPER = tuple(f"armcontour.{x}" for x in ("files", "report", "cli", "studio", "controllers"))


def test_no_string_of_the_engine_names_an_upper_package():
    root = Path(ac.__file__).parent
    files = [x for package in ENGINE.split() for x in (root / package).rglob("*.py")]
    assert len(files) > 150
    found = [
        f"{file.relative_to(root)}, line {node.lineno}: {node.value}"
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and node.value.startswith(UPPER)
    ]
    assert not found
