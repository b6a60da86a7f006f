"""Results that are written completely or not at all, in hidden folders that are then renamed."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

PREFIX = ".armcontour-"
# Folder in a result folder in which the next result is written.
NEXT = f"{PREFIX}next"
# Folder in `NEXT` for the previous result, which is removed after the replacement.
OLD = ".old"
# Fixes for errors of writing, by error number.
FIXES = {
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS),
        "choose a writable location, or change its permissions",
    ),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free some space, or choose another location"),
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR), "choose a location in an existing folder"),
}

# Held while results are moved into place; a signal waits for it before it ends the program.
_placing = threading.Lock()
# Hidden folders of this process, each with its destination and the folders created for it.
_open: dict[FilePath, tuple[FilePath, list[FilePath]]] = {}


class Staging:
    """Hidden folder in a destination folder, which this process locks and creates if necessary.

    Args:
        destination: The folder, without links.
        name: Its name in messages.

    Raises:
        InvalidInput: Another process writes to the destination, or was killed during `move`.
    """

    def __init__(self, destination: FilePath, name: FilePath) -> None:
        self.folder = destination / NEXT
        # A signal must not end the program between these steps.
        with _placing:
            above = [destination, *destination.parents]
            missing = above[: next(k for k, x in enumerate(above) if x.exists())]
            destination.mkdir(parents=True, exist_ok=True)
            self._release = lock(destination, name)
            old = self.folder / OLD
            try:
                if old.is_dir() and any(old.iterdir()):
                    raise InvalidInput(
                        f"A run was killed while it replaced the result in {name}. Move the files "
                        f"in {old} elsewhere, and remove {self.folder}."
                    )
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir()
            except (InvalidInput, OSError):
                self._release()
                raise
            _open[self.folder] = name, missing

    def move(self, moves: Sequence[tuple[FilePath, FilePath]]) -> None:
        """Rename files and folders, in order; if one rename fails, all are renamed back."""
        for source, _ in moves:
            source.lstat()
        with _placing:
            try:
                for source, target in moves:
                    os.rename(source, target)
            except BaseException:
                for source, target in reversed(moves):
                    if os.path.lexists(target) and not os.path.lexists(source):
                        os.rename(target, source)
                raise

    def remove(self) -> None:
        """Remove the folder with its content, and release the lock."""
        _remove(self.folder, _open.pop(self.folder)[1])
        self._release()


def lock(folder: FilePath, name: FilePath) -> Callable[[], None]:
    """Lock a folder until this process ends or calls the returned function; `name`: for messages.

    Raises:
        InvalidInput: Another process has the lock.
    """
    # Windows and some network file systems have no locks on folders.
    with suppress(ImportError, OSError):
        import fcntl

        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise InvalidInput(
                f"Another run is writing to {name}. Wait for its end, or choose another "
                "destination."
            ) from None
        return partial(os.close, handle)
    return lambda: None


def unwritable(target: object, error: OSError) -> InvalidInput:
    """Error for a destination that cannot be written, with a fix."""
    advice = FIXES.get(error.errno or 0, "choose another location")
    return InvalidInput(f"Cannot write {target}: {error.strerror or error}; {advice}.")


def write_atomically(file: FilePath, write: Callable[[FilePath], object]) -> None:
    """Write a file completely, or not at all; raises InvalidInput if writing fails."""
    try:
        with _placing:
            folder = FilePath(tempfile.mkdtemp(prefix=PREFIX, dir=file.parent))
            _open[folder] = file, []
        try:
            write(folder / file.name)
            with _placing:
                os.replace(folder / file.name, file)
        finally:
            _remove(folder, _open.pop(folder)[1])
    except OSError as error:
        raise unwritable(file, error) from None


def _remove(folder: FilePath, created: list[FilePath]) -> None:
    """Remove a hidden folder, and the folders that were created for it if they are empty."""
    shutil.rmtree(folder, ignore_errors=True)
    for x in created:
        with suppress(OSError):
            x.rmdir()


def abandon(patience: float) -> list[str]:
    """Remove all hidden folders before a signal ends the program; return the lost files.

    Current moves into place are completed first, for at most `patience` seconds. Afterwards no
    result can be moved into place.
    """
    if not _placing.acquire(timeout=patience):
        # The hidden folder may have the only copy of an earlier result, so it must stay.
        return []
    ended = dict(_open)
    for folder in [*ended] * 3:
        # The writing thread may add a file between these attempts.
        _remove(folder, ended[folder][1])
    return [str(destination) for destination, _ in ended.values()]
