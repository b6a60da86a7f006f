"""Text of other people in sentences and on terminals: on one line, without orders to a terminal."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from typing import Any

# Characters of a value that a sentence repeats.
MOST_SHOWN = 40
# No sentence needs more characters; what has more repeats a file.
LONGEST_SENTENCE = 2000

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 4 * MOST_SHOWN


def make_printable(text: str) -> str:
    r"""The text with every character that is not printable as its escape, such as `\x1b`.

    Those are the control characters, ends of line, characters that turn the direction of writing,
    and halves of characters. On a terminal some of them are orders, in a list of names they
    deceive.
    """
    if text.isprintable():
        return text
    return "".join(x if x.isprintable() else _escape(x) for x in text)


def to_line(text: str) -> str:
    """The text as one line for a terminal: printable, and not longer than a sentence."""
    return make_printable(shorten(text))


def shorten(text: str, most: int = LONGEST_SENTENCE) -> str:
    """The text, without its middle if it has more than `most` characters."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[: most - 5 - half]} ... {text[len(text) - half :]}"


def show(value: Any) -> str:
    """The beginning of a value as Python writes it, for sentences."""
    text = _short.repr(value) if not isinstance(value, str) else repr(value[: MOST_SHOWN + 1])
    long = len(value) > MOST_SHOWN if isinstance(value, str) else len(text) > MOST_SHOWN
    return f"{text[:MOST_SHOWN]}..." if long else text


def list_some(names: Sequence[str], most: int) -> str:
    """The first names with commas between, and how many more there are."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
