"""Open pages of a session: frames sent to the pages, files for download, the shown document."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from threading import RLock
from typing import Any, Protocol, TypeAlias

import numpy as np

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.studio.description import document_frame
from armcontour.studio.editor import Editor, Revision
from armcontour.studio.handles import is_blank
from armcontour.studio.page_frame import PageFrame, without_options
from armcontour.studio.picture import drawing_frame
from armcontour.studio.scheduler import DocumentState, Scheduler, SchedulerOptions
from armcontour.studio.view import View

# A message of a page.
PageMessage: TypeAlias = Mapping[str, Any]
# Maximum number and total size [bytes] of stored files for download; the newest file always stays.
MAX_FILES, MAX_BYTES = 20, 200_000_000
# Kinds of frames of which a page needs only the newest one.
NEWEST_ONLY = {
    *("arm", "changes", "detail", "document", "executed", "figures", "picture", "refusal")
}


class Page(Protocol):
    """A page that receives frames; `send` may be called from any thread."""

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Send a frame; it replaces a queued frame with the same `replaces`."""


@dataclass(frozen=True, slots=True)
class File:
    """A file for download."""

    name: str
    kind: str
    data: bytes = field(repr=False)


class Pages:
    """Open pages and files for download; thread-safe."""

    def __init__(self) -> None:
        self.files: dict[str, File] = {}
        self._lock = RLock()
        self._numbers: dict[Page, int] = {}
        self._joined = 0
        # Number of the last recorded message of each page, by page number.
        self._seqs: dict[int, int] = {}
        # Frames that a new page receives, by replacement key.
        self._current_frames: dict[str, PageFrame] = {}
        # Numbers of the messages that the newest frame `figures` answers, by page number.
        self._figures_answers: Mapping[int, int] = {}

    @property
    def answers(self) -> dict[int, int]:
        """Number of the last recorded message of each page, by page number."""
        with self._lock:
            return dict(self._seqs)

    def join(self, page: Page) -> None:
        """Add a page and send it the current frames."""
        with self._lock:
            self._joined += 1
            self._numbers[page] = self._joined
            for key, frame in self._current_frames.items():
                page.send(frame.stamped(seq=None).pack(), key)

    def leave(self, page: Page) -> None:
        """Remove a page."""
        with self._lock:
            self._seqs.pop(self._numbers.pop(page, 0), None)

    def record(self, page: Page, message: PageMessage) -> bool:
        """Record the number of a message; returns False if the page is closed."""
        seq = message.get("seq")
        with self._lock:
            is_open = page in self._numbers
            # A request for a detail is not recorded, because it does not change the document.
            counts = is_open and message.get("op") != "detail"
            if counts and isinstance(seq, int) and not isinstance(seq, bool):
                self._seqs[self._numbers[page]] = seq
        return is_open

    def send(
        self, frame: PageFrame, *, to: Page | None = None, answers: Mapping[int, int] | None = None
    ) -> None:
        """Send a frame to one page or to all, with the number of the message that it answers."""
        key, sentence = _replacement_key(frame), frame.header.get("sentence")
        if isinstance(sentence, str):
            frame = frame.stamped(sentence=without_options(sentence))
        with self._lock:
            answers = self.answers if answers is None else answers
            if to is None and key is not None and not frame.header.get("dropped"):
                self._remember(key, frame, answers)
            packed: dict[int | None, bytes] = {}
            for page, number in self._numbers.items():
                if to is None or page is to:
                    seq = answers.get(number)
                    if seq not in packed:
                        packed[seq] = frame.stamped(seq=seq).pack()
                    page.send(packed[seq], key)

    def keep_file(self, name: str, kind: str, data: bytes) -> str:
        """Store a file for download; returns its random identifier."""
        number = secrets.token_hex(8)
        with self._lock:
            self.files[number] = File(name, kind, data)
            while len(self.files) > MAX_FILES or (
                len(self.files) > 1 and sum(len(x.data) for x in self.files.values()) > MAX_BYTES
            ):
                del self.files[next(iter(self.files))]
        return number

    def _remember(self, key: str, frame: PageFrame, answers: Mapping[int, int]) -> None:
        """Store a frame for pages that join later, and discard frames that it makes obsolete."""
        if frame.kind == "figures":
            self._figures_answers = answers
        previous = self._current_frames.get(key, frame).header.get("tier")
        if frame.kind == "refusal" and (previous, frame.header["tier"]) == (1, 3):
            # The refusal of the plan stays, as on the open pages.
            return
        if frame.kind == "refusal" and "outline" in frame.header:
            # A new page shows the refused path, because it has no earlier motion.
            header = {**frame.header, **frame.header["outline"]}
            self._remember("picture", PageFrame("picture", header, frame.arrays), answers)
        if frame.kind == "picture":
            old = ["executed", "refusal"]
            # An exact picture of the same edit can follow the figures, which then stay valid.
            if any(seq > self._figures_answers.get(number, -1) for number, seq in answers.items()):
                old += ["figures", "changes"]
            for kind in old:
                self._current_frames.pop(kind, None)
        self._current_frames[key] = frame


