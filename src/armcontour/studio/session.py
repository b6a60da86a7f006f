"""One document on pages: what they say, one after the other, and what all of them are told.

Pages that show the same document are its tabs. An edit by one of them is shown by all. An edit of a
document that has changed since its gesture began is not made, but answered with the new document.
"""

from __future__ import annotations

import contextlib
import secrets
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, Protocol, TypeAlias

import numpy as np

from armcontour._checks import LONGEST_NAME
from armcontour._files import reading_below
from armcontour._progress import Progress
from armcontour._text import show
from armcontour._warming import warm_for_run
from armcontour._yaml import load
from armcontour.errors import ArmContourError, InvalidInput
from armcontour.io.cell import YAML
from armcontour.io.job_edits import Change, change_data, change_text
from armcontour.jobs import Job
from armcontour.studio.described import Seen, describe, label_of, runs_of
from armcontour.studio.document import Document
from armcontour.studio.edits import EditState, changes_of
from armcontour.studio.exact import Asked, Exact
from armcontour.studio.handles import handles_of
from armcontour.studio.lanes import FastLane, SlowLane
from armcontour.studio.preview import Previewer
from armcontour.studio.screen import Screen, Shown, stamped
from armcontour.studio.tasks import SAME
from armcontour.studio.uploads import Uploads
from armcontour.studio.variants import Variants, add_run, pin_to_run, remove_run
from armcontour.studio.view import View
from armcontour.studio.wire import Frame

Said: TypeAlias = Mapping[str, Any]
# How long nothing changes before the exact figures are computed [s].
REST = 0.15
# Files that are kept for the pages to save.
MOST_FILES = 20
# The timing of the run that is shown first, if a job has such a run.
FASTEST = "optimal"
# Edits after which other things can be grabbed, or elsewhere.
MOVING = ("insert_waypoint", "remove_waypoint", "place", "to_waypoints")
# Frames of which a page needs only the newest.
NEWEST_ONLY = {
    *("arm", "document", "executed", "figures"),
    *("picture", "pose", "progress", "refusal"),
}


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


