"""The folder of a batch: its plan, parts of results, and in the end one file of all."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Any

from armcontour import _files, _staging
from armcontour.batches.ledger import Ledger, kinds_of, rows_of
from armcontour.batches.page import render_page
from armcontour.batches.summary import Extremes, plan_json, summary_json
from armcontour.batches.tables import LINES, PARQUET, Rows, ending, move_in_place, write_table
from armcontour.batches.working import Outcome
from armcontour.errors import InvalidInput

PLAN, PARTS, RESULTS, REPORT, SUMMARY = (
    "plan.json",
    "parts",
    "results",
    "report.html",
    "summary.json",
)
# Jobs whose results are in memory at once when all are written to one file.
SLICE = 20_000
# What tells a report, and a plan or summary, from files of others with the same names.
GENERATOR = '<meta name="generator" content="armcontour">'
DATA_KEYS = {"armcontour", "batch", "do", "jobs", "count"}
NUMBER = re.compile(r"(?:all|\d+-of-\d+)-(\d{6,})\.(?:parquet|jsonl)")


class BatchFolder:
    """The folder of a batch; a context manager that locks it for one shard.

    Args:
        folder: The folder.
        ledger: The ledger of the plan.
        shard: Number of the shard, from 0, and number of all.

    Attributes:
        folder: The folder.

    Raises:
        InvalidInput: The folder holds other files, cannot be written, or another run has it.
    """

    def __init__(self, folder: FilePath, ledger: Ledger, shard: tuple[int, int]) -> None:
        self.folder = folder
        self._ledger, self._shard = ledger, shard
        self._plan = ledger.plan
        self._name = "all" if shard[1] == 1 else f"{shard[0] + 1}-of-{shard[1]}"
        try:
            self._refuse_others()
            (folder / PARTS).mkdir(parents=True, exist_ok=True)
            self._staging = _staging.Staging(
                folder / f"{_staging.PREFIX}{self._name}", folder, growing=True
            )
        except OSError as error:
            raise _staging.unwritable(f"to the folder {folder}", error) from None
        self._staging.empty()
        self._next = 1 + max(
            (int(x[1]) for f in result_files(folder) if (x := NUMBER.fullmatch(f.name))), default=0
        )
        self._put(PLAN, plan_json(self._plan))

    def __enter__(self) -> BatchFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self._staging.remove()

    @property
    def total(self) -> int:
        """Number of jobs of the shard."""
        return len(range(self._shard[0], len(self._plan), self._shard[1]))

    def look(self) -> None:
        """Have the ledger read what is new in the folder."""
        look(self.folder, self._ledger)

    def reopen(self) -> None:
        """Remove the summary, which tells that the results are complete."""
        (self.folder / SUMMARY).unlink(missing_ok=True)

    def write(self, outcomes: Sequence[tuple[int, Outcome]]) -> None:
        """Write a part.

        Args:
            outcomes: Indices of jobs, and what came of them.
        """
        name = f"{self._name}-{self._next:06d}{ending()}"
        self._next += 1
        fresh = self._staging.place / name
        rows = rows_of(self._ledger, outcomes)
        write_table(fresh, [rows], kinds_of(self._plan), self._plan.units)
        move_in_place(fresh, self.folder / PARTS / name)

    def show(self, left: float | None) -> None:
        """Write the page of what is done so far; of several shards, the first does it.

        Args:
            left: Time left [s]; None if unknown.
        """
        if self._shard[0] == 0:
            self.look()
            self._put(REPORT, render_page(self._ledger, left=left, live=True))

    def finish(self) -> None:
        """When all jobs have a result: write one file of all, a summary and a report."""
        self.look()
        if self._ledger.done < len(self._plan):
            return
        try:
            alone = _staging.Staging(
                self.folder / f"{_staging.PREFIX}finish", self.folder, growing=True
            )
        except InvalidInput:
            # Another shard that ended at the same time does it.
            return
        with alone:
            extremes = Extremes(self._plan)
            if self._ledger.in_order(self.folder / f"{RESULTS}{ending()}"):
                for block in self.blocks():
                    extremes.add(block)
            else:
                self._compact(extremes)
            self._put(REPORT, render_page(self._ledger))
            self._put(SUMMARY, summary_json(self._ledger, extremes))

    def _compact(self, extremes: Extremes) -> None:
        """Write all results to one file, and remove the parts."""
        old = result_files(self.folder)
        name = f"{RESULTS}{ending()}"
        fresh = self._staging.place / name

        def counted() -> Iterator[Rows]:
            for block in self.blocks():
                extremes.add(block)
                yield block

        write_table(fresh, counted(), kinds_of(self._plan), self._plan.units)
        move_in_place(fresh, self.folder / name)
        for x in old:
            if x != self.folder / name:
                x.unlink(missing_ok=True)
        self.look()

    def blocks(self) -> Iterator[dict[str, list[Any]]]:
        """The results in the order of the jobs, some at a time."""
        return blocks(self._ledger)

    def _put(self, name: str, text: str) -> None:
        """Write a file of text whole."""
        fresh = self._staging.place / name
        fresh.write_text(text, encoding="utf-8")
        move_in_place(fresh, self.folder / name)

    def _refuse_others(self) -> None:
        """Refuse a folder with files that are not of a batch.

        Raises:
            InvalidInput: It is such a folder, or a file.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InvalidInput(f"{self.folder} is a file, not a folder: choose another --out.")
        if not self.folder.is_dir() or not any(self.folder.iterdir()):
            return
        parts = self.folder / PARTS
        if parts.is_symlink() or not parts.is_dir() and parts.exists():
            raise InvalidInput(f"{parts} is a link or a file, not a folder: remove it.")
        others = [x for x in parts.glob("*") if not NUMBER.fullmatch(x.name) or x.is_symlink()]
        if others:
            raise InvalidInput(
                f"{others[0]} is no part of a batch of armcontour: move it away, or choose another "
                "--out."
            )
        for name in (PLAN, SUMMARY, REPORT, *(f"{RESULTS}{x}" for x in (PARQUET, LINES))):
            file = self.folder / name
            if file.is_symlink() or (file.exists() and not _is_ours(file)):
                raise InvalidInput(
                    f"{file} was not written by a batch of armcontour: move it away, or choose "
                    "another --out."
                )
        # The plan is written before any part.
        hidden = [x for x in self.folder.iterdir() if not x.name.startswith(_staging.PREFIX)]
        started = {x.name for x in hidden} <= {PARTS} and not any(parts.glob("*"))
        if not (self.folder / PLAN).exists() and not started:
            raise InvalidInput(
                f"The folder {self.folder} is not empty and holds no batch of armcontour: choose "
                "another --out."
            )


