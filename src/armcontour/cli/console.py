"""Output on the terminal: lines and tables.

`to_line` makes all text printable, because names come from files of users.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Literal

import typer

from armcontour.core.text import to_line

if TYPE_CHECKING:
    from armcontour.core.result import Data
    from armcontour.files import ResultFolder

# Width of tables that do not go to a terminal [characters].
WIDTH = 120
# Maximum length of names that are not wrapped in a table [characters].
USUAL_NAME = 24


def print_lines(*texts: str, err: bool = False) -> None:
    """Print lines to the standard output or error; the terminal wraps them."""
    for text in texts:
        typer.echo(to_line(text), err=err)


def show_data(data: Data) -> None:
    """Print the values, tables and notes of a result."""
    from armcontour.core.render import text

    print_lines(*text(data).splitlines(), *data.notes)


def print_json(data: Data) -> None:
    """Print a result as JSON."""
    from armcontour.files.result_folder import data_json

    print(data_json(data), end="")


def refuse_force(options: Any) -> None:
    """Raise InvalidInput for --force without --out."""
    from armcontour.core.checks import raise_if

    lonely = options.out is None and options.force
    raise_if(lonely, "--force requires --out, the folder for the results.")


@contextmanager
def result_folder(options: Any) -> Iterator[ResultFolder | None]:
    """Context with the result folder of --out; None without --out."""
    from armcontour.files import ResultFolder

    refuse_force(options)
    if options.out is None:
        yield None
        return
    with ResultFolder(options.out, force=options.force) as folder:
        yield folder


def print_report(out: FilePath) -> None:
    """Print the address of the report in a result folder."""
    print_lines(f"Report: {(out / 'report.html').resolve().as_uri()}")


def show_table(
    headings: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None, names: int = 1
) -> None:
    """Print a table; texts of the first columns (`names`) are wrapped only above USUAL_NAME."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title and Text(to_line(title)), title_justify="left")
    for k, heading in enumerate(headings):
        is_usual = k < names and max((len(x[k]) for x in rows), default=0) <= USUAL_NAME
        side: Literal["left", "right"] = "right" if k else "left"
        table.add_column(Text(to_line(heading)), justify=side, overflow="fold", no_wrap=is_usual)
    for row in rows:
        table.add_row(*(Text(to_line(x)) for x in row))
    Console(width=None if sys.stdout.isatty() else WIDTH).print(table)
