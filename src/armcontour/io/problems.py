"""What a file's checks found, as one sentence for people."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from armcontour._text import shorten, show

# Parts of an error's place that name the type that was tried, and not a key.
TYPE_NAMES = {
    "bool",
    "float",
    "function-before",
    "int",
    "literal['sharp']",
    "str",
}
# What a value should have been, by the kind of the problem.
WANTED = {
    "bool_type": "true or false",
    "dict_type": "a mapping of keys",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a mapping of keys",
    "string_type": "text",
    "tuple_type": "a list",
}
# These say what is wrong with a value of the right kind.
SAYING = ("value_error", "too_short", "too_long", "greater_than_equal")
NAME = "must be letters, digits, - and _, 64 at most, with a letter or digit first"
# Characters of a key that are repeated in a message.
SHOWN = 80


def first_problem(error: ValidationError, schema: Mapping[str, Any]) -> str:
    """The first problem as a sentence, and how many more there are.

    Args:
        error: What the checks found.
        schema: JSON Schema of the whole file.
    """
    problems = error.errors()
    # Where a key may hold one of two things, the message of the one that came closest says most.
    first = max(problems, key=_says)
    keys = _keys(first)
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {place(keys)}: {_instead(keys, schema)}"
    elif first["type"] == "missing":
        sentence = f"the key {place(keys)} is missing"
    else:
        alike = [x for x in problems if _keys(x) == keys]
        sentence = f"{place(keys) or 'the file'}: {_words(first, alike)}"
    others = {_keys(x) for x in problems}
    more = sum(not _within(x, keys) and not _within(keys, x) for x in others)
    closing = "" if sentence.endswith("?") else "."
    return (
        sentence + closing + (f" ({more} more problem{'s' if more > 1 else ''}.)" if more else "")
    )


def place(keys: Sequence[int | str]) -> str:
    """Where a value stands, for people: items of lists are counted from 1."""
    text = ""
    for i, key in enumerate(keys):
        if isinstance(key, str):
            key = shorten(key, SHOWN)
            text += f".{key}" if text else key
        elif i and isinstance(keys[i - 1], int):
            text = f"{text[:-1]}, item {key + 1})"
        else:
            text += f" (item {key + 1})"
    return text


def _says(problem: Any) -> tuple[bool, bool, int]:
    """How much a problem says: what is wrong with a value, an unknown key, or deep inside."""
    kind = problem["type"]
    return kind in SAYING, kind == "extra_forbidden", len(_keys(problem))


def _words(problem: Any, alike: Sequence[Any]) -> str:
    """What is wrong with a value; `alike` are all problems that were found in its place."""
    kind, given, facts = problem["type"], problem["input"], problem.get("ctx", {})
    wanted = [x for x in map(_expected, alike) if x is not None]
    if kind == "too_short":
        return f"needs at least {_ordinal(facts['min_length'])}, but has {facts['actual_length']}"
    if kind == "too_long":
        return f"takes at most {_ordinal(facts['max_length'])}, but has {facts['actual_length']}"
    if kind == "string_pattern_mismatch":
        return f"a name {NAME}, not {show(given)}"
    if kind == "greater_than_equal":
        return f"must be at least {facts['ge']:g}, but is {given:g}"
    if _expected(problem) is not None:
        return f"must be {' or '.join(dict.fromkeys(wanted))}, not {show(given)}"
    if kind == "value_error":
        return str(facts["error"]).rstrip(".")
    return _lower(problem["msg"]).rstrip(".")


def _expected(problem: Any) -> str | None:
    """What a value should have been, if its problem is that it is something else."""
    if problem["type"] == "literal_error":
        return str(problem["ctx"]["expected"]).replace("'", "")
    return WANTED.get(problem["type"])


def _ordinal(number: int) -> str:
    return "one entry" if number == 1 else f"{number} entries"


def _instead(keys: tuple[Any, ...], schema: Mapping[str, Any]) -> str:
    """What may have been meant by an unknown key."""
    *outer, name = keys
    kinds = list(_alternatives(schema, schema))
    for key in outer:
        kinds = [x for kind in kinds for x in _alternatives(schema, _inside(kind, key))]
    known = [x for kind in kinds for x in kind.get("properties", ())]
    near = difflib.get_close_matches(str(name), known, n=1)
    return f"did you mean {near[0]}?" if near else f"the keys there are {', '.join(known)}"


def _inside(kind: Mapping[str, Any], key: int | str) -> Any:
    """The schema of a key, or of an item."""
    if isinstance(key, int):
        return kind.get("items", {})
    others = next(
        iter(kind.get("patternProperties", {}).values()), kind.get("additionalProperties")
    )
    return kind.get("properties", {}).get(key, others or {})


def _alternatives(schema: Mapping[str, Any], kind: Any) -> Iterator[Any]:
    """A part of a schema, or those that it is one of."""
    if "$ref" in kind:
        kind = schema["$defs"][kind["$ref"].rpartition("/")[2]]
    for x in kind.get("anyOf", ()):
        yield from _alternatives(schema, x)
    yield kind


def _keys(problem: Any) -> tuple[Any, ...]:
    *outer, last = problem["loc"] or (None,)
    # An unknown key is whatever stands in the file, and never the name of a type.
    keep = problem["type"] == "extra_forbidden" or (last is not None and not _is_type_name(last))
    return (*(x for x in outer if not _is_type_name(x)), *((last,) if keep else ()))


def _within(outer: tuple[Any, ...], inner: tuple[Any, ...]) -> bool:
    """Whether a place is another or lies in it: that is one problem, seen as two types."""
    return inner[: len(outer)] == outer


def _is_type_name(part: int | str) -> bool:
    return isinstance(part, str) and (any(c in part for c in "[(") or part in TYPE_NAMES)


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]
