"""The command `warm`: compile ahead what commands would compile when they first need it."""

from __future__ import annotations

import os
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console
from armcontour.cli.progress import share_progress

if TYPE_CHECKING:
    from armcontour.core.compiling import Which

PACKAGE = FilePath(__file__).parents[1]


def warm_up(which: Which) -> None:
    """Compile functions, and say how many and where they are kept.

    Args:
        which: Which functions.

    Raises:
        ExecutionError: A process that compiles has ended too early.
    """
    from armcontour.core.compiling import warm

    with share_progress() as progress:
        found = warm(which, progress)
    console = Console()
    console.say(
        f"{found.functions} functions are compiled, {found.compiled} of them now. They are kept "
        f"in {found.folder}."
    )
    if not os.environ.get("NUMBA_CACHE_DIR") and PACKAGE not in found.folder.parents:
        console.say(
            f"Note: only your own programs find them there, because the folder {PACKAGE} cannot "
            "be written. Others compile their own, or set NUMBA_CACHE_DIR to a folder that all "
            "can write to, now and whenever armcontour runs."
        )
