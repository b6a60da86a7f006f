"""Text of files on its way to a terminal."""

from __future__ import annotations

# A sentence that is longer shows a file's content rather than what is wrong with the file.
LONGEST = 4000


def printable(text: str) -> str:
    """Text in which a terminal sees no commands: what is not printable is shown escaped.

    Names in files can hold sequences that set the clipboard or clear the screen.
    """
    shown = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
    if shown.isprintable():
        return shown
    return "".join(x if x.isprintable() else _escaped(x) for x in shown)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
