"""What pages see of the document that is edited: itself, its states, and what others compute."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from threading import RLock
from typing import Any

import numpy as np

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.files.job_edits import key_in
from armcontour.studio.described import describe
from armcontour.studio.editor import Editor, Made
from armcontour.studio.handles import is_blank
from armcontour.studio.lanes import FastLane
from armcontour.studio.picture import drawing_frame
from armcontour.studio.planner import MakeLane, Planner, State
from armcontour.studio.tabs import Tab, Tabs
from armcontour.studio.view import View
from armcontour.studio.wire import Frame


class Display:
    """Shows the document of an editor on pages.

    Args:
        editor: The editor.
        fast: As of `Planner`.
        slow: As of `Planner`.
        rest: As of `Planner`.

    Attributes:
        lock: Who changes the document holds it.
        tabs: The pages.
        planner: Plans and executes what is shown, and does tasks.
    """

    def __init__(
        self,
        editor: Editor,
        fast: Callable[[Callable[[Frame], None]], FastLane],
        slow: MakeLane,
        rest: float,
    ) -> None:
        self.editor = editor
        self.lock = RLock()
        self.tabs = Tabs()
        # What is shown, with the edits of a gesture.
        self._made = Made({})
        self._on_disk = ""
        self.planner = Planner(editor.previewer, self._tell_state, fast, slow, rest)

    def show_all(self) -> None:
        """Show the document and its run as they are now."""
        self.show_document()
        self.show()

    def show_document(self, to: Tab | None = None) -> None:
        """Tell what the document is now.

        Args:
            to: The page; by default all.
        """
        editor = self.editor
        self._on_disk = editor.document.on_disk()
        frame = describe(editor.document, editor.seen, editor.run, draft=editor.draft)
        logs = list(editor.uploads.logs)
        self.tell(frame.stamped(id=editor.id, logs=logs), to=to)

    def show(self, made: Made | None = None, *, moving: bool = False) -> None:
        """Show a state on all pages.

        Args:
            made: What edits have made of the document; None for the document.
            moving: Whether the next state is wanted soon.
        """
        editor = self.editor
        self._made = made = Made(editor.seen.data) if made is None else made
        handles = editor.seen.handles
        if handles is None:
            self.tell_refusal(editor.seen.error or InvalidInput("There is no job yet."))
            return
        view = View(handles.plane, handles.centre)
        if is_blank(made.data):
            self.planner.forget()
            self.tell(drawing_frame(None, view, run=editor.run))
            return
        self.planner.show(
            State(
                data=made.data,
                run=editor.run_of(made.data),
                view=view,
                document=editor.id,
                rev=editor.rev,
                answers=self.tabs.answers,
                request=partial(editor.request, made, {}),
                waypoints=np.array([x.uv for x in handles.waypoints]).reshape(-1, 2),
                moving=moving,
            )
        )

    def open(self) -> None:
        """Show another document, which the editor has opened."""
        self.planner.forget()
        self.show_all()

    def look(self) -> None:
        """See whether the file has changed, and tell the pages if so."""
        if self._on_disk and self.editor.document.on_disk() != self._on_disk:
            self.show_document()

    def request(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """What another process needs to know to work on what is shown.

        Args:
            options: Options of the work.
        """
        return self.editor.request(self._made, options)

    def tell(self, frame: Frame, to: Tab | None = None) -> None:
        """Tell something of the present document.

        Args:
            frame: What is told.
            to: The page; by default all.
        """
        self.tabs.tell(frame.stamped(rev=self.editor.rev, document=self.editor.id), to=to)

    def tell_refusal(self, error: ArmContourError, *, dropped: bool = False) -> None:
        """Say that an edit is not possible.

        Args:
            error: Why.
            dropped: Whether it was to be made: then the document is shown as it is.
        """
        if dropped:
            self.show_document()
        told = {"tier": 1, "run": self.editor.run, "sentence": str(error), "at": {}}
        about = {"error": type(error).__name__, "exit": error.exit_code, "dropped": dropped}
        self.tell(Frame("refusal", {**told, **about, "key": key_in(str(error))}))
        if dropped:
            self.show()

    def _tell_state(self, frame: Frame, state: State | None) -> bool:
        """Pass a frame of the planner on, unless the document has changed since."""
        if state is None:
            self.tell(self._with_file(frame))
            return True
        if state.rev != self.editor.rev or is_blank(self._made.data):
            return False
        about = {"rev": state.rev, "document": state.document}
        self.tabs.tell(frame.stamped(**about), answers=state.answers)
        return True

    def _with_file(self, frame: Frame) -> Frame:
        """The same frame; a file in it is kept for the pages to save."""
        if frame.kind != "result" or "content" not in frame.arrays:
            return frame
        header, content = frame.header, frame.arrays["content"].tobytes()
        number = self.tabs.keep_file(str(header["name"]), str(header["type"]), content)
        return Frame("result", {**header, "file": number})
