"""What the readers of drawings share: how a file is to be read, and its bytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour import _checks
from armcontour.errors import InvalidInput

# Largest file that is read [bytes]: what is made of it must fit in memory many times over.
LARGEST = 64_000_000
# Beyond this [m] floating point no longer resolves what makes two points different; it is a wrong
# unit rather than a drawing.
FARTHEST = 1e6
UNKNOWN = ("refuse", "skip")
# What sentences say of the latter.
SKIP = "have it left out (unknown: skip, or --skip-unknown)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """How a drawing is to be read.

    Args:
        unit: Length of its unit [m]; None takes what the file says.
        chord_tolerance: Curves that are neither lines nor arcs become arcs within this [m].
        join_tolerance: Ends nearer than this are one point [m].
        unknown: What to do with what the reader does not know: "refuse" it, or "skip" it and say so
            in the program's notes.
        layers: Nothing needs to be known of what is on others; None means all.
    """

    unit: float | None = None
    chord_tolerance: float = 1e-5
    join_tolerance: float = 1e-5
    unknown: str = "refuse"
    layers: frozenset[str] | None = None

    def __post_init__(self) -> None:
        if self.unit is not None:
            _checks.positive("unit of a drawing", self.unit, "m")
        _checks.positive("chord tolerance", self.chord_tolerance, "m")
        _checks.positive("join tolerance", self.join_tolerance, "m")
        _checks.choice("unknown", self.unknown, UNKNOWN)


def bytes_of(file: str | FilePath) -> bytes:
    """What a file holds.

    Raises:
        InvalidInput: It cannot be read, or is too large.
    """
    place = FilePath(file)
    try:
        if place.exists() and not place.is_file():
            raise InvalidInput(f"Cannot read {place}: it is no file.")
        size = place.stat().st_size
        if size > LARGEST:
            raise InvalidInput(
                f"{place.name} has {size / 1e6:.0f} MB, more than the {LARGEST / 1e6:.0f} MB that "
                "are read: split it."
            )
        return place.read_bytes()
    except OSError as error:
        raise InvalidInput(f"Cannot read {place}: {error.strerror}.") from None
