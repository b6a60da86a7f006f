"""Changes of a job, and what they gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armcontour.core.render import Result, number
from armcontour.core.result import FILE, JUDGED, VERDICT, Data, Row, Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Improvement:
    """A change of a job, and what it gains.

    Args:
        label: The change in words.
        edits: Keys of the job file, as the run sees them, and their values in SI units.
        saved: By how much the motion gets shorter [s]; below zero it gets longer.
        duration: Duration of the changed motion [s].
        off_drawing: Distance of the tool from the drawing after the change [m].
        kept: Whether the changed run is kept; None if it is not judged.
        condition: What must be true for it.
    """

    label: str
    edits: tuple[tuple[str, Any], ...]
    saved: float
    duration: float
    off_drawing: float
    kept: bool | None
    condition: str = ""

    @property
    def effect(self) -> str:
        """What the change gains, such as "saves 0.5 s"."""
        time = number(abs(self.saved), "s")
        return f"saves {time}" if self.saved >= 0 else f"kept, takes {time} more"


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice(Result):
    """What to change: at most three changes, those that save or repair most first.

    Args:
        improvements: The changes.
        note: A sentence where there are none.
    """

    improvements: tuple[Improvement, ...]
    note: str

    def to_data(self) -> Data:
        """A table of the changes."""
        return Data("What to change", tables=(self.table,), notes=(self.note,) if self.note else ())

    @property
    def table(self) -> Table:
        """The changes, which report, page, print and files have alike."""
        columns = (
            *(Row("change", None, "", "what to change"), Row("saved", None, "s", "saves")),
            *(Row("off_drawing", None, "m", "off the drawing"), Row("kept", None, JUDGED, "then")),
            *(Row("duration", None, "s"), Row("condition", None, "", "if"), Row("edits", None)),
        )
        rows = [
            (x.label, x.saved, x.off_drawing, x.kept, x.duration, x.condition, x.edits)
            for x in self.improvements
        ]
        return Table("changes", columns, rows, VERDICT if rows else FILE)
