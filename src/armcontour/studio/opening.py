"""The Studio's start: the document, everything that computes, and the first plan."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core.file_access import listen_to_reading
from armcontour.core.progress import Step
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.studio.document import Document
    from armcontour.studio.planner import MakeLane
    from armcontour.studio.session import Session

# The task that a page sees while the Studio starts.
START = "start"
# The cell of the empty plane that is opened without a file.
USUAL = "ur5e"


class Starting:
    """Tells the pages how far the start is.

    Args:
        say: Sends a message to all pages.
    """

    def __init__(self, say: Callable[[bytes], None]) -> None:
        self._say = say

    def __call__(self, step: Step) -> None:
        """Tell a step."""
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
    from armcontour.studio.lanes import SlowLane
    from armcontour.studio.preview import CoarsePlanner
    from armcontour.studio.session import Session
    from armcontour.studio.trust import arm_file_of

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
    from armcontour.studio.disk import START
    from armcontour.studio.starting import blank_document, open_file

    if file is None:
        return blank_document(USUAL, FilePath.cwd(), START)
    return open_file(file, cell)
