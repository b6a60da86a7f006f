"""`batch`, which runs a job for every combination of key values."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain, product
from pathlib import Path as FilePath
from typing import Any

from armcontour.core import file_access
from armcontour.core.compilation import compile_kernels
from armcontour.core.errors import ArmContourError, FileError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.pool import open_executor, run_all
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.render import compare, jsonable, lay_out
from armcontour.core.result import FIRST, JUDGED, VERDICT, Data, Row
from armcontour.core.source_file import SourceFile
from armcontour.core.text import Keys, count_noun, short_repr, show
from armcontour.files.exports.export_checks import check_exports
from armcontour.files.job_file import read_job
from armcontour.files.job_patch import Patch, key_of
from armcontour.files.sources import CHANGED
from armcontour.jobs import Job, run

# Name of the file with a line of JSON per job, in the order in which the jobs are completed.
LINES = "results.jsonl"
# Name of the file with the final table.
TABLE = "results.csv"
# Statuses of a job:
DONE = "done"
REFUSED = "refused"  # This library raised an error.
INVALID = "invalid"  # The job cannot be read.
FAILED = "failed"  # Any other error.
# Result of a job: status, and either runs or a sentence.
Line = dict[str, Any]
# Number of a job, from 1, and its values by key path.
Task = tuple[int, Patch]


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchRow:
    """A run in a batch, or a job without results.

    Args:
        job: Number of the job, from 1.
        values: Values of the varied keys, as specified.
        status: "done", "refused" by the library, "invalid" input, or "failed" for another reason.
        run: Name of the run; empty for a job without results.
        data: Results of the run, as `run` prints them.
        error: Message of a job without results.
    """

    job: int
    values: Mapping[str, Any]
    status: str
    run: str = ""
    data: Data
    error: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Results of a batch: one row per job and run.

    Args:
        title: Name of the job file or drawing, and number of jobs.
        rows: The rows, in the order of the combinations.
        sources: Files from which the first valid job was read.
    """

    title: str
    rows: tuple[BatchRow, ...]
    sources: tuple[SourceFile, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """Number of jobs by status."""
        return dict(Counter({x.job: x.status for x in self.rows}.values()))

    def table(self) -> list[dict[str, Any]]:
        """Return rows as mappings with equal keys, for CSV files and pandas, in SI units."""
        rows = [_plain_row(x) for x in self.rows]
        # The error is the last column.
        names = sorted(dict.fromkeys(chain.from_iterable(rows)), key=lambda name: name == "error")
        return [{name: x.get(name) for name in names} for x in rows]

    def cells(self) -> list[tuple[str, ...]]:
        """Return the main results as texts in a table with a header; a column per shown result."""
        several = len({x.run for x in self.rows if x.run}) > 1
        results = {}
        for k, x in enumerate(self.rows):
            texts = {key: y if isinstance(y, str) else json.dumps(y) for key, y in x.values.items()}
            rows = [Row(key, y, "", key, level=VERDICT) for key, y in texts.items()]
            rows += [Row("run", x.run or "-", "", "run", level=VERDICT)] * several
            rows += [y for y in x.data.rows if not isinstance(y.value, str)]
            rows += [Row("status", x.status, "", "verdict", level=VERDICT)] * (x.status != DONE)
            results[str(k)] = Data("", tuple(rows))
        header, *table = compare(results, FIRST, texts=True)
        numbers = [str(x.job) for x in self.rows]
        return [("job", *header[1:]), *((n, *x[1:]) for n, x in zip(numbers, table, strict=True))]

    def errors(self) -> list[str]:
        """Return the message of each job without results, with the number of the job."""
        return [f"Job {x.job}: {x.error}" for x in self.rows if x.error]

    def __str__(self) -> str:
        """Return the main results as a table, and messages of jobs without results."""
        return "\n".join([lay_out(self.title, self.cells()), *self.errors()])

    __repr__ = short_repr


@checked
def batch(
    job: str | FilePath,
    over: Mapping[Any, Sequence[Any]],
    out: str | FilePath | None = None,
    *,
    cell: str | FilePath | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Batch:
    """Run a job for every combination of key values; a refused job is also a row.

    With `out`, each result is written to `results.jsonl` at once, so that an interruption loses no
    result, and the table is written to `results.csv` at the end.

    >>> result = ac.batch("job.yaml", {"limits.speed": ["20 mm/s", "50 mm/s"]}, workers=0)
    >>> [row.data["kept"].value for row in result.rows]
    [True, True]

    Args:
        job: A job file, or with `cell` a drawing.
        over: Lists of values by key of the job, as in a job file.
        out: New folder for the results.
        cell: Cell of a drawing: a built-in cell or a job file.
        workers: Number of processes on this machine; by default one per processor. 0 works in
            this process.
        executor: Your own executor, such as `Client.get_executor()` of Dask.
        progress: Called with the completed share.

    Raises:
        InvalidInput: No job can be read, or the folder is not empty.
        Exception: An error of your own executor; finished results remain.
    """
    file = FilePath(job)
    report = subprogress(progress)
    for key, values in over.items():
        if not len(values):
            raise InvalidInput(f"over has no values for {show(key)}. Specify one, or remove it.")
    reader = _Reader(str(file.absolute()), None if cell is None else str(cell))
    keys = [key_of(x) for x in over]
    patches = [dict(zip(keys, x, strict=True)) for x in product(*over.values())]
    tasks = list(enumerate(patches, start=1))
    first = reader.read_first(patches)
    lines: dict[int, Line] = {}
    with (
        open_executor(workers, executor) as opened,
        _open_results(None if out is None else FilePath(out)) as add,
    ):
        if opened is not None:
            # Compile here first; otherwise several processes would compile the same functions.
            compile_kernels("plane" if first.arm.dimension == 2 else "space", report)
        counts = Counter[str]()
        take = partial(next, iter(tasks), None)
        for (k, patch), line in run_all(reader, take, opened, _lost_job):
            lines[k] = line
            named = {".".join(map(str, x)): value for x, value in patch.items()}
            add({"job": k, "values": named, **line})
            counts[line["status"]] += 1
            report(_completed(counts, len(tasks)))
        rows = _collect_rows(keys, tasks, lines)
        title = f"{file.name}: {count_noun(len(tasks), 'job')}"
        # The values of the jobs differ, so they are no source of the batch.
        sources = tuple(x for x in first.sources if not x.name.startswith(CHANGED))
        result = Batch(title=title, rows=rows, sources=sources)
        if out is not None:
            _write_table(FilePath(out) / TABLE, result.table())
        return result


def _completed(counts: Counter[str], total: int) -> Step:
    """Return the progress of a batch from the numbers of completed jobs by status."""
    done = counts.total()
    words = [f"{done} of {total} jobs"]
    words += [f"{n} {x}" for x, n in counts.items() if x != DONE]
    return Step((", ".join(words),), done / total)


@dataclass(frozen=True, slots=True)
class _Reader:
    """Function that reads and runs one job of a batch; picklable for other processes."""

    file: str
    cell: str | None

    def read(self, patch: Patch) -> Job:
        job = read_job(self.file, cell=self.cell, patch=patch)
        check_exports(job)
        return job

    def read_first(self, patches: Sequence[Patch]) -> Job:
        """Read the first valid job; raise the error of the first job if all are invalid."""
        errors = []
        for patch in patches:
            try:
                return self.read(patch)
            except InvalidInput as error:
                errors.append(error)
        raise errors[0]

    def __call__(self, task: Task) -> Line:
        """Run one job and return its line of the results; an error becomes part of the line."""
        try:
            job = self.read(task[1])
        except ArmContourError as error:
            return {"status": INVALID, "error": str(error)}
        try:
            figures = run(job).figures
        except ArmContourError as error:
            return {"status": REFUSED, "error": str(error)}
        except Exception as error:
            return {"status": FAILED, "error": f"{type(error).__name__}: {error}"}
        runs = {
            name: [[x.name, jsonable(x.figure), x.unit, x.label, x.level] for x in data.shown()]
            for name, data in figures.items()
        }
        return {"status": DONE, "runs": runs}


def _lost_job(error: str) -> Line:
    """Return the line of a job whose process ended with an error."""
    return {"status": FAILED, "error": error}


def _plain_row(row: BatchRow) -> dict[str, Any]:
    """Return a row as a mapping; the keys of values with a unit end with the unit."""
    results = {}
    for x in row.data.rows:
        name = x.name if x.unit in ("", JUDGED) else f"{x.name} [{x.unit}]"
        results[name] = x.value
    start = {"job": row.job, **row.values, "run": row.run, "status": row.status}
    return {**start, **results, "error": row.error}


def _collect_rows(
    keys: Sequence[Keys], tasks: Sequence[tuple[int, Patch]], lines: Mapping[int, Line]
) -> tuple[BatchRow, ...]:
    """Collect the rows of all jobs, with the values of those keys that vary."""
    varied = []
    for key in keys:
        texts = {json.dumps(patch[key]) for _, patch in tasks}
        if len(texts) > 1:
            varied.append(key)
    rows = list[BatchRow]()
    for number, patch in tasks:
        values = {".".join(map(str, key)): patch[key] for key in varied}
        rows += _rows(number, values, lines[number])
    return tuple(rows)


def _rows(number: int, values: Mapping[str, Any], line: Line) -> Iterator[BatchRow]:
    """Yield the rows of a job."""
    status = line["status"]
    if status != DONE:
        error = line["error"]
        yield BatchRow(job=number, values=values, status=status, data=Data(""), error=error)
    for name, rows in line.get("runs", {}).items():
        data = Data(name, tuple(Row(x[0], x[1], x[2], x[3], "", x[4]) for x in rows))
        yield BatchRow(job=number, values=values, status=status, run=name, data=data)


@contextmanager
def _open_results(folder: FilePath | None) -> Iterator[Callable[[Line], object]]:
    """Open the file of results in a new folder; yields a function that appends a result."""
    if folder is None:
        yield lambda line: None
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise FileError(f"The folder {folder} is not empty. Choose another --out.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stream = (folder / LINES).open("x", encoding="utf-8", buffering=1)
    except OSError as error:
        raise file_access.unwritable(f"to the folder {folder}", error) from None
    with stream:
        yield lambda line: stream.write(json.dumps(line) + "\n")


def _write_table(file: FilePath, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows with equal keys to a CSV file, atomically."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(rows[0])
    for row in rows:
        values = (json.dumps(x) if isinstance(x, list | dict) else x for x in row.values())
        table.writerow(["" if x is None else x for x in values])
    file_access.write_atomically(file, lambda x: x.write_text(text.getvalue(), encoding="utf-8"))
