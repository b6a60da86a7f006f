"""`Document`: the text of a job file, with undo and redo, and its file."""

from __future__ import annotations

import difflib
import hashlib
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_bytes
from armcontour.files.cell import drawing_text
from armcontour.files.job_edits import Change, change_data, change_text, file_names
from armcontour.files.job_file import read_data
from armcontour.studio.drafts import BOM, Draft, decoded, drop_draft, find_draft, write_whole

SAME, CHANGED, MISSING, NONE = "same", "changed", "missing", "none"
# Characters of all texts that can be had back by undoing; the last one always can.
MOST_UNDO = 50_000_000


class Step(NamedTuple):
    """A text that can be had back, with its data, and the label of the change between."""

    label: str
    text: str
    data: dict[str, Any]


class Document:
    """The text of a job file that is being changed.

    The text is all there is: undo and redo are lists of texts, so that undoing every change gives
    the same bytes again. Every change writes a draft, until the text is saved.

    Args:
        text: The text.
        source: Name of the job file in messages.
        file: The job file; None for a job without one.
        folder: Folder of relative file names; None for a job that may name no files.
        saved: The bytes of the file when it was read; None if there was no file.
        key: Identity of a document that is not read from its file, for drafts.
        upload: Whether a page has sent the document.

    Attributes:
        key: As above.
        id: Distinguishes the document from others that the session opens.
        earlier: The text that an earlier session has not saved; None if there is none.

    Raises:
        InvalidInput: The text is not a YAML mapping, or names files without a folder.
    """

    def __init__(
        self,
        text: str,
        *,
        source: str,
        file: FilePath | None = None,
        folder: FilePath | None = None,
        saved: bytes | None = None,
        key: str = "",
        upload: bool = False,
    ) -> None:
        self.source, self.file, self.folder = source, file, folder
        self.id = secrets.token_hex(4)
        self._marked = text.startswith(BOM)
        self._saved = saved
        self.key, self._upload = key or f"file {file}", upload
        self.text = self._opened = text.removeprefix(BOM)
        self.saved_text = self.text if saved is not None or file is None else ""
        self._data = self._checked(self.text)
        self._past: list[Step] = []
        self._future: list[Step] = []
        draft = find_draft(self.key, file)
        self.earlier = None if draft is None or draft.text == self._opened else draft.text

    @classmethod
    def open(cls, file: str | FilePath) -> Document:
        """Open a job file.

        Args:
            file: The job file; changes are saved there.

        Raises:
            InvalidInput: No such file, or its text is not a YAML mapping.
        """
        place = FilePath(file).absolute()
        content = read_bytes(place, "job file")
        text = decoded(content, place)
        return cls(text, source=place.name, file=place, folder=place.parent, saved=content)

    @classmethod
    def of_text(
        cls, text: str, folder: FilePath | None, name: str, key: str = "", upload: bool = False
    ) -> Document:
        """A job without a file, such as an upload or the job of the paper.

        Args:
            text: The text.
            folder: Folder of relative file names; None refuses files.
            name: Name of the job file in messages.
            key: As of `Document`; by default the name with the text.
            upload: As of `Document`.

        Raises:
            InvalidInput: The text is not a YAML mapping, or names files that nobody can find.
        """
        key = key or f"text {name} {text}"
        return cls(text, source=name, folder=folder, key=key, upload=upload)

    @classmethod
    def of_drawing(cls, file: str | FilePath, cell: str) -> Document:
        """The job of a drawing in a cell, which can be saved beside the drawing.

        Args:
            file: The drawing.
            cell: Name of a built-in cell, or a job file.

        Raises:
            InvalidInput: No such cell or drawing.
        """
        drawing = FilePath(file).absolute()
        if not drawing.is_file():
            raise InvalidInput(f"There is no drawing {drawing}.")
        place = drawing.with_suffix(".yaml")
        text = drawing_text(cell, drawing, place.parent)
        own = FilePath(cell).absolute() if FilePath(cell).suffix else cell
        key = f"drawing {drawing} on {own}"
        return cls(text, source=place.name, file=place, folder=place.parent, key=key)

    @property
    def data(self) -> Mapping[str, Any]:
        """The data of the text, as written."""
        return self._data

    @property
    def dirty(self) -> bool:
        """Whether the text differs from what was read or saved."""
        return self.text != self.saved_text

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether there is an undone change."""
        return bool(self._future)

    @property
    def before(self) -> str:
        """The text before the last change; "" if there is none."""
        return self._past[-1].text if self._past else ""

    @property
    def undo_label(self) -> str | None:
        """What undoing takes back; None if there is nothing."""
        return self._past[-1].label if self._past else None

    @property
    def redo_label(self) -> str | None:
        """What redoing does again; None if there is nothing."""
        return self._future[-1].label if self._future else None

    def apply(self, changes: Sequence[Change], label: str) -> None:
        """Change the text, as one step of undo; nothing happens without a difference.

        Args:
            changes: The changes.
            label: What they do, for undo.

        Raises:
            InvalidInput: A change that cannot be made; the document stays as it is.
        """
        text = change_text(self.text, changes, self.source)
        self._put(text, change_data(self._data, changes), label)

    def replace(self, text: str, label: str) -> None:
        """Take another text, as one step of undo.

        Args:
            text: The text; with the line breaks of this one if it has none but line feeds.
            label: What it is, for undo.

        Raises:
            InvalidInput: The text is not a YAML mapping; the document stays as it is.
        """
        text = text.removeprefix(BOM)
        # Browsers turn all line breaks into line feeds.
        if "\r\n" in self.text and "\r" not in text:
            text = text.replace("\n", "\r\n")
        self._put(text, self._checked(text), label)

    def undo(self) -> None:
        """Take the last change back.

        Raises:
            InvalidInput: There is none.
        """
        self._step(self._past, self._future, "undo")

    def redo(self) -> None:
        """Do the change again that was undone last.

        Raises:
            InvalidInput: There is none.
        """
        self._step(self._future, self._past, "redo")

    def on_disk(self) -> str:
        """How the file differs from what was read or saved: same, changed, missing or none."""
        if self.file is None:
            return NONE
        if not self.file.exists():
            return MISSING
        return SAME if self._read() == self._saved else CHANGED

    def changed_on_disk(self) -> bool:
        """Whether somebody else has changed the file, or made it, since it was read or saved."""
        return self.on_disk() == CHANGED

    def save(self, *, force: bool = False) -> None:
        """Write the file, completely or not at all, and remove the draft.

        Args:
            force: Whether to write over changes of somebody else.

        Raises:
            InvalidInput: There is no file, it was changed by somebody else, or it cannot be
                written.
        """
        if self.file is None:
            raise InvalidInput(f"{self.source} has no file to save to: download it instead.")
        if not force and self.changed_on_disk():
            raise InvalidInput(
                f"{self.file} was changed by another program since it was read: reload it, or "
                "overwrite it."
            )
        content = ((BOM if self._marked else "") + self.text).encode()
        write_whole(self.file, content)
        self._saved, self.saved_text = content, self.text
        self.write_draft()

    def diff(self) -> str:
        """The changes since the file was read or saved, as a unified diff."""
        return _diff(self.saved_text, self.text, self.source, "saved", "now")

    def conflict(self) -> str:
        """What saving would change in the file as it is on disk now, as a unified diff.

        Raises:
            InvalidInput: The file cannot be read.
        """
        there = decoded(self._read(), self.file) if self.on_disk() in (SAME, CHANGED) else ""
        return _diff(there.removeprefix(BOM), self.text, self.source, "on disk", "now")

    def reload(self) -> None:
        """Take the text of the file as it is on disk now, as one step of undo.

        Raises:
            InvalidInput: There is no file, or its text is not a YAML mapping.
        """
        if self.file is None:
            raise InvalidInput(f"{self.source} has no file to read again.")
        content = self._read()
        text = decoded(content, self.file)
        own = text.removeprefix(BOM)
        data = self._checked(own)
        self._saved, self.saved_text, self._marked = content, own, text.startswith(BOM)
        self._put(own, data, "reload")

    def write_draft(self) -> bool:
        """Keep the text as a draft, to be found after a crash; without changes remove the draft.

        Returns:
            Whether there is a draft now: a folder that cannot be written to has none.
        """
        # The job of a drawing is made again as it was opened.
        made = self._saved is None and self.text == self._opened
        if self.dirty and not made:
            named = (self.source, str(self.folder), self._opened)
            if self.earlier not in (None, self.text):
                # Nobody has decided on it: it stays, next to the newer one.
                Draft(self._earlier_key, *named, self.earlier or "", upload=True).write()
            return Draft(self.key, *named, self.text, self._upload).write()
        # What nobody has decided on is offered again.
        if self.earlier is not None:
            return True
        drop_draft(self.key)
        return False

    def unsaved(self) -> str | None:
        """A sentence on changes that are not saved, which are kept in the draft; None without."""
        if not (self.dirty and self.write_draft()):
            return None
        return f"Changes of {self.source} that were not saved are kept as its draft."

    def settle(self) -> None:
        """Drop what an earlier session has not saved: it was taken, or is not wanted."""
        drop_draft(self._earlier_key)
        self.earlier = None

    @property
    def _earlier_key(self) -> str:
        """Key of the earlier draft, once a newer one has its place."""
        return f"{self.key}, before {hashlib.sha256((self.earlier or '').encode()).hexdigest()}"

    def _checked(self, text: str) -> dict[str, Any]:
        """The data of a text.

        Raises:
            InvalidInput: It is not a YAML mapping, or names files without a folder.
        """
        data = read_data(text, self.source)
        self._refuse_files(text)
        return data

    def _refuse_files(self, text: str) -> None:
        """Refuse names of files in a job that has no folder.

        Raises:
            InvalidInput: There is one.
        """
        for name in file_names(text, self.source) if self.folder is None else ():
            raise InvalidInput(
                f"{self.source} names the file {name}, which is not here, because only the job was "
                "opened: start armcontour studio with the job file in its folder."
            )

    def _put(self, text: str, data: dict[str, Any], label: str) -> None:
        """Take another text as one step of undo."""
        if text == self.text:
            return
        self._refuse_files(text)
        self._past.append(Step(label, self.text, self._data))
        self._future.clear()
        while len(self._past) > 1 and sum(len(x.text) for x in self._past) > MOST_UNDO:
            del self._past[0]
        self.text, self._data = text, data
        self.write_draft()

    def _step(self, taken: list[Step], given: list[Step], what: str) -> None:
        """Take the last text of one list, and put the present one on the other.

        Raises:
            InvalidInput: The list is empty.
        """
        if not taken:
            raise InvalidInput(f"There is nothing to {what}.")
        label, text, data = taken.pop()
        given.append(Step(label, self.text, self._data))
        self.text, self._data = text, data
        self.write_draft()

    def _read(self) -> bytes:
        """The content of the file."""
        assert self.file is not None
        return read_bytes(self.file, "job file")


def _diff(old: str, new: str, name: str, before: str, after: str) -> str:
    """The lines that differ between two texts, as a unified diff."""
    lines = difflib.unified_diff(
        old.splitlines(), new.splitlines(), f"{name} ({before})", f"{name} ({after})", lineterm=""
    )
    return "\n".join(lines)
