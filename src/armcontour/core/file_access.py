"""Read files of other people: regular files only, up to a size limit."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

MEGABYTE = 1_000_000
# Size limit of jobs, arms and limits, which people or small tools write [bytes].
SMALL = 64 * MEGABYTE
# Size limit of logs and trajectories: an hour of seven joints at 1 kHz with 15 digits [bytes].
LARGE = 1000 * MEGABYTE
# First bytes of files that stand for others, or that another program converts.
FOREIGN = {
    b"version https://git-lfs.github.com/": "a pointer of Git LFS and not the file itself: fetch "
    "it with `git lfs pull`",
    b"#ROSBAG V": "a bag of ROS 1: convert it with `rosbags-convert --src FILE.bag --dst FOLDER`, "
    "and give the folder",
}


@dataclass(frozen=True, slots=True)
class _Allowed:
    """Where files may be read: below folders, and some files elsewhere; all without links."""

    folders: tuple[FilePath, ...]
    files: frozenset[FilePath]

    def check(self, place: FilePath, what: str) -> None:
        """Refuse a file that is elsewhere, before anything of it is known."""
        real = place.resolve()
        if real not in self.files and not any(real.is_relative_to(x) for x in self.folders):
            raise InvalidInput(
                f"The {what} {place} is not in {self.folders[0]} or below, where files may be read "
                "here: copy it there, or name it in the job file before the start."
            )


# The innermost `reading_below` is the last; without one, files may be read everywhere.
_allowed: list[_Allowed] = []

# Who is told of the content of every file that is read.
_listeners: list[Callable[[FilePath, bytes], None]] = []


@contextmanager
def hear_reading(listener: Callable[[FilePath, bytes], None]) -> Iterator[None]:
    """Call a function with the place and the content of each file that is read meanwhile."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@contextmanager
def reading_below(folders: Iterable[FilePath], files: Iterable[FilePath] = ()) -> Iterator[None]:
    """Read files in some folders only meanwhile, in all threads; links that lead out are refused.

    Args:
        folders: The folders.
        files: Files elsewhere that may be read, too.
    """
    allowed = _Allowed(tuple(x.resolve() for x in folders), frozenset(x.resolve() for x in files))
    _allowed.append(allowed)
    try:
        yield
    finally:
        _allowed.remove(allowed)


def read_bytes(file: str | FilePath, what: str, *, maximum: int = SMALL) -> bytes:
    """Read the content of a regular file.

    A pipe or a device is refused before anything is read, because reading may never end.

    Args:
        file: The file; a link to a regular file will do.
        what: What the file is, for messages, such as "job file".
        maximum: The size limit [bytes].

    Raises:
        InvalidInput: No such file, no regular file, a file that is too large or unreadable, or one
            that may not be read here.
    """
    place = FilePath(file)
    try:
        if _allowed:
            _allowed[-1].check(place, what)
        with open(place, "rb", opener=open_at_once) as stream:
            state = os.fstat(stream.fileno())
            if not stat.S_ISREG(state.st_mode):
                raise InvalidInput(f"The {what} {place} is not a regular file.")
            # Some system files report the size 0, so the number of bytes read counts, too.
            content = b"" if state.st_size > maximum else stream.read(maximum + 1)
            size = max(state.st_size, len(content))
    except FileNotFoundError:
        raise InvalidInput(f"There is no {what} {place}.") from None
    except InvalidInput:
        raise
    except (OSError, ValueError) as error:
        raise _unreadable(what, place, error) from None
    if size > maximum:
        raise InvalidInput(
            f"The {what} {place} has {size / MEGABYTE:.0f} MB, more than the "
            f"{maximum / MEGABYTE:.0f} MB that are read: split it."
        )
    for start, kind in FOREIGN.items():
        if content.startswith(start):
            raise InvalidInput(f"The {what} {place} is {kind}.")
    tell_content(place, content)
    return content


def open_at_once(place: str, flags: int) -> int:
    """Open a file without blocking, as `opener` of `open`.

    Opening a pipe without a writer would wait for ever.

    Args:
        place: The file.
        flags: Flags of `os.open`.
    """
    return os.open(place, flags | getattr(os, "O_NONBLOCK", 0))


def tell_content(place: FilePath, content: bytes) -> None:
    """Tell who listens what a file holds, or what was made of it by another process.

    Args:
        place: The file.
        content: The content.
    """
    for tell in tuple(_listeners):
        tell(place, content)


def read_text(file: str | FilePath, what: str, *, maximum: int = SMALL, latin: bool = False) -> str:
    """Read a regular file as UTF-8 text, with or without a byte order mark.

    Args:
        file: The file.
        what: What the file is, for messages, such as "job file".
        maximum: The size limit [bytes].
        latin: Read text that is not UTF-8 as Latin-1, which logs of some controllers are.

    Raises:
        InvalidInput: As in `read_bytes`, or the file is not text of these encodings.
    """
    content = read_bytes(file, what, maximum=maximum)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if latin and b"\0" not in content:
            return content.decode("latin-1")
        raise InvalidInput(f"The {what} {file} cannot be read: it is not UTF-8 text.") from None


def _unreadable(what: str, place: FilePath, error: Exception) -> InvalidInput:
    """The error for a file that cannot be read."""
    reason = error.strerror if isinstance(error, OSError) else error
    return InvalidInput(f"The {what} {place} cannot be read: {reason}.")
