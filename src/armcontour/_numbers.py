"""Numbers as text: decimal digits of ASCII, and nothing that only Python takes for a number."""

from __future__ import annotations

import math
from typing import Any

# More digits than this no program prints.
LONGEST = 100


def parse_number(text: str) -> float:
    """The finite number that a text is, blanks around it left out.

    Python's `float` takes `1_0`, digits of every script, `nan` and `inf` too; files do not.

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
    """The finite number that a value of a YAML file is; None if the value is something else."""
    if isinstance(value, bool):
        return None
    try:
        found = parse_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None
