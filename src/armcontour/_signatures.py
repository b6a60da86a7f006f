"""Arguments of compiled functions as text, such as `float64[:, ::1], const(float64[::1]), int64`.

The text is Python in the words of `numba.types`, and two more: `const`, for an array that is
read-only, and `named`, for a named tuple.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any


def to_text(arguments: Sequence[Any]) -> str:
    """Types of arguments as text.

    Raises:
        ValueError: A type that has no text.
    """
    return ", ".join(map(_text, arguments))


def from_text(text: str) -> tuple[Any, ...]:
    """The types of arguments that a text of `to_text` stands for."""
    from numba import types

    words = {**vars(types), "const": _const, "named": _named, "__builtins__": {}}
    # The text comes from this package.
    found: tuple[Any, ...] = eval(f"({text},)" if text else "()", words)
    return found


def _text(kind: Any) -> str:
    """One type as text."""
    from numba import types

    if isinstance(kind, types.Array):
        axes = {
            "C": [":"] * (kind.ndim - 1) + ["::1"],
            "F": ["::1"] + [":"] * (kind.ndim - 1),
            "A": [":"] * kind.ndim,
        }[kind.layout]
        text = f"{_text(kind.dtype)}[{', '.join(axes)}]"
        return text if kind.mutable else f"const({text})"
    if isinstance(kind, types.BaseNamedTuple):
        parts = "".join(f", {_text(x)}" for x in kind)
        made = kind.instance_class
        return f'named("{made.__module__}", "{made.__qualname__}"{parts})'
    if isinstance(kind, types.BaseTuple):
        return f"Tuple(({''.join(f'{_text(x)}, ' for x in kind)}))"
    if isinstance(kind, types.Literal):
        return f"literal({kind.literal_value!r})"
    if isinstance(kind, types.Omitted):
        return f"Omitted({kind.value!r})"
    if kind == types.boolean:
        # Its own name differs between versions of numba.
        return "boolean"
    if getattr(types, str(kind), None) == kind:
        return str(kind)
    raise ValueError(f"The type {kind} of an argument has no text yet.")


def _const(array: Any) -> Any:
    """The type of an array that is read-only."""
    return array.copy(readonly=True)


def _named(module: str, name: str, *parts: Any) -> Any:
    """The type of a named tuple."""
    from numba import types

    kind = getattr(import_module(module), name)
    if len(set(parts)) == 1:
        return types.NamedUniTuple(parts[0], len(parts), kind)
    return types.NamedTuple(parts, kind)