@dataclass(frozen=True, slots=True)
class Made:
    """What edits make of the document.

    Args:
        data: The job as parsed.
        changes: Changes of keys; None if the whole text is new.
        text: The whole text, if it is new.
    """

    data: Mapping[str, Any]
    changes: tuple[Change, ...] | None
    text: str | None = None


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
    """

    def __init__(
        self,
        document: Document,
        previewer: Previewer,
        *,
        trusted: Iterable[FilePath] = (),
        fast: Callable[[Callable[[Frame], None]], FastLane] = FastLane,
        slow: Callable[[Callable[[Frame], None]], SlowLane] = SlowLane,
        rest: float = REST,
        told: Progress = lambda step: None,
    ) -> None:
        self.document, self.previewer = document, previewer
        self.uploads = Uploads()
        self.rev, self.files = 0, dict[str, File]()
        self._trusted = frozenset(x.resolve() for x in trusted)
        self._lock, self._out = threading.RLock(), threading.RLock()
        self._tabs: dict[Tab, int] = {}
        self._seqs: dict[int, int] = {}
        self._gestures: dict[Tab, Gesture] = {}
        self._last: dict[str, Frame] = {}
        self._joined = 0
        self._told = told
        self._ending = contextlib.ExitStack()
        self._named: tuple[FilePath, ...] = ()
        self._rest, self._timer = rest, threading.Timer(0.0, lambda: None)
        self._run = ""
        # The revision whose preview has taken the configuration of its full run.
        self._followed = 0
        self._made = Made({}, ())
        self._seen = Seen({}, None, None)
        self._run = self._run_of(document.data)
        self._seen = self._see(document.data)
        self._on_disk = ""
        self._draft = self._earlier_draft()
        self.variants = Variants()
        self.screen = Screen(previewer, self._tell_of, fast)
        self.exact = Exact(self._tell_slow, slow)

    @property
    def folder(self) -> FilePath:
        """Folder of relative file names."""
        return self.document.folder or FilePath.cwd()

    # What the server calls.

    def confine(self, named: Iterable[FilePath]) -> None:
        """Read files in the folder of the job from now on, and what it has named before.

        Args:
            named: Files elsewhere that may be read.
        """
        self._named = tuple(named)
        folders = [self.folder, self.uploads.folder]
        self._ending.enter_context(reading_below(folders, self._named))

    def begin(self) -> None:
        """Show the document for the first time; returns when that is done."""
        with contextlib.ExitStack() as compiling:
            if self._seen.job is not None:
                compiling.enter_context(warm_for_run(self._seen.job.arm.dimension, self._told))
            with self._lock:
                self._changed()
            if self._seen.job is not None:
                self.screen.wait()

    def join(self, tab: Tab) -> None:
        """A page is open: it gets what the others see."""
        with self._out:
            self._joined += 1
            self._tabs[tab] = self._joined
            for key, frame in self._last.items():
                tab.send(stamped(frame, seq=None).pack(), key)

    def leave(self, tab: Tab) -> None:
        """A page is closed; what it has not finished is dropped."""
        with self._out:
            self._seqs.pop(self._tabs.pop(tab, 0), None)
        gesture = self._gestures.pop(tab, None)
        if gesture is not None and not gesture.is_over:
            with self._lock:
                self._show(Made(self._seen.data, ()))

    def receive(self, tab: Tab, said: Said) -> None:
        """Do what a page says, and answer."""
        with self._lock:
            if tab not in self._tabs:
                return
            seq = said.get("seq")
            if isinstance(seq, int) and not isinstance(seq, bool):
                self._seqs[self._tabs[tab]] = seq
            act = ACTS.get(str(said.get("op")))
            try:
                if act is None:
                    raise InvalidInput(f"The Studio does not know {show(said.get('op'))}.")
                act(self, tab, said)
            except ArmContourError as error:
                self._fail(tab, said, error)
            except Exception as error:
                # The page goes on; the terminal shows what went wrong.
                traceback.print_exc(file=sys.stderr)
                sentence = f"This failed: {type(error).__name__}: {error}"
                self._fail(tab, said, ArmContourError(sentence))

    def look(self) -> None:
        """See whether the file has changed, and tell the pages if so."""
        with self._lock:
            if self._on_disk and self.document.on_disk() != self._on_disk:
                self._tell_document()

    def open_upload(self, name: str, content: bytes, cell: str | None) -> None:
        """Open a file that a page has sent: a job, or a drawing for the arm of the document.

        Args:
            name: Name of the file.
            content: Its bytes.
            cell: For a drawing, the built-in cell to open it in; None keeps the document's arm.

        Raises:
            InvalidInput: A file that cannot be opened.
        """
        with self._lock:
            opened = self.uploads.open(name, content, cell, self.document)
            if isinstance(opened, Document):
                self._job_of(opened.data)
                self.document, self._run, self._draft = opened, "", None
                self.previewer.forget()
                self.variants = Variants()
                self.screen.forget()
                self._changed()
            else:
                self._commit(self._with_changes(opened), f"open {name}")

    def keep_file(self, name: str, kind: str, data: bytes) -> str:
        """Keep something for the pages to save; returns its number."""
        number = secrets.token_hex(8)
        with self._out:
            self.files[number] = File(name, kind, data)
            while len(self.files) > MOST_FILES:
                del self.files[next(iter(self.files))]
        return number

    def unsaved(self) -> str | None:
        """A sentence on changes that are not saved, which are kept in the draft; None without."""
        if not (self.document.dirty and self.document.write_draft()):
            return None
        return f"Changes of {self.document.source} that were not saved are kept as its draft."

    def close(self) -> None:
        """End all work."""
        self._timer.cancel()
        self.exact.close()
        self.screen.close()
        self._ending.close()
        self.uploads.close()

    # Edits.

    def _edit(self, tab: Tab, said: Said) -> None:
        """Show or make the edits of a gesture."""
        gesture = self._gesture(tab, said)
        if gesture.is_over:
            return
        final = bool(said.get("final"))
        try:
            edits = _list_of_mappings(said, "edits")
            made = self._edited(edits)
            if not final:
                self._show(made, moving=True)
                return
            self._commit(made, label_of(edits))
        finally:
            if final:
                self._gestures.pop(tab, None)

    def _gesture(self, tab: Tab, said: Said) -> Gesture:
        """The gesture that a message belongs to; one of an older revision is over."""
        gesture = self._gestures.get(tab)
        if gesture is None or gesture.number != said.get("gesture"):
            known = said.get("rev")
            gesture = Gesture(said.get("gesture"), self.rev if known is None else known)
            self._gestures[tab] = gesture
        if gesture.rev != self.rev and not gesture.is_over:
            gesture.is_over = True
            self._tell_document(tab)
            sentence = "The job was changed elsewhere meanwhile, so this change was not made."
            self._tell(Frame("notice", {"sentence": sentence}), to=tab)
        return gesture

    def _edited(self, edits: Sequence[Mapping[str, Any]]) -> Made:
        """What edits make of the document as it was at the start of their gesture."""
        if [x.get("do") for x in edits] == ["text"]:
            text = edits[0].get("text")
            if not isinstance(text, str):
                raise InvalidInput("The whole job is a text.")
            data = load(text, self.document.source)
            if not isinstance(data, dict):
                raise InvalidInput("A job is a mapping of keys such as arm, path and runs.")
            return self._checked(Made(data, None, text))
        seen = self._seen
        if seen.handles is None:
            raise seen.error or InvalidInput("There is no job to be edited yet.")
        data, handles, changes = dict(seen.data), seen.handles, list[Change]()
        for k, edit in enumerate(edits):
            if k and edits[k - 1].get("do") in MOVING:
                handles = handles_of(self._job_of(data), data)
            more = changes_of(edit, EditState(data=data, run=self._run, handles=handles))
            data = change_data(data, more)
            changes += more
        return self._checked(Made(data, tuple(changes)))

    def _with_changes(self, changes: Sequence[Change]) -> Made:
        """The document with some keys changed."""
        return self._checked(Made(change_data(self._seen.data, changes), tuple(changes)))

    def _checked(self, made: Made) -> Made:
        """The same, if it names no program that the user has not named."""
        refuse_new_xacro(made.data, self.folder, self._trusted)
        return made

    def _commit(self, made: Made, label: str) -> None:
        """Change the document, in one step of undo.

        Raises:
            InvalidInput: The data make no job, and those before did.
        """
        # Seen before anything is changed: what cannot be shown is not made.
        seen = self._see(made.data)
        if seen.error is not None and self._seen.job is not None:
            raise seen.error
        if made.changes is None:
            assert made.text is not None
            self.document.replace(made.text, label)
        else:
            self.document.apply(made.changes, label)
        self._changed(seen)

    def _refuse(self, error: ArmContourError, *, made: bool) -> None:
        """Say that an edit is not possible; if it was to be made, show the document as it is."""
        told = Frame(
            "refusal",
            {
                **{"tier": 1, "run": self._run, "of": "live", "sentence": str(error)},
                **{"error": type(error).__name__, "exit": error.exit_code, "at": {}},
                "dropped": made,
            },
        )
        if not made:
            self._tell(told)
            return
        self._tell_document()
        self._show(Made(self._seen.data, ()), told)

    def _cancel_gesture(self, tab: Tab, said: Said) -> None:
        self._gestures.pop(tab, None)
        self._show(Made(self._seen.data, ()))

    def _undo(self, tab: Tab, said: Said) -> None:
        if not self.document.can_undo:
            raise InvalidInput("There is nothing to undo.")
        self.document.undo()
        self._changed()

    def _redo(self, tab: Tab, said: Said) -> None:
        if not self.document.can_redo:
            raise InvalidInput("There is nothing to redo.")
        self.document.redo()
        self._changed()

    # The file.

    def _save(self, tab: Tab, said: Said) -> None:
        """Write the job file; a job without one becomes something to download."""
        document, force = self.document, said.get("force") is True
        if document.file is None:
            name = f"{document.data.get('name') or 'job'}.yaml"
            number = self.keep_file(name, "application/yaml", document.text.encode())
            self._tell(Frame("download", {"file": number, "name": name}), to=tab)
            return
        if document.changed_on_disk() and not force:
            sentence = (
                f"{document.file.name} was changed by another program since it was opened: "
                "overwrite it, or reload it."
            )
            self._tell(
                Frame("conflict", {"sentence": sentence, "diff": document.conflict()}), to=tab
            )
            return
        document.save(force=force)
        self._tell(Frame("saved", {"file": str(document.file)}))
        self._tell_document()

    def _reload(self, tab: Tab, said: Said) -> None:
        self.document.reload()
        self.previewer.forget()
        self._changed()

    def _revert(self, tab: Tab, said: Said) -> None:
        self._commit(self._of_text(self.document.saved_text), "go back to the saved job")

    def _restore(self, tab: Tab, said: Said) -> None:
        """Take the draft of an earlier session."""
        if self._draft is None:
            raise InvalidInput("There is no draft.")
        made, self._draft = self._of_text(self._draft), None
        self._commit(made, "take the draft")

    def _discard(self, tab: Tab, said: Said) -> None:
        """Remove the draft of an earlier session."""
        self._draft = None
        self.document.write_draft()
        self._tell_document()

    def _earlier_draft(self) -> str | None:
        """What an earlier session has not saved."""
        file = self.document.file
        return None if file is None else Document.draft_of(file)

    def _diff(self, tab: Tab, said: Said) -> None:
        self._tell(Frame("diff", {"text": self.document.diff()}), to=tab)

    def _of_text(self, text: str) -> Made:
        """A whole text as what an edit makes."""
        return self._edited([{"do": "text", "text": text}])

    # Runs, pins, comparisons.

    def _select(self, tab: Tab, said: Said) -> None:
        run = _word(said, "run")
        if run not in (self._seen.data.get("runs") or {}):
            raise InvalidInput(f"The job has no run {run}.")
        self._run = run
        self._tell_all()

    def _pin(self, tab: Tab, said: Said) -> None:
        name = said.get("name")
        self.variants.pin(
            self.document.text,
            self._seen.data,
            self._run,
            name=name if isinstance(name, str) else None,
            figures=self._figures_now(),
        )
        self._tell_document()

    def _unpin(self, tab: Tab, said: Said) -> None:
        self.variants.unpin(said.get("pin"))
        self._tell_all()

    def _swap(self, tab: Tab, said: Said) -> None:
        """The document gets the text of a pin, and the pin that of the document."""
        pin = self.variants.find(said.get("pin"))
        before = self.document.text, self._seen.data, self._run, self._figures_now()
        made, run = self._of_text(pin.text), self._run
        self._run = pin.run
        try:
            self._commit(made, f"swap with {pin.name}")
        except ArmContourError:
            self._run = run
            raise
        self.variants.replace(pin, *before)
        self._tell_all()

    def _compare(self, tab: Tab, said: Said) -> None:
        self.variants.compare(said.get("with"), self._seen.data)
        self._tell_all()

    def _add_run(self, tab: Tab, said: Said) -> None:
        name, like = _word(said, "name"), said.get("like", self._run)
        self._commit(
            self._with_changes(add_run(self._seen.data, name, like)),
            f"add the run {name}",
        )

    def _remove_run(self, tab: Tab, said: Said) -> None:
        name = _word(said, "name")
        made = self._with_changes(remove_run(self._seen.data, name))
        if self._run == name:
            self._run = ""
        self._commit(made, f"remove the run {name}")

    def _pin_to_run(self, tab: Tab, said: Said) -> None:
        name, pin = _word(said, "name"), self.variants.find(said.get("pin"))
        changes = pin_to_run(self._seen.data, pin, name)
        self._commit(self._with_changes(changes), f"make {pin.name} the run {name}")

    # Poses and tasks.

    def _pose(self, tab: Tab, said: Said) -> None:
        t, of = said.get("t"), str(said.get("of"))
        if isinstance(t, bool) or not isinstance(t, int | float):
            raise InvalidInput("A pose needs a time in seconds.")
        q = self.screen.pose(float(t), of)
        self._tell(Frame("pose", {"q": q, "t": t, "of": of}), to=tab)

    def _task(self, tab: Tab, said: Said) -> None:
        options = said.get("options") or {}
        if not isinstance(options, dict):
            raise InvalidInput("The options of a task are a mapping.")
        self.exact.do(_word(said, "id"), _word(said, "task"), self._request(options))

    def _cancel(self, tab: Tab, said: Said) -> None:
        self.exact.cancel(_word(said, "id"))

    def _request(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """What the other process needs to know of the document."""
        made = self._made
        text = self.document.text if made.text is None else made.text
        if made.changes:
            text = change_text(text, made.changes, self.document.source)
        return {
            "text": text,
            "source": self.document.source,
            "folder": str(self.folder),
            "run": self._run,
            "trust_xacro": bool(self._trusted),
            "allowed": [str(x) for x in (self.folder, self.uploads.folder)],
            "named": [str(x) for x in self._named],
            "options": dict(options),
        }

    # What is shown.

    def _changed(self, seen: Seen | None = None) -> None:
        """Show the document after its text has changed.

        Args:
            seen: What is seen of it, if that is known.
        """
        self.rev += 1
        self._tell_all(seen)

    def _tell_all(self, seen: Seen | None = None) -> None:
        """Show the document, its run and what it is compared with, as they are now."""
        self._run = self._run_of(self.document.data)
        self._seen = seen or self._see(self.document.data)
        self.variants.keep_to(self._seen.data)
        self.screen.compare(*self.variants.compared)
        self._tell_document()
        self._show(Made(self._seen.data, ()))

    def _run_of(self, data: Mapping[str, Any]) -> str:
        """The run that is shown of a job: that of the last one, else a fast one, else the first."""
        runs = runs_of(data)
        names = [x["name"] for x in runs]
        fast = [x["name"] for x in runs if x["timing"] == FASTEST and x["corners"] != "free"]
        return self._run if self._run in names else next(iter([*fast, *names]), "")

    def _see(self, data: Mapping[str, Any]) -> Seen:
        """The job of the document, and what can be grabbed of it."""
        try:
            job = self._job_of(data)
            return Seen(data, job, handles_of(job, data))
        except InvalidInput as error:
            # What is seen of the last job stays, greyed, until the text makes a job again.
            return Seen(data, None, self._seen.handles, error)

    def _job_of(self, data: Mapping[str, Any]) -> Job:
        """The job of data.

        Raises:
            InvalidInput: They make none.
        """
        refuse_new_xacro(data, self.folder, self._trusted)
        return self.previewer.job(data, self._run_of(data) or None)

    def _show(self, made: Made, told: Frame | None = None, *, moving: bool = False) -> None:
        """Show a state on all pages, and compute its exact figures when nothing changes."""
        self._made = made
        handles = self._seen.handles
        if handles is None:
            error = self._seen.error or InvalidInput("There is no job yet.")
            self._refuse(error, made=False)
            return
        with self._out:
            answers = dict(self._seqs)
        self.screen.show(
            Shown(
                data=made.data,
                run=self._run_of(made.data),
                view=View(handles.plane, handles.centre),
                rev=self.rev,
                answers=answers,
                waypoints=np.array([x.uv for x in handles.waypoints]).reshape(-1, 2),
                told=told,
                moving=moving,
            )
        )
        self._timer.cancel()
        self._timer = threading.Timer(self._rest, self._at_rest)
        self._timer.daemon = True
        self._timer.start()

    def _at_rest(self) -> None:
        """Nothing has changed for a while: compute what takes longer."""
        with self._lock:
            self.screen.rest()
            with contextlib.suppress(ArmContourError):
                request = self._request({})
                self.exact.ask(Asked(self.rev, dict(self._seqs), request))

    def _figures_now(self) -> Mapping[str, Any]:
        """Duration and error of what is shown, exact if they are known."""
        exact = self.exact.latest
        if exact is not None and exact.request == self._request({}):
            return {"duration": exact.header.get("duration"), "rms": exact.header.get("rms")}
        planned, executed = self.screen.planned, self.screen.executed
        return {
            "duration": None if planned is None else planned.trajectory.duration,
            "rms": None if executed is None else executed.errors.rms,
        }

    # What the pages are told.

    def _tell_document(self, to: Tab | None = None) -> None:
        """Tell what the document is now."""
        self._on_disk = self.document.on_disk()
        frame = describe(
            self.document,
            self._seen,
            self._run,
            self.variants,
            draft=self._draft is not None,
        )
        self._tell(frame, to=to)

    def _tell_of(self, frame: Frame, shown: Shown) -> None:
        """Pass a frame of the fast lane on, unless the document has changed since."""
        if shown.rev == self.rev:
            self._tell(stamped(frame, rev=shown.rev), answers=shown.answers)

    def _tell_slow(self, frame: Frame, asked: Asked | None) -> None:
        """Pass a frame of the slow lane on; figures only of the present document."""
        if asked is None:
            self._tell(self._with_file(frame))
            return
        self.variants.learn(asked.request, frame.header)
        if asked.rev == self.rev:
            self._tell(stamped(frame, rev=asked.rev), answers=asked.answers)
            if frame.kind == "figures" and frame.header.get("start") is not None:
                # The lane that calls here has locks of its own.
                threading.Timer(0.0, self._follow, (asked.rev, frame.header["start"])).start()

    def _follow(self, rev: int, start: Any) -> None:
        """Show the configuration that the full run takes, if the preview has stayed in another."""
        with self._lock:
            planned = self.screen.planned
            if rev != self.rev or rev == self._followed or planned is None:
                return
            if np.abs(planned.start - np.asarray(start)).max() > SAME:
                self._followed = rev
                self.previewer.keep_start(planned.job, np.asarray(start))
                self._show(self._made)

    def _with_file(self, frame: Frame) -> Frame:
        """The same frame; a file in it is kept for the pages to save."""
        if frame.kind != "result" or "content" not in frame.arrays:
            return frame
        header, content = frame.header, frame.arrays["content"].tobytes()
        number = self.keep_file(str(header["name"]), str(header["type"]), content)
        return Frame("result", {**header, "file": number})

    def _fail(self, tab: Tab, said: Said, error: ArmContourError) -> None:
        """Tell a page why its message was not followed."""
        if said.get("op") == "edit":
            self._refuse(error, made=bool(said.get("final")))
            return
        header = {"id": said.get("id"), "op": said.get("op"), "sentence": str(error)}
        self._tell(Frame("failed", header), to=tab)

    def _tell(
        self, frame: Frame, *, to: Tab | None = None, answers: Mapping[int, int] | None = None
    ) -> None:
        """Send a frame to one page or to all.

        Args:
            frame: The frame; without a revision it is of the present one.
            to: The page.
            answers: Messages that it answers, by tab; by default the last ones.
        """
        frame = stamped(frame, rev=frame.header.get("rev", self.rev))
        key = _key(frame)
        with self._out:
            if to is None and key is not None and not frame.header.get("dropped"):
                self._remember(key, frame)
            packed: dict[int | None, bytes] = {}
            for tab, number in self._tabs.items():
                if to is None or tab is to:
                    seq = (self._seqs if answers is None else answers).get(number)
                    if seq not in packed:
                        packed[seq] = stamped(frame, seq=seq).pack()
                    tab.send(packed[seq], key)

    def _remember(self, key: str, frame: Frame) -> None:
        """Keep a frame for pages to come; what it puts out of date goes."""
        if frame.kind == "picture":
            of = frame.header.get("of")
            for kind in ("executed", "figures", "refusal"):
                self._last.pop(f"{kind}/{of}", None)
        if frame.kind == "document" and not frame.header.get("compare"):
            for old in [x for x in self._last if x.endswith("/compare")]:
                del self._last[old]
        self._last[key] = frame


ACTS: dict[str, Callable[[Session, Tab, Said], None]] = {
    "edit": Session._edit,
    "cancel_gesture": Session._cancel_gesture,
    "undo": Session._undo,
    "redo": Session._redo,
    "save": Session._save,
    "reload": Session._reload,
    "revert": Session._revert,
    "restore_draft": Session._restore,
    "discard_draft": Session._discard,
    "diff": Session._diff,
    "select": Session._select,
    "pin": Session._pin,
    "unpin": Session._unpin,
    "swap": Session._swap,
    "compare": Session._compare,
    "add_run": Session._add_run,
    "remove_run": Session._remove_run,
    "pin_to_run": Session._pin_to_run,
    "pose": Session._pose,
    "task": Session._task,
    "cancel": Session._cancel,
}


def refuse_new_xacro(
    data: Mapping[str, Any], folder: FilePath, trusted: Collection[FilePath]
) -> None:
    """Refuse an arm from a file of xacro, unless the user has named the file.

    Such a file is a program: a page may not choose which one is run.

    Args:
        data: The job.
        folder: Folder of relative file names.
        trusted: Files that may be such programs, or may name one.

    Raises:
        InvalidInput: The arm is such a file, or may lead to one.
    """
    # An arm file can name another arm; without any trust, reading it refuses what is a program.
    programs = (".xacro", *YAML) if trusted else (".xacro",)
    file = arm_file_of(data)
    if file is None or not file.lower().endswith(programs):
        return
    if (folder / file).resolve() not in trusted:
        raise InvalidInput(
            f"{file} is a program, or may name one: start the Studio with a job file that names "
            "it, and with --trust-xacro."
        )


def arm_file_of(data: Mapping[str, Any]) -> str | None:
    """The file of the arm of a job; None for a built-in one.

    Args:
        data: The job.
    """
    arm = data.get("arm")
    file = arm.get("file") if isinstance(arm, Mapping) else arm
    return file if isinstance(file, str) and FilePath(file).suffix else None


def _key(frame: Frame) -> str | None:
    """What a frame replaces; None if every one of its kind counts."""
    header = frame.header
    if frame.kind not in NEWEST_ONLY:
        return None
    parts = [frame.kind, header.get("of"), header.get("id")]
    return "/".join(str(x) for x in parts if x is not None)


def _word(said: Said, name: str) -> str:
    """A text that a message must have.

    Raises:
        InvalidInput: It has none, or a long one.
    """
    value = said.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_NAME:
        raise InvalidInput(f"The message {said.get('op')} needs {name}, a short text.")
    return value


def _list_of_mappings(said: Said, name: str) -> list[Mapping[str, Any]]:
    """A list of mappings that a message must have.

    Raises:
        InvalidInput: It has none.
    """
    value = said.get(name)
    if not isinstance(value, list) or not value or not all(isinstance(x, dict) for x in value):
        raise InvalidInput(f"The message {said.get('op')} needs {name}, a list of mappings.")
    return value
