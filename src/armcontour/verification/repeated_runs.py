"""`RepeatedRuns`: largest error and spread of several runs of one program at one speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.render import Result, number, number_range
from armcontour.core.result import FIRST, Data, Row
from armcontour.core.text import count_noun

# Errors of runs differ if the gap between them exceeds this fraction of the median error.
DIFFERENT_SHARE = 0.2
# The gap must also exceed this multiple of the spread of the runs that agree.
DIFFERENT_SPREADS = 5.0
# The gap must also exceed this [m], because robots repeat their positions to some hundredths of a
# millimetre.
LEAST_DIFFERENCE = 10e-6
# A joint has left its first position, or is not yet at its last one, if it is farther away than
# this fraction of its motion.
REST_SHARE = 0.01
# Durations of repeated motions differ by at most this fraction.
MAX_DURATION_DIFFERENCE = 0.03


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepeatedRuns(Result):
    """Largest errors of several runs of one program at one speed.

    The figures describe these runs. They do not say with which probability a later run is within
    them, because a robot changes between runs.

    >>> runs = RepeatedRuns(largest=np.array([0.433e-3, 0.437e-3, 0.435e-3, 1.444e-3]))
    >>> runs.different.tolist()
    [3]

    Args:
        largest: Largest error of each run, in their order [m], (n,).
        numbers: Numbers of the runs for messages, (n,); by default from 1.
    """

    largest: FloatArray
    numbers: IntArray | None = None

    @property
    def spread(self) -> float:
        """Difference between the largest and the smallest of the errors [m]."""
        return float(np.ptp(self.largest))

    @property
    def different(self) -> IntArray:
        """Indices of the runs that differ from the others, in order; empty if the runs agree.

        The errors, sorted by size, are divided at their widest gap. The smaller part differs if the
        gap is wide; of two equal parts, the one without the first run.
        """
        count = len(self.largest)
        if count < 3:
            return np.empty(0, dtype=np.intp)
        order = np.argsort(self.largest, kind="stable")
        gaps = np.diff(self.largest[order])
        widest = int(np.argmax(gaps))
        low = order[: widest + 1]
        high = order[widest + 1 :]
        low_agrees = len(low) > len(high) or (len(low) == len(high) and 0 in low)
        agreeing, others = (low, high) if low_agrees else (high, low)
        errors = self.largest[agreeing]
        least = max(
            LEAST_DIFFERENCE,
            DIFFERENT_SHARE * float(np.median(errors)),
            DIFFERENT_SPREADS * float(np.ptp(errors)),
        )
        return np.sort(others) if gaps[widest] > least else np.empty(0, dtype=np.intp)

    @property
    def note(self) -> str:
        """Sentences on the runs that differ from the others; empty if the runs agree."""
        different = self.different
        if not len(different):
            return ""
        agreeing = np.setdiff1d(np.arange(len(self.largest)), different)
        is_one = len(different) == 1
        errors = number_range(self.largest[different].tolist(), "m")
        return (
            f"{self._names(different)} differ{'s' if is_one else ''} from "
            f"{self._names(agreeing).lower()}: the largest error is {errors} instead of "
            f"{number_range(self.largest[agreeing].tolist(), 'm')}. Compare tool, load, speed and "
            "log of these runs, and record them again."
        )

    def _names(self, indices: IntArray) -> str:
        """Return 'Run 4', or 'Runs 1 to 3' for successive numbers, or 'Runs 1, 2, 5'."""
        numbers = np.arange(1, len(self.largest) + 1) if self.numbers is None else self.numbers
        chosen = numbers[indices].tolist()
        if len(chosen) == 1:
            return f"Run {chosen[0]}"
        if len(chosen) > 2 and chosen[-1] - chosen[0] == len(chosen) - 1:
            return f"Runs {chosen[0]} to {chosen[-1]}"
        return f"Runs {', '.join(map(str, chosen))}"

    @property
    def rows(self) -> tuple[Row, ...]:
        """Rows with the largest error and the spread."""
        runs = count_noun(len(self.largest), "run")
        largest = float(self.largest.max())
        return (
            Row("largest_of_runs", largest, "m", f"largest error of {runs}", level=FIRST),
            Row("spread_of_runs", self.spread, "m", "spread of largest errors", level=FIRST),
            Row("different_runs", (self.different + 1).tolist()),
        )

    def to_data(self) -> Data:
        """Return the largest error, the spread and the runs that differ."""
        notes = (self.note,) if self.note else ()
        return Data(count_noun(len(self.largest), "repeated run"), self.rows, notes=notes)


def require_equal_durations(
    sources: Sequence[str], motions: Sequence[tuple[FloatArray, FloatArray]]
) -> None:
    """Raise InvalidInput if repeated motions last differently long, as at another speed.

    - `sources`: names of the logs, for messages.
    - `motions`: times [s], (n,), and joint positions [rad], (n, dof), of each log.
    """
    durations = [moving_time(*x) for x in motions]
    for source, duration in zip(sources, durations, strict=True):
        if abs(duration - durations[0]) > MAX_DURATION_DIFFERENCE * durations[0]:
            raise InvalidInput(
                f"{source} moves for {number(duration, 's')}, but {sources[0]} for "
                f"{number(durations[0], 's')}. Repeated runs must have one program and one speed. "
                "Specify logs of the same motion."
            )


def moving_time(t: FloatArray, q: FloatArray) -> float:
    """Return the time from the begin to the end of a motion [s].

    - `t`, `q`: times [s], (n,), and joint positions [rad], (n, dof).
    """
    share = REST_SHARE * np.ptp(q, axis=0)
    left = np.flatnonzero((np.abs(q - q[0]) > share).any(axis=1))
    reached = np.flatnonzero((np.abs(q - q[-1]) > share).any(axis=1))
    if not len(left) or not len(reached):
        return 0.0
    return float(t[reached[-1]] - t[left[0]])
