"""Recent documents of the user: opened files, and unsaved texts (drafts) of all sessions."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath

from armcontour.core.errors import FileError
from armcontour.core.file_access import unwritable, write_atomically

# Maximum number of listed documents without unsaved changes.
MAX_RECENT = 8


def state_folder() -> FilePath:
    """Return the user's folder for recent documents and uploads, which outlive a session."""
    folder = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return FilePath(folder or os.path.expanduser("~/.local/state")) / "armcontour" / "studio"


def make_private(folder: FilePath) -> None:
    """Create a folder below `state_folder` that only the user can access."""
    try:
        state_folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Recent:
    """A document that was edited in a session.

    Args:
        id: Identity of the document. Each session has its own, so that sessions keep their drafts
            apart.
        name: Name of the document.
        folder: Folder to which file names in the job are relative.
        file: Job file or drawing that opens the document; None for an upload.
        cell: Cell of a drawing; None for a job.
        opened: Text of the document when it was opened.
        text: Unsaved text; None without unsaved changes.
        steps: Steps of the undo list that lead to the unsaved text, oldest first: the label of the
            change, and the text before it.
        run: Name of the run that the user chose to show; empty without a choice.
    """

    id: str
    name: str
    folder: str
    file: str | None
    cell: str | None
    opened: str
    text: str | None
    steps: Sequence[Sequence[str]] = ()
    run: str = ""

    def write(self) -> bool:
        """Store the document for recovery after a crash; False if the folder is not writable."""
        content = json.dumps(asdict(self)).encode()
        try:
            make_private(_folder())
            write_atomically(_file(self.id), lambda fresh: fresh.write_bytes(content))
        except (FileError, OSError):
            return False
        return True

    @property
    def where(self) -> str:
        """Location of the document for the start page."""
        if self.text is not None:
            changed = time.localtime(_file(self.id).stat().st_mtime)
            return f"not saved, changed {time.strftime('%d %b %H:%M', changed)}, in {self.folder}"
        return self.folder if self.cell is None else f"{self.folder}, on {self.cell}"


def drop_recent(id: str) -> None:
    """Forget a document and its unsaved text."""
    with suppress(OSError):
        _file(id).unlink()


def all_recent() -> Iterator[Recent]:
    """List all stored documents, newest first."""
    with suppress(OSError):
        for file in sorted(_folder().glob("*.json"), key=lambda x: -x.stat().st_mtime_ns):
            with suppress(OSError, ValueError, TypeError):
                yield Recent(**json.loads(file.read_bytes()))


def listed_recent() -> list[Recent]:
    """Return all drafts and the newest existing files, and delete the other entries."""
    drafts = list[Recent]()
    files = dict[tuple[str | None, str | None], Recent]()
    for x in all_recent():
        if x.text is not None:
            drafts.append(x)
        elif (x.file, x.cell) in files or len(files) == MAX_RECENT:
            drop_recent(x.id)
        elif x.file is not None and FilePath(x.file).is_file():
            files[x.file, x.cell] = x
    return [*drafts, *files.values()]


def find_draft(file: FilePath, cell: str | None, text: str) -> Recent | None:
    """Find a file's newest draft that differs from its text and is not older, or None."""
    for x in all_recent():
        if (x.file, x.cell) == (str(file), cell) and x.text not in (None, text):
            is_newer = _file(x.id).stat().st_mtime_ns >= file.stat().st_mtime_ns
            return x if is_newer else None
    return None


def find_run(file: FilePath, cell: str | None) -> str:
    """Return the run that was shown last of a file; empty if it is unknown."""
    return next((x.run for x in all_recent() if (x.file, x.cell) == (str(file), cell)), "")


def _folder() -> FilePath:
    return state_folder() / "recent"


def _file(id: str) -> FilePath:
    return _folder() / f"{id}.json"
