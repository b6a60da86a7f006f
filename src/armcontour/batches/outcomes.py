"""Outcomes of jobs: the work on a job in any process, and the results folder of a batch."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armcontour.batches.columns import CERTIFY, COLUMNS, COMPENSATE, PLACE, figures_of
from armcontour.batches.plan import Plan
from armcontour.core import staging
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.jobs import Job

if TYPE_CHECKING:
    from armcontour.report.sections.batch import PlotValues

# Statuses of jobs. DONE: the job has results. REFUSED: this library raised an error. FAILED: any
# other error, which may be temporary; the option `retry` repeats these jobs.
DONE, REFUSED, FAILED = STATUSES = ("done", "refused", "failed")


class Outcome(NamedTuple):
    """Outcome of a job."""

    # One of STATUSES
    status: str
    # Name of the error's class; None for a job that is done
    error: str | None = None
    # Message of the error; None for a job that is done
    sentence: str | None = None
    # Results for the columns of the plan; empty for a job that is not done
    figures: tuple[float | None, ...] = ()
    # Duration of the work [s]
    seconds: float = 0.0


@dataclass(frozen=True)
class Work:
    """Function that executes jobs of a plan; picklable for other processes."""

    plan: Plan

    def __call__(self, index: int) -> Outcome:
        """Execute the job with an index, from 0; errors become outcomes."""
        begin = time.perf_counter()
        try:
            base = self.plan.bases[self.plan.base(index)]
            job = base.job(self.plan.data(index))
            result = _execute_work(self.plan.work, job, base.run)
            outcome = Outcome(DONE, figures=figures_of(result, self.plan.columns, self.plan.work))
        except ArmContourError as error:
            outcome = Outcome(REFUSED, type(error).__name__, str(error))
        except Exception as error:
            outcome = Outcome(FAILED, type(error).__name__, str(error))
        return outcome._replace(seconds=time.perf_counter() - begin)


def process_ended() -> Outcome:
    """Outcome of a job whose process ended."""
    return Outcome(
        FAILED,
        "ProcessEnded",
        "The process of this job ended before the job was done. It crashed or was killed, for "
        "example because the machine ran out of memory.",
    )


def _execute_work(work: str, job: Job, run: str | None) -> Any:
    """Execute the work of the plan on a job; returns the result of the job."""
    if work == CERTIFY:
        from armcontour.studies.certification import certify

        return certify(job, run)
    if work == PLACE:
        from armcontour.studies.placement import place

        # One process, because the other processes execute other jobs.
        return place(job, run=run, processes=1)
    from armcontour import jobs

    return jobs.run(job, simulate=work != COMPENSATE).runs[str(run)]


ROWS, TABLE, REPORT = "results.jsonl", "results.parquet", "report.html"
# Name of the column with the run times, which differ if the same batch is run again.
SECONDS = "seconds (not reproducible)"


class Results:
    """Results folder of a batch; locked while the context manager is active."""

    def __init__(self, folder: FilePath, plan: Plan) -> None:
        self.folder, self.rows = folder, dict[int, dict[str, Any]]()
        self._plan, self._file = plan, folder / ROWS
        self._keys = plan.job_keys()
        self._indices = {key: k for k, key in enumerate(self._keys)}
        self._closing = ExitStack()

    def __enter__(self) -> Results:
        self._refuse_others()
        with self._closing as opened:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                path = self.folder / f"{staging.PREFIX}batch"
                self._staging = opened.enter_context(
                    staging.Staging(path, self.folder, growing=True)
                )
                self._read()
                self._lines = opened.enter_context(self._file.open("a", encoding="utf-8"))
            except OSError as error:
                raise staging.unwritable(f"to the folder {self.folder}", error) from None
            self._closing = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    def remaining(self, *, retry: bool) -> list[int]:
        """Indices of the jobs without a result; with `retry`, also of the failed jobs."""
        again = FAILED if retry else None
        rows = (self.rows.get(k, {"status": again}) for k in range(len(self._plan)))
        return [k for k, row in enumerate(rows) if row["status"] == again]

    def add(self, index: int, outcome: Outcome) -> None:
        """Store the outcome of a job, and write its row to the file immediately."""
        figures = outcome.figures or [None] * len(self._plan.columns)
        named = dict(zip(self._plan.columns, figures, strict=True))
        row = self._row(index, outcome._asdict() | named | {SECONDS: outcome.seconds})
        self.rows[index] = row
        self._lines.write(json.dumps(row) + "\n")
        self._lines.flush()

    def finish(self) -> list[dict[str, Any]]:
        """Write the rows in the order of the jobs, the table and the report; returns the rows."""
        rows = [self.rows[k] for k in range(len(self._plan))]
        self._lines.close()
        self._put(ROWS, "".join(json.dumps(x) + "\n" for x in rows).encode())
        if find_spec("pyarrow") is not None:
            self._put(TABLE, _parquet(rows, self._plan))
        self._put(REPORT, render_page(self._plan, rows).encode())
        return rows

    def _row(self, index: int, outcome: Mapping[str, Any]) -> dict[str, Any]:
        """Row of a job: its number, name, parameter values, outcome and key."""
        parameters = zip(self._plan.parameters, self._plan.values(index), strict=True)
        return {
            "number": index + 1,
            "job": self._plan.bases[self._plan.base(index)].name,
            **{
                x.key: y if x.numeric or isinstance(y, str) else json.dumps(y)
                for x, y in parameters
            },
            **{x: outcome[x] for x in ("status", "error", "sentence", *self._plan.columns)},
            SECONDS: outcome[SECONDS],
            "key": self._keys[index],
        }

    def _read(self) -> None:
        """Read existing rows of the plan, and truncate an incomplete last one."""
        if not self._file.exists():
            return
        data = self._file.read_bytes()
        complete = data.rfind(b"\n") + 1
        for k, line in enumerate(data[:complete].splitlines()):
            try:
                row = json.loads(line)
                index = self._indices.get(row["key"])
                if row["status"] not in STATUSES:
                    raise ValueError
                if index is not None:
                    self.rows[index] = self._row(index, row)
            except (ValueError, KeyError, TypeError, RecursionError):
                raise InvalidInput(
                    f"{self._file}, line {k + 1} is not a result of a batch. Remove the line or "
                    "the file, and run the batch again; it repeats the removed jobs."
                ) from None
        if complete < len(data):
            os.truncate(self._file, complete)

    def _put(self, name: str, content: bytes) -> None:
        """Write a file of the results folder atomically."""
        fresh = self._staging.folder / name
        fresh.write_bytes(content)
        with staging.moving():
            os.replace(fresh, self.folder / name)

    def _refuse_others(self) -> None:
        """Reject a folder that has files but no results of a batch."""
        if self.folder.exists() and not self.folder.is_dir():
            raise InvalidInput(f"{self.folder} is a file, not a folder. Choose another --out.")
        there = self.folder.iterdir() if self.folder.exists() else ()
        names = [x.name for x in there if not x.name.startswith(staging.PREFIX)]
        if names and ROWS not in names:
            raise InvalidInput(
                f"The folder {self.folder} is not empty and has no {ROWS} of a batch. Choose "
                "another --out."
            )


def _parquet(rows: list[dict[str, Any]], plan: Plan) -> bytes:
    """Rows as a Parquet file, with units in the metadata of the columns."""
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
    import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]

    numbers = {x.key for x in plan.parameters if x.numeric} | {*plan.columns, SECONDS}
    kinds = {"number": pa.int64(), **dict.fromkeys(numbers, pa.float64())}
    schema = pa.schema(
        [
            pa.field(
                x,
                kinds.get(x, pa.string()),
                metadata={"unit": plan.units[x]} if x in plan.units else None,
            )
            for x in rows[0]
        ]
    )
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), sink)
    return bytes(sink.getvalue())


# Maximum number of jobs in the plots of the report; larger batches are subsampled.
MAX_DRAWN = 5_000


def render_page(plan: Plan, rows: Sequence[Mapping[str, Any]]) -> str:
    """Render the results of a batch as a self-contained HTML page."""
    # Imported here, because worker processes do not need the plotting library.
    from armcontour.report import render_batch
    from armcontour.report.sections.batch import BatchView

    stride = max(1, -(-len(rows) // MAX_DRAWN))
    sampled = rows[::stride]
    axes = [_axis(x.key, x.unit, sampled, log=x.log) for x in plan.varied if x.numeric]
    figures = [_axis(x, COLUMNS[x].unit, sampled) for x in plan.columns]
    # Columns without values, such as placements along axes that are not varied, are omitted.
    drawn = [x for x in figures if np.isfinite(x.values).any()]
    names = ", ".join(x.name for x in plan.bases)
    varied = ", ".join(x.key for x in plan.varied)
    view = BatchView(
        name=plan.name,
        about=f"{len(plan)} jobs: {plan.work} {names}" + (f" over {varied}" if varied else ""),
        counts=Counter(x["status"] for x in rows),
        errors=Counter(x["error"] for x in rows if x["error"]),
        axes=tuple(axes),
        figures=tuple(drawn or figures),
        status=tuple(x["status"] for x in sampled),
        done=DONE,
        stride=stride,
    )
    return render_batch(view)


def _axis(
    name: str, unit: str | None, rows: Sequence[Mapping[str, Any]], *, log: bool = False
) -> PlotValues:
    """Values of a column in SI units, for a plot."""
    from armcontour.report.sections.batch import PlotValues

    values: FloatArray = np.array([x[name] for x in rows], dtype=float)
    return PlotValues(name, unit or "", values, log)
