"""Evaluation of executions and checks of trajectories, independent of the code that made them."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "trajectory_check": "Check check",
    "interpolation_check": "InterpolationCheck check_interpolation",
    "error_profile": "Coverage ErrorProfile",
    "evaluation": "Evaluation evaluate",
    "contour_errors": "CornerDeviation",
    "repeated_runs": "RepeatedRuns",
    "limit_verdict": "LimitUse PathDeviation",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
