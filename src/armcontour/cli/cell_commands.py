"""The commands `arms` and `init`: built-in arms, and cells to edit."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import typer

from armcontour.cli.console import print_lines
from armcontour.cli.options import ForceFile
from armcontour.cli.program import PREPARE, command


@command(PREPARE, "arms")
def arms() -> None:
    """List the built-in arms with their sources and assumed parameters."""
    from armcontour.files.robots.loading import arm_names, load_arm

    for name in arm_names():
        arm = load_arm(name)
        chain = arm.chain
        masses = "known" if arm.has_bodies else "not known"
        print_lines(f"{name}: {arm.name}, {arm.dof} joints, masses {masses}")
        print_lines(f"    source: {arm.source}")
        if chain.assumed:
            print_lines(f"    assumed: {chain.assumed}")


@command(PREPARE, "init ur5e --out cell.yaml")
def init(
    cell: Annotated[
        str, typer.Argument(help="Built-in cell, by the name of its arm: see `armcontour arms`.")
    ] = "ur5e",
    out: Annotated[
        FilePath | None,
        typer.Option("--out", "-o", help="File for the cell (.yaml); by default CELL.yaml."),
    ] = None,
    force: ForceFile = False,
) -> None:
    """Write a built-in cell as a job file to edit, with arm, limits, servo and comments."""
    from armcontour.core import staging
    from armcontour.core.errors import InvalidInput
    from armcontour.files.cell import YAML, cell_text

    text = cell_text(cell)
    file = FilePath(f"{cell}.yaml") if out is None else out
    if file.suffix.lower() not in YAML:
        raise InvalidInput(f"The file of --out must have the extension {YAML[0]}, but is {file}.")
    if file.exists() and not force:
        raise InvalidInput(
            f"{file} already exists. Specify another file with --out, or add --force to replace it."
        )
    staging.write_atomically(file, lambda x: x.write_text(text, encoding="utf-8"))
    print_lines(
        f"{file} is a copy of the cell {cell}. Set its arm, its servo and the position of the "
        f"drawing. Then use: armcontour run DRAWING --cell {file} --out FOLDER"
    )
