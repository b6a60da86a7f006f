"""Commands of a page: one method for each value of `op` in its messages, and gestures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.text import show
from armcontour.files.job_text_edits import Change
from armcontour.studio.description import label_of
from armcontour.studio.document import Document
from armcontour.studio.editor import Revision
from armcontour.studio.edits.keys import add_run, remove_run
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.pages import Display, Page, PageMessage
from armcontour.studio.start_page import (
    add_recent,
    find_recent,
    new_document,
    open_file,
    start_frame,
)
from armcontour.studio.view import Detail

# Maximum number of edits in a message, because the job may be read again for each edit.
MAX_EDITS = 100

# Maximum width of a detail, and maximum deviation of its drawn lines [px].
MAX_PIXELS, PIXEL_ERROR = 20_000, 0.25


@dataclass(slots=True)
class Gesture:
    """A drag or similar interaction. Each of its messages contains all edits since its start."""

    number: Any
    rev: int
    is_over: bool = False


class Gestures:
    """The active gestures, at most one per page."""

    def __init__(self, display: Display) -> None:
        self._display, self._editor = display, display.editor
        self._active: dict[Page, Gesture] = {}

    def edit(self, page: Page, message: PageMessage) -> None:
        """Preview the edits of a gesture; commit them if the message is final."""
        gesture = self._gesture(page, message)
        if gesture.is_over:
            return
        final = bool(message.get("final"))
        try:
            edits = _read_edits(message)
            revision = self._editor.revise(edits)
            if not final:
                self._display.show(revision, moving=True)
                return
            self._editor.commit(revision, label_of(edits))
            self._display.show_all()
        finally:
            if final:
                self._active.pop(page, None)

    def cancel(self, page: Page, message: PageMessage) -> None:
        """Discard the gesture of a page and show the document without its edits."""
        self._active.pop(page, None)
        self._display.show()

    def leave(self, page: Page) -> None:
        """Discard the gesture of a closed page."""
        gesture = self._active.pop(page, None)
        if gesture is not None and not gesture.is_over:
            self._display.show()

    def _gesture(self, page: Page, message: PageMessage) -> Gesture:
        """The gesture of a message; a gesture ends if the document has changed since its start."""
        gesture = self._active.get(page)
        if gesture is None or gesture.number != message.get("gesture"):
            entry, now = message.get("rev"), self._editor.rev
            gesture = Gesture(message.get("gesture"), now if entry is None else entry)
            self._active[page] = gesture
        # The final message of a gesture is answered in any case, because the page waits for it.
        if gesture.rev != self._editor.rev and (message.get("final") or not gesture.is_over):
            gesture.is_over = True
            self._display.show_document(page)
            sentence = "The job was changed elsewhere during this edit, so the edit was discarded."
            self._display.send(PageFrame("notice", {"sentence": sentence}), to=page)
        return gesture


def _read_edits(message: PageMessage) -> list[Mapping[str, Any]]:
    """The edits of a message: a list of 1 to MAX_EDITS mappings."""
    edits = message.get("edits")
    if not isinstance(edits, list) or not edits or not all(isinstance(x, dict) for x in edits):
        raise InvalidInput(
            f"The message {message.get('op')} requires `edits`, a non-empty list of mappings."
        )
    if len(edits) > MAX_EDITS:
        raise InvalidInput(
            f"The message has {len(edits)} edits, but at most {MAX_EDITS} are allowed. Edit the "
            "text of the job instead."
        )
    return edits


class Commands:
    """Executes the commands in messages of pages."""

    def __init__(
        self, display: Display, confine: Callable[[Sequence[FilePath]], None] = lambda named: None
    ) -> None:
        self._confine = confine
        self._display, self._editor = display, display.editor
        self.gestures = Gestures(display)
        self._methods: dict[str, Callable[[Page, PageMessage], None]] = {
            "edit": self.gestures.edit,
            "cancel_gesture": self.gestures.cancel,
            "undo": self._undo,
            "redo": self._redo,
            "save": self._save,
            "reload": self._reload,
            "restore_draft": self._restore,
            "discard_draft": self._discard,
            "select": self._select,
            "add_run": self._add_run,
            "remove_run": self._remove_run,
            "detail": self._detail,
            "task": self._task,
            "cancel": self._cancel,
            "resume": self._resume,
            "start": self._start,
            "new": self._new,
            "open_recent": self._open_recent,
        }

    def execute(self, page: Page, message: PageMessage) -> None:
        """Execute the command that `op` of a message selects."""
        act = self._methods.get(str(message.get("op")))
        if act is None:
            raise InvalidInput(f"The Studio has no command {show(message.get('op'))}.")
        act(page, message)

    def _commit(self, revision: Revision, label: str) -> None:
        """Change the document and show it."""
        self._editor.commit(revision, label)
        self._display.show_all()

    def _change(self, changes: Sequence[Change], label: str) -> None:
        """Change keys of the document and show it."""
        self._commit(self._editor.revise_keys(changes), label)

    # Commands that change the text or its file

    def _undo(self, page: Page, message: PageMessage) -> None:
        self._editor.undo()
        self._display.show_all()

    def _redo(self, page: Page, message: PageMessage) -> None:
        self._editor.redo()
        self._display.show_all()

    def _save(self, page: Page, message: PageMessage) -> None:
        """Write the job file; a job without a file becomes a download."""
        document, send = self._editor.document, self._display.send
        force = message.get("force") is True
        if document.file is None:
            name = f"{document.data.get('name') or 'job'}.yaml"
            content = document.text.encode()
            number = self._display.pages.keep_file(name, "application/yaml", content)
            send(PageFrame("download", {"file": number, "name": name}), to=page)
            return
        if document.changed_on_disk() and not force:
            sentence = (
                f"Another program has changed {document.file.name} since it was opened. Overwrite "
                "or reload the file."
            )
            send(PageFrame("conflict", {"sentence": sentence}), to=page)
            return
        document.save(force=force)
        add_recent(document.file, None)
        send(PageFrame("saved", {"file": str(document.file)}))
        self._display.show_document()

    def _reload(self, page: Page, message: PageMessage) -> None:
        self._editor.reload()
        # The files that the job names may have changed too.
        self._display.scheduler.forget_figures()
        self._display.show_all()

    def _restore(self, page: Page, message: PageMessage) -> None:
        """Restore the draft of an earlier session."""
        self._editor.restore()
        self._display.show_all()

    def _discard(self, page: Page, message: PageMessage) -> None:
        """Delete the draft of an earlier session."""
        self._editor.discard()
        self._display.show_document()

    # Commands that open other jobs

    def _start(self, page: Page, message: PageMessage) -> None:
        self._display.send(start_frame(), to=page)

    def _new(self, page: Page, message: PageMessage) -> None:
        card, arm = (_required_text(message, name) for name in ("card", "arm"))
        editor, before = self._editor, self._editor.document
        editor.open(new_document(card, arm, editor.uploads, before))
        self._show_opened(before)

    def _open_recent(self, page: Page, message: PageMessage) -> None:
        """Open a recent file or draft, which may be in any folder."""
        entry, editor = find_recent(_required_text(message, "id")), self._editor
        draft, cell = entry.get("draft"), entry.get("cell")
        file = FilePath(entry["file"]) if draft is None else FilePath(draft.folder, draft.name)
        named, before = [file, *([FilePath(cell)] if cell else [])], editor.document
        with reading_below((file.parent, editor.uploads.root), named):
            if draft is None:
                editor.open(open_file(file, cell))
            else:
                editor.restore(draft)
        self._confine(named)
        self._show_opened(before)

    def _show_opened(self, before: Document) -> None:
        """Show the new document; report that unsaved changes of the previous one are in a draft."""
        self._display.open()
        sentence = before.unsaved()
        if sentence is not None:
            self._display.send(PageFrame("notice", {"sentence": sentence}))

    # Commands for runs

    def _select(self, page: Page, message: PageMessage) -> None:
        self._editor.select(_required_text(message, "run"))
        self._display.show_all()

    def _add_run(self, page: Page, message: PageMessage) -> None:
        name, like = _required_text(message, "name"), message.get("like", self._editor.run)
        self._change(add_run(self._editor.state.data, name, like), f"add the run {name}")

    def _remove_run(self, page: Page, message: PageMessage) -> None:
        name = _required_text(message, "name")
        self._change(remove_run(self._editor.state.data, name), f"remove the run {name}")

    # Commands for details and tasks

    def _detail(self, page: Page, message: PageMessage) -> None:
        """Draw the visible part of the picture with the resolution of the screen."""
        box = checks.check_numbers("box", message.get("box") or [], "m")
        if box.shape != (4,):
            raise InvalidInput(
                f"box must have four numbers (minimum u, minimum v, maximum u, maximum v), but has "
                f"the shape {box.shape}."
            )
        px = max(
            checks.positive("px", message.get("px"), "m"),
            np.ptp(box.reshape(2, 2), 0).max() / MAX_PIXELS,
        )
        detail = Detail(px * PIXEL_ERROR, box)
        self._display.scheduler.draw_detail(
            detail, lambda frame: self._display.send(frame, to=page), page
        )

    def _task(self, page: Page, message: PageMessage) -> None:
        options = message.get("options") or {}
        if not isinstance(options, dict):
            raise InvalidInput("The options of a task must be a mapping.")
        id, task = _required_text(message, "id"), _required_text(message, "task")
        self._display.scheduler.start_task(id, task, self._display.request(options))

    def _cancel(self, page: Page, message: PageMessage) -> None:
        self._display.scheduler.cancel(_required_text(message, "id"))

    def _resume(self, page: Page, message: PageMessage) -> None:
        self._display.scheduler.resume()


def _required_text(message: PageMessage, name: str) -> str:
    """Value of a required key of a message: text of 1 to LONGEST_NAME characters."""
    value = message.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= checks.LONGEST_NAME:
        raise InvalidInput(
            f"The message {message.get('op')} requires `{name}`, a text of 1 to "
            f"{checks.LONGEST_NAME} characters."
        )
    return value
