"""Error messages from the problems that pydantic finds in the data of a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from pydantic import ValidationError

from armcontour.core.text import shorten, show, suggest

# Values of keys of a job file, by the keys that lead to them, from the outermost.
Patch: TypeAlias = Mapping[tuple[str | int, ...], Any]
# Parts of an error's location that are names of types, not keys.
TYPE_NAMES = {
    "bool",
    "float",
    "function-before",
    "int",
    "literal['sharp']",
    "str",
}
# The expected value, by the type of the problem.
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
# Problems of a value that has the right type.
OF_VALUES = ("value_error", "too_short", "too_long", "greater_than_equal", "less_than_equal")
# Keys of older files, and their replacements.
GONE = {
    "ignore_jerk": "plans keep limits of jerk, so remove it; write limits: {joint_jerk: inf} "
    "to lift the arm's own",
}
NAME = "must be letters, digits, - and _, 64 at most, with a letter or digit first"
# Characters of a key that are repeated in a message.
SHOWN = 80


def first_problem(error: ValidationError, schema: Mapping[str, Any]) -> str:
    """The most informative problem as a sentence, and the number of other problems."""
    problems = error.errors()
    # If a key may have one of several types, take the problem of the type that fits best.
    first = max(problems, key=_rank)
    keys = _keys(first)
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {key_text(keys)}: {_instead(keys, schema)}"
    elif first["type"] == "missing":
        sentence = f"the key {key_text(keys)} is missing"
    else:
        alike = [x for x in problems if _keys(x) == keys]
        sentence = f"{key_text(keys) or 'the file'}: {_words(first, alike)}"
    sentence = sentence.replace(key_text(keys), key_text(_named(keys, schema)), 1)
    others = {_keys(x) for x in problems}
    others_count = sum(not _within(x, keys) and not _within(keys, x) for x in others)
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


def _named(keys: Sequence[int | str], schema: Mapping[str, Any]) -> tuple[int | str, ...]:
    """The keys, of which numbers that are keys of mappings are texts, unlike positions in lists."""
    kinds, named = list(_alternatives(schema, schema)), list[int | str]()
    for key in keys:
        listed = any("items" in x for x in kinds)
        named.append(key if listed else str(key))
        kinds = [x for kind in kinds for x in _alternatives(schema, _inside(kind, named[-1]))]
    return tuple(named)


def key_text(keys: Sequence[int | str]) -> str:
    """The location of a value for messages: keys, and items of lists counted from 1."""
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


def _rank(problem: Any) -> tuple[bool, bool, bool, int]:
    """Rank of a problem: wrong values first, then unknown keys, then the deepest location."""
    # That a list has too many entries comes before that it is no number, which it might be as well.
    kind = problem["type"]
    is_length = kind in ("too_short", "too_long")
    return kind in OF_VALUES, is_length, kind == "extra_forbidden", len(_keys(problem))


def _words(problem: Any, alike: Sequence[Any]) -> str:
    """Describe the problem of a value; `alike` are all problems of the same key."""
    kind, value, facts = problem["type"], problem["input"], problem.get("ctx", {})
    expected = [x for x in map(_expected, alike) if x is not None]
    if kind == "too_short":
        return f"needs at least {_entries(facts['min_length'])}, but has {facts['actual_length']}"
    if kind == "too_long":
        return f"takes at most {_entries(facts['max_length'])}, but has {facts['actual_length']}"
    if kind == "string_pattern_mismatch":
        return f"a name {NAME}, not {show(value)}"
    if kind == "greater_than_equal":
        return f"must be at least {facts['ge']:g}, but is {value:g}"
    if kind == "less_than_equal":
        return f"must be at most {facts['le']:g}, but is {value:g}"
    if _expected(problem) is not None:
        but = "but is empty" if value is None else f"not {show(value)}"
        return f"must be {' or '.join(dict.fromkeys(expected))}, {but}"
    if kind == "value_error":
        return str(facts["error"]).rstrip(".")
    return _lower(problem["msg"]).rstrip(".")


def _expected(problem: Any) -> str | None:
    """The expected type or choice, if the problem is a wrong type or choice."""
    if problem["type"] == "literal_error":
        return str(problem["ctx"]["expected"]).replace("'", "")
    return EXPECTED.get(problem["type"])


def _entries(number: int) -> str:
    return "one entry" if number == 1 else f"{number} entries"


def _instead(keys: tuple[Any, ...], schema: Mapping[str, Any]) -> str:
    """The known key that is most similar to an unknown key, or all known keys."""
    *outer, name = keys
    if name in GONE:
        return GONE[name]
    kinds = list(_alternatives(schema, schema))
    for key in outer:
        kinds = [x for kind in kinds for x in _alternatives(schema, _inside(kind, key))]
    names = [x for kind in kinds for x in kind.get("properties", ())]
    if len(outer) == 2 and outer[0] == "runs" and name in schema.get("properties", ()):
        return (
            f"{name} belongs to the whole job, so write it next to runs; several values of it are "
            "compared by `armcontour batch`, or by pins in the Studio"
        )
    if str(name)[:1].isdigit():
        # {tolerance: 0,2 mm} has the keys tolerance and 2 mm.
        return "a comma between braces ends a value, so write decimals with a point, such as 0.2 mm"
    inner = [
        f"{key}.{name}"
        for key in ([] if outer else names)
        for kind in _alternatives(schema, _inside(schema, key))
        if name in kind.get("properties", ())
    ]
    if inner:
        return f"did you mean {' or '.join(dict.fromkeys(inner))}?"
    return suggest(str(name), names, f"the keys there are {', '.join(names)}")


def _inside(kind: Mapping[str, Any], key: int | str) -> Any:
    """The schema of a key of a mapping, or of an item of a list."""
    if isinstance(key, int):
        return kind.get("items", {})
    others = next(
        iter(kind.get("patternProperties", {}).values()), kind.get("additionalProperties")
    )
    return kind.get("properties", {}).get(key, others or {})


def _alternatives(schema: Mapping[str, Any], kind: Any) -> Iterator[Any]:
    """All alternatives of a part of a schema."""
    if "$ref" in kind:
        kind = schema["$defs"][kind["$ref"].rpartition("/")[2]]
    for alternative in kind.get("anyOf", ()):
        yield from _alternatives(schema, alternative)
    yield kind


def _keys(problem: Any) -> tuple[Any, ...]:
    """The keys that lead to a problem, without names of types."""
    *outer, last = problem["loc"] or (None,)
    # The last part of an unknown key is a key of the file, never the name of a type.
    keep = problem["type"] == "extra_forbidden" or (last is not None and not _is_type_name(last))
    return (*(x for x in outer if not _is_type_name(x)), *((last,) if keep else ()))


def _within(outer: tuple[Any, ...], inner: tuple[Any, ...]) -> bool:
    """True if `inner` is `outer` or a key inside it, so that both are one problem."""
    return inner[: len(outer)] == outer


def _is_type_name(part: int | str) -> bool:
    return isinstance(part, str) and (any(c in part for c in "[(") or part in TYPE_NAMES)


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]
