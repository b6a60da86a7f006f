"""Staging folders: hidden folders in which results are made before they are moved into place.

A staging folder has a fixed name next to its destination and belongs to one process, which has a
lock on it. So a second run into the same destination is refused, and the remains of a killed run
can be distinguished from the files of a running one.
"""

from __future__ import annotations

import errno
import os
import shutil
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath

from armcontour.errors import InvalidInput

PREFIX = ".armcontour-"
# Number of characters of a file's name in the name of its staging folder: enough to recognise it,
# and with prefix and checksum below 255 bytes.
LONGEST_NAME = 40

# What mends it that the system refuses to write; of others nothing is known.
MENDS = {
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS), "name a place where you may write, or allow it"
    ),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free some space, or name another place"),
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR), "name a place in a folder that is there"),
}

# A thread that moves results into place has this lock; a thread that ends the program waits for it.
_placing = threading.Lock()
# For each staging folder its destination, unless that grows in parts, and the parent folders that
# were made for it.
_open: dict[FilePath, tuple[FilePath | None, list[FilePath]]] = {}


class Staging:
    """A staging folder of this process; a context manager that removes the folder at its end.

    Args:
        place: Path of the staging folder; `beside` and `inside` give it for a destination.
        destination: The file or folder that is made in it, for messages.
        parents: Whether to make missing parent folders; they are removed if they stay empty.
        growing: Whether the destination is written in parts: then it is not unwritten if the
            program ends because of a signal.

    Raises:
        InvalidInput: Another process uses the folder.
        OSError: The folder cannot be made.
    """

    def __init__(
        self,
        place: FilePath,
        destination: FilePath,
        *,
        parents: bool = False,
        growing: bool = False,
    ) -> None:
        self.place = place
        # The program must not be ended by a signal between these steps.
        with moving():
            self._made = _make_parents(place) if parents else []
            self._handle = _take(place, destination)
            _open[place] = (None if growing else destination, self._made)

    def __enter__(self) -> Staging:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()

    def empty(self) -> None:
        """Remove the content of the folder."""
        for inner in self.place.iterdir():
            if inner.is_dir() and not inner.is_symlink():
                shutil.rmtree(inner)
            else:
                inner.unlink()

    def remove(self) -> None:
        """Remove the folder with its content, and release the lock."""
        shutil.rmtree(self.place, ignore_errors=True)
        _remove_empty(self._made)
        self.release()

    def release(self) -> None:
        """Release the lock; the folder stays for the next run."""
        _open.pop(self.place, None)
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def beside(file: FilePath) -> FilePath:
    """Path of the staging folder for a file or folder, next to it."""
    checksum = zlib.crc32(os.fsencode(file.name))
    return file.parent / f"{PREFIX}{file.name[:LONGEST_NAME]}-{checksum:08x}"


def inside(folder: FilePath) -> FilePath:
    """Path of the staging folder for the content of an existing folder, inside it."""
    return folder / f"{PREFIX}next"


@contextmanager
def moving() -> Iterator[None]:
    """Context in which results are moved into place; signals do not end the program meanwhile.

    The context must be short: only renames.
    """
    with _placing:
        yield


def unwritable(what: object, error: OSError) -> InvalidInput:
    """The refusal of a place that the system does not let us write, with what mends it.

    Args:
        what: The file; or the folder, after "to the folder".
        error: What the system said.
    """
    mend = MENDS.get(error.errno or 0, "name another place")
    return InvalidInput(f"Cannot write {what}: {error.strerror or error}; {mend}.")


def put_in_place(file: FilePath, write: Callable[[FilePath], object]) -> None:
    """Write a file or folder atomically: completely, or not at all if writing fails.

    Args:
        file: The destination, which may exist.
        write: Called with a temporary path of the same name; writes the file or folder there.

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
    """Remove all staging folders before the program ends because of a signal.

    The function waits until the current moves into place are complete. After it no result can be
    moved into place.

    Args:
        patience: Longest time to wait for moves [s].

    Returns:
        The destinations that were not written.
    """
    if not _placing.acquire(timeout=patience):
        # The next run completes an incomplete move, so the staging folder must stay.
        return []
    unwritten = []
    for place, (destination, made) in list(_open.items()):
        # The writing thread may add a file between these attempts.
        for _ in range(3):
            shutil.rmtree(place, ignore_errors=True)
            if not place.exists():
                break
        _remove_empty(made)
        if destination is not None:
            unwritten.append(str(destination))
    return unwritten


def _make_parents(place: FilePath) -> list[FilePath]:
    """Make the parent folders of a path; returns those that were missing, the innermost first."""
    missing = [x for x in place.parents if not x.exists()]
    place.parent.mkdir(parents=True, exist_ok=True)
    return missing


def _remove_empty(folders: list[FilePath]) -> None:
    """Remove those of the folders that are empty."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _swap(fresh: FilePath, file: FilePath, old: FilePath) -> None:
    """Replace a folder in two renames; if the second one fails, the old folder is restored.

    Args:
        fresh: The new folder.
        file: The destination.
        old: Path to which the old folder is moved.
    """
    os.replace(file, old)
    try:
        os.replace(fresh, file)
    except OSError:
        os.replace(old, file)
        raise


def _take(place: FilePath, destination: FilePath) -> int | None:
    """Make a staging folder or take over an existing one.

    Returns:
        A handle with the lock; None if the system has no locks on folders.

    Raises:
        InvalidInput: Another process uses the folder.
        OSError: The folder cannot be made.
    """
    while True:
        existed = False
        try:
            place.mkdir()
        except FileExistsError:
            existed = True
        # Another process may remove its folder between these steps.
        with suppress(FileNotFoundError):
            handle = _lock(place, existed)
            if handle == _BUSY:
                raise InvalidInput(
                    f"Another run is writing to {destination}: wait for its end, or choose "
                    f"another destination. If there is no other run, remove {place}."
                )
            if handle is None or os.path.samestat(os.fstat(handle), os.lstat(place)):
                return handle
            os.close(handle)


_BUSY = -1


def _lock(place: FilePath, existed: bool) -> int | None:
    """Lock a folder.

    Windows and some network file systems have no locks on folders. There the process that makes
    the folder owns it.

    Args:
        place: The folder.
        existed: Whether the folder existed before.

    Returns:
        A handle with the lock; _BUSY if another process uses the folder; None if there are no
        locks and this process made the folder.
    """
    try:
        import fcntl
    except ImportError:
        return _BUSY if existed else None
    handle = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        return _BUSY if existed or isinstance(error, BlockingIOError) else None
    return handle
