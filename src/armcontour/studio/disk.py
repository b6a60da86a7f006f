"""Job files on disk: read as text, written as a whole, and drafts beside them."""

from __future__ import annotations

import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path as FilePath

from armcontour._files import read_bytes
from armcontour._staging import put_in_place, unwritable
from armcontour.errors import InvalidInput

# Folder beside a job file that holds its draft.
DRAFTS = ".armcontour"
BOM = "\ufeff"


class Draft:
    """What was not saved of a job file, in a file of its own beside it.

    Args:
        file: The job file, which may not exist yet.
    """

    def __init__(self, file: FilePath) -> None:
        self._job = file.absolute()
        self._file = self._job.parent / DRAFTS / f"{file.stem}.draft{file.suffix}"

    def find(self) -> str | None:
        """The text that was never saved; None if there is none."""
        job, draft = self._job, self._file
        try:
            newer = not job.exists() or draft.stat().st_mtime_ns >= job.stat().st_mtime_ns
            if draft.is_symlink() or not self._is_ours():
                return None
            text = decoded(read_bytes(draft, "draft"), draft)
            saved = decoded(read_bytes(job, "job file"), job) if job.exists() else None
        except (InvalidInput, OSError):
            return None
        return text if newer and text != (saved or "").removeprefix(BOM) else None

    def write(self, text: str) -> bool:
        """Write a text, to be found after a crash; returns whether the folder lets it."""
        try:
            self._file.parent.mkdir(exist_ok=True)
            if not self._is_ours():
                return False
            put_in_place(self._file, lambda fresh: fresh.write_bytes(text.encode()))
        except (InvalidInput, OSError):
            return False
        return True

    def drop(self) -> None:
        """Remove the draft, and its folder if that is empty."""
        with suppress(OSError):
            if self._is_ours():
                self._file.unlink()
        with suppress(OSError):
            self._file.parent.rmdir()

    def _is_ours(self) -> bool:
        """Whether the folder of the draft is a real folder of this user, and no link.

        Raises:
            OSError: There is no such folder.
        """
        found = self._file.parent.lstat()
        user = os.getuid() if hasattr(os, "getuid") else found.st_uid
        return stat.S_ISDIR(found.st_mode) and found.st_uid == user


def decoded(content: bytes, file: FilePath | None) -> str:
    """The text of a file, with all its line breaks.

    Args:
        content: Its bytes.
        file: The file, for messages.

    Raises:
        InvalidInput: It is not UTF-8.
    """
    try:
        return content.decode()
    except UnicodeDecodeError:
        raise InvalidInput(f"{file} cannot be read: it is not UTF-8 text.") from None


def write_whole(file: FilePath, content: bytes) -> None:
    """Write a file, completely or not at all; a link stays one.

    Args:
        file: The file.
        content: Its bytes.

    Raises:
        InvalidInput: It cannot be written, or it is a link to a file that may not be read here.
    """
    if file.is_symlink():
        read_bytes(file, "job file")
    place = FilePath(os.path.realpath(file))

    def write(fresh: FilePath) -> None:
        fresh.write_bytes(content)
        if place.exists():
            shutil.copymode(place, fresh)

    try:
        put_in_place(place, write)
    except OSError as error:
        raise unwritable(file, error) from None
