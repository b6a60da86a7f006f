"""Session of the Studio: a document, the pages that show it, and the commands of the pages."""

from __future__ import annotations

import contextlib
import json
import sys
import traceback
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path as FilePath
from threading import RLock
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.compilation import compile_for_run
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.progress import Progress
from armcontour.core.source_file import fingerprint
from armcontour.core.text import show
from armcontour.files.file_keys import in_si
from armcontour.files.job_file import cell_names
from armcontour.files.job_model import PathModel
from armcontour.report.arm_frame import arm_frame
from armcontour.report.message_frame import MessageFrame
from armcontour.report.view import View
from armcontour.studio.certified_plans import CertifiedPlan, CertifiedPlans
from armcontour.studio.description import document_frame, label_of
from armcontour.studio.document import CHANGED, Document
from armcontour.studio.editor import Editor, Revision
from armcontour.studio.handles import drawing_view, is_blank
from armcontour.studio.model_reader import (
    ModelReader,
    ModelSource,
    ReadModel,
    is_model_file,
    selection_header,
)
from armcontour.studio.opening import new_document, open_file
from armcontour.studio.pages import Page, PageMessage, Pages
from armcontour.studio.plan_frames import drawing_frame, refusal_header
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.recent import listed_recent
from armcontour.studio.results import Origins, TaskResults
from armcontour.studio.scheduler import DocumentState, Scheduler, SchedulerOptions
from armcontour.studio.segments_frame import segments_frame

# Maximum number of edits in a message, because the job may be read again for each edit.
MAX_EDITS = 100
# Task that plans runs which are not shown.
COMPARE = "compare"


