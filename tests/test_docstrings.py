"""Every public function and class is documented: a summary, and every parameter by its name.

The style is Google's: a section `Args:` whose entries are `name: description`, four spaces deep,
with further lines eight spaces deep.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

import armcontour as ac

SECTIONS = ("Args", "Attributes", "Raises")
ENTRY = re.compile(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*): *(.*)")


def is_ours(member: Any) -> bool:
    return (getattr(member, "__module__", None) or "").startswith("armcontour")


def methods(of: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that the package itself defines, inherited ones once."""
    for owner in of.__mro__:
        if not is_ours(owner):
            continue
        for name, member in vars(owner).items():
            if name.startswith("_"):
                continue
            found = inspect.unwrap(getattr(member, "__func__", member))
            found = getattr(found, "fget", None) or getattr(found, "func", None) or found
            if inspect.isfunction(found):
                yield f"{owner.__name__}.{name}", found


def documented() -> dict[str, Any]:
    """All public functions, classes and methods by their name."""
    found: dict[str, Any] = {}
    for name in ac.__all__:
        value = getattr(ac, name)
        if inspect.isclass(value):
            found[name] = value
            found |= methods(value)
        elif callable(value):
            found[name] = value
    return found


def parameters(of: Any) -> set[str]:
    """Parameters of a function, or those of a class's constructor."""
    names = list(inspect.signature(of).parameters)
    return {x for x in names if x not in ("self", "cls")}


def inherited(name: str) -> set[str]:
    """Parameters that a base class documents: of the method of that name, or of its constructor."""
    of, _, method = name.partition(".")
    found: set[str] = set()
    for base in BY_NAME[of].__mro__[1:] if of in BY_NAME else ():
        member = vars(base).get(method) if method else base
        if is_ours(base) and member is not None:
            found |= set(sections(member.__doc__ or "").get("Args", {}))
    return found


def sections(doc: str) -> dict[str, dict[str, str]]:
    """Names and descriptions in the sections of a docstring."""
    found: dict[str, dict[str, str]] = {}
    now: dict[str, str] | None = None
    name = ""
    for line in inspect.cleandoc(doc).splitlines():
        head = re.fullmatch(rf"({'|'.join(SECTIONS)}):", line)
        if head:
            now = found.setdefault(head[1], {})
        elif line and not line.startswith(" "):
            now = None
        elif now is not None and (entry := ENTRY.fullmatch(line[4:])) and line[4] != " ":
            for name in entry[1].replace("*", "").split(", "):
                assert name not in now, f"{name} stands there twice"
                now[name] = entry[2]
        elif now is not None and line.strip() and name:
            now[name] = f"{now[name]} {line.strip()}"
    return found


DOCUMENTED = documented()
BY_NAME = {x.__name__: x for x in vars(ac).values() if inspect.isclass(x)}
every = pytest.mark.parametrize("name", DOCUMENTED)


@every
def test_the_summary_is_one_sentence_on_one_line(name: str) -> None:
    doc = DOCUMENTED[name].__doc__
    assert doc, "no docstring"
    lines = inspect.cleandoc(doc).splitlines()
    assert lines[0].endswith("."), lines[0]
    assert len(lines[0].split()) > 1 and "ikewise" not in lines[0], lines[0]
    assert len(lines) == 1 or not lines[1], "no empty line after the summary"


@every
def test_the_parameters_are_those_of_the_docstring(name: str) -> None:
    of = DOCUMENTED[name]
    found = sections(of.__doc__)
    listed = set(found.get("Args", {}))
    taken = parameters(of)
    if dataclasses.is_dataclass(of):
        # A result's fields may be listed as attributes.
        listed |= set(found.get("Attributes", {})) & taken
    assert sorted(taken - listed - inherited(name)) == [], "parameters without a description"
    assert sorted(listed - taken) == [], "descriptions without a parameter"


@every
def test_every_description_is_text_with_a_full_stop(name: str) -> None:
    for section, entries in sections(DOCUMENTED[name].__doc__).items():
        for key, text in entries.items():
            assert text.strip().endswith("."), f"{section}: {key}: {text}"
            assert len(text.split()) > 1 and "ikewise" not in text, f"{section}: {key}: {text}"
