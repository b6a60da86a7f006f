"""One document on pages: what they say, one after the other, and what all of them are told.

Pages that show the same document are its tabs. An edit by one of them is shown by all. An edit of a
document that has changed since its gesture began is not made, but answered with the new document.
"""

from __future__ import annotations

import contextlib
import json
import sys
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path as FilePath

from armcontour.core.compilation import compile_for_run
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.progress import Progress
from armcontour.studio.acts import Acts
from armcontour.studio.display import Display
from armcontour.studio.document import Document
from armcontour.studio.editor import Editor
from armcontour.studio.lanes import FastLane, SlowLane
from armcontour.studio.planner import MakeLane
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.tabs import Said, Tab
from armcontour.studio.wire import Frame

# How long nothing changes before the exact figures are computed [s].
REST = 0.15


class Session:
    """A document and the pages that show it.

    Args:
        document: The document.
        previewer: Plans and executes it.
        trusted: Files of arms that may be programs, as the user has named them.
        fast: Makes the lane of previews.
        slow: Makes the lane of everything else.
        rest: How long nothing changes before the exact figures are computed [s].
        told: Called with the progress of the start.

    Attributes:
        editor: The document that is edited.
        display: What pages see of it.
    """

    def __init__(
        self,
        document: Document,
        previewer: CoarsePlanner,
        *,
        trusted: Iterable[FilePath] = (),
        fast: Callable[[Callable[[Frame], None]], FastLane] = FastLane,
        slow: MakeLane = SlowLane,
        rest: float = REST,
        told: Progress = lambda step: None,
    ) -> None:
        self.editor = Editor(document, previewer, trusted)
        self.display = Display(self.editor, fast, slow, rest)
        self._acts = Acts(self.display, self.confine)
        self._told = told
        self._ending = contextlib.ExitStack()

    @property
    def document(self) -> Document:
        """The document."""
        return self.editor.document

    def confine(self, named: Iterable[FilePath]) -> None:
        """Read files in the folder of the job from now on, and what it has named before.

        Args:
            named: Files elsewhere that may be read.
        """
        self.editor.named = tuple(named)
        reading = reading_below(self.editor.folders, self.editor.named)
        self._ending.enter_context(reading)

    def begin(self) -> None:
        """Show the document for the first time; returns when that is done."""
        handles = self.editor.seen.handles
        job = None if handles is None else handles.job
        with contextlib.ExitStack() as compiling:
            if job is not None:
                compiling.enter_context(compile_for_run(job.arm.dimension, self._told))
            with self.display.lock:
                self.display.show_all()
            if self.editor.seen.job is not None:
                self.display.planner.wait()

    def join(self, tab: Tab) -> None:
        """A page is open: it gets what the others see."""
        self.display.tabs.join(tab)

    def leave(self, tab: Tab) -> None:
        """A page is closed; what it has not finished is dropped."""
        self.display.tabs.leave(tab)
        with self.display.lock:
            self._acts.gestures.leave(tab)

    def receive(self, tab: Tab, said: Said) -> None:
        """Do what a page says, and answer."""
        with self.display.lock:
            if not self.display.tabs.hear(tab, said):
                return
            try:
                _refuse_surrogates(said)
                self._acts.do(tab, said)
            except ArmContourError as error:
                self._fail(tab, said, error)
            except Exception as error:
                # The page goes on; the terminal shows what went wrong.
                traceback.print_exc(file=sys.stderr)
                sentence = f"This failed: {type(error).__name__}: {error}"
                self._fail(tab, said, ArmContourError(sentence))

    def look(self) -> None:
        """See whether the file has changed, and tell the pages if so."""
        with self.display.lock:
            self.display.look()

    def open_upload(
        self, name: str, content: bytes, cell: str | None, unknown: str = "", log: bool = False
    ) -> str:
        """Open a file that a page has sent: a job, a drawing for the document's arm, or a log.

        Args:
            name: Name of the file.
            content: Its bytes.
            cell: For a drawing, the built-in cell to open it in; None keeps the document's arm.
            unknown: As of `Uploads.open`.
            log: Whether it is a log of the robot, which is kept for tasks.

        Returns:
            The name by which it is kept.

        Raises:
            InvalidInput: A file that cannot be opened.
        """
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
                editor.commit(editor.with_changes(opened), f"open {name}")
                self.display.show_all()
        return name

    def close(self) -> None:
        """End all work."""
        self.display.planner.close()
        self._ending.close()
        self.editor.uploads.close()

    def _fail(self, tab: Tab, said: Said, error: ArmContourError) -> None:
        """Tell a page why its message was not followed."""
        if said.get("op") == "edit":
            self.display.tell_refusal(error, dropped=bool(said.get("final")))
            return
        header = {"id": said.get("id"), "op": said.get("op"), "sentence": str(error)}
        self.display.tell(Frame("failed", header), to=tab)


def _refuse_surrogates(said: Said) -> None:
    """Refuse text that UTF-8 cannot encode: no file and no frame could hold it.

    Raises:
        InvalidInput: There is such text.
    """
    try:
        json.dumps(said, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidInput(
            "The message has half of a character (a lone surrogate): type the character again."
        ) from None
