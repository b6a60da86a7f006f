"""Jobs, and `run`, which does all steps of a job and returns a study."""

from armcontour.jobs.analog import analog_outputs
from armcontour.jobs.experiment import Experiment, build_plant
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.place_search import PlaceSearch
from armcontour.jobs.programs import programs_of
from armcontour.jobs.shaped import Shaped
from armcontour.jobs.study import (
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
    warnings_of,
)

__all__ = [
    "STEPS",
    "Experiment",
    "ExperimentResult",
    "Goal",
    "Job",
    "PlaceSearch",
    "Rounding",
    "Run",
    "RunPlan",
    "RunResult",
    "Shaped",
    "Study",
    "analog_outputs",
    "build_plant",
    "path_of",
    "programs_of",
    "run",
    "same_plan",
    "steps_of",
    "teach",
    "traced_alike",
    "warnings_of",
]
