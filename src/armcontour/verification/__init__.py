"""Evaluation of executions and checks of trajectories, independent of the code that made them."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "checking": "Check PathDeviation check",
    "error_profile": "Coverage ErrorProfile",
    "evaluation": "Evaluation evaluate",
    "pieces": "CornerDeviation",
    "tally": "LimitUse",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
