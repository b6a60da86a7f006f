"""Atomic writing of an exported file or folder at its destination."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from armcontour import _staging
from armcontour.errors import InvalidInput

# Extensions of the files in the folder of a bag; a folder with other files is not replaced.
BAG = (".mcap", ".db3", ".yaml")


def put(file: FilePath, write: Callable[[FilePath], None], *, folder: bool = False) -> None:
    """Write a file or folder to a temporary path, then move it to the destination.

    If writing fails, an earlier file at the destination stays.

    Args:
        file: The destination.
        write: Called with the temporary path, which has the same name; writes the file there.
        folder: Whether `write` writes a folder.

    Raises:
        InvalidInput: The destination cannot be written.
    """
    try:
        _refuse_destination(file, folder)
        _staging.put_in_place(file, write)
    except OSError as error:
        raise _staging.unwritable(file, error) from None


def _refuse_destination(file: FilePath, folder: bool) -> None:
    """Refuse a destination where something else would be lost.

    Raises:
        InvalidInput: A folder is at the path of a file, a file at the path of a folder, or the
            folder has files that are not of a bag.
    """
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
