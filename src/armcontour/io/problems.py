"""What a file's checks found, as one sentence for people."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

# Parts of an error's place that name the type that was tried, and not a key.
TYPE_NAMES = {
    "ArmModel",
    "CornersModel",
    "OrientationModel",
    "bool",
    "float",
    "function-before",
    "int",
    "literal['sharp']",
    "str",
}


def first_problem(error: ValidationError) -> str:
    """The first problem as a sentence, and how many more there are."""
    problems = error.errors()
    # Where a key may hold one of two things, the message of the one that came closest says most.
    first = max(problems, key=_says)
    key = ".".join(str(x) for x in _keys(first)) or "the file"
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {key}: see `armcontour schema` for those that it takes."
    elif first["type"] == "missing":
        sentence = f"the key {key} is missing."
    else:
        sentence = f"{key}: {_lower(first['msg'].removeprefix('Value error, '))}."
    more = len({_keys(x) for x in problems if not _within(_keys(first), _keys(x))})
    return sentence + (f" ({more} more problem{'s' if more > 1 else ''}.)" if more else "")


def _says(problem: Any) -> tuple[bool, bool, int]:
    """How much a problem says: what is wrong with a value, an unknown key, or deep inside."""
    kind = problem["type"]
    return kind == "value_error", kind == "extra_forbidden", len(_keys(problem))


def _keys(problem: Any) -> tuple[Any, ...]:
    return tuple(x for x in problem["loc"] if not _is_type_name(x))


def _within(place: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether a place is another or lies in it: that is the same problem, seen as another type."""
    return place[: len(other)] == other


def _is_type_name(part: int | str) -> bool:
    return isinstance(part, str) and (any(c in part for c in "[(") or part in TYPE_NAMES)


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]
