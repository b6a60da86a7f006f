"""Files that other people wrote: regular files only, none larger than is asked for."""

from __future__ import annotations

import os
import stat
from pathlib import Path as FilePath

from armcontour.errors import InvalidInput

MEGABYTE = 1_000_000
# Jobs, arms, limits: text that a person writes or a small tool prints.
SMALL = 64 * MEGABYTE
# Logs and trajectories: an hour of seven joints at 1 kHz, printed with 15 digits.
LARGE = 1000 * MEGABYTE


def read_bytes(file: str | FilePath, what: str, *, most: int = SMALL) -> bytes:
    """The content of a regular file.

    A pipe or a device is refused before anything is read of it, since it may never end.

    Args:
        file: The file; a link to a regular file will do.
        what: What the file is, for messages, such as "job file".
        most: The largest size that is read [bytes].

    Raises:
        InvalidInput: There is no such file, it is no regular file, it is too large, or it cannot
            be read.
    """
    place = FilePath(file)
    try:
        # Not blocking: opening a pipe that nobody writes to would wait for ever.
        handle = os.open(place, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
    except FileNotFoundError:
        raise InvalidInput(f"There is no {what} {place}.") from None
    except (OSError, ValueError) as error:
        raise _unreadable(what, place, error) from None
    try:
        with open(handle, "rb") as stream:
            state = os.fstat(handle)
            if not stat.S_ISREG(state.st_mode):
                raise InvalidInput(f"The {what} {place} is not a regular file.")
            # Some systems tell no size of their own files, so what was read counts too.
            content = b"" if state.st_size > most else stream.read(most + 1)
            size = max(state.st_size, len(content))
    except OSError as error:
        raise _unreadable(what, place, error) from None
    if size > most:
        raise InvalidInput(
            f"The {what} {place} has {size / MEGABYTE:.0f} MB, more than the "
            f"{most / MEGABYTE:.0f} MB that are read: split it."
        )
    return content


def read_text(file: str | FilePath, what: str, *, most: int = SMALL) -> str:
    """The text of a regular file in UTF-8, with or without a byte order mark.

    Args:
        file: The file.
        what: What the file is, for messages, such as "job file".
        most: The largest size that is read [bytes].

    Raises:
        InvalidInput: As `read_bytes`; or the file is not text in UTF-8.
    """
    content = read_bytes(file, what, most=most)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInput(f"The {what} {file} cannot be read: it is not UTF-8 text.") from None


_BINARY = getattr(os, "O_BINARY", 0)


def _unreadable(what: str, place: FilePath, error: Exception) -> InvalidInput:
    reason = error.strerror if isinstance(error, OSError) else error
    return InvalidInput(f"The {what} {place} cannot be read: {reason}.")
