"""Origin of a report: date, job, and the files from which it was computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from armcontour.core.source_file import SourceFile, writing_time
from armcontour.jobs import Job


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """What a page was computed from, for its header.

    Args:
        job: Name of the job; empty without one.
        sources: Files with their fingerprints.
    """

    job: str = ""
    sources: Sequence[SourceFile] = ()

    @classmethod
    def of(cls, job: Job, *others: SourceFile) -> Origin:
        """Return the origin of a page about a job; `others` are further files."""
        return cls(job=job.name, sources=(*job.sources, *others))

    @property
    def date(self) -> datetime:
        """Time at which the page is written."""
        return writing_time()
