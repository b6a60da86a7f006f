"""What a preview gives: the plan of a run, and its execution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armcontour._checks import FloatArray
from armcontour.evaluation import ErrorProfile
from armcontour.evaluation.pieces import Piece
from armcontour.jobs import Job
from armcontour.jobs.results import Planned
from armcontour.motion import Execution, TaughtData


@dataclass(frozen=True, kw_only=True, eq=False)
class Preview(Planned):
    """The plan of a run of a document.

    Args:
        job: The job, with this run only.
        start: Joint positions at the start of the motion [rad], (dof,).
        seconds: Time that each step took [s], without steps whose results were kept.
        differs: Sentences on what a full run may do in another way.
        below_base: A sentence on links that come below the base; None if none does.
    """

    job: Job
    start: FloatArray
    seconds: Mapping[str, float] = field(default_factory=dict)
    differs: tuple[str, ...] = ()
    below_base: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Executed:
    """The simulated execution of a plan.

    Args:
        planned: The plan.
        taught: The set-points.
        execution: The executed motion.
        pieces: The execution along each contour.
        errors: The contour error.
        settled: Time after which the tool is at rest [s].
        seconds: Time that each step took [s], without steps whose results were kept.
    """

    planned: Preview
    taught: TaughtData
    execution: Execution
    pieces: tuple[Piece, ...]
    errors: ErrorProfile
    settled: float
    seconds: Mapping[str, float] = field(default_factory=dict)
