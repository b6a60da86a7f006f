"""Output on the terminal: tables and lines.

`to_line` makes all text printable, because names come from files of users.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Literal

from armcontour.core.text import to_line

if TYPE_CHECKING:
    from armcontour.core.result import Data

# Width of output that does not go to a terminal [characters].
WIDTH = 120
# Maximum length of names that are not wrapped in a table [characters].
USUAL_NAME = 24


class Console:
    """Printer on the standard output, as wide as the terminal."""

    def __init__(self) -> None:
        from rich.console import Console as Rich

        self._rich = Rich()
        if not self._rich.is_terminal:
            self._rich = Rich(width=WIDTH)

    def show_table(
        self,
        headings: Sequence[str],
        rows: Iterable[Sequence[str]],
        *,
        title: str | None = None,
        left_aligned: Collection[int] = (0,),
        whole: Collection[int] = (0,),
    ) -> None:
        """Print a table; columns of `whole` are wrapped only if texts exceed USUAL_NAME."""
        from rich.markup import escape
        from rich.table import Table

        shown = None if title is None else escape(to_line(title))
        table = Table(title=shown, title_justify="left")
        lines = [[to_line(x) for x in row] for row in rows]
        for i, heading in enumerate(headings):
            # Long names are wrapped instead of truncated; names up to USUAL_NAME stay on one line.
            justify: Literal["left", "right"] = "left" if i in left_aligned else "right"
            usual = i in whole and max((len(x[i]) for x in lines), default=0) <= USUAL_NAME
            table.add_column(escape(heading), justify=justify, overflow="fold", no_wrap=usual)
        for row in lines:
            table.add_row(*(escape(x) for x in row))
        self._rich.print(table)

    def show(self, data: Data) -> None:
        """Print the values, tables and notes of a result."""
        from armcontour.core.render import text

        for line in text(data).splitlines():
            self.print(line)
        for note in data.notes:
            self.print(note)

    def print(self, text: str) -> None:
        """Print a line without markup; the terminal wraps it."""
        self._rich.print(to_line(text), soft_wrap=True, highlight=False, markup=False)


def print_line(text: str) -> None:
    """Print a line without loading the library `rich`, which takes 0.1 s."""
    sys.stdout.write(f"{to_line(text)}\n")
    sys.stdout.flush()


def show_notes(notes: Iterable[str]) -> None:
    """Print notes about input files to the standard error."""
    for note in notes:
        sys.stderr.write(f"Note: {to_line(note)}\n")
