"""Class `Document`: the text of a job file with its undo history."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from armcontour.core import checks
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.file_access import read_bytes, write_atomically
from armcontour.files.job_file import drawing_text, read_job_mapping
from armcontour.files.job_patch import Patch, write_patch
from armcontour.files.job_text_edits import write_data
from armcontour.studio.recent import Recent, drop_recent, find_draft, find_run

BOM = "\ufeff"
# States of the file on disk, see `Document.on_disk`.
SAME = "same"
CHANGED = "changed"
MISSING = "missing"
NONE = "none"
# Maximum number of characters in the undo history; the last text always stays.
MAX_HISTORY = 50_000_000
# Maximum number of steps and of characters of the undo history that are stored with a draft, which
# is written at every change.
MAX_STORED_STEPS = 60
MAX_STORED = 500_000


class HistoryEntry(NamedTuple):
    """Text and data before (undo) or after (redo) a change, and the label of the change.

    Args:
        label: Label of the change.
        text: Text before or after the change.
        data: Data before or after the change.
    """

    label: str
    text: str
    data: dict[str, Any]


class Steps(NamedTuple):
    """The undo history as a list.

    Args:
        labels: Labels of the changes, in the order in which they were made.
        made: Number of changes that are made; the others were undone.
    """

    labels: tuple[str, ...]
    made: int


class Document:
    """Text of a job file with its undo history; undoing all changes restores the original bytes.

    Args:
        text: The text.
        source: Name of the document in messages; by default the file name.
        folder: Folder to which file names in the job are relative; by default that of the file.
        file: File to which changes are saved; None without one.
        saved: Content of the file; None if it does not exist yet.
        origin: Job file, or drawing and cell, that opens the document again; None for an upload.
        is_start: True if the Studio shows the document because it was started without a file.

    Attributes:
        chosen_run: Run that the user chose to show, also in an earlier session; empty without one.
    """

    def __init__(
        self,
        text: str,
        *,
        source: str = "",
        folder: FilePath | None = None,
        file: FilePath | None = None,
        saved: bytes | None = None,
        origin: tuple[FilePath, str | None] | None = None,
        is_start: bool = False,
    ) -> None:
        self.file = file
        # Name and folder of a document without a file are given.
        self.source = source if file is None else file.name
        self.folder = folder or (FilePath() if file is None else file.parent)
        # Job file, or drawing and cell, that opens the document again.
        self._origin = origin
        # Whether the Studio shows the document because it was started without a file.
        self.is_start = is_start
        self.id = secrets.token_hex(8)
        self._has_bom = text.startswith(BOM)
        self._saved = saved
        self.text = self._opened = text.removeprefix(BOM)
        # The job of a drawing has a file that does not exist yet, so all of its text is unsaved.
        self.saved_text = self.text if saved is not None or file is None else ""
        self._data = read_job_mapping(self.text, self.source)
        self._past: list[HistoryEntry] = []
        self._future: list[HistoryEntry] = []
        self.earlier_draft = None if origin is None else find_draft(*origin, self.text)
        self.chosen_run = "" if origin is None else find_run(*origin)
        self.write_draft()

    @classmethod
    def open(cls, file: str | FilePath) -> Document:
        """Open a job file; changes are saved to it."""
        path = FilePath(file).absolute()
        content = read_bytes(path, "job file")
        return cls(decode(content, path), file=path, saved=content, origin=(path, None))

    @classmethod
    def of_drawing(cls, file: str | FilePath, cell: str, patch: Patch | None = None) -> Document:
        """Create the job of a drawing in a cell (name or job file), next to the drawing.

        - `patch`: changes of the job.
        """
        drawing = FilePath(file).absolute()
        if not drawing.is_file():
            raise FileError(f"The drawing {drawing} does not exist.")
        file_next = drawing.with_suffix(".yaml")
        text = drawing_text(cell, drawing, file_next.parent)
        text = write_patch(text, patch or {}, file_next.name)
        origin = drawing, str(FilePath(cell).absolute()) if FilePath(cell).suffix else cell
        return cls(text, file=file_next, origin=origin)

    @property
    def data(self) -> Mapping[str, Any]:
        """Keys and values of the text, as written."""
        return self._data

    @property
    def dirty(self) -> bool:
        """True if the text differs from the text that was read or saved."""
        return self.text != self.saved_text

    @property
    def undo_label(self) -> str | None:
        """Label of the change that `undo` reverts; None if there is no such change."""
        return self._past[-1].label if self._past else None

    @property
    def redo_label(self) -> str | None:
        """Label of the change that `redo` repeats; None if there is no such change."""
        return self._future[-1].label if self._future else None

    @property
    def steps(self) -> Steps:
        """Labels of all changes that can be undone or redone, and how many of them are made."""
        labels = [x.label for x in self._past] + [x.label for x in reversed(self._future)]
        return Steps(labels=tuple(labels), made=len(self._past))

    def apply(self, data: dict[str, Any], label: str) -> None:
        """Change the data, and the text where it differs, as one step of undo."""
        self._set_text(write_data(self.text, data, self.source), data, label)

    def replace(self, text: str, label: str) -> None:
        """Replace the text as one step of undo; keeps Windows line breaks of the old text."""
        text = text.removeprefix(BOM)
        # Browsers convert all line breaks to line feeds.
        if "\r\n" in self.text and "\r" not in text:
            text = text.replace("\n", "\r\n")
        self._set_text(text, read_job_mapping(text, self.source), label)

    def undo(self) -> None:
        """Revert the last change."""
        self._move_history(self._past, self._future, "undo")

    def redo(self) -> None:
        """Repeat the change that was undone last."""
        self._move_history(self._future, self._past, "redo")

    def go_to_step(self, made: int) -> None:
        """Undo or redo changes until the first `made` ones of `steps` are made."""
        count = len(self._past) + len(self._future)
        made = checks.check_int("The number of steps", made, 0, count)
        while len(self._past) > made:
            self.undo()
        while len(self._past) < made:
            self.redo()

    def on_disk(self) -> str:
        """Compare the file with the last read or saved state: SAME, CHANGED, MISSING or NONE."""
        if self.file is None:
            return NONE
        if not self.file.exists():
            return MISSING
        return SAME if self._read_file() == self._saved else CHANGED

    def save(self, *, force: bool = False) -> None:
        """Write the file atomically, and drop the draft.

        A file that another program has changed is overwritten only with `force`.
        """
        if self.file is None:
            raise InvalidInput(
                f"{self.source} cannot be saved because it has no file. Download it instead."
            )
        if not force and self.on_disk() == CHANGED:
            raise FileError(
                f"Another program has changed {self.file} since it was read. Reload or overwrite "
                "the file."
            )
        content = ((BOM if self._has_bom else "") + self.text).encode()
        _write_file(self.file, content)
        self._saved = content
        self.saved_text = self.text
        self._origin = (self.file, None)
        self.write_draft()

    def reload(self) -> None:
        """Replace the text by the file on disk, as one step of undo."""
        if self.file is None:
            raise InvalidInput(f"{self.source} cannot be reloaded because it has no file.")
        content = self._read_file()
        text = decode(content, self.file)
        body = text.removeprefix(BOM)
        data = read_job_mapping(body, self.source)
        self._saved = content
        self.saved_text = body
        self._has_bom = text.startswith(BOM)
        self._set_text(body, data, "reload")

    def write_draft(self) -> bool:
        """Store the document among the recent ones; returns True if it has a draft."""
        # An unchanged job of a drawing needs no draft, because it can be generated again.
        is_generated = self._saved is None and self.text == self._opened
        unsaved = self.text if self.dirty and not is_generated else None
        if unsaved is None and self._origin is None:
            drop_recent(self.id)
            return False
        file, cell = self._origin or (None, None)
        entry = Recent(
            id=self.id,
            name=self.source if file is None else file.name,
            folder=str(self.folder),
            file=None if file is None else str(file),
            cell=cell,
            opened=self._opened,
            text=unsaved,
            steps=[] if unsaved is None else self._stored_steps(),
            run=self.chosen_run,
        )
        return entry.write() and unsaved is not None

    def restore_steps(self, steps: Sequence[Sequence[str]]) -> None:
        """Replace the newest step, which restored a draft, by the steps that led to the draft.

        Args:
            steps: Steps as in `Recent`. If the first one does not begin with the text before the
                draft, as after a change of the file, the newest step stays before them.
        """
        if not steps or not self._past:
            return
        restored = self._past.pop()
        if steps[0][1] != restored.text:
            self._past.append(restored)
        for label, text in steps:
            self._past.append(HistoryEntry(label, text, read_job_mapping(text, self.source)))
        self.write_draft()

    def _stored_steps(self) -> list[list[str]]:
        """Return the newest steps of the undo list that are stored with a draft."""
        steps: list[list[str]] = []
        size = 0
        for entry in reversed(self._past[-MAX_STORED_STEPS:]):
            size += len(entry.text)
            if size > MAX_STORED:
                break
            steps.append([entry.label, entry.text])
        return steps[::-1]

    def choose_run(self, run: str) -> None:
        """Keep the run that the user chose to show, also for later sessions."""
        self.chosen_run = run
        self.write_draft()

    def unsaved(self) -> str | None:
        """Return a message that unsaved changes are in the draft; None without such changes."""
        if not self.write_draft():
            return None
        return f"The unsaved changes of {self.source} are stored as a draft."

    def drop_earlier_draft(self) -> None:
        """Delete the draft of an earlier session after it was restored or discarded."""
        if self.earlier_draft is not None:
            drop_recent(self.earlier_draft.id)
        self.earlier_draft = None

    def _set_text(self, text: str, data: dict[str, Any], label: str) -> None:
        """Replace text and data as one step of undo."""
        if text == self.text:
            return
        self._past.append(HistoryEntry(label, self.text, self._data))
        self._future.clear()
        while len(self._past) > 1 and sum(len(x.text) for x in self._past) > MAX_HISTORY:
            del self._past[0]
        self.text = text
        self._data = data
        self.write_draft()

    def _move_history(
        self, source: list[HistoryEntry], destination: list[HistoryEntry], action: str
    ) -> None:
        """Restore the last text of `source`, and append the current text to `destination`."""
        if not source:
            raise InvalidInput(f"There is nothing to {action}.")
        label, text, data = source.pop()
        destination.append(HistoryEntry(label, self.text, self._data))
        self.text = text
        self._data = data
        self.write_draft()

    def _read_file(self) -> bytes:
        assert self.file is not None
        return read_bytes(self.file, "job file")


def decode(content: bytes, file: FilePath | str) -> str:
    """Decode the content of a UTF-8 file; line breaks are not converted."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        raise FileError(f"{file} cannot be read because it is not UTF-8 text.") from None


def _write_file(file: FilePath, content: bytes) -> None:
    """Write a file atomically; if the file is a symbolic link, write its target."""
    if file.is_symlink():
        read_bytes(file, "job file")
    target = FilePath(os.path.realpath(file))

    def write(fresh: FilePath) -> None:
        fresh.write_bytes(content)
        if target.exists():
            shutil.copymode(target, fresh)

    write_atomically(target, write)
