"""The commands `arms` and `init`: built-in arms, and cells to edit."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour import files
from armcontour.cli.commands import Arms, Init
from armcontour.cli.execution import Outcome
from armcontour.cli.inputs import refuse_existing
from armcontour.core import staging
from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Progress
from armcontour.files.drawings.endings import YAML
from armcontour.files.robots.loading import arm_names, load_arm


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
    cell, text = options.cell, files.cell_text(options.cell)
    file = options.out or FilePath(f"{cell}.yaml")
    if file.suffix.lower() not in YAML:
        raise InvalidInput(f"The file of --out must have the extension {YAML[0]}, but is {file}.")
    refuse_existing(file, options.force)
    staging.write_atomically(file, lambda x: x.write_text(text, encoding="utf-8"))
    return Outcome(
        lines=[
            f"{file} is a copy of the cell {cell}. Set its arm, its servo and the position of the "
            f"drawing. Then use: armcontour run DRAWING --cell {file} --out FOLDER"
        ]
    )
