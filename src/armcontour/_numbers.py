"""Parse numbers from text: finite decimal numbers in ASCII digits only."""

from __future__ import annotations

import math
from typing import Any

# Longest text of a number; no program prints more digits.
LONGEST = 100


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
