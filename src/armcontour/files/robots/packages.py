"""The folders of ROS packages near a description, found by their `package.xml`."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path as FilePath

from armcontour.core import file_access
from armcontour.core.errors import InvalidInput

MARK = "package.xml"
# Largest number of folders above the description's own among which its package is looked for.
MOST_UP = 4
# Largest number of folders in which one package is looked for.
MOST_FOLDERS = 2000
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
NAME = re.compile(rb"<name>\s*([^<>]*?)\s*</name>")


def find_near(folder: FilePath, name: str) -> FilePath | None:
    """The nearest folder whose `package.xml` has a given name; None if there is none.

    The package of the description comes first, then the folders beside the package, then those
    beside its parent folder and one below them: the places of a package in a workspace of ROS.

    Args:
        folder: The folder of a description.
        name: Name of the package.
    """
    for count, place in enumerate(_places(folder)):
        if count >= MOST_FOLDERS:
            break
        if _name(place / MARK) == name:
            return place
    return None


def _places(folder: FilePath) -> Iterator[FilePath]:
    """The folders that may be a package, nearest first."""
    near = (folder, *folder.parents[:MOST_UP])
    own = next((x for x in near if (x / MARK).is_file()), folder)
    yield own
    yield from _folders(own)
    yield from _folders(own.parent)
    for place in _folders(own.parent.parent):
        yield place
        yield from _folders(place)


def _folders(place: FilePath) -> list[FilePath]:
    """The folders in a folder, in alphabetical order; none if it cannot be listed."""
    try:
        with os.scandir(place) as entries:
            names = [x.name for x in entries if not x.name.startswith(".") and x.is_dir()]
    except OSError:
        return []
    return [place / x for x in sorted(names)]


def _name(file: FilePath) -> str | None:
    """The name of the package of a `package.xml`; None if the file names none."""
    if not file.is_file():
        return None
    try:
        found = NAME.search(COMMENT.sub(b"", file_access.read_bytes(file, "package file")))
    except InvalidInput:
        return None
    return None if found is None else found[1].decode("utf-8", "replace")
