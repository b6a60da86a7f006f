"""Files and folders that are put in place whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from armcontour import _staging
from armcontour.errors import InvalidInput

# What the folder of a bag holds; nothing else may be lost when one is replaced.
BAG = (".mcap", ".db3", ".yaml")


def put(file: FilePath, write: Callable[[FilePath], None], *, folder: bool = False) -> None:
    """Write beside the destination, then put it there; an error leaves what was there before.

    Args:
        file: The destination.
        write: Writes to the path that it is given, which has the same name.
        folder: Whether it writes a folder.

    Raises:
        InvalidInput: It cannot be written there.
    """
    try:
        _refuse_in_the_way(file, folder)
        _staging.put_in_place(file, write)
    except OSError as error:
        raise InvalidInput(f"Cannot write {file}: {error.strerror or error}.") from None


def _refuse_in_the_way(file: FilePath, folder: bool) -> None:
    if not file.name or "\0" in str(file):
        raise InvalidInput(f"Cannot write {str(file)!r}: it is not the name of a file.")
    if not folder and file.is_dir():
        raise InvalidInput(f"Cannot write {file}: a folder of that name is in the way.")
    if not folder or not file.exists():
        return
    if not file.is_dir():
        raise InvalidInput(f"Cannot write the folder {file}: a file of that name is in the way.")
    other = sorted(x.name for x in file.iterdir() if x.suffix not in BAG or x.is_dir())
    if other:
        raise InvalidInput(
            f"Cannot write {file}: that folder holds other things than a bag, such as {other[0]}."
        )
