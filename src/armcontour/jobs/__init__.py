"""Jobs, and `run`, which does all steps of a job and returns a study."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "advice": "advise",
    "analog": "analog_outputs",
    "experiment": "Experiment build_plant",
    "goal": "CertificateGoal",
    "improvements": "Advice Improvement",
    "job": "Job Rounding Run",
    "place_search": "PlaceSearch",
    "planned": "Planned ShapingGain",
    "planning": "plan_one prepare_and_round",
    "results": "ExperimentResult JobResult RunResult warnings_of",
    "study": "STEPS run steps_of",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
