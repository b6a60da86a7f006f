"""Evaluation of executions and checks of trajectories, independent of the code that made them."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.evaluation.checking import Check, PathDeviation, check
    from armcontour.evaluation.error_profile import ErrorProfile, Missed
    from armcontour.evaluation.evaluation import Evaluation, evaluate
    from armcontour.evaluation.pieces import CornerDeviation
    from armcontour.evaluation.tally import LimitUse
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "checking": "Check PathDeviation check",
            "error_profile": "ErrorProfile Missed",
            "evaluation": "Evaluation evaluate",
            "pieces": "CornerDeviation",
            "tally": "LimitUse",
        },
    )
