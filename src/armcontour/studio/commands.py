"""Commands of a page: one method for each `op` of its messages, and the edits of gestures."""

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
from armcontour.files.job_edits import Change
from armcontour.studio.description import label_of
from armcontour.studio.document import Document
from armcontour.studio.editor import Made
from armcontour.studio.edits.keys import add_run, remove_run
from armcontour.studio.page_frame import Frame
from armcontour.studio.pages import Display, Said, Tab
from armcontour.studio.start_page import find_recent, new_document, open_file, remember, start_frame
from armcontour.studio.view import Detail

# Edits of one message; a page sends a few, and each of them reads the job again at worst.
MOST_EDITS = 100

# Largest width of what is drawn closer, and largest error of its lines [px].
WIDEST, OF_A_PIXEL = 20_000, 0.25


@dataclass(slots=True)
class Gesture:
    """A drag or similar interaction; each of its messages contains all edits since its start."""

    number: Any
    rev: int
    is_over: bool = False


class Gestures:
    """Active gestures, at most one per page."""

    def __init__(self, display: Display) -> None:
        self._display, self._editor = display, display.editor
        self._going_on: dict[Tab, Gesture] = {}

    def edit(self, tab: Tab, said: Said) -> None:
        """Preview the edits of a gesture; commit them if the message is final."""
        gesture = self._gesture(tab, said)
        if gesture.is_over:
            return
        final = bool(said.get("final"))
        try:
            edits = _edits_of(said)
            made = self._editor.edited(edits)
            if not final:
                self._display.show(made, moving=True)
                return
            self._editor.commit(made, label_of(edits))
            self._display.show_all()
        finally:
            if final:
                self._going_on.pop(tab, None)

    def cancel(self, tab: Tab, said: Said) -> None:
        """Discard a gesture."""
        self._going_on.pop(tab, None)
        self._display.show()

    def leave(self, tab: Tab) -> None:
        """Discard the gesture of a closed page."""
        gesture = self._going_on.pop(tab, None)
        if gesture is not None and not gesture.is_over:
            self._display.show()

    def _gesture(self, tab: Tab, said: Said) -> Gesture:
        """The gesture of a message. It ends if the document has changed since its start."""
        gesture = self._going_on.get(tab)
        if gesture is None or gesture.number != said.get("gesture"):
            known, now = said.get("rev"), self._editor.rev
            gesture = Gesture(said.get("gesture"), now if known is None else known)
            self._going_on[tab] = gesture
        if gesture.rev != self._editor.rev and not gesture.is_over:
            gesture.is_over = True
            self._display.show_document(tab)
            sentence = "The job was changed elsewhere meanwhile, so this change was not made."
            self._display.tell(Frame("notice", {"sentence": sentence}), to=tab)
        return gesture


def _edits_of(said: Said) -> list[Mapping[str, Any]]:
    """The edits of a message, a list of 1 to MOST_EDITS mappings."""
    edits = said.get("edits")
    if not isinstance(edits, list) or not edits or not all(isinstance(x, dict) for x in edits):
        raise InvalidInput(f"The message {said.get('op')} needs edits, a list of mappings.")
    if len(edits) > MOST_EDITS:
        raise InvalidInput(
            f"The message has {len(edits)} edits, and at most {MOST_EDITS} are made at once: "
            "change the text of the job instead."
        )
    return edits


