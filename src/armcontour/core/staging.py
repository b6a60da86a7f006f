"""Staging folders: hidden folders in which results are written before they are moved into place.

A staging folder has a fixed name next to its destination and belongs to one process, which holds a
lock on it. A second run with the same destination is therefore refused.
"""

from __future__ import annotations

import errno
import os
import shutil
import threading
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

PREFIX = ".armcontour-"
# Number of characters of a file's name in the name of its staging folder. They identify the file,
# and with prefix and checksum the name stays below 255 bytes.
LONGEST_NAME = 40

# Fixes for errors of writing, by error number.
FIXES = {
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS),
        "choose a writable location, or change its permissions",
    ),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free some space, or choose another location"),
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR), "choose a location in an existing folder"),
}

# Folder in a staging folder for the previous result, which is removed after the replacement.
OLD = ".old"

# Held while results are moved into place; a thread that ends the program waits for it.
_placing = threading.Lock()
# Open staging folders and their destinations; None for a destination that grows in parts.
_open: dict[FilePath, FilePath | None] = {}


class Staging:
    """Staging folder of this process; a context manager that removes the folder at its end."""

    def __init__(self, folder: FilePath, destination: FilePath, *, growing: bool = False) -> None:
        self.folder = folder
        # A signal must not end the program between these steps.
        with moving():
            self._handle = _take(folder, destination)
            _open[folder] = None if growing else destination

    def __enter__(self) -> Staging:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()

    def empty(self) -> None:
        """Remove the content of the folder."""
        for inner in self.folder.iterdir():
            if inner.is_dir() and not inner.is_symlink():
                shutil.rmtree(inner)
            else:
                inner.unlink()

    def move(self, moves: Sequence[tuple[FilePath, FilePath]]) -> None:
        """Rename files and folders, in order; if one rename fails, all are renamed back."""
        for source, _ in moves:
            source.lstat()
        with moving():
            try:
                for source, target in moves:
                    os.rename(source, target)
            except BaseException:
                destination = _open.pop(self.folder)
                for source, target in reversed(moves):
                    if os.path.lexists(target) and not os.path.lexists(source):
                        os.rename(target, source)
                _open[self.folder] = destination
                raise

    def remove(self) -> None:
        """Remove the folder with its content, and release the lock."""
        if self.folder in _open:
            shutil.rmtree(self.folder, ignore_errors=True)
            del _open[self.folder]
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def hidden_sibling(file: FilePath) -> FilePath:
    """Path of the staging folder next to a file or folder."""
    checksum = zlib.crc32(os.fsencode(file.name))
    return file.parent / f"{PREFIX}{file.name[:LONGEST_NAME]}-{checksum:08x}"


def inside(folder: FilePath) -> FilePath:
    """Path of the staging folder inside an existing folder."""
    return folder / f"{PREFIX}next"


@contextmanager
def moving() -> Iterator[None]:
    """Context in which results are moved into place; signals do not end the program meanwhile."""
    # Only renames belong in this context, so that it is short.
    with _placing:
        yield


def unwritable(target: object, error: OSError) -> InvalidInput:
    """Error for a destination that cannot be written, with a fix."""
    advice = FIXES.get(error.errno or 0, "choose another location")
    return InvalidInput(f"Cannot write {target}: {error.strerror or error}; {advice}.")


def write_atomically(file: FilePath, write: Callable[[FilePath], object]) -> None:
    """Write a file completely, or not at all if writing fails."""
    with Staging(hidden_sibling(file), file) as staging:
        staging.empty()
        fresh = staging.folder / file.name
        write(fresh)
        with moving():
            os.replace(fresh, file)


def abandon(patience: float) -> list[str]:
    """Remove all staging folders before a signal ends the program; return the lost files."""
    # Current moves into place are completed first, for at most `patience` seconds. Afterwards no
    # result can be moved into place.
    if not _placing.acquire(timeout=patience):
        # The staging folder may have the only copy of an earlier result, so it must stay.
        return []
    ended = dict(_open)
    for folder in ended:
        # The writing thread may add a file between these attempts.
        for _ in range(3):
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():
                break
    return [str(x) for x in ended.values() if x is not None]


def _take(folder: FilePath, destination: FilePath) -> int | None:
    """Create a staging folder or take over one of a killed process; returns the locked handle."""
    # Windows and some network file systems have no locks on folders. There the process that creates
    # the folder owns it, and the handle is None.
    handle, is_ours = None, True
    try:
        folder.mkdir()
    except FileExistsError:
        is_ours = False
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Another process may have removed its folder before this one locked it.
        is_ours = os.path.samestat(os.fstat(handle), os.lstat(folder))
    except BlockingIOError:
        is_ours = False
    except (ImportError, OSError):
        pass
    old = folder / OLD
    if is_ours and not (old.is_dir() and any(old.iterdir())):
        return handle
    if handle is not None:
        os.close(handle)
    raise InvalidInput(
        f"Another run is writing to {destination}, or was killed while it replaced an earlier "
        f"result. Wait for its end, or choose another destination. If there is no other run, move "
        f"any files in {old} elsewhere, and remove {folder}."
    )
