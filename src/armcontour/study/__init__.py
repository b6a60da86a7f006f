"""Jobs and studies: all arrows at once."""

from armcontour.study.certificate import Budget, Certificate, Uncertified, certify
from armcontour.study.goal import Goal
from armcontour.study.job import Experiment, Job, Published, Rounding, Run
from armcontour.study.study import (
    STEPS,
    ExperimentResult,
    RunPlan,
    RunResult,
    Study,
    path_of,
    run,
    same_plan,
    steps_of,
    teach,
    traced_alike,
)
from armcontour.study.sweeping import Sweep, SweepPoint, sweep

__all__ = [
    "STEPS",
    "Budget",
    "Certificate",
    "Experiment",
    "ExperimentResult",
    "Goal",
    "Job",
    "Published",
    "Rounding",
    "Run",
    "RunPlan",
    "RunResult",
    "Study",
    "Sweep",
    "SweepPoint",
    "Uncertified",
    "certify",
    "path_of",
    "run",
    "same_plan",
    "steps_of",
    "sweep",
    "teach",
    "traced_alike",
]
