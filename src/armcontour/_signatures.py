"""Arguments of compiled functions as text, such as `float64[:, ::1], const(float64[::1]), int64`.

The text is Python in the words of `numba.types`, and three more: `const`, for an array that is
read-only, `named`, for a named tuple, and `Vector`, of `_vectors`.
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

    from armcontour._vectors import VECTOR

    own = {"const": _const, "named": _named, "Vector": VECTOR, "__builtins__": {}}
    words = vars(types) | own
    # The text comes from this package.
    found: tuple[Any, ...] = eval(f"({text},)" if text else "()", words)
    return found


def _types() -> Any:
    """The types of numba, of which only some have annotations."""
    from numba import types

    return types


def _text(kind: Any) -> str:
    """One type as text."""
    types = _types()

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
    if str(kind) == "Vector" or getattr(types, str(kind), None) == kind:
        return str(kind)
    raise ValueError(f"The type {kind} of an argument has no text yet.")


def _const(array: Any) -> Any:
    """The type of an array that is read-only."""
    return array.copy(readonly=True)


def _named(module: str, name: str, *parts: Any) -> Any:
    """The type of a named tuple."""
    types = _types()

    kind = getattr(import_module(module), name)
    if len(set(parts)) == 1:
        return types.NamedUniTuple(parts[0], len(parts), kind)
    return types.NamedTuple(parts, kind)
