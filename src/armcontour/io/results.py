"""Result folders: written completely or not at all; files of others are never overwritten.

The first result in a folder appears by one rename. A result that replaces an earlier one is written
to a hidden folder first. Then a journal lists the files to move, so that the next run completes a
replacement that was killed. The old summary is removed first and the new one is moved last: a
folder without `summary.json` has no complete result.
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
from typing import Any, TypeAlias

from armcontour import _files, _staging
from armcontour._text import list_some
from armcontour._version import __version__
from armcontour.errors import InvalidInput

SUMMARY = "summary.json"
# Names and checksums of the written files: --force removes only files with these checksums.
MANIFEST = ".armcontour.json"
JOURNAL = "journal.json"
# Largest number of files in a message.
MOST_NAMED = 3
# Number, size and times of a file.
_State: TypeAlias = tuple[int, int, int, int]


class ResultFolder:
    """A result folder: collects files in a hidden folder and moves them in place at the end.

    Use it as a context manager; the files are moved only if no error occurs.

    Args:
        folder: The destination.
        force: Whether an earlier result may be replaced. Files of an earlier result are removed
            only if they did not change since this program wrote them; other files stay.
        replaces: Name of a kind of result, such as "demo". An earlier result of the same kind may
            be replaced without `force`.

    Attributes:
        folder: The destination.
        files: Names of the files written so far, relative to the folder.

    Raises:
        InvalidInput: The folder holds other files, another run is writing to the folder, or the
            folder cannot be written.
    """

    def __init__(self, folder: FilePath, *, force: bool = False, replaces: str = "") -> None:
        self.folder = folder
        self.files: list[str] = []
        self._force, self._kind = force, replaces
        # Files of an earlier result that were found unchanged, and their state then.
        self._seen: dict[str, _State | None] = {}
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
        """A folder for temporary files, removed at the end also after an error."""
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
        """Let a function write one file, or a folder of files.

        Args:
            name: Name of the file or folder, relative to the result folder.
            write: Called with the path of the file or folder to write.
        """
        file = self._new / name
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write(file)
        except OSError as error:
            raise _staging.unwritable(self.folder / name, error) from None
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
        """Remove the staging folder, unless it has a journal, which the next run completes."""
        if (self._staging.place / JOURNAL).exists():
            self._staging.release()
        else:
            self._staging.remove()

    def _stage(self) -> _staging.Staging:
        """The staging folder: inside a destination in use, else next to the destination."""
        outer = _staging.beside(self._target)
        if self._replaces:
            if outer.is_dir() and not outer.is_symlink():
                # Left by a killed run that started before the folder existed.
                _staging.Staging(outer, self.folder).remove()
            return _staging.Staging(_staging.inside(self._target), self.folder)
        return _staging.Staging(outer, self.folder, parents=True)

    def _refuse_occupied(self) -> None:
        """Refuse a destination with files that must not be replaced."""
        present = _files_in(self._target)
        if not present:
            return
        if not self._force and not (
            self._kind and _manifest_data(self._target).get("kind") == self._kind
        ):
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
        """Whether a file is as it was written; read again only if it was touched since."""
        file = self._target / name
        state = _state(file)
        if state is None or self._seen.get(name) != state:
            if _checksum(file) != written[name]:
                return False
            self._seen[name] = state
        return True

    def _put_in_place(self) -> None:
        """Write the manifest and move all files to the destination."""
        checksums = {x: _checksum(self._new / x) for x in self.files}
        data = {"armcontour": __version__, "kind": self._kind, "files": checksums}
        text = json.dumps(data, indent=1)
        (self._new / MANIFEST).write_text(text + "\n", encoding="utf-8")
        if not self._replaces:
            self._appear()
            return
        self._refuse_occupied()
        written = _manifest(self._target) or {}
        self._refuse_conflicts(written)
        stale = sorted(set(written) - set(self.files))
        journal = {"stale": stale, "new": [*self.files, MANIFEST]}
        partial = self._staging.place / f"{JOURNAL}.part"
        partial.write_text(json.dumps(journal), encoding="utf-8")
        with _staging.moving():
            os.replace(partial, self._staging.place / JOURNAL)
            _finish(self._target, self._staging)

    def _appear(self) -> None:
        """Rename the folder of a first result; fails if files have appeared at the destination."""
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

    def _refuse_conflicts(self, written: Mapping[str, str]) -> None:
        """Refuse to overwrite files of others, and to write through links."""
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
        return _staging.unwritable(f"to the folder {self.folder}", error)


def _resolve(folder: FilePath) -> FilePath:
    """The absolute path of a destination, without links.

    Raises:
        InvalidInput: The destination is a file, is below a file, or is a broken link.
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
    """Whether a folder must not be replaced by a rename.

    True if the folder is not empty, is the current folder or a mount, or has a read-only parent.
    """
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
        # Empty folders count as content, too.
        found |= {(at / x).relative_to(folder).as_posix() for x in folders if x not in links}
    return found


