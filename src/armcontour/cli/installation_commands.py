"""The commands `compile` and `schema`, about this installation."""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath
from typing import Annotated, Literal

import typer

from armcontour.cli.console import print_lines
from armcontour.cli.program import INSTALLED, command

PACKAGE = FilePath(__file__).parents[1]


@command(INSTALLED, "compile usual", name="compile")
def compile_functions(
    kind: Annotated[
        Literal["all", "usual", "plane", "space"],
        typer.Argument(
            help="Functions to compile: all, or those of usual runs in the plane, in space, or "
            "both (usual)."
        ),
    ] = "all",
) -> None:
    """Compile functions now that are otherwise compiled at first use, to avoid later waiting."""
    from armcontour.cli.progress_bars import show_progress
    from armcontour.core.compilation import compile_kernels

    with show_progress() as progress:
        compiled = compile_kernels(kind, progress)
    print_lines(
        f"{compiled.functions} functions are compiled, {compiled.compiled} of them now. They are "
        f"stored in {compiled.folder}."
    )
    if not os.environ.get("NUMBA_CACHE_DIR") and PACKAGE not in compiled.folder.parents:
        print_lines(
            f"Note: only your own programs use these files, because the folder {PACKAGE} is not "
            "writable. Other users compile their own files. To share the files, set "
            "NUMBA_CACHE_DIR to a folder that all users can write to, now and whenever armcontour "
            "runs."
        )


@command(INSTALLED, "schema")
def schema() -> None:
    """Print the JSON Schema of job files."""
    from armcontour.files import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))
