"""Class `Request`: a task for a document, with objects that are computed once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.core.progress import Progress

if TYPE_CHECKING:
    from armcontour.jobs import Job, RunResult
    from armcontour.report.view import View
    from armcontour.studio.plan_frames import Preview
    from armcontour.studio.preview import CoarsePlanner


@dataclass(kw_only=True)
class Request:
    """A task for a document; its properties are computed once.

    Args:
        text: Text of the job.
        source: Name of the document in messages.
        folder: Folder to which file names in the job are relative.
        run: Name of the shown run.
        options: Options of the task.
        logs: Files of the selected logs.
        allowed: Folders from which files may be read; empty: no restriction.
        named: Further files that may be read.
        origin: When and of what the result is made, for its file.
        reading: Number of times that the files of documents were read; a request with another
            number reads them again.
        plan: Pickled plan that a certificate proves, for its export.
        progress: Callback for the progress.
    """

    text: str
    source: str = "job"
    folder: str = ""
    run: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    logs: Sequence[str] = ()
    allowed: Sequence[str] = ()
    named: Sequence[str] = ()
    origin: str = ""
    reading: int = 0
    plan: bytes = b""
    progress: Progress = field(default=lambda step: None, compare=False)

    @cached_property
    def data(self) -> dict[str, Any]:
        """Keys and values of the job text."""
        from armcontour.files.job_file import read_job_mapping

        return read_job_mapping(self.text, self.source)

    @cached_property
    def previewer(self) -> CoarsePlanner:
        """Planner whose cached results are also used for the next tasks with the same files."""
        files = self.folder, self.reading
        if files not in _previewers:
            from armcontour.studio.preview import CoarsePlanner

            _previewers.clear()
            _previewers[files] = CoarsePlanner(FilePath(self.folder))
        return _previewers[files]

    @cached_property
    def job(self) -> Job:
        """The job with only this run, and without its certificate."""
        return self.previewer.job(self.data, self.run)

    @cached_property
    def whole_job(self) -> Job:
        """The job with all keys of its file."""
        from armcontour.files import parse_job

        return parse_job(self.text, source=self.source, folder=FilePath(self.folder))

    @cached_property
    def unchecked(self) -> RunResult:
        """Explained plan of the run without a check of collisions; not for a resumed job."""
        from armcontour.core.errors import error_context
        from armcontour.core.progress import subprogress
        from armcontour.jobs.run_plan import explain_plan, explained_reach, plan_one

        (run,) = self.job.runs
        report = subprogress(self.progress, run.name)
        with error_context(f"Run {run.name}"), self.previewer.remembering():
            with explained_reach(self.job):
                plan = plan_one(self.job, run, report, clear=False)
            return replace(plan, explanation=explain_plan(self.job, plan, report))

    @cached_property
    def result(self) -> RunResult:
        """Result of the run, simulated with its experiment."""
        from armcontour.jobs import run
        from armcontour.jobs.run_job import complete_run

        with self.previewer.remembering():
            if "unchecked" in self.__dict__:
                result = complete_run(self.job, self.unchecked, self.progress)
            else:
                (result,) = run(self.job, progress=self.progress).runs.values()
        if result.failure is not None:
            raise result.failure
        return result

    @property
    def preview(self) -> Preview:
        """Plan of the run with all that is known of it: its result, or the unchecked plan."""
        from armcontour.studio.plan_frames import Tier

        if "result" in self.__dict__:
            return self.previewer.shown(self.job, self.result, Tier.EXACT)
        return self.previewer.shown(self.job, self.unchecked, Tier.PREVIEW)

    @cached_property
    def view(self) -> View:
        """Projection of the job onto the plane of the picture."""
        from armcontour.report.view import View
        from armcontour.studio.handles import handles_of

        handles = handles_of(self.job, self.data)
        return View(handles.plane, handles.centre)

    def option(self, name: str, default: Any) -> Any:
        """Return an option of the task; the default if it is None or missing."""
        value = self.options.get(name)
        return default if value is None else value


# Planner of the last files, by folder and number of reading; at most one entry.
_previewers: dict[tuple[str, int], CoarsePlanner] = {}
