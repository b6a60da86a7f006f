"""Every public function and class is documented: a summary, and every parameter by its name.

The style is Google's: a section `Args:` whose entries are `name: description`, four spaces deep,
with further lines eight spaces deep.
"""

import dataclasses
import inspect
import re
from typing import Any

import armcontour as ac

SECTIONS = ("Args", "Attributes", "Raises")
ENTRY = re.compile(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*): *(.*)")


def is_ours(member):
    return (getattr(member, "__module__", None) or "").startswith("armcontour")


def methods(of):
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


def documented():
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


def parameters(of):
    """Parameters of a function, or those of a class's constructor."""
    names = list(inspect.signature(of).parameters)
    return {x for x in names if x not in ("self", "cls")}


def inherited(name):
    """Parameters that a base class documents: of the method of that name, or of its constructor."""
    of, _, method = name.partition(".")
    found: set[str] = set()
    for base in BY_NAME[of].__mro__[1:] if of in BY_NAME else ():
        member = vars(base).get(method) if method else base
        if is_ours(base) and member is not None:
            found |= set(sections(member.__doc__ or "").get("Args", {}))
    return found


def sections(doc):
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


def faults(name):
    """What is wrong with a docstring."""
    of = DOCUMENTED[name]
    if not of.__doc__:
        yield "no docstring"
        return
    lines = inspect.cleandoc(of.__doc__).splitlines()
    if not lines[0].endswith(".") or len(lines[0].split()) < 2 or "ikewise" in lines[0]:
        yield f"the summary is no sentence: {lines[0]}"
    if len(lines) > 1 and lines[1]:
        yield "no empty line after the summary"
    found, taken = sections(of.__doc__), parameters(of)
    listed = set(found.get("Args", {}))
    if dataclasses.is_dataclass(of):
        # A result's fields may be listed as attributes.
        listed |= set(found.get("Attributes", {})) & taken
    yield from (f"{x} has no description" for x in taken - listed - inherited(name))
    yield from (f"{x} is no parameter" for x in listed - taken)
    for section, entries in found.items():
        for key, text in entries.items():
            if not text.strip().endswith(".") or len(text.split()) < 2 or "ikewise" in text:
                yield f"{section}: {key}: {text}"


def test_public_docstrings_have_a_summary_and_all_parameters():
    assert [f"{name}: {x}" for name in DOCUMENTED for x in faults(name)] == []
