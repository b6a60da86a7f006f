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


# Messages that may wait for a page that does not read them.
MOST_WAITING = 1000
# Messages of a page that may wait for the session: more than a person causes during a start.
MOST_EARLY = 100

# The task that a page sees while the Studio starts.
START = "start"
# The cell of the empty plane that is opened without a file.
USUAL = "ur5e"


class Tab:
    """A page that is open; messages to it may be sent from any thread."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._lock = threading.Lock()
        # In the order in which they are sent.
        self._waiting: dict[object, bytes] = {}
        self.is_slow = False
        # Messages of the page that the session has not received yet; None once the page has joined.
        self.early: list[Said] | None = []

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Send a message, soon.

        Args:
            data: The message.
            replaces: What it is: an older one of the same that still waits is not sent.
        """
        with self._lock:
            key = object() if replaces is None else replaces
            self._waiting.pop(key, None)
            self._waiting[key] = data
            self.is_slow = len(self._waiting) > MOST_WAITING
        # The loop is closed when the server ends.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._news.set)

    async def write(self, send: Send) -> None:
        """Send what waits, until cancelled or the page does not read."""
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
    """The session, while it is being made and afterwards, and the pages that wait for it.

    Args:
        make: Makes the session, given a function that sends a message to all pages.
    """

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
        """Make the session, in this thread; the server ends if that fails."""
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
        """A page is open."""
        with self._lock:
            self.tabs.append(tab)
            if self.session is not None:
                self._let_in(tab, self.session)
            elif self._said is not None:
                tab.send(self._said)

    def receive(self, tab: Tab, said: Said) -> bool:
        """Pass a message of a page to the session, at the latest when the page joins it.

        Returns:
            Whether the message is accepted: only some may wait for the session.
        """
        with self._lock:
            if tab.early is not None:
                tab.early.append(said)
                return len(tab.early) <= MOST_EARLY
            session = self.session
        if session is not None:
            session.receive(tab, said)
        return True

    def leave(self, tab: Tab) -> None:
        """A page is closed."""
        with self._lock:
            self.tabs.remove(tab)
            if self.session is not None:
                self.session.leave(tab)

    def _let_in(self, tab: Tab, session: Session) -> None:
        """Have a page join the session, which then receives the messages that waited for it."""
        session.join(tab)
        early, tab.early = tab.early or (), None
        for said in early:
            session.receive(tab, said)

    def _say(self, data: bytes) -> None:
        """Tell all pages how far the start is."""
        with self._lock:
            self._said = data
            for tab in self.tabs:
                tab.send(data, "start")


class Starting:
    """Tells the pages how far the start is.

    Args:
        say: Sends a message to all pages.
    """

    def __init__(self, say: Callable[[bytes], None]) -> None:
        self._say = say

    def __call__(self, step: Step) -> None:
        """Tell a step."""
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
    """Open a document; `Session.begin` shows it.

    Args:
        file: A job file or a drawing; None opens an empty plane, with the start page.
        cell: Cell of a drawing.
        trust_xacro: Whether an arm from a .xacro file that the job names may be loaded.
        say: Sends a message to all pages.
        slow: As of `Session`; by default another process.

    Raises:
        ArmContourError: The document cannot be opened.
    """
    tell = Starting(say)
    tell(Step(("loading armcontour",)))
    from armcontour.studio.editor import arm_file_of
    from armcontour.studio.preview import CoarsePlanner
    from armcontour.studio.session import Session
    from armcontour.studio.workers import SlowLane

    named: list[FilePath] = []
    # The job file may be a link to another folder: the user has named it.
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
    """The document of a file.

    Raises:
        InvalidInput: It cannot be opened.
    """
    from armcontour.studio.drafts import START
    from armcontour.studio.start_page import blank_document, open_file

    if file is None:
        return blank_document(USUAL, FilePath.cwd(), START)
    return open_file(file, cell)
