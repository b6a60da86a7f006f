"""Tabulate the sizes of an environment's packages, in Markdown.

`python tools/install_size.py` measures the environment of that Python, from the files that its
packages list, without bytecode that Python wrote later. Sizes are in MB of 1e6 bytes.
"""

from __future__ import annotations

import re
from importlib.metadata import Distribution, distributions
from pathlib import Path

# Packages that belong to the environment itself.
ENVIRONMENT_PACKAGES = {"pip", "setuptools", "wheel"}
# Smaller packages share one row [MB].
SMALL = 5.0


def plain(name: str) -> str:
    """Name of a package as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def size_of(package: Distribution) -> float:
    """Return the size of a package's files [MB], without the targets of links."""
    paths = {Path(str(package.locate_file(x))) for x in package.files or ()}
    return sum(x.lstat().st_size for x in paths if x.is_symlink() or x.is_file()) / 1e6


def needs(package: Distribution) -> list[str]:
    """Name the packages that a package requires without extras."""
    requirements = (x for x in package.requires or () if "extra" not in x.partition(";")[2])
    return [plain(match[0]) for x in requirements if (match := re.match(r"[\w.-]+", x))]


def brought_by(name: str, packages: dict[str, Distribution]) -> set[str]:
    """Return a package and its installed dependencies."""
    names = set()
    todo = [name]
    while todo:
        one = todo.pop()
        if one in packages and one not in names:
            names.add(one)
            todo += needs(packages[one])
    return names


def table(packages: dict[str, Distribution], root: str) -> list[str]:
    """Return rows of Markdown: package, version, size, and the dependency that requires it."""
    sizes = {name: size_of(x) for name, x in packages.items()}
    direct = needs(packages[root]) if root in packages else []
    reach = {x: brought_by(x, packages) for x in direct}
    rows = ["| package | version | MB | comes with |", "|---|---|---|---|"]
    large = [x for x in sizes if sizes[x] >= SMALL]
    for name in sorted(large, key=lambda x: -sizes[x]):
        by = "" if name in direct else ", ".join(x for x in direct if name in reach[x])
        rows.append(f"| {name} | {packages[name].version} | {sizes[name]:.0f} | {by} |")
    remainder = sum(sizes.values()) - sum(sizes[x] for x in large)
    rows.append(f"| {len(sizes) - len(large)} smaller ones | | {remainder:.0f} | |")
    rows.append(f"| **together** | | **{sum(sizes.values()):.0f}** | |")
    return rows


def main() -> None:
    """Print the table of this environment."""
    packages = {plain(x.name): x for x in distributions()}
    listed = {name: x for name, x in packages.items() if name not in ENVIRONMENT_PACKAGES}
    print("\n".join(table(listed, "armcontour")))


if __name__ == "__main__":
    main()
