"""Which jobs of a plan have results, and where these are: everything that parts tell."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.batches.plan import Plan
from armcontour.batches.tables import Block, Kind, blocks_of, readable
from armcontour.batches.working import ANSWERS, STATUSES, Outcome
from armcontour.errors import InvalidInput

# Columns that differ from one run of the same batch to the next.
SECONDS, WORKER, TRIES = UNREPRODUCIBLE = (
    "seconds (not reproducible)",
    "worker (not reproducible)",
    "tries (not reproducible)",
)
# Largest number of jobs whose figures are kept for pages.
MOST_SHOWN = 5_000


class Ledger:
    """The jobs of a plan by their keys, and what is known of each.

    Args:
        plan: The plan.

    Attributes:
        status: Index of each job's status in STATUSES, (n,); -1 without a result.
        stride: Of so many jobs, the figures of one are kept.
        figures: These figures, (ceil(n / stride), columns); NaN where there are none.

    Raises:
        InvalidInput: Two jobs are the same.
    """

    def __init__(self, plan: Plan) -> None:
        count = len(plan)
        self.plan = plan
        self.keys = np.empty(count, dtype="S32")
        for k, digest in enumerate(plan.digests()):
            self.keys[k] = digest
        self._order = np.argsort(self.keys, kind="stable").astype(np.int32)
        self._refuse_twins()
        self._errors: list[str] = []
        self.stride = max(1, -(-count // MOST_SHOWN))
        self._forget()

    def _forget(self) -> None:
        """Know of no results."""
        count = len(self.plan)
        self.status = np.full(count, -1, dtype=np.int8)
        self._error = np.full(count, -1, dtype=np.int16)
        self._block = np.full(count, -1, dtype=np.int32)
        self._row = np.zeros(count, dtype=np.int32)
        self._blocks: list[Block] = []
        # Files by their names, with their sizes and times.
        self._seen: dict[FilePath, tuple[int, int]] = {}
        self.figures = np.full((-(-count // self.stride), len(self.plan.columns)), np.nan)

    def _refuse_twins(self) -> None:
        """Refuse a plan with two jobs that are the same."""
        ordered = self.keys[self._order]
        twin = np.flatnonzero(ordered[1:] == ordered[:-1])
        if len(twin):
            first, second = sorted(self._order[twin[0] : twin[0] + 2].tolist())
            raise InvalidInput(
                f"The jobs {first + 1} and {second + 1} of the plan are the same: leave out one of "
                "the values, or files, that stand there twice."
            )

    def read(self, files: Iterable[FilePath]) -> None:
        """Take what files tell that were not read before.

        Args:
            files: Parts, and the file of results.
        """
        for file in files:
            state = _state(file)
            if file not in self._seen:
                with readable(file):
                    for block in blocks_of(file):
                        self._read(block)
                self._seen[file] = state

    def forget_missing(self, files: Iterable[FilePath]) -> None:
        """Forget all if a file that was read is there no more, or is another one.

        Args:
            files: The files that are there.
        """
        now = {x: _state(x) for x in files}
        if any(now.get(x) != state for x, state in self._seen.items()):
            self._forget()

    def _read(self, block: Block) -> None:
        """Take what a block tells."""
        names = ("key", "status", "error", *self.plan.columns)
        rows = block.read(names)
        at, known = self._find(rows["key"])
        status = np.array([STATUSES.index(x) for x in rows["status"]], dtype=np.int8)
        # An answer takes the place of none.
        taken = known & ((self.status[at] < 0) | (~_answered(self.status[at]) & _answered(status)))
        self._blocks.append(block)
        chosen = at[taken]
        self.status[chosen] = status[taken]
        self._block[chosen] = len(self._blocks) - 1
        self._row[chosen] = np.flatnonzero(taken)
        self._error[chosen] = [self._number(rows["error"][i]) for i in np.flatnonzero(taken)]
        shown = np.flatnonzero(taken & (at % self.stride == 0))
        for j, name in enumerate(self.plan.columns):
            values = [rows[name][i] for i in shown]
            self.figures[at[shown] // self.stride, j] = np.array(values, dtype=float)

    def _find(self, keys: Sequence[str]) -> tuple[Any, Any]:
        """Indices of jobs by their keys, and which of the keys belong to the plan."""
        wanted = np.array([bytes.fromhex(x) for x in keys], dtype="S32")
        place = np.searchsorted(self.keys, wanted, sorter=self._order)
        at = self._order[np.minimum(place, len(self.keys) - 1)]
        return at, self.keys[at] == wanted

    def _number(self, error: str | None) -> int:
        """The number of an error's name; -1 for none."""
        if error is None:
            return -1
        if error not in self._errors:
            self._errors.append(error)
        return self._errors.index(error)

    @property
    def done(self) -> int:
        """Number of jobs that have a result."""
        return int((self.status >= 0).sum())

    def todo(self, shard: tuple[int, int], *, retry: bool) -> IntArray:
        """Indices of the jobs that have no result yet.

        Args:
            shard: Number of the shard, from 0, and number of all shards.
            retry: Whether results that are no answers count as none.
        """
        missing = ~_answered(self.status) if retry else self.status < 0
        own = np.arange(len(self.status)) % shard[1] == shard[0]
        return np.flatnonzero(missing & own)

    def counts(self) -> dict[str, int]:
        """Number of jobs by their status, without those that no job has."""
        found = np.bincount(self.status[self.status >= 0], minlength=len(STATUSES))
        return {x: int(n) for x, n in zip(STATUSES, found, strict=True) if n}

    def errors(self) -> dict[str, int]:
        """Number of jobs by the name of their error, the most frequent first."""
        found = Counter(self._error[self._error >= 0].tolist())
        return {self._errors[k]: n for k, n in found.most_common()}

    def in_order(self, file: FilePath) -> bool:
        """Whether all results stand in one file and nowhere else, in the order of the jobs.

        Args:
            file: The file.
        """
        starts = np.cumsum([0, *(x.count for x in self._blocks)])
        if (
            {x.file for x in self._blocks} != {file}
            or self.done < len(self.status)
            or starts[-1] != len(self.status)
        ):
            return False
        return bool(np.array_equal(starts[self._block] + self._row, np.arange(len(self.status))))

    def rows(self, first: int, last: int) -> dict[str, list[Any]]:
        """Results of jobs in their order; those without one are left out.

        Args:
            first: Index of the first job.
            last: Index after the last job.
        """
        names = list(kinds_of(self.plan))
        own = [x for x in names if x not in ("number", "job", *self._keys)]
        where = np.flatnonzero(self._block[first:last] >= 0) + first
        found: dict[str, list[Any]] = {x: [None] * len(where) for x in own}
        for k in np.unique(self._block[where]):
            with readable(self._blocks[k].file):
                rows = self._blocks[k].read(own)
            for at in np.flatnonzero(self._block[where] == k):
                row = self._row[where[at]]
                for x in own:
                    found[x][at] = rows[x][row]
        return {x: found[x] for x in own} | described(self.plan, where.tolist())

    @property
    def _keys(self) -> list[str]:
        return [x.key for x in self.plan.parameters]

    def shown(self) -> IntArray:
        """Indices of the jobs whose figures are kept."""
        return np.arange(len(self.figures)) * self.stride

    def parameter(self, k: int) -> FloatArray:
        """Values of a parameter of these jobs; NaN where it is no number."""
        values = [self.plan.values(i)[k] for i in self.shown().tolist()]
        return np.array([x if _is_number(x) else np.nan for x in values], dtype=float)


