"""Output on the terminal: lines and tables.

`to_line` makes all text printable, because names come from files of users.
"""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from armcontour.core.text import to_line

if TYPE_CHECKING:
    from armcontour.core.result import Data

# Width of tables that do not go to a terminal [characters].
WIDTH = 120
# Maximum length of names that are not wrapped in a table [characters].
USUAL_NAME = 24


def print_lines(*texts: str, err: bool = False) -> None:
    """Print lines to the standard output or error; the terminal wraps them."""
    for text in texts:
        typer.echo(to_line(text), err=err)


def data_lines(data: Data) -> list[str]:
    """Values, tables and notes of a result as lines."""
    from armcontour.core.render import text

    return [*text(data).splitlines(), *data.notes]


def table_lines(
    rows: Sequence[Sequence[str]], title: str | None = None, names: int = 1
) -> list[str]:
    """A table as lines, header first; the first columns (`names`) wrap only above USUAL_NAME."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title and Text(to_line(title)), title_justify="left")
    for k, column in enumerate(zip(*rows, strict=True)):
        is_usual = k < names and max(map(len, column[1:]), default=0) <= USUAL_NAME
        heading = Text(to_line(column[0]))
        table.add_column(heading, overflow="fold", no_wrap=is_usual)
        table.columns[k].justify = "right" if k else "left"
    for row in rows[1:]:
        table.add_row(*(Text(to_line(x)) for x in row))
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDTH
    printed = io.StringIO()
    Console(file=printed, width=width).print(table)
    return printed.getvalue().splitlines()
