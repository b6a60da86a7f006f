"""Check that code, files, tests and docs are not larger than the numbers in size.txt.

    python -m tools.size

Code lines have no docstrings, comments and blank lines. Raise a number of size.txt only in a commit
of its own, with the reason in one sentence; reduce it whenever something becomes smaller.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMITS = Path(__file__).with_name("size.txt")


def code_lines(text: str) -> int:
    """Number of lines of Python without docstrings, comments and blank lines."""
    docs = set[int]()
    for node in ast.walk(ast.parse(text)):
        kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            docs.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = enumerate(map(str.strip, text.splitlines()), 1)
    return sum(1 for i, x in lines if x and not x.startswith("#") and i not in docs)


def count(root: Path = ROOT) -> dict[str, int]:
    """Sizes of a checkout, by name."""
    package = root / "src/armcontour"
    python = [x.read_text(encoding="utf-8") for x in package.rglob("*.py")]
    scripts = [x for x in package.rglob("*.js") if "vendor" not in x.parts]
    lines = (x.strip() for y in scripts for x in y.read_text(encoding="utf-8").splitlines())
    tests = (x.read_text(encoding="utf-8") for x in (root / "tests").rglob("*.py"))
    # Generated pages: the table of keys, the gallery, the reference of Python and the site.
    generated = {"job_keys.md", "gallery", "pages", "_build"}
    pages = {x: x.relative_to(root / "docs").parts for x in (root / "docs").rglob("*.md")}
    written = (x for x, parts in pages.items() if not generated & set(parts))
    words = (x.read_text(encoding="utf-8").split() for x in written)
    return {
        "code lines": sum(map(code_lines, python)),
        "files": len(python),
        "lines of JavaScript": sum(1 for x in lines if x and not x.startswith(("//", "*", "/*"))),
        "lines of tests": sum(len(x.splitlines()) for x in tests),
        "words of docs": sum(map(len, words)),
    }


def read_limits(text: str) -> dict[str, int]:
    """Largest sizes by name, from lines such as `files: 360`."""
    return {name: int(x) for name, _, x in (line.partition(":") for line in text.splitlines())}


def main() -> int:
    """Print the sizes and their limits; 1 if one is exceeded."""
    sizes, limits = count(), read_limits(LIMITS.read_text(encoding="utf-8"))
    for name, size in sizes.items():
        excess = size - limits[name]
        note = f", {excess:,} too many: delete something, see tools/size.py" if excess > 0 else ""
        print(f"{size:7,d} {name} of {limits[name]:,}{note}")
    return int(any(size > limits[name] for name, size in sizes.items()))


if __name__ == "__main__":
    sys.exit(main())
