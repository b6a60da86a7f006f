"""The commands `compile` and `schema`, about this installation."""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath

import typer

from armcontour.cli.commands import Compile, Schema
from armcontour.cli.execution import Outcome
from armcontour.core.compilation import compile_kernels
from armcontour.core.errors import ArmContourError
from armcontour.core.progress import Progress
from armcontour.files import json_schema

PACKAGE = FilePath(__file__).parents[1]


def compile(options: Compile, _: None, progress: Progress) -> Outcome:
    """Compile functions now that are otherwise compiled at first use."""
    compiled = compile_kernels(options.functions, progress)
    if compiled.folder is None:
        raise ArmContourError(
            "Compiled functions cannot be stored, because neither the package's folder nor the "
            "cache folder in your home folder is writable. Each run compiles the functions that it "
            "needs. Set NUMBA_CACHE_DIR to a writable folder, now and whenever armcontour runs."
        )
    lines = [
        f"{compiled.functions} functions are compiled, {compiled.compiled} of them now. They are "
        f"stored in {compiled.folder}."
    ]
    if not os.environ.get("NUMBA_CACHE_DIR") and PACKAGE not in compiled.folder.parents:
        lines.append(
            f"Note: only your own programs use these files, because the folder {PACKAGE} is not "
            "writable. Other users compile their own files. To share the files, set "
            "NUMBA_CACHE_DIR to a folder that all users can write to, now and whenever armcontour "
            "runs."
        )
    return Outcome(lines=lines)


def schema(options: Schema, _: None, progress: Progress) -> Outcome:
    """Print the JSON Schema of job files."""
    typer.echo(json.dumps(json_schema(), indent=2))
    return Outcome()
