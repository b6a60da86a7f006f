"""Jobs, and `run`, which does all steps of a job and returns a study."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.jobs.analog import analog_outputs
    from armcontour.jobs.experiment import Experiment, build_plant
    from armcontour.jobs.goal import Goal
    from armcontour.jobs.job import Job, Rounding, Run
    from armcontour.jobs.place_search import PlaceSearch
    from armcontour.jobs.planning import plan_one, programs_of
    from armcontour.jobs.results import (
        ExperimentResult,
        Planned,
        RunResult,
        ShapingGain,
        Study,
        warnings_of,
    )
    from armcontour.jobs.study import STEPS, run, steps_of
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "analog": "analog_outputs",
            "experiment": "Experiment build_plant",
            "goal": "Goal",
            "job": "Job Rounding Run",
            "place_search": "PlaceSearch",
            "planning": "plan_one programs_of",
            "results": "ExperimentResult Planned RunResult ShapingGain Study warnings_of",
            "study": "STEPS run steps_of",
        },
    )
