"""Edits of pages: shown while a gesture goes on, and made at its end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.studio.described import label_of
from armcontour.studio.display import Display
from armcontour.studio.tabs import Said, Tab
from armcontour.studio.wire import Frame

# Edits of one message; a page sends a few, and each of them reads the job again at worst.
MOST_EDITS = 100


@dataclass(slots=True)
class Gesture:
    """Edits in one movement: each message has all of them since its start.

    Args:
        number: Number of the gesture, as its tab counts.
        rev: Revision of the document at its start.
        is_over: Whether its further messages are ignored.
    """

    number: Any
    rev: int
    is_over: bool = False


class Gestures:
    """The gestures that go on, one for each page at most.

    Args:
        display: Shows the document that is edited.
    """

    def __init__(self, display: Display) -> None:
        self._display, self._editor = display, display.editor
        self._going_on: dict[Tab, Gesture] = {}

    def edit(self, tab: Tab, said: Said) -> None:
        """Show the edits of a gesture, or make them if it ends.

        Raises:
            InvalidInput: They are not possible.
        """
        gesture = self._gesture(tab, said)
        if gesture.is_over:
            return
        final = bool(said.get("final"))
        try:
            edits = _edits_of(said)
            made = self._editor.edited(edits)
            if not final:
                self._display.show(made, moving=True)
                return
            self._editor.commit(made, label_of(edits))
            self._display.show_all()
        finally:
            if final:
                self._going_on.pop(tab, None)

    def cancel(self, tab: Tab, said: Said) -> None:
        """Give a gesture up."""
        self._going_on.pop(tab, None)
        self._display.show()

    def leave(self, tab: Tab) -> None:
        """A page is closed; what it has not finished is dropped."""
        gesture = self._going_on.pop(tab, None)
        if gesture is not None and not gesture.is_over:
            self._display.show()

    def _gesture(self, tab: Tab, said: Said) -> Gesture:
        """The gesture that a message belongs to; one of an older revision is over."""
        gesture = self._going_on.get(tab)
        if gesture is None or gesture.number != said.get("gesture"):
            known, now = said.get("rev"), self._editor.rev
            gesture = Gesture(said.get("gesture"), now if known is None else known)
            self._going_on[tab] = gesture
        if gesture.rev != self._editor.rev and not gesture.is_over:
            gesture.is_over = True
            self._display.show_document(tab)
            sentence = "The job was changed elsewhere meanwhile, so this change was not made."
            self._display.tell(Frame("notice", {"sentence": sentence}), to=tab)
        return gesture


def _edits_of(said: Said) -> list[Mapping[str, Any]]:
    """The edits of a message.

    Raises:
        InvalidInput: It has none, or too many.
    """
    edits = said.get("edits")
    if not isinstance(edits, list) or not edits or not all(isinstance(x, dict) for x in edits):
        raise InvalidInput(f"The message {said.get('op')} needs edits, a list of mappings.")
    if len(edits) > MOST_EDITS:
        raise InvalidInput(
            f"The message has {len(edits)} edits, and at most {MOST_EDITS} are made at once: "
            "change the text of the job instead."
        )
    return edits
