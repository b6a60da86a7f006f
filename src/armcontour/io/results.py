"""A folder of results: written whole or not at all, and never over what somebody else wrote.

A first result appears by one rename. A result that replaces an earlier one in the same folder is
complete in a hidden folder first; a journal then says what is to be moved, so that a killed
replacement is completed by the next run. The summary goes first and comes last: a folder without
`summary.json` is no whole result.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path as FilePath
from pathlib import PurePosixPath

from armcontour import _files, _staging
from armcontour._text import list_some
from armcontour._version import __version__
from armcontour.errors import InvalidInput

SUMMARY = "summary.json"
# What this program wrote: names and checksums, so that --force can prove what it removes.
MANIFEST = ".armcontour.json"
JOURNAL = "journal.json"
# Most files that a sentence names.
MOST_NAMED = 3


class ResultFolder:
    """Collects files beside their destination and puts them in place at the end.

    Use it as a context manager; what is written is put in place only if no error occurs.

    Args:
        folder: The destination.
        force: Whether an earlier result there may be replaced. Files of an earlier result are
            removed only if they are as this program wrote them; other files stay.

    Attributes:
        folder: The destination.
        files: Names of the files written so far, relative to the folder.

    Raises:
        InvalidInput: The folder holds something else, another run is writing to it, or it cannot
            be written.
    """

    def __init__(self, folder: FilePath, *, force: bool = False) -> None:
        self.folder = folder
        self.files: list[str] = []
        self._force = force
        try:
            self._target = _resolve(folder)
            self._replaces = _is_in_use(self._target)
            self._staging = self._stage()
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            _finish(self._target, self._staging)
            self._staging.empty()
            self._new.mkdir()
            self.scratch.mkdir()
            self._refuse_occupied()
        except BaseException as error:
            self._close()
            if isinstance(error, OSError):
                raise self._unwritable(error) from None
            raise

    @property
    def scratch(self) -> FilePath:
        """A folder for what is needed meanwhile; it is removed in every case."""
        return self._staging.place / "scratch"

    @property
    def _new(self) -> FilePath:
        return self._staging.place / "new"

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
        file = self._new / name
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write(file)
        except OSError as error:
            raise InvalidInput(f"Cannot write {self.folder / name}: {error.strerror}.") from None
        inside = sorted(x for x in file.rglob("*") if x.is_file()) if file.is_dir() else [file]
        self.files += [x.relative_to(self._new).as_posix() for x in inside]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._put_in_place()
        except OSError as error:
            raise self._unwritable(error) from None
        finally:
            self._close()

    def _close(self) -> None:
        """Remove the staging folder, unless the next run has to complete a move from it."""
        if (self._staging.place / JOURNAL).exists():
            self._staging.release()
        else:
            self._staging.remove()

    def _stage(self) -> _staging.Staging:
        """The staging folder: in the destination if that stays, else beside the destination."""
        outer = _staging.beside(self._target)
        if self._replaces:
            if outer.is_dir() and not outer.is_symlink():
                # A killed run began before the folder was there.
                _staging.Staging(outer, self.folder).remove()
            return _staging.Staging(_staging.inside(self._target), self.folder)
        return _staging.Staging(outer, self.folder, parents=True)

    def _refuse_occupied(self) -> None:
        """Refuse a destination with anything in it that must not be replaced."""
        present = _files_in(self._target)
        if not present:
            return
        if not self._force:
            raise InvalidInput(
                f"The folder {self.folder} is not empty: choose another --out, or replace an "
                "earlier result with --force."
            )
        written = _manifest(self._target)
        if written is None:
            raise InvalidInput(
                f"The folder {self.folder} is not empty and holds no result of armcontour, so "
                "--force removes nothing there: choose another --out."
            )
        changed = [x for x in written if x in present and not self._is_unchanged(x, written)]
        if changed:
            raise InvalidInput(
                f"In the folder {self.folder}, {list_some(changed, MOST_NAMED)} changed since "
                "armcontour wrote them: move them elsewhere, or choose another --out."
            )

    def _is_unchanged(self, name: str, written: Mapping[str, str]) -> bool:
        return _checksum(self._target / name) == written[name]

    def _put_in_place(self) -> None:
        checksums = {x: _checksum(self._new / x) for x in self.files}
        text = json.dumps({"armcontour": __version__, "files": checksums}, indent=1)
        (self._new / MANIFEST).write_text(text + "\n", encoding="utf-8")
        if not self._replaces:
            self._appear()
            return
        self._refuse_occupied()
        written = _manifest(self._target) or {}
        self._refuse_in_the_way(written)
        stale = {x: written[x] for x in sorted(set(written) - set(self.files))}
        journal = {"stale": stale, "new": [*self.files, MANIFEST]}
        partial = self._staging.place / f"{JOURNAL}.part"
        partial.write_text(json.dumps(journal), encoding="utf-8")
        with _staging.moving():
            os.replace(partial, self._staging.place / JOURNAL)
            _finish(self._target, self._staging)

    def _appear(self) -> None:
        """A first result: one rename, which fails if anything has come there meanwhile."""
        with _staging.moving():
            try:
                if os.name == "nt" and self._target.is_dir():
                    self._target.rmdir()
                os.rename(self._new, self._target)
            except OSError:
                if _files_in(self._target):
                    raise InvalidInput(
                        f"The folder {self.folder} is not empty any more: choose another --out."
                    ) from None
                raise

    def _refuse_in_the_way(self, written: Mapping[str, str]) -> None:
        """Refuse to write over what is not of an earlier result, or through links."""
        for name in self.files:
            target = self._target / name
            for above in _steps_to(self._target, name):
                if above.is_symlink() or (above.exists() and not above.is_dir()):
                    raise InvalidInput(
                        f"Cannot write {self.folder / name}: {above.name} is not a folder of "
                        "this result."
                    )
            if target.is_dir():
                raise InvalidInput(
                    f"Cannot write {self.folder / name}: a folder of that name is in the way."
                )
            if os.path.lexists(target) and name not in written:
                raise InvalidInput(
                    f"Cannot write {self.folder / name}: armcontour did not write the file of "
                    "that name. Move it elsewhere, or choose another --out."
                )

    def _unwritable(self, error: OSError) -> InvalidInput:
        return InvalidInput(f"Cannot write to the folder {self.folder}: {error.strerror or error}.")


def _resolve(folder: FilePath) -> FilePath:
    """The real place of a destination.

    Raises:
        InvalidInput: It is a file, below a file, or a link that leads nowhere.
    """
    if folder.is_symlink() and not folder.exists():
        raise InvalidInput(f"{folder} is a link that leads nowhere: choose another --out.")
    if folder.exists() and not folder.is_dir():
        raise InvalidInput(f"{folder} is a file, not a folder: choose another --out.")
    for above in folder.parents:
        if above.exists() and not above.is_dir():
            raise InvalidInput(
                f"Cannot write to the folder {folder}, because {above} is a file: choose "
                "another --out."
            )
    return folder.resolve()


def _is_in_use(target: FilePath) -> bool:
    """Whether a folder must stay the same folder: it is not empty, or somebody stands in it."""
    if not target.is_dir():
        return False
    here = os.path.samefile(target, os.curdir) if os.path.exists(os.curdir) else False
    free = os.access(target.parent, os.W_OK) and not target.is_mount()
    return here or not free or any(target.iterdir())


def _files_in(folder: FilePath) -> set[str]:
    """Names of all files below a folder, links included, staging folders left out."""
    found = set()
    for place, folders, files in os.walk(folder):
        at = FilePath(place)
        folders[:] = [x for x in folders if at / x != _staging.inside(folder)]
        links = [x for x in folders if (at / x).is_symlink()]
        found |= {(at / x).relative_to(folder).as_posix() for x in (*files, *links)}
        # A folder that somebody made, and left empty, is something too.
        found |= {(at / x).relative_to(folder).as_posix() for x in folders if x not in links}
    return found


def _manifest(folder: FilePath) -> dict[str, str] | None:
    """Names and checksums of the result in a folder; None if it has none that can be trusted."""
    try:
        data = json.loads(_files.read_text(folder / MANIFEST, "list of files"))
        listed = data["files"] if "armcontour" in data else None
    except (InvalidInput, ValueError, KeyError, TypeError, RecursionError):
        return None
    return listed if _names_files(listed) else None


def _names_files(listed: object) -> bool:
    """Whether something maps names inside a folder to checksums."""
    return isinstance(listed, dict) and all(
        isinstance(name, str)
        and isinstance(checksum, str)
        and not PurePosixPath(name).is_absolute()
        and ".." not in PurePosixPath(name).parts
        and not {"\\", ":", "\0"} & set(name)
        for name, checksum in listed.items()
    )


def _checksum(file: FilePath) -> str:
    """The SHA-256 of a regular file; of anything else, and of a file that a link leads to, none."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        handle = os.open(file, flags | getattr(os, "O_BINARY", 0))
    except OSError:
        return ""
    with open(handle, "rb") as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return ""
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _steps_to(folder: FilePath, name: str) -> list[FilePath]:
    """The folders between a folder and a file below it, the upper ones first."""
    return [folder / x for x in list(PurePosixPath(name).parents)[-2::-1]]


