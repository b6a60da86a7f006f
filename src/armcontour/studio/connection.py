"""Connections of pages to the session, which is created while the server already answers."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core.file_access import listen_to_reading
from armcontour.core.progress import Step
from armcontour.studio.access_control import Send

if TYPE_CHECKING:
    from armcontour.studio.document import Document
    from armcontour.studio.pages import Said
    from armcontour.studio.scheduler import MakeLane
    from armcontour.studio.session import Session


# Largest number of messages queued for a page that does not read.
MOST_WAITING = 1000
# Largest number of messages of a page queued for the session: more than a user causes.
MOST_EARLY = 100

# Task of the progress frames during the start.
START = "start"
# Cell of the empty plane that is opened without a file.
USUAL = "ur5e"


class Tab:
    """An open page. Messages may be sent from any thread."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        # Queued messages in the order of sending.
        self._waiting: dict[object, bytes] = {}
        self.is_slow = False
        # Queued messages of the page; None after the page has joined the session.
        self.early: list[Said] | None = []

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Queue a message; it replaces a queued one with the same `replaces`."""
        with self._lock:
            key = object() if replaces is None else replaces
            self._waiting.pop(key, None)
            self._waiting[key] = data
            self.is_slow = len(self._waiting) > MOST_WAITING
        # The loop is closed when the server ends.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._news.set)

    async def write(self, send: Send) -> None:
        """Send queued messages until cancelled or until the page stops reading."""
        while not self.is_slow:
            await self._news.wait()
            self._news.clear()
            while (data := self._next()) is not None:
                await send({"type": "websocket.send", "bytes": data})

    def _next(self) -> bytes | None:
        with self._lock:
            key = next(iter(self._waiting), None)
            return None if key is None else self._waiting.pop(key)


class Desk:
    """Creates the session, and holds pages and their messages until it is ready."""

    def __init__(self, make: Callable[[Callable[[bytes], None]], Session]) -> None:
        self._make = make
        self._lock = threading.Lock()
        self._said: bytes | None = None
        # Ends the server; set when it runs.
        self.stop: Callable[[], None] = lambda: None
        self.tabs: list[Tab] = []
        self.session: Session | None = None
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Create the session in this thread; if that fails, the server ends."""
        try:
            session = self._make(self._say)
            with self._lock:
                self.session = session
                for tab in self.tabs:
                    self._let_in(tab, session)
            session.begin()
        except BaseException as error:
            self.failure = error
            self.stop()

    def join(self, tab: Tab) -> None:
        """Add a page."""
        with self._lock:
            self.tabs.append(tab)
            if self.session is not None:
                self._let_in(tab, self.session)
            elif self._said is not None:
                tab.send(self._said)

    def receive(self, tab: Tab, said: Said) -> bool:
        """Pass a message to the session, or queue it; False if too many are queued."""
        with self._lock:
            if tab.early is not None:
                tab.early.append(said)
                return len(tab.early) <= MOST_EARLY
            session = self.session
        if session is not None:
            session.receive(tab, said)
        return True

    def leave(self, tab: Tab) -> None:
        """Remove a page."""
        with self._lock:
            self.tabs.remove(tab)
            if self.session is not None:
                self.session.leave(tab)

    def _let_in(self, tab: Tab, session: Session) -> None:
        """Add a page to the session, and pass on the messages that it has queued."""
        session.join(tab)
        early, tab.early = tab.early or (), None
        for said in early:
            session.receive(tab, said)

    def _say(self, data: bytes) -> None:
        """Send the progress of the start to all pages."""
        with self._lock:
            self._said = data
            for tab in self.tabs:
                tab.send(data, "start")


class Starting:
    """Reports the progress of the start to the pages."""

    def __init__(self, say: Callable[[bytes], None]) -> None:
        self._say = say

    def __call__(self, step: Step) -> None:
        """Report a step."""
        from armcontour.studio.page_frame import Frame

        header = {"id": START, "task": START, "steps": list(step.names), "share": step.done}
        self._say(Frame("progress", {"seq": None, "rev": 0, **header, "eta": None}).pack())


def open_session(
    file: FilePath | None,
    *,
    cell: str | None = None,
    trust_xacro: bool = False,
    say: Callable[[bytes], None] = lambda data: None,
    slow: MakeLane | None = None,
) -> Session:
    """Open a job file, a drawing in a cell, or an empty plane; `Session.begin` shows it."""
    tell = Starting(say)
    tell(Step(("loading armcontour",)))
    from armcontour.studio.editor import arm_file_of
    from armcontour.studio.preview import CoarsePlanner
    from armcontour.studio.session import Session
    from armcontour.studio.workers import SlowLane

    named: list[FilePath] = []
    # The job file may be a link to another folder; the user has named it.
    with listen_to_reading(lambda place, content: named.append(place)):
        document = _document(file, cell)
    folder = document.folder or FilePath.cwd()
    previewer = CoarsePlanner(folder, trust_xacro=trust_xacro)
    tell(Step(("reading the job",)))
    named_arm = arm_file_of(document.data)
    with listen_to_reading(lambda place, content: named.append(place)):
        session = Session(
            document,
            previewer,
            trusted=[folder / named_arm] if trust_xacro and named_arm else (),
            told=tell,
            slow=slow or SlowLane,
        )
    session.confine(named)
    return session


def _document(file: FilePath | None, cell: str | None) -> Document:
    from armcontour.studio.drafts import START
    from armcontour.studio.start_page import blank_document, open_file

    if file is None:
        return blank_document(USUAL, FilePath.cwd(), START)
    return open_file(file, cell)