class Session:
    """A document and the pages that show it; executes messages of the pages one at a time.

    Args:
        document: The document that is shown first.
        previewer: Planner of previews.
        scheduling: Workers and waiting times; None for the usual ones.
        progress: Callback for the progress of the start.
    """

    def __init__(
        self,
        document: Document,
        previewer: CoarsePlanner,
        *,
        scheduling: SchedulerOptions | None = None,
        progress: Progress = lambda step: None,
    ) -> None:
        self.editor = Editor(document, previewer)
        self.pages = Pages()
        self.lock = RLock()
        self.scheduler = Scheduler(
            previewer, self._send_state_frame, scheduling or SchedulerOptions()
        )
        # Shown revision, including the edits of an active gesture.
        self._revision = Revision({})
        # State of the file when the document was shown last; empty before.
        self._on_disk = ""
        # Gesture of each page, a drag or similar interaction: its number, and the revision of the
        # document at its start. Each of its messages contains all edits since its start.
        self._gestures: dict[Page, tuple[Any, int]] = {}
        self._origins = Origins()
        self._results = TaskResults(self.send)
        self._certified = CertifiedPlans()
        self._progress = progress
        # Identity of the document and drawing whose plan was requested last
        self._shown_id = ""
        self._model_reader = ModelReader(self._take_model)
        # Frame and source of the model that is shown.
        self._model_frame: MessageFrame | None = None
        self._model_source: ModelSource | None = None
        # Identity of the document with which the pages have received it.
        self._model_shown_in = ""
        self._ending = contextlib.ExitStack()

    def confine(self, named: Iterable[FilePath]) -> None:
        """Restrict reading to the folders of job and uploads, and to files named by the user."""
        self.editor.named = tuple(named)
        reading = reading_below(self.editor.folders, self.editor.named)
        self._ending.enter_context(reading)

    def begin(self) -> None:
        """Show the document for the first time; returns after the first picture was sent."""
        handles = self.editor.state.handles
        job = None if handles is None else handles.job
        with contextlib.ExitStack() as compiling:
            if job is not None:
                compiling.enter_context(compile_for_run(job.arm.dimension, self._progress))
            with self.lock:
                self._show_all()
            if self.editor.state.job is not None:
                self.scheduler.wait()

    def join(self, page: Page) -> None:
        """Add a page, and show it the document if it was shown before."""
        with self.lock:
            self.pages.join(page)
            if self._on_disk:
                self.scheduler.show_again()
                self._show_document()
                if self._model_frame is not None:
                    self.send(self._model_frame, to=page)
                self._show(self._revision)
                self._results.show(partial(self.send, to=page))

    def leave(self, page: Page) -> None:
        """Remove a page and discard its gesture."""
        with self.lock:
            self.pages.leave(page)
            if self._gestures.pop(page, None) is not None:
                self._show()

    def receive(self, page: Page, message: PageMessage) -> None:
        """Execute a message of a page; errors are reported to the page."""
        with self.lock:
            if not self.pages.record(page, message):
                return
            try:
                _refuse_surrogates(message)
                command = getattr(self, f"do_{message.get('op')}", None)
                if command is None:
                    raise InvalidInput(f"The Studio has no command {show(message.get('op'))}.")
                command(page, message)
            except ArmContourError as error:
                self._fail(page, message, error)
            except Exception as error:
                # An internal error: the terminal shows the traceback, and the page continues.
                traceback.print_exc(file=sys.stderr)
                sentence = f"Internal error ({type(error).__name__}): {error}"
                self._fail(page, message, ArmContourError(sentence))

    def look(self) -> None:
        """Report to the pages if the job file has changed on disk."""
        with self.lock:
            if self._on_disk and self.editor.document.on_disk() != self._on_disk:
                self._show_document()

    def open_upload(
        self,
        name: str,
        content: bytes,
        cell: str | None,
        unknown: str = "",
        *,
        log: bool = False,
        mesh: bool = False,
    ) -> str:
        """Open an uploaded file, or store it as a log or as a mesh; returns its name."""
        with self.lock:
            editor = self.editor
            if mesh:
                return editor.uploads.keep_mesh(name, content, editor.folder)
            if log:
                name = editor.uploads.keep_log(name, content)
                self._show_document()
                return name
            opened = editor.uploads.open(
                name, content, cell, editor.folder, unknown, editor.state.data
            )
            if isinstance(opened, Document):
                self._open(opened)
            else:
                self._commit(self.editor.revise_keys(opened), f"open {name}")
        return name

    def close(self) -> None:
        """End all work and delete the uploads of the session."""
        self.scheduler.close()
        self._ending.close()
        self.editor.uploads.close()

    def wait_for_model(self) -> None:
        """Wait until the CAD model of the document, if it has one, was read and shown."""
        self._model_reader.wait()

    # Commands of the pages: the method `do_NAME` executes messages with the `op` NAME.

    def do_edit(self, page: Page, message: PageMessage) -> None:
        """Preview the edits of a gesture; commit them if the message is final."""
        gesture = message.get("gesture")
        final = bool(message.get("final"))
        held = self._gestures.pop(page, None)
        rev = held[1] if held is not None and held[0] == gesture else self.editor.rev
        if not final:
            self._gestures[page] = gesture, rev
        if rev != self.editor.rev:
            if final:
                self._show_document(page)
                sentence = "The job was changed elsewhere during the edit, so it was discarded."
                self.send(MessageFrame("notice", {"sentence": sentence}), to=page)
            return
        edits = _read_edits(message)
        revision = self.editor.revise(edits)
        if not final:
            self._show(revision)
            return
        state = self.editor.state
        label = label_of(edits, state.data, revision.data, state.job)
        # The edits that follow are for the new run, so it is shown.
        added = [str(x["name"]) for x in edits if x.get("do") == "add_run"]
        self.editor.commit(revision, label, run=added[-1] if added else "")
        # A measured frame also applies to the job that has it.
        self._origins.renew(message.get("result"), revision.data)
        self._show_all()

    def do_cancel_gesture(self, page: Page, message: PageMessage) -> None:
        """Discard the gesture of a page and show the document without its edits."""
        self._gestures.pop(page, None)
        self._show()

    def do_undo(self, page: Page, message: PageMessage) -> None:
        """Revert the last change; with `to`, undo or redo until this number of steps is made."""
        document = self.editor.document
        to = message.get("to")
        undo = document.undo if to is None else partial(document.go_to_step, to)
        self.editor.change(undo)
        self._show_all()

    def do_redo(self, page: Page, message: PageMessage) -> None:
        """Repeat the change that was undone last."""
        self.editor.change(self.editor.document.redo)
        self._show_all()

    def do_save(self, page: Page, message: PageMessage) -> None:
        """Write the job file; a job without a file becomes a download."""
        document = self.editor.document
        force = message.get("force") is True
        if document.file is None:
            name = f"{document.data.get('name') or 'job'}.yaml"
            number = self.pages.keep_file(name, document.text.encode())
            self.send(MessageFrame("download", {"file": number, "name": name}), to=page)
        elif document.on_disk() == CHANGED and not force:
            sentence = (
                f"Another program has changed {document.file.name} since it was opened. Overwrite "
                "or reload the file."
            )
            self.send(MessageFrame("conflict", {"sentence": sentence}), to=page)
        else:
            document.save(force=force)
            self.send(MessageFrame("saved", {"file": str(document.file)}))
            self._show_document()

    def do_reload(self, page: Page, message: PageMessage) -> None:
        """Read the file again."""
        # The files that the job names may have changed too.
        self.editor.read_again()
        self._origins.read_again()
        self.editor.change(self.editor.document.reload)
        self._show_all()

    def do_restore_draft(self, page: Page, message: PageMessage) -> None:
        """Restore the draft of an earlier session."""
        self.editor.restore()
        self._show_all()

    def do_discard_draft(self, page: Page, message: PageMessage) -> None:
        """Delete the draft of an earlier session."""
        self.editor.document.drop_earlier_draft()
        self._show_document()

    def do_start(self, page: Page, message: PageMessage) -> None:
        """Show the start page with the built-in arms and the recent documents."""
        recent = [
            {"id": x.id, "name": x.name, "where": x.where}
            for x in listed_recent()
            if x.id != self.editor.document.id
        ]
        self.send(MessageFrame("start", {"arms": cell_names(), "recent": recent}), to=page)

    def do_new(self, page: Page, message: PageMessage) -> None:
        """Open the job of a start-page card."""
        card, arm = (_required_text(message, name) for name in ("card", "arm"))
        self._open(new_document(card, arm, self.editor.uploads, self.editor.folder))

    def do_open_recent(self, page: Page, message: PageMessage) -> None:
        """Open a recent document, which may be in any folder."""
        id = _required_text(message, "id")
        entry = next((x for x in listed_recent() if x.id == id), None)
        if entry is None:
            raise InvalidInput("This recent file or draft no longer exists.")
        folder = FilePath(entry.folder)
        named = [FilePath(x) for x in (entry.file, entry.cell) if x is not None]
        with reading_below((folder, self.editor.uploads.root), named):
            if entry.file is not None:
                document = open_file(FilePath(entry.file), entry.cell)
            else:
                document = Document(entry.opened, source=entry.name, folder=folder)
            if entry.text is not None:
                # The user chose to continue this draft.
                document.earlier_draft = entry
                document.chosen_run = entry.run
            before = self.editor.document
            self.editor.open(document)
            if entry.text is not None:
                self.editor.restore()
        self.confine(named)
        self._show_opened(before)

    def do_select(self, page: Page, message: PageMessage) -> None:
        """Show another run."""
        self.editor.select(_required_text(message, "run"))
        self._show_all()

    def do_task(self, page: Page, message: PageMessage) -> None:
        """Start a task in the task process, with the edits of the active gesture.

        With the option `certificate`, the identifier of a certificate, its plan is exported.
        """
        options = message.get("options") or {}
        if not isinstance(options, dict):
            raise InvalidInput("The options of a task must be a mapping.")
        id = _required_text(message, "id")
        task = _required_text(message, "task")
        self.scheduler.check_task(id, task)
        request = self.editor.request(self._revision, options)
        data = self._revision.data
        files = self.editor.sources(request["text"])
        plan = b""
        if "certificate" in options:
            certified = self._current_plan(options["certificate"])
            request["run"] = certified.run
            plan = certified.data
        origin = self._origins.keep(id, task, data, request["run"], files)
        # Figures of runs belong to the table of runs.
        if task != COMPARE:
            self._results.begin(id, task, options, self._origins.made(id))
        self.scheduler.start_task(id, task, {**request, "origin": origin, "plan": plan})

    def do_show_certified(self, page: Page, message: PageMessage) -> None:
        """Show the plan of a certificate instead of that of the run, until the next edit."""
        certified = self._current_plan(_required_text(message, "id"))
        if certified.run != self.editor.run:
            self.editor.select(certified.run)
            self._show_document()
        self._show(certified=certified)

    def do_show_run(self, page: Page, message: PageMessage) -> None:
        """Show the plan of the run again, after that of a certificate."""
        self._show()

    def do_segments(self, page: Page, message: PageMessage) -> None:
        """Send the segments of the drawing to the page, which measures them."""
        job = self.editor.state.job
        self.send(segments_frame(None if job is None else job.program), to=page)

    def do_cancel(self, page: Page, message: PageMessage) -> None:
        """Cancel a task."""
        self.scheduler.cancel(_required_text(message, "id"))

    # Changes of the document, and frames for the pages

    def _commit(self, revision: Revision, label: str) -> None:
        """Change the document and show it."""
        self.editor.commit(revision, label)
        self._show_all()

    def _open(self, document: Document) -> None:
        """Open another document and show it."""
        before = self.editor.document
        self.editor.open(document)
        self._show_opened(before)

    def _show_opened(self, before: Document) -> None:
        """Show the new document; report that unsaved changes of the previous one are in a draft."""
        self.scheduler.forget()
        self._origins.clear()
        self._results.clear()
        self._certified.clear()
        self._show_all()
        sentence = before.unsaved()
        if sentence is not None:
            self.send(MessageFrame("notice", {"sentence": sentence}))

    def _show_all(self) -> None:
        """Send the frame `document`, then plan and show the run."""
        self._show_document()
        self._show()

    def _show_document(self, to: Page | None = None) -> None:
        """Send the frame `document` to one page or to all."""
        editor = self.editor
        self._on_disk = editor.document.on_disk()
        self._request_model()
        frame = document_frame(editor.document, editor.state, editor.run)
        facts = {
            "id": editor.id,
            "logs": list(editor.uploads.logs),
            "model": self._model_header(),
            "hash": fingerprint(editor.document.text.encode()),
            # What has changed since each result was made, by identifier of its task.
            "outdated": self._origins.changes_until(editor.state.data),
        }
        self.send(frame.stamped(**facts), to=to)
        if self._model_frame is not None and self._model_shown_in != editor.id:
            # A page forgets the model when another document is opened.
            self._model_shown_in = editor.id
            self.send(self._model_frame)

    def _current_plan(self, id: Any) -> CertifiedPlan:
        """Return the plan of a certificate; raises InvalidInput if the job has changed since."""
        certified = self._certified.find(id)
        changed = self._origins.changes_until(self.editor.state.data).get(certified.id)
        if changed:
            raise InvalidInput(
                f"The plan of this certificate belongs to an earlier state of the job. Since then: "
                f"{', '.join(changed)}. Certify again."
            )
        return certified

    def _request_model(self) -> None:
        """Request the CAD model of the document, if it is not the one that is shown."""
        source = ModelSource.of_path(self.editor.state.data.get("path"), self.editor.folder)
        self._model_reader.request(source)
        if self._model_frame is not None and source != self._model_source:
            self.editor.picker = None
            self._model_frame = None

    def _take_model(self, read: ReadModel) -> None:
        """Show a model that was read."""
        with self.lock:
            if not self._model_reader.is_current(read.source):
                return
            self._model_source = read.source
            self._model_frame = read.frame
            self.editor.picker = read.picker
            self._model_shown_in = ""
            self._show_document()

    def _model_header(self) -> dict[str, Any] | None:
        """Describe place and selected edges of the CAD model; None without a model."""
        editor = self.editor
        handles = editor.state.handles
        path = editor.state.data.get("path")
        if handles is None or not isinstance(path, Mapping) or not is_model_file(path.get("file")):
            return None
        rules = editor.edge_rules(editor.state.data)
        scale = in_si(path, PathModel).get("scale", 1.0)
        axis = None
        with contextlib.suppress(InvalidInput):
            axis = editor.previewer.tool_axis(editor.state.data)
        return selection_header(editor.picker, rules, handles.frame, scale, axis)

    def _show(
        self, revision: Revision | None = None, *, certified: CertifiedPlan | None = None
    ) -> None:
        """Plan and show a revision, by default the document; or the plan of a certificate."""
        editor = self.editor
        self._revision = revision = Revision(editor.state.data) if revision is None else revision
        handles = editor.state.handles
        if handles is None:
            self._send_refusal(editor.state.error or InvalidInput("The job is not valid yet."))
            return
        view = View(handles.plane, handles.centre)
        if is_blank(revision.data):
            self.scheduler.forget()
            self.send(drawing_frame(None, view, run=editor.run))
            self.send(arm_frame(handles.job))
            return
        if editor.id != self._shown_id:
            # A page forgets arm and path when the drawing is replaced, even within the same job.
            self._shown_id = editor.id
            self.scheduler.show_again()
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
                certified=certified,
            )
        )

    def send(self, frame: MessageFrame, to: Page | None = None) -> None:
        """Send a frame of the current document to one page or to all."""
        self.pages.send(frame.stamped(rev=self.editor.rev, document=self.editor.id), to=to)

    def _send_refusal(self, error: ArmContourError, *, dropped: bool = False) -> None:
        """Send an error to all pages; `dropped`: the edit was discarded, so show the document."""
        if dropped:
            self._show_document()
        header = refusal_header(error, None, tier=1, run=self.editor.run)
        self.send(MessageFrame("refusal", {**header, "dropped": dropped}))
        if dropped:
            self._show()

    def _send_state_frame(self, frame: MessageFrame, state: DocumentState | None) -> bool:
        """Send a frame of the scheduler; False if the document has changed since its request."""
        if state is None:
            frame = self._certified.take(frame)
            made = self._origins.made(frame.header.get("id"))
            self._results.take(self._with_file(frame if made is None else frame.stamped(made=made)))
            return True
        if state.rev != self.editor.rev or is_blank(self._revision.data):
            return False
        about = {"rev": state.rev, "document": state.document}
        self.pages.send(frame.stamped(**about), answers=state.answers)
        return True

    def _with_file(self, frame: MessageFrame) -> MessageFrame:
        """Store the file of a frame for download, and replace its content by its identifier."""
        if frame.kind != "result" or "content" not in frame.arrays:
            return frame
        header = frame.header
        content = frame.arrays["content"].tobytes()
        number = self.pages.keep_file(str(header["name"]), content)
        return MessageFrame("result", {**header, "file": number})

    def _fail(self, page: Page, message: PageMessage, error: ArmContourError) -> None:
        """Report the error of a message; errors of edits are sent to all pages as a refusal."""
        if message.get("op") == "edit":
            self._send_refusal(error, dropped=bool(message.get("final")))
            return
        header = {"id": message.get("id"), "op": message.get("op"), "sentence": str(error)}
        self.send(MessageFrame("failed", header), to=page)


