"""Types of arguments and results in the reference of Python, as the code writes them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from typing import Any

from docs.site.names import by_room

from armcontour.core import quantities

# Types of quantities are shown as numbers or arrays, because descriptions state their units.
KINDS = {
    name: "float" if kind.__origin__ is float else "FloatArray"
    for name, kind in vars(quantities).items()
    if isinstance(getattr(kind, "__metadata__", (None,))[0], quantities.Quantity)
}
WORDS = {
    "npt.ArrayLike": "ArrayLike",
    "FilePath": "pathlib.Path",
    "npt.NDArray": "NDArray",
    "np.object_": "object",
}
ENTRY = re.compile(r"    (\*{0,2}\w+(?:, \*{0,2}\w+)*): ")
NAME = re.compile(r"[A-Za-z_][\w.]*")


def add_types(app: Any, kind: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Add the types of arguments and result to a docstring before Sphinx reads it.

    Args:
        app: Sphinx.
        kind: Kind of the entry, such as "class".
        name: Full name of the object.
        obj: The object.
        options: Options of the entry.
        lines: Lines of the docstring, which are changed.
    """
    types = _types(obj)
    inside = False
    for i, line in enumerate(lines):
        if line and not line.startswith(" "):
            inside = line in ("Args:", "Attributes:")
        entry = ENTRY.match(line) if inside else None
        targets = (
            {types.get(x, "") for x in entry[1].replace("*", "").split(", ")} if entry else {""}
        )
        if entry and len(targets) == 1 and any(targets):
            lines[i] = f"    {entry[1]} ({targets.pop()}): {line[entry.end() :]}"
    result = types.get("return", "None")
    if kind in ("function", "method", "property") and result != "None":
        lines += ["", f":rtype: {result}"]


def _types(obj: Any) -> dict[str, str]:
    """Map each argument of an object, and "return", to its annotated type."""
    if inspect.isclass(obj):
        obj = obj.__init__
    obj = getattr(obj, "fget", None) or getattr(obj, "func", None) or obj
    obj = inspect.unwrap(obj)
    namespace = vars(inspect.getmodule(obj)) if inspect.isfunction(obj) else {}
    stated = getattr(obj, "__annotations__", {})
    return {name: _shown(kind, namespace) for name, kind in stated.items()}


def _shown(kind: Any, namespace: Mapping[str, Any]) -> str:
    """Return a type as short text, with links to entries of the reference.

    Args:
        kind: The annotation.
        namespace: Names of the module with the annotation, and their values.
    """
    text = kind if isinstance(kind, str) else getattr(kind, "__name__", str(kind))
    return NAME.sub(lambda x: _named(x[0], namespace), _without_metadata(text))


def _named(name: str, namespace: Mapping[str, Any]) -> str:
    """Return a name in a type, as a link if it has one entry in the reference."""
    if name in KINDS or name in WORDS:
        return KINDS.get(name) or WORDS[name]
    name = name.rpartition(".")[2]
    entries = {entry: x for members in by_room().values() for entry, x in members}
    same = [x for x in entries if x.rpartition(".")[2] == name]
    # Names that are imported only for type checking are not in the namespace. Most of them have one
    # entry.
    meant = [x for x in same if entries[x] is namespace.get(name)] or same
    return f"~{meant[0]}" if len(meant) == 1 else name


def _without_metadata(text: str) -> str:
    """Return the text of a type without the metadata of `Annotated`."""
    begin = text.find("Annotated[")
    if begin < 0:
        return text
    depth = 0
    comma = 0
    position = begin + len("Annotated[")
    start = position
    while depth >= 0:
        depth += {"[": 1, "(": 1, "]": -1, ")": -1}.get(text[position], 0)
        if text[position] == "," and not depth and not comma:
            comma = position
        position += 1
    return _without_metadata(text[:begin] + text[start:comma] + text[position:])
