"""Drafts of unsaved documents, and atomic writing of job files."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_bytes
from armcontour.core.progress import registered
from armcontour.core.staging import lock, unwritable, write_atomically

BOM = "\ufeff"
# Draft key of the document that the Studio shows if it is started without a file.
START = "start"
# Identities of the Studios in this process, the newest last.
_studios: list[str] = []


def state_folder() -> FilePath:
    """The user's folder for drafts and uploads, which stay after the end of a session."""
    folder = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return FilePath(folder or os.path.expanduser("~/.local/state")) / "armcontour" / "studio"


def make_private(folder: FilePath) -> None:
    """Create a folder below `state_folder` that only the user can access."""
    try:
        state_folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None


@contextmanager
def running_studio() -> Iterator[None]:
    """Context of a Studio that runs: other Studios neither offer nor delete its drafts."""
    identity = os.urandom(8).hex()
    with registered(_studios, identity), ExitStack() as ending:
        with suppress(InvalidInput, OSError):
            make_private(_lock_folder(identity))
            ending.callback(shutil.rmtree, _lock_folder(identity), ignore_errors=True)
            ending.callback(lock(_lock_folder(identity), state_folder()))
        yield


def _lock_folder(studio: str) -> FilePath:
    """Folder that a running Studio locks."""
    return state_folder() / f"running-{studio}"


@dataclass(frozen=True, slots=True)
class Draft:
    """An unsaved text and the document to which it belongs."""

    # Identity of the document.
    key: str
    name: str
    folder: str
    # Text of the document when it was opened.
    opened: str
    # Unsaved text.
    text: str
    # True if no command can open the document again, as for an uploaded job.
    upload: bool
    # Identity of the Studio that wrote the draft.
    studio: str = ""

    @staticmethod
    def is_foreign(key: str) -> bool:
        """True if another Studio, which still runs, wrote the draft of a document."""
        draft = _read_draft(draft_file(key))
        studio = "" if draft is None else str(draft.studio)
        # The identity becomes a file name. Windows has no locks that end with their process.
        if studio.isalnum() and studio not in _studios and os.name != "nt":
            try:
                lock(_lock_folder(studio), state_folder())()
            except InvalidInput:
                return True
        return False

    def write(self) -> bool:
        """Write the draft for recovery after a crash; False if the folder is not writable."""
        content = json.dumps({**asdict(self), "studio": next(reversed(_studios), "")}).encode()
        try:
            make_private(state_folder() / "drafts")
            write_atomically(draft_file(self.key), lambda fresh: fresh.write_bytes(content))
        except (InvalidInput, OSError):
            return False
        return True


def draft_file(key: str) -> FilePath:
    """File of the draft of a document."""
    return state_folder() / "drafts" / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"


def find_draft(key: str, job: FilePath | None) -> Draft | None:
    """Draft of a document; None if it is missing, invalid, equal to the job file, or older."""
    file = draft_file(key)
    try:
        saved = None
        if job is not None and job.exists():
            if file.stat().st_mtime_ns < job.stat().st_mtime_ns:
                return None
            saved = decode_text(read_bytes(job, "job file"), job).removeprefix(BOM)
        draft = _read_draft(file)
    except (InvalidInput, OSError):
        return None
    return None if draft is None or Draft.is_foreign(key) or draft.text == saved else draft


def drop_draft(key: str) -> None:
    """Delete the draft of a document, unless another running Studio wrote it."""
    with suppress(OSError):
        if not Draft.is_foreign(key):
            draft_file(key).unlink()


def all_drafts() -> Iterator[Draft]:
    """All drafts, newest first."""
    files = (state_folder() / "drafts").glob("*.json")
    with suppress(OSError):
        for file in sorted(files, key=lambda x: x.stat().st_mtime_ns, reverse=True):
            draft = _read_draft(file)
            if draft is not None:
                yield draft


def _read_draft(file: FilePath) -> Draft | None:
    """The draft in a file; None if the file is missing or invalid."""
    try:
        return Draft(**json.loads(file.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None


def decode_text(content: bytes, file: FilePath | None) -> str:
    """Decode the content of a UTF-8 file; line breaks are not converted."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        raise InvalidInput(f"{file} cannot be read because it is not UTF-8 text.") from None


def write_file(file: FilePath, content: bytes) -> None:
    """Write a file atomically; if the file is a symbolic link, write its target."""
    if file.is_symlink():
        read_bytes(file, "job file")
    target = FilePath(os.path.realpath(file))

    def write(fresh: FilePath) -> None:
        fresh.write_bytes(content)
        if target.exists():
            shutil.copymode(target, fresh)

    write_atomically(target, write)