def _manifest_data(folder: FilePath) -> dict[str, Any]:
    """Content of the manifest in a folder; empty without one of this program."""
    try:
        data = json.loads(_files.read_text(folder / MANIFEST, "list of files"))
    except (InvalidInput, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) and "armcontour" in data else {}


def _manifest(folder: FilePath) -> dict[str, str] | None:
    """Names and checksums of the result in a folder; None without a valid manifest."""
    listed = _manifest_data(folder).get("files")
    return listed if _names_files(listed) else None


def verify_file(folder: FilePath, name: str) -> FilePath:
    """The path of a file of a result, if armcontour wrote the file and it did not change.

    Args:
        folder: The result folder.
        name: Name of the file relative to the folder.

    Raises:
        InvalidInput: The folder has no result, the result has no such file, or the file changed.
    """
    written = _manifest(folder)
    if written is None or SUMMARY not in written:
        raise InvalidInput(
            f"{folder} holds no result: name the folder that --out of run, certify or learn made."
        )
    if name not in written:
        raise InvalidInput(
            f"The result in {folder} has no {name}: a run with --no-simulation and --export "
            "writes only the exports, and learning on a simulated robot no set-points."
        )
    if _checksum(folder / name) != written[name]:
        raise InvalidInput(
            f"{folder / name} changed since armcontour wrote it, or is gone: run the job again."
        )
    return folder / name


def _names_files(listed: object) -> bool:
    """Whether an object is a mapping from names inside a folder to checksums."""
    return isinstance(listed, dict) and all(
        isinstance(name, str)
        and isinstance(checksum, str)
        and not PurePosixPath(name).is_absolute()
        and ".." not in PurePosixPath(name).parts
        and not {"\\", ":", "\0"} & set(name)
        for name, checksum in listed.items()
    )


def _checksum(file: FilePath) -> str:
    """The SHA-256 of a regular file; empty for links and for anything else."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        handle = os.open(file, flags | getattr(os, "O_BINARY", 0))
    except OSError:
        return ""
    with open(handle, "rb") as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return ""
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _state(file: FilePath) -> _State | None:
    """What the system says of a file that changes with the file; None if it says nothing."""
    try:
        found = file.lstat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _steps_to(folder: FilePath, name: str) -> list[FilePath]:
    """The folders between a folder and a file below it, from the top down."""
    return [folder / x for x in list(PurePosixPath(name).parents)[-2::-1]]


def _is_below(folder: FilePath, name: str) -> bool:
    """Whether no folder between a folder and a file below it is a link."""
    return not any(x.is_symlink() for x in _steps_to(folder, name))


def _finish(target: FilePath, staging: _staging.Staging) -> None:
    """Complete the replacement that a journal describes; without a journal do nothing.

    A journal may be forged, so a file is replaced or removed only if the result's manifest lists it
    unchanged. If another file is in the way, the journal is ignored.
    """
    new = staging.place / "new"
    if new.is_symlink():
        return
    try:
        journal = json.loads((staging.place / JOURNAL).read_text(encoding="utf-8"))
        stale, fresh = journal["stale"], journal["new"]
        valid = _names_files(dict.fromkeys([*stale, *fresh], ""))
    except (OSError, ValueError, KeyError, TypeError):
        return
    written = _manifest(target)

    def is_ours(name: str) -> bool:
        checksum = _checksum(target / name)
        listed = bool(checksum) if name == MANIFEST else checksum == (written or {}).get(name)
        return _is_below(target, name) and (listed or not os.path.lexists(target / name))

    waiting = [x for x in fresh if (new / x).is_file() and _is_below(new, x)] if valid else []
    if not valid or not all(map(is_ours, waiting)):
        return
    for name in [*stale, SUMMARY] if SUMMARY in waiting else stale:
        if (target / name).exists() and is_ours(name):
            (target / name).unlink()
    # The summary marks a complete result, so it is moved last.
    for name in sorted(waiting, key=lambda x: x == SUMMARY):
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
