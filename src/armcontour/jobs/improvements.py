"""Suggested changes of a job, and their effects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armcontour.core.render import Result, number
from armcontour.core.result import FILE, JUDGED, VERDICT, Data, Row, Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Improvement:
    """A suggested change of a job, and its effect.

    Args:
        label: The change in words.
        edits: Keys of the job file, relative to the run, and their values in SI units.
        saved: Reduction of the duration [s]; negative if the motion becomes longer.
        duration: Duration of the changed motion [s].
        off_drawing: Distance of the tool from the drawing after the change [m].
        kept: Verdict on the changed run; None if it is not judged.
        condition: Condition of the change, as a clause.
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
        """Effect of the change, such as "saves 0.5 s"."""
        time = number(abs(self.saved), "s")
        return f"saves {time}" if self.saved >= 0 else f"keeps the accuracy, takes {time} more"


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice(Result):
    """Suggested changes of a run, in order of decreasing effect.

    Args:
        improvements: The changes.
        note: A sentence if there are none.
    """

    improvements: tuple[Improvement, ...]
    note: str

    def to_data(self) -> Data:
        """Result with the table of the changes, or with the note."""
        return Data("What to change", tables=(self.table,), notes=(self.note,) if self.note else ())

    @property
    def table(self) -> Table:
        """Table of the changes for reports, the Studio, the terminal and files."""
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
