"""New documents: from files, uploads and the cards of the start page; uploaded files and logs."""

from __future__ import annotations

import secrets
import shutil
import time
from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.text import make_printable
from armcontour.files.drawings.path_reader import READERS, YAML
from armcontour.files.job_file import cell_names, cell_text, drawing_patch, drawing_text
from armcontour.files.job_patch import Patch, key_of, write_patch
from armcontour.files.job_text_edits import Change
from armcontour.files.mesh_file import MESHES
from armcontour.files.ros_bag import BAG_ENDINGS
from armcontour.studio.document import Document, decode
from armcontour.studio.model_reader import is_model_file
from armcontour.studio.recent import all_recent, make_private, state_folder

# Drawings that cards of the start page open, by card.
DRAWINGS = {"drawing": "plate.svg", "gcode": "slot.ngc", "weld": "seam.svg"}
# Card of the start page that opens the job of the paper.
PAPER = "paper"
# Card of the start page that opens an empty plane.
EMPTY = "empty"
WEAVE = {"width": "4 mm", "frequency": "2 Hz", "speed": "6 mm/s"}
# Data of a document without keys.
NO_JOB: Mapping[str, Any] = MappingProxyType({})
# Extensions of robot descriptions.
ROBOTS = (".urdf",)
# Maximum length of a file name [characters].
MAX_NAME = 100
# Extensions of robot logs.
LOGS = (".csv", ".txt", ".log", *BAG_ENDINGS)
# Maximum number of stored logs.
MAX_LOGS = 8
# Age above which folders of other sessions are deleted [s]. Servers of newer sessions may still
# run.
MAX_AGE = 30 * 86400.0


class Uploads:
    """Uploaded files of a session; they are stored while the session or a draft needs them."""

    def __init__(self) -> None:
        self.root = state_folder() / "uploads"
        self.folder = self.root / secrets.token_hex(8)
        # Stored logs by name, oldest first.
        self.logs: dict[str, FilePath] = {}
        self._logs = self.root / secrets.token_hex(8)

    def open(
        self,
        name: str,
        content: bytes,
        cell: str | None,
        folder: FilePath,
        unknown: str = "",
        job: Mapping[str, Any] = NO_JOB,
    ) -> Document | list[Change]:
        """Open an uploaded file; returns a new document, or changes of the current document.

        `cell`: built-in cell for a drawing; without it, the drawing replaces the document's path.
        `folder`, `job`: folder and data of the current document.
        """
        check_file_name(name)
        ending = FilePath(name).suffix.lower()
        if ending in YAML:
            return Document(decode(content, name), source=name, folder=folder)
        if ending in ROBOTS:
            return [Change(("arm",), {"file": self._store(name, content, folder)})]
        if ending not in READERS:
            raise InvalidInput(
                f"{name} cannot be opened. The file must be a job (.yaml), a drawing "
                f"({', '.join(READERS)}) or a robot description (.urdf)."
            )
        file = self._store(name, content, folder)
        skipping: Patch = {("path", "unknown"): unknown} if unknown else {}
        options: Patch = {**skipping, **edges_patch(file)}
        if cell is not None:
            checks.check_choice("cell", cell, cell_names())
            there = (folder / file).resolve()
            source = f"{there.stem}.yaml"
            text = write_patch(drawing_text(cell, there, folder), options, source)
            return Document(text, source=source, folder=folder)
        patch = {**drawing_patch(FilePath(name), file, job), **options}
        return [Change(key_of(keys), value) for keys, value in patch.items()]

    def keep_log(self, name: str, content: bytes) -> str:
        """Store a log of the robot and return its name; deletes the oldest log above MAX_LOGS."""
        check_file_name(name)
        if FilePath(name).suffix.lower() not in LOGS or not content:
            kinds = ", ".join(LOGS)
            raise InvalidInput(
                f"{name} must be a log of joint positions ({kinds}) and must not be empty."
            )
        make_private(self._logs)
        file = self._logs / name
        number = 1
        while file.exists() and file.read_bytes() != content:
            number += 1
            file = self._logs / f"{number}-{name}"
        file.write_bytes(content)
        self.logs.pop(file.name, None)
        self.logs[file.name] = file
        if len(self.logs) > MAX_LOGS:
            self.logs.pop(next(iter(self.logs))).unlink()
        return file.name

    def keep_mesh(self, name: str, content: bytes, folder: FilePath) -> str:
        """Store the mesh of an obstacle; returns its name or path, as a job in `folder` has it."""
        check_file_name(name)
        if FilePath(name).suffix.lower() not in MESHES:
            raise InvalidInput(f"{name} must be a mesh ({', '.join(MESHES)}).")
        return self._store(name, content, folder)

    def find_logs(self, names: Any) -> list[str]:
        """Return the paths of the stored logs with the given names."""
        if not isinstance(names, list) or not {str(x) for x in names} <= set(self.logs):
            raise InvalidInput("A log is no longer available. Drop it on the page again.")
        return [str(self.logs[str(x)]) for x in names]

    def close(self) -> None:
        """Delete uploads of this and old sessions, except those that a draft needs."""
        needed = "".join(x.text or "" for x in all_recent())
        old = time.time() - MAX_AGE
        for folder in self.root.glob("*"):
            is_own = folder in (self.folder, self._logs)
            if folder.name in needed or (not is_own and folder.stat().st_mtime > old):
                continue
            shutil.rmtree(folder, ignore_errors=True)

    def _store(self, name: str, content: bytes, folder: FilePath) -> str:
        """Store a file unless the same file is next to the job; returns its name or path."""
        there = folder / name
        if there.is_file() and not there.is_symlink() and there.read_bytes() == content:
            return name
        make_private(self.folder)
        file = self.folder / name
        file.write_bytes(content)
        return str(file)


