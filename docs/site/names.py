"""Pages of the reference of Python, from the docstrings."""

from __future__ import annotations

import functools
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

from docs.site.tables import contents, table

import armcontour as ac

# Packages that only commands use.
NO_LIBRARY = ("cli", "studio")
# Subpackages whose names their parent package exports.
PARTS = (
    *("files.drawings", "files.robots", "report.sections"),
    *("planning.jerk", "planning.shaping", "planning.topp"),
)
HEAD = """# Python

Names of `armcontour` itself are stable: `import armcontour as ac`, then `ac.plan(...)`. They are
functions, and the classes that their callers construct. Results, formats of exports and parts of a
process are in their package, such as `armcontour.verification.Evaluation`. These names may move
between versions.
Quantities are in [SI units and radians](../../../conventions.md); arrays are time first.
`FloatArray` is a NumPy array of float64. `ArrayLike` is any object that NumPy converts to an array.
`armcontour.__version__` is the version.

Examples use these objects:

```python
EXAMPLE
```

"""


def write_names() -> Iterator[tuple[str, str]]:
    """Yield the place and text of a page for each package, and of the page that lists them."""
    rows = []
    for room, members in by_room().items():
        summary = _first_line(importlib.import_module(f"armcontour.{room}"))
        yield f"api/{room}.rst", _page(f"armcontour.{room}", summary, members)
        at_top = ", ".join(
            f"[`{x.rpartition('.')[2]}`](#{x})" for x, _ in members if x.count(".") == 1
        )
        rows.append(f"| [{room}]({room}.rst) | {summary} | {at_top} |")
    lists = table("package", "content", "names in `armcontour` itself", rows=rows)
    example = [x[4:] for x in (ac.__doc__ or "").splitlines() if x.startswith(">>> ")]
    head = HEAD.replace("EXAMPLE", "\n".join(example[:-1]))
    yield "api/index.md", head + lists + contents(by_room())


def _page(title: str, summary: str, members: list[tuple[str, Any]]) -> str:
    """Return the page of a package: its names in `armcontour`, and its other names."""
    top = [x for x in members if x[0].count(".") == 1]
    lines = [title, "=" * len(title), "", summary, ""]
    for head, part in (
        ("In armcontour itself", top),
        (f"In {title} alone", [x for x in members if x not in top]),
    ):
        if part:
            lines += [head, "-" * len(head), ""]
            lines += [line for name, value in part for line in _entry(name, value)]
    return "\n".join(lines)


@functools.cache
def by_room() -> dict[str, list[tuple[str, Any]]]:
    """Map each package to its public classes and functions, each of which is listed once."""
    members: dict[str, list[tuple[str, Any]]] = {}
    listed = set[int]()
    for room in rooms():
        unlisted = [(name, x) for name, x in public_of(room) if id(x) not in listed]
        listed.update(id(x) for _, x in unlisted)
        if unlisted:
            members[room] = unlisted
    return members


@functools.cache
def rooms() -> tuple[str, ...]:
    """Return the names of packages, subpackages and modules that have a page."""
    modules = ["core.errors", "core.frames"]
    for folder in sorted(FilePath(*ac.__path__).glob("[a-z]*/")):
        if folder.name not in NO_LIBRARY:
            inside = sorted(x.parent for x in folder.glob("*/__init__.py"))
            modules += [folder.name, *(f"{folder.name}.{x.name}" for x in inside)]
    return tuple(x for x in modules if x not in PARTS)


def public_of(room: str) -> list[tuple[str, Any]]:
    """Return the public classes and functions of a package, with their full names.

    Args:
        room: Name of the package, without `armcontour.`
    """
    module = importlib.import_module(f"armcontour.{room}")
    names = getattr(module, "__all__", None) or [
        name
        for name, x in vars(module).items()
        if not name.startswith("_") and getattr(x, "__module__", "") == module.__name__
    ]
    members = {name: getattr(module, name) for name in names}
    # Names of `armcontour` itself are listed in the package that contains their module.
    for name in ac.__all__:
        value = getattr(ac, name)
        home = f"{getattr(value, '__module__', '')}."
        homes = [x for x in rooms() if home.startswith(f"armcontour.{x}.")]
        if room == max(homes, key=len, default=""):
            members[name] = value
    at_top = {name for name in ac.__all__ if getattr(ac, name) is members.get(name)}
    return [
        (f"armcontour.{name}" if name in at_top else f"armcontour.{room}.{name}", value)
        for name, value in members.items()
        if inspect.isclass(value) or inspect.isfunction(value)
    ]


def _entry(name: str, value: Any) -> list[str]:
    """Return the directive from which Sphinx makes the entry of a name."""
    if not inspect.isclass(value):
        return [f".. autofunction:: {name}", ""]
    # Members that a class inherits from a base without an entry are listed at the class.
    elsewhere = [x for members in by_room().values() for _, x in members]
    bases = [x for x in value.__mro__[1:] if x in elsewhere or not _is_ours(x)]
    without = ", ".join(dict.fromkeys(x.__name__ for x in bases))
    return [f".. autoclass:: {name}", "   :members:", f"   :inherited-members: {without}", ""]


def _is_ours(value: Any) -> bool:
    return str(value.__module__).startswith("armcontour")


def _first_line(module: Any) -> str:
    """Return the first line of the docstring of a module."""
    return (module.__doc__ or "").strip().splitlines()[0]
