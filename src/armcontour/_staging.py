"""Hidden folders in which results are made before they are put in place.

A staging folder has a fixed name beside its destination, and belongs to one process: the process
holds a lock on it. So a second run into the same destination is refused, and what a killed run
left there can be told from what a running one still needs.
"""

from __future__ import annotations

import os
import shutil
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath

from armcontour.errors import InvalidInput

PREFIX = ".armcontour-"
# Enough of a name for a person to recognise it; with prefix and checksum below 255 bytes.
LONGEST_NAME = 40

# Whoever moves results into place holds this lock, and whoever ends the program waits for it.
_placing = threading.Lock()
# By staging folder: the destination, and folders that were made for it.
_open: dict[FilePath, tuple[FilePath, list[FilePath]]] = {}


class Staging:
    """A hidden folder of this process; a context manager that removes the folder at its end.

    Args:
        place: The folder itself; `beside` and `inside` give its name for a destination.
        destination: What is made in it, for messages.
        parents: Whether to make the folders above it; those that stay empty are removed.

    Raises:
        InvalidInput: Another process has the folder.
        OSError: The folder cannot be made.
    """

    def __init__(self, place: FilePath, destination: FilePath, *, parents: bool = False) -> None:
        self.place = place
        # Nobody may end the program between the two steps.
        with moving():
            self._made = _make_parents(place) if parents else []
            self._handle = _take(place, destination)
            _open[place] = (destination, self._made)

    def __enter__(self) -> Staging:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()

    def empty(self) -> None:
        """Remove what the folder holds."""
        for inner in self.place.iterdir():
            if inner.is_dir() and not inner.is_symlink():
                shutil.rmtree(inner)
            else:
                inner.unlink()

    def remove(self) -> None:
        """Remove the folder with what it holds, and give up the lock."""
        shutil.rmtree(self.place, ignore_errors=True)
        _remove_empty(self._made)
        self.release()

    def release(self) -> None:
        """Give up the lock; the folder stays for the next run."""
        _open.pop(self.place, None)
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def beside(file: FilePath) -> FilePath:
    """The staging folder for a file or folder that may not exist yet."""
    checksum = zlib.crc32(os.fsencode(file.name))
    return file.parent / f"{PREFIX}{file.name[:LONGEST_NAME]}-{checksum:08x}"


def inside(folder: FilePath) -> FilePath:
    """The staging folder for a folder whose content is replaced."""
    return folder / f"{PREFIX}next"


@contextmanager
def moving() -> Iterator[None]:
    """While results are moved into place: no signal ends the program until that is done.

    Keep it short: renames only.
    """
    with _placing:
        yield


def put_in_place(file: FilePath, write: Callable[[FilePath], object]) -> None:
    """Write a file or folder that appears whole, or replaces an earlier one whole, or not at all.

    Args:
        file: The destination.
        write: Writes to the path that it is given, which has the same name.

    Raises:
        InvalidInput: Another process is writing the same file.
        OSError: The file cannot be written.
    """
    with Staging(beside(file), file) as staging:
        staging.empty()
        fresh = staging.place / file.name
        write(fresh)
        with moving():
            if fresh.is_dir() and file.exists():
                _swap(fresh, file, staging.place / f"{file.name}.old")
            else:
                os.replace(fresh, file)


def abandon(patience: float) -> list[str]:
    """Remove all staging folders, before the program ends by a signal.

    What is being moved into place is moved first. Nothing can be moved any more afterwards.

    Args:
        patience: How long to wait for what is being moved [s].

    Returns:
        The destinations that were not written.
    """
    if not _placing.acquire(timeout=patience):
        # What was moved in part is completed by the next run: the staging folder must stay.
        return []
    unwritten = []
    for place, (destination, made) in list(_open.items()):
        # The thread that writes may add a file meanwhile.
        for _ in range(3):
            shutil.rmtree(place, ignore_errors=True)
            if not place.exists():
                break
        _remove_empty(made)
        unwritten.append(str(destination))
    return unwritten


def _make_parents(place: FilePath) -> list[FilePath]:
    """Make the folders above a place; gives those that were not there, the lowest first."""
    missing = [x for x in place.parents if not x.exists()]
    place.parent.mkdir(parents=True, exist_ok=True)
    return missing


def _remove_empty(folders: list[FilePath]) -> None:
    """Remove folders in which nothing came to be."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _swap(fresh: FilePath, file: FilePath, old: FilePath) -> None:
    """Folders cannot be replaced in one step: the old one comes back if the second step fails."""
    os.replace(file, old)
    try:
        os.replace(fresh, file)
    except OSError:
        os.replace(old, file)
        raise


def _take(place: FilePath, destination: FilePath) -> int | None:
    """Make or take over a staging folder: the handle with the lock, None without locks."""
    while True:
        left = False
        try:
            place.mkdir()
        except FileExistsError:
            left = True
        # Its owner may remove the folder between two of these steps.
        with suppress(FileNotFoundError):
            handle = _lock(place, left)
            if handle == _BUSY:
                raise InvalidInput(
                    f"Another run is writing to {destination}: wait for its end, or choose "
                    f"another place. If there is no other run, remove {place}."
                )
            if handle is None or os.path.samestat(os.fstat(handle), os.lstat(place)):
                return handle
            os.close(handle)


_BUSY = -1


def _lock(place: FilePath, left: bool) -> int | None:
    """A handle on a folder, with its lock; or _BUSY if another process has the lock.

    Windows has no locks on folders, and some network file systems have none: there the handle is
    None, and whoever made the folder has it.
    """
    try:
        import fcntl
    except ImportError:
        return _BUSY if left else None
    handle = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        return _BUSY if left or isinstance(error, BlockingIOError) else None
    return handle
