"""Jobs, and the function `run`, which executes all steps of a job and returns a study."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "advice": "advise",
    "analog_signals": "analog_outputs",
    "certificate_goal": "CertificateGoal Uncertainty",
    "job": "Experiment Exports Job Rounding Run build_plant",
    "run_notes": "warnings_of",
    "run_plan": "plan_one prepare_program round_program",
    "run_result": "Advice ExperimentResult Improvement JobResult RunResult",
    "study": "STEPS run",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