def outline_frame(data: Mapping[str, Any], previewer: CoarsePlanner) -> MessageFrame | None:
    """Make the outline of a long drawing, shown until its job is read; None for other paths."""
    drawing = previewer.long_drawing(data)
    return None if drawing is None else drawing_frame(drawing[0], drawing_view(*drawing))


def _read_edits(message: PageMessage) -> list[Mapping[str, Any]]:
    """Read a message's edits: a list of 1 to MAX_EDITS mappings."""
    edits: Any = message.get("edits")
    is_list = isinstance(edits, list) and all(isinstance(x, dict) for x in edits)
    if not is_list or not 0 < len(edits) <= MAX_EDITS:
        raise InvalidInput(
            f"The message edit requires `edits`, a list of 1 to {MAX_EDITS} mappings."
        )
    return list(edits)


def _required_text(message: PageMessage, name: str) -> str:
    """Read a required key of a message: text of 1 to LONGEST_NAME characters."""
    value = message.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= checks.LONGEST_NAME:
        raise InvalidInput(
            f"The message {message.get('op')} requires `{name}`, a text of 1 to "
            f"{checks.LONGEST_NAME} characters."
        )
    return value


def _refuse_surrogates(message: PageMessage) -> None:
    """Raise InvalidInput if a text cannot be encoded as UTF-8 for files and frames."""
    try:
        json.dumps(message, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidInput(
            "The text has an incomplete character (a lone surrogate). Type the character again."
        ) from None