def _replacement_key(frame: PageFrame) -> str | None:
    """Key of the frames that a frame replaces: its kind; for progress, also the task identifier.

    None if pages need every frame of the kind.
    """
    if frame.kind == "progress":
        return f"progress/{frame.header.get('id')}"
    return frame.kind if frame.kind in NEWEST_ONLY else None


class Display:
    """Shows the document of an editor on all pages."""

    def __init__(self, editor: Editor, options: SchedulerOptions) -> None:
        self.editor = editor
        self.lock = RLock()
        self.pages = Pages()
        # Shown revision, including the edits of an active gesture.
        self._revision = Revision({})
        self._on_disk = ""
        self.scheduler = Scheduler(editor.previewer, self._send_state_frame, options)

    def show_all(self) -> None:
        """Send the frame `document`, then plan and show the run."""
        self.show_document()
        self.show()

    def show_document(self, to: Page | None = None) -> None:
        """Send the frame `document` to one page or to all."""
        editor = self.editor
        self._on_disk = editor.document.on_disk()
        frame = document_frame(editor.document, editor.state, editor.run)
        logs = list(editor.uploads.logs)
        self.send(frame.stamped(id=editor.id, logs=logs), to=to)

    def show(self, revision: Revision | None = None, *, moving: bool = False) -> None:
        """Plan and show a revision, by default the document; `moving`: a gesture is active."""
        editor = self.editor
        self._revision = revision = Revision(editor.state.data) if revision is None else revision
        handles = editor.state.handles
        if handles is None:
            self.send_refusal(
                editor.state.error or InvalidInput("The document is not a valid job yet.")
            )
            return
        view = View(handles.plane, handles.centre)
        if is_blank(revision.data):
            self.scheduler.forget()
            self.send(drawing_frame(None, view, run=editor.run))
            return
        self.scheduler.show(
            DocumentState(
                data=revision.data,
                run=editor.run_of(revision.data),
                view=view,
                document=editor.id,
                rev=editor.rev,
                answers=self.pages.answers,
                request=partial(editor.request, revision, {}),
                waypoints=np.array([x.uv for x in handles.waypoints]).reshape(-1, 2),
                moving=moving,
            )
        )

    def open(self) -> None:
        """Show the document that the editor has opened."""
        self.scheduler.forget()
        self.show_all()

    def look(self) -> None:
        """Send the frame `document` if the job file has changed on disk."""
        if self._on_disk and self.editor.document.on_disk() != self._on_disk:
            self.show_document()

    def request(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Request for the task process, with the edits of the active gesture."""
        return self.editor.request(self._revision, options)

    def send(self, frame: PageFrame, to: Page | None = None) -> None:
        """Send a frame of the current document to one page or to all."""
        self.pages.send(frame.stamped(rev=self.editor.rev, document=self.editor.id), to=to)

    def send_refusal(self, error: ArmContourError, *, dropped: bool = False) -> None:
        """Send an error to all pages; `dropped`: the edit was discarded, so show the document."""
        if dropped:
            self.show_document()
        facts = {"tier": 1, "run": self.editor.run, "sentence": str(error), "at": {}}
        about = {"error": type(error).__name__, "exit": error.exit_code, "dropped": dropped}
        self.send(PageFrame("refusal", {**facts, **about, "key": ".".join(map(str, error.key))}))
        if dropped:
            self.show()

    def _send_state_frame(self, frame: PageFrame, state: DocumentState | None) -> bool:
        """Send a frame of the scheduler; False if the document has changed since its request."""
        if state is None:
            self.send(self._with_file(frame))
            return True
        if state.rev != self.editor.rev or is_blank(self._revision.data):
            return False
        about = {"rev": state.rev, "document": state.document}
        self.pages.send(frame.stamped(**about), answers=state.answers)
        return True

    def _with_file(self, frame: PageFrame) -> PageFrame:
        """Store the file of a frame for download, and replace its content by its identifier."""
        if frame.kind != "result" or "content" not in frame.arrays:
            return frame
        header, content = frame.header, frame.arrays["content"].tobytes()
        number = self.pages.keep_file(str(header["name"]), str(header["type"]), content)
        return PageFrame("result", {**header, "file": number})
