"""Jobs and studies: all arrows at once."""

from armcontour.study.job import Experiment, Job, Published, Rounding, Run
from armcontour.study.study import (
    STEPS,
    ExperimentResult,
    RunResult,
    Study,
    path_of,
    run,
    steps_of,
)

__all__ = [
    "STEPS",
    "Experiment",
    "ExperimentResult",
    "Job",
    "Published",
    "Rounding",
    "Run",
    "RunResult",
    "Study",
    "path_of",
    "run",
    "steps_of",
]
