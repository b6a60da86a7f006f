"""Jobs, and the function `run`, which executes all steps of a job and returns a study."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "advice": "advise",
    "analog": "analog_outputs",
    "exports": "Exports",
    "goal": "CertificateGoal Uncertainty",
    "job": "Experiment Job Rounding Run build_plant",
    "planned_run": "Planned ShapingGain",
    "run_plan": "plan_one prepare_program round_program",
    "job_result": "Advice ExperimentResult Improvement JobResult RunResult warnings_of",
    "study": "STEPS run",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
