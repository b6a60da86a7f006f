"""A job file that is edited (stub)."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

from armcontour import _staging
from armcontour._files import read_text
from armcontour._yaml import load
from armcontour.errors import InvalidInput
from armcontour.io.cell import cell_data, open_text
from armcontour.io.job_edits import Change, change_data, change_text, set_keys


class Document:
    def __init__(self, text: str, *, file: FilePath | None, folder: FilePath, source: str) -> None:
        self.text, self.file, self.folder, self.source = text, file, folder, source
        self.saved_text = text
        self.draft = None
        self._undo: list[tuple[str, str]] = []
        self._redo: list[tuple[str, str]] = []

    @classmethod
    def open(cls, file: FilePath) -> Document:
        return cls(read_text(file, "job file"), file=file, folder=file.parent, source=file.name)

    @classmethod
    def of_text(cls, text: str, folder: FilePath, name: str) -> Document:
        return cls(text, file=None, folder=folder, source=name)

    @classmethod
    def of_drawing(cls, file: FilePath, cell: str) -> Document:
        text, folder = open_text(cell)
        data, source, _ = cell_data(cell, file)
        text = set_keys(
            text,
            {
                ("name",): data["name"],
                ("title",): data["title"],
                ("path", "file"): str(file.absolute()),
            },
            source,
        )
        return cls(text, file=None, folder=file.parent, source=f"{file.stem}.yaml")

    @property
    def data(self) -> dict[str, Any]:
        return load(self.text, self.source)

    def preview(self, changes: Sequence[Change]) -> dict[str, Any]:
        return change_data(self.data, changes)

    def apply(self, changes: Sequence[Change], label: str) -> None:
        self.replace(change_text(self.text, changes, self.source), label)

    def replace(self, text: str, label: str) -> None:
        if text != self.text:
            self._undo.append((self.text, label))
            self._redo.clear()
            self.text = text

    def undo(self) -> None:
        text, label = self._undo.pop()
        self._redo.append((self.text, label))
        self.text = text

    def redo(self) -> None:
        text, label = self._redo.pop()
        self._undo.append((self.text, label))
        self.text = text

    can_undo = property(lambda self: bool(self._undo))
    can_redo = property(lambda self: bool(self._redo))
    undo_label = property(lambda self: self._undo[-1][1] if self._undo else None)
    redo_label = property(lambda self: self._redo[-1][1] if self._redo else None)
    dirty = property(lambda self: self.text != self.saved_text)

    @property
    def on_disk(self) -> str:
        if self.file is None:
            return "none"
        try:
            return "same" if self.file.read_text() == self.saved_text else "changed"
        except OSError:
            return "missing"

    def changed_on_disk(self) -> bool:
        return self.on_disk == "changed"

    def save(self, force: bool = False) -> None:
        _staging.put_in_place(self.file, lambda x: x.write_text(self.text))
        self.saved_text = self.text

    def diff(self) -> str:
        return "".join(
            difflib.unified_diff(self.saved_text.splitlines(True), self.text.splitlines(True))
        )

    def reload(self) -> None:
        self.replace(read_text(self.file, "job file"), "reload")
        self.saved_text = self.text

    def write_draft(self):
        return None

    def discard_draft(self) -> None: ...