def _is_below(folder: FilePath, name: str) -> bool:
    """Whether a name leads to a place below a folder without any link."""
    return not any(x.is_symlink() for x in _steps_to(folder, name))


def _finish(target: FilePath, staging: _staging.Staging) -> None:
    """Complete the replacement that a journal describes, be it begun or not; else do nothing."""
    new = staging.place / "new"
    if new.is_symlink():
        return
    try:
        journal = json.loads((staging.place / JOURNAL).read_text(encoding="utf-8"))
        stale, fresh = journal["stale"], journal["new"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if not _names_files(stale) or not _names_files(dict.fromkeys(fresh, "")):
        return
    if (new / SUMMARY).exists():
        (target / SUMMARY).unlink(missing_ok=True)
    for name, checksum in stale.items():
        if _is_below(target, name) and _checksum(target / name) == checksum:
            (target / name).unlink()
    # The summary says that the result is whole, so it comes last.
    for name in sorted(fresh, key=lambda x: x == SUMMARY):
        if (new / name).is_file() and _is_below(new, name) and _is_below(target, name):
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(new / name, target / name)
    _remove_empty(target, stale)
    (staging.place / JOURNAL).unlink()


def _remove_empty(target: FilePath, names: Iterable[str]) -> None:
    """Remove the folders of removed files that are empty now."""
    for name in names:
        for above in reversed(_steps_to(target, name)):
            with suppress(OSError):
                above.rmdir()
