"""Jobs, and the function `run`, which executes all steps of a job and returns a `JobResult`."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "advice": "advise",
    "analog_signals": "analog_outputs",
    "certificate_goal": "CertificateGoal Uncertainty",
    "job": "Experiment Exports Job Rounding Run build_plant",
    "run_plan": "plan_one prepare_program find_resumption round_program",
    "run_record": "Advice ExperimentResult Improvement",
    "run_result": "JobResult RunResult warnings_of",
    "run_job": "STEPS run",
    "verdict": "Verdict",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
