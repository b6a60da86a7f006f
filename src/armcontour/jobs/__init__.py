"""Jobs, and `run`, which does all steps of a job and returns a study."""

from armcontour._lazy import lazy_names

_HOME = {
    "advice": "Advice Improvement advise",
    "analog": "analog_outputs",
    "experiment": "Experiment build_plant",
    "goal": "Goal",
    "job": "Job Rounding Run",
    "place_search": "PlaceSearch",
    "planning": "plan_one programs_of",
    "results": "ExperimentResult Planned RunResult ShapingGain Study warnings_of",
    "study": "STEPS run steps_of",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
