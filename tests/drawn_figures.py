"""The pictures that `make docs` draws, which git does not track."""

from __future__ import annotations

import ast
import re
from pathlib import Path

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
OF_MODULE = re.compile(r'^FILE = "(\w+)"$', re.MULTILINE)


def names() -> tuple[str, ...]:
    """Names of the modules that `make figures` runs; to import them takes matplotlib."""
    text = (FIGURES / "__main__.py").read_text(encoding="utf-8")
    found = re.search(r"^NAMES = (\(.+?\))$", text, re.MULTILINE | re.DOTALL)
    assert found
    return tuple(ast.literal_eval(found[1]))


def drawn() -> set[str]:
    """Names of the files that the figures' modules write."""
    found = set()
    for name in names():
        own = OF_MODULE.search((FIGURES / f"{name}.py").read_text(encoding="utf-8"))
        found.add(own[1] if own else name)
    return found
