"""The command `init`: write a built-in cell to a file, to start from."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour.cli.console import Console


def write_cell(cell: str, out: FilePath | None, *, force: bool) -> None:
    """Write the job file of a built-in cell, with its comments, and say how it is used.

    Args:
        cell: Name of the cell.
        out: The file; by default the name of the cell with .yaml, in the current folder.
        force: Whether a file of that name may be replaced.

    Raises:
        InvalidInput: No such cell, a file that is there already, or one that cannot be written.
    """
    from armcontour.core import staging
    from armcontour.core.errors import InvalidInput
    from armcontour.files.cell import YAML, cell_text

    text = cell_text(cell)
    file = FilePath(f"{cell}.yaml") if out is None else out
    if file.suffix.lower() not in YAML:
        raise InvalidInput(f"A cell is a {YAML[0]} file: name one with --out, not {file}.")
    if file.exists() and not force:
        raise InvalidInput(f"{file} is there already: name another file with --out, or --force.")
    try:
        staging.write_atomically(file, lambda x: x.write_text(text, encoding="utf-8"))
    except OSError as error:
        raise staging.unwritable(file, error) from None
    Console().say(
        f"{file} is a copy of the cell {cell}: set its arm, servo and place of the drawing, then "
        f"armcontour run DRAWING --cell {file} --out FOLDER"
    )
