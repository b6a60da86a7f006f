"""Result folders, which are written completely or not at all; other files do not change.

A result is first written to a hidden folder in its destination, which is locked. Then an earlier
result is moved aside, the new result is moved to its place, and the earlier result is deleted. The
summary of the earlier result is moved first and the new summary last, so that a folder without
`summary.json` has no complete result.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Callable
from itertools import chain
from pathlib import Path as FilePath
from typing import Any

from armcontour._version import __version__
from armcontour.core import file_access, render
from armcontour.core.errors import FileError
from armcontour.core.text import list_some

SUMMARY = "summary.json"
# File with the names and checksums of the written files. --force removes only files with these
# checksums.
MANIFEST = ".armcontour.json"
# Maximum number of files that a message lists.
MAX_NAMED = 3


def to_json(data: Any) -> str:
    """Return the data as indented JSON text."""
    return json.dumps(render.jsonable(data), indent=2, allow_nan=False) + "\n"


class ResultFolder:
    """Writer of a result folder, which collects files in a hidden folder and moves them at the end.

    Use it as a context manager; the files, if any, are moved only if no error occurs.

    Args:
        folder: The destination.
        force: Whether an earlier result may be replaced, if its files have not changed since this
            program wrote them. Other files and folders do not change.
        replaces: Name of a kind of result, such as "demo". An earlier result of the same kind may
            be replaced without `force`.

    Attributes:
        folder: The destination.
        files: Names of the files written so far, relative to the folder.

    Raises:
        FileError: The folder has other files, another run is writing to the folder, or the
            folder cannot be written.
    """

    def __init__(self, folder: FilePath, *, force: bool = False, replaces: str = "") -> None:
        self.folder = folder
        self.files: list[str] = []
        self._force = force
        self._kind = replaces
        # File of a record that other processes write, and its size at the begin [bytes].
        self._record: FilePath | None = None
        self._empty_size = 0
        if os.path.lexists(folder) and not folder.is_dir():
            raise FileError(f"{folder} is not a folder. Choose another --out.")
        try:
            self._target = folder.resolve()
            self._staging = file_access.Staging(self._target, folder)
            self._new = self._staging.folder / "new"
            try:
                self._new.mkdir()
                self._find_earlier()
            except BaseException:
                self._staging.remove()
                raise
        except OSError as error:
            raise self._unwritable(error) from None

    def __enter__(self) -> ResultFolder:
        return self

    def write(self, name: str, text: str) -> None:
        """Write a text file with a name relative to the result folder."""
        self.write_with(name, lambda file: file.write_text(text, encoding="utf-8"))

    def write_with(self, name: str, write: Callable[[FilePath], object]) -> None:
        """Create a file or a folder by calling a function with its path.

        Args:
            name: Name of the file or folder, relative to the result folder.
            write: Called with the path of the file or folder to write.
        """
        file = self._new / name
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write(file)
        except OSError as error:
            raise file_access.unwritable(self.folder / name, error) from None
        inside = sorted(x for x in file.rglob("*") if x.is_file()) if file.is_dir() else [file]
        self.files += [x.relative_to(self._new).as_posix() for x in inside]

    def begin_record(self, name: str, text: str) -> FilePath:
        """Create a file in the folder itself, to which other processes append a record.

        It is removed if the command ends without an error. If the command fails or its process is
        killed, the record remains, and no result replaces it.

        Args:
            name: Name of the file.
            text: The beginning of the file. If nothing is appended, the file is removed.

        Returns:
            The path of the file.

        Raises:
            FileError: The folder has a record that an earlier command left, or cannot be
                written.
        """
        file = self._target / name
        try:
            with open(file, "x", encoding="utf-8") as stream:
                stream.write(text)
        except FileExistsError:
            raise FileError(
                f"{self.folder / name} has the record of a motion whose command did not end. Move "
                "it elsewhere, or choose another --out."
            ) from None
        except OSError as error:
            file.unlink(missing_ok=True)
            raise file_access.unwritable(self.folder / name, error) from None
        self._record = file
        self._empty_size = file.stat().st_size
        return file

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Move the files to the folder, unless the command has failed; then nothing is written."""
        is_complete = False
        try:
            if kind is None and self.files:
                self._move_to_destination()
            is_complete = kind is None
        except OSError as error:
            raise self._unwritable(error) from None
        finally:
            self._end_record(is_complete)
            self._staging.remove()

    def _end_record(self, complete: bool) -> None:
        """Remove the record if the command has ended without an error, or if it is empty."""
        if self._record is None or not self._record.exists():
            return
        if complete or self._record.stat().st_size <= self._empty_size:
            self._record.unlink()

    def _find_earlier(self) -> list[str]:
        """Return the names of the files and folders of an earlier result, which may be replaced."""
        present = _names_in(self._target) - {file_access.NEXT}
        if self._record is not None:
            present.discard(self._record.name)
        if not present:
            return []
        manifest = _manifest(self._target)
        if not self._force and not (self._kind and manifest.get("kind") == self._kind):
            raise FileError(
                f"The folder {self.folder} is not empty. Choose another --out, or replace an "
                "earlier result with --force."
            )
        if not manifest:
            raise FileError(
                f"The folder {self.folder} has files, but no result of armcontour, so that --force "
                "cannot replace them. Choose another --out."
            )
        written = manifest["files"]
        names = present & {MANIFEST, *(x.split("/")[0] for x in written)}
        below = chain.from_iterable(_files_below(self._target, x) for x in names)
        files = [x for x in below if x != MANIFEST]
        changed = [x for x in files if not _is_unchanged(self._target / x, written.get(x))]
        if changed:
            raise FileError(
                f"The folder {self.folder} has files that armcontour did not write or that have "
                f"changed since: {list_some(sorted(changed), MAX_NAMED)}. Move them elsewhere, or "
                "choose another --out."
            )
        # The summary is moved away first, because it marks a complete result.
        return sorted(names, key=lambda x: x != SUMMARY)

    def _move_to_destination(self) -> None:
        """Write the manifest and move all files to the destination."""
        checksums = {x: _checksum(self._new / x) for x in self.files}
        data = {"armcontour": __version__, "kind": self._kind, "files": checksums}
        text = json.dumps(data, indent=1)
        (self._new / MANIFEST).write_text(text + "\n", encoding="utf-8")
        earlier = self._find_earlier()
        old = self._staging.folder / file_access.OLD
        old.mkdir()
        fresh = sorted(_names_in(self._new), key=lambda x: x == SUMMARY)
        foreign = [x for x in fresh if os.path.lexists(self._target / x) and x not in earlier]
        if foreign:
            raise FileError(
                f"Cannot write {self.folder / foreign[0]}, because armcontour did not write the "
                "existing file or folder of this name. Move it elsewhere, or choose another --out."
            )
        aside = [(self._target / x, old / x) for x in earlier]
        self._staging.move([*aside, *((self._new / x, self._target / x) for x in fresh)])

    def _unwritable(self, error: OSError) -> FileError:
        return file_access.unwritable(f"to the folder {self.folder}", error)


