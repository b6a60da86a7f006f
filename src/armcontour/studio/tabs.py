"""Who listens: pages, what they are told now and when they come, and files for them to save."""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import RLock
from typing import Any, Protocol, TypeAlias

from armcontour.studio.wire import Frame

# A message of a page.
Said: TypeAlias = Mapping[str, Any]
# Files that are kept for the pages to save, and about how many bytes; the newest is always kept.
MOST_FILES, MOST_BYTES = 20, 200_000_000
# Frames of which a page needs only the newest.
NEWEST_ONLY = {"arm", "changes", "detail", "document", "executed", "figures"} | {
    *("picture", "pose", "refusal")
}

# Options of the command line in a sentence, which also names the key of the job file.
_OPTION = r"--[a-z][a-z-]*(?: (?:'[^']*'|[^\s,.;:()']+))?"
_BEFORE = r",? (?:or|also with|such as)| as"
_OPTIONS = re.compile(rf" \([a-z ]*{_OPTION}\)|(?:{_BEFORE}) {_OPTION}|, {_OPTION}(?=\))")


def without_options(sentence: str) -> str:
    """A sentence without options of the command line, which a page does not have."""
    return _OPTIONS.sub("", sentence)


class Tab(Protocol):
    """A page: somebody to send frames to, from any thread."""

    def send(self, data: bytes, replaces: str | None = None) -> None:
        """Send a frame; an older one that it replaces need not be sent any more."""


@dataclass(frozen=True, slots=True)
class File:
    """Something for a page to save.

    Args:
        name: Name of the file.
        kind: Its type.
        data: Its content.
    """

    name: str
    kind: str
    data: bytes = field(repr=False)


class Tabs:
    """The pages that show a document; all of it may be called from any thread.

    Attributes:
        files: Files for the pages to save, by their numbers.
    """

    def __init__(self) -> None:
        self.files: dict[str, File] = {}
        self._lock = RLock()
        self._numbers: dict[Tab, int] = {}
        self._joined = 0
        # The last message of each page, by the page's number.
        self._seqs: dict[int, int] = {}
        # Frames for pages to come, by what newer ones replace.
        self._last: dict[str, Frame] = {}
        # What the newest figures answer.
        self._figured: Mapping[int, int] = {}

    @property
    def answers(self) -> dict[int, int]:
        """Number of the last message of each page, by the page's number."""
        with self._lock:
            return dict(self._seqs)

    def join(self, tab: Tab) -> None:
        """A page is open: it gets what the others see."""
        with self._lock:
            self._joined += 1
            self._numbers[tab] = self._joined
            for key, frame in self._last.items():
                tab.send(frame.stamped(seq=None).pack(), key)

    def leave(self, tab: Tab) -> None:
        """A page is closed."""
        with self._lock:
            self._seqs.pop(self._numbers.pop(tab, 0), None)

    def hear(self, tab: Tab, said: Said) -> bool:
        """Note a message, which is answered from now on; returns whether the page is open."""
        seq = said.get("seq")
        with self._lock:
            is_open = tab in self._numbers
            # To look closer is no change that anything answers.
            counts = is_open and said.get("op") != "detail"
            if counts and isinstance(seq, int) and not isinstance(seq, bool):
                self._seqs[self._numbers[tab]] = seq
        return is_open

    def tell(
        self, frame: Frame, *, to: Tab | None = None, answers: Mapping[int, int] | None = None
    ) -> None:
        """Send a frame to one page or to all.

        Args:
            frame: The frame, with the revision of the document.
            to: The page.
            answers: As of `answers`: messages that it answers; by default the last ones.
        """
        key, sentence = _key(frame), frame.header.get("sentence")
        if isinstance(sentence, str):
            frame = frame.stamped(sentence=without_options(sentence))
        with self._lock:
            answers = self.answers if answers is None else answers
            if to is None and key is not None and not frame.header.get("dropped"):
                self._remember(key, frame, answers)
            packed: dict[int | None, bytes] = {}
            for tab, number in self._numbers.items():
                if to is None or tab is to:
                    seq = answers.get(number)
                    if seq not in packed:
                        packed[seq] = frame.stamped(seq=seq).pack()
                    tab.send(packed[seq], key)

    def keep_file(self, name: str, kind: str, data: bytes) -> str:
        """Keep something for the pages to save; returns its number.

        Args:
            name: As of `File`.
            kind: As of `File`.
            data: As of `File`.
        """
        number = secrets.token_hex(8)
        with self._lock:
            self.files[number] = File(name, kind, data)
            while len(self.files) > MOST_FILES or self._is_too_much():
                del self.files[next(iter(self.files))]
        return number

    def _is_too_much(self) -> bool:
        """Whether the files that are kept take too much memory, besides the newest."""
        sizes = [len(x.data) for x in self.files.values()]
        return len(sizes) > 1 and sum(sizes) > MOST_BYTES

    def _remember(self, key: str, frame: Frame, answers: Mapping[int, int]) -> None:
        """Keep a frame for future pages, and discard the frames that it makes obsolete."""
        if frame.kind == "figures":
            self._figured = answers
        if frame.kind == "picture":
            old = ["executed", "refusal"]
            # At rest the exact picture may follow the figures of the same edit.
            if any(seq > self._figured.get(number, -1) for number, seq in answers.items()):
                old += ["figures", "changes"]
            for kind in old:
                self._last.pop(kind, None)
        self._last[key] = frame


def _key(frame: Frame) -> str | None:
    """Kind of a frame, with the task of its progress; None if every frame of the kind counts."""
    if frame.kind == "progress":
        return f"progress/{frame.header.get('id')}"
    return frame.kind if frame.kind in NEWEST_ONLY else None
