"""Editor of a document, independent of pages: its job, the shown run, and results of edits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_bytes
from armcontour.core.source_file import SourceFile, fingerprint
from armcontour.core.yaml_loader import load
from armcontour.files.job_text_edits import Change, change_data, write_data
from armcontour.files.model.edge_picking import EdgePicker
from armcontour.files.model.edge_rules import EdgeRule
from armcontour.jobs import Job
from armcontour.studio.description import JobState, runs_of
from armcontour.studio.document import Document
from armcontour.studio.edits import changes_of
from armcontour.studio.handles import (
    EditState,
    blank_handles,
    handles_of,
    has_no_edges,
    is_blank,
)
from armcontour.studio.opening import Uploads
from armcontour.studio.preview import CoarsePlanner, path_only

# Timing method of the run that is shown first.
FASTEST = "optimal"
# Edits after which the handles must be computed again.
HANDLE_EDITS = ("insert_waypoint", "remove_waypoint", "place", "draw")
NOTHING_DRAWN = "The job has no path yet. Draw with the pen, or open a drawing."
NO_EDGES = "No edge is selected yet. Click an edge of the part in the 3D view, then Add."


@dataclass(frozen=True, slots=True)
class Revision:
    """Data of the document after edits.

    Args:
        data: Data of the job.
        text: New text; None if keys are changed.
    """

    data: Mapping[str, Any]
    text: str | None = None


class Editor:
    """Edits a document, independent of pages.

    Args:
        document: The document.
        previewer: Planner that reads the job.

    Attributes:
        state: The job without an unfinished drag.
        run: Name of the shown run.
    """

    def __init__(self, document: Document, previewer: CoarsePlanner) -> None:
        self.document = document
        self.previewer = previewer
        self.uploads = Uploads()
        self.named: tuple[FilePath, ...] = ()
        self.rev = 1
        # Number of times that the files of documents were read.
        self.reading = 0
        self.run = document.chosen_run
        # Run that is shown again if the shown one no longer exists, as after undo.
        self._run_before = ""
        # Edges of the CAD model of the path; None without one, and while it is read.
        self.picker: EdgePicker | None = None
        self.state = JobState({}, None, None)
        self._refresh()

    @property
    def folder(self) -> FilePath:
        """Folder to which file names in the job are relative."""
        return self.document.folder

    @property
    def folders(self) -> tuple[FilePath, FilePath]:
        """Folders from which files may be read."""
        return self.folder, self.uploads.root

    def open(self, document: Document) -> None:
        """Edit another document; raises InvalidInput if its data are not a valid job."""
        before = self.previewer.folder
        self.previewer.folder = document.folder
        self.read_again()
        runs = self.run, self._run_before
        # The runs of the other document are not those of this one, even with the same names.
        self.run = document.chosen_run
        self._run_before = ""
        state = self._read_state(document.data)
        if state.job is None and not is_blank(document.data):
            self.previewer.folder = before
            self.run, self._run_before = runs
            raise state.error or InvalidInput("The document is not a valid job.")
        self.document = document
        self._count_revision(state)

    def read_again(self) -> None:
        """Forget what was read from files, because they may have changed."""
        self.previewer.forget()
        self.reading += 1

    @property
    def id(self) -> str:
        """Identity of document and drawing; the page ignores frames with another identity."""
        handles = self.state.handles
        return f"{self.document.id} {'' if handles is None else handles.file}"

    def restore(self) -> None:
        """Restore the draft of an earlier session."""
        draft = self.document.earlier_draft
        if draft is None:
            raise InvalidInput("There is no draft that can be restored.")
        self.commit(self.revise_text(draft.text), "restore the draft", run=draft.run)
        self.document.restore_steps(draft.steps)
        self.document.drop_earlier_draft()

    def select(self, run: str) -> None:
        """Show another run."""
        if run not in (self.state.data.get("runs") or {}):
            raise InvalidInput(f"The job has no run {run}.")
        self._show_run(run)
        self._refresh()

    def commit(self, revision: Revision, label: str, *, run: str = "") -> None:
        """Change the text as one step of undo; raises an error if a valid job becomes invalid.

        `run`: a run that is shown from now on, such as an added one; by default the same as before.
        """
        # The job is read before the text changes, so that an invalid job leaves the text unchanged.
        state = self._read_state(revision.data)
        is_refused = state.error is not None and not is_blank(revision.data)
        if state.error is not None and is_refused and self.state.job is not None:
            raise state.error
        if revision.text is not None:
            self.document.replace(revision.text, label)
        else:
            self.document.apply(dict(revision.data), label)
        if run:
            self._show_run(run)
        self._count_revision(None if run else state)

    def _show_run(self, run: str) -> None:
        """Show another run, and keep the one that was shown before it."""
        self._run_before = self.run
        self.run = run
        self.document.choose_run(run)

    def change(self, action: Callable[[], None]) -> None:
        """Change the document by one of its methods, such as `undo`."""
        action()
        self._count_revision()

    def revise(self, edits: Sequence[Mapping[str, Any]]) -> Revision:
        """Create a revision from the document and edits of a page; the document is unchanged."""
        if [x.get("do") for x in edits] == ["text"]:
            return self.revise_text(edits[0].get("text"))
        state = self.state
        if state.handles is None:
            raise state.error or InvalidInput("The document is not a valid job yet. Edit its text.")
        data = dict(state.data)
        handles = state.handles
        for k, edit in enumerate(edits):
            if k and edits[k - 1].get("do") in HANDLE_EDITS:
                handles = handles_of(self._make_job(data), data)
            edit_state = EditState(
                data=data,
                run=self.run,
                handles=handles,
                picker=self.picker,
                rules=self.edge_rules(data),
            )
            data = change_data(data, changes_of(edit, edit_state))
        return Revision(data)

    def edge_rules(self, data: Mapping[str, Any]) -> tuple[EdgeRule, ...] | None:
        """Return the rules that select edges of a CAD model; None if there are none."""
        path = data.get("path")
        if self.picker is None or not isinstance(path, Mapping):
            return None
        with suppress(InvalidInput):
            return self.previewer.edge_rules(data)
        return None

    def revise_text(self, text: Any) -> Revision:
        """Make the document's revision with a new text."""
        if not isinstance(text, str):
            raise InvalidInput("The text of a job must be a string.")
        data = load(text, self.document.source)
        if not isinstance(data, dict):
            raise InvalidInput("A job must be a mapping of keys such as arm, path and runs.")
        return Revision(data, text)

    def revise_keys(self, changes: Sequence[Change]) -> Revision:
        """Make the document's revision with changed keys."""
        return Revision(change_data(self.state.data, changes))

    def run_of(self, data: Mapping[str, Any]) -> str:
        """Return the run to show: the last one, the one before, the first optimal, or the first."""
        runs = runs_of(data)
        names = [x["name"] for x in runs]
        fast = [x["name"] for x in runs if x["timing"] == FASTEST and x["corners"] != "free"]
        shown = [x for x in (self.run, self._run_before) if x in names]
        return next(iter([*shown, *fast, *names]), "")

    def sources(self, text: str) -> list[SourceFile]:
        """Return a text of the job and its drawing, with their fingerprints."""
        sources = [SourceFile.from_text(self.document.source, text)]
        path = self.document.data.get("path")
        file = path.get("file") if isinstance(path, Mapping) else None
        if isinstance(file, str):
            drawing = self.folder / file
            with suppress(InvalidInput):
                content = read_bytes(drawing, "drawing")
                sources.append(SourceFile(drawing.name, fingerprint(content)))
        return sources

    def request(self, revision: Revision, options: Mapping[str, Any]) -> dict[str, Any]:
        """Request for the task process: the fields of `tasks.request.Request`."""
        text = revision.text
        if text is None:
            text = write_data(self.document.text, revision.data, self.document.source)
        return {
            "text": text,
            "source": self.document.source,
            "folder": str(self.folder),
            "run": self.run,
            "allowed": [str(x) for x in self.folders],
            "named": [str(x) for x in self.named],
            "options": dict(options),
            "logs": self.uploads.find_logs(options.get("logs") or []),
            "reading": self.reading,
        }

    def _count_revision(self, state: JobState | None = None) -> None:
        """Increase the revision number, and update the shown run and the job."""
        self.rev += 1
        self._refresh(state)

    def _refresh(self, state: JobState | None = None) -> None:
        """Update the shown run and the job; reads the job unless `state` is given."""
        self.run = self.run_of(self.document.data)
        self.state = state or self._read_state(self.document.data)

    def _read_state(self, data: Mapping[str, Any]) -> JobState:
        """Read job and handles from data; keep the error if they are not a valid job."""
        try:
            job = self._make_job(data)
            return JobState(data, job, handles_of(job, data))
        except InvalidInput as error:
            with suppress(InvalidInput):
                if is_blank(data):
                    blank = blank_handles(data, self._make_job)
                    sentence = NO_EDGES if has_no_edges(data["path"]) else NOTHING_DRAWN
                    return JobState(data, None, blank, InvalidInput(sentence))
                if self.state.handles is None:
                    handles = handles_of(self._make_job(path_only(data)), data)
                    return JobState(data, None, handles, error)
            # The page shows the last valid job in grey until the text is a valid job again.
            return JobState(data, None, self.state.handles, error)

    def _make_job(self, data: Mapping[str, Any]) -> Job:
        return self.previewer.job(data, self.run_of(data) or None)
