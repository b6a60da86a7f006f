"""Files of users: reading up to a size limit, and writing completely or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath

from armcontour.core.errors import FileError
from armcontour.core.progress import registered

MEGABYTE = 1_000_000
# Size limit of jobs, arms and limits, which are written by hand or by small tools [bytes].
MAX_HAND_WRITTEN = 64 * MEGABYTE
# Size limit of logs and trajectories: an hour of seven joints at 1 kHz with 15 digits [bytes].
MAX_RECORDED = 1000 * MEGABYTE
_BAG = "Only identify, learn and check read bags of ROS 2. Specify another file"
# First bytes of unsupported files (placeholders, or formats to convert), each with the end of its
# error message.
FOREIGN = {
    b"version https://git-lfs.github.com/": "a pointer of Git LFS and not the file itself. Fetch "
    "it with `git lfs pull`",
    b"#ROSBAG V": "a bag of ROS 1. Convert it: `pip install rosbags`, then `rosbags-convert --src "
    "FILE.bag --dst FOLDER`",
}
# Extensions of unsupported robots, logs and set-points, each with the remedy.
ENDINGS = {
    ".xacro": "Expand it: `pip install xacrodoc`, then `xacrodoc robot.urdf.xacro NAME:=VALUE -d "
    "FOLDER_OF_PACKAGES -o robot.urdf` with the file that calls the macro; with ROS, `xacro "
    "robot.urdf.xacro > robot.urdf`",
    ".xml": "Use a URDF of the same robot (.urdf), or a CSV file of the log",
    ".mcap": _BAG,
    ".db3": _BAG,
    ".npz": "Write a CSV file with the columns t, q1, q2, ... in Python, for example with NumPy",
    ".parquet": "Write a CSV file in Python, with `pandas.read_parquet(FILE).to_csv(NEW_FILE)`",
}
# Active restrictions, the innermost last; without one, all files may be read.
_allowed: list[_Allowed] = []
# Called with path and content of each file that is read.
_listeners: list[Callable[[FilePath, bytes], None]] = []
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


@dataclass(frozen=True, slots=True)
class _Allowed:
    """Folders and single files that may be read, with links resolved."""

    folders: tuple[FilePath, ...]
    files: frozenset[FilePath]

    def check(self, file: FilePath, kind: str) -> None:
        """Raise an error for a file that may not be read, before its existence is checked."""
        real = file.resolve()
        if real not in self.files and not any(real.is_relative_to(x) for x in self.folders):
            raise FileError(
                f"The {kind} {file} is outside of {self.folders[0]}, and only files inside may be "
                "read. Copy it there, or name it in the job file before the start."
            )


def listen_to_reading(
    listener: Callable[[FilePath, bytes], None],
) -> AbstractContextManager[None]:
    """Call `listener` with path and content of each file that is read in this context."""
    return registered(_listeners, listener)


def reading_below(
    folders: Iterable[FilePath], files: Iterable[FilePath] = ()
) -> AbstractContextManager[None]:
    """Let all threads read only `files`, and files below `folders`, while the context is open.

    Links that lead out of the folders are refused.
    """
    allowed = _Allowed(tuple(x.resolve() for x in folders), frozenset(x.resolve() for x in files))
    return registered(_allowed, allowed)


def refuse_ending(file: str | FilePath, noun: str) -> None:
    """Raise an error for a robot, log or file of set-points with an unsupported extension."""
    ending = FilePath(file).suffix.lower()
    if ending in ENDINGS:
        raise FileError(
            f"The {noun} {file} cannot be read, because {ending} files are not supported. "
            f"{ENDINGS[ending]}."
        )


def read_bytes(file: str | FilePath, noun: str, *, maximum: int = MAX_HAND_WRITTEN) -> bytes:
    """Read the content of a regular file.

    Raises:
        InvalidInput: The file cannot be read, is not a regular file, or has more than `maximum`
            bytes.
    """
    # Pipes and devices are refused before reading, because reading them might never end.
    path = FilePath(file)
    try:
        if _allowed:
            _allowed[-1].check(path, noun)
        with open(path, "rb", opener=open_nonblocking) as stream:
            state = os.fstat(stream.fileno())
            if not stat.S_ISREG(state.st_mode):
                raise FileError(f"The {noun} {path} is not a regular file.")
            # Some system files report the size 0, so the number of bytes is also checked.
            content = b"" if state.st_size > maximum else stream.read(maximum + 1)
            size = max(state.st_size, len(content))
    except FileNotFoundError:
        raise FileError(f"There is no {noun} {path}.") from None
    except FileError:
        raise
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileError(f"The {noun} {path} cannot be read: {reason}.") from None
    if size > maximum:
        raise FileError(
            f"The {noun} {path} has {size / MEGABYTE:.0f} MB, more than the "
            f"{maximum / MEGABYTE:.0f} MB that can be read. Split the file."
        )
    for start, kind in FOREIGN.items():
        if content.startswith(start):
            raise FileError(f"The {noun} {path} is {kind}.")
    for listener in tuple(_listeners):
        listener(path, content)
    return content


def open_nonblocking(file: str, flags: int) -> int:
    """Open a file without blocking, as `opener` of `open`."""
    # Opening a pipe without a writer would block.
    return os.open(file, flags | getattr(os, "O_NONBLOCK", 0))


def read_text(
    file: str | FilePath, noun: str, *, maximum: int = MAX_HAND_WRITTEN, latin: bool = False
) -> str:
    """Read a regular file as UTF-8 text, with or without a byte order mark."""
    content = read_bytes(file, noun, maximum=maximum)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if latin and b"\0" not in content:
            return content.decode("latin-1")
        raise FileError(
            f"The {noun} {file} cannot be read, because it is not UTF-8 text."
        ) from None


class Staging:
    """Hidden folder in a destination folder, which this process locks and creates if necessary.

    Args:
        destination: The folder, without links.
        name: Its name in messages.

    Raises:
        FileError: Another process writes to the destination, or was killed during `move`.
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
                    raise FileError(
                        f"A run was killed while it replaced the result in {name}. Move the files "
                        f"in {old} elsewhere, and remove {self.folder}."
                    )
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir()
            except (FileError, OSError):
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
        FileError: Another process has the lock.
    """
    # Windows and some network file systems have no locks on folders.
    with suppress(ImportError, OSError):
        import fcntl

        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise FileError(
                f"Another run is writing to {name}. Wait for its end, or choose another "
                "destination."
            ) from None
        return partial(os.close, handle)
    return lambda: None


def unwritable(target: object, error: OSError) -> FileError:
    """Make the error for a destination that cannot be written; it names a fix."""
    advice = FIXES.get(error.errno or 0, "choose another location")
    return FileError(f"Cannot write {target}: {error.strerror or error}; {advice}.")


def write_atomically(file: FilePath, write: Callable[[FilePath], object]) -> None:
    """Write a file completely, or not at all; raises FileError if writing fails."""
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
