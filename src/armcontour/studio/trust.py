"""Which files of arms a page may name: programs only if the user has named them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.files.cell import YAML


def check_trusted_xacro(
    data: Mapping[str, Any], folder: FilePath, trusted: Collection[FilePath]
) -> None:
    """Refuse an arm from a file of xacro, unless the user has named the file.

    Such a file is a program: a page may not choose which one is run.

    Args:
        data: The job.
        folder: Folder of relative file names.
        trusted: Files that may be such programs, or may name one.

    Raises:
        InvalidInput: The arm is such a file, or may lead to one.
    """
    # An arm file can name another arm; without any trust, reading it refuses what is a program.
    programs = (".xacro", *YAML) if trusted else (".xacro",)
    file = arm_file_of(data)
    if file is None or not file.lower().endswith(programs):
        return
    if (folder / file).resolve() not in trusted:
        raise InvalidInput(
            f"{file} is a program, or may name one: start the Studio with a job file that names "
            "it, and with --trust-xacro."
        )


def arm_file_of(data: Mapping[str, Any]) -> str | None:
    """The file of the arm of a job; None for a built-in one.

    Args:
        data: The job.
    """
    arm = data.get("arm")
    file = arm.get("file") if isinstance(arm, Mapping) else arm
    return file if isinstance(file, str) and FilePath(file).suffix else None
