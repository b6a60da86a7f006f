"""Session of the Studio: a document, the pages that show it, and execution of their messages."""

from __future__ import annotations

import contextlib
import json
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path as FilePath

from armcontour.core.compilation import compile_for_run
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.progress import Progress
from armcontour.studio.commands import Commands
from armcontour.studio.document import Document
from armcontour.studio.drafts import running_studio
from armcontour.studio.editor import Editor
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.pages import Display, Page, PageMessage
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.scheduler import SchedulerOptions


class Session:
    """A document and the pages that show it; executes messages of the pages one at a time."""

    def __init__(
        self,
        document: Document,
        previewer: CoarsePlanner,
        *,
        scheduling: SchedulerOptions | None = None,
        progress: Progress = lambda step: None,
    ) -> None:
        self.editor = Editor(document, previewer)
        self.display = Display(self.editor, scheduling or SchedulerOptions())
        self._commands = Commands(self.display, self.confine)
        self._progress = progress
        self._ending = contextlib.ExitStack()
        self._ending.enter_context(running_studio())

    @property
    def document(self) -> Document:
        """The edited document."""
        return self.editor.document

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
            with self.display.lock:
                self.display.show_all()
            if self.editor.state.job is not None:
                self.display.scheduler.wait()

    def join(self, page: Page) -> None:
        """Add a page."""
        self.display.pages.join(page)

    def leave(self, page: Page) -> None:
        """Remove a page and discard its gesture."""
        self.display.pages.leave(page)
        with self.display.lock:
            self._commands.gestures.leave(page)

    def receive(self, page: Page, message: PageMessage) -> None:
        """Execute a message of a page; errors are reported to the page."""
        with self.display.lock:
            if not self.display.pages.record(page, message):
                return
            try:
                _refuse_surrogates(message)
                self._commands.execute(page, message)
            except ArmContourError as error:
                self._fail(page, message, error)
            except Exception as error:
                # An internal error: the terminal shows the traceback, and the page continues.
                traceback.print_exc(file=sys.stderr)
                sentence = f"Internal error ({type(error).__name__}): {error}"
                self._fail(page, message, ArmContourError(sentence))

    def look(self) -> None:
        """Report to the pages if the job file has changed on disk."""
        with self.display.lock:
            self.display.look()

    def open_upload(
        self, name: str, content: bytes, cell: str | None, unknown: str = "", log: bool = False
    ) -> str:
        """Open an uploaded file, or store it as a log; returns the name of the file or log."""
        with self.display.lock:
            editor = self.editor
            if log:
                name = editor.uploads.keep_log(name, content)
                self.display.show_document()
                return name
            opened = editor.uploads.open(name, content, cell, editor.document, unknown)
            if isinstance(opened, Document):
                editor.open(opened)
                self.display.open()
            else:
                editor.commit(editor.revise_keys(opened), f"open {name}")
                self.display.show_all()
        return name

    def close(self) -> None:
        """End all work and delete the uploads of the session."""
        self.display.scheduler.close()
        self._ending.close()
        self.editor.uploads.close()

    def _fail(self, page: Page, message: PageMessage, error: ArmContourError) -> None:
        """Report the error of a message; errors of edits are sent to all pages as a refusal."""
        if message.get("op") == "edit":
            self.display.send_refusal(error, dropped=bool(message.get("final")))
            return
        header = {"id": message.get("id"), "op": message.get("op"), "sentence": str(error)}
        self.display.send(PageFrame("failed", header), to=page)


def _refuse_surrogates(message: PageMessage) -> None:
    """Raise InvalidInput if a text cannot be encoded as UTF-8 for files and frames."""
    try:
        json.dumps(message, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidInput(
            "The text has an incomplete character (a lone surrogate). Type the character again."
        ) from None
