"""Text of other people for messages: printable, in one line, of limited length; and numbers."""

from __future__ import annotations

import difflib
import inspect
import math
import re
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any

# Characters of a value that a message repeats.
MOST_SHOWN = 40
# Longest message; a longer one would repeat the content of a file.
LONGEST_SENTENCE = 2000

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 4 * MOST_SHOWN
# Longest text of a number; no program prints more digits.
LONGEST = 100


def make_printable(text: str) -> str:
    r"""The text with an escape, such as `\x1b`, for every character that is not printable.

    Such characters are control characters, ends of line, characters that change the direction of
    writing, and lone surrogates. Some control the terminal, others make names misleading.
    """
    if text.isprintable():
        return text
    return "".join(x if x.isprintable() else _escape(x) for x in text)


def to_line(text: str) -> str:
    """The text as one printable line of limited length, for a terminal."""
    return make_printable(shorten(text))


def capitalise(text: str) -> str:
    """The text with a capital at its start, as a sentence begins."""
    return text[:1].upper() + text[1:]


def shorten(text: str, most: int = LONGEST_SENTENCE) -> str:
    """The text; its middle is left out if the text has more than `most` characters."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[: most - 5 - half]} ... {text[len(text) - half :]}"


def show(value: Any) -> str:
    """The start of a value as Python writes it, for messages."""
    text = _short.repr(value) if not isinstance(value, str) else repr(value[: MOST_SHOWN + 1])
    long = len(value) > MOST_SHOWN if isinstance(value, str) else len(text) > MOST_SHOWN
    return f"{text[:MOST_SHOWN]}..." if long else text


def list_some(names: Sequence[str], most: int) -> str:
    """The first names, separated by commas, and the number of other names."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def suggest(name: str, known: Iterable[str], otherwise: str) -> str:
    """A question with the known name that is most similar to an unknown one, or `otherwise`."""
    known = list(known)
    # Two words of the field for one quantity.
    alike = [
        x for x in known if x.replace("velocity", "speed") == name.replace("velocity", "speed")
    ]
    near = alike or difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]}?" if near else otherwise


def describe_fields(cls: type) -> dict[str, str]:
    """Descriptions of the fields of a dataclass, from its docstring and those of its bases."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, rest = inspect.cleandoc(base.__doc__ or "").partition("\nArgs:\n")
        for entry in filter(None, re.split(r"\n(?= {4}\w)", rest.split("\n\n")[0])):
            names, _, text = entry.strip().partition(": ")
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def _escape(character: str) -> str:
    """The escape of a character."""
    return character.encode("unicode_escape").decode("ascii")


def parse_number(text: str) -> float:
    """Parse a finite decimal number; blanks around the number are ignored.

    `float` also accepts `1_0`, digits of other scripts, `nan` and `inf`; these are refused.

    Raises:
        ValueError: The text is not a finite decimal number.
    """
    if len(text) > LONGEST or not text.isascii() or "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number")
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def plain_number(value: Any) -> float | None:
    """Convert a value of a YAML file to a finite number; None if the value is no number."""
    if isinstance(value, bool):
        return None
    try:
        found = parse_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None