def _is_ours(file: FilePath) -> bool:
    """Whether a batch wrote a file; tables of results are checked when they are read."""
    if file.suffix in (PARQUET, LINES):
        return file.is_file()
    try:
        text = _files.read_text(file, "file")
        return GENERATOR in text if file.name == REPORT else DATA_KEYS <= set(json.loads(text))
    except (InvalidInput, ValueError, TypeError, RecursionError):
        return False


def result_files(folder: FilePath) -> list[FilePath]:
    """The files with results in the folder of a batch: one of all, and parts by their names."""
    found = [folder / f"{RESULTS}{x}" for x in (PARQUET, LINES)]
    parts = sorted(x for x in (folder / PARTS).iterdir() if x.suffix in (PARQUET, LINES))
    return [x for x in found if x.exists()] + parts


def look(folder: FilePath, ledger: Ledger) -> None:
    """Have a ledger read the results in a folder that it does not know yet.

    Args:
        folder: The folder of a batch.
        ledger: The ledger of its plan.
    """
    while True:
        # Another shard may just have moved all parts to one file.
        with suppress(FileNotFoundError):
            files = result_files(folder)
            ledger.forget_missing(files)
            ledger.read(files)
            return


def blocks(ledger: Ledger) -> Iterator[dict[str, list[Any]]]:
    """The results that a ledger knows in the order of the jobs, some at a time."""
    names = kinds_of(ledger.plan)
    for first in range(0, len(ledger.plan), SLICE):
        rows = ledger.rows(first, min(first + SLICE, len(ledger.plan)))
        yield {x: rows[x] for x in names}