def _names_in(folder: FilePath) -> set[str]:
    """Return the names of the files and folders in a folder; empty if the folder does not exist."""
    return {x.name for x in folder.iterdir()} if folder.is_dir() else set()


def _files_below(folder: FilePath, name: str) -> list[str]:
    """Names, relative to `folder`, of the file `name` or of all files in the folder `name`."""
    # Symbolic links count as files.
    location = folder / name
    if location.is_symlink() or not location.is_dir():
        return [name]
    files = list[str]()
    for inner in sorted(_names_in(location)):
        files += _files_below(folder, f"{name}/{inner}")
    return files


def _manifest(folder: FilePath) -> dict[str, Any]:
    """Data of the manifest in a folder; empty if it has no valid manifest of this program."""
    try:
        data = json.loads(file_access.read_text(folder / MANIFEST, "list of files"))
    except (FileError, ValueError, RecursionError):
        return {}
    valid = isinstance(data, dict) and "armcontour" in data and isinstance(data.get("files"), dict)
    return data if valid else {}


def kind_of(folder: FilePath) -> str:
    """Kind of the result in a folder, such as "demo"; empty if it has no result with a kind."""
    return str(_manifest(folder).get("kind", ""))


def verify_file(folder: FilePath, name: str) -> FilePath:
    """Check and return a result's file; FileError if armcontour did not write it or it changed."""
    written = _manifest(folder).get("files", {})
    if SUMMARY not in written:
        raise FileError(
            f"{folder} has no result. Specify a folder that run, certify, learn or play wrote "
            "(--out)."
        )
    if name not in written:
        raise FileError(
            f"The result in {folder} has no {name}. A run with --no-simulation and --export writes "
            "only the exports."
        )
    if not _is_unchanged(folder / name, written[name]):
        raise FileError(
            f"{folder / name} has changed since armcontour wrote it, or does not exist. Run the "
            "job again."
        )
    return folder / name


def _is_unchanged(file: FilePath, checksum: object) -> bool:
    """Return whether a file is a regular file with the given checksum."""
    return bool(checksum) and _checksum(file) == checksum


def _checksum(file: FilePath) -> str:
    """SHA-256 of a regular file in hexadecimal; empty for links, folders and unreadable files."""
    no_link = getattr(os, "O_NOFOLLOW", 0)
    try:
        stream = open(
            file, "rb", opener=lambda x, flags: file_access.open_nonblocking(x, flags | no_link)
        )
    except OSError:
        return ""
    with stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return ""
        return hashlib.file_digest(stream, "sha256").hexdigest()