def kinds_of(plan: Plan) -> dict[str, Kind]:
    """The columns of results, and what they hold."""
    kinds: dict[str, Kind] = {"number": "count", "job": "text"}
    kinds |= {x.key: "number" if x.numeric else "text" for x in plan.parameters}
    kinds |= {"status": "text", "error": "text", "sentence": "text"}
    kinds |= dict.fromkeys(plan.columns, "number")
    return kinds | {SECONDS: "number", WORKER: "text", TRIES: "count", "key": "text"}


def described(plan: Plan, indices: Sequence[int]) -> dict[str, list[Any]]:
    """The columns that say which job a row is of.

    Args:
        plan: The plan.
        indices: Indices of the jobs.
    """
    found: dict[str, list[Any]] = {
        "number": [k + 1 for k in indices],
        "job": [plan.bases[plan.base(k)].name for k in indices],
    }
    values = [plan.values(k) for k in indices]
    for j, x in enumerate(plan.parameters):
        column = [y[j] for y in values]
        found[x.key] = column if x.numeric else list(map(_as_text, column))
    return found


def rows_of(ledger: Ledger, outcomes: Sequence[tuple[int, Outcome]]) -> dict[str, list[Any]]:
    """Rows of outcomes, by the names of their columns.

    Args:
        ledger: The ledger of their plan.
        outcomes: Indices of jobs, and what came of them.
    """
    plan = ledger.plan
    indices = [k for k, _ in outcomes]
    found = described(plan, indices)
    found["key"] = [ledger.keys[k].ljust(32, b"\0").hex() for k in indices]
    for name in ("status", "error", "sentence"):
        found[name] = [getattr(x, name) for _, x in outcomes]
    for j, name in enumerate(plan.columns):
        found[name] = [x.figures[j] if x.figures else None for _, x in outcomes]
    found[SECONDS] = [x.seconds for _, x in outcomes]
    found[WORKER] = [x.worker or None for _, x in outcomes]
    found[TRIES] = [x.tries for _, x in outcomes]
    return found


def _answered(status: Any) -> Any:
    """Which results are answers: figures, or a refusal."""
    return (status >= 0) & (status < len(ANSWERS))


def _state(file: FilePath) -> tuple[int, int]:
    """Size and time of a file, which tell it from one that replaced it."""
    found = file.stat()
    return found.st_size, found.st_mtime_ns


def _as_text(value: Any) -> str:
    """A value of a parameter as text."""
    return value if isinstance(value, str) else json.dumps(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
