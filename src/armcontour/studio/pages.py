"""Open pages of a session: frames sent to the pages, and files for download."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import RLock
from typing import Any, Protocol, TypeAlias

from armcontour.report.message_frame import MessageFrame, without_options

# A message of a page.
PageMessage: TypeAlias = Mapping[str, Any]
# Maximum number of stored files for download.
MAX_FILES = 20
# Maximum total size of the stored files [bytes]; the newest file always stays.
MAX_BYTES = 200_000_000
# Frame kinds of which a page needs only the newest frame.
NEWEST_ONLY = {*("arm", "document", "executed", "figures", "picture", "refusal")}


class Page(Protocol):
    """A page that receives frames; `send` may be called from any thread."""

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Send a frame; it replaces a queued frame with the same `replaces`."""


# For each page, the number of the last message that a frame answers.
Answers: TypeAlias = Mapping[Page, int | None]


@dataclass(frozen=True, slots=True)
class File:
    """A file for download.

    Args:
        name: File name for the browser.
        data: Content.
    """

    name: str
    data: bytes = field(repr=False)


class Pages:
    """Open pages and files for download; thread-safe."""

    def __init__(self) -> None:
        self.files: dict[str, File] = {}
        self._lock = RLock()
        # Open pages, each with the number of its last recorded message.
        self._seqs: dict[Page, int | None] = {}

    @property
    def answers(self) -> Answers:
        """Each page's last recorded message, by number."""
        with self._lock:
            return dict(self._seqs)

    def join(self, page: Page) -> None:
        """Add a page."""
        with self._lock:
            self._seqs[page] = None

    def leave(self, page: Page) -> None:
        """Remove a page."""
        with self._lock:
            self._seqs.pop(page, None)

    def record(self, page: Page, message: PageMessage) -> bool:
        """Record the number of a message; returns False if the page is closed."""
        seq = message.get("seq")
        with self._lock:
            is_open = page in self._seqs
            if is_open and isinstance(seq, int) and not isinstance(seq, bool):
                self._seqs[page] = seq
        return is_open

    def send(
        self, frame: MessageFrame, *, to: Page | None = None, answers: Answers | None = None
    ) -> None:
        """Send a frame to one page or to all, with the number of the message that it answers."""
        key = _replacement_key(frame)
        sentence = frame.header.get("sentence")
        if isinstance(sentence, str):
            frame = frame.stamped(sentence=without_options(sentence))
        with self._lock:
            answers = self.answers if answers is None else answers
            packed: dict[int | None, bytes] = {}
            for page in self._seqs:
                if to is None or page is to:
                    seq = answers.get(page)
                    if seq not in packed:
                        packed[seq] = frame.stamped(seq=seq).pack()
                    page.send(packed[seq], key)

    def keep_file(self, name: str, data: bytes) -> str:
        """Store a file for download, and return its identifier.

        Above the limits of number and size, the oldest files are deleted.
        """
        identifier = secrets.token_hex(8)
        with self._lock:
            self.files[identifier] = File(name, data)
            while len(self.files) > MAX_FILES or (
                len(self.files) > 1 and sum(len(x.data) for x in self.files.values()) > MAX_BYTES
            ):
                del self.files[next(iter(self.files))]
        return identifier


def _replacement_key(frame: MessageFrame) -> str | None:
    """Return a frame's kind if a newer frame of this kind replaces it, otherwise None.

    None if pages need every frame of the kind.
    """
    if frame.kind == "progress":
        return f"progress/{frame.header.get('id')}"
    return frame.kind if frame.kind in NEWEST_ONLY else None
