"""Conversion of the validation errors of pydantic to messages in terms of keys of files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from pydantic import ValidationError

from armcontour.core.text import shorten, show, suggest

# Values by key path in a job file, from the outermost key.
Patch: TypeAlias = Mapping[tuple[str | int, ...], Any]
# Names of types that pydantic inserts into the location of an error; they are not keys.
TYPE_NAMES = {
    "bool",
    "float",
    "function-before",
    "int",
    "literal['sharp']",
    "str",
}
# Text for the expected value, by type of the problem.
EXPECTED = {
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
# Types of problems of a value that has the correct type.
VALUE_PROBLEMS = ("value_error", "too_short", "too_long", "greater_than_equal", "less_than_equal")
# Keys of former versions, with the text that replaces the suggestion of a key.
FORMER_KEYS = {
    "ignore_jerk": "remove it, because plans always satisfy jerk limits; to remove the jerk limits "
    "of the arm, write limits: {joint_jerk: inf}",
}
# Required form of the names of runs, for messages.
RUN_NAME_RULE = "must be letters, digits, - and _, 64 at most, with a letter or digit first"
# Maximum length of a key in a message [characters].
MAX_KEY_LENGTH = 80


def describe_first_error(error: ValidationError, schema: Mapping[str, Any]) -> str:
    """Message with the most informative problem and the number of other problems."""
    problems = error.errors()
    # If a key may have several types, pydantic reports a problem for each type.
    first = max(problems, key=_rank)
    keys = _keys(first)
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {key_text(keys)}: {_suggest_key(keys, schema)}"
    elif first["type"] == "missing":
        sentence = f"the key {key_text(keys)} is missing"
    else:
        alike = [x for x in problems if _keys(x) == keys]
        sentence = f"{key_text(keys) or 'the file'}: {_describe_problem(first, alike)}"
    sentence = sentence.replace(key_text(keys), key_text(_with_text_keys(keys, schema)), 1)
    others = {_keys(x) for x in problems}
    others_count = sum(not _is_inside(x, keys) and not _is_inside(keys, x) for x in others)
    closing = "" if sentence.endswith("?") else "."
    return (
        sentence
        + closing
        + (
            f" ({others_count} more problem{'s' if others_count > 1 else ''}.)"
            if others_count
            else ""
        )
    )


def _with_text_keys(keys: Sequence[int | str], schema: Mapping[str, Any]) -> tuple[int | str, ...]:
    """Key path in which only list indices are numbers; keys of mappings become texts."""
    kinds, named = list(_alternatives(schema, schema)), list[int | str]()
    for key in keys:
        listed = any("items" in x for x in kinds)
        named.append(key if listed else str(key))
        kinds = [x for kind in kinds for x in _alternatives(schema, _inside(kind, named[-1]))]
    return tuple(named)


def key_text(keys: Sequence[int | str]) -> str:
    """Text of a key path for messages, with items of lists counted from 1."""
    text = ""
    for i, key in enumerate(keys):
        if isinstance(key, str):
            key = shorten(key, MAX_KEY_LENGTH)
            text += f".{key}" if text else key
        elif i and isinstance(keys[i - 1], int):
            text = f"{text[:-1]}, item {key + 1})"
        else:
            text += f" (item {key + 1})"
    return text


def _rank(problem: Any) -> tuple[bool, bool, bool, int]:
    """Rank of a problem, larger for more informative problems.

    The order is wrong values (wrong lengths highest), unknown keys, then the deepest location.
    """
    # If a key may be a number or a list, the wrong length of a list is more informative than "not a
    # number".
    kind = problem["type"]
    is_length = kind in ("too_short", "too_long")
    return kind in VALUE_PROBLEMS, is_length, kind == "extra_forbidden", len(_keys(problem))


def _describe_problem(problem: Any, alike: Sequence[Any]) -> str:
    """End of the sentence "key: ..." about a problem; `alike`: all problems of the same key."""
    kind, value, facts = problem["type"], problem["input"], problem.get("ctx", {})
    expected = [x for x in map(_expected, alike) if x is not None]
    if kind == "too_short":
        return (
            f"must have at least {_entries(facts['min_length'])}, but has {facts['actual_length']}"
        )
    if kind == "too_long":
        return (
            f"must have at most {_entries(facts['max_length'])}, but has {facts['actual_length']}"
        )
    if kind == "string_pattern_mismatch":
        return f"the name {RUN_NAME_RULE}, but is {show(value)}"
    if kind == "greater_than_equal":
        return f"must be at least {facts['ge']:g}, but is {value:g}"
    if kind == "less_than_equal":
        return f"must be at most {facts['le']:g}, but is {value:g}"
    if _expected(problem) is not None:
        but = "but is empty" if value is None else f"not {show(value)}"
        return f"must be {' or '.join(dict.fromkeys(expected))}, {but}"
    if kind == "value_error":
        return str(facts["error"]).rstrip(".")
    message: str = problem["msg"]
    return (message[:1].lower() + message[1:]).rstrip(".")


def _expected(problem: Any) -> str | None:
    """Text for the expected type or choice; None if the problem is not a wrong type or choice."""
    if problem["type"] == "literal_error":
        return str(problem["ctx"]["expected"]).replace("'", "")
    return EXPECTED.get(problem["type"])


def _entries(number: int) -> str:
    return "one entry" if number == 1 else f"{number} entries"


def _suggest_key(keys: tuple[Any, ...], schema: Mapping[str, Any]) -> str:
    """Suggestion for an unknown key: advice, the most similar known key, or all known keys."""
    *outer, name = keys
    if name in FORMER_KEYS:
        return FORMER_KEYS[name]
    kinds = list(_alternatives(schema, schema))
    for key in outer:
        kinds = [x for kind in kinds for x in _alternatives(schema, _inside(kind, key))]
    names = [x for kind in kinds for x in kind.get("properties", ())]
    if len(outer) == 2 and outer[0] == "runs" and name in schema.get("properties", ()):
        return (
            f"{name} applies to the whole job, so write it at the top level, next to runs; to "
            "compare several values, use `armcontour batch`, or pins in the Studio"
        )
    if str(name)[:1].isdigit():
        # YAML reads {tolerance: 0,2 mm} as a mapping with the keys tolerance and 2 mm.
        return "a comma ends a value in braces, so write decimals with a point, such as 0.2 mm"
    inner = [
        f"{key}.{name}"
        for key in ([] if outer else names)
        for kind in _alternatives(schema, _inside(schema, key))
        if name in kind.get("properties", ())
    ]
    if inner:
        return f"did you mean {' or '.join(dict.fromkeys(inner))}?"
    return suggest(str(name), names, f"the known keys are {', '.join(names)}")


def _inside(kind: Mapping[str, Any], key: int | str) -> Any:
    """Schema of the value of a key in a mapping, or of an item of a list."""
    if isinstance(key, int):
        return kind.get("items", {})
    others = next(
        iter(kind.get("patternProperties", {}).values()), kind.get("additionalProperties")
    )
    return kind.get("properties", {}).get(key, others or {})


def _alternatives(schema: Mapping[str, Any], kind: Any) -> Iterator[Any]:
    """Yield a part of a schema and all its alternatives, with references resolved."""
    if "$ref" in kind:
        kind = schema["$defs"][kind["$ref"].rpartition("/")[2]]
    for alternative in kind.get("anyOf", ()):
        yield from _alternatives(schema, alternative)
    yield kind


def _keys(problem: Any) -> tuple[Any, ...]:
    """Key path of a problem, without names of types."""
    *outer, last = problem["loc"] or (None,)
    # For an unknown key, the last part is the key itself, even if it equals the name of a type.
    keep = problem["type"] == "extra_forbidden" or (last is not None and not _is_type_name(last))
    return (*(x for x in outer if not _is_type_name(x)), *((last,) if keep else ()))


def _is_inside(outer: tuple[Any, ...], inner: tuple[Any, ...]) -> bool:
    """True if the key path `inner` equals `outer` or is inside it, so that both are one problem."""
    return inner[: len(outer)] == outer


def _is_type_name(part: int | str) -> bool:
    return isinstance(part, str) and (any(c in part for c in "[(") or part in TYPE_NAMES)
