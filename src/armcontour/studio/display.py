"""What pages see of the document that is edited: itself, its picture, and its exact figures."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from threading import RLock, Timer
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.errors import ArmContourError, InvalidInput
from armcontour.io.job_edits import key_in
from armcontour.studio.described import describe
from armcontour.studio.editor import Editor, Made
from armcontour.studio.exact import Asked, Exact, MakeLane
from armcontour.studio.lanes import FastLane
from armcontour.studio.preview import CONFIGURATION
from armcontour.studio.screen import Screen, Shown
from armcontour.studio.tabs import Tab, Tabs
from armcontour.studio.view import View
from armcontour.studio.wire import Frame

# How often to look whether the first plan is drawn [s]: what computes exact figures would take the
# processor from it.
SOON = 0.05
# Motions whose starts differ by more are in different configurations [rad].
SAME = 0.01


class Display:
    """Shows the document of an editor on pages, and what others compute of it.

    Args:
        editor: The editor.
        fast: Makes the lane of previews.
        slow: Makes the lane of everything else.
        rest: How long nothing changes before the exact figures are computed [s].

    Attributes:
        lock: Who changes the document holds it.
        tabs: The pages.
        screen: Plans and executes what is shown.
        exact: Computes exact figures and tasks.
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
        # One timer waits for the rest of all edits: to begin a thread for each takes long.
        self._rest, self._due = rest, 0.0
        self._timer: Timer | None = None
        # What is shown, with the edits of a gesture.
        self._made = Made({})
        # The revision whose preview has taken the configuration of its full run.
        self._followed = 0
        self._on_disk = ""
        self.screen = Screen(editor.previewer, self._tell_picture, fast)
        self.exact = Exact(self._tell_exact, slow)

    def close(self) -> None:
        """End all work."""
        self._stop_waiting()
        self.exact.close()
        self.screen.close()

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
        self.tell(frame, to=to)

    def show(
        self, made: Made | None = None, *, told: Frame | None = None, moving: bool = False
    ) -> None:
        """Show a state on all pages, and compute its exact figures when nothing changes.

        Args:
            made: What edits have made of the document; None for the document.
            told: A frame that follows.
            moving: Whether the next state is wanted soon.
        """
        editor = self.editor
        self._made = made = Made(editor.seen.data) if made is None else made
        handles = editor.seen.handles
        if handles is None:
            self.tell_refusal(editor.seen.error or InvalidInput("There is no job yet."))
            return
        self.screen.show(
            Shown(
                data=made.data,
                run=editor.run_of(made.data),
                view=View(handles.plane, handles.centre),
                rev=editor.rev,
                answers=self.tabs.answers,
                waypoints=np.array([x.uv for x in handles.waypoints]).reshape(-1, 2),
                told=told,
                moving=moving,
            )
        )
        self._due = time.monotonic() + self._rest
        if self._timer is None:
            self._wait(self._rest)

    def open(self) -> None:
        """Show another document, which the editor has opened."""
        # Of the document before; a document that cannot be shown has no rest.
        self._stop_waiting()
        self.screen.forget()
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
        self.tabs.tell(frame.stamped(rev=self.editor.rev), to=to)

    def tell_refusal(self, error: ArmContourError, *, dropped: bool = False) -> None:
        """Say that an edit is not possible.

        Args:
            error: Why.
            dropped: Whether it was to be made: then the document is shown as it is.
        """
        told = Frame(
            "refusal",
            {
                **{"tier": 1, "run": self.editor.run, "sentence": str(error)},
                **{"error": type(error).__name__, "exit": error.exit_code, "at": {}},
                **{"dropped": dropped, "key": key_in(str(error))},
            },
        )
        if not dropped:
            self.tell(told)
            return
        self.show_document()
        self.show(told=told)

    def _wait(self, seconds: float) -> None:
        """Look after a time whether nothing has changed meanwhile."""
        self._timer = Timer(seconds, self._at_rest)
        self._timer.daemon = True
        self._timer.start()

    def _stop_waiting(self) -> None:
        """Do not look any more whether nothing changes, until something is shown."""
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()

    def _at_rest(self) -> None:
        """If nothing has changed for a while, compute what takes longer."""
        with self.lock:
            if self._timer is None:
                return
            left = self._due - time.monotonic()
            if left > 0 or not self.screen.has_drawn:
                self._wait(max(left, SOON))
                return
            self._timer = None
            self.screen.rest()
            with contextlib.suppress(ArmContourError):
                request = self.request({})
                self.exact.ask(Asked(self.editor.rev, self.tabs.answers, request))

    def _tell_picture(self, frame: Frame, shown: Shown) -> bool:
        """Pass a frame of the screen on, unless the document has changed since."""
        if shown.rev != self.editor.rev:
            return False
        self.tabs.tell(frame.stamped(rev=shown.rev), answers=shown.answers)
        return True

    def _tell_exact(self, frame: Frame, asked: Asked | None) -> None:
        """Pass a frame of another process on; figures only of the present document."""
        if asked is None:
            self.tell(self._with_file(frame))
            return
        if asked.rev == self.editor.rev:
            self.tabs.tell(frame.stamped(rev=asked.rev), answers=asked.answers)
            if frame.kind == "figures" and frame.header.get("start") is not None:
                # Who calls here has locks of its own.
                Timer(0.0, self._follow, (asked.rev, frame.header["start"])).start()

    def _follow(self, rev: int, start: Any) -> None:
        """Show the configuration that the full run takes, if the preview has stayed in another."""
        with self.lock:
            planned = self.screen.planned
            if rev != self.editor.rev or rev == self._followed or planned is None:
                return
            if np.abs(planned.start - np.asarray(start)).max() > SAME:
                self._followed = rev
                if CONFIGURATION in planned.differs:
                    self.tell(Frame("notice", {"sentence": _other(planned.start, start)}))
                self.editor.previewer.keep_start(planned.job, np.asarray(start))
                self.show(self._made)

    def _with_file(self, frame: Frame) -> Frame:
        """The same frame; a file in it is kept for the pages to save."""
        if frame.kind != "result" or "content" not in frame.arrays:
            return frame
        header, content = frame.header, frame.arrays["content"].tobytes()
        number = self.tabs.keep_file(str(header["name"]), str(header["type"]), content)
        return Frame("result", {**header, "file": number})


def _other(old: npt.ArrayLike, new: npt.ArrayLike) -> str:
    """The sentence on a change that makes another configuration of the arm the fastest one."""
    before, after = (", ".join(f"{x:z.1f}" for x in np.degrees(q)) for q in (old, new))
    return (
        f"The arm is in another configuration now, in which the motion is faster: it starts at "
        f"{after} deg, and started at {before} deg before. `start` in the job file fixes one."
    )
