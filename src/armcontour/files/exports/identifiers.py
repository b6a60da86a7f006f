"""Names of robot programs, which languages of controllers restrict in characters and length."""

from __future__ import annotations

import hashlib

# Number of hexadecimal digits in a digest; two of a thousand programs share one with probability
# 0.03.
DIGEST = 6


def identifier(text: str, longest: int | None = None) -> str:
    """Convert a text to an identifier of ASCII letters, digits and underscores; no digit first.

    With `longest`, different texts have different identifiers of at most this length: if characters
    other than spaces are replaced, or the identifier is cut, it ends with a digest of the text.
    Texts that differ only in spaces and underscores are the same.
    """
    plain = "".join(x if x.isascii() and x.isalnum() else "_" for x in text)
    name = f"_{plain}" if plain[:1].isdigit() else plain
    if longest is None or (plain == text.replace(" ", "_") and len(name) <= longest):
        return name
    digest = hashlib.sha256(text.encode()).hexdigest()[:DIGEST]
    return f"{name[: longest - DIGEST - 1]}_{digest}"
