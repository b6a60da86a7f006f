"""What the readers of drawings share: how a file is to be read, and its bytes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path as FilePath

from armcontour import _checks
from armcontour._checks import LONGEST_NAME
from armcontour._files import SMALL, read_bytes
from armcontour._text import make_printable, show

# Largest file that is read [bytes]: what is made of it must fit in memory many times over.
LARGEST = SMALL
# Characters of a name that is cut; what tells it from others of that beginning comes on top.
KEPT = LONGEST_NAME - 12
# Beyond this [m] floating point no longer resolves what makes two points different; it is a wrong
# unit rather than a drawing.
FARTHEST = 1e6
UNKNOWN = ("refuse", "skip")
OFFSETS = ("file", "zero")
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
        skip: Words and codes of G-code to leave out, such as "M6" or "T".
        offsets: Where offsets of G-code come from that are in the table of a controller: "file"
            reads only those that the file gives, "zero" states that all others are zero.
        layers: Nothing needs to be known of what is on others; None means all.
    """

    unit: float | None = None
    chord_tolerance: float = 1e-5
    join_tolerance: float = 1e-5
    unknown: str = "refuse"
    skip: frozenset[str] = frozenset()
    offsets: str = "file"
    layers: frozenset[str] | None = None

    def __post_init__(self) -> None:
        if self.unit is not None:
            _checks.positive("unit of a drawing", self.unit, "m")
        _checks.positive("chord tolerance", self.chord_tolerance, "m")
        _checks.positive("join tolerance", self.join_tolerance, "m")
        _checks.choice("unknown", self.unknown, UNKNOWN)
        _checks.choice("offsets", self.offsets, OFFSETS)


@dataclass(slots=True)
class Labels:
    """Names of entities and layers as contours can have them.

    A name that is too long is cut, and a character that is not printable becomes its escape, since
    programs write such names that no user can change. Different names stay different.
    """

    _changed: dict[str, str] = field(default_factory=dict)
    _alike: Counter[str] = field(default_factory=Counter)

    def __call__(self, name: str) -> str:
        """The name of a contour or a layer for one of the drawing."""
        if len(name) <= LONGEST_NAME and name.isprintable():
            return name
        if name not in self._changed:
            self._changed[name] = self._fitted(name)
        return self._changed[name]

    def _fitted(self, name: str) -> str:
        plain = make_printable(name[: LONGEST_NAME + 1])
        short = len(name) <= LONGEST_NAME and len(plain) <= LONGEST_NAME
        first = plain if short else f"{plain[:KEPT]}..."
        self._alike[first] += 1
        count = self._alike[first]
        return first if count == 1 else f"{plain[:KEPT]}... ({count})"

    @property
    def notes(self) -> list[str]:
        """A sentence on the names that were changed."""
        if not self._changed:
            return []
        name, label = next(iter(self._changed.items()))
        return [
            f"Names that have more than {LONGEST_NAME} characters, or some that are not printable, "
            f"were changed ({len(self._changed)}), such as {show(name)} to '{label}'."
        ]


def bytes_of(file: str | FilePath) -> bytes:
    """What a file holds.

    Raises:
        InvalidInput: It cannot be read, or is too large.
    """
    return read_bytes(file, "file", most=LARGEST)
