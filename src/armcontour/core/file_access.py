"""Access to files of users: regular files only, up to a size limit."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import registered

MEGABYTE = 1_000_000
# Size limit of jobs, arms and limits, which are written by hand or by small tools [bytes].
SMALL = 64 * MEGABYTE
# Size limit of logs and trajectories: an hour of seven joints at 1 kHz with 15 digits [bytes].
LARGE = 1000 * MEGABYTE
_BAG = "write a CSV file with the script in docs/guides/controllers/ros2.md"
# First bytes of unsupported files (placeholders, or formats to convert), each with the end of its
# error message.
FOREIGN = {
    b"version https://git-lfs.github.com/": "a pointer of Git LFS and not the file itself: fetch "
    "it with `git lfs pull`",
    b"#ROSBAG V": f"a bag of ROS: {_BAG}",
}
# Extensions of unsupported robots, logs and set-points, each with the remedy.
ENDINGS = {
    ".xacro": "expand it: `pip install xacrodoc`, then `xacrodoc robot.urdf.xacro NAME:=VALUE -d "
    "FOLDER_OF_PACKAGES -o robot.urdf` with the file that calls the macro; with ROS, `xacro "
    "robot.urdf.xacro > robot.urdf`",
    ".xml": "use a URDF of the same robot (.urdf), or a CSV file of the log",
    ".mcap": _BAG,
    ".db3": _BAG,
    ".npz": "write a CSV file with the columns t, q1, q2, ... in Python, for example with NumPy",
    ".parquet": "write a CSV file in Python, with `pandas.read_parquet(FILE).to_csv(NEW_FILE)`",
}


@dataclass(frozen=True, slots=True)
class _Allowed:
    """Folders and single files that may be read, with links resolved."""

    folders: tuple[FilePath, ...]
    files: frozenset[FilePath]

    def check(self, file: FilePath, kind: str) -> None:
        """Raise an error for a file that may not be read, before its existence is checked."""
        real = file.resolve()
        if real not in self.files and not any(real.is_relative_to(x) for x in self.folders):
            raise InvalidInput(
                f"The {kind} {file} is not in {self.folders[0]} or below, where files may be read "
                "here. Copy it there, or name it in the job file before the start."
            )


# Active restrictions, the innermost last; without one, all files may be read.
_allowed: list[_Allowed] = []

# Called with path and content of each file that is read.
_listeners: list[Callable[[FilePath, bytes], None]] = []


def listen_to_reading(
    listener: Callable[[FilePath, bytes], None],
) -> AbstractContextManager[None]:
    """Context in which `listener` is called with path and content of each file that is read."""
    return registered(_listeners, listener)


def reading_below(
    folders: Iterable[FilePath], files: Iterable[FilePath] = ()
) -> AbstractContextManager[None]:
    """Context in which all threads may read only `files`, and files below `folders`.

    Links that lead out of the folders are refused.
    """
    allowed = _Allowed(tuple(x.resolve() for x in folders), frozenset(x.resolve() for x in files))
    return registered(_allowed, allowed)


def refuse_ending(file: str | FilePath, noun: str) -> None:
    """Raise an error for a robot, log or file of set-points with an unsupported extension."""
    ending = FilePath(file).suffix.lower()
    if ending in ENDINGS:
        raise InvalidInput(
            f"The {noun} {file} cannot be read, because {ending} files are not supported. To fix "
            f"this, {ENDINGS[ending]}."
        )


def read_bytes(file: str | FilePath, noun: str, *, maximum: int = SMALL) -> bytes:
    """Read the content of a regular file."""
    # Pipes and devices are refused before reading, because reading them might never end.
    path = FilePath(file)
    try:
        if _allowed:
            _allowed[-1].check(path, noun)
        with open(path, "rb", opener=open_nonblocking) as stream:
            state = os.fstat(stream.fileno())
            if not stat.S_ISREG(state.st_mode):
                raise InvalidInput(f"The {noun} {path} is not a regular file.")
            # Some system files report the size 0, so the number of bytes is checked, too.
            content = b"" if state.st_size > maximum else stream.read(maximum + 1)
            size = max(state.st_size, len(content))
    except FileNotFoundError:
        raise InvalidInput(f"There is no {noun} {path}.") from None
    except InvalidInput:
        raise
    except (OSError, ValueError) as error:
        raise _unreadable(noun, path, error) from None
    if size > maximum:
        raise InvalidInput(
            f"The {noun} {path} has {size / MEGABYTE:.0f} MB, more than the "
            f"{maximum / MEGABYTE:.0f} MB that can be read. Split the file."
        )
    for start, kind in FOREIGN.items():
        if content.startswith(start):
            raise InvalidInput(f"The {noun} {path} is {kind}.")
    for tell in tuple(_listeners):
        tell(path, content)
    return content


def open_nonblocking(file: str, flags: int) -> int:
    """Open a file without blocking, as `opener` of `open`."""
    # Opening a pipe without a writer would block.
    return os.open(file, flags | getattr(os, "O_NONBLOCK", 0))


def read_text(file: str | FilePath, noun: str, *, maximum: int = SMALL, latin: bool = False) -> str:
    """Read a regular file as UTF-8 text, with or without a byte order mark."""
    content = read_bytes(file, noun, maximum=maximum)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if latin and b"\0" not in content:
            return content.decode("latin-1")
        raise InvalidInput(f"The {noun} {file} cannot be read: it is not UTF-8 text.") from None


def _unreadable(noun: str, file: FilePath, error: Exception) -> InvalidInput:
    """Error for a file that cannot be read."""
    reason = error.strerror if isinstance(error, OSError) else error
    return InvalidInput(f"The {noun} {file} cannot be read: {reason}.")
