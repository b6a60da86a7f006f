"""Types of arguments and results in the reference of Python, as the code writes them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from typing import Any

from docs.site.names import by_room

from armcontour.core import quantities

# Kinds of quantities are numbers, or arrays of them: their units stand in the descriptions.
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
    """Write the type of each argument, and of the result, into a docstring before it is read.

    Args:
        app: Sphinx.
        kind: What is described, such as "class".
        name: Its full name.
        obj: What it is.
        options: Options of its entry.
        lines: The docstring, which is changed.
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
    """The types that the code states of what an object takes and gives, by name."""
    if inspect.isclass(obj):
        obj = obj.__init__
    obj = getattr(obj, "fget", None) or getattr(obj, "func", None) or obj
    obj = inspect.unwrap(obj)
    namespace = vars(inspect.getmodule(obj)) if inspect.isfunction(obj) else {}
    stated = getattr(obj, "__annotations__", {})
    return {name: _shown(kind, namespace) for name, kind in stated.items()}


def _shown(kind: Any, namespace: Mapping[str, Any]) -> str:
    """A type in short; what has an entry of its own is a link to it.

    Args:
        kind: The type, as it is stated.
        namespace: What names mean where it is stated.
    """
    text = kind if isinstance(kind, str) else getattr(kind, "__name__", str(kind))
    return NAME.sub(lambda x: _named(x[0], namespace), _without_metadata(text))


def _named(name: str, namespace: Mapping[str, Any]) -> str:
    """One name of a type."""
    if name in KINDS or name in WORDS:
        return KINDS.get(name) or WORDS[name]
    name = name.rpartition(".")[2]
    entries = {entry: x for members in by_room().values() for entry, x in members}
    same = [x for x in entries if x.rpartition(".")[2] == name]
    # Names that are imported for types only are not known; most of them mean one thing.
    meant = [x for x in same if entries[x] is namespace.get(name)] or same
    return f"~{meant[0]}" if len(meant) == 1 else name


def _without_metadata(text: str) -> str:
    """A type without what `Annotated` says of it."""
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
