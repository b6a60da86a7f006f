"""Bounds on the program's memory, compared with estimates before the memory is allocated.

Estimates are in bytes for the whole program. The memory of one row of data is a constant in the
module that makes the rows; docs/guides/numbers.md describes how these constants were measured.
"""

from __future__ import annotations

import os

from armcontour import _checks
from armcontour.errors import InvalidInput


def machine_memory() -> float | None:
    """Memory of the machine [bytes]; None where the system does not tell it."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


# Default bound [bytes]: half of the machine's memory, and at least that of a small computer.
DEFAULT = max(2e9, 0.5 * (machine_memory() or 0.0))
# Memory of the interpreter, the libraries and the compiled functions [bytes].
PROGRAM = 0.4e9
# Smallest bound [bytes]: with less memory nothing can be computed.
SMALLEST = 0.5e9


def check_bound(memory: float) -> float:
    """Return a bound on memory [bytes] if it is valid.

    Raises:
        InvalidInput: The bound is not a number, or is below SMALLEST.
    """
    return _checks.between("memory", memory, SMALLEST, _checks.LARGEST, "bytes")


def refuse_above(bound: float, needed: float, what: str, mend: str) -> None:
    """Refuse work that would take more memory than the bound allows.

    Args:
        bound: Bound on the program's memory [bytes].
        needed: Estimated memory of the work, without PROGRAM [bytes].
        what: Description of the work with its numbers, for the message.
        mend: How the user can reduce the memory, for the message.

    Raises:
        InvalidInput: The estimate exceeds the bound.
    """
    total = PROGRAM + needed
    if not total <= check_bound(bound):
        raise InvalidInput(
            f"{what} would take about {in_words(total)} of memory, more than the bound of "
            f"{in_words(bound)}: {mend}, or raise the bound (memory in a job, --memory on the "
            "command line).",
            limit="memory",
            needed=total,
            allowed=bound,
        )


def in_words(size: float) -> str:
    """A number of bytes as text in GB."""
    return f"{size / 1e9:.3g} GB"


def describe_memory_error() -> str:
    """The message for a MemoryError."""
    return (
        "The memory that this program may take is used up: close other programs, or give the job "
        "less to do, with a longer command interval, fewer runs or --no-simulation."
    )
