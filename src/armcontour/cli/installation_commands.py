"""The commands `arms`, `init`, `compile` and `schema`: what this installation contains."""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath

import typer

from armcontour import files
from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Arms, Compile, Init, Schema
from armcontour.cli.inputs import refuse_existing
from armcontour.core import file_access
from armcontour.core.compilation import compile_kernels
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import Progress
from armcontour.files import json_schema
from armcontour.files.drawings.path_reader import YAML
from armcontour.files.robots.arm_loading import arm_names, load_arm

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


def arms(options: Arms, _: None, progress: Progress) -> Outcome:
    """List the built-in arms."""
    lines = []
    for name in arm_names():
        arm = load_arm(name)
        chain = arm.chain
        masses = "known" if arm.has_bodies else "not known"
        lines.append(f"{name}: {arm.name}, {arm.dof} joints, masses {masses}")
        lines.append(f"    source: {arm.source}")
        if chain.assumed:
            lines.append(f"    assumed: {chain.assumed}")
    return Outcome(lines=lines)


def init(options: Init, _: None, progress: Progress) -> Outcome:
    """Write a built-in cell as a job file."""
    cell = options.cell
    text = files.cell_text(options.cell)
    file = options.out or FilePath(f"{cell}.yaml")
    if file.suffix.lower() not in YAML:
        raise InvalidInput(f"The file of --out must have the extension {YAML[0]}, but is {file}.")
    refuse_existing(file, options.force)
    file_access.write_atomically(file, lambda x: x.write_text(text, encoding="utf-8"))
    return Outcome(
        lines=[
            f"{file} is a copy of the cell {cell}. Set its arm, its servo and the position of the "
            f"drawing. Then use: armcontour run DRAWING --cell {file} --out FOLDER"
        ]
    )