class Acts:
    """Executes the messages of pages on the document and on its display."""

    def __init__(
        self, display: Display, confine: Callable[[Sequence[FilePath]], None] = lambda named: None
    ) -> None:
        self._confine = confine
        self._display, self._editor = display, display.editor
        self.gestures = Gestures(display)
        self._known: dict[str, Callable[[Tab, Said], None]] = {
            "edit": self.gestures.edit,
            "cancel_gesture": self.gestures.cancel,
            "undo": self._undo,
            "redo": self._redo,
            "save": self._save,
            "reload": self._reload,
            "revert": self._revert,
            "restore_draft": self._restore,
            "discard_draft": self._discard,
            "diff": self._diff,
            "select": self._select,
            "add_run": self._add_run,
            "remove_run": self._remove_run,
            "pose": self._pose,
            "detail": self._detail,
            "task": self._task,
            "cancel": self._cancel,
            "resume": self._resume,
            "start": self._start,
            "new": self._new,
            "open_recent": self._open_recent,
        }

    def do(self, tab: Tab, said: Said) -> None:
        """Execute a message and respond; `op` selects the command."""
        act = self._known.get(str(said.get("op")))
        if act is None:
            raise InvalidInput(f"The Studio does not know {show(said.get('op'))}.")
        act(tab, said)

    def _commit(self, made: Made, label: str) -> None:
        """Change the document and show it."""
        self._editor.commit(made, label)
        self._display.show_all()

    def _change(self, changes: Sequence[Change], label: str) -> None:
        """Change keys of the document and show it."""
        self._commit(self._editor.with_changes(changes), label)

    # The text and its file.

    def _undo(self, tab: Tab, said: Said) -> None:
        self._editor.undo()
        self._display.show_all()

    def _redo(self, tab: Tab, said: Said) -> None:
        self._editor.redo()
        self._display.show_all()

    def _save(self, tab: Tab, said: Said) -> None:
        """Write the job file; a job without a file becomes a download."""
        document, force, tell = self._editor.document, said.get("force") is True, self._display.tell
        if document.file is None:
            name = f"{document.data.get('name') or 'job'}.yaml"
            content = document.text.encode()
            number = self._display.tabs.keep_file(name, "application/yaml", content)
            tell(Frame("download", {"file": number, "name": name}), to=tab)
            return
        if document.changed_on_disk() and not force:
            sentence = (
                f"{document.file.name} was changed by another program since it was opened: "
                "overwrite it, or reload it."
            )
            tell(Frame("conflict", {"sentence": sentence, "diff": document.conflict()}), to=tab)
            return
        document.save(force=force)
        remember(document.file, None)
        tell(Frame("saved", {"file": str(document.file)}))
        self._display.show_document()

    def _reload(self, tab: Tab, said: Said) -> None:
        self._editor.reload()
        # Files that the job names may have changed, too.
        self._display.planner.forget_figures()
        self._display.show_all()

    def _revert(self, tab: Tab, said: Said) -> None:
        made = self._editor.of_text(self._editor.document.saved_text)
        self._commit(made, "go back to the saved job")

    def _restore(self, tab: Tab, said: Said) -> None:
        """Restore the draft of an earlier session."""
        document = self._editor.document
        self._editor.restore()
        if self._editor.document is document:
            self._display.show_all()
        else:
            self._display.open()

    def _discard(self, tab: Tab, said: Said) -> None:
        """Remove the draft of an earlier session."""
        self._editor.discard()
        self._display.show_document()

    def _diff(self, tab: Tab, said: Said) -> None:
        self._display.tell(Frame("diff", {"text": self._editor.document.diff()}), to=tab)

    # Other jobs.

    def _start(self, tab: Tab, said: Said) -> None:
        self._display.tell(start_frame(), to=tab)

    def _new(self, tab: Tab, said: Said) -> None:
        card, arm, editor = _word(said, "card"), _word(said, "arm"), self._editor
        before = editor.document
        editor.open(new_document(card, arm, editor.uploads, before))
        self._opened(before)

    def _open_recent(self, tab: Tab, said: Said) -> None:
        """Open a recent file or draft, in any folder."""
        known, editor = find_recent(_word(said, "id")), self._editor
        draft, cell = known.get("draft"), known.get("cell")
        file = FilePath(known["file"]) if draft is None else FilePath(draft.folder, draft.name)
        named, before = [file, *([FilePath(cell)] if cell else [])], editor.document
        with reading_below((file.parent, editor.uploads.root), named):
            if draft is None:
                editor.open(open_file(file, cell))
            else:
                editor.restore(draft)
        self._confine(named)
        self._opened(before)

    def _opened(self, before: Document) -> None:
        """Show the new document, and report where unsaved changes of the previous one are kept."""
        self._display.open()
        sentence = before.unsaved()
        if sentence is not None:
            self._display.tell(Frame("notice", {"sentence": sentence}))

    # Runs.

    def _select(self, tab: Tab, said: Said) -> None:
        self._editor.select(_word(said, "run"))
        self._display.show_all()

    def _add_run(self, tab: Tab, said: Said) -> None:
        name, like = _word(said, "name"), said.get("like", self._editor.run)
        self._change(add_run(self._editor.seen.data, name, like), f"add the run {name}")

    def _remove_run(self, tab: Tab, said: Said) -> None:
        name = _word(said, "name")
        self._change(remove_run(self._editor.seen.data, name), f"remove the run {name}")

    # Poses and tasks.

    def _pose(self, tab: Tab, said: Said) -> None:
        t, of = said.get("t"), str(said.get("of"))
        if isinstance(t, bool) or not isinstance(t, int | float):
            raise InvalidInput("A pose needs a time in seconds.")
        q = self._display.planner.pose(float(t), of)
        self._display.tell(Frame("pose", {"q": q, "t": t, "of": of}), to=tab)

    def _detail(self, tab: Tab, said: Said) -> None:
        """Draw the visible part of the picture with the resolution of the screen."""
        box = checks.check_numbers("box", said.get("box") or [], "m")
        if box.shape != (4,):
            raise InvalidInput("box has four numbers: least u and v, largest u and v.")
        px = max(
            checks.positive("px", said.get("px"), "m"), np.ptp(box.reshape(2, 2), 0).max() / WIDEST
        )
        detail = Detail(px * OF_A_PIXEL, box)
        self._display.planner.look(detail, lambda frame: self._display.tell(frame, to=tab), tab)

    def _task(self, tab: Tab, said: Said) -> None:
        options = said.get("options") or {}
        if not isinstance(options, dict):
            raise InvalidInput("The options of a task are a mapping.")
        id, task = _word(said, "id"), _word(said, "task")
        if task == "compare":
            options = {**options, "text": self._editor.document.before}
        self._display.planner.do(id, task, self._display.request(options))

    def _cancel(self, tab: Tab, said: Said) -> None:
        self._display.planner.cancel(_word(said, "id"))

    def _resume(self, tab: Tab, said: Said) -> None:
        self._display.planner.resume()


def _word(said: Said, name: str) -> str:
    """A required text of a message, at most LONGEST_NAME characters."""
    value = said.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= checks.LONGEST_NAME:
        raise InvalidInput(f"The message {said.get('op')} needs {name}, a short text.")
    return value
