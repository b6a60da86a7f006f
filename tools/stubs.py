"""Write the stubs of packages whose names load lazily: `python -m tools.stubs`.

Type checkers and editors read the stubs; they have the names of `_HOME` in each `__init__.py`.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import armcontour

SOURCE = Path(armcontour.__file__).parent


def stubs() -> dict[Path, str]:
    """Return the stub of each package with lazy names, by file."""
    texts = {}
    for file in sorted(SOURCE.rglob("__init__.py")):
        name = ".".join(("armcontour", *file.parent.relative_to(SOURCE).parts))
        home = getattr(import_module(name), "_HOME", {})
        names = []
        for module, words in home.items():
            owner = module if module.startswith("armcontour.") else f"{name}.{module}"
            names += [(owner, x) for x in words.split()]
        lines = [f"from {module} import {x} as {x}" for module, x in sorted(names)]
        if names:
            texts[file.with_suffix(".pyi")] = "\n".join([*lines, ""])
    return texts


if __name__ == "__main__":
    for file, text in stubs().items():
        file.write_text(text, "utf-8")
