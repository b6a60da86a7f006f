"""The skeleton of all commands: claim the result folder, work with progress, write, print, end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Annotated, Any, ClassVar, TypeAlias

import typer

from armcontour import files
from armcontour.cli.console import ProgressDisplay, print_lines
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.progress import listen_to_compilation

# Names of the report and the JSON output in a result folder.
REPORT = "report.html"
SUMMARY = "summary.json"


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results.

    Args:
        out: Folder for the results; by default none is written.
        force: Replace an earlier result in that folder.
    """

    out: Annotated[FilePath | None, typer.Option("--out", "-o")] = None
    force: bool = False
    # Kind of a result that a repeated command replaces without --force.
    kind: ClassVar[str] = ""

    def claim(self) -> files.ResultFolder | None:
        """Return the folder of --out, locked until the command ends; None without --out."""
        if self.out is not None:
            return files.ResultFolder(self.out, force=self.force, replaces=self.kind)
        if self.force:
            raise InvalidInput("--force requires --out, the folder for the results.")
        return None


@dataclass(frozen=True, kw_only=True)
class Json:
    """Results.

    Args:
        as_json: Print JSON instead of a table.
    """

    as_json: Annotated[bool, typer.Option("--json")] = False


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command returns: printed lines, JSON data and exit code.

    Args:
        lines: Lines to print.
        page: Data for --json, and for summary.json if the work has written files.
        code: Exit code.
        error: Error that is raised after the files were written; the lines are printed before.
    """

    lines: Sequence[str] = ()
    page: Mapping[str, Any] | None = None
    code: int = 0
    error: ArmContourError | None = None


Work: TypeAlias = Callable[[Any, Any, ProgressDisplay], Outcome]


def execute(work: Work, options: Any) -> int:
    """Run a command and return its exit code; an error in the work leaves nothing written.

    Args:
        work: Called with the options, the folder of --out (None without it) and the progress.
        options: The options; `Results` and `Json` are for this function.
    """
    with ExitStack() as stack:
        folder = options.claim() if isinstance(options, Results) else None
        if folder is not None:
            stack.enter_context(folder)
        progress = ProgressDisplay(type(options).__name__.lower())
        stack.callback(progress.hide)
        stack.enter_context(listen_to_compilation(progress.note_compilation))
        outcome = work(options, folder, progress)
        if folder is not None and folder.files and outcome.page is not None:
            write_summary(folder, outcome.page)
    if outcome.page is not None and isinstance(options, Json) and options.as_json:
        print(files.to_json(outcome.page), end="")
        raise_if_failed(outcome)
        return outcome.code
    print_lines(*outcome.lines)
    if folder is not None and REPORT in folder.files:
        print_lines(report_line(folder.folder))
    raise_if_failed(outcome)
    return outcome.code


def raise_if_failed(outcome: Outcome) -> None:
    """Raise the error of an outcome, if it has one."""
    if outcome.error is not None:
        raise outcome.error


def write_summary(folder: files.ResultFolder, page: Mapping[str, Any]) -> None:
    """Write summary.json with the data of a result and the names of all files."""
    listed = {**page, "files": [*folder.files, SUMMARY]}
    folder.write(SUMMARY, files.to_json(listed))


def report_line(folder: FilePath) -> str:
    """Return the line with the address of the report in a folder."""
    return f"Report: {(folder / REPORT).resolve().as_uri()}"
