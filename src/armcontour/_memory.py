"""Memory that work will take, said before it is taken.

Estimates are in bytes, of the whole program. What a row costs stands where the rows are made, and
was measured: docs/guides/numbers.md says how.
"""

from __future__ import annotations

from armcontour import _checks
from armcontour.errors import InvalidInput

# What a run may take unless it is told otherwise: a small computer has it.
DEFAULT = 2e9
# What the program takes before it works: the interpreter, libraries, compiled functions.
PROGRAM = 0.4e9
# No bound is below that, as nothing could be done.
SMALLEST = 0.5e9


def check_bound(memory: float) -> float:
    """A bound on memory [bytes].

    Raises:
        InvalidInput: Not a number, or below what the program takes by itself.
    """
    return _checks.between("memory", memory, SMALLEST, _checks.LARGEST, "bytes")


def refuse_above(bound: float, needed: float, what: str, mend: str) -> None:
    """Refuse work that would take more memory than it may.

    Args:
        bound: What it may take [bytes].
        needed: What it would take, beside PROGRAM [bytes].
        what: The work, with its numbers, for the sentence.
        mend: What makes it less.

    Raises:
        InvalidInput: It would take more.
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
    """A number of bytes for people."""
    return f"{size / 1e9:.3g} GB"


def describe_memory_error() -> str:
    """The sentence of a MemoryError: there was less memory than the work needs."""
    return (
        "The memory that this program may take is used up: close other programs, or give the job "
        "less to do, with a longer command interval, fewer runs or --no-simulation."
    )