def edges_patch(file: str) -> Patch:
    """Return the patch that selects no edge of a CAD model, so that the user clicks edges."""
    return {("path", "edges"): []} if is_model_file(file) else {}


def check_file_name(name: str) -> None:
    """Raise InvalidInput for names with a folder, a leading dot or unprintable characters."""
    plain = name == FilePath(name).name and "\\" not in name and not name.startswith(".")
    if not plain or len(name) > MAX_NAME or make_printable(name) != name:
        raise InvalidInput(
            f"The file name must have at most {MAX_NAME} printable characters, no folder and no "
            "leading dot."
        )


def new_document(card: str, arm: str, uploads: Uploads, folder: FilePath) -> Document:
    """Create the job for a card of the start page; file names are relative to `folder`."""
    checks.check_choice("card", card, (*DRAWINGS, PAPER, EMPTY))
    library = resources.files("armcontour.jobs.library")
    if card == PAPER:
        text = (library / "paper.yaml").read_text(encoding="utf-8")
        return Document(text, source="paper.yaml", folder=folder)
    if card == EMPTY:
        return blank_document(arm, folder)
    name = DRAWINGS[card]
    document = uploads.open(name, (library / name).read_bytes(), arm, folder)
    assert isinstance(document, Document)
    if card == "weld":
        text = write_patch(document.text, {("process", "weave"): WEAVE})
        return Document(text, source=document.source, folder=folder)
    return document


def blank_document(arm: str, folder: FilePath, *, is_start: bool = False) -> Document:
    """Create a job with an empty path in a built-in cell; `is_start`: shown on the start page."""
    names: Patch = {("name",): "untitled", ("title",): f"New job on {arm}"}
    text = write_patch(cell_text(arm), names)
    return Document(text, source="untitled.yaml", folder=folder, is_start=is_start)


def open_file(file: FilePath, cell: str | None) -> Document:
    """Open a job file, or a drawing in a cell."""
    if cell is None:
        return Document.open(file)
    return Document.of_drawing(file, cell, edges_patch(file.name))
