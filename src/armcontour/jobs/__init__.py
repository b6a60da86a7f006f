"""Jobs, and `run`, which does all steps of a job and returns a study."""

from armcontour.jobs.analog import analog_outputs
from armcontour.jobs.experiment import Experiment, build_plant
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.place_search import PlaceSearch
from armcontour.jobs.programs import programs_of
from armcontour.jobs.results import ExperimentResult, RunResult, ShapingGain, Study, warnings_of
from armcontour.jobs.study import STEPS, run, steps_of, traced_alike

__all__ = [
    "STEPS",
    "Experiment",
    "ExperimentResult",
    "Goal",
    "Job",
    "PlaceSearch",
    "Rounding",
    "Run",
    "RunResult",
    "ShapingGain",
    "Study",
    "analog_outputs",
    "build_plant",
    "programs_of",
    "run",
    "steps_of",
    "traced_alike",
    "warnings_of",
]
