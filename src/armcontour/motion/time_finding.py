"""What is wrong with the times of a recorded motion, and what was done about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.result import Row, Table
from armcontour.core.text import count_noun

# Number of samples that a sentence names.
MAX_NAMED_SAMPLES = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeFinding(Frozen):
    """Samples of a recording whose times are wrong, and the repair.

    Args:
        kind: "stall" (the set-points waited, but the times did not), "dropped" (samples are
            missing, but the times are even), "clock set" (the times jump), "clock rate", "extra"
            (a sample was written twice with two times), "torn" (joints of two cycles in a sample),
            "repeated" (old positions in a sample), "renewed" (positions are renewed more slowly
            than samples), or "jitter".
        sentence: The finding and the repair, for the user.
        samples: Indices of the samples, from 0; empty if all samples are affected.
        t: Recorded times of these samples [s].
        interval: Median true time from the previous sample to these samples [s]; nan if unknown.
        rate: True time per recorded time.
        repair: "rebuilt" (times from the velocities), "regular" (regular times), or "left out" (the
            positions are interpolated).
    """

    kind: str
    sentence: str
    samples: IntArray
    t: FloatArray
    repair: str
    interval: float = math.nan
    rate: float = 1.0

    @property
    def rows(self) -> tuple[Row, ...]:
        """The finding as rows of a table."""
        return (
            Row("kind", self.kind, "", "finding"),
            Row("count", len(self.samples), "", "samples"),
            Row("samples", self.samples.tolist()),
            Row("t", self.t, "s"),
            Row("interval", self.interval, "s", "true interval"),
            Row("rate", self.rate, "1", "clock rate"),
            Row("repair", self.repair, "", "repair"),
        )


def findings_table(findings: Sequence[TimeFinding]) -> Table:
    """Return findings as a table."""
    return Table.from_rows("findings", [x.rows for x in findings])


def name_samples(samples: IntArray, t: FloatArray) -> str:
    """Return the number of samples, and the first of them with their recorded times."""
    pairs = zip(samples[:MAX_NAMED_SAMPLES], t[:MAX_NAMED_SAMPLES], strict=True)
    named = ", ".join(f"{i + 1} at {time:.4g} s" for i, time in pairs)
    more = ", ..." if len(samples) > MAX_NAMED_SAMPLES else ""
    return f"{count_noun(len(samples), 'sample')} ({named}{more})"
