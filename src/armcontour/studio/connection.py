"""Connections of pages to the session; the server accepts pages before the session exists."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.core.errors import ArmContourError
from armcontour.core.file_access import listen_to_reading
from armcontour.core.progress import Step, TimeLeft
from armcontour.studio.access_control import Send

if TYPE_CHECKING:
    from armcontour.studio.pages import PageMessage
    from armcontour.studio.scheduler import TaskWorkerFactory
    from armcontour.studio.session import Session


# Task name in the progress frames during the start.
START = "start"
# Built-in cell of the empty plane that the Studio shows if it is started without a file.
DEFAULT_CELL = "ur5e"


class OpenPage:
    """A page with an open websocket; any thread may call `send`."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        # Queued messages for the page by replacement key, oldest first.
        self._waiting: dict[object, bytes] = {}

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Queue a message; it replaces a queued message with the same `replaces`."""
        with self._lock:
            key = object() if replaces is None else replaces
            self._waiting.pop(key, None)
            self._waiting[key] = data
        # The event loop is closed when the server shuts down.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._news.set)

    async def write(self, send: Send) -> None:
        """Send queued messages until the task is cancelled."""
        while True:
            await self._news.wait()
            self._news.clear()
            while (data := self._pop()) is not None:
                await send({"type": "websocket.send", "bytes": data})

    def _pop(self) -> bytes | None:
        """Remove the oldest message from the queue and return it; None if the queue is empty."""
        with self._lock:
            key = next(iter(self._waiting), None)
            return None if key is None else self._waiting.pop(key)


class SessionHost:
    """Creates the session; pages that open earlier join it later.

    Args:
        make: Function that creates the session, and sends frames of the start by its argument.
    """

    def __init__(self, make: Callable[[Callable[..., None]], Session]) -> None:
        self._make = make
        self._lock = threading.Lock()
        # Newest frames of the start, by what they replace.
        self._starting: dict[str, bytes] = {}
        # Function that stops the server; assigned when the server runs.
        self.stop: Callable[[], None] = lambda: None
        self.pages: list[OpenPage] = []
        self.session: Session | None = None
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Create the session in the calling thread; a failure stops the server."""
        try:
            session = self._make(self._broadcast)
            with self._lock:
                self.session = session
                self._starting.clear()
                for page in self.pages:
                    session.join(page)
            session.begin()
            self._broadcast(_start_frame({"state": "done"}))
            with self._lock:
                self._starting.clear()
        except BaseException as error:
            self.failure = error
            self.stop()

    def join(self, page: OpenPage) -> None:
        """Add a page."""
        with self._lock:
            self.pages.append(page)
            if self.session is not None:
                self.session.join(page)
            for key, data in self._starting.items():
                page.send(data, key)

    def receive(self, page: OpenPage, message: PageMessage) -> None:
        """Pass a message to the session; a page has no commands before the session exists."""
        if self.session is not None:
            self.session.receive(page, message)

    def leave(self, page: OpenPage) -> None:
        """Remove a page."""
        with self._lock:
            self.pages.remove(page)
            if self.session is not None:
                self.session.leave(page)

    def _broadcast(self, data: bytes, key: str = START) -> None:
        """Send a frame of the start to all pages, also to those that join later."""
        with self._lock:
            # The progress goes on after the session was created.
            if self.session is None or key == START:
                self._starting[key] = data
            for page in self.pages:
                page.send(data, key)


def open_session(
    file: FilePath | None,
    *,
    cell: str | None = None,
    send: Callable[..., None] = lambda data, key=START: None,
    task_worker: TaskWorkerFactory | None = None,
) -> Session:
    """Open a job file, a drawing in a cell, or an empty plane; `Session.begin` shows it."""
    time_left = TimeLeft(time.monotonic)

    def report(step: Step) -> None:
        # The parts of the compilation are steps of one name each, but take their time together.
        left = time_left.after(Step(step.names[:1], step.done))
        times = {"left": left, "spent": time_left.spent}
        send(_start_frame({"steps": list(step.names), "share": step.done, **times}))

    report(Step(("loading armcontour",)))
    from armcontour.studio.opening import blank_document, open_file
    from armcontour.studio.preview import CoarsePlanner
    from armcontour.studio.scheduler import SchedulerOptions
    from armcontour.studio.session import Session, outline_frame
    from armcontour.studio.workers import TaskWorker

    named: list[FilePath] = []
    # Files in `named` may be read wherever they are, because the user has named them. For example,
    # the job file can be a symbolic link to another folder.
    with listen_to_reading(lambda place, content: named.append(place)):
        if file is None:
            document = blank_document(DEFAULT_CELL, FilePath.cwd(), is_start=True)
        else:
            document = open_file(file, cell)
    previewer = CoarsePlanner(document.folder)
    report(Step(("reading the job",)))
    with listen_to_reading(lambda place, content: named.append(place)):
        # An error of the drawing is reported by the session.
        with suppress(ArmContourError):
            outline = outline_frame(document.data, previewer)
            if outline is not None:
                send(outline.stamped(seq=None, rev=0).pack(), outline.kind)
        session = Session(
            document,
            previewer,
            progress=report,
            scheduling=SchedulerOptions(task_worker=task_worker or TaskWorker),
        )
    session.confine(named)
    return session


def _start_frame(header: Mapping[str, Any]) -> bytes:
    """Make a progress frame of the start."""
    from armcontour.report.message_frame import MessageFrame

    whole = {"seq": None, "rev": 0, "id": START, "task": START, **header}
    return MessageFrame("progress", whole).pack()
