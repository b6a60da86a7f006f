"""A folder of results: written whole or not at all, never over an earlier one unasked."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path as FilePath

from armcontour.errors import InvalidInput

SUMMARY = "summary.json"


class ResultFolder:
    """Collects files beside their destination and puts them in place at the end.

    Use it as a context manager; what is written is put in place only if no error occurs.

    Args:
        folder: The destination.
        force: Whether an earlier result there may be replaced.

    Raises:
        InvalidInput: The folder holds something already, or cannot be written.
    """

    def __init__(self, folder: FilePath, *, force: bool = False) -> None:
        self.folder = folder
        self.files: list[str] = []
        try:
            if folder.exists() and not folder.is_dir():
                raise InvalidInput(f"{folder} is a file, not a folder: choose another --out.")
            if folder.is_dir() and any(folder.iterdir()) and not force:
                raise InvalidInput(
                    f"The folder {folder} is not empty: choose another --out, or replace an "
                    "earlier result with --force."
                )
            for above in folder.parents:
                if above.exists() and not above.is_dir():
                    raise InvalidInput(
                        f"Cannot write to the folder {folder}, because {above} is a file: choose "
                        "another --out."
                    )
            parent = folder if folder.is_dir() else folder.parent
            parent.mkdir(parents=True, exist_ok=True)
            if not os.access(parent, os.W_OK):
                raise PermissionError(13, os.strerror(13))
            self._temporary = FilePath(tempfile.mkdtemp(prefix=".armcontour-", dir=parent))
        except OSError as error:
            raise InvalidInput(f"Cannot write to the folder {folder}: {error.strerror}.") from None

    def __enter__(self) -> ResultFolder:
        return self

    def write(self, name: str, text: str) -> None:
        """Write one file, by its name relative to the folder."""
        self.place(name, lambda file: file.write_text(text, encoding="utf-8"))

    def place(self, name: str, write: Callable[[FilePath], object]) -> None:
        """Have one file written, or a folder of files.

        Args:
            name: Relative to the folder.
            write: Called with where to write it.
        """
        file = self._temporary / name
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write(file)
        except OSError as error:
            raise InvalidInput(f"Cannot write {self.folder / name}: {error.strerror}.") from None
        inside = sorted(x for x in file.rglob("*") if x.is_file()) if file.is_dir() else [file]
        self.files += [x.relative_to(self._temporary).as_posix() for x in inside]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._put_in_place()
        except OSError as error:
            raise InvalidInput(
                f"Cannot write to the folder {self.folder}: {error.strerror}."
            ) from None
        finally:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def _put_in_place(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        for name in self.files:
            if (self.folder / name).is_dir():
                raise InvalidInput(
                    f"Cannot write {self.folder / name}: a folder of that name is in the way."
                )
        stale = set(_files_of(self.folder / SUMMARY)) - set(self.files)
        # The summary names the others, so it comes last.
        for name in sorted(self.files, key=lambda x: x == SUMMARY):
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(self._temporary / name, target)
        for name in stale:
            (self.folder / name).unlink(missing_ok=True)


def _files_of(summary: FilePath) -> list[str]:
    """The files of an earlier result, from its summary."""
    try:
        listed = json.loads(summary.read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    inside = [x for x in listed if isinstance(x, str)]
    return [x for x in inside if not FilePath(x).is_absolute() and ".." not in FilePath(x).parts]
